"""Whether logs can be of the given tractor: how tightly it turns and how far its wheels turn.

No effect makes a tractor turn twice as tightly as its file says, and no wheel turns far beyond its lock. Logs that do
are of another vehicle, and any fitted cause would only compensate for its size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
from fields.errors import mark_parameter
from vehicle.datasheet.sheet import QUANTITIES
from vehicle.identification.errors import LogError
from vehicle.identification.logs.motion import (
    CLEAR_STEERING_DEG,
    compute_bends,
    compute_path_chords,
    find_largest_steering,
)
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.thresholds import (
    ALIKE_SHARE,
    FEWEST_LINE_CHORDS,
    MAJORITY,
    NEARLY_SHARE,
    STEERING_SPREAD_DEG,
    SURE_SIGMAS,
)
from vehicle.model.effects import get_effect
from vehicle.model.tractor import Tractor

_CLEAR_ANGLE_DEG = 8.0  # chosen, of the steering: an offset, draft or slope of 3 degrees is less than half of it
_ROUGH_ERROR_SHARE = 1.0 - NEARLY_SHARE  # relative standard error of a ratio from such chords: surely within 40 %
_LOCK_SHARE = 1.0 + ALIKE_SHARE  # of the file's lock, and clear steering beyond that: more than errors of sensors
_COMMAND_SHARE = 2.0  # the same for commands, which controllers send beyond the lock
_LARGEST_LOCK_DEG, _SMALLEST_WHEELBASE_M = QUANTITIES["max_steering_deg"].high, QUANTITIES["wheelbase_m"].low
_MASSES_KG = (0.01, 200_000.0)  # limits of a tractor file
_COMMAND_LAG_SHARE = 1.0 / _COMMAND_SHARE  # least apparent gain where the wheels hardly reach the command


@dataclass(frozen=True)
class MeasuredSize:
    """Size shown by logs: curvature over the file's (None: not shown) and its error, largest angle, range of speeds."""

    bend_ratio: float | None
    bend_ratio_error: float
    angle_deg: float
    speed_mps: tuple[float, float]


def measure_size(logs: Sequence[Log], tractor: Tractor, ground: str) -> MeasuredSize:
    """Measure the size relative to a tractor file on a ground: measured over expected curvature, the slope of a line,
    or roughly of one through zero where the steering hardly varies."""
    parts = [np.empty((3, 0))]
    for log in logs:
        bends, chords = compute_bends(log), compute_path_chords(log)
        if bends is not None and chords is not None:
            parts.append(np.stack([*bends[:2], chords.speed]))
    angle, curvature, pace = np.concatenate(parts, axis=1)
    expected, is_clear = compute_file_curvature(angle, tractor, ground), np.abs(angle) >= _CLEAR_ANGLE_DEG
    ratio, error = None, math.inf
    if len(angle) >= FEWEST_LINE_CHORDS and float(np.std(angle)) >= STEERING_SPREAD_DEG:
        x, y = expected - expected.mean(), curvature - curvature.mean()
        slope, correlation = _fit_line_through_zero(x, y)
        if correlation > MAJORITY:  # a command that the path hardly follows says nothing about size
            ratio, error = slope, math.sqrt(2.0 * float(np.var(y - slope * x)) / float(x @ x))
    if ratio is None and np.count_nonzero(is_clear) >= FEWEST_LINE_CHORDS:
        slope, correlation = _fit_line_through_zero(expected[is_clear], curvature[is_clear])
        if correlation > MAJORITY:
            ratio, error = slope, _ROUGH_ERROR_SHARE * slope
    speeds = (float(np.quantile(pace, 0.05)), float(np.quantile(pace, 0.95))) if len(pace) else (0.0, 0.0)
    return MeasuredSize(ratio, error, max(map(find_largest_steering, logs)), speeds)


