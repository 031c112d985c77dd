"""Who goes first: the gates by which tractors of a plan give way, from what each would do alone on the field.

Paths are given, and every tractor may stand at its hold points. Tractors are moved from hold point to hold point in the
order of time. One enters a segment if no part of it is used by others meanwhile, nobody stands in its way, and all
could still get home, one moving at a time, if everybody then stopped; if that holds at the start, no two wait for each
other for ever. What makes a tractor wait, or nearly does, becomes a gate; other gates of the plan are respected.
timetable_search computes the times. Who goes first decides about much that follows, so several timetables are tried, in
which tractors go a little earlier or later in the order, and the quickest is taken.
"""

from __future__ import annotations

import math
import random
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers
from planner.traffic.conflict_zones import ConflictTable, ConflictZones, find_conflict_zones
from planner.traffic.deadlock_search import (
    ScheduleNet,
    fill_safe_pair,
    fill_safe_pairs,
    find_last_passes,
    find_way_home,
    is_pair_safe,
)
from planner.traffic.timetable_search import (
    GAP_AHEAD_S,
    GAP_BEHIND_S,
    MAX_CHAIN,
    START_LOSS_S,
    TIME_TOLERANCE_S,
    fill_timetable,
)
from planner.traffic.trajectories import SoloSimulation, SoloTrajectory, TrajectoryCache, get_trajectories
from vehicle.missions.plan import FollowOrder, LegGate, Mission, Plan
from vehicle.sim.path_conflicts import ClearanceCheck

EAGERNESS = (0.0, 0.5, 1.0)
"""How the next tractor is picked: by when it can go on (0) or, the more eager (1), by how long it has waited."""
SMALL_FLEET_TRACTORS = 4  # for whom every eagerness is tried, however long their plan
MOST_TIMETABLES = 12  # tried, of which the quickest is taken
MOST_TABLE_EFFORT = 60_000  # of all of them, in segments times tractors: large fleets get few
MOST_LEAD_S = 60.0  # that a draw adds to the lead of a tractor, or takes from it
MAX_DROPPED_GATES = 80  # times that gates of the plan are dropped to undo a deadlock
FOLLOW_DELAY_S = 4.0  # after this time the tractor followed is far enough ahead
FleetState = tuple[int, ...]
"""The hold point each tractor stands at."""
TractorSegment = tuple[int, int]
"""(tractor, number of the segment)."""


@dataclass(frozen=True)
class PlannedWait:
    """Not before `tractor` has been on its segment `segment` for `after_s`: a gate of the plan on a leg.

    `gate` is None if it comes from a follow order: a tractor that follows another stops while that one stands.
    """

    leg: int
    gate: LegGate | None
    tractor: int
    segment: int
    after_s: float


