"""Gates of a replanned plan: which remain, how they count legs, and where tractors wait.

A new plan starts where all tractors are, and may make one wait there. A driving tractor has moved on when the plan is
accepted, so it waits at the end of its base at the earliest. A tractor that stands by order waits where it stands: the
fleet manager holds it until its gates open.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from planner.fleet.manager.remaining_work import RemainingWork
from planner.fleet.model.errors import FleetManagerError
from planner.fleet.safety.base_release import is_passed
from vehicle.missions.plan import ENTER, FollowOrder, Leg, LegGate, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun


def move_waiting_places(
    remaining: RemainingWork, run: SimulationRun, simulate: Callable[[Plan], SimulationRun]
) -> SimulationRun:
    """Move gates so that no driving tractor waits on its base, and simulate again; legs count from the present ones.

    Raises FleetManagerError, with the tractor to pause, if the plan does not reach its end then.
    """
    plan, drive_on = move_gates(remaining, run.plan)
    if plan is run.plan:
        return run
    rerun = simulate(plan)
    if rerun.outcome == DONE:
        return rerun
    if drive_on:
        tractor_names = " and ".join(f"tractor {number + 1}" for number in drive_on)
        raise FleetManagerError(
            f"{tractor_names.capitalize()} would have to wait on legs already being driven: pause {tractor_names} and "
            "replan once all paused tractors stand; resume them after you accept the plan.",
            parameter="without",
        )
    raise FleetManagerError(
        "The remaining work cannot be planned from where tractors stand: they would wait for each other. Resume "
        "paused tractors, and replan.",
        parameter="without",
    )


def move_gates(remaining: RemainingWork, plan: Plan) -> tuple[Plan, list[int]]:
    """The plan with gates on base legs moved to where tractors can wait, and which of these tractors drive on; the same
    plan if there are none."""
    missions, drive_on, has_changed = list(plan.missions), [], False
    for number, mission in enumerate(plan.missions):
        state = remaining.states[number]
        base_count = max(state.base_end - state.leg, 1 if remaining.has_tractor_driven(number) else 0)
        if not any(gate.tractor not in remaining.excluded for leg in mission.legs[:base_count] for gate in leg.gates):
            continue
        place = 0 if remaining.states[number].is_standing else base_count
        if place:
            drive_on.append(number)
        if base_count == 1 and place == 0:
            continue  # it already waits where it stands
        missions[number], has_changed = Mission(_gather_gates_on_leg(mission.legs, base_count, place)), True
    return (Plan(tuple(missions), plan.notes) if has_changed else plan), drive_on


def _gather_gates_on_leg(legs: tuple[Leg, ...], base_count: int, place: int) -> tuple[Leg, ...]:
    """Legs with the gates of the first `base_count` moved to leg `place`, or dropped if there is no such leg; of gates
    on one tractor only the last to open remains."""
    last_gates: dict[int, LegGate] = {}
    for gate in (gate for leg in (*legs[:base_count], *legs[place : place + 1]) for gate in leg.gates):
        known_gate = last_gates.setdefault(gate.tractor, gate)
        last_gates[gate.tractor] = max(known_gate, gate, key=lambda each: (each.leg, each.after_m))
    free_legs = [replace(leg, gates=()) if k < base_count else leg for k, leg in enumerate(legs)]
    if place < len(free_legs):
        free_legs[place] = replace(free_legs[place], gates=tuple(last_gates.values()))
    return tuple(free_legs)


def drop_stale_gates(missions: Sequence[tuple[Leg, ...]], ends: Sequence[int]) -> list[tuple[Leg, ...]]:
    """Drop gates on, and follow orders of, legs that no longer exist."""

    def drop_stale(leg: Leg) -> Leg:
        gates = tuple(gate for gate in leg.gates if gate.leg < ends[gate.tractor])
        follow = leg.follow if leg.follow and leg.follow.leg < ends[leg.follow.tractor] else None
        return replace(leg, gates=gates, follow=follow)

    return [tuple(drop_stale(leg) for leg in legs) for legs in missions]


def drop_open_gates(leg: Leg, remaining: RemainingWork) -> Leg:
    """A leg without open gates, and without gates on or following of excluded tractors."""
    gates = tuple(g for g in _find_gates(leg, remaining) if not is_passed(g, remaining.states))
    follow = leg.follow
    if follow is not None and (
        follow.tractor in remaining.excluded or remaining.states[follow.tractor].leg > follow.leg
    ):
        follow = None
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
