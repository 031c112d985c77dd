"""How turns that a tractor follows badly are better driven: more slowly, or another way; tried on the turn alone.

Slowing makes some turns worse, so that driving tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.candidates.rerouting import another_way, with_turns
from planner.candidates.steady import ASIDE_M, Slip, turn_start
from planner.candidates.turn_alone import turn_of
from planner.site import Site
from vehicle.missions import Leg, Plan

SLOWER = (0.6, 0.36)
WORTH_M = 0.05  # of being nearer to the line: less is not worth the time


@dataclass(frozen=True)
class Cure:
    """A turn badly followed, the legs it is better driven by, and by how many metres it is then off."""

    slip: Slip
    legs: tuple[Leg, ...]
    metres: float


def cures(plan: Plan, bad: list[Slip], site: Site) -> list[Cure]:
    """How turns are better driven of those that were followed badly; nothing where none of them is."""
    found = (_cure(plan, slip, site) for slip in bad)
    return [cure for cure in found if cure is not None]


def left_m(turns: list[Slip], cured: list[Cure] | None = None) -> float:
    """By how many metres all turns of a run together are farther off than they need be, some of them as cured."""
    known = {(cure.slip.tractor, cure.slip.leg): cure.metres for cure in cured or ()}
    off = (known.get((slip.tractor, slip.leg), slip.metres) for slip in turns)
    return math.fsum(max(0.0, metres - ASIDE_M) for metres in off)


def mended(plan: Plan, cured: list[Cure]) -> Plan:
    """The plan with these turns driven as they are better driven."""
    turns = {}
    for cure in cured:
        tractor, leg = cure.slip.tractor, cure.slip.leg
        turns[tractor, turn_start(plan.missions[tractor], leg), leg] = cure.legs
    return with_turns(plan, turns)


def _cure(plan: Plan, slip: Slip, site: Site) -> Cure | None:
    """The quickest way found to drive a turn that keeps it near its line, or the one that comes nearest."""
    turn = turn_of(plan, slip, site)
    now = turn.off_m(turn.legs) if turn.legs else None
    if now is None:
        return None
    tried = [(turn.off_m(legs), legs) for legs in (turn.slowed(factor) for factor in SLOWER)]
    tried.append(another_way(turn, site.job(plan.tractors)))
    known = [(off, tuple(legs)) for off, legs in tried if off is not None and now - off > WORTH_M]
    better = [(slip.metres - (now - off), legs) for off, legs in known]
    if not better:
        return None
    metres, legs = min(better, key=lambda option: (max(ASIDE_M, round(option[0], 6)), _seconds(option[1])))
    return Cure(slip, legs, metres)


def _seconds(legs: tuple[Leg, ...]) -> float:
    """Seconds to drive legs at the speeds they ask for."""
    return round(math.fsum(leg.length_m / leg.speed_mps for leg in legs), 1)