class DeadlockAvoidance:
    """Finds ways home. `waits` are gates by the segment they stand before, `waits_on` (n, n) tells who waits for whom.

    `start` (n,) are the hold points at which all stand. `dropped_gates` are gates that are ignored, as (tractor, leg,
    gate): with them nobody would get home. `net` is the input of traffic.deadlock_search. `way` is a way home from the
    start, by the tractor of each segment, once drop_deadlocked_gates has found one.
    """

    def __init__(self, plan: Plan, zones: ConflictZones, at_once: Collection[int] = ()) -> None:
        """For the gates of a plan, none of them dropped yet; those `at_once` are on their first segment."""
        self.zones, self.trajectories = zones, zones.trajectories
        self.final_holds: FleetState = tuple(trajectory.segment_count for trajectory in self.trajectories)
        self.start = np.isin(np.arange(len(self.trajectories)), list(at_once)).astype(np.int64)
        self.waits, self.waits_on = _list_waits(plan, self.trajectories)
        self.dropped_gates: list[tuple[int, int, LegGate]] = []
        self.net = self._build_net()
        self.way = np.empty(sum(self.final_holds) - int(self.start.sum()), dtype=np.int64)

    def drop_deadlocked_gates(self) -> bool:
        """Drop gates of the plan, none if possible, until all get home from the start if one moves at a time.

        Returns False if that does not help.
        """
        for _ in range(MAX_DROPPED_GATES):
            # The first two that would not get home if they were alone on the field.
            pairs = combinations(range(len(self.start)), 2)
            state, stuck = self.start.copy(), next((pair for pair in pairs if not self._can_finish(*pair)), None)
            if stuck is None and find_way_home(self.net, self.start, state, self.way):
                return True
            dropped = self._choose_pair_wait(*stuck) if stuck else self._find_blocking_waits(state.tolist())
            if not dropped:
                return False
            for segment, wait in dropped:
                self.waits[segment].remove(wait)
                if wait.gate is not None:
                    self.dropped_gates.append((segment[0], wait.leg, wait.gate))
                self._renew_waits(*sorted((segment[0], wait.tractor)))
        return False

    def _can_finish(self, one: int, other: int) -> bool:
        """Whether two would get home if they were alone on the field."""
        return bool(is_pair_safe(self.net, one, self.start[one], other, self.start[other]))

    def _choose_pair_wait(self, one: int, other: int) -> list[tuple[TractorSegment, PlannedWait]]:
        """The gate to drop between two that never get home: without which they do, or do from most states."""
        waits = [
            (segment, wait)
            for segment, segment_waits in sorted(self.waits.items())
            for wait in segment_waits
            if {segment[0], wait.tractor} == {one, other} and wait.gate is not None
        ]
        best, most_safe = waits[:1], -1
        for segment, wait in waits:
            number = self.waits[segment].index(wait)
            del self.waits[segment][number]
            self._renew_waits(one, other)
            self.waits[segment].insert(number, wait)
            # From how many states of two they get home if they are alone; more than there are if also from the start.
            first, holds = self.net.safe_start[one, other], np.diff(self.zones.base)
            size = int(holds[one] * holds[other])
            safe = int(self.net.safe[first : first + size].sum()) + size * self._can_finish(one, other)
            if safe > most_safe:
                best, most_safe = [(segment, wait)], safe
        return best

    def _find_blocking_waits(self, state: Sequence[int]) -> list[tuple[TractorSegment, PlannedWait]]:
        """Closed gates of tractors that block another which they wait for."""
        waiting = [
            ((tractor, state[tractor]), wait)
            for tractor in range(len(state))
            for wait in self.waits.get((tractor, state[tractor]), ())
            if state[wait.tractor] <= wait.segment and wait.gate is not None
        ]
        base, blockers = self.zones.base, self.zones.blockers
        for tractor, final_hold in enumerate(self.final_holds):
            if state[tractor] == final_hold:
                continue
            place = int(base[tractor]) + state[tractor]
            places = blockers.at[blockers.start[place] : blockers.start[place + 1]].tolist()
            for blocker in (
                other_tractor
                for other_tractor, number in enumerate(state)
                if int(base[other_tractor]) + number in places
            ):
                blocker_waits = [pair for pair in waiting if pair[0][0] == blocker]
                if any(wait.tractor == tractor for _, wait in blocker_waits):
                    return [pair for pair in waiting if pair[1].tractor == tractor]
                if blocker_waits:
                    return blocker_waits
        return []

    def _build_net(self) -> ScheduleNet:
        """The input of the search, with all gates."""
        zones = self.zones
        base, tables = zones.base, (zones.apart, zones.stands, zones.blockers)
        owner = np.repeat(np.arange(len(base) - 1), np.diff(base))
        apart, stands, blockers = ((table.start, table.at, table.span_s) for table in tables)
        # Where the table of every two that interact begins in `ScheduleNet.safe` (-1: none), and the size of all.
        holds = np.diff(self.zones.base)
        sizes = np.where(np.triu(self.zones.interacts | self.waits_on | self.waits_on.T, 1), np.outer(holds, holds), 0)
        ends = np.cumsum(sizes).reshape(sizes.shape)
        safe_start, size = np.where(sizes > 0, ends - sizes, -1), int(ends[-1, -1])
        net = ScheduleNet(
            base,
            owner,
            zones.begins_s,
            *apart,
            *stands,
            *blockers,
            *self._build_waits(owner),
            find_last_passes(base, owner, zones.stands.start, zones.stands.at),
            zones.interacts,
            safe_start,
            np.zeros(size, np.bool_),
        )
        fill_safe_pairs(net)
        return net

    def _build_waits(self, owner: Integers) -> tuple[Integers, Integers, Floats]:
        """The gates that are not dropped, as `waits` of ScheduleNet."""
        base = self.zones.base
        rows = [
            (int(base[tractor]) + number, int(base[wait.tractor]) + wait.segment, wait.after_s)
            for (tractor, number), tractor_waits in sorted(self.waits.items())
            for wait in tractor_waits
        ]
        wait_rows = np.array(rows, dtype=np.float64).reshape(-1, 3)
        places = wait_rows[:, :2].astype(np.int64)
        waits = ConflictTable.from_rows(places[:, 0], places[:, 1], np.repeat(wait_rows[:, 2:], 2, axis=1), len(owner))
        after_s = np.ascontiguousarray(waits.span_s[:, 0])
        return waits.start, waits.at, after_s

    def _renew_waits(self, one: int, other: int) -> None:
        """Take the gates as they are now, after some between two were changed."""
        names = "waits_start", "waits_at", "waits_s"
        self.net = self.net._replace(**dict(zip(names, self._build_waits(self.net.owner), strict=True)))
        fill_safe_pair(self.net, one, other)


