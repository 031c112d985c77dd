"""The page of a ranking: one file that loads nothing from elsewhere and works offline, with charts over the number of
tractors as numbers for its template."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from reports.common import palette
from reports.common.drawing_sizes import RISK_FRAME, TIME_FRAME, TIME_STEPS_S, ChartAxis
from reports.common.palette import TRACTOR_COLOURS
from reports.common.plan_records import PlanDrive, SlopePlace
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.rendering import render_template
from reports.common.wording import (
    NO_VALUE,
    SOFT_HYPHEN,
    capitalize_first,
    format_deadline,
    format_duration,
    format_money,
    format_number,
    format_percent,
    format_price,
    get_start_time_of_day_s,
    has_start_time,
    insert_non_breaking_spaces,
)
from reports.plan.answer import format_stated_cost, write_answer
from reports.plan.drive_geometry import SERVICE_STATE, list_states
from reports.plan.figures import FIGURES, PAGE_EXTRA_KEYS, PAGE_KEYS, Figure, choose_figures
from reports.plan.leg_list import LEG_HEADINGS, Steps, format_leg_heading, list_leg_cells
from reports.plan.map_data import build_page_map, build_time_bars
from reports.plan.other_plans import format_stated_end
from reports.plan.plan_wording import (
    UNWORKED_HELP,
    describe_machines,
    describe_simulated_effects,
    format_energy,
    format_in_time_probability,
    format_rate,
    format_unworked,
    has_late_ground_loss,
    list_plan_remarks,
    name_fleet,
)
from reports.plan.ranking_table import choose_first_plans, choose_plan_per_count
from reports.plan.shortfall_wording import group_refusals, split_refused

_POINT_DISTANCE = 10.0  # between two points, in units of the picture
_BETWEEN, _INSET = 30.0, 20.0  # room between two curves, and at their ends
_PARTED_WORDS = ("Colli|sions", "Rever|sals", "Trac|tors", "Clear|ance", "Un|worked")
"""Where headings may be broken on narrow paper."""
PlanKey = tuple[str, int]  # strategy and number of tractors


def _place_counts(plans: list[PlanResult]) -> dict[int, float]:
    """The x of every number of tractors, fewest first."""
    counts = sorted({plan.tractors for plan in plans})
    first = TIME_FRAME.left + _INSET
    span, inner = counts[-1] - counts[0], TIME_FRAME.right - _INSET - first
    return {count: round(first + (inner * (count - counts[0]) / span if span else inner / 2), 1) for count in counts}


def build_time_chart(ranking: PlanRanking) -> dict[str, Any] | None:
    """Points, Pareto line, deadline and ticks of time to finish by number of tractors; None without a feasible plan."""
    plans = [plan for plan in ranking.eligible if plan.time_s is not None]
    if not plans:
        return None
    limit = ranking.allowed_s if ranking.field_allowed_s is None else ranking.field_allowed_s
    top = max([plan.ranked_s for plan in plans] + ([limit] if limit is not None else [])) * 1.06 or 1.0
    axis, places = ChartAxis(0.0, top, TIME_FRAME.bottom, TIME_FRAME.top), _place_counts(plans)
    names = list(dict.fromkeys(plan.strategy for plan in plans))
    front = sorted((plan.tractors, plan.ranked_s) for plan in plans if plan.on_pareto_front)
    deadline = None
    if limit is not None:
        deadline = {"y": axis.place(limit), "text": f"deadline {format_deadline(ranking)}"}
    return {
        "frame": TIME_FRAME,
        "axis": axis,
        "points": _place_points(plans, names, [(places[one.tractors], axis.place(one.ranked_s)) for one in plans]),
        "line": " ".join(f"{places[count]},{axis.place(time)}" for count, time in front),
        "deadline": deadline,
        "counts": places,
        "times": axis.list_ticks(TIME_STEPS_S, lambda time_s: format_duration(time_s).removesuffix(":00")),
        "names": [{"text": name, "colour": index % len(TRACTOR_COLOURS)} for index, name in enumerate(names)],
    }


def _place_points(plans: list[PlanResult], names: list[str], places: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Points to draw, the best last; a point that would hide another is moved right, not as far as the next count."""
    columns = sorted({x for x, _ in places})
    room = min((right - left for left, right in pairwise(columns)), default=TIME_FRAME.width / 4)
    step = min(_POINT_DISTANCE, 0.6 * room / max(sum(x == column for x, _ in places) for column in columns))
    points: list[dict[str, Any]] = []
    for plan, (x, y) in zip(plans, places, strict=True):
        while any(abs(other["x"] - x) < 0.99 * step and abs(other["y"] - y) < _POINT_DISTANCE for other in points):
            x = round(x + step, 3)
        finish = "" if format_unworked(plan) is None else f", to finish {format_duration(plan.ranked_s)}"
        text = f"{plan.tractors} x {plan.strategy}, {plan.turn}: {format_duration(plan.stated_end_s)}{finish}"
        colour = names.index(plan.strategy) % len(TRACTOR_COLOURS)
        points.append({"x": x, "y": y, "colour": colour, "front": plan.on_pareto_front, "text": text})
    return points[::-1]


