"""Between frames and the centre: degrees and eastings outside, radians and metres of the plan inside."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

from planner.service.centre.fleet_plan import FleetPlan
from planner.service.centre.tractors import Report
from planner.service.links.frames import State
from vehicle.missions import Leg, Mission, Plan
from vehicle.plan_file import SavedPlan, plan_to_json


def report_of(state: State, plan: FleetPlan) -> Report:
    """What a state says, at the guided point abreast of the antenna."""
    heading = math.radians(90.0 - state.heading_deg)
    aside = plan.tractor.antenna_right_m
    east, north = plan.saved.origin_m
    return Report(
        x_m=state.easting_m - east - aside * math.sin(heading),
        y_m=state.northing_m - north + aside * math.cos(heading),
        heading_rad=heading,
        speed_mps=state.speed_mps,
        speed_command_mps=state.speed_command_mps,
        steering_command_rad=math.radians(state.steering_command_deg),
        steering_rad=None if state.steering_deg is None else math.radians(state.steering_deg),
        shuttle=state.shuttle,
        mode=state.mode,
        leg=state.leg,
        leg_m=max(state.leg_m, 0.0),
        implement=state.implement,
        done=state.done,
        errors=tuple(state.errors),
        time_s=state.time.timestamp(),
    )


def place_told(report: Report | None, plan: FleetPlan) -> dict[str, float]:
    """Where an antenna was by a report, as `report_of` takes it; empty without one."""
    if report is None:
        return {}
    aside, heading = plan.tractor.antenna_right_m, report.heading_rad
    east, north = plan.saved.origin_m
    return {
        "easting_m": round(report.x_m + east + aside * math.sin(heading), 4),
        "northing_m": round(report.y_m + north - aside * math.cos(heading), 4),
        "heading_deg": round(heading_deg(heading), 4),
    }  # fmt: skip


def heading_deg(angle_rad: float) -> float:
    """Compass heading in [0, 360) of a mathematical angle."""
    return (90.0 - math.degrees(angle_rad)) % 360.0


def mission_told(plan: FleetPlan, number: int) -> dict[str, Any]:
    """A tractor's own legs as a saved plan of one tractor, gates left out: the centre's releases stand for them."""
    legs = tuple(alone(leg) for leg in plan.courses[number].legs)
    text = plan_to_json(Plan((Mission(legs),)), crs=plan.saved.crs, origin_m=plan.saved.origin_m)
    told: dict[str, Any] = json.loads(text)
    return told


def alone(leg: Leg) -> Leg:
    """A leg that waits for nobody."""
    return replace(leg, gates=(), follow=None)


def metres_of(saved: SavedPlan, ring: list[list[float]]) -> tuple[tuple[float, float], ...]:
    """Eastings and northings as metres of the plan."""
    east, north = saved.origin_m
    return tuple((x - east, y - north) for x, y in ring)


def next_shown(since_midnight_s: float) -> float:
    """The next time that the clock of this machine shows this, in seconds since 1970."""
    now = datetime.now()
    at = now.replace(hour=0, minute=0, second=0, microsecond=0) + timedelta(seconds=since_midnight_s)
    return (at if at > now else at + timedelta(days=1)).timestamp()
