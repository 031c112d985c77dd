"""Whether all tractors can get home from where they stand if one moves at a time, and which gates prevent it."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fields.arrays import Flags, Floats, Integers
from planner.traffic.conflict_zones import ConflictTable, ConflictZones
from planner.traffic.deadlock_search import (
    ScheduleNet,
    fill_safe_pair,
    fill_safe_pairs,
    find_last_passes,
    find_way_home,
    is_pair_safe,
)
from planner.traffic.trajectories import SoloTrajectory
from vehicle.missions.plan import FollowOrder, LegGate, Plan

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
            state, stuck = self.start.copy(), self._find_stuck_pair()
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

    def _find_stuck_pair(self) -> tuple[int, int] | None:
        """The first two that would not get home if they were alone on the field."""
        return next((pair for pair in combinations(range(len(self.start)), 2) if not self._can_finish(*pair)), None)

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
