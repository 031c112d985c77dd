"""A turn of a plan driven alone: the end of the track before, the turn, the begin of the track it leads to.

That costs a minute of simulated time where driving the whole plan again costs hours.
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
        driven = tuple(replace(leg, gates=(), follow=None, stand_s=0.0) for leg in (*self.before, *legs, self.after))
        key, known = turn_key(driven), self.site.turns_tried
        if key not in known:
            known[key] = self._driven_off_m(driven)
        return known[key]

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
    before = (_part(legs[first - 1], -LEAD_M),) if first else ()
    return TurnAlone(site, before, legs[first : slip.leg], _part(legs[slip.leg], TAIL_M))


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
