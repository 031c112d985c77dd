"""`headland robot`: a simulated robot tractor as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

if TYPE_CHECKING:
    from planner.service.robot.driver import Driver

HIDE = "An effect hidden in it that the twin does not know, such as steering_offset=1.5; may be given again."


def robot(
    plan: Annotated[Path, typer.Option(help="A plan of headland plan --save.")],
    tractor: Annotated[int, typer.Option(help="Which tractor of the plan, from 1.")] = 1,
    url: Annotated[str, typer.Option(help="Where the service is.")] = "http://127.0.0.1:8765",
    fleet: Annotated[Optional[str], typer.Option(help="Id of the fleet; by default the newest one.")] = None,  # noqa: UP045
    token: Annotated[Optional[str], typer.Option(envvar="HEADLAND_TOKEN", help="A token for control.")] = None,  # noqa: UP045
    hide: Annotated[Optional[list[str]], typer.Option(help=HIDE)] = None,  # noqa: UP045
    noise_m: Annotated[float, typer.Option("--noise-m", help="Noise of its positions, metres.")] = 0.01,
    times: Annotated[float, typer.Option(help="How much faster than real time; the fleet's own counts.")] = 1.0,
    seed: Annotated[int, typer.Option(help="Seed of its noise.")] = 1,
    seconds: Annotated[Optional[float], typer.Option(help="Stop after so long.")] = None,  # noqa: UP045
) -> None:
    """Drive one tractor of a plan as a simulated robot, linked to a fleet of the service.

    Example: headland robot --plan plan.json --tractor 2 --token hl_...
    """
    import asyncio

    from planner.commands.single import one_thread
    from planner.interrupts import quiet
    from planner.service.robot.client import Robot, newest_fleet

    one_thread()
    driver = _driver(plan, tractor, hide or [], noise_m, seed, times)
    which = newest_fleet(url, token) if fleet is None else fleet
    try:
        asyncio.run(Robot(driver, url, which, tractor, token).run(seconds))
    except KeyboardInterrupt:
        quiet()


def _driver(plan: Path, tractor: int, hide: list[str], noise_m: float, seed: int, times: float) -> Driver:
    """The tractor of a plan; raises a HeadlandError for what cannot be."""
    from fields.reading import read_text
    from planner.errors import ScenarioError
    from planner.service.robot.driver import Driver
    from planner.showing import machines_with, scenario_of
    from vehicle.errors import MissionError
    from vehicle.plan_file import saved_from_json

    saved = saved_from_json(read_text(plan, "a plan of headland plan --save", MissionError))
    if not 1 <= tractor <= saved.plan.tractors:
        raise ScenarioError(f"--tractor is {tractor}; the plan has {saved.plan.tractors}, so use 1 to that.")
    if not 0.0 <= noise_m <= 10.0:
        raise ScenarioError(f"--noise-m is {noise_m}; use 0 to 10 metres.")
    machine, implement = machines_with(saved, scenario_of(saved))
    mission = saved.plan.missions[tractor - 1]
    return Driver(mission, machine, implement, saved.origin_m, name=f"robot {tractor}", hidden=_hidden(hide),
                  noise_m=noise_m, seed=seed * 1000 + tractor, times=times)  # fmt: skip


def _hidden(hide: list[str]) -> dict[str, float]:
    from planner.errors import ScenarioError

    hidden = {}
    for each in hide:
        name, _, value = each.partition("=")
        try:
            hidden[name.strip()] = float(value)
        except ValueError:
            raise ScenarioError(f"--hide {each!r} has no value; write effect=value, steering_offset=1.5.") from None
    return hidden
