"""A new plan of a fleet driven from where all tractors are, and joined to what they have driven so far; which gates
remain, and how they count legs.

A driving tractor has moved on when the plan is accepted, so it waits at the end of its base at the earliest. A tractor
that stands by order may wait where it stands: the fleet manager holds it until its gates open.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fields.arrays import SHORTEST_PIECE_M
from fields.errors import HeadlandError
from planner.evaluation.candidates.energy_figures import find_service_conflict
from planner.evaluation.candidates.fleet_drive import FleetDriver
from planner.evaluation.context import PlanningContext
from planner.fleet.manager.remaining_work import STAND_TOLERANCE_M, RemainingWork
from planner.fleet.model.fleet_plan import FleetPlan, build_timed_missions
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import is_passed
from strategies.service_stops.service_gates import add_service_gates, list_stops, note_stops
from vehicle.missions.plan import ENTER, FollowOrder, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun

STUB_LENGTH_M = 0.02  # an excluded tractor drives this far in the simulation: it stands in the way
ROAD_M = 1e4


class RestDriver:
    """Drives what is left of missions from where all tractors are; they give way to one another."""

    def __init__(self, remaining: RemainingWork, context: PlanningContext) -> None:
        self._remaining, self._context = remaining, context
        drivers = (n for n, state in enumerate(remaining.states) if not state.is_standing)
        self._on_way = frozenset(number for number in drivers if remaining.count_base_legs(number) > 0)
        self._driver = FleetDriver(context, beside=True, at_once=self._on_way)

    def measure_alone_s(self, missions: Sequence[tuple[Leg, ...]]) -> list[float]:
        """Seconds that every tractor drives with nobody in its way; 0 for one that does not finish."""
        return self._driver.measure_alone_s(self._build_plan(missions))

    def drive(self, missions: Sequence[tuple[Leg, ...]]) -> SimulationRun:
        """The run of all that is left, with tractors served one at a time where only one can be.

        Raises FleetManagerError if conflicts remain, with the tractor to pause if one would have to wait on its base.
        """
        try:
            run, conflict = self._driver.drive(self._build_plan(missions))
        except HeadlandError as refusal:
            raise self._refuse(f"The remaining work cannot be planned: {refusal}") from None
        if conflict is not None or run.outcome != DONE:
            raise self._refuse(f"The remaining work cannot be planned: {conflict or run.outcome}.")
        # nobody may have to wait on legs that are driven or released
        remaining, waiting = self._remaining, list[int]()
        for number, mission in enumerate(run.plan.missions):
            first = 0 if number in self._on_way else 1
            base = mission.legs[first : remaining.count_base_legs(number)]
            if any(gate.tractor not in remaining.excluded for leg in base for gate in leg.gates):
                waiting.append(number)
        if waiting:
            tractor_names = _name_tractors(waiting)
            raise FleetManagerError(
                f"{tractor_names.capitalize()} would have to wait on legs that must be finished: pause {tractor_names} "
                "and replan once all paused tractors stand; resume them after you accept the plan.",
                parameter="without",
            )
        crowding = find_service_conflict(run, self._context.supply)
        if crowding is not None:
            raise FleetManagerError(f"The remaining work cannot be planned: {crowding}.")
        return run

    def _refuse(self, sentence: str) -> FleetManagerError:
        """A refusal, with what may help where tractors drive, as these cannot wait."""
        names = _name_tractors(sorted(self._on_way - set(self._remaining.excluded)))
        advice = [f"It may help to pause {names}, and to replan once all stand."] if names else []
        return FleetManagerError(" ".join([sentence, *advice]))

    def _build_plan(self, missions: Sequence[tuple[Leg, ...]]) -> Plan:
        plan, supply = _build_plan_from_here(self._remaining, missions), self._context.supply
        if supply is None:
            return plan
        width_m = self._context.request.width_m
        return add_service_gates(plan, (list_stops(one.legs, supply, width_m) for one in plan.missions), supply)


def _name_tractors(numbers: Sequence[int]) -> str:
    return " and ".join(f"tractor {number + 1}" for number in numbers)


def _build_plan_from_here(remaining: RemainingWork, missions: Sequence[tuple[Leg, ...]]) -> Plan:
    """The remaining plan from where all tractors are; leg k counts from the present leg."""
    missions_from_here = []
    for number, (legs, state) in enumerate(zip(missions, remaining.states, strict=True)):
        if remaining.stays(number, len(legs)):  # in the way of the others where it is; one on the road is far away
            x, y, heading = remaining.get_pose(number)
            place = np.array([x - ROAD_M * (number + 1) if remaining.is_on_road(number) else x, y])
            stub = np.array([place, place + STUB_LENGTH_M * np.array([math.cos(heading), math.sin(heading)])])
            missions_from_here.append(Mission((Leg(stub, 1.0, ground=legs[0].ground, task=LegTask()),)))
            continue
        first_leg = cut_leg(legs[state.leg], state.leg_m) if remaining.has_tractor_driven(number) else legs[0]
        rows = [first_leg, *legs[state.leg + 1 :]]
        for k in range(remaining.count_base_legs(number)):
            rows[k] = replace(rows[k], may_wait=False)
        missions_from_here.append(Mission(tuple(renumber_leg_gates(leg, remaining, -1) for leg in rows)))
    return Plan(tuple(missions_from_here))


def cut_leg(leg: Leg, done_m: float) -> Leg:
    """The part of a leg that remains."""
    rest = leg.cut(min(done_m, leg.length_m - SHORTEST_PIECE_M), leg.length_m)
    stand_s, fold_s = (leg.stand_s, leg.fold_s) if done_m <= STAND_TOLERANCE_M else (0.0, 0.0)  # it may have just come
    return rest.copy_with(gates=(), may_wait=leg.may_wait, stand_s=stand_s, fold_s=fold_s)


def build_whole_plan(
    remaining: RemainingWork, context: PlanningContext, missions: Sequence[tuple[Leg, ...]], run: SimulationRun
) -> FleetPlan:
    """Join the legs driven so far and those of the run into one plan."""
    width_m = context.request.width_m
    plan, timed_run, whole_missions, timed_missions = remaining.plan, build_timed_missions(run.plan, run), [], []
    for number, legs in enumerate(missions):
        present_leg, new_legs = remaining.states[number].leg, run.plan.missions[number].legs
        first_count = 1 if remaining.has_tractor_driven(number) else 0
        is_standing = remaining.stays(number, len(legs))
        past_count = len(legs) if is_standing else present_leg + first_count
        past_legs = [replace(leg, gates=(), follow=None) for leg in legs[:past_count]]
        if first_count and not is_standing:  # a standing tractor may have to wait where it is
            present_gates = renumber_leg_gates(new_legs[0], remaining, 1).gates
            past_legs[-1] = replace(past_legs[-1], gates=present_gates)
        future = slice(first_count, first_count if is_standing else None)
        whole_mission = Mission((*past_legs, *(renumber_leg_gates(leg, remaining, 1) for leg in new_legs[future])))
        whole_missions.append(whole_mission)
        past_seconds = remaining.states[number].mission.leg_seconds[: len(past_legs)]
        timed_missions.append(TimedMission(whole_mission, (*past_seconds, *timed_run[number].leg_seconds[future])))
    whole = Plan(tuple(whole_missions), plan.plan.notes)
    if (supply := context.supply) is not None:
        whole = note_stops(whole, [list_stops(one.legs, supply, width_m) for one in whole_missions], supply)
    saved = replace(plan.saved, plan=whole)
    finish = tuple(remaining.elapsed_s + float(seconds) for seconds in run.finish_s)
    return replace(
        plan,
        saved=saved,
        timed_missions=tuple(timed_missions),
        finish_s=finish,
        min_clearance_m=min(plan.min_clearance_m, run.min_clearance_m),
    )


def drop_settled_gates(leg: Leg, remaining: RemainingWork, ends: Sequence[int]) -> Leg:
    """A leg without open gates, without gates on or following of excluded tractors, and without those of legs that no
    longer exist: each tractor keeps as many as in `ends`."""
    found = (gate for gate in _find_gates(leg, remaining) if gate.leg < ends[gate.tractor])
    gates = tuple(gate for gate in found if not is_passed(gate, remaining.states))
    follow = leg.follow
    if follow is not None:
        is_over = remaining.states[follow.tractor].leg > follow.leg or follow.leg >= ends[follow.tractor]
        follow = None if is_over or follow.tractor in remaining.excluded else follow
    return replace(leg, gates=gates, follow=follow)


def _find_gates(leg: Leg, remaining: RemainingWork) -> list[LegGate]:
    """The gates of a leg on tractors that still drive; at the entrance an excluded one passes on its own gates."""
    gates = []
    for gate in leg.gates:
        if gate.tractor not in remaining.excluded:
            gates.append(gate)
        elif leg.task.kind == ENTER and not remaining.has_tractor_driven(gate.tractor):
            gates += _find_gates(remaining.plan.timed_missions[gate.tractor].legs[0], remaining)
    return gates


def renumber_leg_gates(leg: Leg, remaining: RemainingWork, sign: int) -> Leg:
    """Renumber the gates of a leg: counted from the present legs (`sign` -1), or from the start again (1).

    Nobody waits for excluded tractors: their stubs in the simulation say nothing about the real ones.
    """

    def shift_place(tractor: int, number: int, distance_m: float) -> tuple[int, float]:
        state = remaining.states[tractor]
        is_present_leg = number == (state.leg if sign < 0 else 0)
        return number + sign * state.leg, max(distance_m + (sign * state.leg_m if is_present_leg else 0.0), 0.0)

    awaited_gates = (gate for gate in leg.gates if gate.tractor not in remaining.excluded)
    gates = tuple(LegGate(g.tractor, *shift_place(g.tractor, g.leg, g.after_m)) for g in awaited_gates)
    follow = leg.follow
    if follow is not None:
        follow = FollowOrder(follow.tractor, shift_place(follow.tractor, follow.leg, 0.0)[0], follow.gap_m)
    return replace(leg, gates=gates, follow=follow)
