"""Work that goes on: what is done by files and saved plans at a time, cut out of what is planned, and who stands where.

A source is a file of worked ground (any format of field files, its polygons), task logs, the runs of `headland logs
import`, or `plan.json@13:20`, a saved plan driven up to then (`@0:45` of a plan without a start: that long; `@37:20`:
at 13:20 of its second day).
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.documents.reader import read_polygons
from fields.documents.sources import parse_field_reference
from fields.geometry.overlays import clip_area, extract_polygons, unite_areas
from fields.text_files import quote_path, read_text
from fields.units import DAY_S
from planner.errors import HeadlandError, RequestError, attach_parameter, mark_parameter, shorten_value
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.context import DoneWork, PlanningContext, Stand
from planner.evaluation.ground.coverage import MIN_PIECE_WIDTH_M, locate_antenna
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.evaluation.work_order import DoneSource, WorkOrder, match_plan_time
from planner.farm.workday import Workday
from planner.pipeline.outputs.saved_plans import (
    has_unknown_tank,
    read_bare_tractor,
    read_done_ground,
    read_machines,
    read_planned_layout,
    read_request,
    read_supply,
    read_used,
    read_workday,
    rerun_plan,
)
from planner.request.option_texts import describe_span, format_clock, format_hours
from planner.request.plan_request import PlanRequest
from planner.task_logs.formats import point_shapefiles
from planner.task_logs.log_import import detect_log_format, read_task_logs
from planner.task_logs.runs.run_files import load_imported_runs
from planner.task_logs.runs.run_records import ProjectedRun, project_run, reproject_run
from planner.task_logs.runs.worked_ground import iter_worked_strips
from reports.common.wording import round_up_to_minute
from strategies.lines.done_lines import build_round_corners, list_places_ahead
from strategies.path_planning.errors import SOLITARY_STRATEGIES
from strategies.registry import get_strategy
from strategies.rules.supply import Supply
from vehicle.errors import MissionError
from vehicle.missions.plan import ENTER, LEAVE, Leg
from vehicle.missions.plan_file import SavedPlan, parse_saved_plan
from vehicle.missions.run import SimulationRun
from vehicle.records import STANDING, WAITING

PLAN_ERROR_M = 0.5 * MIN_PIECE_WIDTH_M  # a plan of ours: what is narrower than a piece to go back for is its error
OTHERS_ERROR_M = 0.3  # of guidance by satellites alone from pass to pass, which is what unknown work may be driven with
LEAST_DUE_WIDTHS = 1.0  # less ground than a square of the width is nothing to plan
MOST_SHIFT_M = 0.1  # of a boundary that is still the same: what other programs round coordinates to


class AllDoneError(RequestError):
    """Nothing is left to plan."""


def go_on(context: PlanningContext, order: WorkOrder) -> PlanningContext:
    """The context with what is done cut out of its field, and with the tractors that stand on it.

    Raises HeadlandError for work of another field, machine or time, and where nothing is left.
    """
    if order.without and not any(map(match_plan_time, order.done)):
        raise RequestError(
            f"{mark_parameter('without')} leaves machines out of a saved plan, and there is none in "
            f"{mark_parameter('done')}; give one with a time (plan.json@13:20), or ask for fewer "
            f"{mark_parameter('tractors')}.",
            parameter="without",
        )
    if not order.done:
        return context
    field = context.layout.field
    with attach_parameter("done"):
        works = _read_works(order, context)
    ground = extract_polygons(unite_areas(np.array([one.ground for one in works], dtype=np.object_)))
    closing_m = max(one.error_m for one in works)
    ground = ground.buffer(closing_m, join_style="mitre").buffer(-closing_m, join_style="mitre")
    done = clip_area(ground, field.region_without_obstacles)
    if done.is_empty and not order.begins_on_field:  # a plan may stop before it works anything
        raise RequestError(
            f"Nothing of what is given as done lies in field '{field.name}'; give work of this field, or the field of "
            "this work.",
            parameter="done",
        )
    driven = None if order.from_road else next((one for one in reversed(works) if one.numbers or one.stands), None)
    stands, numbers = ((), ()) if driven is None else (driven.stands, driven.numbers)
    left = field.mark_done(done)
    left = replace(left, remarks=(*left.remarks, *(note for one in works for note in one.notes)))
    if left.due_region.area < LEAST_DUE_WIDTHS * context.request.width_m**2:
        raise AllDoneError(f"All of field '{field.name}' is done; there is nothing left to plan.", parameter="done")
    remark = (
        f"{1e-4 * done.area:.2f} ha of field '{field.name}' are done; this plan is for the {left.area_ha:.2f} ha left."
    )
    left = replace(left, remarks=(*left.remarks, remark))
    going_on = DoneWork(done, closing_m, stands, numbers=numbers, may_rest=bool(stands))
    return replace(context, layout=replace(context.layout, field=left), going_on=going_on)


def list_sources(done: Any) -> tuple[DoneSource, ...]:
    """What is done, as Python is given it, one or several of; raises RequestError for what it cannot be."""
    given = done if isinstance(done, list | tuple) else (done,)
    sources = tuple(str(one) if isinstance(one, Path) else one for one in given)
    for one in sources:
        if not isinstance(one, DoneSource) or not one:
            raise RequestError(
                f"{mark_parameter('done')} holds {shorten_value(one)}, which is no source of done work; give files of "
                "ground, logs, or saved plans with a time (plan.json@13:20).",
                parameter="done",
            )
    return sources


def list_numbers(without: Any) -> tuple[int, ...]:
    """The machines that are left out, as Python is given them; raises RequestError for what is no number."""
    numbers = tuple(without) if isinstance(without, list | tuple | set | frozenset | range) else (without,)
    wrong = [one for one in numbers if not isinstance(one, int) or isinstance(one, bool)]
    if wrong:
        raise RequestError(
            f"{mark_parameter('without')} holds {shorten_value(wrong[0])}, which is no number of a machine; give whole "
            "numbers from 1.",
            parameter="without",
        )
    return numbers


def continue_order(order: WorkOrder) -> WorkOrder:
    """An order with the values of the saved plan that goes on for all that it leaves at its defaults, but the field.

    The same order where no plan goes on from where its machines stand. Raises HeadlandError.
    """
    continued = None if order.from_road else read_continued_order(order.done, order.without)
    if continued is None:
        return order
    request = order.request
    is_same = order.tractor is None and request.tractor in (PlanRequest.tractor, continued.request.tractor)
    order = equip_order(continued, order, keeps_tractor=is_same)
    given = {one.name for one in fields(request) if getattr(request, one.name) != one.default}
    return replace(order, request=keep_parameters(continued, request, given | {"field", "local", "crs", "swap_axes"}))


def check_source_exists(source: str) -> None:
    """Refuse a source of done work that is no file."""
    match = match_plan_time(source)
    name = parse_field_reference(source).place if match is None else match["file"]
    if not name or not Path(name).exists():
        raise RequestError(
            f"There is no file {quote_path(name)}; {mark_parameter('done')} takes a file of worked ground, logs, or a "
            "saved plan with a time (plan.json@13:20).",
            parameter="done",
        )


def _read_works(order: WorkOrder, context: PlanningContext) -> list[DoneWork]:
    """What every source says is done; the machines are those of the last saved plan among them."""
    plans, works = [number for number, one in enumerate(order.done) if match_plan_time(one)], list[DoneWork]()
    for number, source in enumerate(order.done):
        if isinstance(source, DoneWork):
            works.append(source)
        elif number in plans[:-1]:
            ground_only = replace(order, without=(), from_road=True)
            works.append(replace(_read_source(source, context, ground_only), stands=(), notes=(), numbers=()))
        else:
            works.append(_read_source(source, context, order))
    if len(plans) > 1:
        note = f"The machines that go on are those of {order.done[plans[-1]]}, the last of {len(plans)} plans."
        works[-1] = replace(works[-1], notes=(*works[-1].notes, note))
    return works


def read_continued_order(sources: Sequence[DoneSource], without: Sequence[int] = ()) -> WorkOrder | None:
    """What the last saved plan among some sources asked for, from the time on at which it is left; None without one.

    It is for the machines that are left, with what they carry, on its layout. The tractor is without what soil and
    heights do to it, as those of the order that goes on do the same or other. Raises HeadlandError.
    """
    match = next((match for source in reversed(sources) if (match := match_plan_time(source))), None)
    if match is None:
        return None
    saved, request = _read_plan(match["file"])
    left = len(_list_machines_left(saved, without))
    start_s = None if request.start_s is None else int(_read_clock(match)) % DAY_S
    return WorkOrder(
        replace(request, tractors=(left,), start_s=start_s),
        tractor=read_bare_tractor(saved, request),
        implement=read_machines(saved, request)[1],
        supply=read_supply(saved),
        done=(match[0],),
        layout=read_planned_layout(saved),
    )


def keep_parameters(continued: WorkOrder, request: PlanRequest, given: Collection[str]) -> PlanRequest:
    """The request of a plan that goes on, with the `given` parameters of another in place of its own."""
    return replace(continued.request, **{name: getattr(request, name) for name in given})


def equip_order(
    continued: WorkOrder, order: WorkOrder, *, keeps_tractor: bool, is_from_farm: bool = False
) -> WorkOrder:
    """An order on the layout of a plan that goes on, by its machines where it keeps the tractor.

    They carry what is given, or what a farm's implement says, else what the plan says. Raises RequestError where none
    of them does and there is a tank: earlier Headlands saved that there is one, but not how large.
    """
    supply = order.supply
    if supply is None and not is_from_farm:
        supply, match = continued.supply, match_plan_time(continued.done[0])
        file = None if match is None else match["file"]
        if supply is None and file is not None and has_unknown_tank(*_read_plan(file)):
            raise RequestError(
                f"The implement of the plan {quote_path(file)} has a tank, and the plan does not say how large; add "
                f"{mark_parameter('farm')} and {mark_parameter('implement')} by which it was made.",
                parameter="farm",
            )
    order = replace(order, supply=supply, layout=continued.layout)
    if not keeps_tractor:
        return order
    return replace(order, tractor=continued.tractor, implement=order.implement or continued.implement)


def keep_continuing(context: PlanningContext, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates that can go on: with all the tractors that stand on the field, and these in no formation.

    Strategies that deal lines differ no more, as whoever is near takes what is left: one of them is kept, if possible
    one that keeps the clearance.
    """
    if context.going_on is None:
        return list(candidates)
    stands = len(context.going_on.stands)
    dealt = [one for one in candidates if one.tractors == 1 or get_strategy(one.strategy).formation is None]
    nearest_last = sorted(dealt, key=lambda one: get_strategy(one.strategy).beside)
    first = list({one.tractors: one for one in reversed(nearest_last)}.values())
    kept = [one for one in candidates if one.tractors >= stands and (one in first or (one not in dealt and not stands))]
    if not kept:
        raise RequestError(
            f"{stands} tractors stand on the field and cannot go on so: plan with {stands} tractors or more "
            f"({mark_parameter('without')} leaves some out), each for itself ({SOLITARY_STRATEGIES}).",
            parameter="tractors",
        )
    return kept


