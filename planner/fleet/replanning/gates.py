"""Gates of a replanned plan: which remain, and how they count legs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from planner.fleet.manager.remaining_work import RemainingWork
from planner.fleet.safety.base_release import is_passed
from vehicle.missions.plan import ENTER, FollowOrder, Leg, LegGate


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
