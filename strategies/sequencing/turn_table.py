"""Seconds between the passes of some swaths, for searching orders of swaths: times of the paths really driven.

Turns to near lines are computed before the search, once for all jobs of a field. Longer paths, and paths on in the same
direction, are estimated first and computed when an order uses them, until an order uses no estimate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.layout.swaths import Swath
from strategies.path_planning.paths import Pose
from strategies.path_planning.primitive_search import compute_shortest_m
from strategies.program.field_job import FieldJob, SwathPass
from strategies.sequencing.order_proof import prove_tour
from strategies.sequencing.tour_search import MAX_PROVEN_SWATHS, UNREACHABLE_S, Tour, TurnSeconds, find_best_tour

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NEAR_LINES = 10  # orders that are best turn over fewer lines; more only where a field is in pieces
MAX_EXACT_ROUNDS = 13
MAX_PROOF_ROUNDS = 3
MIN_PROOF_GAIN = 0.005  # of the seconds between swaths: where an order ends matters more to what follows than less
SEARCH_EFFORTS = ((False, False), (True, False), (True, True))
"""(kicked, proven): an order uses no estimates any more before the search takes more effort."""
TIME_RESOLUTION_S = 1e-3  # times are rounded, so that no choice depends on rounding errors


class TurnTable:
    """Seconds from the end of every pass of `swaths` to the beginning of every other, shape (2 n, 2 n).

    Pass 2 i is swath i along the bearing of its cell, 2 i + 1 against it. `is_exact` marks what is computed: at first
    the turns over at most `near_lines`.
    """

    def __init__(self, job: FieldJob, swaths: list[Swath], near_lines: int = NEAR_LINES) -> None:
        self.job, self.passes = job, [SwathPass(swath, direction) for swath in swaths for direction in (1, -1)]
        key = near_lines, tuple(swaths)
        if key not in job.turn_table_cache:
            self.seconds, self.is_exact = (
                _estimate_turns_s(job, self.passes),
                np.zeros((len(self.passes),) * 2, dtype=bool),
            )
            self._compute_turns(
                np.array(list(_list_near_turns(self.passes, near_lines)), dtype=np.int64).reshape(-1, 2)
            )
            job.turn_table_cache[key] = self.seconds, self.is_exact
        self.seconds, self.is_exact = (cached_array.copy() for cached_array in job.turn_table_cache[key])
        self._exact_ends: set[tuple[int, int]] = set()

    def _compute_turns(self, pairs: Ints) -> None:
        """Compute the seconds of the turns between pairs (k, 2) of passes, where a turn exists."""
        exits, entries = (
            np.array([get_pose(swath_pass) for swath_pass in self.passes])
            for get_pose in (self.job.get_exit_pose, self.job.get_entry_pose)
        )
        seconds = self.job.compute_turn_costs_s(exits, entries, pairs)
        reachable = np.isfinite(seconds)
        p, q = pairs[reachable].T
        self.seconds[p, q] = np.rint(seconds[reachable] / TIME_RESOLUTION_S) * TIME_RESOLUTION_S
        self.is_exact[p, q] = True

    def _compute_path(self, p: int, q: int) -> None:
        """Compute the seconds of the path from pass p to pass q."""
        path = self.job.find_path(self.job.get_exit_pose(self.passes[p]), self.job.get_entry_pose(self.passes[q]))
        self.seconds[p, q] = UNREACHABLE_S if path is None else _round_seconds(self.job.connector.compute_cost_s(path))
        self.is_exact[p, q] = True

    def compute_exact_times(self, order: list[int]) -> bool:
        """Compute all times that an order of passes uses and that are only estimated; returns whether any were."""
        estimated_pairs = [(p, q) for p, q in pairwise(order) if not self.is_exact[p, q]]
        for p, q in estimated_pairs:
            self._compute_path(p, q)
        return bool(estimated_pairs)

    def estimate_start_end_s(self) -> Floats:
        """Seconds between the entrance and the beginning and the end of every pass (2, 2 n); 0 without an entrance.

        With an entrance lane they are those of the shortest paths with the turning radius, exact once computed, and 0
        at an end of the order that is not at the entrance.
        """
        entrance = self.job.layout.field.entrance
        if self.job.entrance_lane is not None:
            return np.where(np.array(self.job.entrance_ends)[:, None], self._entrance_times_s, 0.0)
        if entrance is None:
            return np.zeros((2, len(self.passes)))
        speed = self.job.driving_rules.turn_speed_mps
        places = (
            (self.job.get_entry_pose(swath_pass)[:2], self.job.get_exit_pose(swath_pass)[:2])
            for swath_pass in self.passes
        )
        return np.array([[_round_seconds(math.dist(entrance, end) / speed) for end in pair] for pair in places]).T

    @cached_property
    def _entrance_times_s(self) -> Floats:
        """Estimated seconds from the entrance to every pass, and back to it from every pass (2, 2 n)."""
        radius, speed = self.job.driving_rules.radius_m, self.job.driving_rules.turn_speed_mps
        entrance_poses = (self._get_entrance_poses(swath_pass) for swath_pass in self.passes)
        lengths_m = [
            [compute_shortest_m(np.array(a), np.array(b), radius) + lead for a, b, lead in pair]
            for pair in entrance_poses
        ]
        return np.rint(np.array(lengths_m).T / speed / TIME_RESOLUTION_S) * TIME_RESOLUTION_S

    def _get_entrance_poses(self, swath_pass: SwathPass) -> tuple[tuple[Pose, Pose, float], tuple[Pose, Pose, float]]:
        """The ends of the paths in to a pass and out from it, each with the metres straight through the entrance."""
        entrance_lane = self.job.entrance_lane
        assert entrance_lane is not None
        return (entrance_lane.inner_pose, self.job.get_entry_pose(swath_pass), entrance_lane.lead_m), (
            self.job.get_exit_pose(swath_pass),
            entrance_lane.build_path_out().start,
            entrance_lane.lead_m,
        )

    def compute_exact_start_end(self, order: list[int]) -> bool:
        """Compute the paths in and out that an order of passes uses; returns whether one was only estimated."""
        if self.job.entrance_lane is None:
            return False
        ends = ((0, order[0]), (1, order[-1]))
        estimated_ends = {end for end in ends if self.job.entrance_ends[end[0]]} - self._exact_ends
        for end, p in sorted(estimated_ends):
            a, b, lead_m = self._get_entrance_poses(self.passes[p])[end]
            path = self.job.find_path(a, b)
            if path is not None:
                seconds = self.job.connector.compute_cost_s(path) + lead_m / self.job.driving_rules.turn_speed_mps
                self._entrance_times_s[end, p] = _round_seconds(seconds)
        self._exact_ends |= estimated_ends
        return bool(estimated_ends)

    def find_best_pass_order(
        self, members: list[int], starts: list[list[int]], seed: int = 1, *, roughly: bool = False, proven: bool = True
    ) -> Tour:
        """The best order through some of the swaths, in passes of this table.

        `members` are their places in the table; `starts` orders of these to search from. `roughly` leaves estimates as
        they are and the order where no move helps; without `proven` the best order of few swaths is not computed. The
        bound is that of the search alone (tour_search.sharpen_bound).
        """
        rows = np.array([2 * swath + direction for swath in members for direction in (0, 1)])
        place = {swath: index for index, swath in enumerate(members)}
        first, last = self.estimate_start_end_s()[:, rows]
        inner = [[place[swath] for swath in start] for start in starts]
        if roughly:
            best = find_best_tour(self.seconds[np.ix_(rows, rows)], first, last, inner, seed, kicked=False)
            return Tour(rows[best.passes], best.seconds, best.bound_s)
        for kicked, proof in SEARCH_EFFORTS[: 3 if proven and len(members) <= MAX_PROVEN_SWATHS else 2]:
            for _ in range(MAX_EXACT_ROUNDS):
                search_input = self.seconds[np.ix_(rows, rows)], first, last
                best = find_best_tour(*search_input, inner, seed, kicked=kicked, proven=proof, bounded=False)
                inner = [(best.passes // 2).tolist()]
                order = rows[best.passes].tolist()
                has_estimates = self.compute_exact_times(order)
                if not has_estimates and (kicked or not self.compute_exact_start_end(order)):
                    break  # the paths in and out are computed while the search is cheap
                first, last = self.estimate_start_end_s()[:, rows]
        return replace(best, passes=rows[best.passes])

    def prove_pass_order(self, found: Tour, effort: float) -> Tour:
        """An order of `find_best_pass_order` improved and proven (order_proof), by times without estimates.

        `effort` is that of order_proof.prove_tour. Estimates that an improved order uses are computed; in the last
        round only turns that are computed are used, as there is always a next one whose estimate is too good.
        """
        members = np.unique(found.passes // 2)
        rows = (2 * members[:, None] + np.arange(2)).ravel()
        start = best = np.searchsorted(rows, found.passes)
        bound_s = found.bound_s
        for round_number in range(MAX_PROOF_ROUNDS):
            times, is_last = self._get_times(rows), round_number == MAX_PROOF_ROUNDS - 1
            if is_last:
                is_exact = self.is_exact[np.ix_(rows, rows)]
                times = times._replace(turns=np.where(is_exact, times.turns, UNREACHABLE_S))
            proven = prove_tour(Tour(best, times.sum_order(best), 0.0, times), effort)
            bound_s = bound_s if is_last else max(bound_s, proven.bound_s)
            order = rows[proven.passes].tolist()
            has_estimates = self.compute_exact_times(order) | self.compute_exact_start_end(order)
            best = min(best, proven.passes, key=self._get_times(rows).sum_order)
            if not has_estimates:
                break
        times = self._get_times(rows)
        if times.sum_order(start) <= (1.0 + MIN_PROOF_GAIN) * times.sum_order(best):
            best = start
        seconds = times.sum_order(best)
        return Tour(rows[best], seconds, min(bound_s, seconds), times)

    def _get_times(self, rows: Ints) -> TurnSeconds:
        """The seconds between the passes in some rows."""
        first, last = self.estimate_start_end_s()[:, rows]
        return TurnSeconds(np.ascontiguousarray(self.seconds[np.ix_(rows, rows)]), first.copy(), last.copy())


def _list_near_turns(passes: list[SwathPass], near_lines: int) -> Iterator[tuple[int, int]]:
    """Pairs of passes that a turn may join: opposite directions on near lines of a cell."""
    cells = np.array([swath_pass.swath.cell_number for swath_pass in passes])
    lines = np.array([swath_pass.swath.line for swath_pass in passes])
    directions = np.array([swath_pass.direction for swath_pass in passes])
    for p in range(len(passes)):
        is_near = (np.abs(lines - lines[p]) <= near_lines) & (directions != directions[p]) & (cells == cells[p])
        yield from ((p, q) for q in np.flatnonzero(is_near).tolist() if p // 2 != q // 2)


def _estimate_turns_s(job: FieldJob, passes: list[SwathPass]) -> Floats:
    """`FieldJob.estimate_turn_time_s` between all passes at once, to the millisecond; UNREACHABLE_S within a swath."""
    driving_rules, table = job.driving_rules, np.array(job.driving_rules.turn_s)
    exits, entries = (
        np.array([get_pose(swath_pass) for swath_pass in passes])
        for get_pose in (job.get_exit_pose, job.get_entry_pose)
    )
    off = entries[None, :, :2] - exits[:, None, :2]
    cosine, sine = np.cos(exits[:, 2, None]), np.sin(exits[:, 2, None])
    along = np.abs(off[..., 0] * cosine + off[..., 1] * sine)
    across = np.abs(off[..., 1] * cosine - off[..., 0] * sine)
    lines = np.maximum(1, np.rint(across / job.layout.width_m).astype(np.int64))
    extra = np.maximum(0, lines - len(table) + 1) * job.layout.width_m
    turns = table[np.minimum(lines, len(table) - 1)] + (extra + along) / driving_rules.turn_speed_mps
    onward = (along + across + 2.0 * math.pi * driving_rules.radius_m) / driving_rules.turn_speed_mps
    directions, swath_numbers = np.array([swath_pass.direction for swath_pass in passes]), np.arange(len(passes)) // 2
    seconds = np.where(directions[:, None] == directions[None, :], onward, turns)
    cells = np.array([swath_pass.swath.cell_number for swath_pass in passes])
    for p, q in zip(*np.nonzero(cells[:, None] != cells[None, :]), strict=True):
        seconds[p, q] = job.estimate_turn_time_s(passes[p], passes[q])
    return np.where(
        swath_numbers[:, None] == swath_numbers[None, :],
        UNREACHABLE_S,
        np.rint(seconds / TIME_RESOLUTION_S) * TIME_RESOLUTION_S,
    )


def _round_seconds(seconds: float) -> float:
    return round(seconds / TIME_RESOLUTION_S) * TIME_RESOLUTION_S
