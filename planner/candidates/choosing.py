"""Which of several ways to drive the same work are simulated: not those that one driven before clearly beats."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Protocol, TypeVar

import numpy as np

from planner.candidates.bounds import BARE, CLOSE, Pace, alone_s, least_s
from strategies.record import Refined
from vehicle.missions import ROUND, Leg, Mission, Plan
from vehicle.run import Run

UNSURE, UNSURE_S = 0.05, 15.0  # by so much of the rounds, and so many seconds, least times may err between two orders


class Tried(Protocol):
    """A plan that was driven: its last run, and why it is not feasible (None when it is)."""

    @property
    def run(self) -> Run: ...

    @property
    def reason(self) -> str | None: ...


T = TypeVar("T", bound=Tried)


@dataclass(frozen=True)
class Limits:
    """What is known of how long plans take: a tractor's pace, and how one is driven `alone`."""

    pace: Pace = BARE
    alone: Callable[[Mission], Run] | None = None

    def beaten(self, plan: Plan, best_s: float) -> bool:
        """Whether a plan takes no less than a time, however well it is driven.

        What each tractor drives alone tells more than its pace, and is found out where it may decide.
        """
        least = least_s(plan, self.pace)
        if least >= best_s or self.alone is None or plan.tractors == 1 or least < CLOSE * best_s:
            return least >= best_s
        return alone_s(plan, self.alone, best_s) >= best_s


def promising(
    choices: Sequence[Refined], drive: Callable[[Refined], T], limits: Limits | None = None
) -> list[T]:
    """The choices driven in the order of their least times, without those that one driven before clearly beats.

    The work in tracks is the same: what one order takes longer than another is in its rounds and the ways to them.
    What a run waits more than its plan asked for, another order might not wait; what takes at least as long as one
    was driven in need not be tried.
    """
    timed = sorted((round(least_s(choice.plan), 3), number) for number, choice in enumerate(choices))
    driven: list[T] = []
    done_s = best_s = math.inf
    for least, number in timed:
        if least - UNSURE_S - UNSURE * rounds_s(choices[number].plan) >= done_s:
            continue
        if best_s < math.inf and (limits or Limits()).beaten(choices[number].plan, best_s):
            continue
        one = drive(choices[number])
        driven.append(one)
        if one.reason is None:
            best_s = min(best_s, one.run.duration_s)
            done_s = min(done_s, max(least, least_s(one.run.plan)))
    return driven


def best_first(
    contenders: Sequence[Refined], choices: Sequence[Refined], drive: Callable[[Refined], T], limits: Limits
) -> list[T]:
    """The choices that may win as `promising` drives them; the others as well only where one of those can be driven.

    That one may turn out slower than the rival after all, and others be less slow.
    """
    known: dict[int, T] = {}

    def once(choice: Refined) -> T:
        if id(choice) not in known:
            known[id(choice)] = drive(choice)
        return known[id(choice)]

    runs = promising(contenders, once, limits)
    if len(contenders) < len(choices) and any(one.reason is None for one in runs):
        return promising(choices, once, limits)
    return runs


def rounds_s(plan: Plan) -> float:
    """Seconds that the rounds take whoever works longest on them, at the speed asked for."""
    legs = [[leg for leg in mission.legs if leg.task.kind == ROUND] for mission in plan.missions]
    return max(math.fsum(leg.length_m / leg.speed_mps for leg in each) for each in legs)


def untried(choices: Sequence[Refined], tried: Sequence[Plan]) -> list[Refined]:
    """The choices that are not driven in the very same way as a plan that was tried."""
    return [choice for choice in choices if not any(driven_alike(choice.plan, plan) for plan in tried)]


def driven_alike(one: Plan, other: Plan) -> bool:
    """Whether two plans are the same leg for leg, whatever is noted of them."""
    pairs = list(zip(one.missions, other.missions, strict=False))
    if one.tractors != other.tractors or any(len(a.legs) != len(b.legs) for a, b in pairs):
        return False
    return all(_alike(a, b) for mission, another in pairs for a, b in zip(mission.legs, another.legs, strict=True))


def _alike(one: Leg, other: Leg) -> bool:
    if one is other:
        return True
    plain = (each.name for each in fields(Leg) if each.name != "points")
    return np.array_equal(one.points, other.points) and all(getattr(one, n) == getattr(other, n) for n in plain)
