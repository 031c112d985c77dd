"""Wrong units and signs in a log: recognised by statistics no physical effect reaches, and fixed on request."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.motion import Motion, motion
from vehicle.measured.record import Array, Fix, Log, Suspicion

Columns = dict[str, Array]
Place = tuple[float, float]

SLOWEST_STEP_S = 5.0  # logs have at least 1 Hz; at 1 to 200 Hz milliseconds give steps of 5 to 1000
SMALLEST_WHEELBASE_M = 0.12
CLEAR_STEERING_DEG = 3.0
CLEAR_STEERING_RAD = 0.1
_EARTH_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # WGS 84
_HEADING_FITS, _HEADING_MATCHES = math.cos(math.radians(30.0)), math.cos(math.radians(18.0))
_FEWEST_TURNS = 5


def apply_fixes(columns: Columns, fixes: frozenset[Fix], reference: Place | None = None) -> Columns:
    """Columns in the contract's units and signs.

    `reference` is the longitude and latitude (deg) that become the origin of positions given in degrees; without
    it the first position is.
    """
    out = dict(columns)
    for fix in Fix:
        if fix not in fixes:
            continue
        if fix is Fix.POSITION_DEGREES:
            out |= _local_metres(out, reference or first_place(out))
            continue
        names, convert = _CONVERSIONS[fix]
        out |= {name: convert(out[name]) for name in names if name in out}
    return out


def _ccw_from(zero_deg: float) -> Callable[[Array], Array]:
    return lambda heading: np.mod(zero_deg - heading, 360.0)


_STEERING = ("steering_command_deg", "steering_deg")
_CONVERSIONS: dict[Fix, tuple[tuple[str, ...], Callable[[Array], Array]]] = {
    Fix.TIME_MS: (("time_s",), lambda values: values / 1000.0),
    Fix.POSITION_KM: (("easting_m", "northing_m"), lambda values: values * 1000.0),
    Fix.SPEED_KMH: (("speed_mps", "speed_command_mps"), lambda values: values / 3.6),
    Fix.HEADING_RADIANS: (("heading_deg",), np.degrees),
    Fix.HEADING_CCW_EAST: (("heading_deg",), _ccw_from(90.0)),
    Fix.HEADING_CCW_NORTH: (("heading_deg",), _ccw_from(0.0)),
    Fix.STEERING_RADIANS: (_STEERING, np.degrees),
    Fix.STEERING_LEFT: (_STEERING, np.negative),
}


def first_place(columns: Columns) -> Place:
    """First position of the columns, as they are."""
    good = np.flatnonzero(np.isfinite(columns["easting_m"]) & np.isfinite(columns["northing_m"]))
    return float(columns["easting_m"][good[0]]), float(columns["northing_m"][good[0]])


def _local_metres(columns: Columns, reference: Place) -> Columns:
    """East and north of the reference, by the radii of curvature of the ellipsoid there: true north stays north."""
    longitude, latitude = reference
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        raise LogError(
            f"easting_m {longitude:g} and northing_m {latitude:g} are no longitude and latitude; "
            f"leave the fix {Fix.POSITION_DEGREES} out."
        )
    squared = _FLATTENING * (2.0 - _FLATTENING)
    bulge = 1.0 - squared * math.sin(math.radians(latitude)) ** 2
    meridian, parallel = _EARTH_M * (1.0 - squared) / bulge**1.5, _EARTH_M / math.sqrt(bulge)
    east = np.radians(columns["easting_m"] - longitude) * parallel * math.cos(math.radians(latitude))
    return {"easting_m": east, "northing_m": np.radians(columns["northing_m"] - latitude) * meridian}


def conventions(log: Log, wheelbase_m: float | None = None) -> list[Suspicion]:
    """Conventions the log seems to break, in the order in which their fixes are applied.

    Each check sees the log as if the suspicions before it were fixed. `wheelbase_m` sharpens the check for radians.
    Raises LogError when the two steering columns contradict each other.
    """
    found: list[Suspicion] = []
    for check in (_time, _positions, _speed, _heading_unit, _heading_sense, _steering_unit, _steering_sense):
        suspicion = check(log, wheelbase_m)
        if suspicion is not None:
            found.append(suspicion)
            log = _fixed(log, suspicion.fix)
    return found


def _fixed(log: Log, fix: Fix) -> Log:
    names = ("time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps", *_STEERING)
    columns = {name: getattr(log, name) for name in names if getattr(log, name) is not None}
    first = int(np.flatnonzero(log.used)[0])
    reference = (float(log.easting_m[first]), float(log.northing_m[first]))
    changed: dict[str, Any] = dict(apply_fixes(columns, frozenset([fix]), reference))
    return replace(log, **changed)


def _time(log: Log, _: float | None) -> Suspicion | None:
    if log.step_s < SLOWEST_STEP_S:
        return None
    return Suspicion(Fix.TIME_MS, f"its rows are {log.step_s:g} apart, a log has at least one row per second")


def _path_speed(log: Log) -> tuple[Motion, float] | None:
    chords = motion(log)
    if chords is None:
        return None
    return chords, float(np.mean(chords.speed))


def _stated_speed(log: Log) -> tuple[str, Array] | None:
    for name in ("speed_mps", "speed_command_mps"):
        speed: Array | None = getattr(log, name)
        if speed is not None:
            return name, speed
    return None


def _positions(log: Log, _: float | None) -> Suspicion | None:
    """Kilometres make the path a thousand times too short, degrees a hundred thousand times."""
    rows, stated = log.used, _stated_speed(log)
    moved = float(np.hypot(np.ptp(log.easting_m[rows]), np.ptp(log.northing_m[rows])))
    drove = float(np.ptp(log.time_s[rows])) * 0.5 if stated is None else _distance(log, stated[1])
    if moved <= 0.0 or drove < 5.0 * log.step_s or drove < 3.0:
        return None
    measured = _path_speed(log)
    driven = moved if measured is None else max(moved, measured[1] * float(np.ptp(log.time_s[rows])))
    share = driven / drove
    why = f"the path is {driven:.3g} long where {drove:.0f} m were driven"
    on_earth = np.abs(log.easting_m[rows]).max() <= 180.0 and np.abs(log.northing_m[rows]).max() <= 90.0
    if on_earth and share < 1.0e-4:
        return Suspicion(Fix.POSITION_DEGREES, why)
    return Suspicion(Fix.POSITION_KM, why) if 1.0e-4 <= share < 6.0e-3 else None


def _distance(log: Log, speed: Array) -> float:
    """Metres driven by the stated speed, leaving out gaps."""
    rows = np.flatnonzero(log.used)
    same = np.diff(log.segment[rows]) == 0
    return float(np.sum(np.where(same, speed[rows][:-1] * np.diff(log.time_s[rows]), 0.0)))


def _speed(log: Log, _: float | None) -> Suspicion | None:
    """A factor of 3.6 lies far outside what wheels can slip."""
    measured, stated = _path_speed(log), _stated_speed(log)
    if measured is None or stated is None:
        return None
    chords, path = measured
    said = float(np.mean(stated[1][chords.row]))
    if path < 0.1 or not 2.7 <= said / path <= 4.8:
        return None
    return Suspicion(Fix.SPEED_KMH, f"{stated[0]} says {said:.2f} where the positions move at {path:.2f} m/s")


def _heading_fits(log: Log, chords: Motion, heading_deg: Array) -> dict[Fix | None, float]:
    """Mean cosine between the course and each reading of the heading; None is the contract's reading."""
    travel = np.where(log.shuttle[chords.row] < 0.0, math.pi, 0.0) + chords.course
    heading = np.radians(heading_deg[chords.row])
    return {
        None: float(np.mean(np.cos(travel - heading))),
        Fix.HEADING_CCW_EAST: float(np.mean(np.cos(travel + heading - 0.5 * math.pi))),
        Fix.HEADING_CCW_NORTH: float(np.mean(np.cos(travel + heading))),
    }


