"""Loads as tours: what a tractor works from one stop at a place to the next, put in order by the search for programmes.

Every load is a tour of its own: the first begins where the tractor does, the last ends where it leaves, all others
begin and end at the place, and none takes more than a load. The lines of the search are the parts of the tour.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers
from fields.geometry.arithmetic import ROUNDING
from strategies.programmes.driven_search import Tours, search_driven_tours
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import OrderProblem
from strategies.programmes.order_tours import ANY_WAY_S, NO_MOVE_S
from strategies.rules.supply import Supply
from strategies.service_stops.stop_moves import StopMoves
from strategies.service_stops.tour_parts import TourPart, cut_at_wait_points, cut_to_loads
from strategies.service_stops.tour_stops import TourGaps


@dataclass(frozen=True, eq=False)
class LoadTours:
    """The parts of the tour of one tractor in loads; node 2 i of the search is part i along its line, 2 i + 1 against.

    Attributes:
        gaps: the tour.
        moves: lead to the place and on.
        stages: which lines of the table come first.
        loads: the nodes of every load in order; one without any may be filled.
    """

    gaps: TourGaps
    moves: StopMoves
    stages: Integers
    loads: Tours

    @cached_property
    def ways(self) -> list[TourPart]:
        """The part of every node."""
        pairs = [(part, part.reverse(self.gaps.table)) for part in self.gaps.tour]
        return [way for pair in pairs for way in sorted(pair, key=lambda way: way.node)]

    @cached_property
    def start(self) -> int | None:
        """The node with which the tractor begins if it stands on the field."""
        first = self.loads[0][0]
        return first if self.ways[first].node in self.gaps.table.starts else None

    @cached_property
    def part_stages(self) -> Integers:
        """The stage of every part; that which a tractor begins with is of the first."""
        stage = self.stages[[part.node // 2 for part in self.gaps.tour]]
        stage[[part.node in self.gaps.table.starts for part in self.gaps.tour]] = stage.min()
        return stage

    @cached_property
    def allowed(self) -> Flags:
        """Which parts (loads, n) a load may have: those in stages from its first one up to the first of the next."""
        rows, stages, highest = list[Flags](), self.part_stages, self.part_stages.max()
        for load in reversed(self.loads):
            own = stages[[node // 2 for node in load]] if load else np.array([highest])
            rows.append((stages >= own.min()) & (stages <= max(highest, own.max())))
            highest = own.min()
        allowed = np.array(rows[::-1])
        if self.start is not None:
            allowed[1:, self.start // 2] = False
        return allowed

    @cached_property
    def trips_s(self) -> tuple[Floats, Floats]:
        """Seconds (2 n) from the place to every node, and from every node to the place with the time to be served."""
        ends = [(way.node, way.last_m, way.first_m) for way in self.ways]
        off_s, on_s = self.moves.estimate_trips_s(ends).min(axis=1).T
        return on_s, off_s + self.gaps.supply.estimate_stop_s(self.gaps.total_need)

    @cached_property
    def goes_on(self) -> Flags:
        """Which node goes on along its line in which (2 n, 2 n)."""
        return np.array([[before.leads_to(after) for after in self.ways] for before in self.ways])

    @cached_property
    def need(self) -> Floats:
        """The share (n,) of a load that every part takes."""
        return _measure_needs(self.gaps)

    def pose_problem(self, costs: Floats) -> OrderProblem:
        """The search for the loads with these costs (n + 1, n + 1) of moves between lines."""
        table, ways, has_lane = self.gaps.table, self.ways, self.gaps.table.site.lane is not None
        nodes = np.array([way.node for way in ways])
        is_first, is_last = np.array([[way.is_first, way.is_last] for way in ways]).T
        moves_s = np.where(is_last[:, None] & is_first[None, :], costs[np.ix_(nodes, nodes)], np.inf)
        begin_s, end_s = (np.repeat(trips_s[None], len(self.loads), axis=0) for trips_s in self.trips_s)
        begin_s[0] = np.where(is_first, np.minimum(costs[-1, nodes], NO_MOVE_S) * has_lane, np.inf)
        end_s[-1] = np.where(is_last, np.minimum(costs[nodes, -1], NO_MOVE_S) * has_lane, np.inf)
        if self.start is not None:
            begin_s[0] = np.where(np.arange(len(ways)) == self.start, 0.0, np.inf)
        is_barred = np.array([way.node % 2 == 1 and not table.lines[way.node // 2].both_ways for way in ways])
        begin_s[:, is_barred], end_s[:, is_barred] = np.inf, np.inf
        lengths_m = np.array([part.last_m - part.first_m for part in self.gaps.tour])
        return OrderProblem(
            move_s=np.where(self.goes_on, 0.0, moves_s),
            work_s=lengths_m / table.site.rules.work_speed_mps,
            value_s=np.full(len(lengths_m), ANY_WAY_S),  # none is left
            begin_s=begin_s,
            end_s=end_s,
            allowed=self.allowed,
            stage=self.part_stages,
            need=self.need,
            sum_share=1.0,
        )

    def list_moves(self, loads: Tours) -> list[tuple[int, int]]:
        """The moves between lines within loads, into the field and out of it."""
        table, ways, nodes = self.gaps.table, self.ways, [node for load in loads for node in load]
        steps = [(ways[u], ways[v]) for load in loads for u, v in pairwise(load)]
        ends = [(table.gate, ways[node].node) for node in nodes[:1] if node != self.start]
        ends += [(ways[node].node, table.gate) for node in nodes[-1:]]
        moves = [(before.node, after.node) for before, after in steps if not before.leads_to(after)]
        return moves + ([] if table.site.lane is None else ends)

    def search(self) -> tuple[TourPart, ...]:
        """The parts of all loads in the order that was found."""
        table = self.gaps.table
        found = search_driven_tours(table, self.pose_problem, self.list_moves, lambda _: True, start=self.loads)
        return tuple(self.ways[node] for load in found for node in load)


def order_for_loads(
    table: MoveTable, supply: Supply, moves: StopMoves | None, stages: Sequence[int] | None, tour: Sequence[int]
) -> tuple[TourPart, ...]:
    """The parts of a tour in the order of least time with its stops; as given where that is no worse.

    `stages` (n,) say which lines come first, all at any time by default. The search begins with the tour in as few
    loads as can be, and in those that cost least. What it finds is cut to loads where that costs least, and searched
    again.
    """
    given = best = TourGaps(table, supply, cut_to_loads(table, supply, tour), moves, is_rough=True)
    if moves is None or best.choose_gaps() == ():
        return tuple(best.tour)
    best_s, starts = _estimate_cost_s(best), [(best, _cut_at_stops(best)), (best, _fill_loads(best))]
    stage = np.zeros(len(table.lines), np.int64) if stages is None else np.array(stages, np.int64)
    while starts:
        gaps, (*loads, last) = starts.pop()
        if not loads:
            continue
        found = TourGaps(
            table, supply, LoadTours(gaps, moves, stage, [*loads, [], last]).search(), moves, is_rough=True
        )
        cost_s = _estimate_cost_s(found) if len(found.tour) == len(best.tour) else np.inf
        if cost_s < best_s:
            best, best_s = found, cost_s
            starts.append((found, _cut_at_stops(found)))
    is_served = TourGaps(table, supply, best.tour, moves).choose_gaps() is not None
    return tuple(best.tour if is_served else given.tour)


def _measure_needs(gaps: TourGaps) -> Floats:
    """The share of a load that every part of a tour takes with the move to it."""
    needs = np.array([gaps.measure_part_need(part) for part in gaps.tour]) + gaps.mean_move_need
    return np.minimum(needs / gaps.supply.capacity, 1.0)


def _fill_loads(gaps: TourGaps) -> Tours:
    """The nodes of every load of a tour, each of as many parts as it is enough for."""
    loads, left = [list[int]()], 1.0
    for number, (part, need) in enumerate(zip(gaps.tour, _measure_needs(gaps).tolist(), strict=True)):
        left -= need
        if left < -ROUNDING:
            left = 1.0 - need
            loads.append([])
        loads[-1].append(2 * number + part.node % 2)
    return loads


def _cut_at_stops(gaps: TourGaps) -> Tours:
    """The nodes of every load of a tour as its stops cost least; a part that is left half way is its first load's."""
    stops, loads = gaps.choose_gaps() or (), dict[int, list[int]]()
    first_gaps = accumulate((len(cut_at_wait_points(gaps.table, [part])) for part in gaps.tour), initial=0)
    for number, (part, gap) in enumerate(zip(gaps.tour, first_gaps, strict=False)):
        loads.setdefault(bisect_right(stops, gap), []).append(2 * number + part.node % 2)
    return list(loads.values())


def _estimate_cost_s(gaps: TourGaps) -> float:
    """Seconds of the moves and stops of a tour with all charges, with ways to places as far as they are known."""
    chosen = gaps.choose_gaps() if gaps.has_ends else None
    return np.inf if chosen is None else round(gaps.measure_cost_s(chosen), 3)
