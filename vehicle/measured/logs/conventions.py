"""Wrong units and signs in a log: recognised by statistics no physical effect reaches, and fixed on request."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vehicle.measured.logs.bends import bends, largest_steering
from vehicle.measured.logs.conversions import apply_fixes, first_place, fixed
from vehicle.measured.logs.directions import HEADING_FITS, HEADING_MATCHES, directions, heading_fits
from vehicle.measured.logs.motion import Motion, motion
from vehicle.measured.logs.record import Array, Fix, Log, Suspicion
from vehicle.measured.logs.stretches import SHORTEST_S

__all__ = ["apply_fixes", "conventions", "first_place"]

SLOWEST_STEP_S = 5.0  # logs have at least 1 Hz; at 1 to 200 Hz milliseconds give steps of 5 to 1000
SMALLEST_WHEELBASE_M = 0.12  # of a model car
LARGEST_RAD = 1.0  # 57 degrees: no road wheel turns further
# What a speed in km/h is to the path's in m/s: 3.6, less or more by slip. A command may be far from being reached.
_KMH, _KMH_COMMAND = (2.7, 4.8), (2.7, 6.0)
_ALIKE = 0.02  # of a mean cosine: readings that near to each other are not told apart
_SURE = 4.0  # standard errors
_LEAST_SPREAD = 0.02  # of the steering: 1.1 degrees in radians, and noise in degrees
# Rows of a field: turned and straight driving, how often they must take turns, and what share of each is against it.
_TURN_PER_M, _ROW_PER_M, _FEWEST_TURNS, _AGAINST = 0.06, 0.02, 4, 0.85
_FEWEST_BENDS = 8  # chords, each half overlapping the next: four observations for two numbers


def conventions(log: Log, wheelbase_m: float | None = None, others: Sequence[Log] = ()) -> list[Suspicion]:
    """Conventions the log seems to break.

    Each check sees the log as if the suspicions before it were fixed. `wheelbase_m` sharpens the check for radians;
    `others`, further logs of the same logger, help to tell readings of a straight drive apart.
    Raises LogError when the two steering columns contradict each other.
    """
    suspicions: list[Suspicion] = []
    for check in (_time, _positions, _speed, _heading_unit, _steering_unit):
        for fix, why in check(log, wheelbase_m, others):
            suspicions.append(Suspicion(fix, why))
            log, others = fixed(log, fix), [fixed(other, fix) for other in others]
    return [*suspicions, *directions(log, others), *_implement(log)]


def _time(log: Log, _wheelbase_m: float | None, _others: Sequence[Log]) -> list[tuple[Fix, str]]:
    if log.step_s < SLOWEST_STEP_S:
        return []
    return [(Fix.TIME_MS, f"its rows are {log.step_s:g} apart, a log has at least one row per second")]


def _positions(log: Log, _wheelbase_m: float | None, _others: Sequence[Log]) -> list[tuple[Fix, str]]:
    """Kilometres make the path a thousand times too short, degrees a hundred thousand times."""
    rows = log.used
    stated = log.speed_command_mps if log.speed_mps is None else log.speed_mps
    moved = float(np.hypot(np.ptp(log.easting_m[rows]), np.ptp(log.northing_m[rows])))
    drove = float(np.ptp(log.time_s[rows])) * 0.5 if stated is None else _distance(log, stated)
    if moved <= 0.0 or drove < 5.0 * log.step_s or drove < 3.0:
        return []
    chords = motion(log)
    driven = moved if chords is None else max(moved, float(np.mean(chords.speed)) * float(np.ptp(log.time_s[rows])))
    share = driven / drove
    why = f"the path is {driven:.3g} long where {drove:.0f} m were driven"
    east, north = float(np.abs(log.easting_m[rows]).max()), float(np.abs(log.northing_m[rows]).max())
    if share < 1.0e-4 and max(east, north) <= 180.0 and min(east, north) <= 90.0:
        swapped = [(Fix.EAST_NORTH_SWAPPED, f"northing_m goes to {north:.5g}, a latitude ends at 90")]
        return [*(swapped if north > 90.0 else []), (Fix.POSITION_DEGREES, why)]
    return [(Fix.POSITION_KM, why)] if 1.0e-4 <= share < 6.0e-3 else []


def _distance(log: Log, speed: Array) -> float:
    """Metres driven by the stated speed, leaving out gaps."""
    rows = np.flatnonzero(log.used)
    same = np.diff(log.segment[rows]) == 0
    return float(np.sum(np.where(same, speed[rows][:-1] * np.diff(log.time_s[rows]), 0.0)))


def _speed(log: Log, _wheelbase_m: float | None, _others: Sequence[Log]) -> list[tuple[Fix, str]]:
    """A factor of 3.6 lies far outside what wheels can slip; each column is held against the path."""
    chords = motion(log)
    if chords is None or float(np.mean(chords.speed)) < 0.1:
        return []
    measured = _kmh("speed_mps", log, chords, _KMH)
    command = _kmh("speed_command_mps", log, chords, _KMH_COMMAND)
    if measured and (command or log.speed_command_mps is None):
        return [(Fix.SPEED_KMH, measured)]
    if command:
        return [(Fix.SPEED_KMH if log.speed_mps is None else Fix.SPEED_COMMAND_KMH, command)]
    return [(Fix.SPEED_MEASURED_KMH, measured)] if measured else []


def _kmh(name: str, log: Log, chords: Motion, band: tuple[float, float]) -> str:
    """Why a column is in km/h; empty when it is not. Judged on the faster half too, past every start.

    A log of a few seconds may be all start, and is not judged.
    """
    speed: Array | None = getattr(log, name)
    if speed is None or float(np.ptp(log.time_s[log.used])) < SHORTEST_S:
        return ""
    fast = chords.speed >= np.median(chords.speed)
    for part in (np.ones_like(fast), fast):
        said, path = float(np.mean(speed[chords.row][part])), float(np.mean(chords.speed[part]))
        if not band[0] <= said / path <= band[1]:
            return ""
    return f"{name} says {said:.2f} where the positions move at {path:.2f} m/s"


def _heading_unit(log: Log, _wheelbase_m: float | None, others: Sequence[Log]) -> list[tuple[Fix, str]]:
    """Radians end at 6.3, in every log; on a straight drive due east they look like degrees from east as well."""
    chords = motion(log)
    if log.heading_deg is None or chords is None:
        return []
    seen = [one.heading_deg[one.used] for one in (log, *others) if one.heading_deg is not None]
    largest = max(float(np.abs(values).max()) for values in seen)
    as_degrees = heading_fits(log, chords, log.heading_deg)
    as_radians = max(heading_fits(log, chords, np.degrees(log.heading_deg)).values())
    if as_degrees[None] >= HEADING_FITS or largest > 6.5:
        return []
    if as_radians < max(HEADING_MATCHES, max(as_degrees.values()) - _ALIKE):
        return []
    return [(Fix.HEADING_RADIANS, f"no value is beyond {largest:.2f}, and read so it agrees with the course")]


def _steering_unit(log: Log, wheelbase_m: float | None, _others: Sequence[Log]) -> list[tuple[Fix, str]]:
    """Read as degrees, radians would need a wheelbase of centimetres to bend the path as it is bent.

    Only changes of the angle count (the slope of curvature over angle), so no offset, slope or draft matters.
    """
    bent = bends(log)
    largest = largest_steering(log)
    if bent is None or largest > LARGEST_RAD or len(bent[0]) < _FEWEST_BENDS:
        return []
    if float(np.std(bent[0])) < _LEAST_SPREAD:
        return []
    slope, error = _slope(bent[0], bent[1])
    least = abs(slope) - _SURE * error
    limit = SMALLEST_WHEELBASE_M if wheelbase_m is None else wheelbase_m / 8.0
    if least <= 0.0 or math.radians(1.0) / least > limit:
        return []
    base = 100.0 * math.radians(1.0) / abs(slope)
    why = f"no angle is beyond {largest:.2f}, and as degrees they would need a wheelbase of {base:.1f} cm"
    return [(Fix.STEERING_RADIANS, why)]


def _implement(log: Log) -> list[Suspicion]:
    """Row after row driven with the implement up, and every headland turn between them with it down."""
    chords = motion(log)
    if chords is None:
        return []
    bent = np.abs(chords.curvature)
    kind = np.where(bent > _TURN_PER_M, 1, np.where(bent < _ROW_PER_M, 0, -1))
    kind, working = kind[kind >= 0], log.implement[chords.row][kind >= 0] > 0.5
    if np.count_nonzero(np.diff(kind) > 0) < _FEWEST_TURNS or np.count_nonzero(np.diff(kind) < 0) < _FEWEST_TURNS - 1:
        return []
    turns, rows = float(np.mean(working[kind == 1])), 1.0 - float(np.mean(working[kind == 0]))
    if min(turns, rows) < _AGAINST:
        return []
    why = f"it is 1 in {100.0 * turns:.0f} % of the turns and 0 on {100.0 * rows:.0f} % of the straight rows between"
    return [Suspicion(Fix.IMPLEMENT_REVERSED, why)]


def _slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y over x about their middles and its standard error; far outliers are left out once."""
    kept = np.ones(len(x), dtype=np.bool_)
    slope, error = 0.0, math.inf
    for _ in range(2):
        a, b = x[kept] - x[kept].mean(), y[kept] - y[kept].mean()
        spread = float(a @ a)
        if spread <= 0.0 or np.count_nonzero(kept) < _FEWEST_BENDS:
            break
        slope = float(a @ b) / spread
        left = b - slope * a
        # Chords overlap by half: two of them are one observation.
        error = math.sqrt(2.0 * float(left @ left) / (len(a) - 2) / spread)
        rest = (y - y[kept].mean()) - slope * (x - x[kept].mean())
        kept = np.abs(rest) <= 4.0 * 1.4826 * float(np.median(np.abs(rest))) + 1e-12
    return slope, error