def _read_plan(name: str) -> tuple[SavedPlan, PlanRequest]:
    """A saved plan and its request; raises RequestError with the name of the file."""
    text = read_text(name, "a plan of headland plan --save", MissionError)
    try:
        saved = parse_saved_plan(text)
        return saved, read_request(saved)
    except HeadlandError as refusal:
        raise RequestError(f"{quote_path(name)} cannot be gone on with. {refusal}", parameter="done") from None


def _read_clock(match: re.Match[str]) -> float:
    """Seconds of the time at which a plan is left; raises RequestError for 60 minutes or seconds and more."""
    if int(match["minutes"]) > 59 or int(match["seconds"] or 0) > 59:
        time = match[0].rpartition("@")[2]
        raise RequestError(
            f"{quote_path(match['file'])} is left at {time}, which is no time, as minutes and seconds go to 59; give "
            "one such as 13:20 or 0:45.",
            parameter="done",
        )
    return 3600.0 * int(match["hours"]) + 60.0 * int(match["minutes"]) + int(match["seconds"] or 0)


def _list_machines_left(saved: SavedPlan, without: Sequence[int]) -> list[int]:
    """Numbers, from 0, of the machines of a plan that go on; raises RequestError where none do."""
    unknown = [number for number in without if not 1 <= number <= saved.plan.tractors]
    if unknown:
        raise RequestError(
            f"{mark_parameter('without')} names machine {unknown[0]}, and the plan has {saved.plan.tractors}; give "
            "numbers from 1.",
            parameter="without",
        )
    left = [number for number in range(saved.plan.tractors) if number + 1 not in without]
    if not left:
        raise RequestError(f"{mark_parameter('without')} leaves no machine; leave one in.", parameter="without")
    return left


