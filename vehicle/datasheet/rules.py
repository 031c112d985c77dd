"""The rules that fill a tractor file from a datasheet, each with its words for [source].

A rule hands back its value and its source: "given", or "assumed: " and the rule.
"""

from __future__ import annotations

import math

from vehicle.chassis import GRAVITY
from vehicle.datasheet.sheet import (
    FRONT_SHARE,
    OUTER_WHEEL,
    QUANTITIES,
    TRACK_SHARE,
    Datasheet,
    antenna_forward_m,
    rear_axle_m,
    track_m,
)
from vehicle.tractor import POWER_LAW_M, PowerLaw, Tractor

GIVEN = "given"
MASS_PER_POWER = 50.0
DRIVE_SHARE = 0.4
Sourced = tuple[float, str]


def mass(sheet: Datasheet, like: Tractor) -> Sourced:
    """Mass in kg: given, by power, or by the footprint."""
    if sheet.mass_kg is not None:
        return sheet.mass_kg, GIVEN
    if sheet.power_kw is not None:
        rule = f"{MASS_PER_POWER:g} kg per kW, as the {like.name} (77 kW); a ballasted tractor has up to 89"
        return round(MASS_PER_POWER * sheet.power_kw), f"assumed: {rule}"
    size = (sheet.wheelbase_m * sheet.width_m) / (like.wheelbase_m * like.width_m)
    rule = f"as the {like.name}, times the square of wheelbase x width"
    kg = min(max(like.mass_kg * size**2, QUANTITIES["mass_kg"].low), QUANTITIES["mass_kg"].high)
    return float(f"{kg:.2g}"), f"assumed: {rule}"


def axles(sheet: Datasheet) -> tuple[Sourced, Sourced]:
    """Front and rear axle from the centre of mass, m."""
    rear = rear_axle_m(sheet)
    front = round(sheet.wheelbase_m - rear, 6)
    if sheet.front_share is not None:
        words = f"given: {sheet.front_share:g} of the weight in front"
        return (front, words), (rear, words)
    words = f"assumed: {FRONT_SHARE:g} of the weight in front, as operator's manuals ask for (0.35 to 0.45)"
    return (front, f"{words}; with rear_axle_m the wheelbase given"), (rear, words)


def track(sheet: Datasheet) -> Sourced:
    """Distance between the wheels, m."""
    if sheet.track_m is not None:
        return sheet.track_m, GIVEN
    return track_m(sheet), f"assumed: {TRACK_SHARE:g} of the width, tyres a fifth of it wide"


def length(sheet: Datasheet, like: Tractor) -> Sourced:
    """Length over all, m."""
    if sheet.length_m is not None:
        return sheet.length_m, GIVEN
    share = like.length_m / like.wheelbase_m
    behind = sheet.rear_overhang_m or 0.0
    value = max(share * sheet.wheelbase_m, sheet.wheelbase_m + behind)
    return round(value, 3), f"assumed: {share:.3g} times the wheelbase, as the {like.name}"


def rear_overhang(sheet: Datasheet, like: Tractor) -> Sourced:
    """What reaches behind the rear axle, m."""
    if sheet.rear_overhang_m is not None:
        return sheet.rear_overhang_m, GIVEN
    share = like.rear_overhang_m / like.wheelbase_m
    value = min(share * sheet.wheelbase_m, length(sheet, like)[0] - sheet.wheelbase_m)
    return round(value, 3), f"assumed: {share:.3g} times the wheelbase, a rear wheel's radius as of the {like.name}"


def antenna(sheet: Datasheet) -> Sourced:
    """Antenna ahead of the rear axle, m."""
    if sheet.antenna_forward_m is not None:
        return sheet.antenna_forward_m, GIVEN
    return antenna_forward_m(sheet), "assumed: on the cab, above the centre of mass; measured from the rear axle"


def centre_radius(sheet: Datasheet) -> Sourced:
    """Radius (m) of the antenna's circle at full lock on asphalt."""
    if sheet.radius_of != OUTER_WHEEL:
        return sheet.turning_radius_m, f"turning radius of {sheet.turning_radius_m:g} m"
    across = math.sqrt(sheet.turning_radius_m**2 - sheet.wheelbase_m**2) - 0.5 * track_m(sheet)
    radius = math.hypot(across, antenna_forward_m(sheet))
    words = f"turning radius of {sheet.turning_radius_m:g} m of the outer front wheel (ISO 789-3), {radius:.2f} m"
    return radius, f"{words} at the antenna"


def lock(sheet: Datasheet) -> Sourced:
    """Wheel angle at full lock, degrees: given, or that of Ackermann for the radius."""
    if sheet.max_steering_deg is not None:
        return sheet.max_steering_deg, GIVEN
    radius, ahead = centre_radius(sheet)[0], antenna_forward_m(sheet)
    across = math.sqrt(radius**2 - ahead**2)
    angle = math.degrees(math.atan(sheet.wheelbase_m / across))
    return round(angle, 2), "assumed: Ackermann, atan(wheelbase / radius of the rear axle's middle)"


def laws(sheet: Datasheet, like: Tractor) -> tuple[dict[str, PowerLaw], dict[str, str]]:
    """Radii per ground: on asphalt full lock drives the datasheet's, on other grounds as much wider as `like` does."""
    radius, words = centre_radius(sheet)
    angle = lock(sheet)[0]
    made, sources = {}, {}
    for ground, law in sorted(like.radius.items()):
        sides = {}
        for side, sign in (("right", 1.0), ("left", -1.0)):
            full = sign * like.max_steering_deg
            share = law.radius_m(full) / like.power_law("asphalt").radius_m(full)
            power = getattr(law, side)[1]
            sides[side] = (float(f"{POWER_LAW_M / (radius * share * angle**power):.8g}"), power)
        made[ground] = PowerLaw(**sides)
        exponent = f"the exponent of the {like.name} (thesis, Eq. 2.9 and 2.10)"
        wider = 100.0 * (_wider(like, ground) - 1.0)
        sources[ground] = (
            f"given: {words} at full lock; assumed: {exponent}"
            if ground == "asphalt"
            else f"assumed: {wider:.0f} % wider than on asphalt at full lock, and {exponent}"
        )
    return made, sources


def _wider(like: Tractor, ground: str) -> float:
    """Radius at full lock on a ground over that on asphalt, mean of both sides."""
    asphalt = like.power_law("asphalt")
    full = like.max_steering_deg
    return sum(like.power_law(ground).radius_m(a) / asphalt.radius_m(a) for a in (full, -full)) / 2.0


def steering_rate(sheet: Datasheet, like: Tractor) -> Sourced:
    """How fast the wheels turn over, degrees per s."""
    if sheet.steering_rate_deg_per_s is not None:
        return sheet.steering_rate_deg_per_s, GIVEN
    turned = lock(sheet)[0] / like.max_steering_deg
    tighter = like.smallest_radius_m("asphalt") / centre_radius(sheet)[0]
    rate = like.steering.rate_deg_per_s
    if turned * tighter <= 1.0:
        return rate, f"assumed: as the {like.name}"
    rule = f"as the {like.name}, quicker for a tighter turn: at one speed, full lock within as many radii of way"
    return round(rate * turned * tighter, 1), f"assumed: {rule}"


def drive(mass_kg: float) -> Sourced:
    """Largest drive force, N."""
    return round(DRIVE_SHARE * mass_kg * GRAVITY, 1), f"assumed: {DRIVE_SHARE:g} of the weight"
