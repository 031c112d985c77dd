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
from strategies.lines.work_line import cut_line
from strategies.moves.drives import build_path_legs
from strategies.path_planning.errors import StrategyError
from strategies.path_planning.paths import DrivePath, EntranceLane, Pose, join_paths
from strategies.program.legs import add_wait_points
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.ways import Ways
from vehicle.missions.plan import DRIVE_IN, HEADLAND_PASS, LEAVE, ROUTE, SWATH, TURN, Leg, LegTask, Mission

SHORTEST_PIECE_M = 2.0  # shorter remains of a track are dropped
REWORK_OVERLAP_M = 1.0
LONG_TURN_M, TURN_STOPS_M = 40.0, 12.0
EXIT_STOPS_M = 10.0  # between places to wait on the way out
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
    timed_mission: TimedMission, first: int, first_m: float, moves: SiteMoves, blocked: shapely.Geometry
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
        whole = None if has_begun else _build_whole_swath_piece(run[0], moves, blocked)
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


def _build_whole_swath_piece(first: Leg, moves: SiteMoves, blocked: shapely.Geometry) -> WorkPiece | None:
    """A track that nobody has begun and nothing blocks; None otherwise."""
    if first.task.kind == HEADLAND_PASS:
        return None
    number = next((k for k, line in enumerate(moves.lines) if line.task == replace(first.task, kind=SWATH)), None)
    if number is None:
        return None
    line = moves.lines[number]
    leg_options = tuple(_build_line_legs(moves, 2 * number + way) for way in ((0, 1) if line.both_ways else (0,)))
    if any(shapely.intersects(shapely.LineString(leg.points), blocked) for legs in leg_options for leg in legs):
        return None
    return WorkPiece(leg_options, line.length_m)


def _build_line_legs(moves: SiteMoves, node: int) -> tuple[Leg, ...]:
    """The legs that work a line in a direction; a tractor may wait before the last part of it."""
    whole = moves.build_work_leg(node, 0.0)
    hold_m = max(whole.length_m - moves.site.rules.hold_back_m, 0.5 * whole.length_m)
    return (
        replace(whole, points=cut_line(whole.points, 0.0, hold_m)),
        replace(whole, points=cut_line(whole.points, hold_m, whole.length_m), may_wait=True),
    )


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


def assign_pieces(pieces: Sequence[WorkPiece], helper_tractors: Sequence[HelperTractor], ways: Ways) -> list[WorkPiece]:
    """Give every piece to a helper; returns those that nobody can reach.

    A piece that leads nowhere is given last: its helper cannot take another one.
    """
    remaining = list(pieces)
    for leads_on in (True, False):
        while remaining and _assign_soonest_finished_piece(remaining, helper_tractors, ways, leads_on):
            pass
    return remaining


def _assign_soonest_finished_piece(
    remaining: list[WorkPiece], helper_tractors: Sequence[HelperTractor], ways: Ways, leads_on: bool
) -> bool:
    """Give away the piece that is done soonest, and remove it from `remaining`; False if nobody can take any."""
    offers = sorted(
        (
            helper.free_s + _estimate_approach_s(ways, helper.pose, legs) + _compute_driving_time_s(legs),
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
        if leads_on != _has_onward_path(ways, compute_leg_end_pose(legs[-1], -1), other_pieces):
            continue
        if _append_piece_to_helper(ways, helper, legs):
            del remaining[index]
            return True
    return False


def _has_onward_path(ways: Ways, pose: Pose, other_pieces: Sequence[WorkPiece]) -> bool:
    """Whether a path leads on from a pose: out of the field, or anywhere if there is no entrance."""
    lane = ways.site.lane
    if lane is not None:
        return ways.find(pose, lane.build_path_out().start) is not None
    return not other_pieces or ways.leads_on(pose)


def _append_piece_to_helper(ways: Ways, helper: HelperTractor, legs: tuple[Leg, ...]) -> bool:
    way = ways.find(helper.pose, compute_leg_end_pose(legs[0], 0))
    if way is None:
        return False
    approach_legs = build_approach_legs(ways, way.path, legs[0].task)
    helper.legs += [*approach_legs, *legs]
    helper.free_s += _compute_driving_time_s((*approach_legs, *legs))
    helper.pose = compute_leg_end_pose(legs[-1], -1)
    return True


def build_approach_legs(ways: Ways, path: DrivePath, task: LegTask) -> list[Leg]:
    """The legs of a path to a piece of work."""
    kind = ROUTE if path.kind == "route" or path.length_m > LONG_TURN_M else TURN
    return add_wait_points(build_path_legs(ways.site, path, replace(task, kind=kind)), TURN_STOPS_M)


def build_exit_legs(ways: Ways, lane: EntranceLane, mission: Mission) -> list[Leg]:
    """The legs from the end of a mission to the entrance; raises StrategyError if no path leads there."""
    path_out = lane.build_path_out()
    way = ways.find(mission.end, path_out.start)
    if way is None:
        x, y, _ = mission.end
        raise StrategyError(
            f"No path with a turning radius of {ways.site.rules.radius_m:.1f} m leads from where work ends to the "
            f"entrance (at {x:.0f}, {y:.0f} m) inside the field."
        )
    path = join_paths((way.path, path_out), way.path.kind)
    return add_wait_points(build_path_legs(ways.site, path, LegTask(LEAVE)), EXIT_STOPS_M)


def _estimate_approach_s(ways: Ways, pose: Pose, legs: tuple[Leg, ...]) -> float:
    """Seconds of the straight way to some legs, with the change of heading on an arc."""
    goal, rules = compute_leg_end_pose(legs[0], 0), ways.site.rules
    turn = abs(math.remainder(goal[2] - pose[2], 2.0 * math.pi))
    return (math.dist(pose[:2], goal[:2]) + turn * rules.radius_m) / rules.turn_speed_mps


def _compute_driving_time_s(legs: tuple[Leg, ...]) -> float:
    return sum(leg.length_m / leg.speed_mps for leg in legs)
