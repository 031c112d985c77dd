"""Seconds between the passes of some swaths, for estimating the time of a layout.

Turns to near lines are computed. Longer paths, and paths on in the same direction, are estimated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from fields.layout.swaths import Swath
from strategies.path_planning.paths import Pose
from strategies.path_planning.primitive_search import compute_shortest_m
from strategies.program.field_job import FieldJob, SwathPass
from strategies.sequencing.tour_search import UNREACHABLE_S

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

TIME_RESOLUTION_S = 1e-3  # times are rounded, so that no choice depends on rounding errors


class TurnTable:
    """Seconds from the end of every pass of `swaths` to the beginning of every other, shape (2 n, 2 n).

    Pass 2 i is swath i along the bearing of its cell, 2 i + 1 against it. Turns over at most `near_lines` are computed.
    """

    def __init__(self, job: FieldJob, swaths: list[Swath], near_lines: int) -> None:
        self.job, self.passes = job, [SwathPass(swath, direction) for swath in swaths for direction in (1, -1)]
        self.seconds = _estimate_turns_s(job, self.passes)
        near_turns = list(_list_near_turns(self.passes, near_lines))
        self._compute_turns(np.array(near_turns, dtype=np.int64).reshape(-1, 2))

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

    def estimate_start_end_s(self) -> Floats:
        """Seconds between the entrance and the beginning and the end of every pass (2, 2 n); 0 without an entrance.

        With an entrance lane they are those of the shortest paths with the turning radius.
        """
        entrance = self.job.layout.field.entrance
        if self.job.entrance_lane is not None:
            return self._estimate_entrance_times_s()
        if entrance is None:
            return np.zeros((2, len(self.passes)))
        speed = self.job.driving_rules.turn_speed_mps
        places = (
            (self.job.get_entry_pose(swath_pass)[:2], self.job.get_exit_pose(swath_pass)[:2])
            for swath_pass in self.passes
        )
        return np.array([[_round_seconds(math.dist(entrance, end) / speed) for end in pair] for pair in places]).T

    def _estimate_entrance_times_s(self) -> Floats:
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
