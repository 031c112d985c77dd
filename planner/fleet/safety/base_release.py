"""Which legs a tractor may drive: base and horizon, as in VDA 5050 (6.1).

The base is never taken back, and reaches only a little ahead. A leg joins it once the leg before has, its gates are
open by what the other tractors have really driven, and nothing blocks it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from planner.fleet.model.rules import FleetRules
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import TractorState
from vehicle.missions.plan import LegGate


def is_passed(gate: LegGate, states: Sequence[TractorState]) -> bool:
    """Whether a tractor has reached the place that a gate waits for."""
    awaited = states[gate.tractor]
    return awaited.done or (awaited.leg, awaited.leg_m) >= (gate.leg, gate.after_m) or awaited.leg > gate.leg


def find_closed_gates(timed_mission: TimedMission, leg: int, states: Sequence[TractorState]) -> list[LegGate]:
    """The gates of a leg that are not open yet."""
    return [gate for gate in timed_mission.legs[leg].gates if not is_passed(gate, states)]


def find_gates_closed_on_base(
    timed_mission: TimedMission, state: TractorState, states: Sequence[TractorState]
) -> list[LegGate]:
    """Closed gates for which a tractor stands on a base leg; only replanned plans have them."""
    return find_closed_gates(timed_mission, state.leg, states) if state.leg < state.base_end else []


def compute_base_end(
    number: int,
    timed_missions: Sequence[TimedMission],
    states: Sequence[TractorState],
    blocked: Mapping[int, str],
    rules: FleetRules,
) -> int:
    """The number of legs in the base of a tractor now, at least as many as before."""
    state, timed_mission = states[number], timed_missions[number]
    reach_m = _compute_base_reach_m(state, timed_mission, rules)
    base_end = state.base_end
    while base_end < len(timed_mission.legs) and base_end not in blocked:
        if (
            base_end > state.leg
            and timed_mission.leg_starts_m[base_end] - _compute_mission_position_m(state, timed_mission) > reach_m
        ):
            break
        if find_closed_gates(timed_mission, base_end, states):
            break
        base_end += 1
    return base_end


def find_awaited_legs(
    number: int, timed_missions: Sequence[TimedMission], states: Sequence[TractorState], rules: FleetRules
) -> list[tuple[int, int]]:
    """The (tractor, leg) that a tractor near the end of its base waits for."""
    state, timed_mission = states[number], timed_missions[number]
    closed_here = [] if state.done else find_gates_closed_on_base(timed_mission, state, states)
    if closed_here:
        return _list_unique_legs(closed_here)
    if state.done or state.base_end >= len(timed_mission.legs):
        return []
    if timed_mission.leg_starts_m[state.base_end] - _compute_mission_position_m(
        state, timed_mission
    ) > _compute_base_reach_m(state, timed_mission, rules):
        return []
    return _list_unique_legs(find_closed_gates(timed_mission, state.base_end, states))


def _list_unique_legs(gates: Sequence[LegGate]) -> list[tuple[int, int]]:
    """The (tractor, leg) of gates, without repeats: two gates may wait for two places on one leg."""
    return list(dict.fromkeys((gate.tractor, gate.leg) for gate in gates))


def _compute_mission_position_m(state: TractorState, timed_mission: TimedMission) -> float:
    return timed_mission.leg_starts_m[min(state.leg, len(timed_mission.legs))] + state.leg_m


def _compute_base_reach_m(state: TractorState, timed_mission: TimedMission, rules: FleetRules) -> float:
    """How far ahead the base reaches, metres."""
    speed = max(timed_mission.legs[min(state.leg, len(timed_mission.legs) - 1)].speed_mps, 0.0)
    return max(rules.base_m, rules.base_s * speed * rules.times)
