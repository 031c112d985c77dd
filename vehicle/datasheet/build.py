"""Builds the whole tractor of a datasheet, with a line under [source] for every value, and remarks on odd values.

A rule returns its value and the text for [source]: "given", or "assumed: " and the rule.
"""

from __future__ import annotations

import math
from typing import Any

from pydantic import BaseModel

from vehicle.datasheet.sheet import (
    FRONT_SHARE,
    OUTER_WHEEL,
    QUANTITIES,
    TRACK_SHARE,
    Datasheet,
    compute_antenna_forward_m,
    compute_rear_axle_m,
    compute_wheel_spacing_m,
)
from vehicle.model.tractor import POWER_LAW_M, EngineParameters, PowerLaw, Tractor, load_tractor
from vehicle.records import GRAVITY_MPS2

REFERENCE_TRACTOR = "eg105"
GAIN_KEYS = ("proportional_n_s_per_m", "integral_n_per_m", "derivative_n_s2_per_m")
LOOKAHEAD_KEYS = ("lookahead_m", "turn_lookahead_m")
MAX_RADIUS_PER_WHEELBASE, MAX_ANGLE_MISMATCH = 3.0, 0.25

GIVEN = "given"
MASS_PER_POWER_KG_PER_KW = 50.0
DRIVE_FORCE_SHARE = 0.4
SourcedValue = tuple[float, str]


def build_tractor(name: str, sheet: Datasheet) -> Tractor:
    """The tractor of a datasheet. Values not given follow from rules or are those of the thesis's tractor."""
    reference = load_tractor(REFERENCE_TRACTOR)
    front, rear = derive_axle_positions(sheet)
    body = {
        "mass_kg": derive_mass(sheet, reference),
        "front_axle_m": front,
        "rear_axle_m": rear,
        "track_m": _assume_unless_given(
            sheet.track_m,
            compute_wheel_spacing_m(sheet),
            f"{TRACK_SHARE:g} of the width, with tyres a fifth of the width",
        ),
        "length_m": derive_length(sheet, reference),
        "width_m": (sheet.width_m, GIVEN),
        "rear_overhang_m": derive_rear_overhang(sheet, reference),
        "max_steering_deg": derive_lock_angle(sheet),
        "antenna_forward_m": _assume_unless_given(
            sheet.antenna_forward_m,
            compute_antenna_forward_m(sheet),
            "on the cab, above the centre of mass; measured from the rear axle",
        ),
        "antenna_right_m": (0.0, "assumed: on the centre line"),
        "drive": ("diesel", "assumed: most tractors burn diesel"),
    }
    values: dict[str, Any] = {key: value for key, (value, _) in body.items()}
    source = {key: words for key, (_, words) in body.items()}
    same_words = f"assumed: as the {reference.name}"
    by_wheelbase = sheet.wheelbase_m / reference.wheelbase_m, f"{same_words}, in proportion to the wheelbase"
    by_mass = values["mass_kg"] / reference.mass_kg, f"{same_words}, in proportion to the mass"
    drive_words = f"assumed: {DRIVE_FORCE_SHARE:g} of the weight"
    max_drive_n = round(DRIVE_FORCE_SHARE * values["mass_kg"] * GRAVITY_MPS2, 1)
    sections: dict[str, dict[str, SourcedValue]] = {
        "steering": {"rate_deg_per_s": derive_steering_rate(sheet, reference)},
        "guidance": _scale_values(reference.guidance, LOOKAHEAD_KEYS, *by_wheelbase),
        "speed": _scale_values(reference.speed, GAIN_KEYS, *by_mass) | {"max_drive_n": (max_drive_n, drive_words)},
    }
    for section, changes in sections.items():
        same = getattr(reference, section)
        source |= {f"{section}.{key}": same_words for key in type(same).model_fields}
        source |= {f"{section}.{key}": words for key, (_, words) in changes.items()}
        values[section] = same.model_copy(update={key: value for key, (value, _) in changes.items()})
    radius, sources = derive_radius_laws(sheet, reference)
    source |= {f"radius.{ground}": words for ground, words in sources.items()}
    if sheet.power_kw is not None:
        values["engine"], source["engine.power_kw"] = EngineParameters(power_kw=sheet.power_kw), GIVEN
    return Tractor(name=name, **values, radius=radius, source=source)


