"""The page of a ranking: one file that loads nothing from elsewhere and works offline."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from reports.common import palette
from reports.common.palette import TRACTOR_COLOURS
from reports.common.plan_drives import PlanDrive
from reports.common.plan_results import (
    PlanRanking,
    PlanResult,
    SlopePlace,
    get_stated_cost,
    get_stated_end_s,
    get_stated_late_end_s,
    get_stated_s,
)
from reports.common.rendering import render_template
from reports.common.wording import (
    NO_VALUE,
    SOFT_HYPHEN,
    capitalize_first,
    format_area_or_dash,
    format_duration,
    format_number,
    format_price,
    format_tractor_count,
    format_yes_no,
    get_start_time_of_day_s,
    insert_non_breaking_spaces,
    parse_start_time,
)
from reports.plan.answer import format_money, format_stated_cost, format_stated_end, write_answer
from reports.plan.count_charts import build_risk_chart, build_time_chart
from reports.plan.drive_geometry import SERVICE_STATE, check_drive, list_states
from reports.plan.energy_wording import describe_physics, format_energy, format_rate
from reports.plan.first_screen import choose_first_plans
from reports.plan.leg_list import LEG_HEADINGS, build_leg_cells, format_leg_heading
from reports.plan.map_data import build_page_map, build_time_bars
from reports.plan.plan_wording import (
    COLUMN_HELP,
    UNWORKED_HELP,
    describe_machines,
    describe_ranking,
    describe_simulated_effects,
    format_in_time_probability,
    format_unworked,
    get_charged_traffic_m2,
    get_clearance_m,
    group_refusals,
    has_late_ground_loss,
    list_feasible,
    list_plan_remarks,
    list_refused,
    name_refused_plans,
)
from reports.plan.ranking_table import describe_order_optimality, format_order_optimality

_SOFT_HYPHENATION = {
    "Collisions": "Colli|sions",
    "Reversals": "Rever|sals",
    "Tractors": "Trac|tors",
    "Clearance": "Clear|ance",
    "Unworked": "Un|worked",
}
"""Where headings may be broken on narrow paper."""
_PAGE_COLUMN_HELP = {
    "Tractor time": "time of all tractors together, from the start to the end of each",
    "Turning": "time in turns, all tractors together",
    "Waiting": "time spent waiting for others, all tractors together",
    "Worked %": "share of the field that is worked",
    "Unworked": "ground that no implement worked",
    "In time %": "share of the samples in which it is done in time",
    "Cost": "expected cost: what is paid, and the loss on late ground; without samples as simulated",
    "Done": "end of field work, the median of the samples; without samples as simulated",
    "Time": "time to the end of field work, the median of the samples; without samples as simulated",
    "As simulated": "time without late starts, stops and breakdowns",
    "Reversals": "how often a tractor changes between forwards and backwards",
    "To finish": "time with the unworked ground finished too, at the plan's own rate",
    "Outside m": "the farthest that tractor or implement reach beyond the outline",
    "Outside along m": "driven with tractor or implement farther beyond the outline than allowed",
    "Collisions": "how often tractors touch each other",
    "Pareto front": "no plan with as few tractors is faster",
    "Order gap %": "how much quicker another order of the tracks can be at most; - where the strategy gives the order",
    "In time": "done by the deadline in the simulation",
    "95 %": "it is done sooner in 95 % of the samples",
    "Fuel l": "litres of all tractors in the field, by the load of the simulated drive",
    "Fuel l/ha": "litres by hectare of the field",
    "CO2 kg": "of the fuel burnt, or of making the electricity",
    "Energy kWh": "from the batteries of all tractors",
    "Energy kWh/ha": "kilowatt-hours by hectare of the field",
    "Charges": "stops to charge or change batteries",
    "Charging": "time of all tractors at these stops",
    "Along %": "the steepest slope that a tractor drives up or down",
    "Across %": "the steepest slope across the drive of a tractor",
    "To rolling over": "degrees that the tractor nearest to rolling over has left",
}

CellValue = float | int | str | bool | None
PlanKey = tuple[str, int]  # strategy and number of tractors


@dataclass(frozen=True)
class _PageColumn:
    """A column of the full table: heading, what it sorts by, and how it reads; `is_extra`: shown on request only."""

    heading: str
    value: Callable[[PlanResult], CellValue]
    text: Callable[[PlanResult], str]
    is_text: bool = False
    title: str = ""
    is_extra: bool = False


_RANK_COLUMN = _PageColumn("Rank", lambda p: p.rank, lambda p: str(p.rank or ""))
_NAME_COLUMNS = (
    _PageColumn("Tractors", lambda p: p.tractors, lambda p: str(p.tractors)),
    _PageColumn("Strategy", lambda p: p.strategy, lambda p: p.strategy, is_text=True),
)
_WORKED_COLUMN = _PageColumn("Worked %", lambda p: p.worked_pct, lambda p: format_number(p.worked_pct, 1))
_EXTRA_COLUMNS = (
    _PageColumn("Turn", lambda p: p.turn, lambda p: p.turn, is_text=True),
    _PageColumn("As simulated", lambda p: p.time_s, lambda p: format_duration(p.time_s)),
    _PageColumn("Tractor time", lambda p: p.tractor_time_s, lambda p: format_duration(p.tractor_time_s)),
    _PageColumn("Turning", lambda p: p.turning_s, lambda p: format_duration(p.turning_s)),
    _PageColumn("Waiting", lambda p: p.waiting_s, lambda p: format_duration(p.waiting_s)),
    _PageColumn("Reversals", lambda p: p.reversals, lambda p: format_number(p.reversals, 0)),
    _PageColumn("Overlap %", lambda p: p.overlap_pct, lambda p: format_number(p.overlap_pct, 1)),
    _PageColumn("Unworked", lambda p: p.missed_m2, lambda p: format_area_or_dash(p.missed_m2)),
    _PageColumn("To finish", lambda p: p.finished_s, lambda p: format_duration(p.finished_s)),
    _PageColumn("Outside m", lambda p: p.outside_m, lambda p: format_number(p.outside_m, 1)),
    _PageColumn("Outside along m", lambda p: p.outside_along_m, lambda p: format_number(p.outside_along_m, 0)),
    _PageColumn("Clearance m", get_clearance_m, lambda p: format_number(get_clearance_m(p), 2)),
    _PageColumn("Collisions", lambda p: p.collisions, lambda p: format_number(p.collisions, 0)),
    _PageColumn("Order gap %", lambda p: p.order_gap_pct, lambda p: format_number(p.order_gap_pct, 1)),
    _PageColumn("Pareto front", lambda p: p.on_pareto_front, lambda p: format_yes_no(p.on_pareto_front)),
)
_DEADLINE_COLUMN = _PageColumn("In time", lambda p: p.meets_deadline, lambda p: format_yes_no(p.meets_deadline))
_PROBABILITY_COLUMN = _PageColumn("In time %", lambda p: p.finish_probability, format_in_time_probability)
_PAID_COLUMN = _PageColumn("Paid", lambda p: p.paid_cost, lambda p: format_price(p.paid_cost))
_SERVICE_STOP_COLUMNS = (
    _PageColumn("Refills", lambda p: p.refills, lambda p: format_number(p.refills, 0)),
    _PageColumn("Refilling", lambda p: p.refilling_s, lambda p: format_duration(p.refilling_s)),
)
_CHARGE_COLUMNS = (
    _PageColumn("Charges", lambda p: p.charges, lambda p: format_number(p.charges, 0)),
    _PageColumn("Charging", lambda p: p.charging_s, lambda p: format_duration(p.charging_s)),
)
_CO2_COLUMN = _PageColumn("CO2 kg", lambda p: p.co2_kg, lambda p: format_number(p.co2_kg, 0))
_FUEL_COLUMNS = (
    _PageColumn("Fuel l", lambda p: p.fuel_l, lambda p: format_number(p.fuel_l, 1)),
    _PageColumn("Fuel l/ha", lambda p: p.fuel_l_per_ha, lambda p: format_number(p.fuel_l_per_ha, 1)),
    _CO2_COLUMN,
)
_ELECTRICITY_COLUMNS = (
    _PageColumn("Energy kWh", lambda p: p.energy_kwh, lambda p: format_number(p.energy_kwh, 1)),
    _PageColumn("Energy kWh/ha", lambda p: p.energy_kwh_per_ha, lambda p: format_number(p.energy_kwh_per_ha, 1)),
    _CO2_COLUMN,
)
_SLOPE_COLUMNS = (
    _PageColumn("Along %", lambda p: _get_slope(p.steepest_along), lambda p: _format_slope(p.steepest_along)),
    _PageColumn("Across %", lambda p: _get_slope(p.steepest_across), lambda p: _format_slope(p.steepest_across)),
    _PageColumn("To rolling over", lambda p: _get_slope(p.rollover), lambda p: _format_slope(p.rollover)),
)


def _get_slope(place: SlopePlace | None) -> float | None:
    return None if place is None else abs(place.amount)


def _format_slope(place: SlopePlace | None) -> str:
    return format_number(_get_slope(place), 0)


def _list_page_columns(ranking: PlanRanking) -> list[_PageColumn]:
    """At most eight columns that hold the answer, then those that are shown on request."""
    plans = list_feasible(ranking)
    done = "Time" if parse_start_time(ranking.start) is None else "Done"
    cost = f"Cost {ranking.currency}" if ranking.currency else "Cost"
    columns = [
        _RANK_COLUMN,
        *_NAME_COLUMNS,
        _PageColumn(done, get_stated_end_s, lambda plan: format_stated_end(ranking, get_stated_end_s(plan))),
    ]
    if any(plan.p50_s is not None for plan in plans):
        columns.append(
            _PageColumn(
                "95 %", get_stated_late_end_s, lambda plan: format_stated_end(ranking, get_stated_late_end_s(plan))
            )
        )
    columns += [_PageColumn(cost, get_stated_cost, lambda plan: format_price(get_stated_cost(plan))), _WORKED_COLUMN]
    if any(plan.finish_probability is not None for plan in plans):
        columns.append(_PROBABILITY_COLUMN)
    elif any(plan.meets_deadline is not None for plan in plans):
        columns.append(_DEADLINE_COLUMN)
    extra = [*_EXTRA_COLUMNS, *([_PAID_COLUMN] if has_late_ground_loss(ranking) else [])]
    extra += _FUEL_COLUMNS if any(plan.fuel_l is not None for plan in plans) else ()
    extra += _ELECTRICITY_COLUMNS if any(plan.energy_kwh is not None for plan in plans) else ()
    extra += _SLOPE_COLUMNS if any(plan.steepest_along is not None for plan in plans) else ()
    extra += _SERVICE_STOP_COLUMNS if any(plan.refills is not None for plan in plans) else ()
    extra += _CHARGE_COLUMNS if any(plan.charges is not None for plan in plans) else ()
    return [*columns, *(replace(column, is_extra=True) for column in extra)]


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

    Raises:
        ReportError: a drive cannot be drawn.
    """
    shown = _choose_drives(ranking, drive, drives or {})
    for plan_drive in shown.values():
        check_drive(plan_drive)
    content = _build_page_content(ranking, shown)
    content["picture"] = None if field_picture is None else _draw_inline_picture(field_picture, ranking.field_name)
    return render_template("plan.html.j2", content)


