"""How much more slowly a turn is best driven that a tractor follows badly: tried on the turn alone.

A tractor drives the end of the track before, the turn, and the begin of the track it leads to. That costs a minute of
simulated time where driving the whole plan again costs hours, and slowing makes some turns worse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import blake2b

import numpy as np
import numpy.typing as npt

from planner.candidates.steady import LONGEST_M, Slip, slips, turn_start, worst_aside
from planner.site import Site
from vehicle.missions import Leg, Mission, Plan
from vehicle.run import DONE
from vehicle.world import simulate

SLOWER = (0.6, 0.36)
LEAD_M, TAIL_M = 40.0, 2.0  # of the tracks before and after: enough to come to speed and to settle
LONGEST_S = 900.0
WORTH_M = 0.05  # of being nearer to the line: less is not worth the time
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Cure:
    """A turn badly followed, how much more slowly it is to be driven, and by how many metres it is then off."""

    slip: Slip
    factor: float
    metres: float


def cures(plan: Plan, bad: list[Slip], site: Site) -> list[Cure]:
    """The turns before which a tractor had better slow down, of those that it followed badly."""
    found = [(slip, _best(plan, slip, site)) for slip in bad]
    return [Cure(slip, factor, slip.metres - gain) for slip, (gain, factor) in found if factor < 1.0]


def promised_m(turns: list[Slip], cured: list[Cure]) -> float:
    """What the worst turn of a run is then expected to be off (m)."""
    known = {(cure.slip.tractor, cure.slip.leg) for cure in cured}
    others = (slip.metres for slip in turns if (slip.tractor, slip.leg) not in known)
    return max([*others, *(cure.metres for cure in cured)], default=0.0)


def slowed(plan: Plan, cured: list[Cure]) -> Plan:
    """The plan with these turns driven more slowly."""
    missions = list(plan.missions)
    for cure in cured:
        number, leg = cure.slip.tractor, cure.slip.leg
        legs = list(missions[number].legs)
        first = turn_start(missions[number], leg)
        legs[first:leg] = _slow(legs[first:leg], cure.factor)
        missions[number] = Mission(tuple(legs))
    return replace(plan, missions=tuple(missions))


def _slow(legs: list[Leg], factor: float) -> list[Leg]:
    """Legs of a turn at a share of their speed; a route among them stays as it is."""
    return [replace(leg, speed_mps=factor * leg.speed_mps) if leg.length_m < LONGEST_M else leg for leg in legs]


def _best(plan: Plan, slip: Slip, site: Site) -> tuple[float, float]:
    """By how much (m) a turn comes out nearer to its line, and at what share of its speed."""
    legs = plan.missions[slip.tractor].legs
    first = turn_start(plan.missions[slip.tractor], slip.leg)
    before = [_part(legs[first - 1], -LEAD_M)] if first else []
    turn, after = list(legs[first : slip.leg]), _part(legs[slip.leg], TAIL_M)
    off = [_off([*before, *_slow(turn, factor), after], site) for factor in (1.0, *SLOWER)]
    best = (0.0, 1.0)
    for each, factor in zip(off[1:], SLOWER, strict=True):
        gain = 0.0 if off[0] is None or each is None else round(off[0] - each, 6)
        best = (gain, factor) if gain > best[0] + WORTH_M else best
    return best


def _off(legs: list[Leg], site: Site) -> float | None:
    """How far off a tractor is that drives these legs alone (m); None where it does not come through.

    The same turn is driven once, whichever plans of a site have it.
    """
    key = _key(legs)
    if key not in site.turns_tried:
        site.turns_tried[key] = _driven_off(legs, site)
    return site.turns_tried[key]


def _key(legs: list[Leg]) -> bytes:
    """All that decides how a tractor drives legs alone, in short."""
    manner = [(len(leg.points), leg.speed_mps, leg.gear, leg.implement, leg.ground, leg.task) for leg in legs]
    told = repr(manner).encode() + np.concatenate([leg.points for leg in legs]).tobytes()
    return blake2b(told, digest_size=16).digest()


def _driven_off(legs: list[Leg], site: Site) -> float | None:
    alone = Plan((Mission(tuple(replace(leg, gates=(), follow=None) for leg in legs)),))
    run = simulate(alone, site.tractor, site.implement, max_time_s=LONGEST_S)
    return worst_aside(slips(run, site)) if run.outcome == DONE else None


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