def _fit_line_through_zero(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of a line through 0 and the correlation of the points (k,)."""
    square = float(x @ x)
    return float(x @ y) / max(square, 1e-30), float(x @ y) / math.sqrt(square * float(y @ y) + 1e-30)


def compute_file_curvature(angle_deg: Floats, tractor: Tractor, ground: str) -> Floats:
    """Return the curvature (1/m, positive right) that the file gives for wheel angles, extrapolated beyond the lock."""
    if ground not in tractor.radius:
        return np.tan(np.radians(angle_deg)) / tractor.wheelbase_m
    law = tractor.get_power_law(ground)
    return np.array(
        [0.0 if abs(angle) < 1e-9 else math.copysign(1.0 / law.compute_radius_m(angle), angle) for angle in angle_deg]
    )


def explain_other_vehicle(logs: Sequence[Log], tractor: Tractor, ground: str) -> str:
    """Why the logs cannot be of this tractor, as a clause; empty where they can."""
    size = measure_size(logs, tractor, ground)
    gain_param = next(param for param in get_effect("steering_gain").params)
    file_gain = tractor.effects["steering_gain"].value["ratio"] if "steering_gain" in tractor.effects else 1.0
    sensed = all(log.steering_deg is not None for log in logs)
    least_gain = gain_param.low * file_gain * (1.0 if sensed else _COMMAND_LAG_SHARE)
    if size.bend_ratio is not None and not (
        least_gain <= size.bend_ratio + SURE_SIGMAS * size.bend_ratio_error
        and size.bend_ratio - SURE_SIGMAS * size.bend_ratio_error <= gain_param.high * file_gain
    ):
        return (
            f"at the same wheel angles their path bends {size.bend_ratio:.2g} times as much as the file of "
            f"{tractor.name} says, and faults of a tractor only explain {gain_param.low:g} to {gain_param.high:g}"
        )
    share = _LOCK_SHARE if sensed else _COMMAND_SHARE
    if size.angle_deg > share * tractor.max_steering_deg + CLEAR_STEERING_DEG:
        return (
            f"their wheels turn to {size.angle_deg:.0f} degrees, and the steering lock of {tractor.name} is at "
            f"{tractor.max_steering_deg:g}"
        )
    return ""


def refuse_other_vehicle(logs: Sequence[Log], tractor: Tractor, ground: str) -> None:
    """Raise LogError where the logs cannot be of this tractor, with the size that they suggest."""
    misfit = explain_other_vehicle(logs, tractor, ground)
    if not misfit:
        return
    suggested, speeds = scale_to_logs(logs, tractor, ground), measure_size(logs, tractor, ground).speed_mps
    slow_and_fast = dict.fromkeys(f"{speed:.2g}" for speed in speeds)
    radius = 1.0 / float(compute_file_curvature(np.array([suggested.max_steering_deg]), suggested, ground)[0])
    make = "write a tractor file of this size"
    if suggested.wheelbase_m >= _SMALLEST_WHEELBASE_M:
        make = "make a tractor file of this size with `headland tractor new`"
    raise LogError(
        f"These logs are not of this tractor: {misfit}. Driven at {' to '.join(slow_and_fast)} m/s, they suggest a "
        f"wheelbase of {suggested.wheelbase_m:.2g} m and a turning radius of {radius:.2g} m at "
        f"{suggested.max_steering_deg:.0f} degrees, the largest angle driven; {make}, name the right tractor, or give "
        f"{mark_parameter('as_driven')} to use this size.",
        parameter="tractor",
    )


def scale_to_logs(logs: Sequence[Log], tractor: Tractor, ground: str) -> Tractor:
    """Return the tractor scaled to the size that the logs suggest; unchanged where they fit it.

    All lengths scale with the wheelbase, the mass with its cube and forces with the mass: logs of a path do not show
    them. Radii are those driven at the same angles.
    """
    if not explain_other_vehicle(logs, tractor, ground):
        return tractor
    size = measure_size(logs, tractor, ground)
    scale = 1.0 / size.bend_ratio if size.bend_ratio else 1.0
    scale = min(max(scale, 0.01 / tractor.rear_axle_m), 30.0 / tractor.length_m)
    lengths = (
        "front_axle_m", "rear_axle_m", "track_m", "length_m", "width_m", "rear_overhang_m", "antenna_forward_m",
        "antenna_right_m",
    )  # fmt: skip
    changed: dict[str, object] = {name: getattr(tractor, name) * scale for name in lengths}
    mass = min(max(tractor.mass_kg * scale**3, _MASSES_KG[0]), _MASSES_KG[1])
    changed["mass_kg"] = mass
    changed["max_steering_deg"] = min(math.ceil(size.angle_deg), _LARGEST_LOCK_DEG)
    changed["radius"] = {
        name: {side: (factor / scale, power) for side, (factor, power) in (("right", law.right), ("left", law.left))}
        for name, law in tractor.radius.items()
    }
    forces = ("proportional_n_s_per_m", "integral_n_per_m", "derivative_n_s2_per_m", "max_drive_n")
    lengths_ahead = ("lookahead_m", "turn_lookahead_m", "lateral_limit_m")
    for part, names, (times, over) in (
        ("speed", forces, (mass, tractor.mass_kg)),
        ("guidance", lengths_ahead, (scale, 1.0)),
    ):
        own = getattr(tractor, part).model_dump()
        changed[part] = own | {name: own[name] * times / over for name in names}
    values = tractor.model_dump() | {"name": f"{tractor.name} as driven", "effects": {}, "discrepancy_model": None}
    return Tractor.model_validate(values | changed)