def build_risk_chart(ranking: PlanRanking) -> dict[str, Any] | None:
    """Two curves over the number of tractors: probability above, where there is one, and expected cost below.

    Every count has the plan to take. None without samples.
    """
    plans = choose_plan_per_count(ranking)
    if not plans:
        return None
    top = max(plan.expected_cost or 0.0 for plan in plans) * 1.06 or 1.0
    costs, ticks = [(plan, plan.expected_cost or 0.0) for plan in plans], dict[str, Any](most=5)
    curves = [(f"Cost, {ranking.currency}", top, ticks, costs)]
    judged = [(plan, plan.finish_probability) for plan in plans if plan.finish_probability is not None]
    if judged:
        curves.insert(0, ("In time, %", 1.0, {"steps": (0.25,), "write": format_percent}, judged))
    places, between = _place_counts(plans), _BETWEEN * (len(curves) - 1)
    height = (RISK_FRAME.bottom - RISK_FRAME.top - between) / len(curves)
    texts = {
        plan.tractors: f"{plan.tractors} x {plan.strategy}: "
        + ("" if plan.finish_probability is None else f"{format_in_time_probability(plan)} % in time, ")
        + f"cost {format_price(plan.expected_cost)}"
        for plan in plans
    }
    bands = []
    for number, (name, most, ticks, points) in enumerate(curves):
        upper = RISK_FRAME.top + number * (height + _BETWEEN)
        axis = ChartAxis(0.0, most, upper + height, upper)
        bands.append(
            {
                "name": name,
                "ticks": axis.list_ticks(**ticks),
                "points": [
                    {"x": places[plan.tractors], "y": axis.place(value), "best": plan is ranking.best,
                     "text": texts[plan.tractors]}
                    for plan, value in points
                ],
                "axis": axis,
            }
        )  # fmt: skip
    return {"frame": RISK_FRAME, "bands": bands, "counts": places}


def render_plan_page(
    ranking: PlanRanking,
    drive: PlanDrive | None,
    drives: Mapping[PlanKey, PlanDrive] | None = None,
    field_picture: PlanDrive | None = None,
) -> str:
    """The page as HTML text.

    Headline in plain words, map with a slider through time (when a drive is given), time per tractor, time
    against number of tractors, every plan in a table that sorts, what was refused and why, and the assumptions.
    `drive` is that of the best plan; `drives` adds others by strategy and number of tractors, which a reader can
    choose for the map. Without a plan `field_picture` shows the field and where plans fail. Paths are thinned so that
    the page stays below two megabytes for all but huge tables.
    """
    best, shown = ranking.best, dict[PlanKey | None, PlanDrive]()
    if drive is not None:
        shown[(best.strategy, best.tractors) if best else None] = drive
    for plan in ranking.eligible:  # the others as they are ranked
        key = plan.strategy, plan.tractors
        if drives and key in drives:
            shown.setdefault(key, drives[key])
    content = _build_page_content(ranking, shown)
    content["picture"] = None
    if field_picture is not None:
        from reports.plan.map_figure import draw_plan_map, render_svg

        text = render_svg(draw_plan_map(field_picture, ranking.field_name))
        content["picture"] = text[text.index("<svg") :]
    return render_template("plan.html.j2", content)


def _build_page_content(ranking: PlanRanking, shown: Mapping[PlanKey | None, PlanDrive]) -> dict[str, Any]:
    """What the template of the page takes."""
    plans, effects, answer = ranking.eligible, describe_simulated_effects(ranking), write_answer(ranking)
    columns = [(figure, False) for figure in choose_figures(ranking, plans, PAGE_KEYS)]
    columns += [(figure, True) for figure in choose_figures(ranking, plans, PAGE_EXTRA_KEYS)]
    labels = {  # to choose a drive by, such as ``6. split-field, 3 tractors, u, 0:25:57``
        (plan.strategy, plan.tractors): f"{plan.rank}. {plan.strategy}, {name_fleet(plan)}, {plan.turn}, "
        f"{format_duration(plan.stated_end_s)}"
        for plan in reversed(plans)
    }
    names = [labels.get(key, drive.title) if key else drive.title for key, drive in shown.items()]
    states = list_states(shown.values())
    rare_colours = {state: colour for state, colour in palette.RARE_STATE_COLOURS.items() if state in states}
    first = next(iter(shown.values()), None)
    places = {key: number for number, key in enumerate(shown)}
    return {
        "name": ranking.field_name,
        "area": format_number(ranking.area_ha, 2),
        "machines": describe_machines(ranking),
        "seed": ranking.seed,
        "headline": [insert_non_breaking_spaces(text) for text in answer.list_sentences()],
        "details": [insert_non_breaking_spaces(text) for text in answer.details],
        "facts": _list_plan_facts(ranking, ranking.best),
        "map": None if first is None else build_page_map(dict(zip(names, shown.values(), strict=True))),
        "bars": [] if first is None else build_time_bars(first, states),
        "states": states,
        "service": _choose_service_words(ranking),
        "state_colours": {**palette.STATE_COLOURS, **rare_colours},
        "cards": [] if first is None else _build_leg_cards(first.steps, ranking.start),
        "headings": LEG_HEADINGS,
        "begin_s": get_start_time_of_day_s(ranking.start),
        "front": build_time_chart(ranking),
        "risk": build_risk_chart(ranking),
        "columns": [_build_page_column(figure, is_extra) for figure, is_extra in columns],
        "rows": [
            _build_page_row(plan, columns, plan is ranking.best, places.get((plan.strategy, plan.tractors)))
            for plan in choose_first_plans(ranking, math.inf)
        ],
        "remarks": _list_remarks(ranking, plans),
        "refusals": [
            {"heading": heading, "count": len(some), "groups": group_refusals(some)}
            for heading, some in split_refused(ranking).items()
        ],
        "assumptions": [*ranking.assumptions, *([effects] if effects else [])],
    }


