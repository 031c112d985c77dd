"""Turns that a tractor cannot follow, driven another way: with wider arcs, and where these have room.

An arc that is as tight as the tractor can drive, and short, is over before guidance has brought it there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from planner.candidates.steady import ASIDE_M
from planner.candidates.turn_alone import TurnAlone
from strategies.job import Job
from strategies.legs import driven_legs
from strategies.ways.paths import Path, Pose
from vehicle.missions import THROUGH_M, TURN, WAY, Gate, Leg, Mission, Plan

SAME_M = 1e-6
Turn = tuple[int, int, int]
"""(tractor, first leg of a turn, first leg after it)."""


def another_way(turn: TurnAlone, job: Job) -> tuple[float | None, list[Leg]]:
    """How far off (m) a tractor is on the first way that it keeps to, else on the best, and its legs; None for none."""
    best: tuple[float | None, list[Leg]] = None, []
    if not turn.before or not turn.legs or not turn.short:
        return best
    for way in _ways(turn, job):
        legs = driven_legs(job, way, replace(turn.legs[0].task, kind=WAY if way.kind == "route" else TURN))
        off = turn.off_m(legs) if legs else None
        if off is not None and (best[0] is None or off < best[0] - SAME_M):
            best = off, legs
        if best[0] is not None and best[0] <= ASIDE_M:
            break
    return best


def _ways(turn: TurnAlone, job: Job) -> Iterator[Path]:
    """Turns between the same poses: those that keep to the headland first, of these the tightest first."""
    a, b = _pose(turn.before[-1], -1), _pose(turn.after, 0)
    for finder in turn.site.roomier:
        way = finder.direct(a, b)
        if way is not None and not job.crosses(way):
            yield way


def _pose(leg: Leg, end: int) -> Pose:
    """Pose of the guided point at one end of a leg, 0 or -1."""
    (x0, y0), (x1, y1) = leg.points[:2] if end == 0 else leg.points[-2:]
    x, y = leg.points[end]
    return float(x), float(y), math.atan2(leg.gear * (y1 - y0), leg.gear * (x1 - x0))


def with_turns(plan: Plan, turns: Mapping[Turn, tuple[Leg, ...]]) -> Plan:
    """The plan with other legs for some of its turns. Who waited for something in a turn waits for its end.

    A stand in a turn comes before it, and what the plan notes of refills goes with it.
    """
    missions, refills = list(plan.missions), plan.notes.get("refills")
    for (tractor, first, last), legs in sorted(turns.items(), reverse=True):
        old = missions[tractor].legs
        if [id(leg.points) for leg in legs] == [id(leg.points) for leg in old[first:last]]:
            # Their gates are those of the plan as it is by now: legs of others may have got other numbers.
            slower = (replace(leg, speed_mps=new.speed_mps) for leg, new in zip(old[first:last], legs, strict=True))
            missions[tractor] = Mission((*old[:first], *slower, *old[last:]))
            continue
        gates = tuple(gate for leg in old[first:last] for gate in leg.gates)
        stand_s = math.fsum(leg.stand_s for leg in old[first:last])
        begun = replace(legs[0], may_wait=old[first].may_wait, gates=gates, stand_s=stand_s)
        missions[tractor] = Mission((*old[:first], begun, *legs[1:], *old[last:]))
        missions = [_renumbered(mission, tractor, first, last, legs) for mission in missions]
        refills = refills and [_noted(one, tractor, first, last, len(legs)) for one in refills]
    notes = plan.notes if refills is None else {**plan.notes, "refills": refills}
    return replace(plan, missions=tuple(missions), notes=notes)


def _noted(refill: Mapping[str, Any], tractor: int, first: int, last: int, count: int) -> dict[str, Any]:
    """What is noted of a refill, with the number of its leg as it is with another turn of so many legs."""
    leg = refill["leg"]
    if refill["tractor"] != tractor + 1 or leg < first:
        return dict(refill)
    return {**refill, "leg": first if leg < last else leg + count - (last - first)}


def _renumbered(mission: Mission, tractor: int, first: int, last: int, turn: tuple[Leg, ...]) -> Mission:
    """A mission whose gates and follow orders name the legs of a tractor as they are with another turn."""
    more, end = len(turn) - (last - first), first + len(turn) - 1

    def moved(gate: Gate) -> Gate:
        if gate.tractor != tractor or gate.leg < first:
            return gate
        if gate.leg >= last:
            return replace(gate, leg=gate.leg + more)
        return replace(gate, leg=end, after_m=max(0.0, turn[-1].length_m - THROUGH_M))

    legs = []
    for leg in mission.legs:
        if not leg.gates and leg.follow is None:
            legs.append(leg)
            continue
        follow = leg.follow
        if follow is not None and follow.tractor == tractor and follow.leg >= last:
            follow = replace(follow, leg=follow.leg + more)
        legs.append(replace(leg, gates=tuple(moved(gate) for gate in leg.gates), follow=follow))
    return Mission(tuple(legs))
