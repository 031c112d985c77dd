"""The lines of every tractor in an order found together with its loads: where a load ends, a place should be near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from strategies.program.supply import Supply
from strategies.programmes.move_table import NO_MOVE_S, MoveTable
from strategies.programmes.programme import Programme, list_pairs
from strategies.sequencing.tour_search import UNREACHABLE_S
from strategies.service_stops.load_search import SEARCH_EFFORT_STEPS, LoadedOrder, LoadOrderingTask, order_in_loads
from strategies.service_stops.stop_moves import StopMoves
from strategies.service_stops.tour_stops import TourGaps

Floats = npt.NDArray[np.float64]

MOST_ROUNDS = 6  # in which moves may turn out dearer than estimated
LATER_EFFORT = SEARCH_EFFORT_STEPS // 4


@dataclass(frozen=True, eq=False)
class TourLoads:
    """The lines of one tractor as a task of the search for orders in loads; its passes are nodes of `rows`."""

    table: MoveTable
    supply: Supply
    moves: StopMoves | None
    stages: Sequence[int]
    tour: tuple[int, ...]

    @property
    def rows(self) -> npt.NDArray[np.int64]:
        """Both nodes of every line, in the order of the tour."""
        return np.array([2 * (node // 2) + way for node in self.tour for way in (0, 1)], np.int64)

    def build_task(self) -> LoadOrderingTask:
        """The task with all moves as far as they are known."""
        rows, table, gaps = self.rows, self.table, TourGaps(self.table, self.supply, self.tour, self.moves)
        stage = np.array([self.stages[node // 2] for node in rows])
        is_barred = (stage[:, None] > stage[None, :]) | (rows[:, None] // 2 == rows[None, :] // 2)
        turns = np.where(is_barred, UNREACHABLE_S, np.minimum(table.cost_s[np.ix_(rows, rows)], UNREACHABLE_S))
        served_s = self.supply.estimate_stop_s(gaps.total_need)
        detours = np.where(is_barred, UNREACHABLE_S, np.minimum(self._list_detours(turns) + served_s, UNREACHABLE_S))
        has_lane = table.site.lane is not None
        first, last = (
            np.minimum(ends[rows], UNREACHABLE_S) * has_lane
            for ends in (table.cost_s[table.gate], table.cost_s[:, table.gate])
        )
        for number, node in enumerate(rows.tolist()):
            if not table.lines[node // 2].both_ways and node % 2:
                first[number] = last[number] = UNREACHABLE_S
        capacity = self.supply.capacity  # a line that takes more is served inside, and then takes a load like others
        needs = np.minimum(np.array(gaps.whole_needs) + gaps.mean_move_need, capacity)
        return LoadOrderingTask(turns, detours, first, last, needs, capacity, capacity)

    def _list_detours(self, turns: Floats) -> Floats:
        """Seconds from every pass by way of a place to every other, without the time to be served."""
        if self.moves is None:
            return turns
        trips = [self.moves.list_trips(self._get_end(node), (node, 0.0)) for node in self.rows.tolist()]
        off, on = (
            np.array([[self.moves.estimate_s(ways[way]) for ways in of_node] for of_node in trips]) for way in (0, 1)
        )
        least: Floats = (off[:, None, :] + on[None, :, :]).min(axis=2)
        return least

    def _get_end(self, node: int) -> tuple[int, float]:
        return node, self.table.lines[node // 2].measure_path_m(node % 2)

    def list_nodes(self, order: LoadedOrder) -> tuple[int, ...]:
        """The tour of an order."""
        return tuple(self.rows[order.passes].tolist())

    def drive_moves(self, order: LoadedOrder) -> bool:
        """Find and drive all moves that an order uses; whether there was any that was not driven before."""
        tour, is_new = self.list_nodes(order), False
        cut_pairs = {(tour[cut - 1], tour[cut]) for cut in order.cuts} if self.moves is not None else set()
        for pair in list_pairs(self.table, [tour]):
            if pair not in cut_pairs and not self.table.is_proven(*pair):
                is_new = True
                if self.table.find(*pair, search=True):
                    self.table.prove(*pair)
        return self._drive_detours(tour, order.cuts) or is_new

    def _drive_detours(self, tour: Sequence[int], cuts: Sequence[int]) -> bool:
        """Find and drive the moves to places and on; whether there was any that was not driven before."""
        if self.moves is None:
            return False
        trips = [
            trip
            for cut in cuts
            for ways in self.moves.list_trips(self._get_end(tour[cut - 1]), (tour[cut], 0.0))
            for trip in ways
            if not self.moves.is_known(trip)
        ]
        for trip in trips:
            self.moves.get_move(trip)
        return bool(trips)

    def list_tours(self) -> list[tuple[int, ...]]:
        """The tour as it is and those that the search finds, with moves driven anew until it uses no other."""
        if len(self.tour) < 2 or self.supply.is_enough(
            TourGaps(self.table, self.supply, self.tour, self.moves).total_need
        ):
            return [self.tour]
        tours, numbers = [self.tour], list(range(len(self.tour)))
        best = order_in_loads(self.build_task(), [numbers])
        for _ in range(MOST_ROUNDS):
            if best.seconds >= NO_MOVE_S:
                break
            is_new = self.drive_moves(best)
            tours.append(self.list_nodes(best))
            if not is_new:
                break
            best = order_in_loads(self.build_task(), [(best.passes // 2).tolist(), numbers], effort=LATER_EFFORT)
        return tours

    def choose_tour(self) -> tuple[int, ...]:
        """The tour whose work takes least time with its stops; that given where none can be served in time."""
        return min(self.list_tours(), key=lambda tour: round(self._measure_cost_s(tour), 3))

    def _measure_cost_s(self, tour: tuple[int, ...]) -> float:
        """Seconds of the moves and stops of a tour with all charges; infinite where it cannot be driven."""
        gaps = TourGaps(self.table, self.supply, tour, self.moves)
        chosen = gaps.choose_gaps() if gaps.has_ends else None
        return np.inf if chosen is None else gaps.measure_cost_s(chosen)


def order_for_loads(
    programme: Programme, supply: Supply, moves: StopMoves | None, stages: Sequence[int] | None = None
) -> Programme:
    """The programme with the lines of every tractor in the order of least time with its stops.

    `stages` (n,) say which lines come first, all at any time by default.
    """
    table = programme.table
    stage = [0] * len(table.lines) if stages is None else stages
    tours = [TourLoads(table, supply, moves, stage, tour).choose_tour() for tour in programme.tours]
    return replace(programme, tours=tuple(tours))
