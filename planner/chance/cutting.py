"""Legs of a run cut in two or more, so that a tractor can be told to wait on the way along one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from vehicle.layout import REC_LEG
from vehicle.missions import Follow, Gate, Leg, Mission, Plan
from vehicle.run import Run

SHORTEST_M = 0.5  # of what is cut off on either side
Points = npt.NDArray[np.float64]


@dataclass(frozen=True, order=True)
class Cut:
    """A place on a leg: the row of the record at which the tractor was there, and metres from the leg's beginning."""

    row: int
    metres: float


Cuts = Mapping[tuple[int, int], Sequence[Cut]]
"""Where to cut, by (tractor, leg)."""


def cut_legs(run: Run, cuts: Cuts) -> Run:
    """The same run with these legs cut: every part is a leg of its own, in the plan and in the record.

    Legs that follow, or are followed, stay whole, and nothing shorter than SHORTEST_M is cut off.
    """
    places = _allowed(run.plan, cuts)
    if not places:
        return run
    plan = _cut_plan(run.plan, places)
    record = run.record.copy()
    for tractor, mission in enumerate(run.plan.missions):
        shift = np.zeros(len(mission.legs) + 1, dtype=np.int64)
        for leg in range(len(mission.legs)):
            shift[leg + 1] = shift[leg] + len(places.get((tractor, leg), ()))
        on = run.leg(tractor)
        moved = on + shift[on]
        for (who, _), own in places.items():
            if who == tractor:
                for place in own:
                    leg_ends = int(np.searchsorted(on, on[place.row], side="right"))
                    moved[place.row : leg_ends] += 1
        record[:, tractor, REC_LEG] = moved
    return replace(run, plan=plan, record=record)


def _allowed(plan: Plan, cuts: Cuts) -> dict[tuple[int, int], list[Cut]]:
    """Those cuts that leave enough on either side of them, on legs that may be cut."""
    whole = {
        pair
        for number, mission in enumerate(plan.missions)
        for index, leg in enumerate(mission.legs)
        if leg.follow is not None
        for pair in ((number, index), (leg.follow.tractor, leg.follow.leg))
    }
    kept: dict[tuple[int, int], list[Cut]] = {}
    for key in sorted(set(cuts) - whole):
        length, last = plan.missions[key[0]].legs[key[1]].length_m, 0.0
        for place in sorted(cuts[key]):
            if last + SHORTEST_M <= place.metres <= length - SHORTEST_M:
                kept.setdefault(key, []).append(place)
                last = place.metres
    return kept


def _cut_plan(plan: Plan, places: dict[tuple[int, int], list[Cut]]) -> Plan:
    metres = {key: [place.metres for place in own] for key, own in places.items()}
    first = [
        np.concatenate(([0], np.cumsum([1 + len(metres.get((number, leg), ())) for leg in range(len(mission.legs))])))
        for number, mission in enumerate(plan.missions)
    ]

    def gate(old: Gate) -> Gate:
        ends = metres.get((old.tractor, old.leg), [])
        part = int(np.searchsorted(ends, old.after_m, side="left"))
        start = ends[part - 1] if part else 0.0
        return Gate(old.tractor, int(first[old.tractor][old.leg]) + part, old.after_m - start)

    def follow(old: Follow) -> Follow:
        return replace(old, leg=int(first[old.tractor][old.leg]))

    missions = []
    for number, mission in enumerate(plan.missions):
        legs: list[Leg] = []
        for index, leg in enumerate(mission.legs):
            legs += _parts(
                replace(leg, gates=tuple(gate(each) for each in leg.gates), follow=leg.follow and follow(leg.follow)),
                metres.get((number, index), []),
            )
        missions.append(Mission(tuple(legs)))
    return replace(plan, missions=tuple(missions))


def _parts(leg: Leg, metres: list[float]) -> list[Leg]:
    """A leg in parts; gates and stand come before the first."""
    if not metres:
        return [leg]
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(leg.points, axis=0).T))))
    edges = [0.0, *metres, float(along[-1])]
    parts = []
    for number, (start, end) in enumerate(pairwise(edges)):
        points = _between(leg.points, along, start, end)
        part = replace(leg, points=points)
        parts.append(part if number == 0 else replace(part, gates=(), may_wait=False, stand_s=0.0))
    return parts


def _between(points: Points, along: Points, start: float, end: float) -> Points:
    """The polyline from one distance along it to another."""
    inside = (along > start + 1e-3) & (along < end - 1e-3)
    ends = np.array([[np.interp(at, along, points[:, axis]) for axis in (0, 1)] for at in (start, end)])
    return np.vstack([ends[:1], points[inside], ends[1:]])