def _read_source(source: str, context: PlanningContext, order: WorkOrder) -> DoneWork:
    """What a source says is done, in metres of the field."""
    check_source_exists(source)
    if match := match_plan_time(source):
        return _read_driven_plan(match, context, order)
    path = Path(parse_field_reference(source).place)
    if path.suffix.lower() == ".json" and '"tractors"' in path.read_text(errors="replace")[:4000]:
        raise RequestError(
            f"{quote_path(source)} is a plan; say up to when it was driven, such as {path.name}@13:20.",
            parameter="done",
        )
    runs = _read_logs(source)
    if runs is not None:
        return _read_runs(source, runs, context)
    with attach_parameter("done"):
        polygons = read_polygons(source, context.layout.field)
    return DoneWork(unite_areas(np.array(polygons, dtype=np.object_)), OTHERS_ERROR_M)


def _read_logs(source: str) -> list[ProjectedRun] | None:
    """The runs of task logs in any format, or of a folder of imported runs; None for a file of ground."""
    path = Path(source)
    if path.is_dir() and any(one.with_suffix(".json").exists() for one in path.glob("*.csv")):
        return load_imported_runs([path])
    try:
        log_format = detect_log_format(source)
    except HeadlandError:
        return None
    try:
        return [project_run(run) for run in read_task_logs(source).runs]
    except HeadlandError:
        if log_format is not point_shapefiles.LOG_FORMAT:  # a Shapefile may hold either
            raise
        return None


