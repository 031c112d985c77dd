"""Whether all tractors get home from where they stand, if one moves at a time; what would have to give for that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.yielding.courses import Course
from planner.yielding.crossings import Crossings, Table
from planner.yielding.ways_home import Net, by_turns, last_passes, last_waits, one_by_one
from vehicle.missions import Follow, Gate, Plan

MOST_LOOSENED = 80  # times that a deadlock is undone by leaving out gates of the plan
FOLLOWS_S = 4.0  # who is followed has gone on far enough after this time
State = tuple[int, ...]
"""The hold point each tractor stands at."""
Stretch = tuple[int, int]
"""(tractor, number of the stretch)."""


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
    """Finds ways home. `waits` are gates by the stretch they stand before, `others` (n, n) tells who waits for whom.

    `loosened` are gates that are not heeded, as (tractor, leg, gate): with them nobody would get home. `net` is what
    all that depends on as planner.yielding.ways_home has it.
    """

    def __init__(self, plan: Plan, crossings: Crossings, *, deep: bool = False) -> None:
        """For the gates of a plan, none of them left out yet; `deep` as in planner.yielding.ways_home."""
        self.deep = deep
        self.crossings, self.courses = crossings, crossings.courses
        self.homes: State = tuple(course.stretches for course in self.courses)
        self.waits, self.others = _waits_of(plan, self.courses)
        self.loosened: list[tuple[int, int, Gate]] = []
        bounds = [self._bounds(one) for one in range(len(self.courses))]
        self.net = self._heeding(np.concatenate(bounds))

    def loosen(self) -> bool:
        """Leave out gates of the plan, none where none need be, until all get home from the start, one at a time.

        False where that does not help.
        """
        state = np.zeros(len(self.homes), dtype=np.int64)
        if one_by_one(self.net, state):
            return True
        for _ in range(MOST_LOOSENED):
            if by_turns(self.net, state.copy(), self.deep, state):
                return True
            left_out = self._knot(state.tolist())
            if not left_out:
                return False
            for one, wait in left_out:
                self.waits[one, int(state[one])].remove(wait)
                if wait.gate is not None:
                    self.loosened.append((one, wait.leg, wait.gate))
            self.net = self._heeding(self.net.bound)
        return False

    def _knot(self, state: Sequence[int]) -> list[tuple[int, Wait]]:
        """Unfulfilled gates for a tractor that cannot move because of those that wait for it."""
        waiting = [
            (one, wait)
            for one in range(len(state))
            for wait in self.waits.get((one, state[one]), ())
            if state[wait.tractor] <= wait.stretch and wait.gate is not None
        ]
        base, blockers = self.crossings.base, self.crossings.blockers
        for one, home in enumerate(self.homes):
            if state[one] == home:
                continue
            place = int(base[one]) + state[one]
            places = blockers.at[blockers.start[place] : blockers.start[place + 1]].tolist()
            for blocker in (other for other, number in enumerate(state) if int(base[other]) + number in places):
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

    def _heeding(self, bound: npt.NDArray[np.int64]) -> Net:
        """What a schedule depends on, with the gates that are heeded."""
        crossings = self.crossings
        base, tables = crossings.base, (crossings.apart, crossings.stands, crossings.blockers)
        owner = np.repeat(np.arange(len(base) - 1), np.diff(base))
        rows = [
            (int(base[one]) + number, int(base[wait.tractor]) + wait.stretch, wait.after_s)
            for (one, number), each in sorted(self.waits.items())
            for wait in each
        ]
        column = np.array(rows, dtype=np.float64).reshape(-1, 3)
        places = column[:, :2].astype(np.int64)
        waits = Table.of(places[:, 0], places[:, 1], np.repeat(column[:, 2:], 2, axis=1), len(owner))
        apart, stands, blockers = ((table.start, table.at, table.span_s) for table in tables)
        return Net(
            base, owner, crossings.begins_s, *apart, *stands, *blockers,
            waits.start, waits.at, np.ascontiguousarray(waits.span_s[:, 0]), bound,
            last_passes(base, owner, crossings.stands.start, crossings.stands.at),
            last_waits(base, owner, waits.start, waits.at), crossings.near,
        )  # fmt: skip


def _waits_of(plan: Plan, courses: list[Course]) -> tuple[dict[Stretch, list[Wait]], npt.NDArray[np.bool_]]:
    """What stretches wait for, and who waits for whom; of a large fleet many wait for the same place."""
    waits: dict[Stretch, list[Wait]] = {}
    passed: dict[Gate, tuple[int, float]] = {}
    others = np.zeros((len(courses), len(courses)), dtype=np.bool_)
    for one, (mission, course) in enumerate(zip(plan.missions, courses, strict=True)):
        for number, leg in enumerate(course.hold_legs[:-1]):
            for gate in mission.legs[leg].gates:
                if gate not in passed:
                    passed[gate] = courses[gate.tractor].passes(gate.leg, gate.after_m)
                waits.setdefault((one, number), []).append(Wait(leg, gate, gate.tractor, *passed[gate]))
                others[one, gate.tractor] = True
        for number, each in enumerate(mission.legs):
            if each.follow is not None and (wait := _kept_back(courses, one, number, each.follow)) is not None:
                waits.setdefault((one, wait.leg), []).append(wait)
                others[one, wait.tractor] = True
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