def _build_leg_cards(steps_by_tractor: Steps, start: str | None) -> list[dict[str, Any]]:
    """The list of legs of each tractor."""
    return [
        {
            "number": tractor,
            "colour": (tractor - 1) % len(TRACTOR_COLOURS),
            "heading": format_leg_heading(tractor, steps),
            "rows": list_leg_cells(steps, start),
        }
        for tractor, steps in enumerate(steps_by_tractor, start=1)
    ]


def _list_remarks(ranking: PlanRanking, plans: Sequence[PlanResult]) -> list[str]:
    """What is said below the table of the plans that can be driven."""
    return [
        *([UNWORKED_HELP] if any(plan.missed_m2 is not None for plan in plans) else []),
        *list_plan_remarks(plans),
        *(() if ranking.samples else ranking.money_sentences),
        *ranking.check_sentences,
    ]


def _choose_service_words(ranking: PlanRanking) -> dict[str, str]:
    """What stops at the service point are called."""
    if any(plan.charges for plan in ranking.plans) and all(plan.refills is None for plan in ranking.plans):
        return {"state": "charging", "stop": "charge or change of the battery", "verb": "charges"}
    if ranking.unloads:
        return {"state": "unloading", "stop": "unload", "verb": "unloads"}
    return {"state": SERVICE_STATE, "stop": "refill", "verb": "refills"}


def _build_page_column(figure: Figure, is_extra: bool) -> dict[str, Any]:
    """The heading of a figure, which may be broken at soft hyphens, and what it holds."""
    heading = figure.heading
    for parted in _PARTED_WORDS:
        heading = heading.replace(parted.replace("|", ""), parted.replace("|", SOFT_HYPHEN))
    title = capitalize_first(figure.help or figure.note)
    return {"heading": heading, "title": title, "is_text": figure.is_text, "is_extra": is_extra}


def _list_plan_facts(ranking: PlanRanking, best: PlanResult | None) -> list[tuple[str, str]]:
    """The figures of the best plan, label and value; unknown ones are left out."""
    if best is None or not ranking.eligible:
        return []
    has_start, cost = has_start_time(ranking), best.stated_cost
    paid = best.paid_cost if has_late_ground_loss(ranking) else None
    energy = insert_non_breaking_spaces(", ".join(filter(None, (format_energy(best), format_rate(best)))))
    facts = [
        ("Done" if has_start else "Time", format_stated_end(ranking, best.stated_end_s)),
        ("95 %", format_stated_end(ranking, best.stated_late_end_s)),
        ("Fleet", name_fleet(best)),
        ("Cost", NO_VALUE if cost is None else format_stated_cost(ranking, best)),
        ("Paid of it", NO_VALUE if paid is None else format_money(paid, ranking.currency)),
        ("In time", FIGURES["finish_probability"].format_with_unit(best)),
        ("Fuel" if best.energy_kwh is None else "Energy", energy or NO_VALUE),
        ("Worked", FIGURES["worked_pct"].format_with_unit(best)),
        ("Unworked", insert_non_breaking_spaces(format_unworked(best) or NO_VALUE)),
        ("Overlap", FIGURES["overlap_pct"].format_with_unit(best)),
        ("Spoilt by wheels", insert_non_breaking_spaces(FIGURES["spoilt_m2"].format(best))),
        ("Wheel traffic off the headland", FIGURES["wheel_traffic_m2"].format_with_unit(best)),
        ("Farthest outside", FIGURES["outside_m"].format_with_unit(best)),
        ("Closest approach", FIGURES["min_clearance_m"].format_with_unit(best)),
    ]
    return [(label, value) for label, value in facts if value != NO_VALUE]


def _build_page_row(
    plan: PlanResult, columns: Sequence[tuple[Figure, bool]], is_best: bool, drive_number: int | None
) -> dict[str, Any]:
    """The cells of a plan with what they sort by, and the number of its drive."""
    cells = []
    for figure, is_extra in columns:
        value = figure.get_value(plan)
        value = abs(value.amount) if isinstance(value, SlopePlace) else value
        sort = "" if value is None else str(int(value)) if isinstance(value, bool) else str(value)
        cells.append({"sort": sort, "text": figure.format(plan), "words": figure.is_text, "extra": is_extra})
    return {"best": is_best, "cells": cells, "plan": drive_number}
