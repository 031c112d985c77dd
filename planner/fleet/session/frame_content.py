"""Content of frames: reports read from them, and the scene, ticks and coverage of a fleet.

Frames have degrees and eastings, the fleet manager radians and metres of the plan.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import shapely

from planner.fleet.manager.finish_forecast import FinishDistribution
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.timed_mission import encode_leg
from planner.fleet.model.tractor_state import TractorReport
from planner.fleet.safety.motion_prediction import get_wheel_angle_rad
from planner.fleet.session.frame_timing import format_utc
from planner.fleet.session.inbound_frames import StateFrame
from vehicle.missions.plan import Mission, Plan
from vehicle.missions.plan_file import format_plan
from vehicle.sim.compile import compute_contact_boxes, compute_point_speeds


def build_report(state: StateFrame, plan: FleetPlan, time_s: float) -> TractorReport:
    """The report of a state frame of `time_s` (seconds since 1970), at the guided point beside the antenna."""
    heading_rad = math.radians(90.0 - state.heading_deg)
    aside_m = plan.tractor.antenna_right_m
    east, north = plan.saved.origin_m
    return TractorReport(
        x_m=state.easting_m - east - aside_m * math.sin(heading_rad),
        y_m=state.northing_m - north + aside_m * math.cos(heading_rad),
        heading_rad=heading_rad,
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
        errors=state.errors,
        time_s=time_s,
    )


def build_antenna_pose_values(report: TractorReport | None, plan: FleetPlan) -> dict[str, float]:
    """The place of the antenna of a report, as in a state frame; empty without one."""
    if report is None:
        return {}
    aside_m, heading_angle_rad = plan.tractor.antenna_right_m, report.heading_rad
    east, north = plan.saved.origin_m
    return {
        "easting_m": round(report.x_m + east + aside_m * math.sin(heading_angle_rad), 4),
        "northing_m": round(report.y_m + north - aside_m * math.cos(heading_angle_rad), 4),
        "heading_deg": round(compute_heading_deg(heading_angle_rad), 4),
    }


def compute_heading_deg(angle_rad: float) -> float:
    """Compass heading in [0, 360) of a mathematical angle."""
    return (90.0 - math.degrees(angle_rad)) % 360.0


def describe_mission(plan: FleetPlan, number: int) -> dict[str, Any]:
    """The legs of a tractor as a saved plan of one tractor, without gates: releases replace them."""
    legs = tuple(replace(leg, gates=(), follow=None) for leg in plan.timed_missions[number].legs)
    alone, saved = Plan((Mission(legs),)), plan.saved
    speeds = compute_point_speeds(alone, plan.tractor)
    text = format_plan(alone, crs=saved.crs, origin_m=saved.origin_m, point_speeds=speeds)
    document: dict[str, Any] = json.loads(text)
    return document


def find_next_time_s(since_midnight_s: float) -> float:
    """The next local time of day, in seconds since 1970."""
    now = datetime.now()
    shown_at = now.replace(hour=0, minute=0, second=0, microsecond=0) + timedelta(seconds=since_midnight_s)
    return (shown_at if shown_at > now else shown_at + timedelta(days=1)).timestamp()


def build_scene(manager: FleetManager, deadline_s: float | None) -> dict[str, Any]:
    """The scene frame; points in metres of the coordinate system."""
    plan, field, origin_m = manager.plan, manager.plan.field, manager.plan.saved.origin_m
    outlines, blocks = list[list[list[float]]](), list[list[list[float]]]()
    if field is not None:
        rings = (field.boundary.exterior, *field.boundary.interiors)
        outlines = [_encode_points(ring.coords[:-1], field.origin_m) for ring in rings]
        parts = shapely.get_parts([obstacle.shape for obstacle in field.obstacles])
        blocks = [_encode_points(part.exterior.coords[:-1], field.origin_m) for part in parts]
    boxes = {name: round(metres, 3) for name, metres in compute_contact_boxes(plan.tractor, plan.implement).items()}
    machine = {
        "boxes_m": boxes,
        "antenna_forward_m": plan.tractor.guide_m,
        "wheelbase_m": plan.tractor.wheelbase_m,
        "max_steering_deg": plan.tractor.max_steering_deg,
    }
    return {
        "kind": "scene",
        "version": manager.scene_version,
        "crs": plan.saved.crs,
        "origin_m": list(origin_m),
        "field": outlines,
        "field_obstacles": blocks,
        "fence": [
            _encode_points(part.exterior.coords, origin_m)
            for part in shapely.get_parts(shapely.simplify(manager.guard.fence, 0.2))
        ],
        "obstacles": [
            {
                "id": block.id,
                "name": block.name,
                "who": block.who,
                "polygon_m": _encode_points(block.ring, origin_m),
            }
            for block in manager.obstacles.items.values()
        ],
        "width_m": plan.implement.width_m,
        "deadline_s": deadline_s,
        "tractors": [
            {"tractor": number + 1, "legs": [encode_leg(leg, origin_m) for leg in timed_mission.legs]} | machine
            for number, timed_mission in enumerate(plan.timed_missions)
        ],
    }


def _encode_points(points: Sequence[Sequence[float]], origin_m: tuple[float, float]) -> list[list[float]]:
    """Points in metres from an origin as in frames; heights are left out."""
    return np.round(np.array(points)[:, :2] + origin_m, 2).tolist()  # type: ignore[no-any-return]


def build_tick_tractor(manager: FleetManager, number: int, now: float, state_s: float | None) -> dict[str, Any]:
    """One tractor of a tick; `state_s` is when its last state was (since 1970). The caller fills in the twin."""
    state, report = manager.states[number], manager.states[number].report
    east, north = manager.plan.saved.origin_m
    worked_m = state.mission.worked_m[-1]
    steering_rad = None if report is None else get_wheel_angle_rad(report)
    return {
        "tractor": number + 1,
        "time": None if state_s is None else format_utc(state_s),
        "easting_m": None if report is None else round(report.x_m + east, 3),
        "northing_m": None if report is None else round(report.y_m + north, 3),
        "heading_deg": None if report is None else round(compute_heading_deg(report.heading_rad), 2),
        "speed_mps": None if report is None else round(report.speed_mps, 3),
        "steering_deg": None if steering_rad is None else round(math.degrees(steering_rad), 2),
        "twin": None,
        "connection": state.get_connection(now, manager.rules.silence_s),
        "age_s": None if report is None else round(now - state.last_fix_s, 2),
        "mode": state.mode,
        "holds": sorted(state.holds),
        "holder": manager.lease_holders.get(number),
        "leg": state.leg,
        "leg_m": round(state.leg_m, 2),
        "base_end": state.base_end,
        "waits_for": [{"tractor": awaited + 1, "leg": leg} for awaited, leg in manager.find_awaited_legs(number)],
        "eta_s": _round_finite(manager.finish_in_s[number]),
        "late_s": _round_finite(manager.estimate_delay_s(number, now)),
        "error_m": None,
        "error_deg": None,
        "done_pct": 100.0 if worked_m == 0.0 else round(100.0 * state.worked_m / worked_m, 2),
        "possible_area": _describe_possible_area(manager, number),
    }


def _describe_possible_area(manager: FleetManager, number: int) -> dict[str, float] | None:
    """The circle that a tractor in doubt may be in now, and how fast that grows; None for any other."""
    state = manager.states[number]
    area = manager.guard.build_area(number, state)
    if area is None or state.doubt is None:
        return None
    east, north = manager.plan.saved.origin_m
    return {
        "easting_m": round(float(area.centre[0]) + east, 2),
        "northing_m": round(float(area.centre[1]) + north, 2),
        "radius_m": round(float(area.radii_m[0]), 2),
        "growth_mps": round(state.doubt.speed_mps * manager.rules.times, 3),
    }


def build_tick_fleet(
    manager: FleetManager, deadline_s: float | None, finish_distribution: FinishDistribution | None
) -> dict[str, Any]:
    """The fleet in a tick; the deadline in seconds from now, with the probability of meeting it, if known."""
    done_m, worked_m = manager.compute_total_worked_m(), manager.plan.worked_m
    finish_s = max(
        (s for s, state in zip(manager.finish_in_s, manager.states, strict=True) if not state.has_no_more_legs),
        default=math.inf,
    )
    probability = None
    if finish_distribution is not None and deadline_s is not None:
        probability = finish_distribution.compute_probability(
            finish_s * manager.rules.times, deadline_s * manager.rules.times
        )
    return {
        "state": manager.state,
        "eta_s": _round_finite(finish_s),
        "done_pct": round(100.0 * done_m / worked_m, 2) if worked_m else 100.0,
        "done_m2": round(done_m * manager.plan.implement.width_m, 1),
        "deadline_s": _round_finite(deadline_s),
        "probability": probability,
    }


def build_alarms(manager: FleetManager) -> dict[str, Any]:
    """The alarms frame, with UTC times."""
    clock_s, now = time.time(), time.monotonic()
    items = manager.alarms.describe_alarms()
    for item in items:
        item["since"] = format_utc(clock_s - (now - item["since"]), "seconds")
    return {"kind": "alarms", "items": items}


def build_coverage(manager: FleetManager, number: int, first: int) -> dict[str, Any] | None:
    """The coverage frame of a tractor after the first points; None for nothing new."""
    points = manager.coverage_lines[number][first:]
    if not points:
        return None
    east, north = manager.plan.saved.origin_m
    encoded = [None if point is None else [round(point[0] + east, 2), round(point[1] + north, 2)] for point in points]
    return {"kind": "coverage", "tractor": number + 1, "first": first, "points": encoded}


def _round_finite(value: float | None) -> float | None:
    return round(value, 1) if value is not None and math.isfinite(value) else None
