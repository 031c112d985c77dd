"""Reassigns remaining tracks: piece by piece to the tractor that would finish it soonest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely
import shapely.ops

from planner.fleet.model.timed_mission import TimedMission
from strategies.headland.raised_paths import find_raised_path
from strategies.path_planning.paths import DrivePath, Pose
from strategies.path_planning.primitive_search import compute_shortest_m
from strategies.program.field_job import FieldJob, SwathPass
from strategies.program.legs import add_wait_points, build_path_legs, build_swath_legs
from vehicle.missions.plan import DRIVE_IN, HEADLAND_PASS, ROUTE, SWATH, TURN, Leg, LegTask

SHORTEST_PIECE_M = 2.0  # shorter remains of a track are dropped
REWORK_OVERLAP_M = 1.0
LONG_TURN_M, TURN_STOPS_M = 40.0, 12.0
Points = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WorkPiece:
    """A piece of remaining work: the options to drive it, each a run of legs."""

    leg_options: tuple[tuple[Leg, ...], ...]
    work_m: float


@dataclass
class HelperTractor:
    """A tractor that takes over work: when it is free, where, and its new legs."""

    number: int
    free_s: float
    pose: Pose
    legs: list[Leg]


def find_remaining_pieces(
    timed_mission: TimedMission, first: int, first_m: float, job: FieldJob, blocked: shapely.Geometry
) -> tuple[list[WorkPiece], float]:
    """Find the work after `first_m` metres of leg `first`: whole tracks in both directions, others from where they end.

    Parts in `blocked` are left out; their metres are the second value.
    """
    pieces: list[WorkPiece] = []
    blocked_m = 0.0
    legs, k = timed_mission.legs, first
    while k < len(legs):
        if legs[k].task.kind not in (SWATH, HEADLAND_PASS, DRIVE_IN):
            k += 1
            continue
        run = [legs[k]]
        while k + len(run) < len(legs) and _is_continuation(run[-1], legs[k + len(run)]):
            run.append(legs[k + len(run)])
        has_begun = k == first and (first_m > 0.0 or (k > 0 and _is_continuation(legs[k - 1], run[0])))
        whole = None if has_begun else _build_whole_swath_piece(run[0], job, blocked)
        if whole is None:
            parts, lost_m = _cut_unworked_parts(run, first_m if has_begun else 0.0, blocked)
            blocked_m += lost_m
        pieces += [whole] if whole else parts
        k += len(run)
    return pieces, blocked_m


def _is_continuation(previous: Leg, leg: Leg) -> bool:
    """Whether a leg continues the work of the previous one on the same track or headland side."""
    return (
        leg.task.kind in (SWATH, DRIVE_IN)
        and previous.task.kind != HEADLAND_PASS
        and previous.task.has_same_goal(leg.task)
    )


def _build_whole_swath_piece(first: Leg, job: FieldJob, blocked: shapely.Geometry) -> WorkPiece | None:
    """A track that nobody has begun and nothing blocks; None otherwise."""
    if first.task.kind == HEADLAND_PASS:
        return None
    swath = next((t for t in job.layout.swaths if (t.line, t.piece) == (first.task.number, first.task.piece)), None)
    if swath is None:
        return None
    leg_options = tuple(tuple(build_swath_legs(job, SwathPass(swath, direction))) for direction in (1, -1))
    if any(shapely.intersects(shapely.LineString(leg.points), blocked) for legs in leg_options for leg in legs):
        return None
    return WorkPiece(leg_options, swath.length_m)


def _cut_unworked_parts(run: Sequence[Leg], done_m: float, blocked: shapely.Geometry) -> tuple[list[WorkPiece], float]:
    """The parts of a run that are neither driven nor `blocked`, in its direction, and the blocked metres."""
    points = np.concatenate([leg.points for leg in run])
    line = shapely.remove_repeated_points(shapely.LineString(points), 1e-6)
    line = shapely.ops.substring(line, max(done_m - REWORK_OVERLAP_M, 0.0), line.length)
    working_leg = next((leg for leg in run if leg.implement), run[0])
    pieces = []
    for part in shapely.get_parts(shapely.difference(line, blocked)).tolist():
        if part.geom_type == "LineString" and part.length >= SHORTEST_PIECE_M:
            leg = replace(
                working_leg, points=np.asarray(part.coords), gates=(), follow=None, stand_s=0.0, may_wait=True
            )
            pieces.append(WorkPiece(((leg,),), part.length))
    return pieces, float(shapely.intersection(line, blocked).length)


def compute_leg_end_pose(leg: Leg, end: int) -> Pose:
    """Pose of the tractor at one end of a leg, 0 or -1."""
    (x0, y0), (x1, y1) = leg.points[:2] if end == 0 else leg.points[-2:]
    x, y = leg.points[end]
    return float(x), float(y), math.atan2(leg.gear * (y1 - y0), leg.gear * (x1 - x0))


def assign_pieces(
    pieces: Sequence[WorkPiece], helper_tractors: Sequence[HelperTractor], job: FieldJob
) -> list[WorkPiece]:
    """Give every piece to a helper; returns those that nobody can reach.

    A piece that leads nowhere is given last: its helper cannot take another one.
    """
    remaining = list(pieces)
    for leads_on in (True, False):
        while remaining and _assign_soonest_finished_piece(remaining, helper_tractors, job, leads_on):
            pass
    return remaining


def _assign_soonest_finished_piece(
    remaining: list[WorkPiece], helper_tractors: Sequence[HelperTractor], job: FieldJob, leads_on: bool
) -> bool:
    """Give away the piece that is done soonest, and remove it from `remaining`; False if nobody can take any."""
    offers = sorted(
        (
            helper.free_s + _estimate_approach_s(job, helper.pose, legs) + _compute_driving_time_s(legs),
            helper.number,
            index,
            direction,
        )
        for helper in helper_tractors
        for index, piece in enumerate(remaining)
        for direction, legs in enumerate(piece.leg_options)
    )
    for _, number, index, direction in offers:
        helper = next(candidate for candidate in helper_tractors if candidate.number == number)
        legs, other_pieces = remaining[index].leg_options[direction], [*remaining[:index], *remaining[index + 1 :]]
        if leads_on != _has_onward_path(job, compute_leg_end_pose(legs[-1], -1), other_pieces):
            continue
        if _append_piece_to_helper(job, helper, legs):
            del remaining[index]
            return True
    return False


def _has_onward_path(job: FieldJob, pose: Pose, other_pieces: Sequence[WorkPiece]) -> bool:
    """Whether a path leads on from a pose: out of the field, or to another piece if there is no entrance."""
    if job.entrance_lane is not None:
        return find_path_between(job, pose, job.entrance_lane.build_path_out().start) is not None
    return not other_pieces or any(
        find_path_between(job, pose, compute_leg_end_pose(legs[0], 0))
        for piece in other_pieces
        for legs in piece.leg_options
    )


def find_path_between(job: FieldJob, start: Pose, end: Pose) -> DrivePath | None:
    """A path between two pieces of work, also from corners where headland sides end at the edge; None if none."""
    return job.find_path(start, end) or find_raised_path(job, start, end, allow_rim=True)


def _append_piece_to_helper(job: FieldJob, helper: HelperTractor, legs: tuple[Leg, ...]) -> bool:
    path = find_path_between(job, helper.pose, compute_leg_end_pose(legs[0], 0))
    if path is None:
        return False
    approach_legs = build_approach_legs(job, path, legs[0].task)
    helper.legs += [*approach_legs, *legs]
    helper.free_s += sum(leg.length_m / leg.speed_mps for leg in (*approach_legs, *legs))
    helper.pose = compute_leg_end_pose(legs[-1], -1)
    return True


def build_approach_legs(job: FieldJob, path: DrivePath, task: LegTask) -> list[Leg]:
    """The legs of a path to a piece of work."""
    kind = ROUTE if path.kind == "route" or path.length_m > LONG_TURN_M else TURN
    return add_wait_points(build_path_legs(job, path, replace(task, kind=kind)), TURN_STOPS_M)


def _estimate_approach_s(job: FieldJob, pose: Pose, legs: tuple[Leg, ...]) -> float:
    length_m = compute_shortest_m(
        np.array(pose), np.array(compute_leg_end_pose(legs[0], 0)), job.driving_rules.radius_m
    )
    return float(length_m) / job.driving_rules.turn_speed_mps


def _compute_driving_time_s(legs: tuple[Leg, ...]) -> float:
    return sum(leg.length_m / leg.speed_mps for leg in legs)
