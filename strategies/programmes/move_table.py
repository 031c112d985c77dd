"""The moves between the lines of a site: found when asked for, driven when used, kept for all programmes.

A node is a line in one direction: 2 i for the first of line i, 2 i + 1 for the other, so that `node ^ 1` is the same
line driven the other way. The entrance is a node too, the last.
"""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from strategies.lines.lay_lines import measure_proof_rooms
from strategies.lines.work_line import WorkLine, cut_line
from strategies.moves.move import Move, MoveFinder
from strategies.path_planning.paths import DrivePath, Pose
from strategies.program.legs import MIN_LEG_M, MIN_STEP_M, PATH_STEP_M
from strategies.programmes.order_tours import POSSIBLE_S
from strategies.programmes.work_moves import MISSED_FACTOR, list_work_moves
from strategies.site.site import Site
from vehicle.missions.plan import TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE

Floats = npt.NDArray[np.float64]

NO_MOVE_S = POSSIBLE_S  # cost of a move that does not exist
NEAR_LINES = 14  # lines whose moves from an end are found at once; those farther off when a programme uses them
GUESS_S = 20.0  # of a move not yet found, beyond the way at turning speed
DETOUR_FACTOR, DETOUR_S = 2.0, 90.0  # guess of a move that only a search may find, of the way at turning speed
MOST_VAIN = 2  # searches from or to a place that found nothing, before it is given up
DEAR_S = 12.0  # a move that takes so much longer than its way is also sought with the ends of lines cut back
CUTS_M = ((4.0, 0.0), (0.0, 4.0), (4.0, 4.0), (8.0, 8.0))  # from the line left, and from the line begun
MOST_CUT_SHARE = 0.4
SETTLE_M = 20.0  # of the lines before and after a move that are driven with it
MOST_OFF_SHARE = 0.25  # of the width: a drive that begins a line farther beside it has lost it
OFF_LENGTH_M = 6.0  # driven until a tractor is back on a line that it began beside
ROOM_TOLERANCE_M = 0.03


