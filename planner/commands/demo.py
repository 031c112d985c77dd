"""`headland demo`: something to look at without any preparation."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

FIELD, WIDTH_M, TRACTORS = "iwamizawa", 3.0, 3
HIDDEN = {2: "steering_offset=1.5"}
"""What the second robot has wrong: its twin finds out."""
HEADLAND = (sys.executable, "-c", "from planner.main import main; main()")
TOKEN = "HEADLAND_TOKEN"  # where robots look for it: other users of a machine see command lines
END_S, PATIENCE_S = 10.0, 600.0

demo = typer.Typer(help="Demonstrations.\n\nExample: headland demo fleet", no_args_is_help=True)


@demo.callback()
def _demonstrations() -> None:
    """Demonstrations that need no preparation."""


@demo.command()
def fleet(
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    port: Annotated[int, typer.Option(help="Port of the service; 0 for any that is free.")] = 0,
    times: Annotated[float, typer.Option(help="How much faster than real time.")] = 3.0,
    seconds: Annotated[Optional[float], typer.Option(help="End after so long.")] = None,  # noqa: UP045
) -> None:
    """Start a service with a fleet of three simulated robots on a sample field; Ctrl-C, or SIGTERM, ends all of it.

    Example: headland demo fleet --times 5
    """
    from planner.interrupts import quiet

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # whoever ends this one ends service and robots too
    try:
        with tempfile.TemporaryDirectory(prefix="headland-demo-") as folder, contextlib.ExitStack() as stack:
            _shown(Path(folder), stack, browser, port, times, seconds)
    except KeyboardInterrupt:
        quiet()
    typer.echo("Service and robots have ended.")


def _shown(
    folder: Path, stack: contextlib.ExitStack, browser: bool, port: int, times: float, seconds: float | None
) -> None:
    from planner.service.robot.client import asked

    plan = folder / "plan.json"
    typer.echo(f"Planning {FIELD} for {TRACTORS} tractors.")
    plan.write_text(_plan_text(), encoding="utf-8")
    data = folder / "data"
    token = _new_token(data)
    service, url = stack.enter_context(_service(data, port))
    _awaited(url, service)
    body = {"name": f"{FIELD} with {TRACTORS} robots", "plan": plan.read_text(encoding="utf-8"), "times": times}
    id = asked(url, "fleets", token, body)["id"]
    for number in range(1, TRACTORS + 1):
        hide = ("--hide", HIDDEN[number]) if number in HIDDEN else ()
        words = ("robot", "--plan", str(plan), "--tractor", str(number), "--url", url, "--fleet", id)
        stack.enter_context(_running((*words, *hide), env=os.environ | {TOKEN: token}))
    asked(url, f"fleets/{id}/start", token, {})
    typer.echo(f"The fleet drives: {url}/ (token for control: {token}). Ctrl-C ends all of it.")
    if browser:
        import webbrowser

        webbrowser.open(f"{url}/")
    begin = time.monotonic()
    while seconds is None or time.monotonic() - begin < seconds:
        time.sleep(0.2)


def _awaited(url: str, service: subprocess.Popen[str]) -> None:
    """Wait until a service answers: where it runs for the first time, it compiles first."""
    from planner.service.errors import ServiceError
    from planner.service.robot.client import asked

    begin = time.monotonic()
    while True:
        try:
            asked(url, "health", None)
            return
        except ServiceError:
            if service.poll() is not None or time.monotonic() - begin > PATIENCE_S:
                raise
            time.sleep(0.5)


def _plan_text() -> str:
    """A plan of the sample field, made now."""
    from planner.commands.show import progress_bar, warm_up
    from planner.planning import plan as simulate_all
    from planner.saving import saved_plan
    from planner.scenario import Scenario

    warm_up()
    scenario = Scenario(field=FIELD, width_m=WIDTH_M, tractors=(TRACTORS,), strategies=("split-field",))
    with progress_bar("Simulating plans") as progress:
        planned = simulate_all(scenario, progress=progress)
    assert planned.run is not None  # a sample field that is planned in every test
    return saved_plan(planned.site, planned.run.plan)


def _new_token(data: Path) -> str:
    from planner.commands.serve import settings_of
    from planner.service.store import Store

    store = Store(settings_of(data, ""))
    try:
        return store.new_token("demonstration", "control")
    finally:
        store.close()


@contextlib.contextmanager
def _service(data: Path, port: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A service in a process of its own; the address it listens on."""
    with _running(("serve", "--data", str(data), "--port", str(port)), stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        address = next((word for word in line.split() if word.startswith("http://")), None)
        if address is None:
            from planner.service.errors import ServiceError

            raise ServiceError("The service did not start; headland serve says why.")
        yield process, address.rstrip("/")


@contextlib.contextmanager
def _running(words: tuple[str, ...], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A command of Headland in a process of its own, deaf to this one's Ctrl-C, which ends with the body."""
    process = subprocess.Popen((*HEADLAND, *words), text=True, start_new_session=True, **options)
    try:
        yield process
    finally:
        with _undisturbed():
            process.terminate()
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """No further Ctrl-C or SIGTERM, and no repeated one, keeps a process from being ended."""
    from planner.interrupts import quiet

    before = {which: signal.signal(which, signal.SIG_IGN) for which in (signal.SIGINT, signal.SIGTERM)}
    quiet()
    try:
        yield
    finally:
        for which, handler in before.items():
            signal.signal(which, handler)
