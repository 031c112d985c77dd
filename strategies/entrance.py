"""The ways from the entrance of a field to where every tractor begins, and back to it, as legs of a plan.

Before it begins a tractor stands on the road, and once it has left it is gone: in nobody's way. All come in by one
gate, one after another, each when the one before it is clear of it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from strategies.errors import StrategyError
from strategies.headland.laps import link
from strategies.headland.rounds import STOPS_M, renumbered
from strategies.job import Job
from strategies.legs import driven_legs, mission_from, with_stops
from strategies.ways.gateway import Gateway
from strategies.ways.paths import Path, Pose, join, straight
from vehicle.missions import ENTER, LEAVE, Gate, Leg, Mission, Plan, Task

STRAIGHT_ON = (0.0, 1.5, 3.0, 6.0)  # radii straight on from the gate before the first turn
GOAL_M = 40.0  # so far before work begins a way in belongs to it: where that is begun aside, only so much is slowed


def with_entrance(job: Job, plan: Plan) -> Plan:
    """The plan with every tractor driving in by the gate of the job, and out by it; as it is where there is none.

    Raises StrategyError where no way leads in or out.
    """
    if job.gate is None:
        return plan
    ways = [(_way_in(job, job.gate, one), way_out(job, job.gate, one)) for one in plan.missions]
    moved = [len(before) for before, _ in ways]
    missions = []
    for mission, (before, after) in zip(plan.missions, ways, strict=True):
        missions.append(mission_from([*before, *renumbered(mission.legs, moved), *after]))
    return _one_by_one(job, plan, missions)


def _way_in(job: Job, gate: Gateway, mission: Mission) -> list[Leg]:
    """The legs from the gate to the start of a mission."""
    path = _shortest_straight(job, gate, mission.start, outwards=False)
    if path is None:
        raise _no_way(job, mission.start, "the entrance to where work begins")
    goal = mission.legs[0].task
    legs, left = list[Leg](), path.length_m
    for leg in with_stops(driven_legs(job, path, Task(ENTER)), STOPS_M):
        near = left <= GOAL_M
        legs.append(replace(leg, task=replace(goal, kind=ENTER)) if near else leg)
        left -= leg.length_m
    return legs


def way_out(job: Job, gate: Gateway, mission: Mission) -> list[Leg]:
    """The legs from the end of a mission to the gate."""
    path = _shortest_straight(job, gate, mission.end, outwards=True)
    if path is None:
        raise _no_way(job, mission.end, "where work ends to the entrance")
    return with_stops(driven_legs(job, path, Task(LEAVE)), STOPS_M)


def _shortest_straight(job: Job, gate: Gateway, pose: Pose, *, outwards: bool) -> Path | None:
    """The way between the gate and a pose that goes straight through it no farther than it has to; None for none."""
    for radii in STRAIGHT_ON:
        more = radii * job.manner.radius_m
        if not job.connector.fits(straight(gate.inside, more)):
            return None
        lead = gate.out(more) if outwards else gate.into(more)
        ends = (pose, lead.start) if outwards else (lead.end, pose)
        way = link(job, *ends, anyhow=True, beside=job.standing and not outwards)
        if way is not None:
            return join((way, lead) if outwards else (lead, way), way.kind)
    return None


def _no_way(job: Job, pose: Pose, words: str) -> StrategyError:
    return StrategyError(
        f"No way of turning radius {job.manner.radius_m:.1f} m leads from {words} (at {pose[0]:.0f}, {pose[1]:.0f} m) "
        "inside the field; a wider headland or another entrance may."
    )


def _one_by_one(job: Job, plan: Plan, missions: list[Mission]) -> Plan:
    """The missions with a gate each on the one that comes in before it.

    Whoever others wait for at the start goes first, then the one that has most to drive.
    """
    before = [{gate.tractor for gate in mission.legs[0].gates} for mission in plan.missions]
    driven = [round(math.fsum(leg.length_m / leg.speed_mps for leg in mission.legs), 1) for mission in missions]
    order: list[int] = []
    while len(order) < len(missions):
        left = [one for one in range(len(missions)) if one not in order]
        free = [one for one in left if before[one] <= set(order)] or left
        order.append(min(free, key=lambda one: (-driven[one], one)))
    whole = Plan(tuple(missions), plan.notes)
    for first, second in pairwise(order):
        whole = whole.with_gate(second, 0, _clear(job, first, missions[first]))
    return whole


def _clear(job: Job, tractor: int, mission: Mission) -> Gate:
    """Gate that opens when a tractor is its own length and a little more from where it came in."""
    rears, fronts, _ = zip(*job.manner.boxes, strict=True)
    left = max(fronts) - min(rears) + job.manner.ahead_m
    for number, leg in enumerate(mission.legs):
        if left <= leg.length_m:
            return Gate(tractor, number, left)
        left -= leg.length_m
    return Gate(tractor, len(mission.legs) - 1, mission.legs[-1].length_m)
