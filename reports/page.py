"""One self-contained page per ranking: it asks for nothing outside itself and works without a network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from reports import palette
from reports.drawing import bar_rows, front_picture, map_picture
from reports.paths import STATES, check_drive
from reports.results import Drive, PlanResult, Ranking
from reports.wording import (
    clearance,
    duration,
    effects_words,
    feasible,
    headline,
    members,
    number,
    price,
    refusals,
    refused,
    remarks,
    tractors,
    yes_no,
)

Value = float | int | str | bool | None


@dataclass(frozen=True)
class _Column:
    """A column of the full table: heading, what it sorts by, and how it reads."""

    heading: str
    value: Callable[[PlanResult], Value]
    text: Callable[[PlanResult], str]
    words: bool = False


_COLUMNS = (
    _Column("Rank", lambda p: p.rank, lambda p: str(p.rank or "")),
    _Column("Tractors", lambda p: p.tractors, lambda p: str(p.tractors)),
    _Column("Strategy", lambda p: p.strategy, lambda p: p.strategy, words=True),
    _Column("Turn", lambda p: p.turn, lambda p: p.turn, words=True),
    _Column("Time", lambda p: p.time_s, lambda p: duration(p.time_s)),
    _Column("Tractor time", lambda p: p.tractor_time_s, lambda p: duration(p.tractor_time_s)),
    _Column("Cost", lambda p: p.cost, lambda p: price(p.cost)),
    _Column("Turning", lambda p: p.turning_s, lambda p: duration(p.turning_s)),
    _Column("Waiting", lambda p: p.waiting_s, lambda p: duration(p.waiting_s)),
    _Column("Reversals", lambda p: p.reversals, lambda p: number(p.reversals, 0)),
    _Column("Worked %", lambda p: p.worked_pct, lambda p: number(p.worked_pct, 1)),
    _Column("Overlap %", lambda p: p.overlap_pct, lambda p: number(p.overlap_pct, 1)),
    _Column("Outside m", lambda p: p.outside_m, lambda p: number(p.outside_m, 1)),
    _Column("Farthest out m", lambda p: p.excursion_m, lambda p: number(p.excursion_m, 2)),
    _Column("Clearance m", clearance, lambda p: number(clearance(p), 2)),
    _Column("Collisions", lambda p: p.collisions, lambda p: number(p.collisions, 0)),
    _Column("On the front", lambda p: p.on_pareto_front, lambda p: yes_no(p.on_pareto_front)),
)
_DEADLINE = _Column("In time", lambda p: p.meets_deadline, lambda p: yes_no(p.meets_deadline))


def plan_page(ranking: Ranking, drive: Drive | None) -> str:
    """The page as HTML text.

    Headline in plain words, map with a slider through time (when a drive is given), time per tractor, time
    against number of tractors, every plan in a table that sorts, what was refused and why, and the assumptions.

    Raises:
        ReportError: the drive cannot be drawn.
    """
    from jinja2 import Environment, StrictUndefined

    if drive is not None:
        check_drive(drive)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = files("reports").joinpath("plan.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source).render(_content(ranking, drive)).rstrip() + "\n"


def _content(ranking: Ranking, drive: Drive | None) -> dict[str, Any]:
    plans, effects = feasible(ranking), effects_words(ranking)
    columns = [*_COLUMNS, _DEADLINE] if any(plan.meets_deadline is not None for plan in plans) else list(_COLUMNS)
    return {
        "name": ranking.field_name,
        "area": number(ranking.area_ha, 2),
        "seed": ranking.seed,
        "headline": headline(ranking),
        "facts": _facts(ranking.best),
        "drive": drive,
        "map": None if drive is None else map_picture(drive),
        "bars": [] if drive is None else bar_rows(drive),
        "front": front_picture(ranking),
        "columns": columns,
        "rows": [_row(plan, columns, plan is ranking.best) for plan in plans],
        "remarks": remarks(plans),
        "refused": len(refused(ranking)),
        "refusals": [
            {"count": len(group.plans), "reason": group.reason, "alike": group.alike, "members": members(group)}
            for group in refusals(refused(ranking))
        ],
        "assumptions": [*ranking.assumptions, *([effects] if effects else [])],
        "states": list(STATES),
        "state_colours": palette.STATES,
        "tractor_colours": list(zip(palette.TRACTORS, palette.TRACTORS_ON_DARK, strict=True)),
    }


def _facts(best: PlanResult | None) -> list[tuple[str, str]]:
    """What the best plan comes to, label and value; what is not known is left out."""
    if best is None:
        return []
    facts = [
        ("Time", duration(best.time_s)),
        ("Fleet", tractors(best.tractors)),
        ("Cost", price(best.cost)),
        ("Worked", _with_unit(best.worked_pct, 1, "%")),
        ("Overlap", _with_unit(best.overlap_pct, 1, "%")),
        ("Closest approach", _with_unit(clearance(best), 2, "m")),
    ]
    return [(label, value) for label, value in facts if value != number(None, 0)]


def _with_unit(value: float | None, decimals: int, unit: str) -> str:
    text = number(value, decimals)
    return text if text == number(None, 0) else f"{text} {unit}"


def _row(plan: PlanResult, columns: list[_Column], best: bool) -> dict[str, Any]:
    cells = []
    for column in columns:
        value = column.value(plan)
        sort = "" if value is None else str(int(value)) if isinstance(value, bool) else str(value)
        cells.append({"sort": sort, "text": column.text(plan), "words": column.words})
    return {"best": best, "cells": cells}
