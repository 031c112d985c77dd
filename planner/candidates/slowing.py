"""How turns that a tractor follows badly are better driven: more slowly, or another way; tried on the turn alone.

Slowing makes some turns worse, so that driving tells.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.candidates.rerouting import another_way, with_turns
from planner.candidates.steady import ASIDE_M, Slip, tracks_begun, turn_start
from planner.candidates.turn_alone import turn_of
from planner.site import Site
from vehicle.missions import Leg, Plan

SLOWER = (0.6, 0.36)
WORTH_M = 0.05  # of being nearer to the line: less is not worth the time


Cured = dict[bytes, tuple[Leg, ...]]
"""Legs that turns are better driven by, by what the turns are."""


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


def cured_turns(plan: Plan, cured: Iterable[Cure], site: Site) -> Cured:
    """How turns of a plan are better driven, for other plans that have them; without those in which others count."""
    return {turn_of(plan, cure.slip, site).key: cure.legs for cure in cured if _by_itself(cure.legs)}


def with_cured(plan: Plan, cured: Mapping[bytes, tuple[Leg, ...]], site: Site) -> Plan:
    """The plan with the turns that are known to be better driven otherwise; itself where it has none of them."""
    turns = {}
    for tractor, mission in enumerate(plan.missions if cured else ()):
        for leg in tracks_begun(mission):
            first = turn_start(mission, leg)
            better = cured.get(turn_of(plan, Slip(tractor, leg, 0.0), site).key)
            if better is not None and _by_itself(mission.legs[first:leg]):
                turns[tractor, first, leg] = _as_begun(mission.legs[first:leg], better)
    return with_turns(plan, turns) if turns else plan


def _by_itself(legs: Sequence[Leg]) -> bool:
    """Whether a tractor follows nobody and stands nowhere on some legs."""
    return not any(leg.follow or leg.stand_s for leg in legs)


def _as_begun(legs: Sequence[Leg], better: Sequence[Leg]) -> tuple[Leg, ...]:
    """Better legs of a turn with the gates of those of a plan, which stay with each where the way is the same."""
    pairs = list(zip(legs, better, strict=False))
    if len(legs) == len(better) and all(np.array_equal(leg.points, other.points) for leg, other in pairs):
        return tuple(replace(leg, speed_mps=other.speed_mps) for leg, other in pairs)
    return tuple(replace(leg, gates=()) for leg in better)


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
