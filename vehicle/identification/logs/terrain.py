"""The slope of the ground from roll and pitch sensors, or from known heights; a reason where it cannot be measured.

Such a sensor shows the ground, its mounting, and the lean of the tractor where it turns or speeds up. Mounting and lean
are the same everywhere, while the ground changes its sign when driven there and back. They are separated over all logs
of a tractor together, with the ground as a smooth height over the field. Pitch explains speed uphill and downhill, roll
the slope across the direction of travel.

Where the heights of the ground are known, the fall under every row stands in for a sensor that the logs lack. It has no
mounting and no lean, and what it leaves of the drift and of the speeds is said.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
from vehicle.identification.logs.motion import compute_path_chords, measure_steady_time_s
from vehicle.identification.logs.readings import LogConvention, format_fix_option
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.thresholds import (
    ALIKE_SHARE,
    CLEAR_SIGMAS,
    FEW_SHARE,
    FEWEST_PARTS,
    MAJORITY,
    MEASURED_SIGMAS,
    MOVING_MPS,
    NEARLY_SHARE,
    PART_S,
    STEEPEST_DEG,
    STRAIGHT_PER_M,
)

SMOOTHING_WIDTHS_S = (0.3, 0.6, 1.0, 1.6, 2.5, 4.0)  # smoothing: a tractor drives its own length in 2 to 4 s
_LEAST_SLOPE = 0.004  # root mean square: less changes no drive visibly
# Expected size of mounting (slope), lean (slope per m/s2: an accelerometer shows 1 / g) and ground (slope).
_EXPECTED_SENSOR, _EXPECTED_GROUND = 0.1, 0.15
STEADY_COMMAND_S = 4.0  # after a change of the command: all speeds have reached 99 % of it
_LEAST_GAIN = FEW_SHARE  # of the speed per slope: less is a centimetre per second on a slope of 10 %
_COMPASS_ERROR_RAD = 0.004  # a quarter of a degree, the drift of a heading from run to run
_LEAST_DRIFT = 0.03  # m/m per slope; tyres give way by about a tenth of the slope, soil by more
_OTHER_PLACE = "so heights or positions are of another place or in another coordinate system"


@dataclass(frozen=True, eq=False)
class GroundFall:
    """Used rows of all logs, concatenated: the fall of the ground in one direction, and related values.

    `fall` (m/m) is positive where the ground falls to the right (from roll, positive with the right side lower) or
    ahead (from pitch, positive nose up). `heading` is in rad, clockwise from north; `block` numbers pieces of PART_S.
    `rms_fall` is the root mean square of the fall; `mounting_deg` was subtracted from the sensor.
    """

    fall: Floats
    heading: Floats
    block: Floats
    rms_fall: float
    mounting_deg: float


def measure_ground_fall(logs: Sequence[Log], column: str) -> GroundFall | str:
    """Return the fall of the ground from `roll_deg` or `pitch_deg` (where a log lacks it, of ground known under all),
    or a clause why it cannot be measured."""
    if get_ground_source(logs, column):
        return _project_known_fall(logs, column)
    logs_with_column = [log for log in logs if getattr(log, column) is not None]
    if len(logs_with_column) < len(logs):
        return f"it is logged in {len(logs_with_column)} of {len(logs)} logs only"
    if any(log.heading_deg is None for log in logs):
        return "it also needs heading_deg"
    shown_falls = [_compute_shown_fall(log, column) for log in logs]
    if all(np.ptp(shown) == 0.0 for shown in shown_falls):
        return "it is constant, so the sensor is off or the ground is flat"
    width, noise = _select_width(logs, shown_falls)
    shown = np.concatenate([smooth_values(log, own, width) for log, own in zip(logs, shown_falls, strict=True)])
    heading, block = _list_directions(logs)
    push = np.concatenate([_measure_push(log, column) for log in logs])
    east = np.concatenate([log.easting_m[log.used] for log in logs])
    north = np.concatenate([log.northing_m[log.used] for log in logs])
    aside = 0.5 * math.pi if column == "roll_deg" else 0.0
    direction = heading + aside
    # The fall in the direction of travel where the height is a polynomial of the place, per coefficient (n, 9).
    size = max(float(np.std(east)), float(np.std(north)), 1.0)
    east, north = ((axis - float(np.mean(axis))) / size for axis in (east, north))
    to_east, to_north = np.sin(direction), np.cos(direction)
    ground = []
    for degree in (1, 2, 3):
        for p in range(degree + 1):
            q = degree - p
            along = p * east ** max(p - 1, 0) * north**q * to_east + q * east**p * north ** max(q - 1, 0) * to_north
            ground.append(along / degree)
    mounting_lean = _estimate_mounting(shown, push, np.stack(ground, axis=1), block)
    if mounting_lean is None:
        return "the drives cannot separate the ground from the mounting of the sensor; driving there and back would"
    mounting, lean = mounting_lean
    fall = shown - mounting - lean * push
    rms_fall = float(np.sqrt(np.mean(fall**2)))
    if rms_fall < _LEAST_SLOPE or noise > (1.0 - NEARLY_SHARE) * rms_fall**2:
        return "it shows no slope above its noise, so the ground is flat or the sensor is off"
    degrees = math.degrees(math.atan(mounting)) * (1.0 if column == "roll_deg" else -1.0)
    return GroundFall(fall, direction - aside, block, rms_fall, degrees)


def _list_directions(logs: Sequence[Log]) -> tuple[Floats, Floats]:
    """Return heading (rad, clockwise from north) and piece of PART_S of the used rows of all logs."""
    parts = []
    for number, log in enumerate(logs):
        assert log.heading_deg is not None
        time = log.time_s[log.used]
        block = np.floor((time - time[0]) / PART_S) + 1e6 * number
        parts.append(np.stack([np.unwrap(np.radians(log.heading_deg[log.used])), block]))
    heading, block = np.concatenate(parts, axis=1)
    return heading, block


def _measure_push(log: Log, column: str) -> Floats:
    """Return the acceleration (m/s2) of the used rows to the right (`roll_deg`) or ahead, which leans the tractor."""
    assert log.heading_deg is not None
    time, used = log.time_s[log.used], log.used
    speed = np.hypot(*(np.gradient(axis[used], time) for axis in (log.easting_m, log.northing_m)))
    pace = smooth_values(log, speed, 1.0) * np.where(log.shuttle[used] < 0.0, -1.0, 1.0)
    if column == "pitch_deg":
        return np.asarray(np.gradient(pace, time))
    heading = smooth_values(log, np.unwrap(np.radians(log.heading_deg[used])), 1.0)
    return np.asarray(pace * np.gradient(heading, time))


def get_ground_source(logs: Sequence[Log], column: str) -> str:
    """Return where the known ground under all logs comes from, in place of a column; empty where the column is used."""
    is_used = any(log.ground_fall is None for log in logs) or all(getattr(log, column) is not None for log in logs)
    return "" if is_used else logs[0].ground_source


def _project_known_fall(logs: Sequence[Log], column: str) -> GroundFall | str:
    """Return the known fall of the ground to the right (`roll_deg`) or ahead (`pitch_deg`) in the used rows."""
    if any(log.heading_deg is None for log in logs):
        return "heading_deg is not in all logs"
    heading, block = _list_directions(logs)
    to_east, to_north = np.sin(heading), np.cos(heading)
    if column == "roll_deg":
        to_east, to_north = to_north, -to_east
    east, north = np.concatenate([log.ground_fall[log.used] for log in logs if log.ground_fall is not None]).T
    fall = east * to_east + north * to_north
    rms_fall = float(np.sqrt(np.mean(fall**2)))
    if rms_fall < _LEAST_SLOPE:
        return "the ground is flat there"
    return GroundFall(fall, heading, block, rms_fall, 0.0)


def split_per_log(logs: Sequence[Log], values: Floats) -> tuple[Floats, ...]:
    """Split values of the used rows into one array per log with all its rows, 0 in unused rows."""
    parts = tuple(np.zeros(len(log.used)) for log in logs)
    ends = np.cumsum([log.rows_used for log in logs])
    for log, part, own in zip(logs, parts, np.split(values, ends[:-1]), strict=True):
        part[log.used] = own
    return parts


def _compute_shown_fall(log: Log, column: str) -> Floats:
    """Return the fall shown by the sensor in the used rows, interpolated where it is missing or impossible."""
    angle, time = getattr(log, column)[log.used], log.time_s[log.used]
    is_possible = np.abs(angle) <= STEEPEST_DEG
    if not is_possible.any():
        return np.zeros(len(angle))
    out: Floats = np.tan(np.radians(np.interp(time, time[is_possible], angle[is_possible])))
    return out if column == "roll_deg" else -out


def smooth_values(log: Log, values: Floats, width_s: float) -> Floats:
    """Return the mean over `width_s` around every row of its own segment."""
    return _compute_moving_means(log, values, width_s)[0]


def _compute_moving_means(log: Log, values: Floats, width_s: float) -> tuple[Floats, Floats]:
    """Return the mean over `width_s` around every row of its own segment, and the number of rows in it."""
    out, count = np.empty_like(values), np.ones(len(values))
    segment, time = log.segment[log.used], log.time_s[log.used]
    for number in range(log.segment_count):
        is_segment = segment == number
        segment_time, total = time[is_segment], np.concatenate([[0.0], np.cumsum(values[is_segment])])
        first = np.searchsorted(segment_time, segment_time - 0.5 * width_s - 1e-9)
        end = np.searchsorted(segment_time, segment_time + 0.5 * width_s + 1e-9)
        count[is_segment] = end - first
        out[is_segment] = (total[end] - total[first]) / count[is_segment]
    return out, count


def _select_width(logs: Sequence[Log], shown_falls: Sequence[Floats]) -> tuple[float, float]:
    """Return the width (s) whose means best predict left-out rows, and the variance of the remaining noise."""
    best = (np.inf, 0.0, 0.0)
    for width in SMOOTHING_WIDTHS_S:
        squared_error, rows, shares = 0.0, 0, 0.0
        for log, values in zip(logs, shown_falls, strict=True):
            mean, count = _compute_moving_means(log, values, width)
            apart, count = (values - mean)[count > 1.0], count[count > 1.0]
            # A row's own share of its mean is 1 / count: without it the error is count / (count - 1) times as large.
            squared_error += float(np.sum((apart * count / (count - 1.0)) ** 2))
            rows, shares = rows + len(count), shares + float(np.sum(1.0 / count))
        if rows and squared_error / rows < best[0]:
            share = shares / rows
            best = (squared_error / rows, width, squared_error / rows * share / (1.0 + share))
    return best[1], best[2]


def _estimate_mounting(shown: Floats, push: Floats, ground: Floats, block: Floats) -> tuple[float, float] | None:
    """Estimate mounting (slope) and lean (slope per m/s2) of a sensor that shows a fall (n,) pushed by an acceleration
    (n,), on a ground of columns (n, 9); None where the drives do not show the mounting well.

    Least squares with prior sizes: an amount that the drives do not show stays as uncertain as before.
    """
    columns = np.concatenate([np.ones((len(shown), 1)), push[:, None], ground], axis=1)
    spread = np.concatenate([[_EXPECTED_SENSOR, _EXPECTED_SENSOR], np.full(columns.shape[1] - 2, _EXPECTED_GROUND)])
    blocks, noise = len(np.unique(block)), float(np.var(shown))
    for _ in range(3):
        weight = blocks / (len(shown) * max(noise, 1e-8))
        square = weight * columns.T @ columns + np.diag(1.0 / spread**2)
        coefficients = np.linalg.solve(square, weight * columns.T @ shown)
        noise = float(np.mean((shown - columns @ coefficients) ** 2))
    error = np.sqrt(np.diag(np.linalg.inv(square)))
    slope = float(np.sqrt(np.mean((shown - coefficients[0] - coefficients[1] * push) ** 2)))
    if error[0] > max(ALIKE_SHARE * slope, _LEAST_SLOPE):
        return None
    return float(coefficients[0]), float(coefficients[1]) if abs(coefficients[1]) > MEASURED_SIGMAS * error[1] else 0.0


def estimate_grade_speed(logs: Sequence[Log]) -> tuple[tuple[Floats, ...], tuple[str, ...]]:
    """Return the share of the commanded speed that is driven on the grade, per row of each log, by pitch or the known
    ground, and sentences; no share where they do not explain the speeds of all logs or one of them is missing."""
    source = get_ground_source(logs, "pitch_deg")
    if all(log.pitch_deg is None for log in logs) and not source:
        return (), ()

    def leave_unused(why: str) -> tuple[tuple[Floats, ...], tuple[str, ...]]:
        return (), (f"{f'{source} do not explain speed' if source else 'pitch_deg is not used'}: {why}.",)

    if any(log.speed_mps is None or log.speed_command_mps is None for log in logs):
        needed = "it also needs speed_mps and speed_command_mps"
        return leave_unused("speed_mps or speed_command_mps is missing" if source else needed)
    ground_fall = measure_ground_fall(logs, "pitch_deg")
    if isinstance(ground_fall, str):
        return leave_unused(ground_fall)
    # In reverse the tractor drives downhill where the ground rises ahead.
    forward_fall = ground_fall.fall * np.concatenate([np.where(log.shuttle[log.used] < 0.0, -1.0, 1.0) for log in logs])
    gain, error, spread, left = _estimate_grade_gain(logs, ground_fall, forward_fall)
    least = max(_LEAST_GAIN, MEASURED_SIGMAS * error)
    if gain < -least:
        sensor_clause = "the tractor is faster where it says uphill, so it seems to be positive with the nose down"
        return leave_unused(f"the tractor is faster where they say uphill, {_OTHER_PLACE}" if source else sensor_clause)
    if gain < least:
        return leave_unused(f"the speed does not depend on {'them' if source else 'it'}")
    remark = (
        f"{f'{source} explain' if source else 'pitch_deg explains'} speed: on a slope of 10 % the tractor drives "
        f"{10.0 * gain:.1f} % slower uphill and faster downhill than commanded. Commanded speeds were corrected for it"
    )
    remark += (
        f"; over {PART_S:g} s speeds then differ from them by {100.0 * left:.1f} % instead of {100.0 * spread:.1f} % "
        "(root mean square)."
        if source
        else f"; the mounting of the sensor ({ground_fall.mounting_deg:+.1f} degrees) was subtracted."
    )
    # Half of the speed is a limit, so that no outlier stops a tractor.
    share = 1.0 + np.clip(gain * forward_fall, -MAJORITY, MAJORITY)
    return split_per_log(logs, share), (remark,)


def _estimate_grade_gain(
    logs: Sequence[Log], ground_fall: GroundFall, forward_fall: Floats
) -> tuple[float, float, float, float]:
    """Return the share of speed gained per fall and its standard error, from rows under a constant command.

    Slip, in general and of the implement, is estimated separately. The last two values are the root mean squares, over
    blocks, of what is left of the share of speed without the gain and with it.
    """
    speed, command, implement = (
        np.concatenate([getattr(log, name)[log.used] for log in logs])
        for name in ("speed_mps", "speed_command_mps", "implement")
    )
    steady_s = np.concatenate([measure_steady_time_s(log)[log.used] for log in logs])
    use = (steady_s >= STEADY_COMMAND_S) & (command > MOVING_MPS)
    ratio, fall, block, implement = speed[use] / command[use], forward_fall[use], ground_fall.block[use], implement[use]
    columns = np.stack([fall, np.ones(len(fall)), implement], axis=1)
    if implement.size and np.ptp(implement) == 0.0:
        columns = columns[:, :2]
    if len(np.unique(block)) < FEWEST_PARTS or np.ptp(fall) == 0.0:
        return 0.0, np.inf, 0.0, 0.0
    coefficients, error = _fit_by_blocks(columns, ratio, block)
    level = columns[:, 1:] @ np.linalg.lstsq(columns[:, 1:], ratio, rcond=None)[0]
    spread, left = (_compute_block_rms(values, block) for values in (ratio - level, ratio - columns @ coefficients))
    return float(coefficients[0]), error, spread, left


def _fit_by_blocks(columns: Floats, values: Floats, block: Floats) -> tuple[Floats, float]:
    """Fit values (k,) by columns (k, m); return the coefficients, and the standard error of the first of them where the
    rows of a block are one observation."""
    coefficients = np.asarray(np.linalg.lstsq(columns, values, rcond=None)[0], dtype=np.float64)
    inverse = np.linalg.pinv(columns.T @ columns)
    scores = columns * (values - columns @ coefficients)[:, None]
    sums = np.stack([scores[block == number].sum(axis=0) for number in np.unique(block)])
    return coefficients, float(np.sqrt((inverse @ (sums.T @ sums) @ inverse)[0, 0]))


def _compute_block_rms(values: Floats, block: Floats) -> float:
    """Return the root mean square of the means over blocks."""
    owners = np.unique(block, return_inverse=True)[1]
    means = np.bincount(owners, values) / np.bincount(owners)
    return float(np.sqrt(np.mean(means**2)))


@dataclass(frozen=True, eq=False)
class CrossSlope:
    """Slope of the ground to the right (m/m, positive with the right side lower) per row of each log, in the logs'
    order; empty where it cannot be used.

    `east`, `north` are the mean fall of the ground per metre in those directions, `rms_slope` the root mean square of
    the slope across the direction of travel. `remarks` are sentences.
    """

    across: tuple[Floats, ...] = ()
    east: float = 0.0
    north: float = 0.0
    rms_slope: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def mean_plane(self) -> tuple[float, float, float]:
        """The mean fall (m/m), the bearing it falls to (deg, clockwise from north) and the root mean square slope
        across."""
        bearing = float(np.degrees(np.arctan2(self.east, self.north))) % 360.0
        return float(np.hypot(self.east, self.north)), bearing, self.rms_slope


def estimate_cross_slope(logs: Sequence[Log]) -> CrossSlope:
    """Estimate the slope across the direction of travel, from roll or the known ground; without, only a remark."""
    source = get_ground_source(logs, "roll_deg")
    if all(log.roll_deg is None for log in logs) and not source:
        return CrossSlope()

    def leave_unused(why: str) -> CrossSlope:
        unused = f"{source} do not explain drift" if source else "roll_deg is not used"
        return CrossSlope(remarks=(f"{unused}: {why}. The ground is taken as a plane.",))

    ground_fall = measure_ground_fall(logs, "roll_deg")
    if isinstance(ground_fall, str):
        return leave_unused(ground_fall)
    drift, error, spread, left = _estimate_drift(logs, ground_fall)
    if drift < -max(_LEAST_DRIFT, CLEAR_SIGMAS * error):
        sensor_clause = (
            "it grows where the tractor drifts to the left, and no tractor drifts uphill; if it is positive with the "
            f"left side lower, give {format_fix_option(LogConvention.ROLL_LEFT)}"
        )
        ground_clause = f"the tractor drifts uphill on them, and no tractor does, {_OTHER_PLACE}"
        return leave_unused(ground_clause if source else sensor_clause)
    remark = (
        f"{source or 'roll_deg'} {'give' if source else 'gives'} the slope across the direction of travel, "
        f"{100.0 * ground_fall.rms_fall:.1f} % (root mean square)"
    )
    if not source:
        remark += f"; its mounting ({ground_fall.mounting_deg:+.1f} degrees) and the lean in bends were subtracted."
    elif not drift > CLEAR_SIGMAS * error:
        remark += "; how far the tractor drifts on straight drives does not depend on it."
    else:
        remark += (
            f". On straight drives the tractor drifts {10.0 * drift:.1f} cm downhill per metre across a slope of 10 %; "
            f"this leaves {math.degrees(left):.2f} of the {math.degrees(spread):.2f} degrees by which course and "
            f"heading differ over {PART_S:g} s (root mean square)."
        )
    sides = np.stack([np.cos(ground_fall.heading), -np.sin(ground_fall.heading)], axis=1)
    east, north = np.linalg.lstsq(sides, ground_fall.fall, rcond=None)[0]
    across = split_per_log(logs, ground_fall.fall)
    return CrossSlope(across, float(east), float(north), ground_fall.rms_fall, (remark,))


def _estimate_drift(logs: Sequence[Log], ground_fall: GroundFall) -> tuple[float, float, float, float]:
    """Return the drift to the right per metre and slope, and its standard error, from course and heading on straight
    chords.

    The last two values are the root mean squares, over blocks, of course minus heading (rad) without it and with it.
    """
    columns = (ground_fall.fall, ground_fall.heading, ground_fall.block)
    parts = []
    for log, *own in zip(logs, *(split_per_log(logs, values) for values in columns), strict=True):
        chords = compute_path_chords(log)
        if chords is not None:
            slope, heading, block = (values[chords.row] for values in own)
            use = (np.abs(chords.curvature) < STRAIGHT_PER_M) & (log.shuttle[chords.row] > 0.0) & (chords.speed > 0.3)
            crab = chords.course - heading
            wrapped = np.arctan2(np.sin(crab), np.cos(crab))
            parts.append(np.stack([slope, wrapped, block, chords.curvature])[:, use])
    x, y, block, curvature = np.concatenate([np.zeros((4, 0)), *parts], axis=1)
    x, y = x - (x.mean() if len(x) else 0.0), y - (np.median(y) if len(y) else 0.0)
    if len(np.unique(block)) < FEWEST_PARTS or float(x @ x) == 0.0:
        return 0.0, np.inf, 0.0, 0.0
    (drift, _), error = _fit_by_blocks(np.stack([x, np.ones(len(x))], axis=1), y, block)
    compass = _COMPASS_ERROR_RAD / (np.sqrt(len(parts)) * float(np.std(x)))
    # What follows from slight bends, where the antenna is off the rear axle, does not count.
    bent = np.stack([np.ones(len(y)), curvature], axis=1)
    before, left = (
        _compute_block_rms(values - bent @ np.linalg.lstsq(bent, values, rcond=None)[0], block)
        for values in (y, y - drift * x)
    )
    return float(drift), math.hypot(error, compass), before, left