def _draw_inline_picture(drive: PlanDrive, field_name: str) -> str:
    """A map without time as SVG for a page."""
    from reports.plan.map_figure import draw_plan_map, render_svg

    text = render_svg(draw_plan_map(drive, field_name))
    return text[text.index("<svg") :]


def _choose_drives(
    ranking: PlanRanking, drive: PlanDrive | None, drives: Mapping[PlanKey, PlanDrive]
) -> dict[PlanKey | None, PlanDrive]:
    """Drives to choose from: the best plan's first, the others as they are ranked."""
    best = ranking.best
    shown: dict[PlanKey | None, PlanDrive] = {}
    if drive is not None:
        shown[_get_plan_key(best) if best else None] = drive
    for plan in list_feasible(ranking):
        if _get_plan_key(plan) in drives:
            shown.setdefault(_get_plan_key(plan), drives[_get_plan_key(plan)])
    return shown


def _get_plan_key(plan: PlanResult) -> PlanKey:
    return plan.strategy, plan.tractors


def _name_service_stops(ranking: PlanRanking) -> dict[str, str]:
    """What tractors do at service stops: the state, the stop, and the verb of a tractor."""
    if any(plan.refills is not None for plan in ranking.plans) or not any(plan.charges for plan in ranking.plans):
        return {"state": SERVICE_STATE, "stop": "refill", "verb": "refills"}
    return {"state": "charging", "stop": "charge or change of the battery", "verb": "charges"}


