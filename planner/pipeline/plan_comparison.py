"""A saved plan compared with its as-driven runs: time by kind, worked ground, and causes of the difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.text_files import count_noun
from fields.units import KMH_PER_MPS
from planner.errors import HeadlandError, RequestError
from planner.evaluation.ground.coverage import locate_antenna
from planner.evaluation.preparation import read_planned_field
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.example_logs import find_work_state
from planner.pipeline.outputs.saved_plans import SavedPlanRun, simulate_saved_plan
from planner.task_logs.runs.phases import summarise_run
from planner.task_logs.runs.run_files import load_imported_runs
from planner.task_logs.runs.run_records import ProjectedRun, compute_course_deg, compute_speeds, reproject_run
from planner.task_logs.runs.worked_ground import measure_coverage, trace_tool_lines
from reports.task_logs.run_results import (
    STANDING,
    TRANSIT,
    TURNING,
    UNLOGGED,
    WORKING,
    ComparisonSide,
    GroundCoverage,
    PlanComparison,
    RunFigures,
    TimeDifference,
)
from vehicle.identification.logs.series import find_spans

NEAR_FIELD_M, MIN_INSIDE_SHARE = 20.0, 0.5
"""A run belongs to the field if more than this share of its positions is in it or this near."""
ROW_STEP = 10  # rows of the 10 Hz record: plans are compared at 1 Hz, as logs
PLAN_FORMAT = "plan"


def compare_plan_with_runs(plan: str | Path, paths: Sequence[str | Path]) -> PlanComparison:
    """A plan of `headland plan --save` and imported runs of its field.

    Raises MissionError, RequestError, VehicleError or LogError if the plan is not usable or no run is in its field.
    """
    saved_run = simulate_saved_plan(plan)
    runs = load_imported_runs(paths)
    crs = saved_run.saved.crs
    if crs is None:
        raise RequestError(
            "The plan is in local metres, but runs have a place on the earth; plan the field in longitude and latitude."
        )
    projected_runs = [reproject_run(run, crs) for run in runs]
    planned = [build_planned_run(saved_run, tractor) for tractor in range(saved_run.saved.plan.tractors)]
    field, is_field_known = _find_compared_field(saved_run, projected_runs, planned)
    near = field.buffer(NEAR_FIELD_M)
    shapely.prepare(near)
    shares = [float(shapely.contains_xy(near, *run.xy.T).mean()) for run in projected_runs]
    field_runs = [run for run, share in zip(projected_runs, shares, strict=True) if share > MIN_INSIDE_SHARE]
    if not field_runs:
        name = saved_run.request.field_name
        raise RequestError(
            f"None of {count_noun(len(runs), 'run')} is in the field {name!r} of the plan; give runs in this field."
        )
    tool_offset_m = saved_run.tractor.antenna_forward_m + saved_run.implement.hitch_m
    sides = [
        _build_comparison_side(side_runs, field, saved_run.request.width_m, tool_offset_m, is_field_known)
        for side_runs in (planned, field_runs)
    ]
    return PlanComparison(
        name=next((run.field for run in field_runs if run.field), Path(saved_run.request.field_name).stem),
        field_m2=float(field.area) if is_field_known else None,
        boundary=tuple(np.array(ring.coords)[:, :2] for ring in (field.exterior, *field.interiors))
        if is_field_known
        else (),
        width_m=saved_run.request.width_m,
        planned=sides[0],
        as_driven=sides[1],
        differences=tuple(_find_time_differences(sides[0].figures, sides[1].figures)),
        notes=tuple(
            _list_comparison_notes(
                runs, field_runs, saved_run, None if sides[1].ground is None else tool_offset_m, is_field_known
            )
        ),
    )


def build_planned_run(saved_run: SavedPlanRun, tractor: int) -> ProjectedRun:
    """The run of a tractor of a plan at 1 Hz, as its antenna would log it."""
    run = saved_run.run
    end_row = int(np.searchsorted(run.time_s, run.finish_s[tractor]))
    rows = np.unique(
        np.append(np.arange(0, min(end_row + 1, len(run.time_s)), ROW_STEP), min(end_row, len(run.time_s) - 1))
    )
    xy = locate_antenna(run.get_poses(tractor)[rows], saved_run.tractor.guide_m) + np.array(saved_run.saved.origin_m)
    time_s = run.time_s[rows]
    return ProjectedRun(
        name=f"tractor {tractor + 1}",
        log_format=PLAN_FORMAT,
        crs=saved_run.saved.crs or "",
        time_s=time_s,
        xy=xy,
        heading_deg=compute_course_deg(xy),
        speed_mps=compute_speeds(time_s, xy),
        is_working=find_work_state(saved_run, tractor)[rows],
        width_m=saved_run.request.width_m,
        field=saved_run.request.field_name,
    )


def _find_compared_field(
    saved_run: SavedPlanRun, runs: Sequence[ProjectedRun], planned: Sequence[ProjectedRun]
) -> tuple[shapely.Polygon, bool]:
    """The field of the plan, or its part, in its metres and True, or the convex hull of the planned work and False."""
    request = saved_run.request
    try:
        field = read_planned_field(WorkOrder(request, tractor=saved_run.tractor, implement=saved_run.implement))
        if field.crs == saved_run.saved.crs:
            return shapely.transform(field.boundary, lambda points: points + np.array(field.origin_m)), True
    except HeadlandError:
        pass
    hull = shapely.MultiPoint(np.concatenate([run.xy[run.is_working] for run in planned])).convex_hull.buffer(
        0.5 * request.width_m
    )
    outlines = [run.outline for run in runs if run.outline is not None and run.outline.intersection(hull).area > 0.0]
    if outlines:
        return max(outlines, key=lambda one: float(one.intersection(hull).area)), True
    return hull, False


def _build_comparison_side(
    runs: Sequence[ProjectedRun], field: shapely.Polygon, width_m: float, tool_offset_m: float, is_field_known: bool
) -> ComparisonSide:
    """The combined runs of one side."""
    has_work_state = all(run.has_work_state for run in runs)
    width = next((run.width_m for run in runs if run.width_m), width_m)
    covered: GroundCoverage | None = (
        measure_coverage(runs, field, width, tool_offset_m) if is_field_known and has_work_state else None
    )
    idle_lines = [run.xy[max(first - 1, 0) : last + 2] for run in runs for first, last in find_spans(~run.is_working)]
    return ComparisonSide(
        len(runs),
        _sum_figures([summarise_run(run) for run in runs]),
        tuple(line for run in runs for line in trace_tool_lines(run, 0.0)) if has_work_state else (),
        tuple(line for line in idle_lines if len(line) > 1),
        covered,
    )


def _sum_figures(figures: Sequence[RunFigures]) -> RunFigures:
    """The combined figures of several runs: sums, None if one is unknown, and means over all of them."""
    names = (
        "seconds", "active_m", "inactive_m", "counted_m", "placed_m", "area_m2", "lifts", "turns", "u_turns", "stops",
        "stops_s", "fuel_l", "rows",
    )  # fmt: skip
    sums: dict[str, Any] = {}
    for name in names:
        values = [getattr(one, name) for one in figures]
        sums[name] = None if None in values else sum(values)
    by_kind_s = {kind: sum(one.by_kind_s[kind] for one in figures) for kind in figures[0].by_kind_s}
    active_m, working_s = sums["active_m"], by_kind_s[WORKING]
    u_turns = [(one.u_turns or 0, one.u_turn_s) for one in figures if one.u_turn_s is not None]
    turning = [(one.by_kind_s[TURNING], one.turning_mps) for one in figures if one.turning_mps]
    turning_s = sum(seconds for seconds, _ in turning)
    return RunFigures(
        **sums,
        by_kind_s=by_kind_s,
        area_counted=all(one.area_counted for one in figures),
        u_turn_s=sum(n * s for n, s in u_turns) / sum(n for n, _ in u_turns) if u_turns else None,
        working_mps=active_m / working_s if active_m and working_s else None,
        turning_mps=sum(seconds * mps for seconds, mps in turning) / turning_s if turning_s else None,
        width_m=figures[0].width_m,
    )


def _find_time_differences(planned: RunFigures, as_driven: RunFigures) -> Iterator[TimeDifference]:
    """Parts that add up to the difference in machine time, the largest first.

    At work and in turns, amount and pace are separated: (b - a) x s and b x (t - s) add up to b x t - a x s, with the
    lengths or counts a and b, and the seconds s and t per unit.
    """
    has_turns = as_driven.turns is not None
    travel_s, unlogged_s = (as_driven.by_kind_s[kind] - planned.by_kind_s[kind] for kind in (TRANSIT, UNLOGGED))
    differences = [TimeDifference(UNLOGGED, unlogged_s, "moved without a log")]
    standing_s = as_driven.by_kind_s[STANDING] - planned.by_kind_s[STANDING]
    differences.append(TimeDifference(STANDING, standing_s, f"{as_driven.stops} stops, planned {planned.stops}"))
    if has_turns:
        differences += [
            TimeDifference(TRANSIT, travel_s, "on paths longer than a turn"),
            *_split_by_amount_and_pace(WORKING, planned, as_driven),
            *_split_by_amount_and_pace(TURNING, planned, as_driven),
        ]
    else:
        differences.append(TimeDifference("moving", as_driven.moving_s - planned.moving_s, "moving, working or not"))
    yield from sorted((one for one in differences if abs(one.seconds) >= 1.0), key=lambda one: -abs(one.seconds))


def _split_by_amount_and_pace(kind: str, planned: RunFigures, as_driven: RunFigures) -> Iterator[TimeDifference]:
    """Differences at work or in turns by amount and by pace; a single one if either side has no such work."""
    is_work = kind == WORKING
    planned_count, driven_count = ((side.active_m if is_work else side.turns) for side in (planned, as_driven))
    planned_s, driven_s = planned.by_kind_s[kind], as_driven.by_kind_s[kind]
    if not planned_count or not driven_count or not planned_s or not driven_s:
        yield TimeDifference(kind, driven_s - planned_s, f"time {kind}")
        return
    planned_pace, driven_pace = planned_s / planned_count, driven_s / driven_count
    if is_work:
        amounts = f"{driven_count:.0f} m at work, planned {planned_count:.0f} m"
        paces = f"at work {KMH_PER_MPS / driven_pace:.1f} km/h, planned {KMH_PER_MPS / planned_pace:.1f} km/h"
    else:
        amounts = f"{driven_count:.0f} turns, planned {planned_count:.0f}"
        paces = f"{driven_pace:.0f} s per turn, planned {planned_pace:.0f} s"
    yield TimeDifference(kind, (driven_count - planned_count) * planned_pace, amounts)
    yield TimeDifference(kind, driven_count * (driven_pace - planned_pace), paces)


def _list_comparison_notes(
    runs: Sequence[ProjectedRun],
    field_runs: Sequence[ProjectedRun],
    saved_run: SavedPlanRun,
    tool_offset_m: float | None,
    is_field_known: bool,
) -> Iterator[str]:
    if len(field_runs) < len(runs):
        yield f"{count_noun(len(runs) - len(field_runs), 'run')} in other places skipped."
    if not all(run.has_work_state for run in field_runs):
        yield "Some runs have no work state, so ground and work are not compared."
    if not is_field_known:
        yield "The field of the plan cannot be read, so ground is not compared; put its file back."
    width = next((run.width_m for run in field_runs if run.width_m), None)
    if width and abs(width - saved_run.request.width_m) > 0.05:
        yield f"Working width: {width:g} m in the logs, {saved_run.request.width_m:g} m in the plan; both are used."
    if tool_offset_m is None:
        return
    yield (
        f"Worked ground is swept by a tool of this width {tool_offset_m:.1f} m behind the antenna, by the tractor and "
        "implement of the plan; pieces narrower than 0.4 m are not drawn."
    )
