"""Whether all tractors can get home from where they stand if one moves at a time, and which gates prevent it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.traffic.conflict_zones import ConflictTable, ConflictZones
from planner.traffic.deadlock_search import (
    ScheduleNet,
    can_finish_by_turns,
    can_finish_one_by_one,
    find_last_passes,
    find_last_waits,
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

    `dropped_gates` are gates that are ignored, as (tractor, leg, gate): with them nobody would get home. `net` is the
    input of traffic.deadlock_search.
    """

    def __init__(self, plan: Plan, zones: ConflictZones, *, deep: bool = False) -> None:
        """For the gates of a plan, none of them dropped yet; `deep` as in traffic.deadlock_search."""
        self.deep = deep
        self.zones, self.trajectories = zones, zones.trajectories
        self.final_holds: FleetState = tuple(trajectory.segment_count for trajectory in self.trajectories)
        self.waits, self.waits_on = _list_waits(plan, self.trajectories)
        self.dropped_gates: list[tuple[int, int, LegGate]] = []
        bounds = [self._list_next_waits(tractor) for tractor in range(len(self.trajectories))]
        self.net = self._build_net(np.concatenate(bounds))

    def drop_deadlocked_gates(self) -> bool:
        """Drop gates of the plan, none if possible, until all get home from the start, one at a time.

        Returns False if that does not help.
        """
        state = np.zeros(len(self.final_holds), dtype=np.int64)
        if can_finish_one_by_one(self.net, state):
            return True
        for _ in range(MAX_DROPPED_GATES):
            if can_finish_by_turns(self.net, state.copy(), self.deep, state):
                return True
            dropped = self._find_blocking_waits(state.tolist())
            if not dropped:
                return False
            for tractor, wait in dropped:
                self.waits[tractor, int(state[tractor])].remove(wait)
                if wait.gate is not None:
                    self.dropped_gates.append((tractor, wait.leg, wait.gate))
            self.net = self._build_net(self.net.bound)
        return False

    def _find_blocking_waits(self, state: Sequence[int]) -> list[tuple[int, PlannedWait]]:
        """Closed gates of tractors that block another which they wait for."""
        waiting = [
            (tractor, wait)
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
                blocker_waits = [pair for pair in waiting if pair[0] == blocker]
                if any(wait.tractor == tractor for _, wait in blocker_waits):
                    return [pair for pair in waiting if pair[1].tractor == tractor]
                if blocker_waits:
                    return blocker_waits
        return []

    def _list_next_waits(self, tractor: int) -> list[int]:
        """For each hold point the next one at which a tractor waits for others by plan."""
        bounds, last = [], self.final_holds[tractor]
        for number in range(self.final_holds[tractor], -1, -1):
            bounds.append(last)
            last = number if (tractor, number) in self.waits else last
        return bounds[::-1]

    def _build_net(self, next_waits: npt.NDArray[np.int64]) -> ScheduleNet:
        """The input of the search, with the gates that are not dropped."""
        zones = self.zones
        base, tables = zones.base, (zones.apart, zones.stands, zones.blockers)
        owner = np.repeat(np.arange(len(base) - 1), np.diff(base))
        rows = [
            (int(base[tractor]) + number, int(base[wait.tractor]) + wait.segment, wait.after_s)
            for (tractor, number), tractor_waits in sorted(self.waits.items())
            for wait in tractor_waits
        ]
        wait_rows = np.array(rows, dtype=np.float64).reshape(-1, 3)
        places = wait_rows[:, :2].astype(np.int64)
        waits = ConflictTable.from_rows(places[:, 0], places[:, 1], np.repeat(wait_rows[:, 2:], 2, axis=1), len(owner))
        apart, stands, blockers = ((table.start, table.at, table.span_s) for table in tables)
        return ScheduleNet(
            base,
            owner,
            zones.begins_s,
            *apart,
            *stands,
            *blockers,
            waits.start,
            waits.at,
            np.ascontiguousarray(waits.span_s[:, 0]),
            next_waits,
            find_last_passes(base, owner, zones.stands.start, zones.stands.at),
            find_last_waits(base, owner, waits.start, waits.at),
            zones.interacts,
        )


def _list_waits(
    plan: Plan, trajectories: list[SoloTrajectory]
) -> tuple[dict[TractorSegment, list[PlannedWait]], npt.NDArray[np.bool_]]:
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
