"""Wrong units, signs and axes of columns: detected by statistics that no physical effect reaches, fixed on request."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fields.arrays import Floats
from vehicle.identification.logs.directions import (
    HEADING_FITS,
    HEADING_MATCHES,
    compute_heading_agreements,
    find_direction_errors,
)
from vehicle.identification.logs.motion import (
    PathChords,
    compute_bends,
    compute_path_chords,
    find_largest_steering,
    fit_chords,
)
from vehicle.identification.logs.readings import SPEED_UNITS, LogConvention, Suspicion, convert_log
from vehicle.identification.logs.schema import SHORTEST_SEGMENT_S, Log
from vehicle.identification.logs.series import measure_spread
from vehicle.identification.logs.thresholds import (
    ALMOST_ALL_SHARE,
    BEND_PER_M,
    FEWEST_CHORDS,
    FEWEST_EVENTS,
    FEWEST_TIMES,
    STEADY_SHARE,
    SURE_SIGMAS,
)

SMALLEST_WHEELBASE_M = 0.12  # of a model car
LARGEST_RAD = 1.0  # 57 degrees: no road wheel turns further
_ALIKE_COSINE = 0.02  # of a mean cosine: conventions this close cannot be distinguished
_LEAST_STEERING_SPREAD = 0.02  # of the steering: 1.1 degrees in radians, and noise in degrees
# Straight rows of a field: limit of curvature; share of turns and rows that contradicts the column.
_ROW_PER_M = 0.02
_WRAP_RAD = 3.0
# Nothing in radians changes by more than a circle; a share of wild rows is left to receivers.
_LARGEST_CHANGE_RAD = 7.0
_LEAST_TURN_DEG2 = 20 * 5.0**2  # chosen: 20 chords that turn by 5 degrees, where noise turns them by 1
_ALIKE_SHARES = (0.75, 1.67)  # of a commanded speed to the measured one in the same unit
_AHEAD_S = 0.3  # chosen: within which wheels move towards a command
_GAP_DEG = 0.7  # chosen: rows with larger gaps show who follows whom
# Chosen, correlations of movement with the gap before it: from which a column follows, and up to which it does not.
_FOLLOWS, _FOLLOWS_MORE = 0.6, 0.2
_STEEPEST_ROWS = 2  # chosen: one may be an outlier
_STEEPER = 1.5  # chosen: times the steepest movement of the column that follows


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
        for fix, why in check(log, other_logs, wheelbase_m):
            suspicions.append(Suspicion(fix, why))
            log, other_logs = convert_log(log, fix), [convert_log(other_log, fix) for other_log in other_logs]
    swapped = find_swapped_steering(log)
    names = [] if swapped is None else [Suspicion(LogConvention.STEERING_SWAPPED, swapped)]
    return [*suspicions, *find_direction_errors(log, other_logs), *_check_implement(log), *names]


def _check_time(log: Log, *_: object) -> list[tuple[LogConvention, str]]:
    why = f"its rows are {log.step_s:g} apart, and a log has at least one row per second"
    units = (LogConvention.TIME_MS, LogConvention.TIME_US, LogConvention.TIME_NS)
    return [(unit, why) for unit in units if unit.explains(log.step_s)]


def _check_positions(log: Log, *_: object) -> list[tuple[LogConvention, str]]:
    """Check for kilometres (the path is 1000 times too short), degrees (100,000 times), and feet (3.3 too long)."""
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
    if LogConvention.POSITION_DEGREES.explains(share) and max(east, north) <= 180.0 and min(east, north) <= 90.0:
        swapped = [(LogConvention.EAST_NORTH_SWAPPED, f"northing_m reaches {north:.5g}, and a latitude is at most 90")]
        return [*(swapped if north > 90.0 else []), (LogConvention.POSITION_DEGREES, why)]
    if LogConvention.POSITION_FEET.explains(share):
        speeds = [one for one in (log.speed_mps, log.speed_command_mps) if one is not None]
        shares = [path_length / max(_integrate_distance(log, one), 1e-9) for one in speeds]
        is_agreed = bool(shares) and all(map(LogConvention.POSITION_FEET.explains, shares))
        return [(LogConvention.POSITION_FEET, why)] if is_agreed else []
    return [(LogConvention.POSITION_KM, why)] if LogConvention.POSITION_KM.explains(share) else []


def _integrate_distance(log: Log, speed: Floats) -> float:
    """Return the distance (m) driven at the stated speed, without gaps."""
    rows = np.flatnonzero(log.used)
    is_same_segment = np.diff(log.segment[rows]) == 0
    return float(np.sum(np.where(is_same_segment, speed[rows][:-1] * np.diff(log.time_s[rows]), 0.0)))


def _check_speed(log: Log, *_: object) -> list[tuple[LogConvention, str]]:
    """Check for other units: 2 to 4 times is far more than slip can explain. Each column is compared with the path."""
    chords = compute_path_chords(log)
    if chords is None or float(np.mean(chords.speed)) < 0.1:
        return []
    suspicions, is_alike = [], True
    if log.speed_command_mps is not None and log.speed_mps is not None:
        # The command is in the unit of the measured speed; it may not be reached.
        command_mps, mean_mps = (float(np.mean(one[chords.row])) for one in (log.speed_command_mps, log.speed_mps))
        is_alike = _ALIKE_SHARES[0] <= command_mps / max(mean_mps, 1e-9) < _ALIKE_SHARES[1]
    for both, only_measured, only_command in SPEED_UNITS:
        measured = _explain_speed("speed_mps", log, chords, only_measured)
        command = _explain_speed("speed_command_mps", log, chords, only_command)
        if measured and is_alike:
            suspicions.append((both, measured))
        elif command:
            suspicions.append((both if log.speed_mps is None else only_command, command))
        elif measured:
            suspicions.append((only_measured, measured))
    return suspicions


def _explain_speed(name: str, log: Log, chords: PathChords, unit: LogConvention) -> str:
    """Why a column is in a unit, over all driving and the faster half; empty when it is not, and for a few seconds."""
    speed: Floats | None = getattr(log, name)
    if speed is None or float(np.ptp(log.time_s[log.used])) < SHORTEST_SEGMENT_S:
        return ""
    fast = chords.speed >= np.median(chords.speed)
    for part in (np.ones_like(fast), fast):
        stated, path = float(np.mean(speed[chords.row][part])), float(np.mean(chords.speed[part]))
        if not unit.explains(stated / path):
            return ""
    return f"{name} is {stated:.2f} while the positions move at {path:.2f} m/s"


def _check_heading_unit(log: Log, other_logs: Sequence[Log], *_: object) -> list[tuple[LogConvention, str]]:
    """Check for radians: they turn a 57th as far as the path, or they end at 6.3 in every log and agree with the path.
    Driving due east, radians look like degrees from east as well."""
    chords = compute_path_chords(log)
    if log.heading_deg is None or chords is None:
        return []
    logs = [one for one in (log, *other_logs) if one.heading_deg is not None]
    ratio = _measure_turn_ratio(logs)
    if ratio is not None and LogConvention.HEADING_RADIANS.explains(abs(ratio)):
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
    parts = [np.empty((2, 0))]
    for log in logs:
        chords = compute_path_chords(log)
        if log.heading_deg is None or chords is None:
            continue
        turns = np.degrees(np.diff(chords.course) + math.pi) % 360.0 - 180.0
        changes = np.diff(log.heading_deg[chords.row])
        near = (np.diff(log.segment[chords.row]) == 0) & (np.abs(turns) < 90.0)
        parts.append(np.stack([turns, changes])[:, near])
    turns, changes = np.concatenate(parts, axis=1)
    if np.count_nonzero(np.abs(changes) > _LARGEST_CHANGE_RAD) > (1.0 - ALMOST_ALL_SHARE) * len(changes):
        return None
    small = np.abs(changes) < _WRAP_RAD
    turns, changes = turns[small], changes[small]
    squares = float(turns @ turns)
    if squares < _LEAST_TURN_DEG2:
        return None
    ratio = float(turns @ changes) / squares
    # Chords overlap by half, so two count as one observation.
    error = math.sqrt(2.0 * float(np.mean((changes - ratio * turns) ** 2)) / squares)
    return ratio if abs(ratio) > SURE_SIGMAS * error else None


def _check_steering_unit(log: Log, _other: object, wheelbase_m: float | None) -> list[tuple[LogConvention, str]]:
    """Check for radians: as degrees they would need a wheelbase of centimetres to bend the path this much. Only changes
    of the angle count (the slope of curvature over angle), so no offset, slope or draft matters."""
    bends = compute_bends(log)
    largest = find_largest_steering(log)
    if bends is None or largest > LARGEST_RAD or len(bends[0]) < FEWEST_CHORDS:
        return []
    if float(np.std(bends[0])) < _LEAST_STEERING_SPREAD:
        return []
    angle, curvature = bends[:2]
    inliers, slope, error = np.ones(len(angle), dtype=np.bool_), 0.0, math.inf
    for _ in range(2):  # far outliers are excluded once
        if np.count_nonzero(inliers) < FEWEST_CHORDS or float(np.ptp(angle[inliers])) == 0.0:
            break
        slope, error = fit_chords(angle[inliers], curvature[inliers])
        left = (curvature - curvature[inliers].mean()) - slope * (angle - angle[inliers].mean())
        inliers = np.abs(left) <= 4.0 * measure_spread(left) + 1e-12
    least_slope = abs(slope) - SURE_SIGMAS * error
    limit = SMALLEST_WHEELBASE_M if wheelbase_m is None else wheelbase_m / 8.0
    if least_slope <= 0.0 or math.radians(1.0) / least_slope > limit:
        return []
    wheelbase_cm = 100.0 * math.radians(1.0) / abs(slope)
    why = f"no angle exceeds {largest:.2f}, and in degrees they would need a wheelbase of {wheelbase_cm:.1f} cm"
    return [(LogConvention.STEERING_RADIANS, why)]


def _check_implement(log: Log) -> list[Suspicion]:
    """Check for rows driven with the implement up and headland turns with it down."""
    chords = compute_path_chords(log)
    if chords is None:
        return []
    curvature = np.abs(chords.curvature)
    kind = np.where(curvature > BEND_PER_M, 1, np.where(curvature < _ROW_PER_M, 0, -1))
    kind, working = kind[kind >= 0], log.implement[chords.row][kind >= 0] > 0.5
    if np.count_nonzero(np.diff(kind) > 0) < FEWEST_TIMES or np.count_nonzero(np.diff(kind) < 0) < FEWEST_TIMES - 1:
        return []
    turns, rows = float(np.mean(working[kind == 1])), 1.0 - float(np.mean(working[kind == 0]))
    if min(turns, rows) < STEADY_SHARE:
        return []
    why = f"it is 1 in {100.0 * turns:.0f} % of the turns and 0 on {100.0 * rows:.0f} % of the straight rows between"
    return [Suspicion(LogConvention.IMPLEMENT_REVERSED, why)]


# --- steering columns under each other's names: wheels move towards their command, at the rate of a valve; commands
# jump, and do not wait for the wheels. A clock that is wrong shifts one of them and makes neither of them jump.


def find_swapped_steering(log: Log) -> str | None:
    """Return how the two steering columns show that each has the name of the other; None where they do not."""
    if log.steering_deg is None or log.steering_command_deg is None or log.rows_used < FEWEST_EVENTS:
        return None
    wheel_follows = _measure_following(log, log.steering_deg, log.steering_command_deg)
    command_follows = _measure_following(log, log.steering_command_deg, log.steering_deg)
    if wheel_follows is None or command_follows is None:
        return None
    rows = np.flatnonzero(log.used)
    step_s = np.maximum(np.diff(log.time_s[rows]), 0.5 * log.step_s)
    # The mean rates (deg/s) of the steepest rows.
    steepness = [float(np.mean(np.sort(np.abs(np.diff(values[rows])) / step_s)[-_STEEPEST_ROWS:]))
                 for values in (log.steering_deg, log.steering_command_deg)]  # fmt: skip
    follows = command_follows > max(_FOLLOWS, wheel_follows + _FOLLOWS_MORE)
    if not follows or steepness[0] < _STEEPER * steepness[1]:
        return None
    return (
        f"steering_command_deg moves towards steering_deg at up to {steepness[1]:.0f} deg/s, and steering_deg jumps "
        "without following it"
    )


def _measure_following(log: Log, follower: Floats, leader: Floats) -> float | None:
    """Return the correlation of the movement of a column with how far the other one is ahead; None without gaps."""
    rows = np.flatnonzero(log.used)
    ahead = max(round(_AHEAD_S / log.step_s), 1)
    start, end = rows[:-ahead], rows[ahead:]
    near = (log.segment[start] == log.segment[end]) & (log.time_s[end] - log.time_s[start] < 2.0 * ahead * log.step_s)
    if np.count_nonzero(near) < FEWEST_EVENTS:
        return None
    start, end = start[near], end[near]
    gap, movement = leader[start] - follower[start], follower[end] - follower[start]
    # An offset of the sensor is no gap.
    gap = gap - np.median(gap)
    clear = np.abs(gap) > _GAP_DEG
    if np.count_nonzero(clear) < FEWEST_EVENTS:
        return None
    squares = float(gap[clear] @ gap[clear]) * float(movement[clear] @ movement[clear])
    return float(gap[clear] @ movement[clear]) / math.sqrt(squares) if squares > 0.0 else 0.0
