"""Wrong units, signs and axes of columns: detected by statistics that no physical effect reaches, fixed on request."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vehicle.identification.errors import LogError
from vehicle.identification.logs.chords import PathChords, compute_bends, compute_path_chords, find_largest_steering
from vehicle.identification.logs.directions import (
    HEADING_FITS,
    HEADING_MATCHES,
    compute_heading_agreements,
    find_direction_errors,
)
from vehicle.identification.logs.schema import (
    SHORTEST_SEGMENT_S,
    STEERING_COLUMNS,
    Array,
    Log,
    LogConvention,
    Suspicion,
)
from vehicle.identification.logs.swapped_steering import find_swapped_steering

Columns = dict[str, Array]
Place = tuple[float, float]

_EARTH_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # WGS 84


def convert_columns(columns: Columns, fixes: frozenset[LogConvention], reference: Place | None = None) -> Columns:
    """Return the columns in the contract's units and signs.

    Fixes are applied in the order of LogConvention. `reference` is the (longitude, latitude) in degrees that becomes
    the origin of positions given in degrees; by default the first position.
    """
    out = dict(columns)
    for fix in LogConvention:
        if fix not in fixes:
            continue
        if fix is LogConvention.EAST_NORTH_SWAPPED:
            out |= {"easting_m": out["northing_m"], "northing_m": out["easting_m"]}
            continue
        if fix is LogConvention.STEERING_SWAPPED:
            out |= _swap_steering(out)
            continue
        if fix is LogConvention.POSITION_DEGREES:
            out |= _convert_to_local_metres(out, reference or find_first_place(out))
            continue
        names, convert = _CONVERSIONS[fix]
        out |= {name: convert(out[name]) for name in names if name in out}
    return out


def _swap_steering(columns: Columns) -> Columns:
    """Return each steering column under the name of the other; raises LogError where there is only one."""
    command, wheel = STEERING_COLUMNS
    absent = next((name for name in STEERING_COLUMNS if name not in columns), None)
    if absent is not None:
        raise LogError(
            f"{absent} is not logged, and the fix {LogConvention.STEERING_SWAPPED} exchanges it with the other "
            "steering column; remove that fix, or rename the column."
        )
    return {command: columns[wheel], wheel: columns[command]}


def _make_ccw_heading_converter(zero_deg: float) -> Callable[[Array], Array]:
    return lambda heading: np.mod(zero_deg - heading, 360.0)


def _convert_from_kmh(values: Array) -> Array:
    return values / 3.6


_CONVERSIONS: dict[LogConvention, tuple[tuple[str, ...], Callable[[Array], Array]]] = {
    LogConvention.TIME_MS: (("time_s",), lambda values: values / 1e3),
    LogConvention.TIME_US: (("time_s",), lambda values: values / 1e6),
    LogConvention.TIME_NS: (("time_s",), lambda values: values / 1e9),
    LogConvention.POSITION_KM: (("easting_m", "northing_m"), lambda values: values * 1000.0),
    LogConvention.SPEED_KMH: (("speed_mps", "speed_command_mps"), _convert_from_kmh),
    LogConvention.SPEED_MEASURED_KMH: (("speed_mps",), _convert_from_kmh),
    LogConvention.SPEED_COMMAND_KMH: (("speed_command_mps",), _convert_from_kmh),
    LogConvention.HEADING_RADIANS: (("heading_deg",), lambda values: np.mod(np.degrees(values), 360.0)),
    LogConvention.HEADING_CCW_EAST: (("heading_deg",), _make_ccw_heading_converter(90.0)),
    LogConvention.HEADING_CCW_NORTH: (("heading_deg",), _make_ccw_heading_converter(0.0)),
    LogConvention.HEADING_REVERSED: (("heading_deg",), lambda values: np.mod(values + 180.0, 360.0)),
    LogConvention.STEERING_RADIANS: (STEERING_COLUMNS, np.degrees),
    LogConvention.STEERING_LEFT: (STEERING_COLUMNS, np.negative),
    LogConvention.IMPLEMENT_REVERSED: (("implement",), lambda values: 1.0 - values),
    LogConvention.ROLL_LEFT: (("roll_deg",), np.negative),
}


def find_first_place(columns: Columns) -> Place:
    """Return the first finite position of the columns, unconverted."""
    finite_rows = np.flatnonzero(np.isfinite(columns["easting_m"]) & np.isfinite(columns["northing_m"]))
    return float(columns["easting_m"][finite_rows[0]]), float(columns["northing_m"][finite_rows[0]])


def _convert_to_local_metres(columns: Columns, reference: Place) -> Columns:
    """Return east and north of the reference by the ellipsoid's radii of curvature there: true north stays north.

    Raises LogError for values that are no longitude and latitude.
    """
    longitude, latitude = reference
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        raise LogError(
            f"easting_m {longitude:g} and northing_m {latitude:g} are not a longitude and latitude; "
            f"remove the fix {LogConvention.POSITION_DEGREES}."
        )
    squared = _FLATTENING * (2.0 - _FLATTENING)
    bulge = 1.0 - squared * math.sin(math.radians(latitude)) ** 2
    meridian, parallel = _EARTH_M * (1.0 - squared) / bulge**1.5, _EARTH_M / math.sqrt(bulge)
    east = np.radians(columns["easting_m"] - longitude) * parallel * math.cos(math.radians(latitude))
    return {"easting_m": east, "northing_m": np.radians(columns["northing_m"] - latitude) * meridian}


def convert_log(log: Log, fix: LogConvention) -> Log:
    """Return the log with one fix applied to all its columns."""
    names = (
        "time_s",
        "easting_m",
        "northing_m",
        "heading_deg",
        "speed_mps",
        "speed_command_mps",
        *STEERING_COLUMNS,
        "implement",
    )
    columns = {name: getattr(log, name) for name in names if getattr(log, name) is not None}
    first = int(np.flatnonzero(log.used)[0])
    reference = (float(log.easting_m[first]), float(log.northing_m[first]))
    changed: dict[str, Any] = dict(convert_columns(columns, frozenset([fix]), reference))
    return replace(log, **changed)


# Logs have at least 1 Hz. At 1 to 200 Hz milliseconds give steps of 5 to 1000, and each smaller unit 1000 times more.
SLOWEST_STEP_S = 5.0
_TIME_UNITS = ((LogConvention.TIME_NS, 5.0e6), (LogConvention.TIME_US, 5.0e3), (LogConvention.TIME_MS, SLOWEST_STEP_S))
SMALLEST_WHEELBASE_M = 0.12  # of a model car
LARGEST_RAD = 1.0  # 57 degrees: no road wheel turns further
# Ratio of a speed in km/h to the speed of the path in m/s: 3.6, with slip. A command may not be reached for long.
_KMH, _KMH_COMMAND = (2.7, 4.8), (2.7, 6.0)
_ALIKE_COSINE = 0.02  # of a mean cosine: conventions this close cannot be distinguished
_SURE_SIGMAS = 4.0  # standard errors
_LEAST_STEERING_SPREAD = 0.02  # of the steering: 1.1 degrees in radians, and noise in degrees
# Turns and straight rows of a field: limits of curvature, least number of turns, share that contradicts the column.
_TURN_PER_M, _ROW_PER_M, _FEWEST_TURNS, _REVERSED_SHARE = 0.06, 0.02, 4, 0.85
# A heading in radians changes by 0.017 for a degree of the path, one in degrees by 1, a frozen one by 0.
_RADIAN_TURN_RATIO, _WRAP_RAD = (0.012, 0.025), 3.0
# Nothing in radians changes by more than a circle; a share of wild rows is left to receivers.
_LARGEST_CHANGE_RAD, _MOST_LARGER_SHARE = 7.0, 0.05
_LEAST_TURN_DEG2 = 20 * 5.0**2  # chosen: 20 chords that turn by 5 degrees, where noise turns them by 1
_FEWEST_BENDS = 8  # chords, each half overlapping the next: four observations for two numbers


def find_convention_errors(
    log: Log, wheelbase_m: float | None = None, other_logs: Sequence[Log] = ()
) -> list[Suspicion]:
    """Return the conventions that the log seems to break.

    Each check sees the log with the suspected errors before it fixed. `wheelbase_m` sharpens the check for radians;
    `other_logs` of the same logger help where a straight drive is ambiguous. Raises LogError when the two steering
    columns contradict each other.
    """
    suspicions: list[Suspicion] = []
    for check in (_check_time, _check_positions, _check_speed, _check_heading_unit, _check_steering_unit):
        for fix, why in check(log, wheelbase_m, other_logs):
            suspicions.append(Suspicion(fix, why))
            log, other_logs = convert_log(log, fix), [convert_log(other_log, fix) for other_log in other_logs]
    return [*suspicions, *find_direction_errors(log, other_logs), *_check_implement(log), *_check_steering_names(log)]


def _check_time(log: Log, _wheelbase_m: float | None, _other_logs: Sequence[Log]) -> list[tuple[LogConvention, str]]:
    fix = next((unit for unit, least_step in _TIME_UNITS if log.step_s >= least_step), None)
    if fix is None:
        return []
    return [(fix, f"its rows are {log.step_s:g} apart, and a log has at least one row per second")]


def _check_positions(
    log: Log, _wheelbase_m: float | None, _other_logs: Sequence[Log]
) -> list[tuple[LogConvention, str]]:
    """Check for kilometres (the path is 1000 times too short) and degrees (100,000 times too short)."""
    rows = log.used
    stated = log.speed_command_mps if log.speed_mps is None else log.speed_mps
    extent = float(np.hypot(np.ptp(log.easting_m[rows]), np.ptp(log.northing_m[rows])))
    stated_distance = float(np.ptp(log.time_s[rows])) * 0.5 if stated is None else _integrate_distance(log, stated)
    if extent <= 0.0 or stated_distance < 5.0 * log.step_s or stated_distance < 3.0:
        return []
    chords = compute_path_chords(log)
    path_length = (
        extent if chords is None else max(extent, float(np.mean(chords.speed)) * float(np.ptp(log.time_s[rows])))
    )
    share = path_length / stated_distance
    why = f"the path is {path_length:.3g} long although {stated_distance:.0f} m were driven"
    east, north = float(np.abs(log.easting_m[rows]).max()), float(np.abs(log.northing_m[rows]).max())
    if share < 1.0e-4 and max(east, north) <= 180.0 and min(east, north) <= 90.0:
        swapped = [(LogConvention.EAST_NORTH_SWAPPED, f"northing_m reaches {north:.5g}, and a latitude is at most 90")]
        return [*(swapped if north > 90.0 else []), (LogConvention.POSITION_DEGREES, why)]
    return [(LogConvention.POSITION_KM, why)] if 1.0e-4 <= share < 6.0e-3 else []


def _integrate_distance(log: Log, speed: Array) -> float:
    """Return the distance (m) driven at the stated speed, without gaps."""
    rows = np.flatnonzero(log.used)
    is_same_segment = np.diff(log.segment[rows]) == 0
    return float(np.sum(np.where(is_same_segment, speed[rows][:-1] * np.diff(log.time_s[rows]), 0.0)))


def _check_speed(log: Log, _wheelbase_m: float | None, _other_logs: Sequence[Log]) -> list[tuple[LogConvention, str]]:
    """Check for km/h: 3.6 is far more than slip can explain. Each column is compared with the path."""
    chords = compute_path_chords(log)
    if chords is None or float(np.mean(chords.speed)) < 0.1:
        return []
    measured = _explain_kmh("speed_mps", log, chords, _KMH)
    command = _explain_kmh("speed_command_mps", log, chords, _KMH_COMMAND)
    if measured and (command or log.speed_command_mps is None):
        return [(LogConvention.SPEED_KMH, measured)]
    if command:
        return [(LogConvention.SPEED_KMH if log.speed_mps is None else LogConvention.SPEED_COMMAND_KMH, command)]
    return [(LogConvention.SPEED_MEASURED_KMH, measured)] if measured else []


def _explain_kmh(name: str, log: Log, chords: PathChords, band: tuple[float, float]) -> str:
    """Why a column is in km/h; empty when it is not.

    Also compared over the faster half, without starts. Logs of a few seconds may be all start and are not judged.
    """
    speed: Array | None = getattr(log, name)
    if speed is None or float(np.ptp(log.time_s[log.used])) < SHORTEST_SEGMENT_S:
        return ""
    fast = chords.speed >= np.median(chords.speed)
    for part in (np.ones_like(fast), fast):
        stated, path = float(np.mean(speed[chords.row][part])), float(np.mean(chords.speed[part]))
        if not band[0] <= stated / path <= band[1]:
            return ""
    return f"{name} is {stated:.2f} while the positions move at {path:.2f} m/s"


def _check_heading_unit(
    log: Log, _wheelbase_m: float | None, other_logs: Sequence[Log]
) -> list[tuple[LogConvention, str]]:
    """Check for radians: they turn a 57th as far as the path, or they end at 6.3 in every log and agree with the path.

    Driving due east, radians look like degrees from east as well.
    """
    chords = compute_path_chords(log)
    if log.heading_deg is None or chords is None:
        return []
    logs = [one for one in (log, *other_logs) if one.heading_deg is not None]
    ratio = _measure_turn_ratio(logs)
    if ratio is not None and _RADIAN_TURN_RATIO[0] < abs(ratio) < _RADIAN_TURN_RATIO[1]:
        return [(LogConvention.HEADING_RADIANS, f"it changes by {abs(ratio):.3f} while the path turns by one degree")]
    largest = max(float(np.abs(one.heading_deg[one.used]).max()) for one in logs if one.heading_deg is not None)
    as_degrees = compute_heading_agreements(log, chords, log.heading_deg)
    as_radians = max(compute_heading_agreements(log, chords, np.degrees(log.heading_deg)).values())
    if as_degrees[None] >= HEADING_FITS or largest > 6.5:
        return []
    if as_radians < max(HEADING_MATCHES, max(as_degrees.values()) - _ALIKE_COSINE):
        return []
    return [
        (LogConvention.HEADING_RADIANS, f"no value exceeds {largest:.2f}, and in radians it agrees with the course")
    ]


def _measure_turn_ratio(logs: Sequence[Log]) -> float | None:
    """Return by how much the heading changes while the path turns by one degree; None where logs do not show it.

    Between neighbouring chords no tractor turns half a circle, so larger changes are the wrap of radians. A heading
    that often changes by more than a circle of radians is in degrees; so few of its changes are small that their ratio
    says nothing, as a ratio within its own error.
    """
    all_turns, all_changes = [np.empty(0)], [np.empty(0)]
    for log in logs:
        chords = compute_path_chords(log)
        if log.heading_deg is None or chords is None:
            continue
        turns = np.degrees(np.diff(chords.course) + math.pi) % 360.0 - 180.0
        changes = np.diff(log.heading_deg[chords.row])
        near = (np.diff(log.segment[chords.row]) == 0) & (np.abs(turns) < 90.0)
        all_turns.append(turns[near])
        all_changes.append(changes[near])
    turns, changes = np.concatenate(all_turns), np.concatenate(all_changes)
    if np.count_nonzero(np.abs(changes) > _LARGEST_CHANGE_RAD) > _MOST_LARGER_SHARE * len(changes):
        return None
    small = np.abs(changes) < _WRAP_RAD
    turns, changes = turns[small], changes[small]
    squares = float(turns @ turns)
    if squares < _LEAST_TURN_DEG2:
        return None
    ratio = float(turns @ changes) / squares
    # Chords overlap by half, so two count as one observation.
    error = math.sqrt(2.0 * float(np.mean((changes - ratio * turns) ** 2)) / squares)
    return ratio if abs(ratio) > _SURE_SIGMAS * error else None


def _check_steering_unit(
    log: Log, wheelbase_m: float | None, _other_logs: Sequence[Log]
) -> list[tuple[LogConvention, str]]:
    """Check for radians: as degrees they would need a wheelbase of centimetres to bend the path this much.

    Only changes of the angle count (the slope of curvature over angle), so no offset, slope or draft matters.
    """
    bends = compute_bends(log)
    largest = find_largest_steering(log)
    if bends is None or largest > LARGEST_RAD or len(bends[0]) < _FEWEST_BENDS:
        return []
    if float(np.std(bends[0])) < _LEAST_STEERING_SPREAD:
        return []
    slope, error = _fit_slope(bends[0], bends[1])
    least_slope = abs(slope) - _SURE_SIGMAS * error
    limit = SMALLEST_WHEELBASE_M if wheelbase_m is None else wheelbase_m / 8.0
    if least_slope <= 0.0 or math.radians(1.0) / least_slope > limit:
        return []
    wheelbase_cm = 100.0 * math.radians(1.0) / abs(slope)
    why = f"no angle exceeds {largest:.2f}, and in degrees they would need a wheelbase of {wheelbase_cm:.1f} cm"
    return [(LogConvention.STEERING_RADIANS, why)]


def _check_steering_names(log: Log) -> list[Suspicion]:
    """Check for a wheel angle under the name of the command, and the command under that of the wheel angle."""
    why = find_swapped_steering(log)
    return [] if why is None else [Suspicion(LogConvention.STEERING_SWAPPED, why)]


def _check_implement(log: Log) -> list[Suspicion]:
    """Check for rows driven with the implement up and headland turns with it down."""
    chords = compute_path_chords(log)
    if chords is None:
        return []
    curvature = np.abs(chords.curvature)
    kind = np.where(curvature > _TURN_PER_M, 1, np.where(curvature < _ROW_PER_M, 0, -1))
    kind, working = kind[kind >= 0], log.implement[chords.row][kind >= 0] > 0.5
    if np.count_nonzero(np.diff(kind) > 0) < _FEWEST_TURNS or np.count_nonzero(np.diff(kind) < 0) < _FEWEST_TURNS - 1:
        return []
    turns, rows = float(np.mean(working[kind == 1])), 1.0 - float(np.mean(working[kind == 0]))
    if min(turns, rows) < _REVERSED_SHARE:
        return []
    why = f"it is 1 in {100.0 * turns:.0f} % of the turns and 0 on {100.0 * rows:.0f} % of the straight rows between"
    return [Suspicion(LogConvention.IMPLEMENT_REVERSED, why)]


def _fit_slope(x: Array, y: Array) -> tuple[float, float]:
    """Return the slope of y over x about their means and its standard error; far outliers are excluded once."""
    inliers = np.ones(len(x), dtype=np.bool_)
    slope, error = 0.0, math.inf
    for _ in range(2):
        a, b = x[inliers] - x[inliers].mean(), y[inliers] - y[inliers].mean()
        spread = float(a @ a)
        if spread <= 0.0 or np.count_nonzero(inliers) < _FEWEST_BENDS:
            break
        slope = float(a @ b) / spread
        residuals = b - slope * a
        # Chords overlap by half, so two count as one observation.
        error = math.sqrt(2.0 * float(residuals @ residuals) / (len(a) - 2) / spread)
        all_residuals = (y - y[inliers].mean()) - slope * (x - x[inliers].mean())
        inliers = np.abs(all_residuals) <= 4.0 * 1.4826 * float(np.median(np.abs(all_residuals))) + 1e-12
    return slope, error