def _read_runs(source: str, runs: Sequence[ProjectedRun], context: PlanningContext) -> DoneWork:
    """What runs worked in the field, by their width, or that of the request where they state none."""
    field, width_m = context.layout.field, context.request.width_m
    if field.crs is None:
        raise RequestError(
            f"{quote_path(source)} has places on the earth, and field '{field.name}' has none; give the boundary in "
            "longitude and latitude.",
            parameter="done",
        )
    idle = [run.name for run in runs if not run.has_work_state]
    if len(idle) == len(runs):
        raise RequestError(
            f"{quote_path(source)} does not say where the implement worked; give a file of worked ground instead.",
            parameter="done",
        )
    tool_m = context.tractor.antenna_forward_m + context.implement.hitch_m
    strips = list[shapely.Geometry]()
    for run in runs:
        placed = reproject_run(run, field.crs)
        strips += iter_worked_strips(placed, run.width_m or width_m, tool_m)
    ground = shapely.transform(unite_areas(np.array(strips, dtype=np.object_)), lambda xy: xy - field.origin_m)
    notes = (f"{len(idle)} of {len(runs)} runs do not say where they worked, and are left out.",) if idle else ()
    return DoneWork(ground, OTHERS_ERROR_M, notes=notes)


def _read_driven_plan(match: re.Match[str], context: PlanningContext, order: WorkOrder) -> DoneWork:
    """What a saved plan has done at a time, and where the machines that are left stand then."""
    (saved, request), field = _read_plan(match["file"]), context.layout.field
    _check_same_job(match["file"], saved, request, context)
    run = rerun_plan(saved, request)
    since_start_s, elapsed_s, notes = _find_time(match, request, read_workday(saved, request), run.duration_s)
    if not order.from_road:
        _check_deadline(match["file"], request, since_start_s, context.request)
    begun = cut_run(run, elapsed_s)
    shift = np.asarray(saved.origin_m) - np.asarray(field.origin_m)
    swept = unite_areas(compute_swept_area(begun, context).ground)
    reached = [int(begun.get_leg_numbers(number)[-1]) for number in range(saved.plan.tractors)]
    legs = [leg for mission, at in zip(saved.plan.missions, reached, strict=True) for leg in mission.legs[:at]]
    corners = build_round_corners(legs, context.driving_rules.radius_m, context.request.width_m)
    ground = unite_areas(np.array([swept, *corners, *read_done_ground(saved)], dtype=np.object_))
    left = _list_machines_left(saved, order.without)
    used = read_used(saved)
    stands = {number: _find_stand(begun, number, context, used[number]) for number in left}
    ranked = sorted(left, key=lambda number: stands[number] is None)
    placed = tuple(stand.move_by(*shift.tolist()) for number in ranked if (stand := stands[number]) is not None)
    numbers = tuple(number + 1 for number in ranked)
    return DoneWork(shapely.transform(ground, lambda xy: xy + shift), PLAN_ERROR_M, placed, notes, numbers)


