"""The batteries of electric tractors as a supply: how long they last on a layout, and where they are charged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from fields.layout.swaths import Layout
from planner.errors import attach_parameter
from planner.evaluation.field_physics import FieldPhysics
from planner.request.plan_request import PlanRequest
from planner.request.service_points import locate_service_point
from strategies.rules.battery_supply import ESTIMATE_MARGIN, BatterySupply
from strategies.rules.driving_rules import DrivingRules
from vehicle.energy.run_energy import build_leg_meter
from vehicle.model.tractor import Tractor

DETOUR_FACTOR = 1.5  # of the straight line from the farthest corner of the field to the place
AMPLE_SHARE = 0.8  # of a battery: if one is enough for all work with so much to spare, no stop is planned


def build_battery_supply(
    request: PlanRequest,
    layout: Layout,
    headland_m: float,
    rules: DrivingRules,
    tractor: Tractor,
    physics: FieldPhysics,
) -> BatterySupply | None:
    """The battery of every tractor; None for diesel, where its use is not known, and where one lasts for all work.

    `headland_m` is the length of all headland passes.

    Raises RequestError for a place to charge at that cannot be read or is too far off.
    """
    load = physics.fuel_load
    meter = None if load is None else build_leg_meter(tractor, load, physics.terrain)
    if meter is None:
        return None
    drive, ground = meter.drive, layout.field.default_ground
    lengths_m = [swath.length_m for swath in layout.swaths]
    mean_m = float(np.mean(lengths_m))
    swath_kwh = meter.compute_straight_kwh(mean_m, rules.work_speed_mps, True, ground)
    turn_m = rules.turn_s[1] * rules.turn_speed_mps
    supply = BatterySupply(
        capacity=drive.usable_kwh,
        rate_per_m2=(1.0 + ESTIMATE_MARGIN) * swath_kwh / mean_m / layout.width_m,
        stop_s=drive.stop_s,
        meter=meter,
        turn_kwh=(1.0 + ESTIMATE_MARGIN) * meter.compute_straight_kwh(turn_m, rules.turn_speed_mps, False, ground),
    )
    with attach_parameter("refill"):
        located = locate_service_point(request, layout.field, supply)
    assert isinstance(located, BatterySupply)
    worked_m = [*lengths_m, headland_m]
    if sum(supply.compute_need(length_m, layout.width_m) for length_m in worked_m) <= AMPLE_SHARE * drive.usable_kwh:
        return None
    if located.place is None:
        return located
    # The energy of the way to its place and back is set apart.
    place, corners = shapely.Point(located.place), shapely.points(shapely.get_coordinates(layout.field.boundary))
    trip_m = DETOUR_FACTOR * float(shapely.distance(place, corners).max())
    trip_kwh = (1.0 + ESTIMATE_MARGIN) * located.meter.compute_straight_kwh(trip_m, rules.turn_speed_mps, False, ground)
    return replace(located, trip_kwh=trip_kwh, capacity=located.usable_kwh - 2.0 * trip_kwh)
