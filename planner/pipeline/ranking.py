"""Which candidates a request calls for, their results in order of merit, and the sentences of a ranking."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from fields.errors import join_first
from fields.geometry.field import Field
from fields.layout.swaths import Layout
from fields.terrain.slopes import measure_cross_slope, measure_fall_line_share
from fields.units import DAY_S, KMH_PER_MPS, MINUTE_S, MPS_PER_KMH
from planner.errors import RequestError, mark_parameter
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.field_physics import build_grid
from planner.evaluation.ground.unworked_area import (
    KEPT_HEADLAND,
    LEFT_OUT,
    find_unworked_areas,
    mark_worked_shares,
    measure_requested_share,
)
from planner.evaluation.ground.wheel_traffic import TYRE_WIDTH_M
from planner.evaluation.ground_sentences import describe_ground
from planner.evaluation.pull_check import describe_pull
from planner.farm.workday import BREAK, FOLD, NIGHT, ROAD, UNFOLD, Workday
from planner.pipeline.outputs.pictures import describe_cells
from planner.request.option_texts import format_clock
from planner.request.plan_options import PLAN_OPTIONS
from planner.request.plan_request import PlanRequest
from planner.request.service_points import describe_supply, export_supply
from planner.risk.assessment import mark_chosen_plan
from planner.risk.costs import are_prices_given, choose_terms, describe_prices, get_price_per_hour
from planner.risk.rain import parse_rain
from reports.common.language import mark_text
from reports.common.plan_records import Shortfall, UnworkedPiece
from reports.common.plan_results import PlanRanking, PlanResult, build_time_sort_key
from reports.common.rendering import pick_values
from reports.common.wording import round_up_to_minute
from strategies.names import STRATEGY_NAMES
from strategies.registry import get_strategy
from vehicle.model.effects import DISCREPANCY_KEY
from vehicle.model.tractor import load_tractor

TIME_TOLERANCE_S = 0.05
MAX_MARGIN_SHARE = 0.5  # of the field taken by a margin: more is surely a mistake
MAX_MARGIN_SHARE_INFEASIBLE = 0.5 * MAX_MARGIN_SHARE  # from here it is to blame if no plan works
ENTRANCE_SENTENCE = (
    "All tractors enter and leave through the entrance, one after another; these drives are simulated and timed. "
    "Outside the field tractors block nobody. Field work is done when the last one sets out for the entrance."
)
NO_ENTRANCE_SENTENCE = "Without an entrance, every tractor begins and ends on the field, where its work does."


def describe_workday(day: Workday | None, request: PlanRequest, plan: PlanResult | None) -> tuple[str, ...]:
    """Sentences on the times of day of a plan; none without a farm if all times are today."""
    notes = describe_next_day_times(request)
    if day is None or plan is None or plan.home_s is None:
        return notes
    if day.start_s is None:
        total = (
            f"{_describe_duties(day)}: {_format_minutes(day.before_field_s + day.after_field_s)} in total, besides the "
            "field work."
        )
        return notes if day.before_field_s + day.after_field_s == 0.0 else (*notes, total)
    home_s = (
        plan.home_s if plan.p50_s is None else day.compute_clock_s(day.before_field_s + plan.p50_s + day.after_field_s)
    )
    done_s = round_up_to_minute(plan.stated_end_s)
    ready, done, home = (request.format_clock_after(at) for at in (plan.ready_s, done_s, round_up_to_minute(home_s)))
    end = "home" if day.road_m else "folded"
    summary = (
        f"{_describe_duties(day)}: out at {format_clock(day.start_s)}, field work from {ready} to {done}, "
        f"{end} at {home}."
    )
    return (*notes, summary, *_describe_pauses(day, request, home_s))


def describe_next_day_times(request: PlanRequest) -> tuple[str, ...]:
    """Notes that a deadline or rain before the start's time of day is on the next day, which later rain is not."""
    start_s = request.start_s
    if start_s is None:
        return ()
    onsets_s = () if request.rain is None else parse_rain(request.rain, start_s).onsets_s
    limit_s = () if request.time_limit_s is None else (request.time_limit_s,)
    next_day = {
        subject: dict.fromkeys(format_clock(start_s + one_s) for one_s in delays_s if start_s + one_s >= DAY_S)
        for subject, delays_s in (("The deadline", limit_s), ("Rain", [s for s in sorted(onsets_s) if s <= DAY_S]))
    }
    return tuple(
        f"{subject} at {join_first([*clocks])} is taken as the next day's: the start is at {format_clock(start_s)}."
        for subject, clocks in next_day.items()
        if clocks
    )