def _heading_unit(log: Log, _: float | None) -> Suspicion | None:
    chords = motion(log)
    if log.heading_deg is None or chords is None:
        return None
    largest = float(np.abs(log.heading_deg[log.used]).max())
    as_degrees = _heading_fits(log, chords, log.heading_deg)
    as_radians = max(_heading_fits(log, chords, np.degrees(log.heading_deg)).values())
    if as_degrees[None] >= _HEADING_FITS or largest > 6.5:
        return None
    if as_radians < max(_HEADING_MATCHES, *as_degrees.values()):
        return None
    return Suspicion(Fix.HEADING_RADIANS, f"no value is beyond {largest:.2f}, and read so it agrees with the course")


def _heading_sense(log: Log, _: float | None) -> Suspicion | None:
    chords = motion(log)
    if log.heading_deg is None or chords is None:
        return None
    fits = _heading_fits(log, chords, log.heading_deg)
    best = max((Fix.HEADING_CCW_EAST, Fix.HEADING_CCW_NORTH), key=lambda fix: fits[fix])
    if fits[None] >= _HEADING_FITS or fits[best] < _HEADING_MATCHES:
        return None
    return Suspicion(
        best, f"agreement with the course over ground is {fits[None]:.2f} as it is and {fits[best]:.2f} read so"
    )


