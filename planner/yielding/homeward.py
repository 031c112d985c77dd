"""Whether all tractors get home from where they stand, if one moves at a time; what would have to give for that."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from planner.yielding.courses import Course
from planner.yielding.crossings import Crossings, Stretch
from vehicle.missions import Follow, Gate, Plan

MOST_STATES = 400  # looked at for a way home
MOST_LOOSENED = 80  # times that a deadlock is undone by leaving out gates of the plan
FOLLOWS_S = 4.0  # who is followed has gone on far enough after this time
State = tuple[int, ...]
"""The hold point each tractor stands at."""


@dataclass(frozen=True)
class Wait:
    """Not before `tractor` has been on its stretch `stretch` for `after_s`: a gate of the plan on a leg.

    `gate` is None where nobody has written one: who follows another closely gets no farther while that one stands.
    """

    leg: int
    gate: Gate | None
    tractor: int
    stretch: int
    after_s: float


class Homeward:
    """Finds ways home. `waits` are gates by the stretch they stand before, `others[one]` are those it waits for.

    `loosened` are gates that are not heeded, as (tractor, leg, gate): with them nobody would get home.
    """

    def __init__(self, plan: Plan, crossings: Crossings) -> None:
        self.crossings, self.courses = crossings, crossings.courses
        self.homes: State = tuple(course.stretches for course in self.courses)
        self.waits, self.others = _waits_of(plan, self.courses)
        self.loosened: list[tuple[int, int, Gate]] = []
        self._safe: dict[State, bool] = {}
        self._bound = [self._bounds(one) for one in range(len(self.courses))]

    def safe(self, state: State) -> bool:
        """Whether an order is found in which all get home from where they stand, one moving at a time."""
        if state not in self._safe:
            self._safe[state] = self._one_by_one(state) or self._by_turns(state) == self.homes
        return self._safe[state]

    def harmless(self, one: int, state: State) -> bool:
        """Whether a tractor stands where nobody else comes by any more."""
        return all(number < state[other] for other, number in self.crossings.stands.get((one, state[one]), {}))

    def loosen(self) -> bool:
        """Leave out gates of the plan until all get home from the start; False where that does not help."""
        state: State = (0,) * len(self.homes)
        for _ in range(MOST_LOOSENED):
            state = self._by_turns(state)
            if state == self.homes:
                self._safe.clear()
                return True
            left_out = self._knot(state)
            if not left_out:
                return False
            for one, wait in left_out:
                self.waits[one, state[one]].remove(wait)
                if wait.gate is not None:
                    self.loosened.append((one, wait.leg, wait.gate))
        return False

    def _knot(self, state: State) -> list[tuple[int, Wait]]:
        """Unfulfilled gates for a tractor that cannot move because of those that wait for it."""
        waiting = [
            (one, wait)
            for one in range(len(state))
            for wait in self.waits.get((one, state[one]), ())
            if state[wait.tractor] <= wait.stretch and wait.gate is not None
        ]
        for one, home in enumerate(self.homes):
            if state[one] == home:
                continue
            places = self.crossings.blockers.get((one, state[one]), {})
            for blocker in sorted(other for other, hold in places if state[other] == hold):
                held = [pair for pair in waiting if pair[0] == blocker]
                if any(wait.tractor == one for _, wait in held):
                    return [pair for pair in waiting if pair[1].tractor == one]
                if held:
                    return held
        return []

    def _bounds(self, one: int) -> list[int]:
        """For each hold point the next one at which a tractor waits for others by plan."""
        bounds, last = [], self.homes[one]
        for number in range(self.homes[one], -1, -1):
            bounds.append(last)
            last = number if (one, number) in self.waits else last
        return bounds[::-1]

    def _one_by_one(self, state: State) -> bool:
        """Whether each can go home in one go, in some order; finds it if there is any."""
        at, out = state, {one for one, home in enumerate(self.homes) if state[one] < home}
        while out:
            for one in sorted(out):
                ends = (*at[:one], self.homes[one], *at[one + 1 :])
                if self.harmless(one, ends) and self._reach(at, one, self.homes[one]) == self.homes[one]:
                    at = ends
                    out.discard(one)
                    break
            else:
                return False
        return True

    def _by_turns(self, state: State) -> State:
        """The state in which all are home if an order of moves is found, else the farthest on that was found."""
        seen, stack, farthest = {state}, [state], state
        while stack and len(seen) < MOST_STATES:
            at = stack.pop()
            if at == self.homes:
                return at
            farthest = max(farthest, at, key=self._driven_s)
            for after in sorted(self._moves(at), reverse=True):
                if after[-1] not in seen:
                    seen.add(after[-1])
                    stack.append(after[-1])
        return farthest

    def _driven_s(self, state: State) -> float:
        return round(sum(course.begins_s(at) for course, at in zip(self.courses, state, strict=True)), 1)

    def _moves(self, at: State) -> Iterator[tuple[bool, float, int, State]]:
        """What may be done next, with what decides which is tried first.

        A tractor goes on to where it waits for others by plan, or else as far as it does not stand in the way of what
        another has to do before it waits for anybody.
        """
        for one, home in enumerate(self.homes):
            if at[one] == home:
                continue
            reach = self._reach(at, one, self._bound[one][at[one]])
            free = (hold for hold in range(reach, at[one], -1) if not self._blocks(at, one, hold))
            for hold in sorted({*([reach] if reach > at[one] else []), *([next(free, reach)])} - {at[one]}):
                blocks = self._blocks(at, one, hold)
                yield blocks, self.courses[one].begins_s(at[one]), one, (*at[:one], hold, *at[one + 1 :])

    def _reach(self, at: State, one: int, bound: int) -> int:
        """How far a tractor can go while all others stand, up to a hold point."""
        hold = at[one]
        while hold < bound and self._can_move(at, one, hold):
            hold += 1
        return hold

    def _blocks(self, at: State, one: int, hold: int) -> bool:
        """Whether a tractor at a hold point stands in the way of what another does before it waits for anybody."""
        stands = self.crossings.stands.get((one, hold), {})
        return any(at[other] <= number < self._bound[other][at[other]] for other, number in stands)

    def _can_move(self, at: Sequence[int], one: int, hold: int) -> bool:
        """Whether a tractor can drive the stretch from a hold point while all others stand."""
        mine = one, hold
        if any(at[other] == place for other, place in self.crossings.blockers.get(mine, {})):
            return False
        return all(at[wait.tractor] > wait.stretch for wait in self.waits.get(mine, ()))


def _waits_of(plan: Plan, courses: list[Course]) -> tuple[dict[Stretch, list[Wait]], list[set[int]]]:
    waits: dict[Stretch, list[Wait]] = {}
    others: list[set[int]] = [set() for _ in courses]
    for one, (mission, course) in enumerate(zip(plan.missions, courses, strict=True)):
        for number, leg in enumerate(course.hold_legs[:-1]):
            for gate in mission.legs[leg].gates:
                place = courses[gate.tractor].passes(gate.leg, gate.after_m)
                waits.setdefault((one, number), []).append(Wait(leg, gate, gate.tractor, *place))
                others[one].add(gate.tractor)
        for number, each in enumerate(mission.legs):
            if each.follow is not None and (wait := _kept_back(courses, one, number, each.follow)) is not None:
                waits.setdefault((one, wait.leg), []).append(wait)
                others[one].add(wait.tractor)
    return waits, others


def _kept_back(courses: list[Course], one: int, leg: int, follow: Follow) -> Wait | None:
    """What a follower waits for, and before which of its stretches, if it stops short of the end of its leg.

    It does where the one it follows stands at the end of its own leg, and is not a gap ahead then.
    """
    ends = []
    for number, after in ((one, leg + 1), (follow.tractor, follow.leg + 1)):
        if after not in courses[number].hold_legs[:-1]:
            return None
        ends.append(courses[number].hold_legs.index(after))
    me, other = (courses[n].poses[courses[n].holds[end]] for n, end in zip((one, follow.tractor), ends, strict=True))
    ahead = (other["x"] - me["x"]) * math.cos(me["angle"]) + (other["y"] - me["y"]) * math.sin(me["angle"])
    if ahead >= follow.gap_m:
        return None
    return Wait(ends[0], None, follow.tractor, ends[1], FOLLOWS_S)