def _describe_duties(day: Workday) -> str:
    road_s = day.sum_duties_s(ROAD) / max(1, day.road_ways)
    road = f"{day.road_m / 1000.0:.1f} km of road each way take {_format_minutes(road_s)}, " if day.road_m else ""
    unfolding, folding = (_format_minutes(day.sum_duties_s(duty)) for duty in (UNFOLD, FOLD))
    handling_s = day.sum_duties_s(UNFOLD) + day.sum_duties_s(FOLD)
    sentence = f"{road}unfolding {unfolding} and folding {folding}" if handling_s else f"{road}no unfolding or folding"
    return sentence[0].upper() + sentence[1:]


def _describe_pauses(day: Workday, request: PlanRequest, home_s: float) -> tuple[str, ...]:
    """Sentences on breaks, on waiting for the first shift, and on work that continues in another shift."""
    pauses = day.list_pauses(home_s)
    notes = []
    breaks = [pause for pause in pauses if pause.kind == BREAK]
    if breaks:
        total = _format_minutes(sum(pause.to_s - pause.from_s for pause in breaks))
        notes.append(f"This includes {'a break' if len(breaks) == 1 else f'{len(breaks)} breaks'} of {total}.")
    for pause in (one for one in pauses if one.kind == NIGHT):
        begin, end = request.format_clock_after(pause.from_s), request.format_clock_after(pause.to_s)
        notes.append(
            f"The shift begins at {end}."
            if pause.from_s <= 0.0
            else f"The shift ends at {begin} before the work is done; it continues at {end}."
        )
    return tuple(notes)


def _format_minutes(seconds: float) -> str:
    minutes = round(seconds / MINUTE_S)
    if 0.0 < seconds < 0.5 * MINUTE_S:
        return f"{seconds:.0f} s"
    if minutes < 60:
        return f"{round(seconds / MINUTE_S, 1):g} min"
    return f"{minutes // 60} h {minutes % 60} min"


def list_candidates(request: PlanRequest) -> list[Candidate]:
    """Every combination worth simulating.

    One tractor alone does the same by all strategies of Headland that do not say otherwise, so the first of these is
    tried. Where something is wanted of single lines, those are tried that deal lines out, if any is asked for.
    """
    alike = [name for name in STRATEGY_NAMES if name in request.strategies and not get_strategy(name).differs_alone]
    others = [name for name in request.strategies if name not in STRATEGY_NAMES or get_strategy(name).differs_alone]
    dealing = [name for name in request.strategies if not request.line_wishes or get_strategy(name).formation is None]
    return [
        Candidate(name, tractors)
        for tractors in request.tractors
        for name in (dealing or request.strategies if tractors > 1 else [*alike[:1], *others])
    ]


