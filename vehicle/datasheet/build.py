"""Builds the whole tractor of a datasheet, with a line under [source] for every value, and remarks on odd values."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from vehicle.datasheet import rules
from vehicle.datasheet.sheet import Datasheet
from vehicle.model.tractor import (
    EngineParameters,
    GuidanceParameters,
    SpeedParameters,
    SteeringParameters,
    Tractor,
    load_tractor,
)

REFERENCE_TRACTOR = "eg105"
GAIN_KEYS = ("proportional_n_s_per_m", "integral_n_per_m", "derivative_n_s2_per_m")
LOOKAHEAD_KEYS = ("lookahead_m", "turn_lookahead_m")
MAX_RADIUS_PER_WHEELBASE, MAX_ANGLE_MISMATCH = 3.0, 0.25


def build_tractor(name: str, sheet: Datasheet) -> Tractor:
    """The tractor of a datasheet. Values not given follow from rules or are those of the thesis's tractor."""
    reference = load_tractor(REFERENCE_TRACTOR)
    front, rear = rules.derive_axle_positions(sheet)
    body = {
        "mass_kg": rules.derive_mass(sheet, reference),
        "front_axle_m": front,
        "rear_axle_m": rear,
        "track_m": rules.derive_wheel_spacing(sheet),
        "length_m": rules.derive_length(sheet, reference),
        "width_m": (sheet.width_m, rules.GIVEN),
        "rear_overhang_m": rules.derive_rear_overhang(sheet, reference),
        "max_steering_deg": rules.derive_lock_angle(sheet),
        "antenna_forward_m": rules.derive_antenna_forward(sheet),
        "antenna_right_m": (0.0, "assumed: on the centre line"),
        "drive": ("diesel", "assumed: most tractors burn diesel"),
    }
    values: dict[str, Any] = {key: value for key, (value, _) in body.items()}
    source = {key: words for key, (_, words) in body.items()}
    steering, sources = _derive_steering(sheet, reference)
    source |= sources
    guidance, sources = _derive_guidance(sheet, reference)
    source |= sources
    speed, sources = _derive_speed_control(values["mass_kg"], reference)
    source |= sources
    radius, sources = rules.derive_radius_laws(sheet, reference)
    source |= {f"radius.{ground}": words for ground, words in sources.items()}
    if sheet.power_kw is not None:
        values["engine"], source["engine.power_kw"] = EngineParameters(power_kw=sheet.power_kw), rules.GIVEN
    return Tractor(name=name, **values, steering=steering, guidance=guidance, speed=speed, radius=radius, source=source)


def _build_assumed_sources(reference: Tractor, section: str, values: BaseModel) -> dict[str, str]:
    """Sources of a section that is copied from another tractor."""
    return {f"{section}.{key}": f"assumed: as the {reference.name}" for key in type(values).model_fields}


def _derive_steering(sheet: Datasheet, reference: Tractor) -> tuple[SteeringParameters, dict[str, str]]:
    sources = _build_assumed_sources(reference, "steering", reference.steering)
    rate, sources["steering.rate_deg_per_s"] = rules.derive_steering_rate(sheet, reference)
    return reference.steering.model_copy(update={"rate_deg_per_s": rate}), sources


def _derive_guidance(sheet: Datasheet, reference: Tractor) -> tuple[GuidanceParameters, dict[str, str]]:
    """As the other tractor, with lookaheads in proportion to the wheelbase."""
    sources = _build_assumed_sources(reference, "guidance", reference.guidance)
    changes = {}
    for key in LOOKAHEAD_KEYS:
        changes[key] = round(getattr(reference.guidance, key) * sheet.wheelbase_m / reference.wheelbase_m, 3)
        sources[f"guidance.{key}"] = f"assumed: as the {reference.name}, in proportion to the wheelbase"
    return reference.guidance.model_copy(update=changes), sources


def _derive_speed_control(mass_kg: float, reference: Tractor) -> tuple[SpeedParameters, dict[str, str]]:
    """As the other tractor, with forces in proportion to the mass."""
    sources = _build_assumed_sources(reference, "speed", reference.speed)
    changes = {}
    for key in GAIN_KEYS:
        changes[key] = round(getattr(reference.speed, key) * mass_kg / reference.mass_kg, 3)
        sources[f"speed.{key}"] = f"assumed: as the {reference.name}, in proportion to the mass"
    changes["max_drive_n"], sources["speed.max_drive_n"] = rules.derive_max_drive(mass_kg)
    return reference.speed.model_copy(update=changes), sources


def describe_unusual_values(sheet: Datasheet) -> tuple[str, ...]:
    """Sentences on values that are possible but look odd."""
    oddities = []
    radius, base = rules.derive_antenna_radius(sheet)[0], sheet.wheelbase_m
    if radius > MAX_RADIUS_PER_WHEELBASE * base:
        oddities.append(
            f"A turning radius of {radius:g} m is {radius / base:.1f} wheelbases, usually 1.5 to 2.5; halve it if "
            "the datasheet gives the diameter of the turning circle."
        )
    if sheet.max_steering_deg is not None:
        ackermann_deg = rules.derive_lock_angle(sheet.model_copy(update={"max_steering_deg": None}))[0]
        if abs(sheet.max_steering_deg / ackermann_deg - 1.0) > MAX_ANGLE_MISMATCH:
            oddities.append(
                f"A wheel angle of {sheet.max_steering_deg:g} degrees does not fit a radius of {radius:.2f} m and a "
                f"wheelbase of {base:g} m, which need {ackermann_deg:.1f} degrees; the radius is used, check all three."
            )
    return tuple(oddities)
