"""Where tractors of a fleet stand: places to wait on a line, and those where they begin and end without an entrance.

Before it begins and when it is done, a tractor stands in the way of others. Two that each stand where the other must
pass on its first or last part never get on, so no two tours begin or end so.
"""

from __future__ import annotations

import math

import numpy as np

from fields.arrays import Flags, Floats, build_directions, compute_angles, cut_line, locate_at, measure_along
from strategies.programmes.site_moves import SiteMoves
from vehicle.missions.plan import HEADLAND_PASS
from vehicle.sim.path_conflicts import ClearanceCheck, PosePath, build_poses

WAIT_STEP_M = 40.0  # between places to wait along a line; longer moves have some too
POSE_STEP_M = 0.8  # between the poses of a path that are compared with one standing


def sample_poses(points: Floats, back_m: float, gear: int = 1) -> Floats:
    """Poses (n, 3) of a centre of mass `back_m` behind the guided point on a path (k, 2) that is driven in a gear."""
    along = measure_along(points)
    places = locate_at(points, along, np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / POSE_STEP_M))))
    ahead, poses = gear * (places[1:] - places[:-1]), np.empty((len(places), 3))
    poses[:-1, 2] = compute_angles(ahead)
    poses[-1, 2] = poses[-2, 2]
    poses[:, :2] = places - back_m * build_directions(poses[:, 2])
    return poses


def list_parts_m(moves: SiteMoves, node: int, length_m: float) -> list[float]:
    """Where the parts of a worked line begin, and its end: a tractor may wait before each but the first.

    There are places to wait along a headland side, and before the last part of any line; on a long track also before
    others come so near, as its end may be in their way.
    """
    hold_m = max(length_m - moves.site.rules.hold_back_m, 0.5 * length_m)
    if moves.lines[node // 2].task.kind != HEADLAND_PASS:
        before_m = [hold_m - WAIT_STEP_M] if hold_m > 2.0 * WAIT_STEP_M else []
        return [0.0, *before_m, hold_m, length_m]
    parts = max(1, round(hold_m / WAIT_STEP_M))
    return [0.0, *(hold_m * part / parts for part in range(1, parts + 1)), length_m]


def find_clashes(moves: SiteMoves, check: ClearanceCheck) -> Flags:
    """Nodes of which no two tractors may begin (0) or end (1) with both, (2, nodes, nodes): each stands where the other
    has to pass on its first or last part. Two that stand on the field stand where they stand."""
    known = moves.clashes
    if check not in known:
        known[check] = np.array([_find_clashes(moves, check, side) for side in (0, 1)])
        known[check][0][np.ix_(moves.starts, moves.starts)] = False
    return known[check]


def _find_clashes(moves: SiteMoves, check: ClearanceCheck, side: int) -> Flags:
    parts = [_build_part(moves, side, node) for node in range(moves.gate)]
    if not parts:
        return np.zeros((0, 0), bool)
    stands = PosePath(build_poses(np.array([part[-side] for part in parts])))
    is_blocked = np.zeros((moves.gate, moves.gate), bool)
    for node, part in enumerate(parts):
        is_blocked[check.find_blocked_parts(stands, PosePath(build_poses(part)))[:, 0], node] = True
    both: Flags = is_blocked & is_blocked.T
    return both


def _build_part(moves: SiteMoves, side: int, node: int) -> Floats:
    """Poses (n, 3) of the centre of mass on the first (or last) part of a line."""
    path = moves.lines[node // 2].paths[node % 2]
    parts_m = list_parts_m(moves, node, float(measure_along(path)[-1]))
    points = cut_line(path, *(parts_m[-2:] if side else parts_m[:2]))
    return sample_poses(points, moves.site.back_m)