def _build_page_content(ranking: PlanRanking, shown: Mapping[PlanKey | None, PlanDrive]) -> dict[str, Any]:
    plans, refused, effects = list_feasible(ranking), list_refused(ranking), describe_simulated_effects(ranking)
    columns = _list_page_columns(ranking)
    names, states = _build_drive_labels(plans, shown), list_states(shown.values())
    order_remark = describe_order_optimality(plans)
    first = next(iter(shown.values()), None)
    places = {key: number for number, key in enumerate(shown)}
    return {
        "name": ranking.field_name,
        "area": format_number(ranking.area_ha, 2),
        "machines": describe_machines(ranking),
        "seed": ranking.seed,
        "headline": [insert_non_breaking_spaces(text) for text in write_answer(ranking).list_sentences()],
        "details": [
            insert_non_breaking_spaces(text) for text in (*describe_ranking(ranking), *describe_physics(ranking))
        ]
        if plans
        else [],
        "facts": _list_plan_facts(ranking, ranking.best),
        "map": None if first is None else build_page_map(dict(zip(names, shown.values(), strict=True))),
        "bars": [] if first is None else build_time_bars(first, states),
        "states": states,
        "service": _name_service_stops(ranking),
        "state_colours": palette.STATE_COLOURS
        | ({SERVICE_STATE: palette.SERVICE_COLOUR} if SERVICE_STATE in states else {}),
        "cards": [] if first is None else _build_leg_cards(first, ranking.field_start or ranking.start),
        "headings": LEG_HEADINGS,
        "begin_s": get_start_time_of_day_s(ranking.field_start or ranking.start),
        "front": build_time_chart(ranking),
        "risk": build_risk_chart(ranking),
        "columns": [
            replace(column, heading=_insert_soft_hyphens(column.heading), title=_explain_column(column.heading))
            for column in columns
        ],
        "rows": [
            _build_page_row(plan, columns, plan is ranking.best, places.get(_get_plan_key(plan)))
            for plan in choose_first_plans(ranking, math.inf)
        ],
        "remarks": [
            *([UNWORKED_HELP] if any(plan.missed_m2 is not None for plan in plans) else []),
            *([order_remark] if order_remark else []),
            *list_plan_remarks(plans),
            *(() if ranking.samples else ranking.money_sentences),
            *ranking.check_sentences,
        ],
        "refusals": [
            _build_refusal_section("Refused", [plan for plan in refused if plan.bound_s is None]),
            _build_refusal_section("Not simulated", [plan for plan in refused if plan.bound_s is not None]),
        ],
        "assumptions": [*ranking.assumptions, *([effects] if effects else [])],
    }


