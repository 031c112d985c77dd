"""Where tanks are made good: as asked for, as the field file says, or on the headland; and whether they last."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from fields.field import Field
from fields.layout import Layout
from fields.projection import project
from planner.errors import ScenarioError, named
from planner.scenario import Scenario
from strategies.supply import HEADLAND, PLACE, TENDER, Point, Supply
from vehicle.missions import Plan

FARTHEST_M = 50.0  # a hose or a loader reaches into the field from a place no farther off


def supplied(scenario: Scenario, field: Field, supply: Supply | None) -> Supply | None:
    """What every tractor carries, with where it is made good; None where nothing is carried.

    Raises ScenarioError for a place that is none or too far off, and for a place without anything to carry.
    """
    asked = None if scenario.refill is None else scenario.refill.strip().lower()
    if supply is None:
        if asked is not None:
            raise ScenarioError(
                f"{named('refill')} says where a tank is filled or emptied, and no implement carries anything; give "
                "a farm file whose implement has capacity and rate_per_m2, or leave it out."
            )
        return None
    if asked in (HEADLAND, TENDER):
        return replace(supply, where=asked, place=None)
    place = field.refill if asked is None else _place(asked, field)
    if place is None:
        return replace(supply, where=HEADLAND, place=None)
    away = float(field.boundary.distance(shapely.Point(place)))
    if away > FARTHEST_M:
        raise ScenarioError(
            f"The place to refill lies {away:.0f} m from the field; it must be within {FARTHEST_M:g} m of it."
        )
    return replace(supply, where=PLACE, place=place)


def _place(text: str, field: Field) -> Point:
    """A place in metres of the field from degrees of longitude and latitude, or metres of a field in local metres."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    degrees = field.crs is not None
    if not (math.isfinite(x) and math.isfinite(y)) or (degrees and not (abs(x) <= 180.0 and abs(y) <= 90.0)):
        what = "longitude,latitude in degrees" if degrees else "x,y in metres, as the field is in local metres"
        raise ScenarioError(
            f"{named('refill')} {text[:40]!r} is no place; write {HEADLAND}, {TENDER} or {what}.", parameter="refill"
        )
    if field.crs is not None:
        x, y = project(np.array([[x, y]]), "EPSG:4326", field.crs)[0].tolist()
    east, north = field.origin_m
    return x - east, y - north


def check_load(supply: Supply | None, layout: Layout) -> None:
    """Raise ScenarioError where a load does not last for the longest track: nobody refills half way along one."""
    if supply is None:
        return
    longest = max((track.length for track in layout.tracks), default=0.0)
    need = supply.need(longest, layout.width_m)
    if need > supply.capacity:
        lasts_m = supply.capacity / supply.rate_per_m2 / layout.width_m
        raise ScenarioError(
            f"A capacity of {supply.capacity:g} lasts for {lasts_m:.0f} m of track at a rate of "
            f"{supply.rate_per_m2:g} per m2, and the longest track of {longest:.0f} m takes {need:.6g}; use "
            f"a capacity of {_up(need):g} or more, a lower rate, or a {named('bearing_deg')} with shorter tracks."
        )


def _up(need: float) -> float:
    """A need rounded up to three digits."""
    step = 10.0 ** (math.floor(math.log10(need)) - 2)
    return math.ceil(need / step) * step


def carried(supply: Supply) -> dict[str, float | str]:
    """What tractors carry as plain values, as a ranking tells what was asked."""
    return {
        "capacity": supply.capacity, "rate_per_m2": supply.rate_per_m2, "refill_s": supply.refill_s,
        "refill": supply.where if supply.place is None else f"{supply.place[0]:.2f},{supply.place[1]:.2f} m",
    }  # fmt: skip


def supply_words(supply: Supply) -> tuple[str, ...]:
    """What every plan takes for granted of tanks, a sentence each."""
    doing = "collects" if supply.collects else "spreads"
    begun = "starts empty and is unloaded" if supply.collects else "starts full and is refilled"
    return (
        f"Every tractor {doing} {supply.rate_per_m2:g} l or kg per m2 worked and carries {supply.capacity:g}; it "
        f"{begun} in {supply.refill_s:g} s, {place_words(supply)}.",
        f"It goes between two tracks or on a round, where that costs least time; after the last it "
        f"{'keeps what it holds' if supply.collects else 'is not refilled'}.",
    )


def on_earth(plan: Plan, field: Field) -> Plan:
    """The plan whose notes on refills have longitude and latitude as well, where the field has a place on the earth."""
    entries = plan.notes.get("refills")
    if not entries or field.crs is None:
        return plan
    degrees = field.to_wgs84([(one["x_m"], one["y_m"]) for one in entries]).tolist()
    told = [{**one, "lon": lon, "lat": lat} for one, (lon, lat) in zip(entries, degrees, strict=True)]
    return replace(plan, notes={**plan.notes, "refills": told})


def place_words(supply: Supply) -> str:
    """Where tanks are made good, in words."""
    if supply.where == HEADLAND:
        return "on the headland at the end of a track"
    if supply.where == TENDER:
        return "by a tender at the end of a track, one tractor at a time; the tender's own ways are not simulated"
    x, y = supply.place or (0.0, 0.0)
    return f"at a place ({x:.0f}, {y:.0f} m), one tractor at a time"