def rank_plans(context: PlanningContext, results: Iterable[PlanResult]) -> PlanRanking:
    """Order by the time to finish the field, then tractors, then name; infeasible plans last.

    A plan is charged for missed ground at its own rate: time and hourly cost grow by missed over worked area, without
    ground that obstacles cut off. Plans on the Pareto front of that time against the number of tractors are marked,
    among those that keep the clearance if any does.
    Raises RequestError for a margin that takes most of the field, or much of it if no plan works.
    """
    field = context.layout.field
    results = [
        replace(one, largest_missed=replace(locate_piece(field, piece.m2, piece.x_m, piece.y_m), reason=piece.reason))
        if (piece := one.largest_missed)
        else one
        for one in mark_worked_shares(results, context)
    ]
    check_margin(context, any(result.feasible for result in results))
    feasible = sorted((r for r in results if r.feasible), key=build_time_sort_key)
    front: list[PlanResult] = []  # what no plan beats in time and number of tractors; of equal counts the quickest
    keeping = [result for result in feasible if result.keeps_clearance] or feasible
    for result in sorted(keeping, key=lambda r: (r.tractors, r.ranked_s)):
        if not front or result.ranked_s < front[-1].ranked_s - TIME_TOLERANCE_S:
            front.append(result)
    ranked = [
        replace(result, rank=place, on_pareto_front=result in front) for place, result in enumerate(feasible, start=1)
    ]
    infeasible = sorted((r for r in results if not r.feasible), key=lambda r: (r.tractors, r.strategy))
    request, elevation = context.request, context.physics.elevation
    terms = choose_terms(request, context.cost_terms)
    tractor_effects = {name: dict(setting.value) for name, setting in context.tractor.effects.items()}
    model = context.tractor.discrepancy_model
    if model is not None and model.on:
        tractor_effects[DISCREPANCY_KEY] = dict(model.amounts)
    ranking = PlanRanking(
        field_name=field.name,
        area_ha=field.area_ha,
        seed=request.seed,
        plans=(*ranked, *infeasible),
        start=None if request.start_s is None else format_clock(request.start_s),
        deadline=None if request.deadline_s is None else format_clock(request.deadline_s),
        allowed_s=request.time_limit_s,
        assumptions=list_assumptions(context),
        tractor_effects=tractor_effects,
        scenario=export_request(context),
        currency=terms.prices.currency,
        prices_assumed=not are_prices_given(request, context.cost_terms),
        money_sentences=(mark_text(f"The cost covers {describe_prices(terms)}."),),
        cut_off=locate_cut_off_ground(field),
        **_measure_slopes(context),
        pull=context.pull,
        field_remarks=(*field.remarks, *(() if elevation is None else elevation.remarks)),
        ground_sentences=describe_ground(context),
    )
    advised = mark_chosen_plan(ranking, context.criteria)
    return add_clock_times(replace(advised, shortfalls=find_shortfalls(advised, context)), context)


def find_shortfalls(ranking: PlanRanking, context: PlanningContext) -> tuple[Shortfall, ...]:
    """What the best plan of a ranking lacks, with what its samples said before; empty without a plan."""
    best = ranking.best
    if best is None:
        return ()
    found = [] if ranking.eligible else [Shortfall("pull")]
    found += [] if best.works_enough else [Shortfall("worked", _describe_worked_share(best, context))]
    late = () if ranking.missed_by_s is None else (Shortfall("late", _suggest_start(ranking.missed_by_s, context)),)
    return (*found, *ranking.shortfalls, *late)


def _suggest_start(missed_by_s: float, context: PlanningContext) -> str:
    """The start with which the best plan would be in time; "" where the hours of a farm or work that goes on set it."""
    start_s = context.request.start_s
    if start_s is None or context.workday is not None or context.going_on is not None:
        return ""  # else the drive is the same at another time of day
    earlier_s = start_s - round_up_to_minute(missed_by_s)
    if earlier_s < 0.0 or earlier_s <= (context.request.deadline_s or 0.0) < start_s:
        return ""  # the start would be yesterday's, or the deadline no more the next day's
    return f"In time with --start {format_clock(earlier_s)}."


