"""Turns of a run that a tractor did not follow well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_checks import FenceIntrusionCheck, ObstacleIntrusionCheck
from planner.evaluation.ground.coverage import Points, locate_antenna
from vehicle.missions.plan import Mission
from vehicle.missions.run import SimulationRun

MAX_OFFSET_M = 0.4  # a swath started farther beside its line needs a better turn
MAX_OUTSIDE_M = 0.3  # so does a turn this far outside the field
MAX_TURN_M = 60.0  # a longer leg is a route: slowing all of it would cost more than the offset


@dataclass(frozen=True)
class TurnDeviation:
    """The deviation after a turn: tractor, first working leg after the turn, and metres.

    `is_outside`: the turn left the field, crossed a fence, or touched an obstacle.
    """

    tractor: int
    leg: int
    offset_m: float
    is_outside: bool = False


def find_turn_deviations(run: SimulationRun, context: PlanningContext) -> list[TurnDeviation]:
    """Every turn of a run with its deviation: the offset of the next swath, or how far it left the field if worse."""
    checks: tuple[FenceIntrusionCheck | ObstacleIntrusionCheck, ...] = (
        FenceIntrusionCheck(context),
        ObstacleIntrusionCheck(context),
    )
    turns = []
    for tractor, mission in enumerate(run.plan.missions):
        at_leg, poses = run.get_leg_numbers(tractor), run.get_poses(tractor)
        legs = find_first_working_legs(mission)
        starts = _find_leg_start_rows(at_leg, [find_first_turn_leg(mission, leg) for leg in legs])
        ends = [start_points + 1 for start_points in _find_leg_start_rows(at_leg, legs)]
        rows = _mark_rows(starts, ends, len(poses))
        beyond_m = _measure_outside_m(poses, rows, context)
        is_near = [_find_rows_to_check(check, poses, rows) for check in checks]
        start_points = locate_antenna(poses[np.array(ends, dtype=np.int64) - 1], context)
        for leg, place, start, end in zip(legs, start_points, starts, ends, strict=True):
            line = mission.legs[leg].points
            along = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
            off = place - line[0]
            offset_m = abs(float(along[0] * off[1] - along[1] * off[0]))
            outside_m = float(np.max(beyond_m[start:end], initial=0.0))
            crossed_m = max(
                check.measure_intrusion_m(poses[start:end]) if rows_near[start:end].any() else 0.0
                for check, rows_near in zip(checks, is_near, strict=True)
            )
            outside_m = max(outside_m, MAX_OUTSIDE_M + crossed_m if crossed_m else 0.0)
            is_outside = outside_m > MAX_OUTSIDE_M
            turns.append(
                TurnDeviation(
                    tractor, leg, max(offset_m, outside_m + MAX_OFFSET_M) if is_outside else offset_m, is_outside
                )
            )
    return turns


def _find_leg_start_rows(at_leg: npt.NDArray[np.int64], legs: list[int]) -> list[int]:
    """The first row of the record on each of the legs or a later one; 0 for a leg that is never reached."""
    rows = np.searchsorted(at_leg, legs)
    rows[rows == len(at_leg)] = 0
    return rows.tolist()  # type: ignore[no-any-return]


def _mark_rows(starts: list[int], ends: list[int], count: int) -> npt.NDArray[np.bool_]:
    """Which of `count` rows are in turns with these first and end rows."""
    rows = np.zeros(count, dtype=np.bool_)
    for start, end in zip(starts, ends, strict=True):
        rows[start:end] = True
    return rows


def _measure_outside_m(poses: Points, rows: npt.NDArray[np.bool_], context: PlanningContext) -> Points:
    """How far (t,) the guided point is outside the field at the marked rows; 0 elsewhere and inside."""
    boundary = context.layout.field.workable_region
    shapely.prepare(boundary)
    beyond_m, looked = np.zeros(len(poses)), np.flatnonzero(rows)
    path = locate_antenna(poses[looked], context)
    out = ~shapely.contains_xy(boundary, path)
    beyond_m[looked[out]] = shapely.distance(shapely.points(path[out]), boundary)
    return beyond_m


def _find_rows_to_check(
    check: FenceIntrusionCheck | ObstacleIntrusionCheck, poses: Points, rows: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Which of the marked rows (t,) a check must look at."""
    is_near = rows.copy()
    is_near[rows] = check.find_poses_to_check(poses[rows])
    return is_near


def get_worst_offset_m(turns: list[TurnDeviation]) -> float:
    """The largest deviation (m) of all turns."""
    return max((deviation.offset_m for deviation in turns), default=0.0)


def find_first_working_legs(mission: Mission) -> list[int]:
    """First working legs after every interruption of work: of swaths, and of headland sides after a corner."""
    legs = mission.legs
    return [k for k in range(1, len(legs)) if legs[k].implement and not legs[k - 1].implement]


def find_first_turn_leg(mission: Mission, leg: int) -> int:
    """The first of the legs that lead to a working leg."""
    goal = mission.legs[leg].task
    while leg > 0 and not mission.legs[leg - 1].implement and mission.legs[leg - 1].task.has_same_goal(goal):
        leg -= 1
    return leg
