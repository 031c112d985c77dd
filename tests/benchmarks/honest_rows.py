"""Blocks of rows side by side as a fleet plan, and the path of one block as a table by metres.

All robots drive rows with half circles and fishtail turns (which reverse) in turn; every other block is mirrored, so
that two robots begin beside each other and two end so.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from fields.arrays import Floats, Integers
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.timed_mission import TimedMission
from tests.service.fleets import fleet_plan
from vehicle.missions.plan import SWATH, TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.plan_file import SavedPlan

RADIUS_M, ROW_M, GAP_M, TURN_MPS, BRAKE_MPS2 = 5.0, 3.0, 3.0, 1.2, 0.5


def lay_rows(pairs: int, length_m: float, speed_mps: float) -> tuple[Leg, ...]:
    """The legs of one block from its west: rows with half circles and fishtails in turn, and a last half circle."""
    legs, x, way = list[Leg](), 0.0, 1.0

    def add(points: list[tuple[float, float]], gear: int = 1, *, is_row: bool = False) -> None:
        task = LegTask(SWATH if is_row else TURN, len(legs))
        legs.append(Leg(np.array(points), speed_mps if is_row else TURN_MPS, gear, is_row, task=task))

    def bend(first_rad: float, last_rad: float, middle_x: float) -> list[tuple[float, float]]:
        angles = np.linspace(first_rad, last_rad, 25)
        top = length_m if way > 0.0 else 0.0
        return [(middle_x - RADIUS_M * math.cos(a), top + way * RADIUS_M * math.sin(a)) for a in angles]

    for row in range(2 * pairs):
        ends = (0.0, length_m) if way > 0.0 else (length_m, 0.0)
        add([(x, y) for y in ends], is_row=True)
        if row % 2 == 0:
            add(bend(0.0, math.pi, x + RADIUS_M))
            x += 2.0 * RADIUS_M
        elif row < 2 * pairs - 1:
            add(bend(0.0, 0.5 * math.pi, x + RADIUS_M))
            (x1, y1) = legs[-1].points[-1]
            add([(x1, y1), (x1 + ROW_M - 2.0 * RADIUS_M, y1)], gear=-1)
            add(bend(0.5 * math.pi, math.pi, x + ROW_M - RADIUS_M))
            x += ROW_M
        way = -way
    return tuple(legs)


@dataclass(frozen=True)
class Blocks:
    """A fleet plan of blocks side by side, and the path of the first of them as a table by metres."""

    plan: FleetPlan
    at_m: Floats
    places: Floats
    headings_rad: Floats
    allowed_mps: Floats
    gears: Floats
    leg_starts_m: Floats
    offsets_m: Floats
    ways: Floats

    def find_poses(self, at_m: Floats) -> tuple[Floats, Floats]:
        """Places (n, 2) and headings (n,) of all robots at their metres on their paths."""
        x, y = (np.interp(at_m, self.at_m, column) for column in self.places.T)
        heading_rad = np.interp(at_m, self.at_m, self.headings_rad)
        heading_rad = np.where(self.ways > 0.0, heading_rad, math.pi - heading_rad)
        return np.column_stack([self.offsets_m + self.ways * x, y]), heading_rad

    def find_gears(self, at_m: Floats) -> Floats:
        """The gears (n,) at places."""
        gears: Floats = self.gears[np.minimum(np.searchsorted(self.at_m, at_m), len(self.gears) - 1)]
        return gears

    def find_legs(self, at_m: Floats) -> Integers:
        """The legs (n,) of places."""
        return np.clip(np.searchsorted(self.leg_starts_m, at_m, side="right") - 1, 0, len(self.leg_starts_m) - 2)


def lay_blocks(tractors: int, rng: np.random.Generator) -> Blocks:
    """Blocks of a fleet; the length of rows and the speed on them are drawn."""
    pairs, length_m, speed_mps = 5, float(rng.uniform(120.0, 260.0)), float(rng.uniform(1.5, 4.0))
    legs = lay_rows(pairs, length_m, speed_mps)
    width_m = max(float(leg.points[:, 0].max()) for leg in legs)
    ways = np.where(np.arange(tractors) % 2 == 0, 1.0, -1.0)
    offsets_m = np.arange(tractors) * (width_m + ROW_M + GAP_M) + np.where(ways > 0.0, 0.0, width_m)
    missions = tuple(
        Mission(tuple(replace(leg, points=leg.points * (way, 1.0) + (offset_m, 0.0)) for leg in legs))
        for way, offset_m in zip(ways, offsets_m, strict=True)
    )
    seconds = tuple(leg.length_m / leg.speed_mps for leg in legs)
    reach_m = RADIUS_M + 5.0
    model = fleet_plan(1)
    plan = replace(
        model,
        saved=SavedPlan(Plan(missions), None, (1000.0, 2000.0), {}),
        timed_missions=tuple(TimedMission(mission, seconds) for mission in missions),
        finish_s=(sum(seconds),) * tractors,
        min_clearance_m=ROW_M + GAP_M - model.implement.width_m,
        ground=shapely.box(-reach_m, -reach_m, offsets_m.max() + width_m + reach_m, length_m + reach_m),
    )
    return _tabulate(plan, legs, offsets_m, ways)


def _tabulate(plan: FleetPlan, legs: tuple[Leg, ...], offsets_m: Floats, ways: Floats) -> Blocks:
    places, headings_rad, limits_mps, gears = [legs[0].points[:1]], [0.5 * math.pi], [0.0], [1.0]
    for leg, following in pairwise([*legs, None]):
        assert leg is not None
        steps = np.diff(leg.points, axis=0)
        parts = np.maximum(np.ceil(np.hypot(*steps.T) / 0.1).astype(int), 1)
        for start, step, count in zip(leg.points, steps, parts, strict=False):
            places.append(start + np.outer(np.arange(1, count + 1) / count, step))
            course_rad = math.atan2(step[1], step[0]) + (0.0 if leg.gear > 0 else math.pi)
            headings_rad += [course_rad] * count
            limits_mps += [leg.speed_mps] * count
            gears += [float(leg.gear)] * count
        if following is None or following.gear != leg.gear:
            limits_mps[-1] = 0.1
    points = np.vstack(places)
    at_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    allowed_mps = np.array(limits_mps)
    allowed_mps[0] = allowed_mps[1]
    for place in range(len(at_m) - 2, -1, -1):
        braking_mps = math.sqrt(allowed_mps[place + 1] ** 2 + 2.0 * BRAKE_MPS2 * (at_m[place + 1] - at_m[place]))
        allowed_mps[place] = min(allowed_mps[place], braking_mps)
    starts_m = np.array(plan.timed_missions[0].leg_starts_m)
    return Blocks(plan, at_m, points, np.unwrap(headings_rad), allowed_mps, np.array(gears), starts_m, offsets_m, ways)
