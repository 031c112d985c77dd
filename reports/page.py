"""One self-contained page per ranking: it asks for nothing outside itself and works without a network."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from reports import palette
from reports.drawing import bar_rows, map_picture
from reports.front import front_picture
from reports.leg_list import HEADINGS, cells, heading
from reports.odds import odds_picture
from reports.palette import TRACTORS
from reports.paths import REFILLING, check_drive, states_of
from reports.results import Drive, PlanResult, Ranking
from reports.template import rendered
from reports.wording import (
    COLUMN_WORDS,
    LEFT_WORDS,
    SOFT_HYPHEN,
    area_or_dash,
    begin_s,
    bound,
    clearance,
    duration,
    effects_words,
    feasible,
    gap_words,
    headline,
    in_time,
    late_counts,
    left,
    machines,
    members,
    number,
    price,
    proven_words,
    refusals,
    refused,
    remarks,
    tractors,
    yes_no,
)

_SOFT = {"Collisions": "Colli|sions", "Reversals": "Rever|sals", "Tractors": "Trac|tors", "Clearance": "Clear|ance",
         "Farthest": "Farth|est"}  # fmt: skip
"""Where headings may be broken on narrow paper."""
_MORE_WORDS = {
    "Tractor time": "time of all tractors together, from the start to the end of each",
    "Turning": "time in turns, all tractors together",
    "Waiting": "time spent waiting for others, all tractors together",
    "Worked %": "share of the field that is worked",
    "Left": "ground that no implement worked",
    "In time %": "how often it is done in time, of all draws",
    "Cost": "cost of what was driven, as simulated",
    "Reversals": "how often a tractor changes between forwards and backwards",
    "To finish": "time with the ground that is left worked as well, at the plan's own rate",
    "Outside m": "length of the guided path outside the boundary",
    "Farthest out m": "how far the guided path goes outside the boundary",
    "Collisions": "how often tractors touch each other",
    "On the front": "nobody is faster with as few tractors",
    "Order gap %": "by how much any other order of the tracks could be quicker at most; - where the order is given",
    "In time": "done by the deadline, as simulated",
    "Median time": "as often as not it is done sooner",
    "At 95 %": "done sooner in 95 of 100 draws",
}

Value = float | int | str | bool | None
Plan = tuple[str, int]  # strategy and number of tractors


@dataclass(frozen=True)
class _Column:
    """A column of the full table: heading, what it sorts by, and how it reads."""

    heading: str
    value: Callable[[PlanResult], Value]
    text: Callable[[PlanResult], str]
    words: bool = False
    title: str = ""


_COST = _Column("Cost", lambda p: p.cost, lambda p: price(p.cost))
_COLUMNS = (
    _Column("Rank", lambda p: p.rank, lambda p: str(p.rank or "")),
    _Column("Tractors", lambda p: p.tractors, lambda p: str(p.tractors)),
    _Column("Strategy", lambda p: p.strategy, lambda p: p.strategy, words=True),
    _Column("Turn", lambda p: p.turn, lambda p: p.turn, words=True),
    _Column("Time", lambda p: p.time_s, lambda p: duration(p.time_s)),
    _Column("Tractor time", lambda p: p.tractor_time_s, lambda p: duration(p.tractor_time_s)),
    _COST,
    _Column("Turning", lambda p: p.turning_s, lambda p: duration(p.turning_s)),
    _Column("Waiting", lambda p: p.waiting_s, lambda p: duration(p.waiting_s)),
    _Column("Reversals", lambda p: p.reversals, lambda p: number(p.reversals, 0)),
    _Column("Worked %", lambda p: p.worked_pct, lambda p: number(p.worked_pct, 1)),
    _Column("Overlap %", lambda p: p.overlap_pct, lambda p: number(p.overlap_pct, 1)),
    _Column("Left", lambda p: p.missed_m2, lambda p: area_or_dash(p.missed_m2)),
    _Column("To finish", lambda p: p.finished_s, lambda p: duration(p.finished_s)),
    _Column("Outside m", lambda p: p.outside_m, lambda p: number(p.outside_m, 1)),
    _Column("Farthest out m", lambda p: p.excursion_m, lambda p: number(p.excursion_m, 2)),
    _Column("Clearance m", clearance, lambda p: number(clearance(p), 2)),
    _Column("Collisions", lambda p: p.collisions, lambda p: number(p.collisions, 0)),
    _Column("Order gap %", lambda p: p.order_gap_pct, lambda p: number(p.order_gap_pct, 1)),
    _Column("On the front", lambda p: p.on_pareto_front, lambda p: yes_no(p.on_pareto_front)),
)
_DEADLINE = _Column("In time", lambda p: p.meets_deadline, lambda p: yes_no(p.meets_deadline))
_DRAWN = (
    _Column("In time %", lambda p: p.finish_probability, in_time),
    _Column("Median time", lambda p: p.p50_s, lambda p: duration(p.p50_s)),
    _Column("At 95 %", lambda p: p.p95_s, lambda p: duration(p.p95_s)),
    _Column("Paid", lambda p: p.paid_cost, lambda p: price(p.paid_cost)),
)
_EXPECTED = _Column("Expected cost", lambda p: p.expected_cost, lambda p: price(p.expected_cost))
_REFILLED = (
    _Column("Refills", lambda p: p.refills, lambda p: number(p.refills, 0)),
    _Column("Refilling", lambda p: p.refilling_s, lambda p: duration(p.refilling_s)),
)


def plan_page(ranking: Ranking, drive: Drive | None, drives: Mapping[Plan, Drive] | None = None) -> str:
    """The page as HTML text.

    Headline in plain words, map with a slider through time (when a drive is given), time per tractor, time
    against number of tractors, every plan in a table that sorts, what was refused and why, and the assumptions.
    `drive` is that of the best plan; `drives` adds others by strategy and number of tractors, which a reader can
    choose for the map. Paths are thinned so that the page stays below two megabytes for all but huge tables.

    Raises:
        ReportError: a drive cannot be drawn.
    """
    shown = _shown(ranking, drive, drives or {})
    for one in shown.values():
        check_drive(one)
    return rendered("plan.html.j2", _content(ranking, shown))


def _shown(ranking: Ranking, drive: Drive | None, drives: Mapping[Plan, Drive]) -> dict[Plan | None, Drive]:
    """Drives to choose from: the best plan's first, the others as they are ranked."""
    best = ranking.best
    shown: dict[Plan | None, Drive] = {}
    if drive is not None:
        shown[_key(best) if best else None] = drive
    for plan in feasible(ranking):
        if _key(plan) in drives:
            shown.setdefault(_key(plan), drives[_key(plan)])
    return shown