def _list_waits(
    plan: Plan, trajectories: list[SoloTrajectory]
) -> tuple[dict[TractorSegment, list[PlannedWait]], Flags]:
    """What segments wait for, and who waits for whom; in a large fleet many wait for the same place."""
    waits: dict[TractorSegment, list[PlannedWait]] = {}
    passings: dict[LegGate, tuple[int, float]] = {}
    waits_on = np.zeros((len(trajectories), len(trajectories)), dtype=np.bool_)
    for tractor, (mission, trajectory) in enumerate(zip(plan.missions, trajectories, strict=True)):
        for number, leg in enumerate(trajectory.hold_legs[:-1]):
            for gate in mission.legs[leg].gates:
                if gate not in passings:
                    passings[gate] = trajectories[gate.tractor].locate_passing(gate.leg, gate.after_m)
                waits.setdefault((tractor, number), []).append(PlannedWait(leg, gate, gate.tractor, *passings[gate]))
                waits_on[tractor, gate.tractor] = True
        for number, follower_leg in enumerate(mission.legs):
            if (
                follower_leg.follow is not None
                and (wait := _find_follow_wait(trajectories, tractor, number, follower_leg.follow)) is not None
            ):
                waits.setdefault((tractor, wait.leg), []).append(wait)
                waits_on[tractor, wait.tractor] = True
    return waits, waits_on


def _find_follow_wait(
    trajectories: list[SoloTrajectory], tractor: int, leg: int, follow: FollowOrder
) -> PlannedWait | None:
    """What a follower waits for, and before which of its segments, if it stops short of the end of its leg.

    It does if the tractor it follows stands at the end of its own leg and is less than the gap ahead.
    """
    ends = []
    for number, next_leg in ((tractor, leg + 1), (follow.tractor, follow.leg + 1)):
        if next_leg not in trajectories[number].hold_legs[:-1]:
            return None
        ends.append(trajectories[number].hold_legs.index(next_leg))
    own_pose, followed_pose = (
        trajectories[n].poses[trajectories[n].holds[end]]
        for n, end in zip((tractor, follow.tractor), ends, strict=True)
    )
    ahead_m = (followed_pose["x"] - own_pose["x"]) * math.cos(own_pose["angle"]) + (
        followed_pose["y"] - own_pose["y"]
    ) * math.sin(own_pose["angle"])
    if ahead_m >= follow.gap_m:
        return None
    return PlannedWait(ends[0], None, follow.tractor, ends[1], FOLLOW_DELAY_S)


@dataclass(frozen=True)
class Timetable:
    """When each tractor begins each of its segments, when it is done, and the gates before legs that enforce it."""

    begins_s: list[list[float]]
    free_s: list[float]
    gates: list[tuple[int, int, LegGate]]

    @property
    def duration_s(self) -> float:
        """When the last tractor is done (s)."""
        return max(self.free_s)