def _describe_worked_share(best: PlanResult, context: PlanningContext) -> str:
    """The share that a plan works, and the reason why most of the rest is not worked."""
    requested_share = measure_requested_share(context)
    requested_m2 = requested_share * context.layout.field.due_region.area
    worked_pct = (best.worked_pct or 0.0) / requested_share
    areas = [
        (one.area_m2, one.reason) for one in find_unworked_areas(context) if one.reason not in (KEPT_HEADLAND, LEFT_OUT)
    ]
    unexplained_m2 = 0.01 * (100.0 - worked_pct) * requested_m2 - sum(area_m2 for area_m2, _ in areas)
    most_m2, reason = max([*areas, (unexplained_m2, "reached by no pass of this plan as it is driven")])
    most_pct = 100.0 * most_m2 / requested_m2
    ground = mark_text("the field") if requested_share == 1.0 else mark_text("the ground asked for")
    return f"No recommendation: only {worked_pct:.1f} % of {ground} is worked; {most_pct:.0f} % is {reason}."


def add_clock_times(ranking: PlanRanking, context: PlanningContext) -> PlanRanking:
    """The ranking with the times of day of its best plan."""
    workday, request = context.workday, context.request
    notes = describe_workday(workday, request, ranking.best)
    if workday is None:
        return replace(ranking, day_sentences=notes)
    time_limit_s = ranking.allowed_s
    field_time_s = (
        None if time_limit_s is None else float(workday.compute_work_s(np.array(time_limit_s))) - workday.before_field_s
    )
    start = request.format_clock_after(workday.compute_clock_s(workday.before_field_s, begins=True))[:5] or None
    return replace(ranking, day_sentences=notes, field_start=start, field_allowed_s=field_time_s)


def check_margin(context: PlanningContext, feasible: bool) -> None:
    """Refuse a margin that takes most of the ground outside obstacles, or much of it if no plan is feasible."""
    field, margin_m = context.layout.field, context.request.margin_m
    remaining_share = field.workable_region.area / field.area_without_margin_m2
    if remaining_share < 1.0 - (MAX_MARGIN_SHARE if feasible else MAX_MARGIN_SHARE_INFEASIBLE):
        consequence = (
            "less than half of the ground outside obstacles"
            if remaining_share < 1.0 - MAX_MARGIN_SHARE
            else "and no plan works there"
        )
        raise RequestError(
            f"The margin ({mark_parameter('margin_m')}) of {margin_m:g} m leaves {100.0 * remaining_share:.0f} % of "
            f"field '{field.name}', {consequence}; use a smaller margin."
        )


def locate_piece(field: Field, area_m2: float, x_m: float, y_m: float) -> UnworkedPiece:
    """A piece of ground with longitude and latitude if the field has a coordinate system."""
    if field.crs is None:
        return UnworkedPiece(area_m2, x_m, y_m)
    ((lon, lat),) = field.to_wgs84([(x_m, y_m)]).tolist()
    return UnworkedPiece(area_m2, x_m, y_m, lon, lat)


def locate_cut_off_ground(field: Field) -> UnworkedPiece | None:
    """All ground that obstacles cut off, at the place of its largest piece; None without any."""
    if not field.cut_off_parts:
        return None
    place = shapely.point_on_surface(max(field.cut_off_parts, key=lambda part: part.area))
    return locate_piece(field, field.cut_off_m2, place.x, place.y)


def _measure_slopes(context: PlanningContext) -> dict[str, Any]:
    """Slope across the main lines and share of them that may erode, by their names in PlanRanking.

    None without heights or lines.
    """
    terrain = context.physics.terrain
    lines = context.main_lines_m
    if terrain is None or not lines:
        return {}
    grid = build_grid(terrain)
    return {
        "cross_slope_pct": 100.0 * measure_cross_slope(lines, grid),
        "erosion_share": measure_fall_line_share(lines, grid),
    }


