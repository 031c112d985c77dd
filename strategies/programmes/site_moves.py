"""The moves of a site: which there are between any two lines, and how each is driven; asked once, then remembered.

A node is a line in one direction: 2 i for the first of line i, 2 i + 1 for the other, so that `node ^ 1` is the same
line driven the other way. The entrance is a node too, the last. Nothing here depends on what was asked before, so that
all programmes of a site may share it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from strategies.lines.lay_lines import measure_proof_rooms
from strategies.lines.work_line import WorkLine, cut_line
from strategies.moves.move import Move, MoveFinder
from strategies.path_planning.paths import DrivePath, Pose
from strategies.program.legs import MIN_LEG_M, MIN_STEP_M, PATH_STEP_M
from strategies.programmes.work_moves import list_work_moves
from strategies.site.site import MISSED_FACTOR, Site
from vehicle.missions.plan import TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE

Floats = npt.NDArray[np.float64]

DEAR_S = 12.0  # a move that takes so much longer than its way is also sought with the ends of lines cut back
CUTS_M = ((4.0, 0.0), (0.0, 4.0), (4.0, 4.0), (8.0, 8.0))  # from the line left, and from the line begun
MOST_CUT_SHARE = 0.4
SETTLE_M = 20.0  # of the lines before and after a move that are driven with it
BRAKE_M = 10.0  # beyond, so that stopping at the end is not measured
STRAIGHT_M = 2.0 * (SETTLE_M + BRAKE_M)  # driven from rest to rest, for what starting and stopping take
MOST_OFF_SHARE = 0.25  # of the width: a drive that begins a line farther beside it has lost it
OFF_LENGTH_M = 6.0  # driven until a tractor is back on a line that it began beside
ROOM_TOLERANCE_M = 0.03
MISSION_TOLERANCE_M = 0.1  # of a whole mission, whose lines begin less exactly than those driven alone


@dataclass(eq=False)
class SiteMoves:
    """All that is known of the moves between the lines of a site.

    Attributes:
        ends, begins: poses of the guided point where nodes end and begin; the entrance comes last.
    """

    site: Site
    lines: Sequence[WorkLine]
    finder: MoveFinder = field(init=False)
    _options: dict[tuple[int, int], tuple[Move, ...]] = field(default_factory=dict)
    _found: dict[tuple[int, int], Move | None] = field(default_factory=dict)
    _driven: dict[Move, Move | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.finder = MoveFinder(self.site)
        nodes, lane = range(2 * len(self.lines)), self.site.lane
        self.ends: list[Pose] = [self.lines[k // 2].get_end(k % 2) for k in nodes]
        self.begins: list[Pose] = [self.lines[k // 2].get_begin(k % 2) for k in nodes]
        self.ends.append((0.0, 0.0, 0.0) if lane is None else lane.inner_pose)
        self.begins.append((0.0, 0.0, 0.0) if lane is None else lane.build_path_out().start)

    @property
    def gate(self) -> int:
        """The node of the entrance."""
        return 2 * len(self.lines)

    def list_options(self, u: int, v: int) -> tuple[Move, ...]:
        """The moves in closed form between two nodes, the cheapest first."""
        if (u, v) not in self._options:
            self._options[u, v] = tuple(self._list_options(u, v))
        return self._options[u, v]

    def search(self, u: int, v: int) -> Move | None:
        """A move by search, if need be between lines cut back by the turning radius."""
        if (u, v) not in self._found:
            self._found[u, v] = self._search(u, v)
        return self._found[u, v]

    def drive(self, u: int, v: int, move: Move) -> Move | None:
        """A move with its time and deviation as driven; None if it is not, leaves the ground or loses its line."""
        if move not in self._driven:
            self._driven[move] = self._drive(u, v, move)
        return self._driven[move]

    def has_way(self, u: int, v: int) -> bool:
        """Whether more than a pocket of ground is reached from where u ends, and leads to where v begins."""
        finder = self.finder
        return finder.has_way_on(self.ends[u], backwards=False) and finder.has_way_on(self.begins[v], backwards=True)

    def guess_plain_s(self, u: int, v: int) -> float:
        """Seconds of the straight way at turning speed, with the change of heading on an arc."""
        a, b = self.ends[u], self.begins[v]
        turn = abs(math.remainder(b[2] - a[2], 2.0 * math.pi))
        return (math.dist(a[:2], b[:2]) + turn * self.site.rules.radius_m) / self.site.rules.turn_speed_mps

    def _list_options(self, u: int, v: int) -> list[Move]:
        """Every kind of move between two nodes, the cheapest first."""
        a, b = self.ends[u], self.begins[v]
        options = self.finder.list_moves(a, b)
        if self.gate not in (u, v):
            p, q = self.lines[u // 2], self.lines[v // 2]
            options += list_work_moves(self.site, self.finder, p, u % 2, q, v % 2)
            if min((one.cost_s for one in options), default=math.inf) > self.guess_plain_s(u, v) + DEAR_S:
                options += self._list_cut_moves(u, v)
        return sorted(options, key=attrgetter("cost_s"))

    def _list_cut_moves(self, u: int, v: int) -> list[Move]:
        """Moves between lines whose ends are cut back for them; what is left unworked is charged."""
        cuts = [(cut, self._cut_ends(u, v, *cut)) for cut in CUTS_M]
        return [
            self._charge_cuts(move, *cut)
            for cut, ends in cuts
            if ends is not None
            for move in self.finder.list_moves(*ends, most=2)
        ]

    def _search(self, u: int, v: int) -> Move | None:
        found = self.finder.search(self.ends[u], self.begins[v])
        radius_m = self.site.rules.radius_m
        ends = None if found is not None or self.gate in (u, v) else self._cut_ends(u, v, radius_m, radius_m)
        if ends is None:
            return found
        found = self.finder.search(*ends)
        return None if found is None else self._charge_cuts(found, radius_m, radius_m)

    def _cut_ends(self, u: int, v: int, leave_m: float, join_m: float) -> tuple[Pose, Pose] | None:
        """Where the line of u ends and that of v begins once cut back; None where too little would remain."""
        line, following = self.lines[u // 2], self.lines[v // 2]
        lengths_m = line.measure_path_m(u % 2), following.measure_path_m(v % 2)
        if any(
            cut and cut > MOST_CUT_SHARE * length_m - 1.0
            for cut, length_m in zip((leave_m, join_m), lengths_m, strict=True)
        ):
            return None
        return line.get_pose(u % 2, lengths_m[0] - leave_m), following.get_pose(v % 2, join_m)

    def _charge_cuts(self, move: Move, leave_m: float, join_m: float) -> Move:
        cut_s = (leave_m + join_m) / self.site.rules.work_speed_mps
        drive_s, charge_s = move.drive_s - cut_s, move.charge_s + MISSED_FACTOR * cut_s
        return replace(move, drive_s=drive_s, charge_s=charge_s, leave_m=leave_m, join_m=join_m)

    def _drive(self, u: int, v: int, move: Move) -> Move | None:
        legs = build_path_legs(self.site, move.path, LegTask(TURN), is_work=move.is_work)
        before = None if u == self.gate else self.build_work_leg(u, move.leave_m, last_m=SETTLE_M)
        after = None if v == self.gate else self.build_work_leg(v, 0.0, move.join_m, first_m=SETTLE_M + BRAKE_M)
        driven = [leg for leg in (before, *legs, after) if leg is not None]
        run = self.site.drive(Plan((Mission(tuple(driven)),)))
        if run.outcome != DONE:
            return None
        poses, numbers = run.get_poses(0), run.get_leg_numbers(0)
        if measure_proof_rooms(self.site, poses).min() < -ROOM_TOLERANCE_M:
            return None
        if after is None:
            return move
        row = int(np.argmax(numbers == len(driven) - 1))
        off_m = self._measure_off_m(poses[row], self.lines[v // 2].get_pose(v % 2, move.join_m))
        if off_m > MOST_OFF_SHARE * self.site.width_m:
            return None
        speed = self.site.rules.work_speed_mps
        missed_s = MISSED_FACTOR * off_m * OFF_LENGTH_M * self.site.work_s_per_m2
        begun_s = 0.0 if before is None else self._measure_start_s(before.length_m)
        settled_m = min(SETTLE_M, 0.5 * after.length_m)
        end_s = _find_time_s(run.time_s[row:], poses[row:], settled_m) - settled_m / speed
        drive_s = end_s - begun_s - (move.leave_m + move.join_m) / speed
        return replace(move, drive_s=drive_s, charge_s=move.charge_s + missed_s)

    def find_lost_legs(self, legs: Sequence[Leg]) -> list[int]:
        """The legs at which a drive of them all leaves the ground, or where it stops; each stretch once."""
        run = self.site.drive(Plan((Mission(tuple(legs)),)))
        numbers = run.get_leg_numbers(0)
        is_off = measure_proof_rooms(self.site, run.get_poses(0)) < -MISSION_TOLERANCE_M
        is_off[-1] |= run.outcome != DONE
        lost: list[int] = np.unique(numbers[np.flatnonzero(np.diff(is_off, prepend=False) & is_off)]).tolist()
        return lost

    def _measure_start_s(self, distance_m: float) -> float:
        """Seconds from rest to so far along a straight line (at most SETTLE_M)."""
        return _find_time_s(*self._straight, distance_m)

    @property
    def rest_s(self) -> float:
        """Seconds that a straight line takes longer from rest to rest than at working speed."""
        time_s, _ = self._straight
        return float(time_s[-1]) - STRAIGHT_M / self.site.rules.work_speed_mps

    @cached_property
    def _straight(self) -> tuple[Floats, Floats]:
        """Times and poses of a drive along a straight line from rest to rest, on level ground: it lies nowhere."""
        leg = Leg(np.array([[0.0, 0.0], [STRAIGHT_M, 0.0]]), self.site.rules.work_speed_mps, 1, True)
        run = self.site.drive_level(Plan((Mission((leg,)),)))
        return run.time_s, run.get_poses(0)

    def _measure_off_m(self, pose: Floats, goal: Pose) -> float:
        """How far beside the line from a goal pose on the implement is, with the centre of mass at a pose (3,)."""
        x, y, heading = pose.tolist()
        dx, dy = x - self.site.bar_m * math.cos(heading) - goal[0], y - self.site.bar_m * math.sin(heading) - goal[1]
        off_m: float = abs(dy * math.cos(goal[2]) - dx * math.sin(goal[2]))
        return off_m

    def build_work_leg(
        self, node: int, leave_m: float, join_m: float = 0.0, *, first_m: float = math.inf, last_m: float = math.inf
    ) -> Leg:
        """The leg that works a node, without what moves cut from its ends; only its first or last metres."""
        line, way = self.lines[node // 2], node % 2
        end_m = line.measure_path_m(way) - leave_m
        points = cut_line(line.paths[way], max(join_m, end_m - last_m), min(end_m, join_m + first_m))
        x, y = points[len(points) // 2].tolist()
        ground = self.site.layout.field.find_ground_at(x, y)
        return Leg(points, self.site.rules.work_speed_mps, 1, True, ground, line.task)


def _find_time_s(time_s: Floats, poses: Floats, distance_m: float) -> float:
    """When a drive has come so far from its first pose."""
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    return float(np.interp(distance_m, driven_m, time_s))


def build_path_legs(site: Site, path: DrivePath, task: LegTask, *, is_work: bool = False) -> list[Leg]:
    """A path as legs, one per gear; with the implement down where it is work."""
    legs = []
    for gear, sampled in path.sample(PATH_STEP_M):
        steps_m = np.hypot(*np.diff(sampled, axis=0).T)
        points = sampled[np.concatenate([[True], steps_m > MIN_STEP_M])]
        if float(steps_m.sum()) <= MIN_LEG_M:
            continue
        x, y = points[len(points) // 2].tolist()
        speed_mps = site.rules.work_speed_mps if is_work else site.rules.get_path_speed_mps(gear)
        ground = site.layout.field.find_ground_at(x, y)
        legs.append(Leg(points, speed_mps, gear, is_work, ground, task))
    return legs
