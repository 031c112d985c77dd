"""Service points: where tanks are filled or emptied, and what plans say of them."""

from __future__ import annotations

import math
from dataclasses import replace

import shapely

from fields.geometry.arithmetic import NEAR_FIELD_M
from fields.geometry.field import Field
from planner.errors import RequestError, mark_parameter
from planner.request.plan_request import PlanRequest
from strategies.rules.battery_supply import BatterySupply
from strategies.rules.supply import HEADLAND, PLACE, SERVICE_VEHICLE, Point, Supply
from vehicle.missions.plan import Plan


def locate_service_point(
    request: PlanRequest, field: Field, supply: Supply | None, *, is_electric: bool = False
) -> Supply | None:
    """The supply of every tractor with its service point; None where nothing is carried.

    Tractors that are electric may be charged there. Raises RequestError for a place that cannot be read or is too far
    off, and for a place where nothing is carried or charged.
    """
    requested_place = None if request.refill is None else request.refill.strip().lower()
    if supply is None:
        if requested_place is not None and not is_electric:
            raise RequestError(
                f"{mark_parameter('refill')} says where a tank is filled or emptied, and no implement carries "
                "anything; give "
                "a farm file whose implement has capacity and rate_per_m2, an electric tractor, or leave it out."
            )
        return None
    if requested_place in (HEADLAND, SERVICE_VEHICLE):
        return replace(supply, served_at=requested_place, place=None)
    place = field.service_point if requested_place is None else _parse_service_point(requested_place, field)
    if place is None:
        return replace(supply, served_at=HEADLAND, place=None)
    distance_m = float(field.boundary.distance(shapely.Point(place)))
    if distance_m > NEAR_FIELD_M:
        raise RequestError(
            f"The place to refill or charge lies {distance_m:.0f} m from the field; it must be within "
            f"{NEAR_FIELD_M:g} m of it."
        )
    return replace(supply, served_at=PLACE, place=place)


def _parse_service_point(text: str, field: Field) -> Point:
    """A place in metres of the field from degrees of longitude and latitude, or metres of a field in local metres."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    place = field.locate_place((x, y)) if math.isfinite(x) and math.isfinite(y) else None
    if place is None:
        is_local = field.crs is None
        expected = "x,y in metres, as the field is in local metres" if is_local else "longitude,latitude in degrees"
        raise RequestError(
            f"{mark_parameter('refill')} {text[:40]!r} is not a place; write {HEADLAND}, {SERVICE_VEHICLE} or "
            f"{expected}.",
            parameter="refill",
        )
    return place


def export_supply(supply: Supply) -> dict[str, float | str | None]:
    """What tractors carry, or their batteries, as plain values for a ranking."""
    x, y = supply.place or (0.0, 0.0)
    values: dict[str, float | str | bool | None]
    if isinstance(supply, BatterySupply):
        drive = supply.meter.drive
        is_charged = drive.battery.change_s is None
        values = {
            "battery_kwh": drive.battery.capacity_kwh,
            "usable_kwh": drive.usable_kwh,
            "charger_kw": drive.battery.charger_kw if is_charged else None,
            "connect_s": drive.battery.connect_s if is_charged else None,
            "change_s": drive.battery.change_s,
        }
    else:
        values = {"capacity": supply.capacity, "rate_per_m2": supply.rate_per_m2, "refill_s": supply.stop_s}
        values |= {"collects": True} if supply.collects else {}
    return {**values, "refill": supply.served_at if supply.place is None else f"{x:.2f},{y:.2f} m"}


def describe_supply(supply: Supply) -> tuple[str, ...]:
    """What every plan assumes about tanks, or about batteries, one sentence each."""
    if isinstance(supply, BatterySupply):
        battery, usable_kwh = supply.meter.drive.battery, supply.meter.drive.usable_kwh
        if battery.change_s is None:
            way = f"is charged with {battery.charger_kw:g} kW ({battery.connect_s:g} s to connect)"
            amount = "A stop charges what the work up to the next stop needs; after the last track nothing is charged."
        else:
            way = f"is changed for a full one in {battery.change_s:g} s"
            amount = "After the last track it is not changed."
        return (
            f"Every tractor starts with a battery of {battery.capacity_kwh:g} kWh, {usable_kwh:.3g} kWh of it above "
            f"the reserve; it {way}, {describe_service_point(supply)}.",
            amount,
        )
    action = "collects" if supply.collects else "spreads"
    start_condition = "starts empty and is unloaded" if supply.collects else "starts full and is refilled"
    return (
        f"Every tractor {action} {supply.rate_per_m2:g} l or kg per m2 worked and carries {supply.capacity:g}; it "
        f"{start_condition} in {supply.stop_s:g} s, {describe_service_point(supply)}.",
        "It does so between two tracks or on a headland pass, where that costs least time, and within a track that "
        f"takes more than a load; after the last it {'keeps what it holds' if supply.collects else 'is not refilled'}.",
    )


def add_coordinates(plan: Plan, field: Field) -> Plan:
    """The plan with longitude and latitude of its stops, where the field has a coordinate system."""
    stops = plan.notes.stops
    if not stops or field.crs is None:
        return plan
    degrees = field.to_wgs84([(stop.x_m, stop.y_m) for stop in stops]).tolist()
    located = tuple(replace(stop, lon=lon, lat=lat) for stop, (lon, lat) in zip(stops, degrees, strict=True))
    return replace(plan, notes=replace(plan.notes, stops=located))


def describe_service_point(supply: Supply) -> str:
    """Where tanks are filled or emptied, or batteries charged or changed, in words."""
    if supply.place is not None:
        x, y = supply.place
        return f"at a place ({x:.0f}, {y:.0f} m), one tractor at a time"
    if isinstance(supply, BatterySupply):
        if supply.one_at_a_time:
            return "by a service vehicle at the end of a track, one tractor at a time; its own driving is not simulated"
        return "on the headland at the end of a track, where a mobile charger or full batteries are taken to stand"
    if supply.served_at == SERVICE_VEHICLE:
        return "by a tender at the end of a track, one tractor at a time; the tender's own driving is not simulated"
    return "on the headland at the end of a track"