@dataclass(eq=False)
class MoveTable:
    """Costs of all moves between the lines of a site, as far as they are known.

    Attributes:
        cost_s: (n + 1, n + 1) seconds from the end of a node to the begin of another, with charges; guesses where
            not yet found, NO_MOVE_S where there is none.
    """

    site: Site
    lines: Sequence[WorkLine]
    finder: MoveFinder = field(init=False)
    cost_s: Floats = field(init=False)
    _options: dict[tuple[int, int], list[Move]] = field(default_factory=dict)
    _searched: set[tuple[int, int]] = field(default_factory=set)
    _proven: set[tuple[int, int]] = field(default_factory=set)
    _searched_in_vain: dict[tuple[str, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.finder = MoveFinder(self.site)
        nodes = range(2 * len(self.lines))
        lane = self.site.lane
        self.ends: list[Pose] = [self.lines[k // 2].get_end(k % 2) for k in nodes]
        self.begins: list[Pose] = [self.lines[k // 2].get_begin(k % 2) for k in nodes]
        self.ends.append((0.0, 0.0, 0.0) if lane is None else lane.inner_pose)
        self.begins.append((0.0, 0.0, 0.0) if lane is None else lane.build_path_out().start)
        self.cost_s = self._guess_costs()
        for u in nodes:
            for v in np.argsort(self.cost_s[u, :-1], kind="stable")[: NEAR_LINES + 2].tolist():
                if self.cost_s[u, v] < NO_MOVE_S:
                    self.find(u, v, search=False)

    @property
    def gate(self) -> int:
        """The node of the entrance."""
        return 2 * len(self.lines)

    def _guess_costs(self) -> Floats:
        ends, begins, rules = np.array(self.ends), np.array(self.begins), self.site.rules
        gaps_m = np.hypot(*(ends[:, None, :2] - begins[None, :, :2]).transpose(2, 0, 1))
        turns = np.abs((begins[None, :, 2] - ends[:, None, 2] + math.pi) % (2.0 * math.pi) - math.pi)
        costs: Floats = (gaps_m + turns * rules.radius_m) / rules.turn_speed_mps + GUESS_S
        for number, line in enumerate(self.lines):
            own = slice(2 * number, 2 * number + 2)
            costs[own, own] = NO_MOVE_S
            if not line.both_ways:
                costs[2 * number + 1], costs[:, 2 * number + 1] = NO_MOVE_S, NO_MOVE_S
        costs[-1, -1] = NO_MOVE_S
        return costs

    def get_move(self, u: int, v: int) -> Move | None:
        """The best move between two nodes that no drive has refused; None if none is known."""
        options = self._options.get((u, v))
        return options[0] if options else None

    def is_proven(self, u: int, v: int) -> bool:
        """Whether the move between two nodes was driven well."""
        return (u, v) in self._proven

    def get_proven_mask(self) -> npt.NDArray[np.bool_]:
        """For all pairs of nodes (n + 1, n + 1) whether their move was driven well."""
        mask = np.zeros(self.cost_s.shape, bool)
        mask[tuple(np.array(list(self._proven), np.int64).reshape(-1, 2).T)] = True
        return mask

    def find(self, u: int, v: int, *, search: bool) -> bool:
        """Find the moves between two nodes, by a search where nothing else helps; whether there is one."""
        if (u, v) not in self._options:
            self._options[u, v] = self._list_options(u, v)
        if not self._options[u, v] and search and self._may_search(u, v):
            self._searched.add((u, v))
            found = self._search(u, v)
            self._options[u, v] = [] if found is None else [found]
            if found is None:
                for key in (("end", u), ("begin", v)):
                    self._searched_in_vain[key] = self._searched_in_vain.get(key, 0) + 1
        self._update_cost(u, v)
        return bool(self._options[u, v])

    def _update_cost(self, u: int, v: int) -> None:
        """The cost of the best move between two nodes that is left; dear where only a search may find one."""
        options = self._options[u, v]
        if options:
            self.cost_s[u, v] = max(0.0, options[0].cost_s)
        elif self._may_search(u, v):
            self.cost_s[u, v] = DETOUR_FACTOR * self._guess_plain_s(self.ends[u], self.begins[v]) + DETOUR_S
        else:
            self.cost_s[u, v] = NO_MOVE_S

    def _may_search(self, u: int, v: int) -> bool:
        """Whether a search may still find a move: not where others to or from the same place were in vain."""
        vain, finder = self._searched_in_vain, self.finder
        if (u, v) in self._searched or max(vain.get(("end", u), 0), vain.get(("begin", v), 0)) >= MOST_VAIN:
            return False
        return finder.has_way_on(self.ends[u], backwards=False) and finder.has_way_on(self.begins[v], backwards=True)

    def _list_options(self, u: int, v: int) -> list[Move]:
        """Every kind of move between two nodes, the cheapest first."""
        a, b = self.ends[u], self.begins[v]
        options = self.finder.list_moves(a, b)
        if self.gate not in (u, v):
            p, q = self.lines[u // 2], self.lines[v // 2]
            options += list_work_moves(self.site, self.finder, p, u % 2, q, v % 2)
            plain_s = self._guess_plain_s(a, b)
            if min((one.cost_s for one in options), default=math.inf) > plain_s + DEAR_S:
                options += self._list_cut_moves(u, v)
        return sorted(options, key=attrgetter("cost_s"))

    def _guess_plain_s(self, a: Pose, b: Pose) -> float:
        turn = abs(math.remainder(b[2] - a[2], 2.0 * math.pi))
        return (math.dist(a[:2], b[:2]) + turn * self.site.rules.radius_m) / self.site.rules.turn_speed_mps

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
        """A move by search, if need be between lines cut back by the turning radius."""
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

    def prove(self, u: int, v: int) -> bool:
        """Drive the moves between two nodes, the cheapest first, until the cheapest is one that was driven well.

        A move that a drive refuses does not exist; of others the time is as driven, and beginning the next line beside
        it is charged.
        """
        options, driven = self._options[u, v], set[int]()
        while options and id(options[0]) not in driven:
            proven = self._drive(u, v, options.pop(0))
            if proven is not None:
                driven.add(id(proven))
                insort(options, proven, key=attrgetter("cost_s"))
        if options:
            self._proven.add((u, v))
        self._update_cost(u, v)
        return bool(options)

    def _drive(self, u: int, v: int, move: Move) -> Move | None:
        """A move with its time and deviation as driven; None if it is not, leaves the ground or loses its line."""
        legs = build_path_legs(self.site, move.path, LegTask(TURN), is_work=move.is_work)
        before = None if u == self.gate else self.build_work_leg(u, move.leave_m, last_m=SETTLE_M)
        after = None if v == self.gate else self.build_work_leg(v, 0.0, move.join_m, first_m=SETTLE_M)
        driven = [leg for leg in (before, *legs, after) if leg is not None]
        run = self.site.drive(Plan((Mission(tuple(driven)),)))
        if run.outcome != DONE:
            return None
        poses, numbers = run.get_poses(0), run.get_leg_numbers(0)
        if measure_proof_rooms(self.site, poses).min() < -ROOM_TOLERANCE_M:
            return None
        if after is None:
            return move
        row, first = int(np.argmax(numbers == len(driven) - 1)), 0 if before is None else int(np.argmax(numbers > 0))
        off_m = self._measure_off_m(poses[row], self.lines[v // 2].get_pose(v % 2, move.join_m))
        if off_m > MOST_OFF_SHARE * self.site.width_m:
            return None
        cut_s = (move.leave_m + move.join_m) / self.site.rules.work_speed_mps
        missed_s = MISSED_FACTOR * off_m * OFF_LENGTH_M * self.site.work_s_per_m2
        drive_s = float(run.time_s[row] - run.time_s[first]) - cut_s
        return replace(move, drive_s=drive_s, charge_s=move.charge_s + missed_s)

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
