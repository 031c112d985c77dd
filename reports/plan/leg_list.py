"""Leg lists for drivers: what each tractor does, in order, for the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from fields.units import name_compass_point
from reports.common.plan_records import DriverLeg
from reports.common.rendering import format_json, pick_values
from reports.common.text_tables import MOST_NAMED, build_plain_table, format_sentence, format_title
from reports.common.wording import (
    LEAST_WHOLE,
    format_clock_at,
    format_duration,
    format_minutes,
    format_number,
    join_list,
)

LEG_DECIMALS = 2
_LEAST_DRIVE_M = 0.5  # shorter ways to where a tractor rests are not told
_LONG_REVERSING_M = 10.0  # a switch-back or corner backs up by less, and says so by its name
_TURN_NAMES = {"u": "U", "omega": "omega", "switch-back": "switch-back"}

Steps = Sequence[Sequence[DriverLeg]]
_STANDS = ("wait", "fold", "unfold", "refill", "charge", "change")
LEG_HEADINGS = ("No.", "Leg", "From", "Metres", "Min:s")


def describe_leg(leg: DriverLeg) -> str:
    """A leg in a few words: ``track 14, northwards``, ``way to track 16, reversing 12 m, over finished track 3``."""
    parts = [_describe_purpose(leg)]
    is_named = leg.shape == "switch-back" and leg.kind in ("turn", "corner")
    if leg.reversing_m >= (_LONG_REVERSING_M if is_named else LEAST_WHOLE):
        parts.append(f"reversing {format_number(leg.reversing_m, 0)} m")
    parts += [f"over finished {_name_ground(leg.over_finished)}"] if leg.over_finished else []
    parts += [f"over uncut {_name_ground(leg.over_standing)}"] if leg.over_standing else []
    return ", ".join([*parts, *([f"with a break of {format_duration(leg.pause_s)}"] if leg.pause_s else [])])


def _name_ground(names: Sequence[str]) -> str:
    """``tracks 3 and 4``, ``headland`` or both."""
    tracks = [name for name in names if name != "headland"]
    places = [_name_few("track", tracks)] if tracks else []
    return " and ".join([*places, *(["headland"] if len(tracks) < len(names) else [])])


def _name_few(noun: str, names: Sequence[object]) -> str:
    """``track 3``, ``tracks 3, 4 and 5``; where there are more, how many."""
    return (
        f"{len(names)} {noun}s"
        if len(names) > MOST_NAMED
        else f"{noun}{'s' if len(names) > 1 else ''} {join_list(names)}"
    )


def _describe_purpose(leg: DriverLeg) -> str:
    """What a leg is for."""
    if leg.kind == "wait":
        awaited = _name_few("tractor", leg.for_tractors)
        return f"wait for {awaited}" if leg.for_tractors else "wait"
    if leg.kind == "rest":
        return "rest here" if leg.length_m < _LEAST_DRIVE_M else "drive aside and rest"
    if leg.kind == "refill":
        amount = "" if leg.amount is None else f" {abs(leg.amount):.0f} l or kg"
        return f"{'unload' if (leg.amount or 0.0) < 0.0 else 'refill'}{amount}"
    if leg.kind in ("fold", "unfold"):
        return f"{leg.kind} the implement"
    if leg.kind in ("charge", "change"):
        return "change of the battery" if leg.kind == "change" else f"charge {leg.amount or 0.0:.1f} kWh"
    if leg.kind == "refill-way":
        return "to the service point"
    if leg.kind == "drive":
        return "continue"
    if leg.kind == "leave":
        return "on to the entrance" if leg.continues else "back to the entrance"
    if leg.kind == "enter" and leg.number is None:
        return "in by the entrance"
    goal = f"track {leg.number}{leg.part}"
    if leg.is_headland_pass:
        goal = f"round {leg.number}" + (f", side {leg.part}" if leg.part else "")
    if leg.kind in ("track", "round"):
        heading = "all round"  # along a closed line
        if leg.bearing_deg is not None:
            heading = f"{name_compass_point(leg.bearing_deg)}wards"
        return f"{goal}, {'the rest' if leg.continues else heading}"
    if leg.continues:
        return f"on to {goal}"
    if leg.kind == "corner":
        return f"corner to side {leg.part}{', backing up' if leg.shape == 'switch-back' else ''}"
    if leg.kind == "enter":
        return f"from the entrance to {goal}"
    if leg.kind == "way":
        return f"way to {goal}"
    over = "" if leg.over_swaths is None else f" over {leg.over_swaths} track{'s' if leg.over_swaths > 1 else ''}"
    return f"{_TURN_NAMES.get(leg.shape, 'turn')}{over} to {goal}"


def build_leg_tables(
    title: str, steps: Steps, start: str | None = None, only_tractor: int | None = None
) -> RenderableType:
    """A table per tractor, or only for `only_tractor` (from 1); with a `start` times are clock times."""
    parts: list[RenderableType] = [format_title(title)]
    when = "time of day" if start else "after the start"
    parts.append(format_sentence(f"From: h:mm:ss, {when}. Min:s: duration.", style="dim"))
    for tractor, rows in enumerate(steps, start=1):
        if only_tractor in (None, tractor):
            heading = Text(format_leg_heading(tractor, rows), style="bold")
            parts += [Text(""), heading, build_plain_table(LEG_HEADINGS, list_leg_cells(rows, start), texts=(1,))]
    return Group(*parts)


def format_leg_heading(tractor: int, steps: Sequence[DriverLeg]) -> str:
    """``Tractor 2: 21 legs, 4.1 km, 0:52:10 on the field``, without breaks."""
    length_m, end_s = sum(step.length_m for step in steps), steps[-1].from_s + steps[-1].seconds if steps else 0.0
    legs = f"{len(steps)} leg{'' if len(steps) == 1 else 's'}"
    return f"Tractor {tractor}: {legs}, {format_number(length_m / 1000.0, 1)} km, {format_duration(end_s)} on the field"


def list_leg_cells(steps: Sequence[DriverLeg], start: str | None = None) -> list[tuple[str, ...]]:
    """A row of cells under `LEG_HEADINGS` for every leg; with a `start` times are clock times."""
    return [
        (str(place), describe_leg(one), format_clock_at(start, one.clock_s), format_leg_metres(one),
         format_minutes(one.seconds))
        for place, one in enumerate(steps, start=1)
    ]  # fmt: skip


def format_leg_metres(step: DriverLeg) -> str:
    """The length of a leg in metres; "" for a wait, folding or a service stop."""
    return "" if step.kind in _STANDS else format_number(step.length_m, 0)


def format_leg_rows(steps: Sequence[DriverLeg], start: str | None = None) -> list[str]:
    """The rows of a list as text of fixed pitch, headings first; with a `start` times are clock times."""
    rows = [LEG_HEADINGS, *list_leg_cells(steps, start)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        " ".join(cell.ljust(width) if place == 1 else cell.rjust(width)
                 for place, (cell, width) in enumerate(zip(row, widths, strict=True)))
        for row in rows
    ]  # fmt: skip


def format_leg_lists_json(steps: Steps, plan_facts: dict[str, Any], only_tractor: int | None = None) -> str:
    """The lists as JSON text with a trailing newline: `plan_facts`, then ``tractors``.

    Each of these has its number (``tractor``) and ``legs``; missing values are null.
    """
    lists = [
        {"tractor": tractor, "legs": [_build_leg_entry(place, step) for place, step in enumerate(rows, start=1)]}
        for tractor, rows in enumerate(steps, start=1)
        if only_tractor in (None, tractor)
    ]
    return format_json({**plan_facts, "tractors": lists}, LEG_DECIMALS, is_ascii=False)


def _build_leg_entry(place: int, step: DriverLeg) -> dict[str, Any]:
    return {
        "number": place, "words": describe_leg(step),
        **pick_values(step, ("kind", "from_s", "clock_s", "seconds", "pause_s", "length_m")),
        "swath": None if step.is_headland_pass else step.number,
        "headland_pass": step.number if step.is_headland_pass else None,
        "part": step.part or None, **pick_values(step, ("bearing_deg", "over_swaths")), "shape": step.shape or None,
        **pick_values(step, (
            "for_tractors", "reversing_m", "over_finished", "over_finished_m", "over_standing", "over_standing_m",
            "fuel_l", "energy_kwh", "slope_along_pct", "slope_across_pct",
        )),
    }  # fmt: skip
