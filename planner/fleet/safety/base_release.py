"""Which legs a tractor may drive: base and horizon, as in VDA 5050 (6.1).

The base is never taken back, and reaches only a little ahead. A leg joins it once the leg before has, its gates are
open by what the other tractors have really driven, and nothing blocks it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import TractorState
from vehicle.missions.plan import LegGate


def is_passed(gate: LegGate, states: Sequence[TractorState]) -> bool:
    """Whether a tractor has reached the place that a gate waits for."""
    awaited = states[gate.tractor]
    return awaited.done or (awaited.leg, awaited.leg_m) >= (gate.leg, gate.after_m) or awaited.leg > gate.leg


def find_closed_gates(state: TractorState, leg: int, states: Sequence[TractorState]) -> list[LegGate]:
    """The gates of a leg of a tractor that are not open yet."""
    return [gate for gate in state.mission.legs[leg].gates if not is_passed(gate, states)]


def find_gates_closed_on_base(state: TractorState, states: Sequence[TractorState]) -> list[LegGate]:
    """Closed gates for which a tractor stands on a base leg; only replanned plans have them."""
    return find_closed_gates(state, state.leg, states) if state.leg < state.base_end else []


def compute_base_end(
    state: TractorState, states: Sequence[TractorState], blocked: Mapping[int, str], rules: FleetRules
) -> int:
    """The number of legs in the base of a tractor now, at least as many as before."""
    base_end = state.base_end
    while base_end < len(state.mission.legs) and base_end not in blocked:
        is_beyond_reach = base_end > state.leg and not _is_within_reach(state, base_end, rules)
        if is_beyond_reach or find_closed_gates(state, base_end, states):
            break
        base_end += 1
    return base_end


def find_awaited_legs(state: TractorState, states: Sequence[TractorState], rules: FleetRules) -> list[tuple[int, int]]:
    """The (tractor, leg) that a tractor near the end of its base waits for, without repeats: two gates may wait for two
    places on one leg."""
    if state.done:
        return []
    gates = find_gates_closed_on_base(state, states)
    is_at_base_end = state.base_end < len(state.mission.legs) and _is_within_reach(state, state.base_end, rules)
    if not gates and is_at_base_end:
        gates = find_closed_gates(state, state.base_end, states)
    return list(dict.fromkeys((gate.tractor, gate.leg) for gate in gates))


def _is_within_reach(state: TractorState, leg: int, rules: FleetRules) -> bool:
    """Whether the base may reach as far ahead as the start of a leg."""
    speed_mps = max(state.present_leg.speed_mps, 0.0)
    reach_m = max(rules.base_m, rules.base_s * speed_mps * rules.times)
    return state.mission.leg_starts_m[leg] - state.position_m <= reach_m