def _find_time(
    match: re.Match[str], request: PlanRequest, day: Workday, duration_s: float
) -> tuple[float, float, tuple[str, ...]]:
    """Seconds after the start and of driving at which a plan is left, and that it has the same clock a day later."""
    begin_s = day.compute_clock_s(day.before_field_s, begins=True)
    end_s = round_up_to_minute(day.compute_clock_s(day.before_field_s + duration_s))
    span = describe_span(request.start_s, begin_s, end_s)
    name, time, start_s = quote_path(match["file"]), match[0].rpartition("@")[2], request.start_s or 0
    since_start_s = _read_clock(match) - start_s
    since_start_s += DAY_S if since_start_s < 0.0 else 0.0
    day_later_s = since_start_s + DAY_S
    elapsed_s, later_s = day.compute_work_s(np.array([since_start_s, day_later_s])) - day.before_field_s
    if not 0.0 <= elapsed_s <= round_up_to_minute(duration_s):
        raise RequestError(
            f"The plan {name} {span}, as simulated without late starts, stops and breakdowns, and {time} is not within "
            "that; give a time within it.",
            parameter="done",
        )
    if request.start_s is None or 3600 * int(match["hours"]) >= DAY_S or later_s >= duration_s:
        return since_start_s, float(elapsed_s), ()
    later = format_hours(start_s + day_later_s)
    note = f"The plan {name} {span}, and {time} is taken as the first one; {later} is a day later."
    return since_start_s, float(elapsed_s), (note,)


def _check_deadline(name: str, earlier: PlanRequest, elapsed_s: float, request: PlanRequest) -> None:
    """Refuse to go on after the deadline of the plan, which would be that of the next day."""
    limit_s, start_s = earlier.time_limit_s, earlier.start_s
    if limit_s is None or start_s is None or request.deadline_s != earlier.deadline_s or elapsed_s < limit_s:
        return
    if request.start_s == int(start_s + elapsed_s) % DAY_S:
        raise RequestError(
            f"The deadline of the plan {quote_path(name)}, {format_clock(start_s + limit_s)}, has passed at "
            f"{format_clock(request.start_s)}; give another {mark_parameter('deadline_s')}.",
            parameter="deadline_s",
        )