class PrecedenceSearch:
    """Finds a timetable for the trajectories of a plan."""

    def __init__(self, plan: Plan, zones: ConflictZones, at_once: Collection[int] = ()) -> None:
        """For a plan of which those `at_once` drive already."""
        self.plan, self.zones, self.trajectories = plan, zones, zones.trajectories
        self.deadlock_avoidance = DeadlockAvoidance(plan, zones, at_once)

    def find_timetable(self) -> Timetable | None:
        """The quickest timetable; None if tractors stand so that they could not even get home one after another.

        Gates of the plan that would prevent that are dropped (DeadlockAvoidance.dropped_gates).
        """
        best = self._find_quickest() if self.deadlock_avoidance.drop_deadlocked_gates() else None
        if best is None:
            return None
        begun_s, free_s, gates = best
        base = self.zones.base.tolist()  # by numbered places; a timetable goes by tractors, legs and metres
        begins = [begun_s[first : end - 1].tolist() for first, end in pairwise(base)]
        return Timetable(begins, free_s.tolist(), [self._build_gate(*gate) for gate in gates.tolist()])

    def _find_quickest(self) -> tuple[Floats, Floats, Floats] | None:
        """The quickest of some timetables, by each eagerness and then with other leads; None without any.

        Leads are drawn around those of the quickest before, until the last to finish waits for nobody.
        """
        net, count = self.deadlock_avoidance.net, len(self.trajectories)
        alone_s = net.begins_s[self.zones.base[1:] - 1] - net.begins_s[self.zones.base[:-1]]
        least_s = alone_s.max() + START_LOSS_S + TIME_TOLERANCE_S
        least = len(EAGERNESS) if count <= SMALL_FLEET_TRACTORS else 1
        tries = min(MOST_TIMETABLES, max(MOST_TABLE_EFFORT // (count * len(net.owner)), least))
        draw, best, eager, leads_s = random.Random(1), None, EAGERNESS[0], np.zeros(count)
        for number in range(tries):
            most_s, tried = (0.0, EAGERNESS[number]) if number < len(EAGERNESS) else (MOST_LEAD_S, eager)
            tried_s = leads_s + [draw.uniform(-most_s, most_s) for _ in range(count)]
            table = self._fill_timetable(tried, tried_s)
            if np.isnan(table[1]).any() or (best and _rank_timetable(table[1]) >= _rank_timetable(best[1])):
                continue
            best, eager, leads_s = table, tried, tried_s
            if best[1].max() <= least_s:
                break
        return best

    def _fill_timetable(self, eager: float, leads_s: Floats) -> tuple[Floats, Floats, Floats]:
        """A timetable in which the earliest possible entry comes next (timetable_search.fill_timetable)."""
        net = self.deadlock_avoidance.net
        max_spans = MAX_CHAIN * int(np.max(np.diff(net.apart_start) + np.diff(net.blockers_start)))
        is_concerned = net.near | self.deadlock_avoidance.waits_on
        how = eager, leads_s, self.deadlock_avoidance.start, self.deadlock_avoidance.way
        return fill_timetable(net, is_concerned, max_spans, (GAP_BEHIND_S, GAP_AHEAD_S), *how)  # type: ignore[no-any-return]

    def _build_gate(self, own_segment: float, other_segment: float, after_s: float) -> tuple[int, int, LegGate]:
        """The gate before a segment that opens when another has been begun for `after_s`, with tractor and leg."""
        owner, base = self.deadlock_avoidance.net.owner, self.zones.base
        tractor, other_tractor = int(owner[int(own_segment)]), int(owner[int(other_segment)])
        gate = self.trajectories[other_tractor].build_segment_gate(
            other_tractor, int(other_segment - base[other_tractor]), after_s, self.plan.missions[other_tractor]
        )
        return tractor, self.trajectories[tractor].hold_legs[int(own_segment - base[tractor])], gate


def _rank_timetable(free_s: Floats) -> tuple[int, int]:
    """Sort key of timetables: when the last tractor is done, then the sum over all."""
    return round(float(free_s.max())), round(sum(free_s.tolist()))


def schedule_plan(
    plan: Plan,
    check: ClearanceCheck,
    simulate_alone: SoloSimulation,
    cache: TrajectoryCache | None = None,
    at_once: Collection[int] = (),
) -> Plan | None:
    """The plan with gates so that no tractors meet; None if no order was found.

    Those `at_once`, by number, are on their way and cannot wait where they are. `cache` holds results for the same
    machine and clearance.
    """
    trajectories = get_trajectories(plan, simulate_alone, cache)
    if trajectories is None:
        return None
    gated_legs = [{n for n, leg in enumerate(mission.legs) if leg.gates} for mission in plan.missions]
    precedence = PrecedenceSearch(plan, find_conflict_zones(trajectories, check, gated_legs, cache), at_once)
    table = precedence.find_timetable()
    if table is None:
        return None
    return _add_gates(_drop_gates(plan, precedence.deadlock_avoidance.dropped_gates), table.gates)


def _drop_gates(plan: Plan, dropped: list[tuple[int, int, LegGate]]) -> Plan:
    """The plan without the dropped gates; the note `loosened` counts the legs that are no longer waited for."""
    missions, dropped_places = list(plan.missions), {(gate.tractor, gate.leg) for _, _, gate in dropped}
    for tractor, leg, gate in dropped:
        legs = list(missions[tractor].legs)
        remaining_gates = tuple(leg_gate for leg_gate in legs[leg].gates if leg_gate is not gate)
        legs[leg] = replace(legs[leg], gates=remaining_gates)
        missions[tractor] = Mission(tuple(legs))
    return Plan(tuple(missions), replace(plan.notes, loosened=len(dropped_places))) if dropped else plan


def _add_gates(plan: Plan, gates: list[tuple[int, int, LegGate]]) -> Plan:
    """The plan with gates at (tractor, leg); of several for one leg on the same tractor only the last one is used."""
    latest_gates: dict[tuple[int, int, int], LegGate] = {}
    for tractor, leg, gate in gates:
        key = tractor, leg, gate.tractor
        if key not in latest_gates or (latest_gates[key].leg, latest_gates[key].after_m) < (gate.leg, gate.after_m):
            latest_gates[key] = gate
    for (tractor, leg, _), gate in latest_gates.items():
        plan = plan.copy_with_gate(tractor, leg, gate)
    return plan
