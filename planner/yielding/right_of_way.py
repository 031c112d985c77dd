"""Who goes first: paths are given, and every tractor may stand at its hold points.

Tractors are moved from hold point to hold point in the order of time. One enters a stretch when nothing of it is taken
by others meanwhile, nobody stands in its way, and all could still get home one after another if everybody then stood
still; no two can wait for each other for ever where that holds at the start. What makes a tractor wait, or only just
not, becomes a gate; other gates of the plan are heeded. The times are worked out in planner.yielding.turns_taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from planner.yielding.crossings import Crossings
from planner.yielding.homeward import Homeward
from planner.yielding.turns_taken import AHEAD_S, BEHIND_S, CHAIN, filled
from vehicle.missions import Gate, Plan

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Manner:
    """How turns are taken: by when one can go on or, the more `eager`, by when it has come to its hold point.

    With `on` one that must not stop at the next hold point may go on beyond it in one go.
    """

    eager: float
    on: bool


SMALL_FLEET = 4  # tractors; larger ones are scheduled in one manner
MANNERS = (Manner(0.0, False), Manner(0.0, True), Manner(0.5, False), Manner(0.5, True), Manner(1.0, True))


@dataclass(frozen=True)
class Timetable:
    """When each tractor begins each of its stretches, when it is done, and the gates before legs that make it so."""

    begins_s: list[list[float]]
    free_s: list[float]
    gates: list[tuple[int, int, Gate]]

    @property
    def duration_s(self) -> float:
        """When the last one is done."""
        return max(self.free_s)


class RightOfWay:
    """Finds a timetable for the courses of a plan."""

    def __init__(self, plan: Plan, crossings: Crossings, slack: float = 1.0) -> None:
        """For a plan whose tractors keep `slack` times the usual time between each other."""
        self.plan, self.crossings, self.courses = plan, crossings, crossings.courses
        self.margins = BEHIND_S * slack, AHEAD_S * slack
        self.homeward = Homeward(plan, crossings)

    def timetable(self) -> Timetable | None:
        """The quickest timetable; None where tractors stand so that they could not even get home one after another.

        Gates of the plan that would keep them from that are left out (`homeward.loosened`). Where no timetable is
        found, ways home are looked for more deeply.
        """
        for deep in (False, True):
            if deep:
                self.homeward = Homeward(self.plan, self.crossings, deep=deep)
            if not self.homeward.loosen():
                continue
            manners = MANNERS if len(self.courses) <= SMALL_FLEET else MANNERS[:1]
            tables = [self._filled(manner) for manner in manners]
            found = [table for table in tables if not np.isnan(table[1]).any()]
            if found:
                return self._told(*min(found, key=lambda table: _merit(table[1])))
        return None

    def _filled(self, manner: Manner) -> tuple[Floats, Floats, Floats]:
        """A timetable in which the entry comes next that can be soonest, as planner.yielding.turns_taken has it."""
        net = self.homeward.net
        most = CHAIN * int(np.max(np.diff(net.apart_start) + np.diff(net.blockers_start)))
        concerned = net.near | self.homeward.others
        how = (manner.eager, manner.on), self.homeward.deep
        return filled(net, concerned, most, self.margins, *how)  # type: ignore[no-any-return]

    def _told(self, begun_s: Floats, free_s: Floats, gates: Floats) -> Timetable:
        """A timetable with tractors, legs and metres for what is numbered through."""
        base = self.crossings.base.tolist()
        begins = [begun_s[first : end - 1].tolist() for first, end in pairwise(base)]
        return Timetable(begins, free_s.tolist(), [self._gate(*gate) for gate in gates.tolist()])

    def _gate(self, mine: float, place: float, after_s: float) -> tuple[int, int, Gate]:
        """The gate before a stretch that opens when another has been begun for so long, with tractor and leg."""
        owner, base = self.homeward.net.owner, self.crossings.base
        one, other = int(owner[int(mine)]), int(owner[int(place)])
        gate = self.courses[other].gate(other, int(place - base[other]), after_s, self.plan.missions[other])
        return one, self.courses[one].hold_legs[int(mine - base[one])], gate


def _merit(free_s: Floats) -> tuple[int, int]:
    """What decides between timetables: when the last one is done, and then all of them."""
    return round(float(free_s.max())), round(sum(free_s.tolist()))
