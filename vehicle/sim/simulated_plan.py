"""Simulated plans and solo runs: what one tractor drives alone on the field, and what a fleet drives of that.

Tractors depend on each other by gates, by orders to follow and where they touch. As long as none of this matters, a
tractor drives the same in a fleet as alone, bit for bit, so that either run gives the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from vehicle.arrays import Floats, Records
from vehicle.jit import compile_function
from vehicle.missions.plan import LegGate, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.records import DT_S, FINISHED, REC_ANGLE, REC_STATUS, REC_X, REC_Y, STATE
from vehicle.sim.clearance import find_too_close
from vehicle.sim.loop import MIN_PROGRESS_M
from vehicle.sim.world import STALL_S, WorldSnapshot

CORNER_SPEED_RATIO = 3.0  # largest speed of a corner over that of its tractor
ROUNDING_FACTOR = 1.01  # margin for the rounding of sums


@dataclass(eq=False)
class SimulatedPlan:
    """A simulated plan, the progress at which the legs of each tractor end (m), and snapshots of its run.

    `fine_progress_m` is the progress of each tractor (m, (n,)) every second after some snapshots, by their index.
    `is_independent` is whether each tractor was driven as if it were alone.
    """

    plan: Plan
    leg_ends_m: Sequence[Floats]
    snapshots: list[WorldSnapshot] = field(default_factory=list)
    fine_progress_m: dict[int, list[Floats]] = field(default_factory=dict)
    is_independent: bool = False

    @cached_property
    def progress_m(self) -> Floats:
        """Progress of each tractor at the snapshots (m), (k, n)."""
        progress_m = np.array([snapshot.states["progress"] for snapshot in self.snapshots])
        return progress_m.reshape(len(self.snapshots), self.plan.tractors)

    def compute_opening_m(self, gate: LegGate) -> float:
        """Progress (m) of the tractor that a gate waits for, when it opens."""
        return (float(self.leg_ends_m[gate.tractor][gate.leg - 1]) if gate.leg else 0.0) + gate.after_m


@dataclass(frozen=True, eq=False)
class SoloRun:
    """The run of a tractor alone, the progress at which its legs end (m), and snapshots by their step.

    Snapshots are without their rows, and with the number of the tractor in them.
    """

    run: SimulationRun
    leg_ends_m: Floats
    snapshots: dict[int, tuple[WorldSnapshot, int]]

    @property
    def mission(self) -> Mission:
        """The mission of the tractor."""
        return self.run.plan.missions[0]


def extract_solo_run(
    run: SimulationRun,
    tractor: int,
    leg_ends_m: Floats,
    snapshots: Sequence[tuple[WorldSnapshot, int]],
    max_time_s: float,
) -> SoloRun | None:
    """One tractor of a run in which all were independent; None if the tractor's own run could end differently.

    That is if it is not done within `max_time_s`, or may have stalled.
    """
    finish = float(run.finish_s[tractor])
    if not finish + 0.5 * DT_S < max_time_s or not _is_progressing(snapshots, finish):
        return None
    rows = int(np.argmax(run.record[:, tractor, REC_STATUS] == FINISHED)) + 1
    solo_run = SimulationRun(
        plan=Plan((run.plan.missions[tractor],)),
        outcome=DONE,
        time_s=run.time_s[:rows],
        record=run.record[:rows, tractor : tractor + 1],
        finish_s=run.finish_s[tractor : tractor + 1],
        contacts=(),
        min_clearance_m=np.inf,
        roll_over=run.roll_over[tractor : tractor + 1],
    )
    before = ((snapshot, place) for snapshot, place in snapshots if snapshot.rows <= rows)
    own_snapshots = {snapshot.step: (replace(snapshot, chunks=()), place) for snapshot, place in before}
    return SoloRun(solo_run, leg_ends_m, own_snapshots)


def _is_progressing(snapshots: Sequence[tuple[WorldSnapshot, int]], finish_s: float) -> bool:
    """Whether a tractor makes progress, or stands to refill or unload, between all snapshots until it is done.

    If snapshots are at most half the stall time apart, no stall can have gone unnoticed.
    """
    times, progress_m, stands_still = [0.0], [0.0], [False]
    for snapshot, tractor in snapshots:
        if snapshot.time_s < finish_s:
            times.append(snapshot.time_s)
            progress_m.append(float(snapshot.states["progress"][tractor]))
            stands_still.append(bool(snapshot.states["stand_left"][tractor] > 0.0))
    is_sampled_often = all(after - before <= 0.5 * STALL_S for before, after in pairwise([*times, finish_s]))
    has_moved = (after > before + MIN_PROGRESS_M for before, after in pairwise(progress_m))
    return is_sampled_often and all(
        moved or any(pair) for moved, pair in zip(has_moved, pairwise(stands_still), strict=True)
    )


def combine_solo_runs(solo_runs: Sequence[SoloRun]) -> SimulatedPlan:
    """A fleet of tractors that each drive as if alone, with the snapshots that all of them have."""
    steps = set.intersection(*(set(solo_run.snapshots) for solo_run in solo_runs))
    rows = ([solo_run.snapshots[step] for solo_run in solo_runs] for step in sorted(steps))
    plan = Plan(tuple(solo_run.mission for solo_run in solo_runs))
    leg_ends_m = [solo_run.leg_ends_m for solo_run in solo_runs]
    return SimulatedPlan(plan, leg_ends_m, [_join_snapshots(parts) for parts in rows], is_independent=True)


def _join_snapshots(parts: Sequence[tuple[WorldSnapshot, int]]) -> WorldSnapshot:
    first, count = parts[0][0], len(parts)
    states = np.empty(count, dtype=STATE)
    for row, (snapshot, tractor) in enumerate(parts):
        states[row] = snapshot.states[tractor]
    motion = np.array([snapshot.motion[tractor] for snapshot, tractor in parts])
    return _build_independent_snapshot(first, states, motion, ())


def _build_independent_snapshot(
    snapshot: WorldSnapshot, states: Records, motion: Floats, chunks: Sequence[Floats]
) -> WorldSnapshot:
    """A snapshot with other tractors, which touch nobody, as if they had made progress at the last check."""
    clock = np.array([snapshot.clock[0], states["progress"].sum(), snapshot.time_s])
    clearances, present = np.full(len(states), np.inf), np.zeros(len(states), dtype=np.bool_)
    return WorldSnapshot(clock, states, clearances, motion, present, chunks, snapshot.rows)


def select_tractors(snapshot: WorldSnapshot, tractors: Sequence[int]) -> WorldSnapshot:
    """A snapshot of some of its tractors, which must not depend on the others."""
    chunks = [rows[:, tractors] for rows in snapshot.list_record_parts()]
    return _build_independent_snapshot(snapshot, snapshot.states[tractors], snapshot.motion[tractors], chunks)


def find_last_independent_snapshot(
    combined: SimulatedPlan,
    solo_runs: Sequence[SoloRun],
    snapshot_count: int,
    models: Records,
    clearance_limits_m: tuple[float, float],
    reach_m: float,
) -> WorldSnapshot | None:
    """The last of the first `snapshot_count` snapshots of a fleet up to which its tractors drive as if alone.

    They do until two come too close by `clearance_limits_m` (vehicle.sim.clearance.find_too_close), or so close that
    they may touch before the next check, until which a tractor drives at most `reach_m`. After the snapshot all make
    progress, so that the time of the last progress does not matter. None if there is no such snapshot.
    """
    if snapshot_count < 2:
        return None
    rows = combined.snapshots[snapshot_count - 1].rows
    record = np.concatenate([solo_run.run.record[:rows] for solo_run in solo_runs], axis=1)
    clearances = np.full(len(solo_runs), np.inf)
    leaves = np.array([solo_run.mission.leaves for solo_run in solo_runs])
    limits_m = (*clearance_limits_m, CORNER_SPEED_RATIO * reach_m)
    states = np.zeros(len(solo_runs), dtype=STATE)
    free_rows = _count_independent_rows(record, states, leaves, models, clearances, *limits_m)
    for number in range(snapshot_count - 2, -1, -1):
        begin, end = combined.snapshots[number], combined.snapshots[number + 1]
        gained = combined.progress_m[number + 1].sum() - combined.progress_m[number].sum()
        if end.rows <= free_rows and gained > ROUNDING_FACTOR * MIN_PROGRESS_M * (end.rows - begin.rows):
            driven = record[: begin.rows]
            clearances[:] = np.inf
            _count_independent_rows(driven, states, leaves, models, clearances, *limits_m)
            return replace(begin, clearances=clearances, chunks=(driven,))
    return None


@compile_function
def _count_independent_rows(  # type: ignore[no-untyped-def]
    record, states, leaves, models, clearances, stop_clearance_m, beside_clearance_m, min_clearance_m
):
    """Number of rows of a record before two are too close or may touch; updates `clearances` (n,)."""
    for row in range(len(record)):
        for i in range(len(states)):
            states[i].x, states[i].y = record[row, i, REC_X], record[row, i, REC_Y]
            states[i].angle = record[row, i, REC_ANGLE]
            states[i].away = 1 if leaves[i] and record[row, i, REC_STATUS] == FINISHED else 0
        _, first, _ = find_too_close(states, models, clearances, stop_clearance_m, beside_clearance_m)
        if first >= 0 or clearances.min() < min_clearance_m:
            return row
    return len(record)
