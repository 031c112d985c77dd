"""Plans that a rival beats before they are driven, and how that is told."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from planner.candidates.bounds import CLOSE, alone_s, done_s, pace_of
from planner.site import Site
from reports.results import PlanResult
from strategies.record import Refined
from vehicle.missions import Mission, Plan
from vehicle.run import Run

SURE = 1.1  # times the rival: what takes longer from one corner is not looked at from the others


@dataclass(frozen=True)
class Rival:
    """The quickest feasible plan of as many tractors: its strategy, and seconds until it has finished the field.

    `tractor_s` are those of all its tractors together, each until it is done.
    """

    strategy: str
    seconds: float
    tractor_s: float = 0.0


@dataclass(frozen=True)
class Beaten:
    """A candidate whose every plan takes at least so many seconds, and more than the rival.

    `driven` says that quicker ones were driven and were not feasible.
    """

    seconds: float
    rival: Rival
    driven: bool = False


def beaten(
    site: Site, plans: Sequence[Plan], rival: Rival, alone: Callable[[Mission], Run] | None = None
) -> Beaten | None:
    """The plans as beaten by a rival, None where one of them might win.

    What each tractor drives `alone` is found out where the pace of the tractors nearly decides. Where chance and money
    decide, all tractors together must take longer as well.
    """
    least = math.inf
    for plan in plans:
        seconds = _too_long_s(site, plan, rival, alone)
        if seconds is None:
            return None
        least = min(least, seconds)
    return Beaten(least, rival) if plans else None


def contenders(
    site: Site, choices: Sequence[Refined], rival: Rival, alone: Callable[[Mission], Run]
) -> tuple[list[Refined], Beaten | None]:
    """The choices that might win against a rival, and how it beats the others; None where there are none."""
    times = [_too_long_s(site, choice.plan, rival, alone) for choice in choices]
    left = [choice for choice, seconds in zip(choices, times, strict=True) if seconds is None]
    least = min((seconds for seconds in times if seconds is not None), default=None)
    return left, None if least is None else Beaten(least, rival)


def quickest_of(one: Beaten | None, other: Beaten | None) -> Beaten | None:
    """Of two that are beaten the one with the lower bound; None where there are none."""
    return min((each for each in (one, other) if each is not None), key=lambda each: each.seconds, default=None)


def _too_long_s(site: Site, plan: Plan, rival: Rival, alone: Callable[[Mission], Run] | None) -> float | None:
    """Seconds that a plan takes at least, as `beaten` has it; None where it might win."""
    done = done_s(plan, pace_of(site.tractor, site.implement, site.manner.radius_m))
    decided = site.stakes is not None and site.stakes.decides
    if decided and math.fsum(done) < rival.tractor_s:
        return None
    seconds = max(done)
    if alone is not None and plan.tractors > 1 and CLOSE * rival.seconds <= seconds <= rival.seconds:
        seconds = max(seconds, alone_s(plan, alone, rival.seconds))
    return None if seconds <= rival.seconds else seconds


def surely(found: Beaten | None) -> bool:
    """Whether a formation is beaten by so much that no other corner can make up for it."""
    return found is not None and found.seconds > SURE * found.rival.seconds


def from_any_corner(found: Beaten) -> Beaten:
    """A formation that is surely beaten from one corner, with what that leaves to all others."""
    return replace(found, seconds=found.seconds / SURE)


def result_of(found: Beaten, site: Site, strategy: str, tractors: int) -> PlanResult:
    """What is told of a candidate that is not simulated."""
    rival = found.rival
    reason = f"cannot win: at least {found.seconds:.0f} s, {rival.strategy} takes {rival.seconds:.0f} s"
    return PlanResult(strategy, tractors, site.scenario.turn, False, reason, bound_s=round(found.seconds, 3))
