"""The moves of a site: which there are between any two lines, and how each is driven; asked once, then remembered.

A node is a line in one direction: 2 i for the first of line i, 2 i + 1 for the other, so that `node ^ 1` is the same
line driven the other way. The entrance is a node too, the last. Nothing here depends on what was asked before, so that
all programmes of a site may share it.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np
import shapely

from fields.arrays import Flags, Floats, Integers, cut_line
from strategies.lines.lay_lines import measure_proof_rooms, unite_strips
from strategies.lines.work_line import WorkLine
from strategies.moves.drives import (
    ROOM_TOLERANCE_M,
    MoveDrives,
    Passage,
    build_work_leg,
    measure_settling,
)
from strategies.moves.move import Move
from strategies.moves.move_finder import MoveFinder
from strategies.path_planning.paths import Pose
from strategies.programmes.move_estimates import CUTS_M, MOST_CUT_SHARE, MoveEstimates
from strategies.programmes.work_moves import list_work_moves
from strategies.site.site import LEFT_FACTOR, MISSED_FACTOR, SETTLE_M, SETTLED_M, Site
from vehicle.missions.plan import ENTER, HEADLAND_PASS, LEAVE, Leg, Mission, Plan
from vehicle.missions.run import DONE


@dataclass(eq=False)
class SiteMoves:
    """All that is known of the moves between the lines of a site.

    Attributes:
        starts: nodes of the lines that tractors standing on the field begin with, in the order of the tractors.
        used: what each of these has used of its load.
        orders: the nodes that each of these was to work before, its start first; a search begins with them.
        folded: those of the starts at which a tractor stands with its implement folded.
        ends, begins: poses of the guided point where nodes end and begin; the entrance comes last.
        lost_in_runs: by nodes and the moves between them, the pairs at which a drive of them all left the ground.
        clashes: by who says so, the nodes (2, n, n) of which no two tractors may begin or end with both.
        legs: by nodes, moves and what is cut off, the legs of a tour.
        options, cut_moves, folded_moves, searched_moves: the moves found between nodes.
        stop_moves: those driven from so far along a node to a place to be served, or on from there; None for none.
        driven: by the moves found, what a drive made of them; None where it refused them.
    """

    site: Site
    lines: Sequence[WorkLine]
    starts: tuple[int, ...] = ()
    used: tuple[float, ...] = ()
    orders: tuple[tuple[int, ...], ...] = ()
    folded: frozenset[int] = frozenset()
    finder: MoveFinder = field(init=False)
    gate_finder: MoveFinder = field(init=False)
    estimates: MoveEstimates = field(init=False)
    drives: MoveDrives = field(init=False)
    lost_in_runs: dict[tuple[Hashable, ...], tuple[tuple[int, int], ...]] = field(default_factory=dict)
    clashes: dict[Hashable, Flags] = field(default_factory=dict)
    legs: dict[Hashable, tuple[Leg, ...]] = field(default_factory=dict)
    options: dict[tuple[int, int], tuple[Move, ...]] = field(default_factory=dict)
    cut_moves: dict[tuple[int, int, float], tuple[Move, ...]] = field(default_factory=dict)
    folded_moves: dict[tuple[int, int], tuple[Move, ...]] = field(default_factory=dict)
    searched_moves: dict[tuple[int, int], Move | None] = field(default_factory=dict)
    stop_moves: dict[tuple[int, float, Pose, bool], Move | None] = field(default_factory=dict)
    driven: dict[Move, Move | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        settling = measure_settling(self.site)
        self.finder, self.gate_finder = (MoveFinder(site, settling) for site in (self.site, self.site.at_gate))
        self.drives = MoveDrives(self.site, self.site.is_alike)
        nodes, lane = range(2 * len(self.lines)), self.site.lane
        self.ends: list[Pose] = [self.lines[k // 2].get_end(k % 2) for k in nodes]
        self.begins: list[Pose] = [self.lines[k // 2].get_begin(k % 2) for k in nodes]
        self.ends.append((0.0, 0.0, 0.0) if lane is None else lane.in_pose)
        self.begins.append((0.0, 0.0, 0.0) if lane is None else lane.out_pose)
        self.estimates = MoveEstimates(self.site, self.lines, self.finder, self.ends, self.begins, self.starts)

    @cached_property
    def edge_ways_s(self) -> tuple[Floats, Floats]:
        """Without an entrance, the charge (2 n,) for coming in over the nearest edge to each node, and for leaving so.

        Only ground inside the headland is charged: lines that begin and end on the headland are alike. Of a crop that
        stands the strips that wheels crush on the way in are charged like ground that is left.
        """
        site, field = self.site, self.site.layout.field
        outline, spared_m = field.whole_boundary.exterior, site.layout.headland_m + site.rules.tool_m
        s_per_m = 1.0 / site.rules.turn_speed_mps + site.wheels_s_per_m
        ways = [shapely.points(np.array(poses[:-1]).reshape(-1, 3)[:, :2]) for poses in (self.begins, self.ends)]
        begins, ends = (s_per_m * np.maximum(0.0, shapely.distance(places, outline) - spared_m) for places in ways)
        crushed_s = LEFT_FACTOR * site.rules.body_width_m / site.rules.work_speed_mps
        return begins + crushed_s * np.repeat(self._count_standing_passes(), 2), ends

    def _count_standing_passes(self) -> Integers:
        """How many passes of a crop that stands lie between the edge and each line (n,) before any work."""
        passes = [line.task.number or 0 if line.group[0] == HEADLAND_PASS else 0 for line in self.lines]
        if self.site.standing is None or not any(passes):
            return np.zeros(len(self.lines), np.int64)
        numbers, inside = np.array(passes), 1 + max(passes)
        return np.where(numbers > 0, numbers, inside) - min(number for number in passes if number)

    @cached_property
    def covered_ground(self) -> shapely.Geometry:
        """The ground that the lines cover, each driven in its first direction."""
        return unite_strips(self.site, self.lines)

    @property
    def tables(self) -> dict[str, dict[Any, Any]]:
        """All that is worth telling others of moves, by names; moves come before what is known of them."""
        return {
            "estimates": self.estimates.known,
            "options": self.options,
            "cut": self.cut_moves,
            "folded": self.folded_moves,
            "searched": self.searched_moves,
            "stops": self.stop_moves,
            "driven": self.driven,
            "lost": self.lost_in_runs,
        }

    @property
    def gate(self) -> int:
        """The node of the entrance."""
        return 2 * len(self.lines)

    def get_used(self, node: int) -> float:
        """What a tractor that begins with a node has used of its load."""
        return self.used[self.starts.index(node)] if node in self.starts else 0.0

    def list_options(self, u: int, v: int) -> tuple[Move, ...]:
        """The moves in closed form between two nodes, the cheapest first; folded where the implement must be."""
        if self._must_fold(u, v):
            return self.list_folded_moves(u, v)
        if (u, v) not in self.options:
            self.options[u, v] = tuple(self._list_options(u, v))
        return self.options[u, v]

    def list_cut_moves(self, u: int, v: int, beyond_m: float = 0.0) -> tuple[Move, ...]:
        """Moves with the ends of lines cut back for them, the cheapest first; what is left unworked is charged.

        All by as much together, more than `beyond_m` and no more than some move needs.
        """
        if self.gate in (u, v) or u in self.folded or math.isinf(beyond_m):
            return ()
        key = u, v, beyond_m
        if key not in self.cut_moves:
            self.cut_moves[key] = tuple(self._list_cut_moves(*key))
        return self.cut_moves[key]

    def list_folded_moves(self, u: int, v: int) -> tuple[Move, ...]:
        """Moves with the implement folded, the cheapest first: it is folded already where a tractor comes in or stands
        so, and stays so where it leaves."""
        if (u, v) not in self.folded_moves:
            finder, begins = self._get_finder(u, v), u == self.gate or u in self.folded
            spared_s = (begins + (v == self.gate)) * self.site.get_fold_s(True)
            found = (
                replace(one, drive_s=one.drive_s - spared_s, begins_folded=begins)
                for one in finder.list_folded_moves(self.ends[u], self.begins[v], self.estimates.count_passes(u, v))
            )
            self.folded_moves[u, v] = tuple(sorted(found, key=attrgetter("cost_s")))
        return self.folded_moves[u, v]

    def _get_finder(self, u: int, v: int) -> MoveFinder:
        return self.gate_finder if self.gate in (u, v) else self.finder

    def _must_fold(self, u: int, v: int) -> bool:
        """Whether the implement is folded there in any case."""
        return u in self.folded or (self.gate in (u, v) and self.site.folds_at_gate)

    def search(self, u: int, v: int) -> Move | None:
        """A move by search, if need be between lines cut back by the turning radius."""
        if (u, v) not in self.searched_moves:
            self.searched_moves[u, v] = self._search(u, v)
        return self.searched_moves[u, v]

    def drive(self, wanted: Sequence[tuple[int, int, Move]]) -> None:
        """Drive moves between two nodes each, all at once; `driven` has what comes of them."""
        todo = [(self._build_passage(*one), one[2]) for one in wanted if one[2] not in self.driven]
        proven = self.drives.prove([passage for passage, _ in todo])
        self.driven.update((move, one) for (_, move), one in zip(todo, proven, strict=True))

    def has_way(self, u: int, v: int) -> bool:
        """Whether more than a pocket of ground is reached from where u ends, and leads to where v begins."""
        finder = self._get_finder(u, v)
        return finder.has_way_on(self.ends[u], backwards=False) and finder.has_way_on(self.begins[v], backwards=True)

    def _list_options(self, u: int, v: int) -> list[Move]:
        """Every kind of move between the ends of two nodes, the cheapest first."""
        a, b = self.ends[u], self.begins[v]
        options = self._get_finder(u, v).list_moves(a, b, passes=self.estimates.count_passes(u, v))
        if self.gate not in (u, v):
            p, q = self.lines[u // 2], self.lines[v // 2]
            options += list_work_moves(self.site, self.finder, p, u % 2, q, v % 2)
        return sorted(options, key=attrgetter("cost_s"))

    def _list_cut_moves(self, u: int, v: int, beyond_m: float) -> list[Move]:
        found, passes = list[Move](), self.estimates.count_passes(u, v)
        for _, cuts in groupby((cut for cut in CUTS_M if sum(cut) > beyond_m), key=sum):
            ends = [(cut, self._cut_ends(u, v, *cut)) for cut in cuts]
            found += [
                self.charge_cuts(move, *cut)
                for cut, poses in ends
                if poses is not None
                for move in self.finder.list_moves(*poses, most=2, passes=passes)
            ]
            if found:
                break
        return sorted(found, key=attrgetter("cost_s"))

    def _search(self, u: int, v: int) -> Move | None:
        if self._must_fold(u, v):
            return None
        passes = self.estimates.count_passes(u, v)
        found = self._get_finder(u, v).search(self.ends[u], self.begins[v], passes)
        radius_m = self.site.rules.radius_m
        ends = None if found is not None or self.gate in (u, v) else self._cut_ends(u, v, radius_m, radius_m)
        if ends is None:
            return found
        found = self.finder.search(*ends, passes)
        return None if found is None else self.charge_cuts(found, radius_m, radius_m)

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

    def charge_cuts(self, move: Move, leave_m: float, join_m: float) -> Move:
        """A move for which the ends of its lines are cut back, with what is left unworked charged."""
        cut_s = (leave_m + join_m) / self.site.rules.work_speed_mps
        drive_s, charge_s = move.drive_s - cut_s, move.charge_s + MISSED_FACTOR * cut_s
        return replace(move, drive_s=drive_s, charge_s=charge_s, leave_m=leave_m, join_m=join_m)

    def _build_passage(self, u: int, v: int, move: Move) -> Passage:
        stands = u == self.gate or self.lines[u // 2].is_place
        before = None if stands else self.cut_before(u, move.leave_m)
        after = None if v == self.gate else self.cut_after(v, move.join_m)
        return Passage(move, before, after, at_gate=self.gate in (u, v))

    def cut_before(self, node: int, leave_m: float) -> Floats:
        """The stretch (n, 2) of a node that is driven with the move which leaves it so far before its end."""
        line, way = self.lines[node // 2], node % 2
        end_m = line.measure_path_m(way) - leave_m
        return cut_line(line.paths[way], max(0.0, end_m - SETTLE_M), end_m)

    def cut_after(self, node: int, join_m: float) -> Floats:
        """The stretch (n, 2) of a node that is driven with the move which joins it so far after its begin."""
        line, way = self.lines[node // 2], node % 2
        return cut_line(line.paths[way], join_m, min(line.measure_path_m(way), join_m + SETTLED_M))

    def find_lost_legs(self, legs: Sequence[Leg]) -> list[int]:
        """The legs at which a drive of them all leaves the ground, or where it stops; each stretch once."""
        run = self.site.drive(Plan((Mission(tuple(legs)),)))
        numbers = run.get_leg_numbers(0)
        poses, is_folded = run.get_poses(0), run.find_folded_rows(0)
        at_gate = np.array([leg.task.kind in (ENTER, LEAVE) for leg in legs])[numbers]
        rooms = measure_proof_rooms(self.site, poses, is_folded)
        rooms[at_gate] = measure_proof_rooms(self.site.at_gate, poses[at_gate], is_folded[at_gate])
        is_off = rooms < -ROOM_TOLERANCE_M
        is_off[-1] |= run.outcome != DONE
        lost: list[int] = np.unique(numbers[np.flatnonzero(np.diff(is_off, prepend=False) & is_off)]).tolist()
        return lost

    def build_work_leg(self, node: int, leave_m: float, join_m: float = 0.0) -> Leg:
        """The leg that works a node, without what moves cut from its ends."""
        line, way = self.lines[node // 2], node % 2
        points = cut_line(line.paths[way], join_m, line.measure_path_m(way) - leave_m)
        return build_work_leg(self.site, points, line.task)
