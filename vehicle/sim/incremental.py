"""Simulates plans of one fleet one after another, each from where it first differs from an earlier plan.

A plan is simulated again with other gates, or composed anew with other legs. Up to the first changed leg nothing
differs, so the run continues from a snapshot of the earlier one, with the same result bit for bit; a changed gate
counts only if it was still closed when its tractor came in sight of it. The earlier run is the last one, the last that
was completed, or a fleet of tractors that were driven alone.

Tractors depend on each other by gates, by orders to follow and where they touch. As long as none of this matters, a
tractor drives the same in a fleet as alone, bit for bit, so that either run gives the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from fields.arrays import Floats, Records
from vehicle.control.guidance import ARRIVAL_TOLERANCE_M
from vehicle.control.speed_profile import BRAKE_SHARE, STEERING_DISTANCE_FACTOR
from vehicle.jit import compile_function
from vehicle.missions.plan import FollowOrder, Leg, LegGate, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Implement, Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import DT_S, FINISHED, REC_ANGLE, REC_STATUS, REC_X, REC_Y, STATE
from vehicle.sim.clearance import build_start_distances, find_too_close
from vehicle.sim.compile import LOOKAHEAD_SWING_RAD
from vehicle.sim.loop import MIN_PROGRESS_M
from vehicle.sim.world import STALL_S, World, WorldSnapshot

SNAPSHOT_INTERVAL_S = 60.0  # of simulated time
FINE_INTERVAL_S = 1.0  # to find out which of two tractors came first
MAX_SPEED_RATIO = 1.5  # upper bound of a speed over that of the fastest leg
AIM_MARGIN_M = 1.0  # upper bound of the distance from the point of progress to the guided point, with position errors
CORNER_SPEED_RATIO = 3.0  # largest speed of a corner over that of its tractor
ROUNDING_FACTOR = 1.01  # margin for the rounding of sums


class IncrementalSimulator:
    """Simulates plans of a fleet; arguments as of World and World.run. `resumed_at_s` is where the last run began."""

    def __init__(
        self,
        tractor: Tractor,
        implement: Implement,
        *,
        stop_clearance_m: float,
        beside_clearance_m: float | None = None,
        terrain: Terrain | None = None,
        load: WorkLoad | None = None,
        position_errors: Any = None,
        seed: int = 1,
    ) -> None:
        self.tractor, self.implement = tractor, implement
        self.stop_clearance_m, self.beside_clearance_m = stop_clearance_m, beside_clearance_m
        self.terrain, self.load = terrain, load
        self.position_errors, self.seed = position_errors, seed
        self.resumed_at_s = 0.0
        self._last_plan: SimulatedPlan | None = None
        self._last_finished_plan: SimulatedPlan | None = None
        self._solo_runs: dict[int, SoloRun] = {}
        self._solo_fleet: tuple[list[SoloRun], SimulatedPlan] | None = None

    def simulate(self, plan: Plan, max_time_s: float) -> SimulationRun:
        """The run of a plan, the same as a new World would give."""
        world = self._build_world(plan)
        candidates = [
            self._list_common_snapshots(earlier, plan, max_time_s)
            for earlier in (self._last_plan, self._last_finished_plan)
            if earlier is not None
        ]
        current = SimulatedPlan(plan, world.leg_ends_m, max(candidates, key=_get_last_time_s, default=[]))
        self.resumed_at_s = self._resume(world, current, max_time_s)

        def keep_snapshot(_: float) -> None:
            snapshot = world.take_snapshot()
            if snapshot is not None:
                current.snapshots.append(snapshot)

        run = world.run(
            stop_clearance_m=self.stop_clearance_m,
            beside_clearance_m=self.beside_clearance_m,
            max_time_s=max_time_s,
            progress=keep_snapshot,
            chunk_s=SNAPSHOT_INTERVAL_S,
        )
        current.snapshots = [entry.attach_to_record(run.record) for entry in current.snapshots]
        self._last_plan = current
        if run.outcome == DONE:
            self._last_finished_plan = current
        return run

    def _resume(self, world: World, current: SimulatedPlan, max_time_s: float) -> float:
        """Let a world go on from the last snapshot known of its plan, and the time of it (s); 0 at the start.

        What was driven alone is no snapshot of the fleet: it takes the place of those that it is later than.
        """
        start = self._find_solo_start(current.plan, max_time_s, world.models)
        if start is not None and start.time_s > _get_last_time_s(current.snapshots):
            current.snapshots = []
        else:
            start = current.snapshots[-1] if current.snapshots else None
        if start is None:
            return 0.0
        world.restore(start)
        return start.time_s

    def simulate_alone(self, plan: Plan, tractors: Sequence[int], max_times_s: Sequence[float]) -> list[SimulationRun]:
        """Runs of some tractors of a plan without waiting, each alone on the field and for `max_times_s` at most.

        They share a world, but for one that is not done by then or may have stalled, and with position errors, which
        are drawn per tractor.
        """
        if self.position_errors is not None and len(self.position_errors):
            limits = zip(tractors, max_times_s, strict=True)
            return [self.simulate_mission(plan.missions[tractor], max_s) for tractor, max_s in limits]
        unchanged = ((n, entry) for n, entry in self._solo_runs.items() if n < plan.tractors and n not in tractors)
        self._solo_runs = {n: entry for n, entry in unchanged if _has_same_legs(entry, plan.missions[n])}
        self._solo_fleet = None
        world = self._build_world(Plan(tuple(plan.missions[tractor] for tractor in tractors)))
        earlier_plans = self._last_plan, self._last_finished_plan
        shared = max((self._list_shared_snapshots(earlier, plan, tractors) for earlier in earlier_plans), key=len)
        snapshots = [(entry, list(tractors)) for entry in shared]
        if shared:
            world.restore(select_tractors(shared[-1], tractors))

        def keep_snapshot(_: float) -> None:
            snapshot = world.take_snapshot()
            if snapshot is not None:
                snapshots.append((snapshot, list(range(len(tractors)))))

        run = world.run(
            independent=True, max_time_s=max(max_times_s), progress=keep_snapshot, chunk_s=SNAPSHOT_INTERVAL_S
        )
        runs = list[SimulationRun]()
        for place, (tractor, leg_ends_m, max_s) in enumerate(zip(tractors, world.leg_ends_m, max_times_s, strict=True)):
            own_snapshots = [(entry, places[place]) for entry, places in snapshots]
            solo_run = extract_solo_run(run, place, leg_ends_m, own_snapshots, max_s)
            if solo_run is not None:
                self._solo_runs[tractor] = solo_run
            runs.append(solo_run.run if solo_run else self.simulate_mission(plan.missions[tractor], max_s))
        return runs

    def simulate_mission(self, mission: Mission, max_time_s: float) -> SimulationRun:
        """The run of one tractor in a World of its own."""
        return self._build_world(Plan((mission,))).run(max_time_s=max_time_s)

    def _list_shared_snapshots(
        self, earlier: SimulatedPlan | None, plan: Plan, tractors: Sequence[int]
    ) -> list[WorldSnapshot]:
        """The snapshots of a run up to which some tractors met no difference between its plan and another."""
        if earlier is None or earlier.plan.tractors != plan.tractors or not earlier.snapshots:
            return []
        same_counts, count = count_same_paths(earlier.plan, plan), len(earlier.snapshots)
        for tractor in tractors:
            before, mission = earlier.plan.missions[tractor], plan.missions[tractor]
            sight_m = self._compute_lookahead_bound_m(before, mission)
            for leg in range(max(len(before.legs), len(mission.legs))):
                links = (before.legs[leg], mission.legs[leg]) if leg < same_counts[tractor] else None
                if links and has_same_leg_references(*links, same_counts):
                    continue
                limit = (float(earlier.leg_ends_m[tractor][leg - 1]) if leg else 0.0) - sight_m
                unseen = int(np.count_nonzero(earlier.progress_m[:, tractor] < limit))
                if unseen >= count:
                    break
                gates = _find_differing_gates(*links, same_counts) if links else None
                if gates is None or not self._has_opened_before(earlier, tractor, limit, gates):
                    count = unseen
                    break
            if not count:
                return []
        return earlier.snapshots[:count]

    def _find_solo_start(self, plan: Plan, max_time_s: float, models: Records) -> WorldSnapshot | None:
        """The last snapshot up to which the solo runs of the tractors, if known, give the run of a plan."""
        runs = ((self._solo_runs.get(number), mission) for number, mission in enumerate(plan.missions))
        solo_runs = [solo_run for solo_run, mission in runs if solo_run and _has_same_legs(solo_run, mission)]
        if len(solo_runs) < plan.tractors:
            return None
        if self._solo_fleet is None or self._solo_fleet[0] != solo_runs:
            self._solo_fleet = solo_runs, combine_solo_runs(solo_runs)
        combined = self._solo_fleet[1]
        reach_m = _compute_fastest_mps(plan.missions) / self.tractor.guidance.rate_hz
        stop = self.stop_clearance_m
        limits = stop, stop if self.beside_clearance_m is None else self.beside_clearance_m
        snapshot_count = len(self._list_common_snapshots(combined, plan, max_time_s))
        return find_last_independent_snapshot(combined, solo_runs, snapshot_count, models, limits, reach_m)

    def _build_world(self, plan: Plan) -> World:
        return World(
            plan, self.tractor, self.implement, terrain=self.terrain, load=self.load,
            position_errors=self.position_errors, seed=self.seed,
        )  # fmt: skip

    def _list_common_snapshots(self, earlier: SimulatedPlan, plan: Plan, max_time_s: float) -> list[WorldSnapshot]:
        """The snapshots of a run up to which no tractor met a difference between its plan and another."""
        shared = self._list_shared_snapshots(earlier, plan, range(plan.tractors))
        return [snapshot for snapshot in shared if snapshot.time_s < max_time_s]

    def _has_opened_before(self, earlier: SimulatedPlan, tractor: int, limit_m: float, gates: set[LegGate]) -> bool:
        """Whether gates opened in a run before the progress of a tractor reached `limit_m`, where it sees them."""
        snapshot_count = int(np.count_nonzero(earlier.progress_m[:, tractor] < limit_m))

        def has_passed(progress: Records) -> bool:
            return all(progress[gate.tractor] >= earlier.compute_opening_m(gate) for gate in gates)

        if snapshot_count and has_passed(earlier.progress_m[snapshot_count - 1]):
            return True
        if not 0 < snapshot_count < len(earlier.snapshots) or not has_passed(earlier.progress_m[snapshot_count]):
            return False
        fine_rows = self._simulate_finely(earlier, snapshot_count - 1)
        return any(has_passed(progress_m) for progress_m in fine_rows if progress_m[tractor] < limit_m)

    def _simulate_finely(self, earlier: SimulatedPlan, index: int) -> list[Records]:
        """Progress of each tractor (m) every second until the next snapshot of a run."""
        if index not in earlier.fine_progress_m:
            world = self._build_world(earlier.plan)
            world.restore(earlier.snapshots[index])
            earlier.fine_progress_m[index] = progress_rows = []
            world.run(
                stop_clearance_m=self.stop_clearance_m,
                beside_clearance_m=self.beside_clearance_m,
                chunk_s=FINE_INTERVAL_S,
                max_time_s=earlier.snapshots[index + 1].time_s,
                independent=earlier.is_independent,
                progress=lambda _: progress_rows.append(world.program.states["progress"].copy()),
            )
        return earlier.fine_progress_m[index]

    def _compute_lookahead_bound_m(self, *missions: Mission) -> float:
        """Upper bound of how far ahead (m) of its progress a tractor reacts to its legs.

        These are the stopping distance (vehicle.control.guidance.compute_allowed_speed) and the distance of the point
        it steers for, which is measured from the antenna even where progress is counted from the rear axle.
        """
        fastest = _compute_fastest_mps(missions)
        guidance = self.tractor.guidance
        braking_m = fastest * fastest / (2.0 * BRAKE_SHARE * self.tractor.speed.max_acceleration_mps2)
        steering_m = STEERING_DISTANCE_FACTOR * guidance.turn_lookahead_m
        stop_m = braking_m + steering_m + 1.0 + 2.0 * ARRIVAL_TOLERANCE_M
        ahead_m = fastest * LOOKAHEAD_SWING_RAD / math.radians(self.tractor.steering.rate_deg_per_s)
        lookahead_m = max(guidance.lookahead_m, guidance.turn_lookahead_m, ahead_m)
        aim_m = lookahead_m + abs(self.tractor.antenna_forward_m) + AIM_MARGIN_M
        return max(stop_m, aim_m)


def _compute_fastest_mps(missions: Sequence[Mission]) -> float:
    """Upper bound of the speeds of missions."""
    return MAX_SPEED_RATIO * max(leg.speed_mps for mission in missions for leg in mission.legs)


def _get_last_time_s(snapshots: list[WorldSnapshot]) -> float:
    return snapshots[-1].time_s if snapshots else 0.0


def _has_same_legs(solo_run: SoloRun, mission: Mission) -> bool:
    """Whether a mission has the same legs as that of a solo run."""
    legs = solo_run.mission.legs
    return len(legs) == len(mission.legs) and all(map(_has_same_path, legs, mission.legs))


def count_same_paths(before: Plan, after: Plan) -> list[int]:
    """Number of legs at the start of each mission that are the same in two plans of as many tractors, apart from gates
    and orders to follow."""
    pairs = [list(zip(a.legs, b.legs, strict=False)) for a, b in zip(before.missions, after.missions, strict=True)]
    return [next((n for n, (a, b) in enumerate(pair) if not _has_same_path(a, b)), len(pair)) for pair in pairs]


def has_same_leg_references(a: Leg, b: Leg, same_counts: Sequence[int]) -> bool:
    """Whether two legs wait for and follow the same, given the number of same legs of each tractor."""
    return a is b or _collect_leg_references(a, same_counts) == _collect_leg_references(b, same_counts)


def _find_differing_gates(a: Leg, b: Leg, same_counts: Sequence[int]) -> set[LegGate] | None:
    """The gates that only one of two legs has; None if they differ in more, or name legs that differ."""
    (gates, follow, late), (later_gates, leader, later) = (_collect_leg_references(leg, same_counts) for leg in (a, b))
    return None if late or later or follow != leader else gates ^ later_gates


def _has_same_path(a: Leg, b: Leg) -> bool:
    """Whether two legs are the same apart from gates and order to follow."""
    if a is b:
        return True
    traits, other_traits = (
        (leg.speed_mps, leg.gear, leg.implement, leg.ground, leg.task.kind, leg.standing_s, len(leg.points))
        for leg in (a, b)
    )
    return traits == other_traits and (a.points is b.points or bool((a.points == b.points).all()))


def _collect_leg_references(leg: Leg, same_counts: Sequence[int]) -> tuple[set[LegGate], FollowOrder | None, bool]:
    """Gates and order to follow on the first `same_counts` legs of tractors, and whether there are later gates."""
    gates = {gate for gate in leg.gates if gate.leg < same_counts[gate.tractor]}
    follow = leg.follow if leg.follow and leg.follow.leg < same_counts[leg.follow.tractor] else None
    return gates, follow, len(gates) < len(set(leg.gates))


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
        start_m = float(self.leg_ends_m[gate.tractor][gate.leg - 1]) if gate.leg else 0.0
        return gate.compute_opening_m(start_m, self.plan.missions[gate.tractor].legs)


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
    start_distances = np.full((len(states), len(states)), np.inf)
    return WorldSnapshot(clock, states, clearances, start_distances, motion, present, chunks, snapshot.rows)


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
    leaves = np.array([solo_run.mission.leaves for solo_run in solo_runs])
    limits_m = (*clearance_limits_m, CORNER_SPEED_RATIO * reach_m)

    def follow(rows: Records) -> tuple[int, Floats, Floats]:
        """The number of rows up to which all drive as if alone, with the distances that a world would have noted."""
        clearances = np.full(len(solo_runs), np.inf)
        start_distances = build_start_distances([solo_run.mission.enters for solo_run in solo_runs])
        states = np.zeros(len(solo_runs), dtype=STATE)
        free = _count_independent_rows(rows, states, leaves, models, clearances, start_distances, *limits_m)
        return free, clearances, start_distances

    free_rows, _, _ = follow(record)
    for number in range(snapshot_count - 2, -1, -1):
        begin, end = combined.snapshots[number], combined.snapshots[number + 1]
        gained = combined.progress_m[number + 1].sum() - combined.progress_m[number].sum()
        if end.rows <= free_rows and gained > ROUNDING_FACTOR * MIN_PROGRESS_M * (end.rows - begin.rows):
            driven = record[: begin.rows]
            _, clearances, start_distances = follow(driven)
            return replace(begin, clearances=clearances, start_distances=start_distances, chunks=(driven,))
    return None


@compile_function
def _count_independent_rows(  # type: ignore[no-untyped-def]
    record, states, leaves, models, clearances, start_distances, stop_clearance_m, beside_clearance_m, min_clearance_m
):
    """Number of rows of a record before two are too close, wherever they began, or may touch; updates `clearances` (n,)
    and `start_distances` (n, n)."""
    for i in range(len(states)):
        states[i].progress = math.inf
    for row in range(len(record)):
        for i in range(len(states)):
            states[i].x, states[i].y = record[row, i, REC_X], record[row, i, REC_Y]
            states[i].angle = record[row, i, REC_ANGLE]
            states[i].away = 1 if leaves[i] and record[row, i, REC_STATUS] == FINISHED else 0
        _, first, _ = find_too_close(states, models, clearances, start_distances, stop_clearance_m, beside_clearance_m)
        if first >= 0 or clearances.min() < min_clearance_m:
            return row
    return len(record)