def _assume_unless_given(given: float | None, value: float, rule: str) -> SourcedValue:
    """What a datasheet gives, else the value of a rule, with the words of its source."""
    return (value, f"assumed: {rule}") if given is None else (given, GIVEN)


def _scale_values(section: BaseModel, keys: tuple[str, ...], factor: float, words: str) -> dict[str, SourcedValue]:
    """Values of a section of another tractor times a factor, with the words of their source."""
    return {key: (round(getattr(section, key) * factor, 3), words) for key in keys}


def describe_unusual_values(sheet: Datasheet) -> tuple[str, ...]:
    """Sentences on values that are possible but look odd."""
    oddities = []
    radius, base = derive_antenna_radius(sheet)[0], sheet.wheelbase_m
    if radius > MAX_RADIUS_PER_WHEELBASE * base:
        oddities.append(
            f"A turning radius of {radius:g} m is {radius / base:.1f} wheelbases, usually 1.5 to 2.5; halve it if "
            "the datasheet gives the diameter of the turning circle."
        )
    if sheet.max_steering_deg is not None:
        ackermann_deg = derive_lock_angle(sheet.model_copy(update={"max_steering_deg": None}))[0]
        if abs(sheet.max_steering_deg / ackermann_deg - 1.0) > MAX_ANGLE_MISMATCH:
            oddities.append(
                f"A wheel angle of {sheet.max_steering_deg:g} degrees does not fit a radius of {radius:.2f} m and a "
                f"wheelbase of {base:g} m, which need {ackermann_deg:.1f} degrees; the radius is used, check all three."
            )
    return tuple(oddities)


def derive_mass(sheet: Datasheet, reference: Tractor) -> SourcedValue:
    """Mass in kg: given, from power, or from the footprint."""
    if sheet.mass_kg is not None:
        return sheet.mass_kg, GIVEN
    if sheet.power_kw is not None:
        rule = f"{MASS_PER_POWER_KG_PER_KW:g} kg per kW, as the {reference.name} (77 kW)"
        words = f"assumed: {rule}; a ballasted tractor has up to 89"
        return round(MASS_PER_POWER_KG_PER_KW * sheet.power_kw), words
    size = (sheet.wheelbase_m * sheet.width_m) / (reference.wheelbase_m * reference.width_m)
    rule = f"as the {reference.name}, times the square of wheelbase x width"
    kg = min(max(reference.mass_kg * size**2, QUANTITIES["mass_kg"].low), QUANTITIES["mass_kg"].high)
    return float(f"{kg:.2g}"), f"assumed: {rule}"


def derive_axle_positions(sheet: Datasheet) -> tuple[SourcedValue, SourcedValue]:
    """Front and rear axle from the centre of mass, m."""
    rear = compute_rear_axle_m(sheet)
    front = round(sheet.wheelbase_m - rear, 6)
    if sheet.front_share is not None:
        words = f"given: {sheet.front_share:g} of the weight in front"
        return (front, words), (rear, words)
    words = f"assumed: {FRONT_SHARE:g} of the weight in front, as operator's manuals ask for (0.35 to 0.45)"
    return (front, f"{words}; with rear_axle_m the wheelbase given"), (rear, words)


def derive_length(sheet: Datasheet, reference: Tractor) -> SourcedValue:
    """Length over all, m."""
    share = reference.length_m / reference.wheelbase_m
    value = max(share * sheet.wheelbase_m, sheet.wheelbase_m + (sheet.rear_overhang_m or 0.0))
    rule = f"{share:.3g} times the wheelbase, as the {reference.name}"
    return _assume_unless_given(sheet.length_m, round(value, 3), rule)


