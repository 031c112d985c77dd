"""The swaths of one tractor in an order found together with its loads: turns, paths to the service point, and stops.

Paths to the place and back are estimated first, and computed where an order uses them, until none is estimated.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fields.layout.swaths import Swath
from strategies.path_planning.paths import Pose
from strategies.path_planning.primitive_search import compute_shortest_m
from strategies.program.field_job import FieldJob
from strategies.program.supply import PLACE, Supply
from strategies.sequencing.swath_order import SearchedOrder
from strategies.sequencing.tour_search import UNREACHABLE_S
from strategies.sequencing.turn_table import TurnTable
from strategies.service_stops.load_search import SEARCH_EFFORT_STEPS, LoadedOrder, LoadOrderingTask, order_in_loads
from strategies.service_stops.stops import find_service_path, find_service_points

Floats = npt.NDArray[np.float64]

MAX_EXACT_ROUNDS = 6
TIME_RESOLUTION_S = 1e-3


def search_in_loads(searched: SearchedOrder, job: FieldJob, table: TurnTable, supply: Supply) -> SearchedOrder:
    """The swaths of an order reordered for their loads; unchanged if one load is enough for all."""
    need = np.array(
        [supply.compute_need(swath_pass.swath.length_m, job.layout.width_m) for swath_pass in searched.order]
    )
    if supply.is_enough(float(need.sum())):
        return searched
    swath_places = {swath: index for index, swath in enumerate(job.layout.swaths)}
    members = [swath_places[swath_pass.swath] for swath_pass in searched.order]
    trips = ServiceTrips(job, table, supply, members)
    starts = [list(range(len(members))), _sort_by_line(searched, job)]
    best_loads = order_in_loads(trips.build_task(need), starts)
    for _ in range(MAX_EXACT_ROUNDS):
        if not trips.compute_exact_times(best_loads):
            break
        best_loads = order_in_loads(
            trips.build_task(need), [(best_loads.passes // 2).tolist(), starts[0]], effort=SEARCH_EFFORT_STEPS // 4
        )
    if best_loads.seconds >= UNREACHABLE_S:
        return searched
    work_s = sum(swath_pass.swath.length_m for swath_pass in searched.order) / job.driving_rules.work_speed_mps
    return SearchedOrder(
        [table.passes[p] for p in trips.rows[best_loads.passes].tolist()], work_s + best_loads.seconds, searched.tour
    )


def _sort_by_line(searched: SearchedOrder, job: FieldJob) -> list[int]:
    """The places of an order sorted by line."""
    swaths: list[Swath] = [swath_pass.swath for swath_pass in searched.order]
    return sorted(range(len(swaths)), key=lambda n: (swaths[n].cell_number, swaths[n].line, swaths[n].piece))


class ServiceTrips:
    """Seconds to the place from the end of every pass of some swaths, and from there to the beginning of every other.

    `to_point_s` and `from_point_s` (b, 2 n) have a row for every pose that a tractor may stand in; empty without a
    place.
    """

    def __init__(self, job: FieldJob, table: TurnTable, supply: Supply, members: list[int]) -> None:
        self.job, self.table, self.supply = job, table, supply
        self.rows = np.array([2 * swath + direction for swath in members for direction in (0, 1)])
        self.passes = [table.passes[row] for row in self.rows]
        self.service_points: tuple[Pose, ...] = find_service_points(job) if supply.served_at == PLACE else ()
        self.to_point_s = np.array(
            [
                [self._estimate_path_s(job.get_exit_pose(swath_pass), spot) for swath_pass in self.passes]
                for spot in self.service_points
            ]
        )
        self.from_point_s = np.array(
            [
                [self._estimate_path_s(spot, job.get_entry_pose(swath_pass)) for swath_pass in self.passes]
                for spot in self.service_points
            ]
        )
        self.exact_ends: set[tuple[int, int]] = set()

    def _estimate_path_s(self, a: Pose, b: Pose) -> float:
        driving_rules = self.job.driving_rules
        return compute_shortest_m(np.array(a), np.array(b), driving_rules.radius_m) / driving_rules.turn_speed_mps

    def build_task(self, need: Floats) -> LoadOrderingTask:
        """The input of the search."""
        turns = self.table.seconds[np.ix_(self.rows, self.rows)]
        first, last = np.ascontiguousarray(self.table.estimate_start_end_s()[:, self.rows])
        detours = (
            turns
            if not self.service_points
            else (self.to_point_s[:, :, None] + self.from_point_s[:, None, :]).min(axis=0)
        )
        swath_numbers = np.arange(len(self.rows)) // 2
        detours = np.where(
            swath_numbers[:, None] == swath_numbers[None, :],
            UNREACHABLE_S,
            detours + self.supply.estimate_stop_s(float(need.sum())),
        )
        return LoadOrderingTask(turns, detours, first, last, need, self.supply.capacity, self.supply.capacity)

    def compute_exact_times(self, loads: LoadedOrder) -> bool:
        """Compute all times that an order uses and that are only estimated; returns whether there were any."""
        order = self.rows[loads.passes].tolist()
        parts = np.split(np.array(order), loads.cuts)
        has_estimates = sum(self.table.compute_exact_times(part.tolist()) for part in parts) > 0
        for cut in loads.cuts if self.service_points else ():
            p, q = int(loads.passes[cut - 1]), int(loads.passes[cut])
            for end, pass_number in ((0, p), (1, q)):
                if (end, pass_number) not in self.exact_ends:
                    self.exact_ends.add((end, pass_number))
                    self._compute_paths(end, pass_number)
                    has_estimates = True
        return has_estimates

    def _compute_paths(self, end: int, pass_number: int) -> None:
        """Compute the paths to the place after a pass (`end` 0), or from there to it (1)."""
        for row, spot in enumerate(self.service_points):
            job, swath_pass = self.job, self.passes[pass_number]
            path = (
                find_service_path(job, spot, job.get_entry_pose(swath_pass))
                if end
                else find_service_path(job, job.get_exit_pose(swath_pass), spot)
            )
            seconds = (
                UNREACHABLE_S
                if path is None
                else round(self.job.connector.compute_cost_s(path) / TIME_RESOLUTION_S) * TIME_RESOLUTION_S
            )
            (self.from_point_s if end else self.to_point_s)[row, pass_number] = seconds