def _check_same_job(name: str, saved: SavedPlan, request: PlanRequest, context: PlanningContext) -> None:
    """Refuse a plan of another width or boundary."""
    plan, field, width_m = quote_path(name), context.layout.field, context.request.width_m
    if not math.isclose(request.width_m, width_m):
        raise RequestError(
            f"The plan {plan} is for a working width of {request.width_m:g} m, and {width_m:g} m are asked for; give "
            f"{mark_parameter('width_m')} {request.width_m:g}, or what was worked as a file of ground or logs.",
            parameter="done",
        )
    rings = saved.ground.get("boundary_m")
    if not rings or saved.crs != field.crs:
        raise RequestError(
            f"The plan {plan} is for another field than '{field.name}'; give the field that it was made for.",
            parameter="done",
        )
    shift = np.asarray(saved.origin_m) - np.asarray(field.origin_m)
    planned = shapely.Polygon(np.array(rings[0]) + shift, [np.array(ring) + shift for ring in rings[1:]])
    farthest_m = float(shapely.hausdorff_distance(planned.boundary, field.whole_boundary.boundary))
    if farthest_m > MOST_SHIFT_M:
        raise RequestError(
            f"The boundary of field '{field.name}' is not the one that the plan {plan} was made for: they differ by "
            f"{farthest_m:.1f} m. Give the field as it was then, or what was worked as a file of ground or logs.",
            parameter="done",
        )


def cut_run(run: SimulationRun, elapsed_s: float) -> SimulationRun:
    """A run up to a time."""
    rows = max(2, int(np.searchsorted(run.time_s, elapsed_s, side="right")))
    return replace(run, time_s=run.time_s[:rows], record=run.record[:rows])


def _find_stand(run: SimulationRun, number: int, context: PlanningContext, used: float) -> Stand | None:
    """Where a tractor stands at the end of a run, before which it had `used` some of its load; None for one that is not
    on the field."""
    legs, numbers, poses = run.plan.missions[number].legs, run.get_leg_numbers(number), run.get_poses(number)
    at = int(numbers[-1])
    waits = legs[0].task.kind == ENTER and math.dist(poses[0, :2], poses[-1, :2]) < MOST_SHIFT_M
    leg, is_done = legs[min(at, len(legs) - 1)], float(run.finish_s[number]) <= float(run.time_s[-1])
    if waits or leg.task.kind == LEAVE or (is_done and not run.plan.missions[number].rests):
        return None
    x, y = locate_antenna(poses[-1:], context.tractor.guide_m)[0].tolist()
    pose = (x, y, float(poses[-1, 2]))
    begun_m = math.dist(poses[np.argmax(numbers == at), :2], poses[-1, :2])
    stands = run.get_statuses(number)[-1] in (WAITING, STANDING)
    is_before = at > 0 and stands and begun_m < MOST_SHIFT_M  # neither folded nor served for the leg
    driven_m = 0.0 if is_before else float(shapely.LineString(leg.points).project(shapely.Point(pose[:2])))
    driven = [*legs[:at], *list_driven_part(leg, driven_m)]
    used = 0.0 if context.supply is None else sum_used(driven, context.supply, context.request.width_m, used)
    is_folded = (legs[at - 1] if is_before else leg).folded
    return Stand(pose, used, list_places_ahead(legs[at:]), is_folded)


def list_driven_part(leg: Leg, driven_m: float) -> list[Leg]:
    """What of a leg is driven, as a leg; none before its first metre."""
    if driven_m <= 0.0:
        return []
    return [leg.cut(0.0, driven_m)]


def sum_used(legs: Sequence[Leg], supply: Supply, width_m: float, used: float = 0.0) -> float:
    """What is used of a load since it was filled last: by legs, and `used` before them."""
    served = max((number for number, leg in enumerate(legs) if leg.stand_s > 0.0), default=None)
    used, legs = (used, legs) if served is None else (0.0, legs[served:])
    return used + supply.compute_legs_need(legs, width_m) if legs else used