def derive_rear_overhang(sheet: Datasheet, reference: Tractor) -> SourcedValue:
    """Overhang behind the rear axle, m."""
    share = reference.rear_overhang_m / reference.wheelbase_m
    value = min(share * sheet.wheelbase_m, derive_length(sheet, reference)[0] - sheet.wheelbase_m)
    rule = f"{share:.3g} times the wheelbase, the radius of a rear wheel as for the {reference.name}"
    return _assume_unless_given(sheet.rear_overhang_m, round(value, 3), rule)


def derive_antenna_radius(sheet: Datasheet) -> SourcedValue:
    """Radius (m) of the antenna's circle at full lock on asphalt."""
    if sheet.radius_of != OUTER_WHEEL:
        return sheet.turning_radius_m, f"turning radius of {sheet.turning_radius_m:g} m"
    across = math.sqrt(sheet.turning_radius_m**2 - sheet.wheelbase_m**2) - 0.5 * compute_wheel_spacing_m(sheet)
    radius = math.hypot(across, compute_antenna_forward_m(sheet))
    words = f"turning radius of {sheet.turning_radius_m:g} m of the outer front wheel (ISO 789-3), {radius:.2f} m"
    return radius, f"{words} at the antenna"


def derive_lock_angle(sheet: Datasheet) -> SourcedValue:
    """Wheel angle at full lock, degrees: given, or the Ackermann angle for the radius."""
    radius, ahead = derive_antenna_radius(sheet)[0], compute_antenna_forward_m(sheet)
    across = math.sqrt(radius**2 - ahead**2)
    angle = math.degrees(math.atan(sheet.wheelbase_m / across))
    rule = "Ackermann, atan(wheelbase / radius of the rear axle's middle)"
    return _assume_unless_given(sheet.max_steering_deg, round(angle, 2), rule)


def derive_radius_laws(sheet: Datasheet, reference: Tractor) -> tuple[dict[str, PowerLaw], dict[str, str]]:
    """Radii per ground: at full lock on asphalt the datasheet's, on other grounds wider as for `reference`."""
    radius, words = derive_antenna_radius(sheet)
    angle, asphalt = derive_lock_angle(sheet)[0], reference.get_power_law("asphalt")
    laws, sources = {}, {}
    for ground, law in sorted(reference.radius.items()):
        sides, shares = {}, []
        for side, sign in (("right", 1.0), ("left", -1.0)):
            full_lock_deg = sign * reference.max_steering_deg
            share = law.compute_radius_m(full_lock_deg) / asphalt.compute_radius_m(full_lock_deg)
            shares.append(share)
            power = getattr(law, side)[1]
            sides[side] = (float(f"{POWER_LAW_M / (radius * share * angle**power):.8g}"), power)
        laws[ground] = PowerLaw(**sides)
        exponent = f"the exponent of the {reference.name} (thesis, Eq. 2.9 and 2.10)"
        wider = 100.0 * (sum(shares) / 2.0 - 1.0)
        sources[ground] = (
            f"given: {words} at full lock; assumed: {exponent}"
            if ground == "asphalt"
            else f"assumed: {wider:.0f} % wider than on asphalt at full lock, and {exponent}"
        )
    return laws, sources


def derive_steering_rate(sheet: Datasheet, reference: Tractor) -> SourcedValue:
    """Steering rate of the wheels, degrees per s."""
    lock_ratio = derive_lock_angle(sheet)[0] / reference.max_steering_deg
    radius_ratio = reference.compute_smallest_radius_m("asphalt") / derive_antenna_radius(sheet)[0]
    rate, rule = reference.steering.rate_deg_per_s, f"as the {reference.name}"
    if lock_ratio * radius_ratio > 1.0:
        rate = round(rate * lock_ratio * radius_ratio, 1)
        rule += ", faster for a tighter turn: full lock after the same distance in turning radii"
    return _assume_unless_given(sheet.steering_rate_deg_per_s, rate, rule)
