"""The swaths that a formation leaves over, which the leader of its last round works, and the corners it may begin at.

The other tractors wait in their last swaths, before the last part, until the leader works the last leftover swath.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.layout.swaths import Swath
from strategies.formations.grouping import (
    START_CORNERS,
    FormationGrouping,
    FormationRound,
    StartCorner,
    divide_runs,
    group_swaths,
)
from strategies.formations.queueing import FormationDraft
from strategies.formations.slots import SHORTEST_M, Floats, FormationSlot, find_blocked_spans, sample_poses
from strategies.program.field_job import FieldJob, SwathPass
from strategies.program.legs import build_swath_legs, build_turn_legs
from strategies.sequencing.swath_order import search_order
from strategies.sequencing.turn_table import TurnTable
from vehicle.missions.plan import DRIVE_IN


class _TurnTableAfterPass(TurnTable):
    """Seconds between swaths that are worked after a tractor has finished another pass."""

    def __init__(self, job: FieldJob, swaths: list[Swath], before: SwathPass) -> None:
        self.before = before
        super().__init__(job, swaths)

    def estimate_start_end_s(self) -> npt.NDArray[np.float64]:
        """Estimated seconds from the pass before to every pass, and 0 from their ends (2, 2 n)."""
        first = [round(self.job.estimate_turn_time_s(self.before, swath_pass), 3) for swath_pass in self.passes]
        return np.array([first, [0.0] * len(first)])

    def compute_exact_start_end(self, order: list[int]) -> bool:
        """Nothing to compute: the tractor is already on the field and stays there."""
        return False


def find_leader(slots: FormationRound) -> FormationSlot:
    """The slot of the first row."""
    return next(slot for slot in slots if slot.row == 1)


def order_leftover_swaths(job: FieldJob, swath_grouping: FormationGrouping) -> list[SwathPass]:
    """The leftover swaths in the order and direction in which the leader of the last round works them."""
    if not swath_grouping.single_swaths:
        return []
    before = find_leader(swath_grouping.rounds[-1]).swath_pass
    key = "alone", before, tuple(swath_grouping.single_swaths)
    if key not in job.formation_cache:
        part_job = replace(job, layout=replace(job.layout, swaths=tuple(swath_grouping.single_swaths)))
        job.formation_cache[key] = search_order(
            swath_grouping.single_swaths,
            part_job,
            _TurnTableAfterPass(part_job, swath_grouping.single_swaths, before),
            proven=False,
        ).order
    return list(job.formation_cache[key])


def hold_others_clear(job: FieldJob, rounds: list[FormationRound], order: list[SwathPass]) -> list[FormationRound]:
    """The rounds with the others waiting clear of the leader while it works the leftover swaths, if there is room."""
    if not order:
        return rounds
    leader = find_leader(rounds[-1])
    path_poses = _sample_leader_poses(job, [leader.swath_pass, *order])
    last_rounds = {slot.tractor: number for number, slots in enumerate(rounds) for slot in slots}
    held_rounds = []
    for number, slots in enumerate(rounds):
        idle_tractors = {slot.tractor for slot in slots if last_rounds[slot.tractor] == number} - {leader.tractor}
        held_rounds.append(
            [
                _move_waiting_place_back(job, slot, path_poses) if slot.tractor in idle_tractors else slot
                for slot in slots
            ]
        )
    return held_rounds


def _move_waiting_place_back(job: FieldJob, slot: FormationSlot, path_poses: list[Floats]) -> FormationSlot:
    hold_m = find_blocked_spans(job, slot.swath_pass, path_poses).find_clear_place_before(slot.hold_m)
    return replace(slot, hold_m=hold_m, up_m=()) if hold_m >= slot.place_m + SHORTEST_M else slot


def _sample_leader_poses(job: FieldJob, order: list[SwathPass]) -> list[Floats]:
    """The poses on all swaths of an order except the first, and on the paths between them."""
    pose_rows = []
    for a, b in pairwise(order):
        path = job.find_path(job.get_exit_pose(a), job.get_entry_pose(b))
        if path is not None:
            pose_rows.append(sample_poses(path))
        pose_rows.append(np.array([(*job.get_entry_pose(b), 0.0), (*job.get_exit_pose(b), 0.0)]))
    return pose_rows


def assign_leftover_swaths(draft: FormationDraft, order: list[SwathPass]) -> int:
    """Let the leader of the last round work these passes after it; returns the number of that tractor."""
    job, leader = draft.job, find_leader(draft.rounds[-1])
    legs = draft.legs[leader.tractor]
    for a, b in pairwise([leader.swath_pass, *order]):
        legs += build_turn_legs(job, a, b) + build_swath_legs(job, b)
    last_begun_leg = max(index for index, leg in enumerate(legs) if leg.task.kind == DRIVE_IN)
    for other_tractor in sorted(set(draft.last_slots) - {leader.tractor}):
        draft.add_wait(
            other_tractor, draft.find_last_leg(other_tractor), [draft.build_end_gate(leader.tractor, last_begun_leg)]
        )
    return leader.tractor


CLOSE_RATIO = 1.05  # corners whose estimates are this close are compared by the paths driven


def rank_start_corners(job: FieldJob) -> list[StartCorner]:
    """The four corners to begin at, the one with the least estimated time first.

    The estimate depends only on the shape of the field, not on its place or orientation. It is cached for all jobs of
    a field with the same number of tractors.
    """
    key = "corners", job.tractors, job.corner, job.layout.field.entrance, job.layout.swaths
    if key not in job.formation_cache:
        job.formation_cache[key] = _estimate_start_corners(job)
    return list(job.formation_cache[key])


def _estimate_start_corners(job: FieldJob) -> list[StartCorner]:
    divided_runs = divide_runs(job)
    tours = {corner: group_swaths(replace(job, corner=corner), divided_runs) for corner in START_CORNERS}
    estimates = {corner: tour.seconds if tour.rounds else math.inf for corner, tour in tours.items()}
    limit = CLOSE_RATIO * min(estimates.values())
    close_corners = [corner for corner in START_CORNERS if estimates[corner] <= limit < math.inf]
    driven_times_s = (
        {corner: compute_grouping_time_s(job, tours[corner]) for corner in close_corners}
        if len(close_corners) > 1
        else {}
    )
    return sorted(
        START_CORNERS,
        key=lambda corner: (
            corner not in close_corners,
            round(driven_times_s.get(corner, 0.0), 2),
            round(estimates[corner], 3),
        ),
    )


def compute_grouping_time_s(job: FieldJob, swath_grouping: FormationGrouping) -> float:
    """Seconds for a grouping by the paths that would be driven, row after row; infinite if a path is missing."""
    work = sum(max(slot.swath_pass.swath.length_m for slot in slots) for slots in swath_grouping.rounds)
    turns = sum(_compute_turns_s(job, before, after) for before, after in pairwise(swath_grouping.rounds))
    if not swath_grouping.rounds:
        return math.inf
    turns += job.estimate_entrance_time_s(
        swath_grouping.rounds[0][0].swath_pass, swath_grouping.rounds[-1][-1].swath_pass
    )
    single_order = order_leftover_swaths(job, swath_grouping)
    work += sum(swath_pass.swath.length_m for swath_pass in single_order)
    turns += sum(
        _compute_path_s(job, a, b)
        for a, b in pairwise([find_leader(swath_grouping.rounds[-1]).swath_pass, *single_order])
    )
    return work / job.driving_rules.work_speed_mps + turns


def _compute_turns_s(job: FieldJob, before: FormationRound, after: FormationRound) -> float:
    """Seconds until the tractors of one round are in the next, row after row."""
    last_passes = {slot.tractor: slot.swath_pass for slot in before}
    row_times_s: dict[int, float] = {}
    for slot in after:
        if slot.tractor in last_passes:
            row_times_s[slot.row] = max(
                row_times_s.get(slot.row, 0.0), _compute_path_s(job, last_passes[slot.tractor], slot.swath_pass)
            )
    return sum(row_times_s.values())


def _compute_path_s(job: FieldJob, a: SwathPass, b: SwathPass) -> float:
    """Seconds of the path between two passes; infinite for none."""
    path = job.find_path(job.get_exit_pose(a), job.get_entry_pose(b))
    return math.inf if path is None else job.connector.compute_cost_s(path)
