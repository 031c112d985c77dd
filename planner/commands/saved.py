"""`headland show`: what each tractor of a saved plan does, in order."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from planner.commands.options import AsJson

if TYPE_CHECKING:
    from planner.showing import Shown


def show(
    plan: Annotated[Path, typer.Argument(help="A plan written by headland plan --save.")],
    tractor: Annotated[Optional[int], typer.Option(help="Show this tractor alone, counted from 1.")] = None,  # noqa: UP045
    json: AsJson = False,
) -> None:
    """Show the legs of every tractor of a saved plan in order: what, from when, how far and how long.

    Example: headland show plan.json --tractor 2
    """
    from planner.commands.show import out, progress_bar, remark, warm_up
    from planner.errors import ScenarioError
    from planner.showing import show as drive_again
    from reports.leg_list import leg_lists, leg_lists_json

    warm_up()
    with progress_bar("Driving the plan again"):
        shown = drive_again(plan)
    remark(_touching(shown))
    count = len(shown.steps)
    if tractor is not None and not 1 <= tractor <= count:
        raise ScenarioError(f"--tractor is {tractor}; the plan has tractors 1 to {count}.", parameter="tractor")
    if json:
        typer.echo(leg_lists_json(shown.steps, _about(shown), tractor), nl=False)
        return
    out(leg_lists(_title(shown), shown.steps, _start(shown), tractor))


def _touching(shown: Shown) -> list[str]:
    """Who touches whom, which no plan that was saved does before somebody changes it."""
    return [
        f"Tractors {first + 1} and {second + 1} touch after {time:.0f} s; plan anew."
        for time, first, second in shown.run.contacts
    ]


def _about(shown: Shown) -> dict[str, Any]:
    """What the plan is, before its legs."""
    return {
        "field": shown.scenario.field,
        "strategy": shown.saved.plan.notes.get("strategy"),
        "start": _start(shown),
        "time_s": shown.run.duration_s,
    }


def _title(shown: Shown) -> str:
    from reports.wording import duration, tractors

    words = [shown.saved.plan.notes.get("strategy"), tractors(shown.saved.plan.tractors)]
    told = ", ".join(str(word) for word in words if word)
    return f"{shown.scenario.field}: {told}, done in {duration(shown.run.duration_s)}"


def _start(shown: Shown) -> str | None:
    from planner.scenario import clock

    return None if shown.scenario.start_s is None else clock(shown.scenario.start_s)
