"""Whether logs can be of a tractor at all: a quick look at how tightly it turns and how far its wheels turn.

No effect of the catalogue makes a tractor turn twice as tightly as its file says, and no wheel turns far beyond its
lock. Where logs do, the file is of another vehicle, and every cause that could be fitted would stand in for its size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.errors import named
from vehicle.datasheet import QUANTITIES
from vehicle.effects import effect
from vehicle.measured.errors import LogError
from vehicle.measured.logs.bends import bends, largest_steering
from vehicle.measured.logs.motion import motion
from vehicle.measured.logs.record import Array, Log
from vehicle.tractor import PowerLaw, Tractor

_FEWEST, _SPREAD_DEG = 12, 1.5  # chords, and how far the steering must move to tell a line
_SURE = 4.0  # standard errors
_CLEAR_DEG = 8.0  # chosen, of the steering: an offset, draft or slope of 3 degrees is less than half of it
_ROUGH = 0.1  # chosen, the standard error of a ratio told from such chords alone, as a share: surely within 40 %
_FOLLOWS = 0.5  # of the correlation: a command that the path hardly follows says nothing of size
_LOCK_SHARE, _LOCK_DEG = 1.3, 3.0  # beyond the file's lock: more than sensors are wrong by
_COMMAND_SHARE = 2.0  # the same of a command, which controllers send beyond the lock
_LARGEST_LOCK_DEG, _SMALLEST_SHEET_M = 59.0, QUANTITIES["wheelbase_m"].low
_MASSES_KG = (0.01, 200_000.0)  # that a tractor file may have
_COMMAND_LAGS = 0.5  # a command that the wheels hardly reach makes the path look less bent, by so much at most


@dataclass(frozen=True)
class Size:
    """What logs say: bend over the file's at the same angle and its standard error, angles and speeds that were driven.

    `bends` is None where the logs do not tell it.
    """

    bends: float | None
    error: float
    angle_deg: float
    speed_mps: tuple[float, float]


def size_of(logs: Sequence[Log], tractor: Tractor, ground: str) -> Size:
    """The size that logs say a vehicle has, held against a tractor file on a ground."""
    angles, curvatures, paces = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    for log in logs:
        bent, chords = bends(log), motion(log)
        if bent is not None and chords is not None:
            angles.append(bent[0])
            curvatures.append(bent[1])
            paces.append(chords.speed)
    angle, pace = np.concatenate(angles), np.concatenate(paces)
    ratio, error = _ratio(angle, np.concatenate(curvatures), tractor, ground)
    speeds = (float(np.quantile(pace, 0.05)), float(np.quantile(pace, 0.95))) if len(pace) else (0.0, 0.0)
    return Size(ratio, error, max(map(largest_steering, logs)), speeds)


def _ratio(angle: Array, curvature: Array, tractor: Tractor, ground: str) -> tuple[float | None, float]:
    """Bend over the file's by a straight line through chords, and its standard error; None where they do not tell.

    Where the steering stands at one angle, or the line does not tell, a line through none of both does, roughly.
    """
    said = _said(angle, tractor, ground)
    if len(angle) >= _FEWEST and float(np.std(angle)) >= _SPREAD_DEG:
        x, y = said - said.mean(), curvature - curvature.mean()
        slope, together = _line(x, y)
        if together > _FOLLOWS:
            return slope, math.sqrt(2.0 * float(np.var(y - slope * x)) / float(x @ x))
    clear = np.abs(angle) >= _CLEAR_DEG
    if np.count_nonzero(clear) < _FEWEST:
        return None, math.inf
    slope, together = _line(said[clear], curvature[clear])
    return (slope, _ROUGH * slope) if together > _FOLLOWS else (None, math.inf)


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope of a line through 0, and how far points (k,) lie on one."""
    square = float(x @ x)
    return float(x @ y) / max(square, 1e-30), float(x @ y) / math.sqrt(square * float(y @ y) + 1e-30)


def _said(angle_deg: Array, tractor: Tractor, ground: str) -> Array:
    """Curvature (1/m, positive right) that the file gives wheel angles; beyond the lock as it goes on."""
    if ground not in tractor.radius:
        return np.tan(np.radians(angle_deg)) / tractor.wheelbase_m
    law = tractor.power_law(ground)
    return np.array([0.0 if abs(one) < 1e-9 else math.copysign(1.0 / law.radius_m(one), one) for one in angle_deg])


