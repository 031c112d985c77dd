"""A turn of a plan driven alone: the end of the track before, the turn, the begin of the track it leads to.

That costs a minute of simulated time where driving the whole plan again costs hours. The controller looks at the path
ten times a second, so that a turn begins up to 0.15 m sooner or later, and may come too near to something in one plan
and not in another: it is driven from several places within one look, and the worst counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b

import numpy as np
import numpy.typing as npt

from planner.candidates.steady import LONGEST_M, Slip, slips, turn_start, worst_aside
from planner.site import Site
from vehicle.missions import Leg, Mission, Plan
from vehicle.run import DONE
from vehicle.world import simulate

LEAD_M, TAIL_M = 40.0, 2.0  # of the tracks before and after: enough to come to speed and to settle
LONGEST_S = 900.0
PLACES = 4  # chosen: a quarter of a look apart is 4 cm at working speed
SHORTEST_M = 1.0  # of a part of a leg: it takes no part in the turn, and places are shifted along no shorter one
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TurnAlone:
    """A turn of a plan: its legs, the end of what is driven before them, if anything is, and what they lead to."""

    site: Site
    before: tuple[Leg, ...]
    legs: tuple[Leg, ...]
    after: Leg

    def off_m(self, legs: Sequence[Leg]) -> float | None:
        """How far off a tractor is that drives these legs in place of the turn's; None where it does not come through.

        As in planner.candidates.steady: beside the line it leads to, or outside the field if that is worse. The same
        turn is driven once, whichever plans of a site have it.
        """
        driven = self._by(legs)
        key, known = turn_key(driven), self.site.turns_tried
        if key not in known:
            known[key] = self._worst_m(driven)
        return known[key]

    @property
    def key(self) -> bytes:
        """What it is, whichever plan has it."""
        return turn_key(self._by(self.legs))

    def _by(self, legs: Sequence[Leg]) -> tuple[Leg, ...]:
        return tuple(replace(leg, gates=(), follow=None, stand_s=0.0) for leg in (*self.before, *legs, self.after))

    def _worst_m(self, legs: tuple[Leg, ...]) -> float | None:
        worst = 0.0
        for later_m in self._places_m(legs[0]):
            off = self._driven_off_m((_part(legs[0], later_m - legs[0].length_m), *legs[1:]) if later_m else legs)
            if off is None:
                return None
            worst = max(worst, off)
        return worst

    def _places_m(self, first: Leg) -> list[float]:
        """By how much later on the first leg the tractor may as well begin (m)."""
        look_m = first.speed_mps / self.site.tractor.guidance.rate_hz
        if not self.before or first.length_m < look_m + SHORTEST_M:
            return [0.0]
        return [place * look_m / PLACES for place in range(PLACES)]

    def _driven_off_m(self, legs: tuple[Leg, ...]) -> float | None:
        run = simulate(Plan((Mission(legs),)), self.site.tractor, self.site.implement, max_time_s=LONGEST_S)
        return worst_aside(slips(run, self.site)) if run.outcome == DONE else None

    @property
    def short(self) -> bool:
        """Whether it is all a turn, and no route."""
        return math.fsum(leg.length_m for leg in self.legs) < LONGEST_M

    def slowed(self, factor: float) -> list[Leg]:
        """Its legs at a share of their speed; of a route only as many at its end as a turn has."""
        left = np.cumsum([leg.length_m for leg in self.legs[::-1]])[::-1]
        return [
            replace(leg, speed_mps=factor * leg.speed_mps) if rest < LONGEST_M else leg
            for leg, rest in zip(self.legs, left.tolist(), strict=True)
        ]


def turn_key(legs: tuple[Leg, ...]) -> bytes:
    """All that decides how a tractor drives legs alone, in short."""
    manner = [(len(leg.points), leg.speed_mps, leg.gear, leg.implement, leg.ground, leg.task) for leg in legs]
    told = repr(manner).encode() + np.concatenate([leg.points for leg in legs]).tobytes()
    return blake2b(told, digest_size=16).digest()


def turn_of(plan: Plan, slip: Slip, site: Site) -> TurnAlone:
    """The turn that was followed badly."""
    legs = plan.missions[slip.tractor].legs
    first = turn_start(plan.missions[slip.tractor], slip.leg)
    return TurnAlone(site, _lead(legs, first), legs[first : slip.leg], _part(legs[slip.leg], TAIL_M))


def _lead(legs: Sequence[Leg], first: int) -> tuple[Leg, ...]:
    """The last LEAD_M before a leg, of the legs that work on the same track as the one before it."""
    lead: list[Leg] = []
    left_m, number = LEAD_M, first - 1
    while left_m > SHORTEST_M and number >= 0 and (not lead or _goes_on(legs[number], lead[0])):
        lead.insert(0, _part(legs[number], -left_m))
        left_m -= legs[number].length_m
        number -= 1
    return tuple(lead)


def _goes_on(leg: Leg, after: Leg) -> bool:
    """Whether a tractor that is on a leg is on the same line as on the one after it, and drives on without a halt."""
    return leg.task == after.task and leg.task.works and leg.gear == after.gear and after.stand_s == 0.0


def _part(leg: Leg, metres: float) -> Leg:
    """The first metres of a leg, or its last where they are negative."""
    if leg.length_m <= abs(metres):
        return leg
    points = leg.points if metres > 0.0 else leg.points[::-1]
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    last = int(np.searchsorted(along, abs(metres)))
    share = (abs(metres) - along[last - 1]) / (along[last] - along[last - 1])
    end = points[last - 1] + share * (points[last] - points[last - 1])
    kept: Points = np.concatenate([points[:last], [end]])
    if np.hypot(*(kept[-1] - kept[-2])) < 1e-3:
        kept = np.delete(kept, -2, axis=0)
    return replace(leg, points=kept if metres > 0.0 else kept[::-1])
