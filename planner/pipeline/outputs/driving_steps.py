"""What each tractor of a run does, step by step: the driver's list.

The legs of one swath, headland side, turn or route are one step, drive-in included; a wait splits a step in two.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Flags, Floats, Integers, compute_angles, measure_along
from fields.geometry.overlays import intersect, subtract, unite
from planner.farm.workday import Workday
from planner.pipeline.outputs.step_measures import NO_MEASURES, StepMeasures
from planner.request.plan_request import STANDING_CROP_OPERATIONS
from reports.common.plan_records import DriverLeg
from strategies.lines.line_wishes import format_piece_letter, name_line
from strategies.rules.legs import MIN_STEP_M
from vehicle.missions.plan import (
    DRIVE,
    ENTER,
    HEADLAND_PASS,
    LEAVE,
    REFILL,
    ROUTE,
    SWATH,
    TURN,
    Leg,
)
from vehicle.missions.run import (
    RecordSegment,
    SimulationRun,
    classify_task,
    iter_segments,
    measure_reversing_m,
    number_leg_steps,
)
from vehicle.records import WAITING

CORNER, WAIT, TO_REFILL, FOLD, UNFOLD, REST = "corner", "wait", "refill-way", "fold", "unfold", "rest"
"""Kinds of step that are not kinds of task."""
LOOP_SHARE = 0.5  # of the length: a step whose ends are nearer to each other has no direction
OMEGA_SWING_RAD = math.radians(20.0)  # a turn that first swings out by more than this is an omega
MAX_SKEW_SHARE = 0.02  # of the length: swaths of one cell diverge by no more
MIN_SPACING_SHARE = 0.5  # of the width: swaths of one cell are never nearer
MAX_TURN_M = 60.0  # a longer one is a route, whatever its shape
MIN_U_TURN_RAD, MIN_BULB_RAD = math.radians(135.0), math.radians(225.0)  # a turn by less is no U; one by more is a bulb

MIN_CROSSED_M = 5.0  # on finished ground: less is the end of a turn, and what is not named is less together
HEADLAND = "headland"  # what finished headland passes are called, beside the names of tracks

Steps = tuple[tuple[DriverLeg, ...], ...]
"""Those of every tractor, in order."""


def list_steps(
    run: SimulationRun, width_m: float, measures: StepMeasures = NO_MEASURES, *, operation: str | None = None
) -> Steps:
    """The steps of every tractor in order; `width_m` is the width of the implement, `measures` what steps use.

    Where a crop stands until it is worked, as the `operation` says, they tell where they lead over it.
    """
    worked_ground = _list_worked_ground(run, width_m, operation in STANDING_CROP_OPERATIONS)
    return tuple(
        tuple(_iter_steps(run, tractor, width_m, worked_ground, measures)) for tractor in range(run.plan.tractors)
    )


def delay_steps(steps: Steps, workday: Workday | None) -> Steps:
    """Steps of every tractor at the times of a working day, which may begin with the road and has breaks."""
    day = workday or Workday()

    def delay(step: DriverLeg) -> DriverLeg:
        begin_s = day.before_field_s + step.from_s
        clock_s = day.compute_clock_s(begin_s, begins=True)
        pause_s = day.compute_clock_s(begin_s + step.seconds) - clock_s - step.seconds
        return replace(step, delay_s=clock_s - step.from_s, pause_s=max(0.0, round(pause_s, 3)))

    return tuple(tuple(map(delay, own)) for own in steps)


@dataclass(frozen=True, eq=False)
class _WorkedGround:
    """Strips (n,) of work, the name of each, and the row of the record in which it was finished.

    Where `crop_stands`, it does so until then.
    """

    strips: npt.NDArray[np.object_]
    names: list[str]
    finished_row: Integers
    crop_stands: bool


def _list_worked_ground(run: SimulationRun, width_m: float, crop_stands: bool) -> _WorkedGround:
    """The ground of every leg of work."""
    lines, labels, rows = list[shapely.LineString](), list[str](), list[int]()
    for tractor, mission in enumerate(run.plan.missions):
        leg_numbers = run.get_leg_numbers(tractor)
        for number, leg in enumerate(mission.legs):
            if leg.task.is_work and leg.task.number is not None:
                lines.append(shapely.LineString(leg.points))
                labels.append(HEADLAND if leg.task.kind == HEADLAND_PASS else name_line(leg.task))
                rows.append(int(np.searchsorted(leg_numbers, number, side="right")))
    strips = shapely.buffer(np.array(lines, dtype=np.object_), 0.5 * width_m, cap_style="flat")
    return _WorkedGround(strips, labels, np.array(rows, dtype=np.int64), crop_stands)


def _measure_crossing(path: Floats, worked_ground: _WorkedGround, is_counted: Flags) -> tuple[tuple[str, ...], float]:
    """Names of those strips (n,) that count and that a path (t, 2) leads over, and the metres on them.

    What lies on another strip as well does not count: ground that is worked again is not finished, and on ground that
    was worked once nothing stands.
    """
    line = shapely.LineString(path)
    near = shapely.intersects(worked_ground.strips, line)
    line = subtract(line, unite(worked_ground.strips[near & ~is_counted]))
    metres: dict[str, float] = {}
    for strip in np.flatnonzero(near & is_counted).tolist():
        name = worked_ground.names[strip]
        metres[name] = metres.get(name, 0.0) + float(intersect(line, worked_ground.strips[strip]).length)
    by_metres = sorted(metres, key=lambda name: (metres[name], len(name), name))
    slight = np.cumsum([metres[name] for name in by_metres]) < MIN_CROSSED_M
    crossed = sorted(by_metres[slight.sum() :], key=lambda name: (len(name), name))
    total_m = math.fsum(metres.values())
    return (tuple(crossed), total_m) if total_m >= MIN_CROSSED_M else ((), 0.0)


def _iter_steps(
    run: SimulationRun, tractor: int, width_m: float, worked_ground: _WorkedGround, measures: StepMeasures
) -> Iterator[DriverLeg]:
    mission = run.plan.missions[tractor]
    legs, groups = mission.legs, number_leg_steps(mission.legs)
    begun: set[int] = set()
    for segment in iter_segments(run, tractor):
        values = measures.list_values(tractor, segment.first_row, segment.end_row)
        first, last = segment.first_row, min(segment.end_row, len(run.time_s) - 1)
        path = run.get_poses(tractor)[first : last + 1, :2]
        driven_m, from_s = measure_along(path), float(run.time_s[first])
        x, y = path[int(np.searchsorted(driven_m, 0.5 * driven_m[-1]))].tolist()
        step = DriverLeg(WAIT, None, "", from_s, float(run.time_s[last] - from_s), float(driven_m[-1]), x, y, **values)
        if mission.rests:
            yield replace(step, kind=REST)
            continue
        if segment.is_standing:
            yield _name_stand(step, run, tractor, segment)
            continue
        if segment.is_waiting:
            yield replace(step, for_tractors=_find_awaited_tractors(run, tractor, segment))
            continue
        members = np.flatnonzero(groups == segment.group)
        named = _build_step(legs, int(members[0]), int(members[-1]), width_m)
        yield replace(
            named,
            from_s=step.from_s,
            seconds=step.seconds,
            length_m=step.length_m,
            x_m=step.x_m,
            y_m=step.y_m,
            continues=segment.group in begun,
            **_describe_drive(run, tractor, segment, named.kind, worked_ground),
            **values,
        )
        begun.add(segment.group)


def _describe_drive(
    run: SimulationRun, tractor: int, segment: RecordSegment, kind: str, worked_ground: _WorkedGround
) -> dict[str, Any]:
    """How much of a driven segment is in reverse, and over which finished or standing ground; nothing for work."""
    if kind in (SWATH, HEADLAND_PASS):
        return {}
    last = min(segment.end_row, len(run.time_s) - 1)
    path = run.get_poses(tractor)[segment.first_row : last + 1, :2]
    values: dict[str, Any] = {"reversing_m": measure_reversing_m(run, tractor, segment)}
    is_finished = worked_ground.finished_row <= segment.first_row
    if len(path) > 1:
        values["over_finished"], values["over_finished_m"] = _measure_crossing(path, worked_ground, is_finished)
    if len(path) > 1 and worked_ground.crop_stands:
        values["over_standing"], values["over_standing_m"] = _measure_crossing(path, worked_ground, ~is_finished)
    return values


def _name_stand(step: DriverLeg, run: SimulationRun, tractor: int, segment: RecordSegment) -> DriverLeg:
    """A step of standing, named after what is done there."""
    if run.find_folding_rows(tractor)[segment.first_row]:
        leg = run.plan.missions[tractor].legs[run.get_leg_numbers(tractor)[segment.first_row]]
        return replace(step, kind=FOLD if leg.folded else UNFOLD)
    notes, place = run.plan.notes, (tractor, int(run.get_leg_numbers(tractor)[segment.first_row]))
    sign = -1.0 if notes.collects else 1.0  # what is taken out is negative; None if the plan does not say
    amounts = (sign * stop.amount for stop in notes.stops or () if (stop.tractor, stop.leg) == place)
    return replace(step, kind=notes.service, amount=next(amounts, None))


def _find_awaited_tractors(run: SimulationRun, tractor: int, segment: RecordSegment) -> tuple[int, ...]:
    """The tractors, from 1, whose gates may be closed when a wait begins; otherwise the tractor that is followed."""
    legs, current_leg = run.plan.missions[tractor].legs, int(run.get_leg_numbers(tractor)[segment.first_row])
    started = bool((run.get_statuses(tractor)[: segment.first_row] != WAITING).any())
    next_gates = (
        legs[current_leg + 1].gates
        if started and current_leg + 1 < len(legs)
        else ()
        if started
        else legs[current_leg].gates
    )
    closed_by = {
        gate.tractor + 1 for gate in next_gates if int(run.get_leg_numbers(gate.tractor)[segment.first_row]) <= gate.leg
    }
    follow = legs[current_leg].follow
    return tuple(sorted(closed_by)) or (() if follow is None else (follow.tractor + 1,))


def _build_step(legs: Sequence[Leg], first: int, last: int, width_m: float) -> DriverLeg:
    """The step of the legs `first` to `last`, without time and place."""
    task, kind_group = legs[first].task, classify_task(legs[first].task)
    goal = next((leg for leg in range(first, len(legs)) if legs[leg].task.is_work), None)
    on_headland_pass = goal is not None and legs[goal].task.kind == HEADLAND_PASS
    step = DriverLeg(kind_group, None, "", 0.0, 0.0, 0.0, 0.0, 0.0)
    if kind_group == REFILL:
        return replace(step, kind=TO_REFILL)
    if kind_group == ENTER and goal is not None:
        task = legs[goal].task
    if kind_group in (DRIVE, LEAVE) or task.number is None:
        return replace(step, kind=kind_group if kind_group in (ENTER, LEAVE) else DRIVE)
    part = str(task.piece + 1) if on_headland_pass else format_piece_letter(task.piece)
    numbered_step = replace(
        step,
        number=task.number + (not on_headland_pass),
        is_headland_pass=on_headland_pass,
        part=part if task.is_piece else "",
    )
    step_legs = legs[first : last + 1]
    if kind_group == ENTER:
        return numbered_step
    if kind_group in (HEADLAND_PASS, SWATH):
        return replace(numbered_step, bearing_deg=_compute_bearing_deg(step_legs))
    before = legs[first - 1].task if first else None
    is_way = any(leg.task.kind == ROUTE for leg in step_legs) or sum(leg.length_m for leg in step_legs) > MAX_TURN_M
    is_corner = (
        not is_way
        and on_headland_pass
        and before is not None
        and before.kind == HEADLAND_PASS
        and before.number == task.number
    )
    swaths_over = (
        _count_swaths_over(legs, first - 1, goal, width_m) if first and goal is not None and not is_way else None
    )
    kind = CORNER if is_corner else ROUTE if is_way else TURN
    return replace(numbered_step, kind=kind, over_swaths=swaths_over, shape="" if is_way else _classify_turn(step_legs))


def _count_swaths_over(legs: Sequence[Leg], from_index: int, to_index: int, width_m: float) -> int | None:
    """How many swaths a turn leads over; None if it does not join two swaths of one cell."""
    a, b = legs[from_index], legs[to_index]
    if a.task.kind != SWATH or b.task.kind != SWATH or a.task.number is None or b.task.number is None:
        return None
    swath_count = abs(a.task.number - b.task.number)
    along = a.points[-1] - a.points[-2]
    along = along / float(np.hypot(*along))
    ahead, off = b.points[-1] - b.points[0], b.points[0] - a.points[-1]
    aside_m, apart_m = (abs(float(along[0] * step[1] - along[1] * step[0])) for step in (ahead, off))
    parallel = aside_m <= MAX_SKEW_SHARE * b.length_m
    spaced = MIN_SPACING_SHARE * swath_count * width_m <= apart_m <= (swath_count + 1.0 - MIN_SPACING_SHARE) * width_m
    return swath_count if swath_count and parallel and spaced else None


def _compute_bearing_deg(legs: Sequence[Leg]) -> float | None:
    """Direction of the middle half, clear of corners driven in a bend, clockwise from north; None for a loop."""
    begin, end = legs[0].points[0], legs[-1].points[-1]
    length = sum(leg.length_m for leg in legs)
    if math.hypot(*(end - begin).tolist()) < max(LOOP_SHARE * length, MIN_STEP_M):
        return None
    line = shapely.LineString(np.concatenate([leg.points for leg in legs]))
    a, b = (line.interpolate(share, normalized=True) for share in (0.25, 0.75))
    return math.degrees(math.atan2(b.x - a.x, b.y - a.y)) % 360.0


def _classify_turn(legs: Sequence[Leg]) -> str:
    """The shape of a turn: "switch-back" (reversing), "omega" (bulb or swinging out), "u", or "" for a slight bend."""
    if any(leg.gear < 0 for leg in legs):
        return "switch-back"
    points = np.concatenate([legs[0].points, *(leg.points[1:] for leg in legs[1:])])
    steps = np.diff(points, axis=0)
    steps = steps[np.hypot(*steps.T) > MIN_STEP_M]
    bends = np.diff(np.unwrap(compute_angles(steps)))
    left_rad, right_rad = float(bends[bends > 0].sum()), float(-bends[bends < 0].sum())
    if max(left_rad, right_rad) < MIN_U_TURN_RAD:
        return ""
    return "omega" if min(left_rad, right_rad) > OMEGA_SWING_RAD or max(left_rad, right_rad) > MIN_BULB_RAD else "u"