def export_request(context: PlanningContext) -> dict[str, Any]:
    """The request of a ranking as plain values, with the values chosen for what it left open."""
    request, layout, physics, estimate = context.request, context.layout, context.physics, context.physics.moisture
    implement, estimated = dict[str, Any](), dict[str, Any]()
    if request.draft is not None or request.depth_cm is not None:  # else both follow from the operation
        rule = request.find_draft_rule()
        assert rule is not None  # a request with either is refused where nothing is pulled
        implement = {"draft": rule.name, "depth_cm": rule.depth_cm if rule.follows_depth else None}
    if estimate is not None:  # the rain of the last days and the moisture that it makes
        estimated = {
            "rain_mm": estimate.rain_mm,
            "rain_days": estimate.days,
            "et0_mm": round(estimate.et0_mm, 2),
            "estimated_moisture_pct": round(estimate.moisture_pct, 2),
            "estimated_moisture_range_pct": [round(estimate.low_pct, 2), round(estimate.high_pct, 2)],
        }
    return {
        "field": layout.field.name,
        "width_m": layout.width_m,
        "headland_m": layout.headland_m,
        "bearing_deg": layout.bearing_deg,
        "swaths": len(layout.swaths),
        "swath_form": request.swaths,
        "cells": describe_cells(layout),
        "radius_m": context.driving_rules.radius_m,
        **pick_values(request, ("clearance_m", "margin_m")),
        "tractor": context.tractor.name,
        "turn": request.turn,
        "speed_kmh": request.speed_mps / MPS_PER_KMH,
        "headland_passes": layout.headland_passes,
        **pick_values(request, ("operation", "headland_order", "corners", "overhang_m", "no_headland", "open_edges")),
        "sections": request.sections,
        "transport_width_m": context.implement.transport_width_m,
        "turn_speed_kmh": request.effective_turn_speed_mps / MPS_PER_KMH,
        "price_per_hour": get_price_per_hour(request.price_per_hour),
        "price_per_tractor": request.price_per_tractor,
        "start": None if request.start_s is None else format_clock(request.start_s),
        "deadline": None if request.deadline_s is None else format_clock(request.deadline_s),
        **pick_values(request, ("seed", "gnss")),
        "samples": 0 if context.criteria is None else context.criteria.samples,
        **pick_values(request, ("rain", "objective")),
        **({} if context.supply is None else export_supply(context.supply)),
        "budget": request.budget,
        "elevation": None if physics.elevation is None else physics.elevation.source,
        "soil": None if physics.soil is None else physics.soil.name,
        "moisture_pct": None if physics.soil is None else physics.soil.moisture_pct,
        "defaults": _pick_default_machines(context),
        **implement,
        **estimated,
    }


def _pick_default_machines(context: PlanningContext) -> dict[str, Any]:
    """Tractor, width and speed by their options, where they are the defaults and no farm has them."""
    request, usual, terms = context.request, PlanRequest, context.cost_terms
    implement = None if terms is None else terms.implement
    is_default = {
        "tractor": (terms is None or terms.tractor is None) and context.bare_tractor == load_tractor(usual.tractor),
        "width": implement is None and request.width_m == usual.width_m,
        "speed_kmh": (implement is None or implement.speed_kmh is None) and request.speed_mps == usual.speed_mps,
    }
    return {option.name: option.default for option in PLAN_OPTIONS if is_default.get(option.name)}


def _describe_headland(context: PlanningContext) -> str:
    """How the headland is treated, and what the time covers."""
    count = context.layout.headland_passes
    if not count:
        return (
            "Time counts from the start on the headland to the end of the last track; the headland stays unworked and "
            "is charged like other missed ground."
        )
    plural = "es" if count > 1 else ""
    order = ", before or after the tracks" if context.layout.swaths else ""
    return (
        f"The headland is worked in {count} pass{plural} with {context.request.corners} corners, shared by all "
        f"tractors{order}; time counts from the start to the end of the last track or pass."
    )


