"""The lists that drivers take along: what each tractor does, in order, for the terminal and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.fitting import Column, FittedTable, sentence
from reports.plain import finite
from reports.results import Step
from reports.step_words import step_words
from reports.wording import clock_at, duration, minutes, number

Steps = Sequence[Sequence[Step]]

STEP_KEYS = (
    "number", "words", "kind", "from_s", "seconds", "length_m", "track", "round", "part", "bearing_deg", "over_tracks",
    "shape", "for_tractors",
)  # fmt: skip
HEADINGS = ("No.", "Leg", "From", "Metres", "Min:s")
_DECIMALS = 2


def leg_lists(title: str, steps: Steps, start: str | None = None, only: int | None = None) -> RenderableType:
    """A table per tractor, or of tractor `only` (from 1); with a `start` the times are those of the clock."""
    parts: list[RenderableType] = [Text(title, style="bold underline")]
    when = "times of day" if start else "after the start"
    parts.append(sentence(f"From is h:mm:ss {when}; Min:s is how long it takes.", style="dim"))
    for tractor, rows in enumerate(steps, start=1):
        if only in (None, tractor):
            parts += [Text(""), Text(heading(tractor, rows), style="bold"), _table(rows, start)]
    return Group(*parts)


def heading(tractor: int, steps: Sequence[Step]) -> str:
    """``Tractor 2: 21 legs, 4.1 km, 0:52:10``."""
    length_m, end_s = sum(step.length_m for step in steps), steps[-1].from_s + steps[-1].seconds if steps else 0.0
    legs = f"{len(steps)} leg{'' if len(steps) == 1 else 's'}"
    return f"Tractor {tractor}: {legs}, {number(length_m / 1000.0, 1)} km, {duration(end_s)}"


def cells(place: int, step: Step, start: str | None = None) -> tuple[str, ...]:
    """The row of a step under `HEADINGS`."""
    return str(place), step_words(step), clock_at(start, step.from_s), metres(step), minutes(step.seconds)


def metres(step: Step) -> str:
    """How far it leads; nothing of a wait."""
    return "" if step.kind in ("wait", "refill") else number(step.length_m, 0)


def text_rows(steps: Sequence[Step]) -> list[str]:
    """The rows of a list in columns for a fixed pitch, a heading first."""
    rows = [HEADINGS, *(cells(place, step) for place, step in enumerate(steps, start=1))]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        " ".join(cell.ljust(width) if place == 1 else cell.rjust(width)
                 for place, (cell, width) in enumerate(zip(row, widths, strict=True)))
        for row in rows
    ]  # fmt: skip


def _table(steps: Sequence[Step], start: str | None) -> FittedTable:
    columns = tuple(Column(name, words=name == "Leg") for name in HEADINGS)
    return FittedTable(columns, tuple(cells(place, step, start) for place, step in enumerate(steps, start=1)))


def leg_lists_json(steps: Steps, about: dict[str, Any], only: int | None = None) -> str:
    """The lists as JSON text with a trailing newline: what is said of the plan, then ``tractors``.

    Each has its number (``tractor``) and ``legs`` with `STEP_KEYS`; what a leg does not have is null.
    """
    lists = [
        {"tractor": tractor, "legs": [_entry(place, step) for place, step in enumerate(rows, start=1)]}
        for tractor, rows in enumerate(steps, start=1)
        if only in (None, tractor)
    ]
    return json.dumps(finite({**about, "tractors": lists}, _DECIMALS), indent=2, ensure_ascii=False) + "\n"


def _entry(place: int, step: Step) -> dict[str, Any]:
    values = (
        place, step_words(step), step.kind, step.from_s, step.seconds, step.length_m,
        None if step.to_round else step.number, step.number if step.to_round else None, step.part or None,
        step.bearing_deg, step.over, step.shape or None, list(step.for_tractors),
    )  # fmt: skip
    return dict(zip(STEP_KEYS, values, strict=True))