def _build_refusal_section(heading: str, plans: Sequence[PlanResult]) -> dict[str, Any]:
    """The plans that were refused, or not simulated, by reason."""
    return {
        "heading": heading,
        "count": len(plans),
        "groups": [
            {
                "count": len(group.plans),
                "reason": group.reason,
                "alike": group.has_similar_reasons,
                "members": name_refused_plans(group),
            }
            for group in group_refusals(plans)
        ],
    }


def _build_leg_cards(drive: PlanDrive, start: str | None) -> list[dict[str, Any]]:
    """The list of legs of every tractor: heading, colour and rows of text."""
    return [
        {
            "number": tractor,
            "colour": (tractor - 1) % len(TRACTOR_COLOURS),
            "heading": format_leg_heading(tractor, steps),
            "rows": [build_leg_cells(place, step, start) for place, step in enumerate(steps, start=1)],
        }
        for tractor, steps in enumerate(drive.steps, start=1)
    ]


def _insert_soft_hyphens(heading: str) -> str:
    """A heading that may be broken at soft hyphens."""
    for word, parted in _SOFT_HYPHENATION.items():
        heading = heading.replace(word, parted.replace("|", SOFT_HYPHEN))
    return heading


def _explain_column(heading: str) -> str:
    """What a column holds; "" where its heading says it."""
    help_text = _PAGE_COLUMN_HELP.get(heading) or COLUMN_HELP.get(heading) or ""
    return capitalize_first(help_text or _PAGE_COLUMN_HELP.get(heading.split()[0], ""))