def _key(plan: PlanResult) -> Plan:
    return plan.strategy, plan.tractors


def _content(ranking: Ranking, shown: Mapping[Plan | None, Drive]) -> dict[str, Any]:
    plans, effects = feasible(ranking), effects_words(ranking)
    columns = [*_COLUMNS, _DEADLINE] if any(plan.meets_deadline is not None for plan in plans) else list(_COLUMNS)
    if any(plan.expected_cost is not None for plan in plans):
        columns = [column for column in columns if column is not _COST] + [*_DRAWN]
        columns += [_EXPECTED] if late_counts(ranking) else []
    columns += _REFILLED if any(plan.refills is not None for plan in plans) else ()
    names, states = _names(plans, shown), states_of(shown.values())
    proven = proven_words(plans)
    first = next(iter(shown.values()), None)
    places = {key: number for number, key in enumerate(shown)}
    return {
        "name": ranking.field_name,
        "area": number(ranking.area_ha, 2),
        "machines": machines(ranking),
        "seed": ranking.seed,
        "headline": [bound(text) for text in headline(ranking)],
        "facts": _facts(ranking, ranking.best),
        "map": None if first is None else map_picture(dict(zip(names, shown.values(), strict=True))),
        "bars": [] if first is None else bar_rows(first, states),
        "states": states,
        "state_colours": palette.STATES | ({REFILLING: palette.REFILLING} if REFILLING in states else {}),
        "cards": [] if first is None else _cards(first, ranking.field_start or ranking.start),
        "headings": HEADINGS,
        "begin_s": begin_s(ranking.field_start or ranking.start),
        "front": front_picture(ranking),
        "odds": odds_picture(ranking),
        "columns": [replace(column, heading=_soft(column.heading), title=_title(column.heading)) for column in columns],
        "rows": [_row(plan, columns, plan is ranking.best, places.get(_key(plan))) for plan in plans],
        "remarks": [
            *([LEFT_WORDS] if any(plan.missed_m2 is not None for plan in plans) else []),
            *([proven] if proven else []),
            *remarks(plans),
            *(() if ranking.draws else ranking.money),
            *ranking.checked,
        ],
        "refused": len(refused(ranking)),
        "refusals": [
            {"count": len(group.plans), "reason": group.reason, "alike": group.alike, "members": members(group)}
            for group in refusals(refused(ranking))
        ],
        "assumptions": [*ranking.assumptions, *([effects] if effects else [])],
    }


