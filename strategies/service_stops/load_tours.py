"""Loads as tours: what a tractor works from one stop at a place to the next, put in order by the search for programmes.

Every load is a tour of its own: the first begins where the tractor does, the last ends where it leaves, all others
begin and end at the place, and none takes more than a load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from strategies.programmes.driven_search import Tours, search_driven_tours
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import OrderProblem
from strategies.programmes.order_tours import LOAD_TOLERANCE, NO_MOVE_S
from strategies.rules.supply import Supply
from strategies.service_stops.stop_moves import StopMoves
from strategies.service_stops.tour_parts import TourPart, cut_to_loads
from strategies.service_stops.tour_stops import TourGaps

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LINE_VALUE_S = 1e4  # more than any way to a line takes: none is left


@dataclass(frozen=True, eq=False)
class LoadTours:
    """The lines of one tractor in loads.

    Attributes:
        stages: (n,) which lines come first.
        need: (n,) the share of a load that every line takes.
        loads: the nodes of every load in order; one without any may be filled.
    """

    table: MoveTable
    supply: Supply
    moves: StopMoves
    stages: Ints
    need: Floats
    loads: Tours

    @cached_property
    def start(self) -> int | None:
        """The node with which the tractor begins if it stands on the field."""
        return self.loads[0][0] if self.loads[0][0] in self.table.starts else None

    @cached_property
    def allowed(self) -> npt.NDArray[np.bool_]:
        """Which lines (loads, n) a load may have: those in stages from its first one up to the first of the next."""
        is_own = np.isin(np.arange(len(self.stages)), [node // 2 for load in self.loads for node in load])
        rows, highest = list[npt.NDArray[np.bool_]](), self.stages.max()
        for load in reversed(self.loads):
            stages = self.stages[[node // 2 for node in load]] if load else np.array([highest])
            rows.append(is_own & (self.stages >= stages.min()) & (self.stages <= max(highest, stages.max())))
            highest = stages.min()
        allowed = np.array(rows[::-1])
        if self.start is not None:
            allowed[1:, self.start // 2] = False
        return allowed

    @cached_property
    def trips_s(self) -> tuple[Floats, Floats]:
        """Seconds (2 n) from the place to every node, and from every node to the place with the time to be served."""
        ends_m = [line.measure_path_m(way) for line in self.table.lines for way in (0, 1)]
        trips = [self.moves.list_trips((node, end_m), (node, 0.0)) for node, end_m in enumerate(ends_m)]
        estimates_s = [[[self.moves.estimate_s(trip) for trip in both] for both in of_node] for of_node in trips]
        off_s, on_s = np.array(estimates_s).min(axis=1).T
        return on_s, off_s + self.supply.estimate_stop_s(float(self.need.sum()) * self.supply.capacity)

    def pose_problem(self, costs: Floats) -> OrderProblem:
        """The search for the loads with these costs (n + 1, n + 1) of moves."""
        table = self.table
        begin_s, end_s = (np.repeat(trips_s[None], len(self.loads), axis=0) for trips_s in self.trips_s)
        has_lane = table.site.lane is not None
        begin_s[0], end_s[-1] = (np.minimum(ends, NO_MOVE_S) * has_lane for ends in (costs[-1, :-1], costs[:-1, -1]))
        if self.start is not None:
            begin_s[0] = np.where(np.arange(len(begin_s[0])) == self.start, 0.0, np.inf)
        is_barred = np.array([way == 1 and not line.both_ways for line in table.lines for way in (0, 1)], bool)
        begin_s[:, is_barred], end_s[:, is_barred] = np.inf, np.inf
        return OrderProblem(
            move_s=costs[:-1, :-1],
            work_s=np.array([line.length_m for line in table.lines]) / table.site.rules.work_speed_mps,
            value_s=np.where(self.allowed.any(axis=0), LINE_VALUE_S, 0.0),
            begin_s=begin_s,
            end_s=end_s,
            allowed=self.allowed,
            stage=self.stages,
            need=self.need,
            sum_share=1.0,
        )

    def list_moves(self, loads: Tours) -> list[tuple[int, int]]:
        """The moves within loads, into the field and out of it."""
        gate, nodes = self.table.gate, [node for load in loads for node in load]
        ends = [(gate, node) for node in nodes[:1] if node != self.start]
        ends += [(node, gate) for node in nodes[-1:]]
        return [pair for load in loads for pair in pairwise(load)] + ([] if self.table.site.lane is None else ends)

    def search(self) -> list[int]:
        """The nodes of all loads in the order that was found."""
        found = search_driven_tours(self.table, self.pose_problem, self.list_moves, lambda _: True, start=self.loads)
        return [node for load in found for node in load]


def order_for_loads(
    table: MoveTable, supply: Supply, moves: StopMoves | None, stages: Sequence[int] | None, tour: Sequence[int]
) -> tuple[TourPart, ...]:
    """The parts of a tour in the order of least time with its stops; as given where that is no worse.

    `stages` (n,) say which lines come first, all at any time by default. The search begins with the tour in as few
    loads as can be, and in those that cost least. What it finds is cut to loads where that costs least, and searched
    again.
    """
    gaps = TourGaps(table, supply, cut_to_loads(table, supply, tour), moves, is_rough=True)
    if moves is None or gaps.choose_gaps() == ():
        return tuple(gaps.tour)
    best, best_s, need = gaps, _estimate_cost_s(gaps), _measure_needs(gaps)
    starts = [_cut_at_stops(gaps), _fill_loads(tour, need)]
    while starts:
        *loads, last = starts.pop()
        if not loads:
            continue
        found = LoadTours(table, supply, moves, _rank_lines(table, stages), need, [*loads, [], last]).search()
        gaps = TourGaps(table, supply, cut_to_loads(table, supply, found), moves, is_rough=True)
        cost_s = _estimate_cost_s(gaps) if len(found) == len(tour) else np.inf
        if cost_s < best_s:
            best, best_s = gaps, cost_s
            starts.append(_cut_at_stops(gaps))
    return tuple(best.tour)


def _rank_lines(table: MoveTable, stages: Sequence[int] | None) -> Ints:
    """The stage of every line (n,); what a tractor stands on is of the first."""
    stage = np.zeros(len(table.lines), np.int64) if stages is None else np.array(stages, np.int64)
    stage[np.array(table.starts, int) // 2] = stage.min(initial=0)
    return stage


def _measure_needs(gaps: TourGaps) -> Floats:
    """The share of a load (n,) that every line of a tour takes with the move to it, and where its tractor stands."""
    need = np.zeros(len(gaps.table.lines))
    for part in gaps.tour:
        need[part.node // 2] += gaps.measure_part_need(part)
    need[need > 0.0] += gaps.mean_move_need
    return np.minimum(need / gaps.supply.capacity, 1.0)


def _fill_loads(tour: Sequence[int], need: Floats) -> Tours:
    """The nodes of every load of a tour, each of as many lines as it is enough for."""
    loads, left = [list[int]()], 1.0
    for node in tour:
        left -= float(need[node // 2])
        if left < -LOAD_TOLERANCE:
            left = 1.0 - float(need[node // 2])
            loads.append([])
        loads[-1].append(node)
    return loads


def _cut_at_stops(gaps: TourGaps) -> Tours:
    """The nodes of every load of a tour as its stops cost least; a line that is left half way is its first load's."""
    stops, known, loads = set(gaps.choose_gaps() or ()), set[int](), [list[int]()]
    for gap, part in enumerate(gaps.parts):
        if gap in stops and loads[-1]:
            loads.append([])
        if part.node not in known:
            known.add(part.node)
            loads[-1].append(part.node)
    return [load for load in loads if load]


def _estimate_cost_s(gaps: TourGaps) -> float:
    """Seconds of the moves and stops of a tour with all charges, with ways to places as far as they are known."""
    chosen = gaps.choose_gaps() if gaps.has_ends else None
    return np.inf if chosen is None else round(gaps.measure_cost_s(chosen), 3)
