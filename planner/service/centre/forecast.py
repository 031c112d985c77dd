"""When every tractor will be done: the rest of the plan, leg by leg, at the pace driven so far and with its gates."""

from __future__ import annotations

import math
from collections.abc import Sequence

from planner.service.centre.course import Course
from planner.service.centre.releasing import passed
from planner.service.centre.tractors import TractorState
from vehicle.missions import Gate

TRUSTED_S = 120.0  # of driving as planned that a pace is believed to begin with
SLOWEST, QUICKEST = 4.0, 0.5
Place = tuple[int, float]


def pace(state: TractorState) -> float:
    """Seconds really driven per second of the plan, one to begin with."""
    ratio = (TRUSTED_S + state.driving_s) / (TRUSTED_S + state.driven_plan_s)
    return min(max(ratio, QUICKEST), SLOWEST)


def finish_in_s(
    courses: Sequence[Course], states: Sequence[TractorState], halted: Sequence[bool],
    places: Sequence[Place | None] | None = None,
) -> list[float]:  # fmt: skip
    """Seconds from now until each tractor is done (n,); infinite for who never is as things stand.

    `halted` tractors stay where they are, and so do those that wait for them. `places` are legs and metres on them
    where the tractors are believed to be by now; without one a tractor is where it has reported.
    """
    known = places or [None] * len(states)
    rows = [_Row(*each) for each in zip(courses, states, halted, known, strict=True)]
    moved = True
    while moved:
        moved = sum(row.advance(rows, states) for row in rows) > 0
    return [row.finish_s for row in rows]


class _Row:
    """The legs of one tractor timed so far: `begins` and `ends` from its present leg on."""

    def __init__(self, course: Course, state: TractorState, halt: bool, place: Place | None) -> None:
        self.course, self.state, self.pace = course, state, pace(state)
        self.leg, self.leg_m = (state.leg, state.leg_m) if place is None else place
        self.begins: list[float] = []
        self.ends: list[float] = []
        self.free_s = math.inf if halt and not state.done else 0.0

    @property
    def next_leg(self) -> int:
        return self.leg + len(self.ends)

    @property
    def finish_s(self) -> float:
        if self.state.done:
            return 0.0
        if self.next_leg < len(self.course.legs):
            return math.inf
        return self.ends[-1] if self.ends else self.free_s

    def advance(self, rows: Sequence[_Row], states: Sequence[TractorState]) -> bool:
        """Time as many legs as can be; whether there were any."""
        before = len(self.ends)
        while not self.state.done and self.next_leg < len(self.course.legs):
            begin = self._begin(rows, states)
            if begin is None:
                break
            leg = self.next_leg
            share = 1.0
            if not self.ends:
                share = 1.0 - min(self.leg_m / max(self.course.lengths_m[leg], 1e-6), 1.0)
            self.begins.append(begin)
            self.ends.append(begin + share * self.course.seconds[leg] * self.pace)
        return len(self.ends) > before

    def _begin(self, rows: Sequence[_Row], states: Sequence[TractorState]) -> float | None:
        begin = self.ends[-1] if self.ends else self.free_s
        for gate in self.course.legs[self.next_leg].gates:
            if passed(gate, states) or (self.ends and self.next_leg < self.state.released):
                continue  # of the legs that are released only the present one may still be waited on
            opens = rows[gate.tractor].passing_s(gate)
            if opens is None:
                return None
            begin = max(begin, opens)
        return begin

    def passing_s(self, gate: Gate) -> float | None:
        """When this tractor has driven what a gate waits for; None while its leg is not timed."""
        index = gate.leg - self.leg
        if index < 0:
            return 0.0
        if index >= len(self.ends):
            return None
        share = min(gate.after_m / max(self.course.lengths_m[gate.leg], 1e-6), 1.0)
        return self.ends[index] - (1.0 - share) * self.course.seconds[gate.leg] * self.pace
