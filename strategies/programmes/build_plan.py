"""A programme as a plan, in which who has nothing to do stands in nobody's way."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from strategies.moves.drives import build_move_legs
from strategies.path_planning.paths import Pose
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme
from strategies.programmes.tour_legs import build_mission, build_stand
from strategies.programmes.waiting_places import StandingCheck
from strategies.programmes.ways_home import Way, build_way
from vehicle.missions.plan import ROUTE, Leg, LegTask, Mission, Plan

PARKING_STEPS = 8  # each way from where a tractor stands, half a reach of machines long
MOST_TRIED = 20  # of the places to park that are free: where the nearest are not reached few others are


def build_plan(programme: Programme, **notes: Any) -> Plan:
    """The plan of a programme, one mission per tractor that has lines or stands on the field."""
    table, tours = programme.table, programme.tours
    missions = tuple(
        build_mission(table, tours[number]) if tours[number] else build_stand(table, table.starts[number])
        for number in programme.list_present()
    )
    return Plan(missions, {"tractors": len(missions), **notes})


def clear_ways(plan: Plan, table: MoveTable, check: StandingCheck) -> Plan:
    """The plan with every tractor that rests in the way of others driving to the nearest place where it is in none.

    It stays where it stands if no such place is reached.
    """
    missions, back_m = list(plan.missions), table.site.body.guide_m - table.site.axle_m
    for number in (resting - 1 for resting in plan.resting):
        ways = [build_way(mission, back_m) for place, mission in enumerate(missions) if place != number]
        places = _iter_free_places(missions[number].end, ways, back_m, check)
        for pose in islice(places, MOST_TRIED):
            legs = _list_parking_legs(table, missions[number], pose)
            if legs is not None:
                missions[number] = Mission(legs)
                break
    return replace(plan, missions=tuple(missions))


def _list_parking_legs(table: MoveTable, mission: Mission, pose: Pose) -> tuple[Leg, ...] | None:
    """The legs of a tractor that rests, to a pose; None where no way leads there."""
    finder, (stand, *_) = table.moves.finder, mission.legs
    if math.dist(mission.end[:2], pose[:2]) == 0.0:
        return mission.legs
    moves = finder.list_folded_moves(mission.end, pose) if stand.folded else finder.list_moves(mission.end, pose)
    found = next(iter(moves), None) or (None if stand.folded else finder.search(mission.end, pose))
    if found is None:
        return None
    return (stand, *build_move_legs(table.site, replace(found, begins_folded=stand.folded), LegTask(ROUTE)))


def _iter_free_places(stand: Pose, ways: list[Way], back_m: float, check: StandingCheck) -> Iterator[Pose]:
    """Poses beside one, itself first and then the nearest, at which a tractor is in the way of no others."""
    x, y, heading = stand
    steps_m = 0.5 * check.reach_m * np.arange(-PARKING_STEPS, PARKING_STEPS + 1)
    ahead_m, aside_m = (values.ravel() for values in np.meshgrid(steps_m, steps_m))
    nearest = np.argsort(np.hypot(ahead_m, aside_m), kind="stable")
    ahead_m, aside_m = ahead_m[nearest], aside_m[nearest]
    cosine, sine = math.cos(heading), math.sin(heading)
    xs, ys = x + ahead_m * cosine - aside_m * sine, y + ahead_m * sine + aside_m * cosine
    middles = np.column_stack([xs - back_m * cosine, ys - back_m * sine, np.full(len(xs), heading)])
    blocked = check.find_blocked(middles, [way.path for way in ways])
    for place in np.flatnonzero(~blocked).tolist():
        yield float(xs[place]), float(ys[place]), heading
