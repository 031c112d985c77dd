"""The lines of every tractor in an order found together with its loads: where a load ends, a place should be near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_tours import NO_MOVE_S
from strategies.programmes.programme import Programme, list_pairs
from strategies.rules.supply import Supply
from strategies.service_stops.load_search import (
    SEARCH_EFFORT_STEPS,
    UNREACHABLE_S,
    LoadedOrder,
    LoadOrderingTask,
    order_in_loads,
)
from strategies.service_stops.stop_moves import StopMoves
from strategies.service_stops.tour_parts import TourPart, cut_to_loads
from strategies.service_stops.tour_stops import TourGaps

Floats = npt.NDArray[np.float64]

MOST_ROUNDS = 6  # in which moves may turn out dearer than estimated
LATER_EFFORT = SEARCH_EFFORT_STEPS // 4


@dataclass(frozen=True, eq=False)
class TourLoads:
    """The parts of one tractor as a task of the search for orders in loads; its passes are the `ways` of the parts."""

    table: MoveTable
    supply: Supply
    moves: StopMoves | None
    stages: Sequence[int]
    tour: tuple[TourPart, ...]

    @cached_property
    def ways(self) -> list[TourPart]:
        """Every part in the direction of its line, and against it."""
        pairs = [(part, part.reverse(self.table)) for part in self.tour]
        return [way for pair in pairs for way in sorted(pair, key=attrgetter("node"))]

    def build_task(self) -> LoadOrderingTask:
        """The task with all moves as far as they are known."""
        ways, gaps = self.ways, self._build_gaps(self.tour)
        stage = np.array([self.stages[way.node // 2] for way in ways])
        is_begun = np.isin([way.node // 2 for way in ways], np.array(self.table.starts, int) // 2)
        stage[is_begun] = stage.min()
        part = np.arange(len(ways)) // 2
        is_barred = (stage[:, None] > stage[None, :]) | (part[:, None] == part[None, :])
        is_barred[:, [self._is_start(way) for way in ways]] = True
        turns = np.where(is_barred, UNREACHABLE_S, self._list_turns())
        served_s = self.supply.estimate_stop_s(gaps.total_need)
        detours = np.where(is_barred, UNREACHABLE_S, np.minimum(self._list_detours(turns) + served_s, UNREACHABLE_S))
        needs = np.array([gaps.measure_part_need(way) for way in self.tour]) + gaps.mean_move_need
        capacity = self.supply.capacity
        return LoadOrderingTask(turns, detours, *self._list_ends(), np.minimum(needs, capacity), capacity, capacity)

    def _build_gaps(self, tour: Sequence[TourPart]) -> TourGaps:
        return TourGaps(self.table, self.supply, tour, self.moves)

    def _list_turns(self) -> Floats:
        """Seconds from every way to every other without a stop: on along a line, or from its end to a begin."""
        ways = self.ways
        nodes, is_first, is_last = _list_places(ways)
        moves_s = np.where(is_last[:, None] & is_first[None, :], self.table.cost_s[np.ix_(nodes, nodes)], UNREACHABLE_S)
        goes_on = np.array([[before.leads_to(after) for after in ways] for before in ways])
        return np.where(goes_on, 0.0, np.minimum(moves_s, UNREACHABLE_S))

    def _list_ends(self) -> tuple[Floats, Floats]:
        """Seconds to every way at first, and from it at last; nothing without an entrance."""
        table, has_lane = self.table, self.table.site.lane is not None
        nodes, is_first, is_last = _list_places(self.ways)
        is_barred = np.array([not table.lines[node // 2].both_ways and node % 2 == 1 for node in nodes])
        first, last = (
            np.where(is_end & ~is_barred, np.minimum(ends[nodes], UNREACHABLE_S) * has_lane, UNREACHABLE_S)
            for is_end, ends in ((is_first, table.cost_s[table.gate]), (is_last, table.cost_s[:, table.gate]))
        )
        is_start = np.array([self._is_start(way) and way.node in table.starts for way in self.ways])
        return (np.where(is_start, 0.0, UNREACHABLE_S) if is_start.any() else first), last

    def _is_start(self, way: TourPart) -> bool:
        """Whether a tractor that stands on the field begins with a part, one way or the other."""
        return way in (self.tour[0], self.tour[0].reverse(self.table)) and self.tour[0].node in self.table.starts

    def _list_detours(self, turns: Floats) -> Floats:
        """Seconds from every way by way of a place to every other, without the time to be served."""
        if self.moves is None:
            return turns
        trips = [self.moves.list_trips((way.node, way.last_m), (way.node, way.first_m)) for way in self.ways]
        off, on = (
            np.array([[self.moves.estimate_s(both[end]) for both in of_way] for of_way in trips]) for end in (0, 1)
        )
        least: Floats = (off[:, None, :] + on[None, :, :]).min(axis=2)
        return least

    def list_parts(self, order: LoadedOrder) -> tuple[TourPart, ...]:
        """The tour of an order."""
        return tuple(self.ways[number] for number in order.passes.tolist())

    def drive_moves(self, order: LoadedOrder) -> bool:
        """Find and drive all moves that an order uses; whether there was any that was not driven before."""
        tour = self.list_parts(order)
        cuts = set(order.cuts) if self.moves is not None else set()
        pairs = [
            (before.node, after.node)
            for gap, (before, after) in enumerate(pairwise(tour), start=1)
            if gap not in cuts and not before.leads_to(after)
        ]
        ends = [pair for pair in list_pairs(self.table, [[tour[0].node, tour[-1].node]]) if self.table.gate in pair]
        is_new = not all(self.table.is_proven(*pair) for pair in [*pairs, *ends])
        self.table.prove([*pairs, *ends])
        return self._drive_detours(tour, order.cuts) or is_new

    def _drive_detours(self, tour: Sequence[TourPart], cuts: Sequence[int]) -> bool:
        """Find and drive the moves to places and on; whether there was any that was not driven before."""
        if self.moves is None:
            return False
        ends = [((tour[cut - 1].node, tour[cut - 1].last_m), (tour[cut].node, tour[cut].first_m)) for cut in cuts]
        trips = [trip for both in ends for ways in self.moves.list_trips(*both) for trip in ways]
        unknown = [trip for trip in trips if not self.moves.is_known(trip)]
        for trip in unknown:
            self.moves.get_move(trip)
        return bool(unknown)

    def list_tours(self) -> list[tuple[TourPart, ...]]:
        """The tour as it is and those that the search finds, with moves driven anew until it uses no other."""
        if len(self.tour) < 2 or self.supply.is_enough(self._build_gaps(self.tour).total_need):
            return [self.tour]
        tours, numbers = [self.tour], list(range(len(self.tour)))
        best = order_in_loads(self.build_task(), [numbers])
        for _ in range(MOST_ROUNDS):
            if best.seconds >= NO_MOVE_S:
                break
            is_new = self.drive_moves(best)
            tours.append(self.list_parts(best))
            if not is_new:
                break
            best = order_in_loads(self.build_task(), [(best.passes // 2).tolist(), numbers], effort=LATER_EFFORT)
        return tours

    def choose_tour(self) -> tuple[TourPart, ...]:
        """The tour of least time with its stops on which these are enough; that given where there is none."""
        tours = sorted(dict.fromkeys(self.list_tours()), key=lambda tour: round(self._estimate_cost_s(tour), 3))
        is_enough = (self._build_gaps(tour).choose_gaps() is not None for tour in tours)
        return next((tour for tour, enough in zip(tours, is_enough, strict=True) if enough), self.tour)

    def _estimate_cost_s(self, tour: tuple[TourPart, ...]) -> float:
        """Seconds of the moves and stops of a tour with all charges, with ways to places as far as they are known."""
        gaps = TourGaps(self.table, self.supply, tour, self.moves, is_rough=True)
        chosen = gaps.choose_gaps() if gaps.has_ends else None
        return np.inf if chosen is None else gaps.measure_cost_s(chosen)


def _list_places(
    ways: Sequence[TourPart],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """The nodes of some parts, and which of them are the first and the last of their lines."""
    return (
        np.array([way.node for way in ways]),
        np.array([way.is_first for way in ways]),
        np.array([way.is_last for way in ways]),
    )


def order_for_loads(
    programme: Programme, supply: Supply, moves: StopMoves | None, stages: Sequence[int] | None = None
) -> list[tuple[TourPart, ...]]:
    """The parts of the lines of every tractor in the order of least time with its stops.

    `stages` (n,) say which lines come first, all at any time by default.
    """
    table = programme.table
    stage = [0] * len(table.lines) if stages is None else stages
    return [
        TourLoads(table, supply, moves, stage, cut_to_loads(table, supply, tour)).choose_tour() if tour else ()
        for tour in programme.tours
    ]
