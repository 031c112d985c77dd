"""Imported runs: a table for the terminal, and JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from rich.console import Group, RenderableType

from reports.fitting import Column, FittedTable, sentence
from reports.plain import finite
from reports.wording import NOTHING, duration, number, percent
from reports.work_results import RunTold

KMH = 3.6
_FIGURE = re.compile(r"\d+(?:\.\d+)?")
_COLUMNS = (
    Column("Run", words=True),
    Column("Date", whole=True),
    Column("Field", words=True, drop=1),
    Column("Time", whole=True),
    Column("ha"),
    Column("km"),
    Column("Working (%)", "Work%"),
    Column("Turns", drop=2),
    Column("Stops", drop=3),
    Column("Lifts", drop=4),
    Column("Speed (km/h)", "km/h", drop=5),
    Column("Fuel (l)", "l", drop=6),
)


def runs_table(runs: Sequence[RunTold]) -> RenderableType:
    """One run to a line, and below the whole of them where there are more."""
    rows = [_row(run) for run in runs]
    if len(runs) > 1:
        rows.append(_total(runs))
    return Group(FittedTable(_COLUMNS, tuple(rows)), *(sentence(words) for words in told_notes(runs)))


def _row(run: RunTold) -> tuple[str, ...]:
    what = run.figures
    speed = None if what.working_mps is None else what.working_mps * KMH
    length = None if what.active_m is None or what.inactive_m is None else what.active_m + what.inactive_m
    return (
        run.name, run.start[:10] or NOTHING, run.field or NOTHING, duration(what.seconds), _hectares(what.area_m2),
        number((what.placed_m if length is None else length) / 1e3, 2), percent(what.share_working), _count(what.turns),
        _count(what.stops), _count(what.lifts), number(speed, 1), number(what.fuel_l, 0),
    )  # fmt: skip


def _total(runs: Sequence[RunTold]) -> tuple[str, ...]:
    """The sum of all runs; of speeds and shares there is none."""
    what = [run.figures for run in runs]
    seconds = sum(one.seconds for one in what)
    known = [one for one in what if one.share_working is not None]
    fuel = [one.fuel_l for one in what if one.fuel_l is not None]
    share = sum(one.by_kind_s["working"] for one in known) / max(sum(one.seconds for one in known), 1e-9)
    length = sum(one.placed_m if one.counted_m is None else one.counted_m for one in what)
    return (
        f"all {len(runs)}", "", "", duration(seconds), _hectares(sum(one.area_m2 or 0.0 for one in what)),
        number(length / 1e3, 2), percent(share) if known else NOTHING, str(sum(one.turns or 0 for one in what)),
        str(sum(one.stops for one in what)), str(sum(one.lifts or 0 for one in what)), "",
        number(sum(fuel), 0) if fuel else NOTHING,
    )  # fmt: skip


def told_notes(runs: Sequence[RunTold]) -> Iterator[str]:
    """What is odd about the runs; what is odd about several, figures apart, once with how many."""
    alike: dict[str, list[tuple[RunTold, str]]] = {}
    for run in runs:
        for note in run.notes:
            alike.setdefault(_FIGURE.sub("#", note), []).append((run, note))
    for members in alike.values():
        run, note = members[0]
        if len(members) == 1:
            yield f"{run.name}: {note}."
        elif all(other == note for _, other in members):
            yield f"{len(members)} runs: {note}."
        else:
            yield f"{len(members)} runs, {run.name} for instance: {note}."


def runs_json(runs: Sequence[RunTold], notes: Sequence[str]) -> str:
    """An object: `runs` with their figures in SI units, and `notes` on what could not be read."""
    told = {"runs": [_entry(run) for run in runs], "notes": list(notes)}
    return json.dumps(finite(told), indent=2, allow_nan=False) + "\n"


def _entry(run: RunTold) -> dict[str, object]:
    about = {key: value for key, value in asdict(run).items() if key not in ("figures", "notes")}
    return {**about, **asdict(run.figures), "share_working": run.figures.share_working, "notes": list(run.notes)}


def _hectares(m2: float | None) -> str:
    return NOTHING if m2 is None else number(m2 / 1e4, 2)


def _count(value: int | None) -> str:
    return NOTHING if value is None else str(value)
