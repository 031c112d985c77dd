"""Which legs a tractor may drive: base and horizon, as VDA 5050 has them (6.1).

Released legs are the base; it is never taken back, and reaches only a little ahead. A leg joins it when the one before
has, its gates are open by what the others have really driven, and nothing blocks it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from planner.service.centre.course import Course
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import TractorState
from vehicle.missions import Gate


def passed(gate: Gate, states: Sequence[TractorState]) -> bool:
    """Whether a tractor has driven what a gate waits for."""
    other = states[gate.tractor]
    return other.done or (other.leg, other.leg_m) >= (gate.leg, gate.after_m) or other.leg > gate.leg


def closed_gates(course: Course, leg: int, states: Sequence[TractorState]) -> list[Gate]:
    """The gates of a leg that are not open yet."""
    return [gate for gate in course.legs[leg].gates if not passed(gate, states)]


def waits_here(course: Course, state: TractorState, states: Sequence[TractorState]) -> list[Gate]:
    """The gates not open yet for which a tractor stands on a leg that is released: those of a plan made anew."""
    return closed_gates(course, state.leg, states) if state.leg < state.released else []


def base_end(
    number: int, courses: Sequence[Course], states: Sequence[TractorState], blocked: Mapping[int, str], rules: Rules
) -> int:
    """How many legs of a tractor are released now: at least as many as before."""
    state, course = states[number], courses[number]
    reach_m = _reach_m(state, course, rules)
    released = state.released
    while released < len(course.legs) and released not in blocked:
        if released > state.leg and course.before_m[released] - _at_m(state, course) > reach_m:
            break
        if closed_gates(course, released, states):
            break
        released += 1
    return released


def waits_for(
    number: int, courses: Sequence[Course], states: Sequence[TractorState], rules: Rules
) -> list[tuple[int, int]]:
    """(tractor, leg) whose progress keeps a tractor back at the end of what it may drive, when it is near that end."""
    state, course = states[number], courses[number]
    here = [] if state.done else waits_here(course, state, states)
    if here:
        return _each_once(here)
    if state.done or state.released >= len(course.legs):
        return []
    if course.before_m[state.released] - _at_m(state, course) > _reach_m(state, course, rules):
        return []
    return _each_once(closed_gates(course, state.released, states))


def _each_once(gates: Sequence[Gate]) -> list[tuple[int, int]]:
    """(tractor, leg) of gates; two may wait for two places on one leg."""
    return list(dict.fromkeys((gate.tractor, gate.leg) for gate in gates))


def _at_m(state: TractorState, course: Course) -> float:
    return course.before_m[min(state.leg, len(course.legs))] + state.leg_m


def _reach_m(state: TractorState, course: Course, rules: Rules) -> float:
    """How far ahead legs are released."""
    speed = max(course.legs[min(state.leg, len(course.legs) - 1)].speed_mps, 0.0)
    return max(rules.base_m, rules.base_s * speed * rules.times)
