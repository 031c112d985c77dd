"""When the tractors of a round leave the queue so that all are in place soonest (OR-Tools CP-SAT).

The input is how each tractor passes the headland on its way to the round, measured in a run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from strategies.formations.formation import Formation
from strategies.formations.slots import FormationSlot
from strategies.program.field_job import FieldJob
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import REC_ANGLE, REC_PLACE, REC_X, REC_Y
from vehicle.sim.compile import compute_contact_boxes

if TYPE_CHECKING:
    from ortools.sat.python import cp_model


SEGMENT_M = 1.5
LINE_TOLERANCE_M = 1.0  # a tractor is on the headland if any part of it is less than this before the line
PLACE_TOLERANCE_M = 0.3
TICKS_PER_S = 10
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class HeadlandPassage:
    """One tractor's path through a headland after its release, measured in a run.

    `segment_times_s` maps a segment of the headland to (first, last) seconds on it, `distance_m` (t,) is the distance
    driven at 10 Hz, `placed_s` the time at which the tractor is in place.
    """

    tractor: int
    segment_times_s: dict[int, tuple[float, float]]
    distance_m: Floats
    placed_s: float


def measure_passages(
    job: FieldJob, formation: Formation, run: SimulationRun, number: int, tractor: Tractor, implement: Implement
) -> list[HeadlandPassage]:
    """The passages of all tractors of a round, in the order of its slots."""
    return [
        _measure_passage(job, formation, run, number, slot, tractor, implement) for slot in formation.rounds[number]
    ]


def _measure_passage(
    job: FieldJob,
    formation: Formation,
    run: SimulationRun,
    number: int,
    slot: FormationSlot,
    tractor: Tractor,
    implement: Implement,
) -> HeadlandPassage:
    """One tractor's passage from the record, with the times at which its outline covers each segment."""
    marks = formation.marks[number, slot.tractor]
    legs = run.get_leg_numbers(slot.tractor)
    first, last = int(np.argmax(legs >= marks.release_leg)), int(np.argmax(legs >= marks.work_leg))
    poses = run.get_poses(slot.tractor)[first : max(last, first + 2)]
    along, across = measure_outline_extents(job, slot, poses, tractor, implement)
    line_m = _project_headland_line_m(job, slot)
    segment_times_s: dict[int, tuple[float, float]] = {}
    for index in np.flatnonzero(along > line_m - LINE_TOLERANCE_M):
        low, high = across[index]
        for segment in range(math.floor(low / SEGMENT_M), math.floor(high / SEGMENT_M) + 1):
            start = segment_times_s.get(segment, (index / TICKS_PER_S, 0.0))[0]
            segment_times_s[segment] = start, (index + 1) / TICKS_PER_S
    distance_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, REC_PLACE], axis=0).T))))
    placed = int(np.argmax(distance_m > distance_m[-1] - PLACE_TOLERANCE_M))
    return HeadlandPassage(slot.tractor, segment_times_s, distance_m, placed / TICKS_PER_S)


def measure_outline_extents(
    job: FieldJob, slot: FormationSlot, poses: Floats, tractor: Tractor, implement: Implement
) -> tuple[Floats, Floats]:
    """How far the outline reaches out of the swath (t,), and its extent along the headland (t, 2), in metres."""
    heading = job.compute_heading(slot.swath_pass) + math.pi  # out of the track just worked is against the coming pass
    outward = np.array([math.cos(heading), math.sin(heading)])
    sideward = np.array([-outward[1], outward[0]]) * (1 if slot.swath_pass.direction > 0 else -1)
    corners = _list_corners(compute_contact_boxes(tractor, implement))
    cosine, sine = np.cos(poses[:, REC_ANGLE]), np.sin(poses[:, REC_ANGLE])
    x = poses[:, REC_X, None] + corners[:, 0] * cosine[:, None] - corners[:, 1] * sine[:, None]
    y = poses[:, REC_Y, None] + corners[:, 0] * sine[:, None] + corners[:, 1] * cosine[:, None]
    along = (x * outward[0] + y * outward[1]).max(axis=1)
    across = x * sideward[0] + y * sideward[1]
    return along, np.column_stack([across.min(axis=1), across.max(axis=1)])