def _steering(log: Log) -> Array:
    """The steering to judge by: the sensor before the command. Refuses two columns that contradict each other."""
    command, sensor = log.steering_command_deg, log.steering_deg
    if sensor is None or command is None:
        angle = command if sensor is None else sensor
        assert angle is not None
        return angle
    one, two = command[log.used], sensor[log.used]
    spread, other = float(np.std(one)), float(np.std(two))
    if spread > 0.0 and other > 0.0:
        together = float(np.mean((one - one.mean()) * (two - two.mean()))) / (spread * other)
        if together < -0.7 and spread > 0.03:
            raise LogError(
                f"{log.name}: steering_command_deg and steering_deg have opposite signs (correlation "
                f"{together:.2f}); make both positive to the right."
            )
        if together > 0.7 and not 1.0 / 20.0 < spread / other < 20.0:
            raise LogError(
                f"{log.name}: steering_command_deg moves {spread / other:.3g} times as far as steering_deg; "
                "one is in radians, write both in degrees."
            )
    return sensor


def _bends(log: Log) -> tuple[Array, Array] | None:
    """Steering averaged over each chord, and the curvature to the right of a forward gear, per chord."""
    chords = motion(log)
    if chords is None:
        return None
    steering = np.where(log.used, _steering(log), 0.0)
    rows = np.flatnonzero(log.used)
    time, values = log.time_s[rows], steering[rows]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    middle = log.time_s[chords.row]
    ends = [np.interp(middle + shift * chords.span_s, time, total) for shift in (-0.5, 0.5)]
    return (ends[1] - ends[0]) / chords.span_s, chords.curvature * np.sign(log.shuttle[chords.row])


def _steering_unit(log: Log, wheelbase_m: float | None) -> Suspicion | None:
    """Read as degrees, radians would need a wheelbase of centimetres to bend the path as it is bent."""
    bends = _bends(log)
    if bends is None:
        return None
    angle, curvature = bends
    largest = float(np.abs(_steering(log)[log.used]).max())
    clear = np.abs(angle) > CLEAR_STEERING_RAD
    if largest > 1.0 or np.count_nonzero(clear) < _FEWEST_TURNS:
        return None
    angle, curvature = angle[clear], curvature[clear]
    together = abs(float(angle @ curvature)) / math.sqrt(float(angle @ angle) * float(curvature @ curvature) + 1e-30)
    base = math.radians(float(angle @ angle) / max(abs(float(angle @ curvature)), 1e-30))
    limit = SMALLEST_WHEELBASE_M if wheelbase_m is None else wheelbase_m / 8.0
    if together < 0.9 or base > limit:
        return None
    return Suspicion(
        Fix.STEERING_RADIANS,
        f"no angle is beyond {largest:.2f}, and as degrees they would need a wheelbase of {100.0 * base:.1f} cm",
    )


def _steering_sense(log: Log, _: float | None) -> Suspicion | None:
    """Judged on clear steering only, where no offset, slope or draft can turn the tractor the other way."""
    bends = _bends(log)
    if bends is None:
        return None
    clear = np.abs(bends[0]) >= CLEAR_STEERING_DEG
    if np.count_nonzero(clear) < _FEWEST_TURNS:
        return None
    angle, curvature = bends[0][clear], bends[1][clear]
    together = float(angle @ curvature) / math.sqrt(float(angle @ angle) * float(curvature @ curvature) + 1e-30)
    opposite = float(np.mean(angle * curvature < 0.0))
    if together > -0.5 or opposite < 0.8:
        return None
    return Suspicion(
        Fix.STEERING_LEFT, f"in {100.0 * opposite:.0f} % of the clear bends the path turns away from the steering"
    )