def _build_drive_labels(plans: Sequence[PlanResult], shown: Mapping[PlanKey | None, PlanDrive]) -> list[str]:
    """A line per drive to choose it by: ``6. split-field, 3 tractors, u, 0:25:57``."""
    by_key = {_get_plan_key(plan): plan for plan in reversed(plans)}
    return [
        f"{plan.rank}. {plan.strategy}, {format_tractor_count(plan.tractors)}, {plan.turn}, "
        f"{format_duration(get_stated_s(plan))}"
        if (plan := by_key.get(key) if key else None)
        else drive.title
        for key, drive in shown.items()
    ]


def _list_plan_facts(ranking: PlanRanking, best: PlanResult | None) -> list[tuple[str, str]]:
    """The figures of the best plan, label and value; unknown ones are left out."""
    if best is None:
        return []
    paid = best.paid_cost if has_late_ground_loss(ranking) else None
    facts = [
        (
            "Time" if parse_start_time(ranking.start) is None else "Done",
            format_stated_end(ranking, get_stated_end_s(best)),
        ),
        ("95 %", format_stated_end(ranking, get_stated_late_end_s(best))),
        ("Fleet", format_tractor_count(best.tractors)),
        ("Cost", NO_VALUE if get_stated_cost(best) is None else format_stated_cost(ranking, best)),
        ("Paid of it", NO_VALUE if paid is None else format_money(ranking, paid)),
        ("In time", _append_word_unless_dash(format_in_time_probability(best), " %")),
        (
            "Fuel" if best.energy_kwh is None else "Energy",
            insert_non_breaking_spaces(", ".join(filter(None, (format_energy(best), format_rate(best))))) or NO_VALUE,
        ),
        ("Worked", _format_with_unit(best.worked_pct, 1, "%")),
        ("Unworked", insert_non_breaking_spaces(format_unworked(best) or format_number(None, 0))),
        ("Overlap", _format_with_unit(best.overlap_pct, 1, "%")),
        ("Driven over when finished", _format_with_unit(get_charged_traffic_m2(best), 0, "m2")),
        ("Wheel traffic", _format_with_unit(best.wheel_traffic_m2, 0, "m2")),
        ("Farthest outside", _format_with_unit(best.outside_m, 1, "m")),
        ("Closest approach", _format_with_unit(get_clearance_m(best), 2, "m")),
        (
            "Order of tracks",
            format_number(None, 0) if best.order_gap_pct is None else format_order_optimality(best.order_gap_pct),
        ),
    ]
    return [(label, value) for label, value in facts if value != format_number(None, 0)]


def _append_word_unless_dash(text: str, word: str) -> str:
    return text if text == format_number(None, 0) else f"{text}{word}"


def _format_with_unit(value: float | None, decimals: int, unit: str) -> str:
    return _append_word_unless_dash(format_number(value, decimals), f" {unit}")


def _build_page_row(
    plan: PlanResult, columns: list[_PageColumn], is_best: bool, drive_number: int | None
) -> dict[str, Any]:
    cells = []
    for column in columns:
        value = column.value(plan)
        sort = "" if value is None else str(int(value)) if isinstance(value, bool) else str(value)
        cells.append({"sort": sort, "text": column.text(plan), "words": column.is_text, "extra": column.is_extra})
    return {"best": is_best, "cells": cells, "plan": drive_number}
