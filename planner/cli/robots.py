"""`headland demo` (a service with a fleet, ready to watch) and `headland robot` (a simulated tractor)."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Annotated, Any, Optional

import typer

from planner.cli.common.options import create_group, is_web_address
from planner.cli.common.terminal import create_progress_callback, limit_linear_algebra_threads, warm_up
from planner.errors import RequestError
from planner.pipeline.interrupts import stop_repeating

DEMO_FIELD, DEMO_WIDTH_M, DEMO_TRACTORS = "iwamizawa", 3.0, 3
HIDDEN_EFFECTS = {2: "steering_offset=1.5"}
"""An error of the second robot that its twin finds."""
HEADLAND_COMMAND = (sys.executable, "-c", "from planner.cli.main import main; main()")
TOKEN_VARIABLE = "HEADLAND_TOKEN"  # an environment variable, as other users of a machine see command lines
# Longer than a service waits for its office, and that for its workers: one killed earlier leaves semaphores behind.
STARTUP_S = 600.0

demo = create_group("Demonstrations.\n\nExample: headland demo fleet")


@demo.command()
def fleet(
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    port: Annotated[int, typer.Option(help="Port of the service; 0 for any that is free.")] = 0,
    times: Annotated[float, typer.Option(help="Times faster than real time.")] = 3.0,
    seconds: Annotated[Optional[float], typer.Option(help="End after this many seconds.")] = None,
) -> None:
    """Start a service with three simulated robots on a sample field; Ctrl-C or SIGTERM ends all of it.

    Example: headland demo fleet --times 5
    """

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ending this process ends service and robots too
    try:
        with tempfile.TemporaryDirectory(prefix="headland-demo-") as folder, contextlib.ExitStack() as stack:
            _run_demo(Path(folder), stack, browser, port, times, seconds)
    except KeyboardInterrupt:
        stop_repeating()
    typer.echo("Service and robots have ended.")


def _run_demo(
    folder: Path, stack: contextlib.ExitStack, browser: bool, port: int, times: float, seconds: float | None
) -> None:
    from planner.pipeline.outputs.saved_plans import write_saved_plan
    from planner.pipeline.planning import plan as simulate_all
    from planner.request.plan_request import PlanRequest
    from planner.service.errors import ServiceError
    from planner.service.fleets.robot_client import request_json

    plan = folder / "plan.json"
    typer.echo(f"Planning {DEMO_FIELD} for {DEMO_TRACTORS} tractors.")
    warm_up()
    request = PlanRequest(
        field=DEMO_FIELD, width_m=DEMO_WIDTH_M, tractors=(DEMO_TRACTORS,), strategies=("split-field",)
    )
    with create_progress_callback("Simulating plans") as progress:
        result = simulate_all(request, progress=progress)
    assert result.run is not None  # this sample field always has a plan
    text = write_saved_plan(result.context, result.run.plan)
    plan.write_text(text, encoding="utf-8")
    data = folder / "data"
    token = _create_token(data, "operator", "operator")
    service, url, login = stack.enter_context(_start_service(data, port))
    begin_s = time.monotonic()
    while True:  # until the service answers; on the first run it compiles first
        try:
            request_json(url, "health", None)
            break
        except ServiceError:
            if service.poll() is not None or time.monotonic() - begin_s > STARTUP_S:
                raise
            time.sleep(0.5)
    body = {"name": f"{DEMO_FIELD} with {DEMO_TRACTORS} robots", "plan": text, "times": times}
    fleet_id = request_json(url, "fleets", token, body)["id"]
    for number in range(1, DEMO_TRACTORS + 1):
        hide = ("--hide", HIDDEN_EFFECTS[number]) if number in HIDDEN_EFFECTS else ()
        arguments = ("robot", "--plan", str(plan), "--tractor", str(number), "--url", url, "--fleet", fleet_id)
        robot_token = _create_token(data, f"robot {number}", "robot", fleet=fleet_id, tractor=number)
        stack.enter_context(_run_headland_command((*arguments, *hide), env=os.environ | {TOKEN_VARIABLE: robot_token}))
    request_json(url, f"fleets/{fleet_id}/start", token, {})
    typer.echo(f"The fleet is driving. Open this address to watch it, once: {login}")
    typer.echo(f"To control it, enter this operator token there: {token}. Ctrl-C ends everything.")
    if browser:
        import webbrowser

        webbrowser.open(login)
    begin_s = time.monotonic()
    while seconds is None or time.monotonic() - begin_s < seconds:
        time.sleep(0.2)


def _create_token(data: Path, name: str, scope: str, **restrictions: Any) -> str:
    """A token with one scope, for a day."""
    from planner.cli.server import build_settings
    from planner.service.store.service_store import open_store

    with open_store(build_settings(data, "")) as store:
        return store.create_token_text(name, scope, expires="24h", **restrictions)


@contextlib.contextmanager
def _start_service(data: Path, port: int) -> Iterator[tuple[subprocess.Popen[str], str, str]]:
    """A service in its own process, its address, and the login link for a browser."""
    with _run_headland_command(("serve", "--data", str(data), "--port", str(port)), stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        address = next((word for word in line.split() if word.startswith("http://")), None)
        if address is None:
            from planner.service.errors import ServiceError

            raise ServiceError("The service did not start; run headland serve to see why.")
        login = process.stdout.readline().strip().rpartition(" ")[2]
        threading.Thread(target=_drain_output, args=(process.stdout,), daemon=True).start()
        yield process, address.rstrip("/"), login


def _drain_output(stream: IO[str]) -> None:
    """Read the output of a process until it ends, so that it is never blocked by a full pipe."""
    with contextlib.suppress(ValueError):
        for _ in stream:
            pass


@contextlib.contextmanager
def _run_headland_command(arguments: tuple[str, ...], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A command of Headland in its own process and session (Ctrl-C here does not reach it), ended with the body."""
    process = subprocess.Popen((*HEADLAND_COMMAND, *arguments), text=True, start_new_session=True, **options)
    try:
        yield process
    finally:
        ends = (signal.SIGINT, signal.SIGTERM)  # ignored while the process is being ended
        handlers = {signal_number: signal.signal(signal_number, signal.SIG_IGN) for signal_number in ends}
        stop_repeating()
        try:
            process.terminate()
            try:
                process.wait(60.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()
        finally:
            for signal_number, handler in handlers.items():
                signal.signal(signal_number, handler)


def robot(
    plan: Annotated[Path, typer.Option(help="A plan of headland plan --save.")],
    tractor: Annotated[int, typer.Option(help="Tractor of the plan, from 1.")] = 1,
    url: Annotated[str, typer.Option(help="Address of the service.")] = "http://127.0.0.1:8765",
    fleet: Annotated[Optional[str], typer.Option(help="Id of the fleet; by default the newest one.")] = None,
    token: Annotated[
        Optional[str], typer.Option(envvar=TOKEN_VARIABLE, help="A token with scope robot for this tractor.")
    ] = None,
    hide: Annotated[
        Optional[list[str]],
        typer.Option(
            help="An effect of the robot that its twin does not know, such as steering_offset=1.5; may be repeated."
        ),
    ] = None,
    noise_m: Annotated[float, typer.Option("--noise-m", help="Noise of positions, metres.")] = 0.01,
    times: Annotated[float, typer.Option(help="Times faster than real time; the value of the fleet wins.")] = 1.0,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 1,
    seconds: Annotated[Optional[float], typer.Option(help="Stop after this many seconds.")] = None,
) -> None:
    """Drive one tractor of a plan as a simulated robot that is connected to a fleet of the service.

    Example: headland robot --plan plan.json --tractor 2 --token hl_...
    """
    limit_linear_algebra_threads()
    import asyncio

    from planner.fleet.simulated_robot import RobotDriver
    from planner.pipeline.outputs.saved_plans import load_saved_plan, read_machines, read_request
    from planner.service.fleets.robot_client import RobotClient, find_newest_fleet

    if not is_web_address(url):
        raise RequestError(f"--url {url!r} is not the address of a service; give one such as http://127.0.0.1:8765.")
    saved = load_saved_plan(plan)
    if not 1 <= tractor <= saved.plan.tractors:
        raise RequestError(f"--tractor is {tractor}; use 1 to {saved.plan.tractors}, the tractors of the plan.")
    if not 0.0 <= noise_m <= 10.0:
        raise RequestError(f"--noise-m is {noise_m}; use 0 to 10 metres.")
    machine, implement = read_machines(saved, read_request(saved))
    driver = RobotDriver(
        saved.plan.missions[tractor - 1], machine, implement, saved.origin_m, name=f"robot {tractor}",
        hidden=_parse_hidden_effects(hide or ()), noise_m=noise_m, seed=seed * 1000 + tractor, times=times,
    )  # fmt: skip
    fleet_id = find_newest_fleet(url, token) if fleet is None else fleet
    try:
        asyncio.run(RobotClient(driver, url, fleet_id, tractor, token).run(seconds))
    except KeyboardInterrupt:
        stop_repeating()


def _parse_hidden_effects(texts: Sequence[str]) -> dict[str, float]:
    """Values by effect of texts such as steering_offset=1.5; raises RequestError."""
    hidden = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            hidden[name.strip()] = float(value)
        except ValueError:
            raise RequestError(
                f"--hide {text!r} has no value; write effect=value, such as steering_offset=1.5."
            ) from None
    return hidden