def _cards(drive: Drive, start: str | None) -> list[dict[str, Any]]:
    """The list of legs of every tractor: heading, colour and rows of text."""
    return [
        {
            "number": tractor,
            "colour": (tractor - 1) % len(TRACTORS),
            "heading": heading(tractor, steps),
            "rows": [cells(place, step, start) for place, step in enumerate(steps, start=1)],
        }
        for tractor, steps in enumerate(drive.steps, start=1)
    ]


def _soft(heading: str) -> str:
    """A heading with soft hyphens."""
    for word, parted in _SOFT.items():
        heading = heading.replace(word, parted.replace("|", SOFT_HYPHEN))
    return heading


def _title(heading: str) -> str:
    """What a column holds, in words; "" where its heading says it."""
    words = _MORE_WORDS.get(heading) or COLUMN_WORDS.get(heading) or COLUMN_WORDS.get(heading.removesuffix(" cost"), "")
    return words[:1].upper() + words[1:]


def _names(plans: Sequence[PlanResult], shown: Mapping[Plan | None, Drive]) -> list[str]:
    """A line per drive to choose it by: ``6. split-field, 3 tractors, u, 0:25:57``."""
    by_key = {_key(plan): plan for plan in reversed(plans)}
    return [
        f"{plan.rank}. {plan.strategy}, {tractors(plan.tractors)}, {plan.turn}, {duration(plan.time_s)}"
        if (plan := by_key.get(key) if key else None) else drive.title
        for key, drive in shown.items()
    ]  # fmt: skip


def _facts(ranking: Ranking, best: PlanResult | None) -> list[tuple[str, str]]:
    """What the best plan comes to, label and value; what is not known is left out."""
    if best is None:
        return []
    drawn, unit = best.expected_cost is not None, f" {ranking.currency}" if ranking.currency else ""
    facts = [
        ("Time", duration(best.time_s)),
        ("Fleet", tractors(best.tractors)),
        ("Paid" if drawn else "Cost", _with_word(price(best.paid_cost if drawn else best.cost), unit)),
        ("In time", _with_word(in_time(best), " %")),
        ("Expected cost", _with_word(price(best.expected_cost if late_counts(ranking) else None), unit)),
        ("Worked", _with_unit(best.worked_pct, 1, "%")),
        ("Left open", bound(left(best) or number(None, 0))),
        ("Overlap", _with_unit(best.overlap_pct, 1, "%")),
        ("Trampled", _with_unit(best.trampled_m2, 0, "m2")),
        ("Outline outside", _with_unit(best.outside_outline_m, 0, "m")),
        ("Closest approach", _with_unit(clearance(best), 2, "m")),
        ("Order of tracks", number(None, 0) if best.order_gap_pct is None else gap_words(best.order_gap_pct)),
    ]
    return [(label, value) for label, value in facts if value != number(None, 0)]


def _with_word(text: str, word: str) -> str:
    return text if text == number(None, 0) else f"{text}{word}"


def _with_unit(value: float | None, decimals: int, unit: str) -> str:
    return _with_word(number(value, decimals), f" {unit}")


def _row(plan: PlanResult, columns: list[_Column], best: bool, place: int | None) -> dict[str, Any]:
    cells = []
    for column in columns:
        value = column.value(plan)
        sort = "" if value is None else str(int(value)) if isinstance(value, bool) else str(value)
        cells.append({"sort": sort, "text": column.text(plan), "words": column.words})
    return {"best": best, "cells": cells, "plan": place}
