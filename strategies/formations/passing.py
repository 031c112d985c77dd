"""Tractors on their way to a round and from it, and where on a column nobody stands in their way.

A way is traced once, and then compared with all places that are asked about.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fields.arrays import Flags, Floats, build_directions, compute_angles, measure_along
from strategies.lines.work_line import cut_line, locate_at
from strategies.moves.move import Move
from strategies.path_planning.paths import DrivePath, Pose
from strategies.programmes.move_table import MoveTable
from strategies.site.ground import CELL_M
from strategies.site.site import Site
from vehicle.sim.path_conflicts import ClearanceCheck, PosePath, build_poses

SETTLED_M = 4.0  # beyond the end of a move, on which a tractor is off its line
LINE_STEP_M = 1.0  # between poses along the lines before the first round and after the last
MOST_STEPS = 100  # between places that are tried


def trace_body(site: Site, path: DrivePath) -> Floats:
    """Poses (n, 3) of the centre of mass along a path of the guided point, and beyond its end until it has settled.

    Forwards the axle trails the guided point, in reverse the body lies along the path.
    """
    settled = replace(path, segments=(*path.segments, replace(path.segments[-1], length_m=SETTLED_M, curvature=0.0)))
    guide_m, poses = site.body.guide_m, list[tuple[float, float, float]]()
    angle = path.start[2]
    x, y = path.start[0] - guide_m * math.cos(angle), path.start[1] - guide_m * math.sin(angle)
    for gear, points in settled.sample(CELL_M):
        headings = compute_angles(np.diff(points, axis=0)).tolist()
        for (px, py), heading in zip(points.tolist(), [*headings, headings[-1]], strict=True):
            angle = math.atan2(py - y, px - x) if gear > 0 else heading + math.pi
            x, y = px - guide_m * math.cos(angle), py - guide_m * math.sin(angle)
            poses.append((x + site.axle_m * math.cos(angle), y + site.axle_m * math.sin(angle), angle))
    return np.array(poses)


def trace_line(site: Site, path: Floats, *, at_end: bool) -> Floats:
    """Poses (n, 3) on the part of a line within a machine's length of where a tractor may wait at its end, or begin."""
    whole_m, reach_m = float(measure_along(path)[-1]), site.rules.hold_back_m + site.rules.length_m
    first_m = max(0.0, whole_m - reach_m) if at_end else 0.0
    part = cut_line(path, first_m, min(whole_m, first_m + reach_m))
    along = measure_along(part)
    places = locate_at(part, along, np.linspace(0.0, along[-1], 2 + int(along[-1] / LINE_STEP_M)))
    headings = compute_angles(np.diff(places, axis=0))
    back_m = site.back_m
    return np.column_stack([places[1:] - back_m * build_directions(headings), headings])


@dataclass(frozen=True, eq=False)
class PassingWay:
    """A tractor on its way to a round or from it: poses (n, 3), and what its move cuts from either column (m)."""

    poses: Floats
    leave_m: float = 0.0
    join_m: float = 0.0

    @cached_property
    def path(self) -> PosePath:
        """Its poses as they are compared with places."""
        return PosePath(build_poses(self.poses))

    @cached_property
    def circle(self) -> tuple[float, float, float]:
        """Centre and radius of a circle round all poses (m)."""
        x, y = self.poses[:, :2].mean(axis=0).tolist()
        return x, y, float(np.hypot(*(self.poses[:, :2] - (x, y)).T).max())

    def is_near(self, x: float, y: float, reach_m: float) -> bool:
        """Whether it may come nearer to a place than that; never if it has no poses."""
        if not len(self.poses):
            return False
        u, v, radius_m = self.circle
        return math.hypot(x - u, y - v) < radius_m + reach_m


@dataclass(eq=False)
class PassageTracer:
    """The passages of a site, and the places on columns clear of them; a way is traced once."""

    site: Site
    check: ClearanceCheck
    _moves: dict[Move, PassingWay] = field(default_factory=dict)

    def trace_move(self, move: Move) -> PassingWay:
        """The way of a move."""
        if move not in self._moves:
            self._moves[move] = PassingWay(trace_body(self.site, move.path), move.leave_m, move.join_m)
        return self._moves[move]

    def trace_arrival(self, table: MoveTable, before: Sequence[int], first: int) -> PassingWay:
        """On the last part of the line before the rounds, where a tractor may wait, and from there on."""
        nodes = [*self._list_gate(table), *before]
        if not nodes:
            return PassingWay(np.empty((0, 3)))
        return self._trace_way(table, (nodes[-1], first), nodes[-1], at_end=True)

    def trace_departure(self, table: MoveTable, last: int, after: Sequence[int]) -> PassingWay:
        """To the line after the rounds, and on its first part."""
        nodes = [*after, *self._list_gate(table)]
        if not nodes:
            return PassingWay(np.empty((0, 3)))
        return self._trace_way(table, (last, nodes[0]), nodes[0], at_end=False)

    def _list_gate(self, table: MoveTable) -> list[int]:
        return [] if self.site.lane is None else [table.gate]

    def _trace_way(self, table: MoveTable, pair: tuple[int, int], node: int, *, at_end: bool) -> PassingWay:
        """A move, with part of the line of one of its nodes unless that is the entrance."""
        move = table.get_move(*pair)
        assert move is not None  # tours use moves that exist
        way = self.trace_move(move)
        if node == table.gate:
            return way
        parts = [trace_line(self.site, table.lines[node // 2].paths[node % 2], at_end=at_end), way.poses]
        return replace(way, poses=np.concatenate(parts if at_end else parts[::-1]))

    def find_clear_place(self, begin: Pose, passages: Sequence[PassingWay], place_m: float, step_m: float) -> float:
        """The first place on a column from its begin, a distance on and then in steps, that is in nobody's way (m).

        With a step to spare, as nobody stops and drives quite as planned; infinite where there is none.
        """
        if not math.isfinite(place_m):
            return place_m
        for count in (1, MOST_STEPS):  # mostly the first will do
            along_m: Floats = place_m + step_m * np.arange(-1.0, count)
            blocked = self._find_blocked(begin, along_m, passages)
            clear = np.flatnonzero(~(blocked[1:] | blocked[:-1]))
            if len(clear):
                return float(along_m[1 + clear[0]])
        return math.copysign(math.inf, step_m)

    def _find_blocked(self, begin: Pose, along_m: Floats, passages: Sequence[PassingWay]) -> Flags:
        """At which distances along a column from its begin one stands in the way of any passage."""
        x, y, heading = begin
        ahead_m = along_m - self.site.back_m
        ways = x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading)
        u, v = (0.5 * float(way[0] + way[-1]) for way in ways)
        reach_m = self.check.reach_m + 0.5 * abs(float(along_m[-1] - along_m[0]))
        near = [one.path for one in passages if one.is_near(u, v, reach_m)]
        if not near:
            return np.zeros(len(along_m), bool)
        return self.check.find_blocked(np.column_stack([*ways, np.full(len(along_m), heading)]), near)