def _describe_ways_in(context: PlanningContext) -> list[str]:
    """Where tractors begin; those that go on begin where they stand."""
    if context.gateway is not None:
        return [ENTRANCE_SENTENCE]
    return [] if context.going_on else [NO_ENTRANCE_SENTENCE]


def _describe_counted_day_parts(context: PlanningContext) -> tuple[str, ...]:
    """Which parts of the farm's day count."""
    workday = context.workday
    if workday is None:
        return ()
    notes = ["The day is the same for all tractors: road, unfolding, field work, folding, road."]
    notes += [] if workday.road_m else ["The road to the field is not counted: its length is unknown."]
    if workday.start_s is None and (workday.breaks_s or workday.shift_s[1] is not None):
        notes.append("Without a start time, breaks and shifts of the farm are not counted.")
    return tuple(notes)


def _describe_bearings(layout: Layout) -> str:
    """The bearing of the tracks, or the bearings in the cells."""
    if any(swath.via_m for swath in layout.swaths):
        return f"along contours, bearing {layout.bearing_deg:.0f} degrees on the whole"
    bearings = [f"{cell.bearing_deg:.0f}" for cell in layout.cells]
    if len(bearings) == 1:
        return f"at bearing {bearings[0]} degrees"
    return f"at bearings {', '.join(bearings[:-1])} and {bearings[-1]} degrees in {len(bearings)} cells"


def _describe_payment(context: PlanningContext) -> str:
    """What is paid, and until when."""
    request = context.request
    if context.cost_terms is None:
        hire_text = f" and {request.price_per_tractor:g} per tractor." if request.price_per_tractor else "."
        price = get_price_per_hour(request.price_per_hour)
        return f"Every tractor is paid until the last one is done: {price:g} per hour{hire_text}"
    is_itemised = context.cost_terms.prices.per_hour is None
    period = "until it is done, people until the last one is" if is_itemised else "until the last one is done"
    return f"The cost is {describe_prices(context.cost_terms)}; every tractor is paid {period}."


def list_assumptions(context: PlanningContext) -> tuple[str, ...]:
    """The assumptions shared by all plans of a ranking, in sentences."""
    driving_rules, layout, tractor = context.driving_rules, context.layout, context.tractor
    tracks = f"{layout.track_count} tracks {_describe_bearings(layout)}" if layout.swaths else "no track"
    return (
        f"{tractor.name}, implement {layout.width_m:g} m wide, working {driving_rules.tool_m:.1f} m behind the "
        "antenna.",
        f"Work at {KMH_PER_MPS * driving_rules.work_speed_mps:.3g} km/h, "
        f"turns at {KMH_PER_MPS * driving_rules.turn_speed_mps:.3g} km/h.",
        f"Planned turning radius {driving_rules.radius_m:.2f} m; headland {layout.headland_m:g} m at the ends of "
        f"{tracks}.",
        "Metres outside the field are those of the antenna; tractor and implement may reach over the boundary in "
        "turns, which is counted as outline outside.",
        "Worked ground is what the lowered implement passes over. Missed ground is charged at the plan's own rate: the "
        "time to finish is the time driven times field over worked area, the hourly cost grows by the same factor, and "
        "plans are ranked by that time."
        + (" Ground that obstacles cut off is not charged." if layout.field.cut_off_parts else ""),
        "Wheel traffic is finished ground off the headland that wheels cross with the implement raised; all tyres are "
        f"assumed to be {TYRE_WIDTH_M:g} m wide.",
        _describe_headland(context),
        *_describe_ways_in(context),
        *_describe_counted_day_parts(context),
        _describe_payment(context),
        *(() if context.supply is None else describe_supply(context.supply)),
        *(("Position errors are those of an RTK receiver, a few millimetres.",) if context.request.gnss else ()),
        *describe_pull(context.pull, context.request.find_draft_rule(), context.physics.soil),
        *describe_ground(context),
        *layout.field.remarks,
    )
