"""Who goes first: the gates by which tractors of a plan give way, from what each would do alone on the field.

Paths are given, and every tractor may stand at its hold points. Tractors are moved from hold point to hold point in the
order of time. One enters a segment if no part of it is used by others meanwhile, nobody stands in its way, and all
could still get home, one moving at a time, if everybody then stopped; if that holds at the start, no two wait for each
other for ever. What makes a tractor wait, or nearly does, becomes a gate; other gates of the plan are respected.
timetable_search computes the times. Who goes first decides about much that follows, so several timetables are tried, in
which tractors go a little earlier or later in the order, and the quickest is taken.
"""

from __future__ import annotations

import random
from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fields.arrays import Floats
from planner.traffic.conflict_zones import ConflictZones, find_conflict_zones
from planner.traffic.deadlock_avoidance import DeadlockAvoidance
from planner.traffic.timetable_search import (
    GAP_AHEAD_S,
    GAP_BEHIND_S,
    MAX_CHAIN,
    START_LOSS_S,
    TIME_TOLERANCE_S,
    fill_timetable,
)
from planner.traffic.trajectories import SoloSimulation, TrajectoryCache, get_trajectories
from vehicle.missions.plan import LegGate, Mission, Plan
from vehicle.sim.path_conflicts import ClearanceCheck

EAGERNESS = (0.0, 0.5, 1.0)
"""How the next tractor is picked: by when it can go on (0) or, the more eager (1), by how long it has waited."""
SMALL_FLEET_TRACTORS = 4  # for whom every eagerness is tried, however long their plan
MOST_TIMETABLES = 12  # tried, of which the quickest is taken
MOST_TABLE_EFFORT = 60_000  # of all of them, in segments times tractors: large fleets get few
MOST_LEAD_S = 60.0  # that a draw adds to the lead of a tractor, or takes from it


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
    return Plan(tuple(missions), plan.notes | {"loosened": len(dropped_places)}) if dropped else plan


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
