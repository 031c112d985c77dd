"""The whole tractor of a datasheet: every value there is, each with a line under [source]."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from vehicle.datasheet import rules
from vehicle.datasheet.sheet import Datasheet
from vehicle.tractor import Guidance, SpeedControl, Steering, Tractor, load_tractor

LIKE = "eg105"
GAINS = ("proportional_n_s_per_m", "integral_n_per_m", "derivative_n_s2_per_m")
LOOKAHEADS = ("lookahead_m", "turn_lookahead_m")
FAR_TURNING, FAR_OFF = 3.0, 0.25


def tractor_from(name: str, sheet: Datasheet) -> Tractor:
    """The tractor of a datasheet. What it leaves open follows from rules or is as of the thesis's tractor."""
    like = load_tractor(LIKE)
    front, rear = rules.axles(sheet)
    body = {
        "mass_kg": rules.mass(sheet, like),
        "front_axle_m": front,
        "rear_axle_m": rear,
        "track_m": rules.track(sheet),
        "length_m": rules.length(sheet, like),
        "width_m": (sheet.width_m, rules.GIVEN),
        "rear_overhang_m": rules.rear_overhang(sheet, like),
        "max_steering_deg": rules.lock(sheet),
        "antenna_forward_m": rules.antenna(sheet),
        "antenna_right_m": (0.0, "assumed: on the centre line"),
    }
    values: dict[str, Any] = {key: value for key, (value, _) in body.items()}
    source = {key: words for key, (_, words) in body.items()}
    steering, told = _steering(sheet, like)
    source |= told
    guidance, told = _guidance(sheet, like)
    source |= told
    speed, told = _speed(values["mass_kg"], like)
    source |= told
    radius, told = rules.laws(sheet, like)
    source |= {f"radius.{ground}": words for ground, words in told.items()}
    return Tractor(
        name=name, **values, steering=steering, guidance=guidance, speed=speed, radius=radius, source=source
    )  # fmt: skip


def _as(like: Tractor, section: str, values: BaseModel) -> dict[str, str]:
    """Sources of a section that is as of another tractor."""
    return {f"{section}.{key}": f"assumed: as the {like.name}" for key in type(values).model_fields}


def _steering(sheet: Datasheet, like: Tractor) -> tuple[Steering, dict[str, str]]:
    told = _as(like, "steering", like.steering)
    rate, told["steering.rate_deg_per_s"] = rules.steering_rate(sheet, like)
    return like.steering.model_copy(update={"rate_deg_per_s": rate}), told


def _guidance(sheet: Datasheet, like: Tractor) -> tuple[Guidance, dict[str, str]]:
    """As of the other tractor, lookaheads as long against the wheelbase."""
    told = _as(like, "guidance", like.guidance)
    changes = {}
    for key in LOOKAHEADS:
        changes[key] = round(getattr(like.guidance, key) * sheet.wheelbase_m / like.wheelbase_m, 3)
        told[f"guidance.{key}"] = f"assumed: as the {like.name}, in proportion to the wheelbase"
    return like.guidance.model_copy(update=changes), told


def _speed(mass_kg: float, like: Tractor) -> tuple[SpeedControl, dict[str, str]]:
    """As of the other tractor, forces in proportion to the mass."""
    told = _as(like, "speed", like.speed)
    changes = {}
    for key in GAINS:
        changes[key] = round(getattr(like.speed, key) * mass_kg / like.mass_kg, 3)
        told[f"speed.{key}"] = f"assumed: as the {like.name}, in proportion to the mass"
    changes["max_drive_n"], told["speed.max_drive_n"] = rules.drive(mass_kg)
    return like.speed.model_copy(update=changes), told


def remarks(sheet: Datasheet) -> tuple[str, ...]:
    """What is possible but looks odd, in sentences."""
    said = []
    radius, base = rules.centre_radius(sheet)[0], sheet.wheelbase_m
    if radius > FAR_TURNING * base:
        said.append(
            f"A turning radius of {radius:g} m is {radius / base:.1f} wheelbases, usual are 1.5 to 2.5; halve it if "
            "the datasheet gives the diameter of the turning circle."
        )
    if sheet.max_steering_deg is not None:
        free = rules.lock(sheet.model_copy(update={"max_steering_deg": None}))[0]
        if abs(sheet.max_steering_deg / free - 1.0) > FAR_OFF:
            said.append(
                f"Wheels turned by {sheet.max_steering_deg:g} degrees do not go with a radius of {radius:.2f} m on a "
                f"wheelbase of {base:g} m, which asks for {free:.1f}; the radius counts, check all three."
            )
    return tuple(said)
