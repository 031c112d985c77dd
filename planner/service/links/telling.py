"""The picture of a fleet as frames for pages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely

from planner.service.centre.centre import Centre
from planner.service.centre.chances import Chances
from planner.service.centre.course import leg_told
from planner.service.links.converting import heading_deg
from vehicle.compile import outline


def scene(centre: Centre, deadline_s: float | None) -> dict[str, Any]:
    """All that changes seldom; points in metres of the coordinate system."""
    plan = centre.plan
    origin = np.asarray(plan.saved.origin_m)
    boxes = {name: round(metres, 3) for name, metres in outline(plan.tractor, plan.implement).items()}
    machine = {
        "boxes_m": boxes, "antenna_forward_m": plan.tractor.antenna_forward_m - plan.tractor.rear_axle_m,
        "wheelbase_m": plan.tractor.wheelbase_m, "max_steering_deg": plan.tractor.max_steering_deg,
    }  # fmt: skip
    fence = [np.asarray(part.exterior.coords) for part in shapely.get_parts(shapely.simplify(centre.guard.fence, 0.2))]
    return {
        "kind": "scene", "version": centre.version * 1000 + centre.obstacles.version, "crs": plan.saved.crs,
        "origin_m": list(plan.saved.origin_m),
        "field": [_told(np.asarray(ring) + origin) for ring in plan.rings],
        "field_obstacles": [_told(np.asarray(ring) + origin) for ring in plan.obstacles],
        "fence": [_told(ring + origin) for ring in fence],
        "obstacles": [
            {"id": block.id, "name": block.name, "who": block.who, "polygon_m": _told(np.asarray(block.ring) + origin)}
            for block in centre.obstacles.items.values()
        ],
        "width_m": plan.implement.width_m, "deadline_s": deadline_s,
        "tractors": [
            {"tractor": number + 1, "legs": [leg_told(leg, plan.saved.origin_m) for leg in course.legs]} | machine
            for number, course in enumerate(plan.courses)
        ],
    }  # fmt: skip


def _told(points: np.ndarray) -> list[list[float]]:
    return np.round(points, 2).tolist()  # type: ignore[no-any-return]


def tractor_told(centre: Centre, number: int, now: float, time: str | None) -> dict[str, Any]:
    """One tractor of a tick; `time` is that of its last state. The twin's entries are for whoever has one."""
    state, report = centre.states[number], centre.states[number].report
    east, north = centre.plan.saved.origin_m
    worked = centre.courses[number].worked_m[-1]
    done = worked if state.done else centre.courses[number].done_m(state.leg, state.leg_m)
    steering = None
    if report is not None:
        steering = report.steering_command_rad if report.steering_rad is None else report.steering_rad
    return {
        "tractor": number + 1, "time": time,
        "easting_m": None if report is None else round(report.x_m + east, 3),
        "northing_m": None if report is None else round(report.y_m + north, 3),
        "heading_deg": None if report is None else round(heading_deg(report.heading_rad), 2),
        "speed_mps": None if report is None else round(report.speed_mps, 3),
        "steering_deg": None if steering is None else round(math.degrees(steering), 2),
        "twin": None,
        "connection": state.connection(now, centre.rules.silence_s),
        "age_s": None if report is None else round(now - state.seen_s, 2),
        "mode": state.mode, "holds": sorted(state.holds), "holder": centre.leases.holder(number),
        "leg": state.leg, "leg_m": round(state.leg_m, 2), "released": state.released,
        "waits_for": [{"tractor": other + 1, "leg": leg} for other, leg in centre.waits_for(number)],
        "eta_s": _finite(centre.finish_in_s[number]), "late_s": _finite(centre.late_s(number, now)),
        "error_m": None, "error_deg": None,
        "done_pct": 100.0 if worked == 0.0 else round(100.0 * done / worked, 2),
    }  # fmt: skip


def fleet_told(centre: Centre, deadline_s: float | None, chances: Chances | None) -> dict[str, Any]:
    """The fleet in a tick; the deadline in seconds from now, with the probability of keeping it where it is known."""
    done, worked = centre.done_m(), centre.plan.worked_m
    finish = max((s for s, state in zip(centre.finish_in_s, centre.states, strict=True) if not state.out),
                 default=math.inf)  # fmt: skip
    probability = None
    if chances is not None and deadline_s is not None:
        probability = chances.in_time(finish * centre.rules.times, deadline_s * centre.rules.times)
    return {
        "state": centre.state, "eta_s": _finite(finish),
        "done_pct": round(100.0 * done / worked, 2) if worked else 100.0,
        "done_m2": round(done * centre.plan.implement.width_m, 1), "deadline_s": _finite(deadline_s),
        "probability": probability,
    }  # fmt: skip


def painted(centre: Centre, number: int, first: int) -> dict[str, Any] | None:
    """What a tractor has worked after the first so many points; None for nothing."""
    points = centre.painting.since(number, first)
    if not points:
        return None
    east, north = centre.plan.saved.origin_m
    told = [None if point is None else [round(point[0] + east, 2), round(point[1] + north, 2)] for point in points]
    return {"kind": "painted", "tractor": number + 1, "first": first, "points": told}


def _finite(value: float | None) -> float | None:
    return round(value, 1) if value is not None and math.isfinite(value) else None