def _list_corners(boxes: dict[str, float]) -> Floats:
    """Corners of the boxes of tractor and implement (8, 2), forward and to the left of the centre of mass (m)."""
    ends = {"nose": "half_width", "tail": "half_width", "tool_front": "tool_half_width", "tool_tail": "tool_half_width"}
    return np.array([[boxes[end], sign * boxes[half]] for end, half in ends.items() for sign in (1, -1)])


def _project_headland_line_m(job: FieldJob, slot: FormationSlot) -> float:
    """The headland line of the coming pass, measured out of the field (m)."""
    x, y, heading = job.get_entry_pose(slot.swath_pass)
    return -(x * math.cos(heading) + y * math.sin(heading))


ReleaseDistances = Mapping[tuple[int, int], tuple[tuple[int, float], ...]]
"""By (round, tractor): the others it waits for, and how far each must be past its own release (m)."""


def optimise_releases(
    number: int, passages: list[HeadlandPassage], slots: tuple[FormationSlot, ...], hold_s: float
) -> ReleaseDistances:
    """Optimal releases of one round, as distances the others must have driven since their own releases."""
    release_ticks = _solve_releases(passages, slots, hold_s)
    by_time = sorted(range(len(passages)), key=lambda i: (release_ticks[i], slots[i].row, i))
    releases: dict[tuple[int, int], tuple[tuple[int, float], ...]] = {}
    for place, own_index in enumerate(by_time):
        gates = []
        for other_index in by_time[:place]:
            lag_s = (release_ticks[own_index] - release_ticks[other_index]) / TICKS_PER_S
            if lag_s > 0 and passages[own_index].segment_times_s.keys() & passages[other_index].segment_times_s.keys():
                distances_m = passages[other_index].distance_m
                gates.append(
                    (
                        passages[other_index].tractor,
                        float(distances_m[min(round(lag_s * TICKS_PER_S), len(distances_m) - 1)]),
                    )
                )
        releases[number, passages[own_index].tractor] = tuple(gates)
    return releases


def _solve_releases(passages: list[HeadlandPassage], slots: tuple[FormationSlot, ...], hold_s: float) -> list[int]:
    """Release of each tractor in ticks: all in place soonest, then released soonest, no segment shared."""
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    ticks = [math.ceil(passage.placed_s * TICKS_PER_S) for passage in passages]
    horizon = sum(ticks) + round(hold_s * TICKS_PER_S) * len(passages) * 2
    release = [model.new_int_var(0, horizon, f"release_{i}") for i in range(len(passages))]
    segment_intervals: dict[int, list[cp_model.IntervalVar]] = {}
    for start, passage in zip(release, passages, strict=True):
        for segment, (first, last) in sorted(passage.segment_times_s.items()):
            begin = math.floor(first * TICKS_PER_S)
            length = math.ceil((last + hold_s) * TICKS_PER_S) - begin
            interval = model.new_fixed_size_interval_var(start + begin, length, "")
            segment_intervals.setdefault(segment, []).append(interval)
    place = {slot.tractor: index for index, slot in enumerate(slots)}
    for index, slot in enumerate(slots):
        if slot.neighbour is not None:
            model.add(release[index] >= release[place[slot.neighbour]])
    for segment in sorted(segment_intervals):
        model.add_no_overlap(segment_intervals[segment])
    placed = model.new_int_var(0, horizon + max(ticks), "placed")
    for start, length in zip(release, ticks, strict=True):
        model.add(placed >= start + length)
    model.minimize(placed * (horizon * len(passages) + 1) + sum(release))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.catch_sigint_signal = (
        False  # the solver would consume the signal, so that only its own search ends
    )
    solver.parameters.random_seed = 1
    solver.parameters.max_deterministic_time = 2.0
    status = solver.solve(model)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return _compute_sequential_releases(ticks)
    return [solver.value(var) for var in release]


def _compute_sequential_releases(ticks: list[int]) -> list[int]:
    """Releases without any overlap, for a solver that ran out of time."""
    starts = [0]
    for length in ticks[:-1]:
        starts.append(starts[-1] + length)
    return starts