def misfit(logs: Sequence[Log], tractor: Tractor, ground: str) -> str:
    """Why the logs cannot be of this tractor, as a clause; empty where they can."""
    size = size_of(logs, tractor, ground)
    own = next(one for one in effect("steering_gain").params)
    known = tractor.effects["steering_gain"].value["ratio"] if "steering_gain" in tractor.effects else 1.0
    sensed = all(log.steering_deg is not None for log in logs)
    least = own.low * known * (1.0 if sensed else _COMMAND_LAGS)
    if size.bends is not None and not (
        least <= size.bends + _SURE * size.error and size.bends - _SURE * size.error <= own.high * known
    ):
        return (
            f"at the same wheel angles their path bends {size.bends:.2g} times as much as the file of {tractor.name} "
            f"says, and no fault of a tractor does more than {own.low:g} to {own.high:g}"
        )
    share = _LOCK_SHARE if sensed else _COMMAND_SHARE
    if size.angle_deg > share * tractor.max_steering_deg + _LOCK_DEG:
        return (
            f"their wheels turn to {size.angle_deg:.0f} degrees, and the lock of {tractor.name} is at "
            f"{tractor.max_steering_deg:g}"
        )
    return ""


def refuse_other(logs: Sequence[Log], tractor: Tractor, ground: str) -> None:
    """Raise LogError where the logs cannot be of this tractor, with the values that they suggest."""
    why = misfit(logs, tractor, ground)
    if not why:
        return
    other = as_driven(logs, tractor, ground)
    radius = 1.0 / float(_said(np.array([other.max_steering_deg]), other, ground)[0])
    make = "make a file of these with `headland tractor new`" if other.wheelbase_m >= _SMALLEST_SHEET_M else (
        "write a file of these"
    )  # fmt: skip
    raise LogError(
        f"These logs are not of this tractor: {why}. Driven at {_range(size_of(logs, tractor, ground).speed_mps)} m/s, "
        f"they suggest a wheelbase of {other.wheelbase_m:.2g} m and {radius:.2g} m of turning radius at "
        f"{other.max_steering_deg:.0f} degrees, the largest angle driven; {make}, name the right one, or give "
        f"{named('as_driven')} to go on with these.",
        parameter="tractor",
    )


def _range(values: tuple[float, float]) -> str:
    low, high = (f"{one:.2g}" for one in values)
    return low if low == high else f"{low} to {high}"


def as_driven(logs: Sequence[Log], tractor: Tractor, ground: str) -> Tractor:
    """The tractor in the size that the logs suggest; as it is where they fit it.

    All lengths go with the wheelbase, the mass with their cube and forces with the mass: what logs of a path do not
    say is as of a scale model. Radii are those driven at the same angles.
    """
    if not misfit(logs, tractor, ground):
        return tractor
    size = size_of(logs, tractor, ground)
    scale = 1.0 / size.bends if size.bends else 1.0
    scale = min(max(scale, 0.01 / tractor.rear_axle_m), 30.0 / tractor.length_m)
    lengths = ("front_axle_m", "rear_axle_m", "track_m", "length_m", "width_m", "rear_overhang_m", "antenna_forward_m",
               "antenna_right_m")  # fmt: skip
    changed: dict[str, object] = {name: getattr(tractor, name) * scale for name in lengths}
    mass = min(max(tractor.mass_kg * scale**3, _MASSES_KG[0]), _MASSES_KG[1])
    changed["mass_kg"] = mass
    changed["max_steering_deg"] = min(math.ceil(size.angle_deg), _LARGEST_LOCK_DEG)
    changed["radius"] = {name: _scaled(law, scale) for name, law in tractor.radius.items()}
    forces = ("proportional_n_s_per_m", "integral_n_per_m", "derivative_n_s2_per_m", "max_drive_n")
    changed["speed"] = tractor.speed.model_copy(
        update={name: getattr(tractor.speed, name) * mass / tractor.mass_kg for name in forces}
    )
    ahead = ("lookahead_m", "turn_lookahead_m", "lateral_limit_m")
    changed["guidance"] = tractor.guidance.model_copy(
        update={name: getattr(tractor.guidance, name) * scale for name in ahead}
    )
    made = tractor.model_dump() | {"name": f"{tractor.name} as driven", "effects": {}, "rest": None}
    return Tractor.model_validate(made | {key: _plain(value) for key, value in changed.items()})


def _scaled(law: PowerLaw, scale: float) -> PowerLaw:
    sides = {side: (factor / scale, power) for side, (factor, power) in (("right", law.right), ("left", law.left))}
    return PowerLaw(**sides)


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return value.model_dump() if hasattr(value, "model_dump") else value
