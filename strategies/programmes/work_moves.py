"""Moves with the implement down: round the corner of a headland pass, or round what interrupts a swath.

Both lines are cut back for the arc, and ground that stays unworked so is charged like that of lines left.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely

from fields.geometry.overlays import intersect, subtract
from strategies.lines.work_line import SHARPEST_RAD, STRAIGHT_RAD, WorkLine
from strategies.moves.move import Move
from strategies.moves.move_finder import MoveFinder
from strategies.path_planning.paths import DrivePath, Pose
from strategies.site.ground import CELL_M
from strategies.site.site import MISSED_FACTOR, Site
from vehicle.missions.plan import HEADLAND_PASS

SWATH_OFF_M, SWATH_TURN_RAD = 0.5, 0.05  # pieces of one swath continue each other this well
FARTHEST_M = 50.0  # between the ends of pieces joined with the implement down
BYPASSES_M = (0.0, 2.0, 4.0, 6.0, 9.0, 12.0, 16.0)  # cut from both pieces of a swath, to leave the line and return
ROUNDER_M = (0.0, 2.0)  # cut from both sides of a corner beyond the tangent of the arc
LONGEST_DETOUR, DETOUR_M = 1.7, 2.0  # of the way asked for: more is no longer working the same ground
MOST_CUT_SHARE = 0.5


def list_work_moves(site: Site, finder: MoveFinder, a: WorkLine, way: int, b: WorkLine, next_way: int) -> list[Move]:
    """The moves with the implement down from the end of line a, driven one way, to the begin of line b."""
    if a.group != b.group or a is b:
        return []
    end, begin = a.get_end(way), b.get_begin(next_way)
    moves = []
    for leave_m, join_m, corner in _list_cuts(site, end, begin, a.task.kind):
        factor = MISSED_FACTOR if corner is None else site.corner_factor
        if leave_m > MOST_CUT_SHARE * a.measure_path_m(way) - 1.0:
            continue
        if join_m > MOST_CUT_SHARE * b.measure_path_m(next_way) - 1.0:
            continue
        p = a.get_pose(way, a.measure_path_m(way) - leave_m)
        q = b.get_pose(next_way, join_m)
        for move in finder.list_moves(p, q, leads=False, most=2):
            missed_m2 = _measure_missed_m2(site, move.path, p, q, corner)
            if missed_m2 is not None and factor < math.inf:
                finish_s = factor * missed_m2 * site.work_s_per_m2
                drive_s = max(move.drive_s, move.path.length_m / site.rules.work_speed_mps)
                drive_s -= (leave_m + join_m) / site.rules.work_speed_mps
                moves.append(
                    replace(move, drive_s=drive_s, charge_s=finish_s, leave_m=leave_m, join_m=join_m, is_work=True)
                )
                break
    return moves


def _list_cuts(
    site: Site, end: Pose, begin: Pose, kind: str
) -> Iterator[tuple[float, float, tuple[float, float] | None]]:
    """By how much both lines may be cut back, and the corner between them, None where they continue each other."""
    turn = math.remainder(begin[2] - end[2], 2.0 * math.pi)
    ux, uy, vx, vy = math.cos(end[2]), math.sin(end[2]), math.cos(begin[2]), math.sin(begin[2])
    dx, dy = begin[0] - end[0], begin[1] - end[1]
    along, aside = ux * dx + uy * dy, ux * dy - uy * dx
    if kind == HEADLAND_PASS and STRAIGHT_RAD < abs(turn) <= SHARPEST_RAD:
        cross = ux * vy - uy * vx
        before, after = (dx * vy - dy * vx) / cross, (ux * dy - uy * dx) / cross
        tangent = site.rules.radius_m * math.tan(0.5 * abs(turn))
        reach_m = site.width_m + 2.0 * tangent
        if abs(before) <= reach_m and abs(after) <= reach_m:
            corner = end[0] + before * ux, end[1] + before * uy
            for more in ROUNDER_M:
                yield max(0.0, tangent - before + more), max(0.0, tangent - after + more), corner
    elif math.hypot(dx, dy) <= FARTHEST_M and abs(turn) <= STRAIGHT_RAD and along > -2.0:
        is_straight_on = abs(turn) <= SWATH_TURN_RAD and abs(aside) <= SWATH_OFF_M
        cuts = BYPASSES_M if kind == HEADLAND_PASS or is_straight_on else ()
        yield from ((cut, cut, None) for cut in cuts)


def _measure_missed_m2(
    site: Site, path: DrivePath, p: Pose, q: Pose, corner: tuple[float, float] | None
) -> float | None:
    """Ground that an arc leaves of what the lines would have worked (m2); None if it is no way to work it."""
    if not path.segments or path.reverse_m > 0.0:
        return None
    places = [p[:2], *([] if corner is None else [corner]), q[:2]]
    straight = shapely.LineString(places)
    if path.length_m > LONGEST_DETOUR * straight.length + DETOUR_M:
        return None
    driven = shapely.LineString(np.concatenate([points for _, points in path.sample(CELL_M)]))
    half_m = 0.5 * site.width_m
    due = shapely.buffer(straight, half_m, cap_style="flat", join_style="mitre")
    worked = shapely.buffer(driven, half_m, cap_style="flat")
    return float(intersect(subtract(due, worked), site.work_ground).area)
