"""How the vehicle of the logs turns: by front wheels as the model does, by rear wheels, or by a joint in its middle.

A vehicle with one steered axle of any kind turns with the angle of its wheels alone: v tan(angle) / base, about an axle
that does not move sideways. A jointed one turns its front unit by (v sin(angle) + r * rate) / (f cos(angle) + r), f and
r from the joint to the axles, and its rear unit by that minus the rate of the joint (Corke and Ridley, Steering
kinematics for a center-articulated mobile robot, IEEE Trans. Robotics and Automation 17(2), 2001): its heading changes
with the angle itself, by r / (f + r) or -f / (f + r), at any speed and at rest. A delay of any instrument changes it in
proportion to the speed.

A compass that is wrong by the direction it points to looks like a drift across a slope: positions leave the headings
by the same angles. But headings of such a compass turn more, or less, than the wheels turn the vehicle.

The antenna's sideways speed is its distance ahead of the axle that does not move sideways times the rate of turning.
Where rear wheels steer, that is the front axle, a wheelbase further ahead than the model has it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.faults.run_regression import thin_rows
from vehicle.identification.faults.steering_evidence import (
    STEP_S,
    SteeringEvidence,
    build_evidence_segments,
    find_largest_angles,
    follow_command,
)
from vehicle.identification.logs.schema import Array, Log, Rows
from vehicle.jit import compile_function
from vehicle.model.effects import CATALOGUE, PATH, POSITION, STEERING
from vehicle.model.tractor import Tractor

ARTICULATED, REAR_STEERED = "articulated", "rear_steered"
# Chosen: 142 sets of two references without a joint show at most 0.04 rad per rad, and 2 errors where one speed shows
# little; joints show 0.35 to 0.65.
_LEAST_JOINT_SHARE, _MOST_JOINT_SHARE, _CLEAR_SIGMAS = 0.2, 0.85, 6.0
_LEAST_JOINT_GAIN = 1.15  # chosen: sets without a joint gain 1 %, those of the third reference with one 40 to 50 %
# Chosen: in so many wheelbases the path forgets the change of an angle.
_MOST_WHEELBASES = 3.0
# Chosen, of the wheelbase: how near the still axle is to the front axle of the file, and how well that is known.
_NEAR_SHARE, KNOWN_SHARE = 0.15, 0.1
# Chosen, of how far the antenna is ahead: so near to an axle that does not move sideways headings may be its course.
_STILL_SHARE = 0.2
_WINDOW_S, _THIN_S = 1.0, 0.3  # over which changes are taken, and between them
_FEWEST_ROWS, _MOST_ROWS = 100, 10_000  # more show the same
_LEAST_MOVED_DEG = 40.0  # chosen: the root of the sum of squared changes of the angle that show how heading follows
_MOST_HOLD_S = 0.5  # chosen: steering columns that change more rarely do not show when the angle moved
_PASSES, _OUTLIER_SIGMAS = 4, 4.0
# Chosen, m: drawbars of drawn implements, which push the tractor until they have swung out behind it.
_TRAILS_M = (2.5, 6.0)
# Of the angle that the heading follows: later or earlier by clocks, and low-passed by tyres.
_SHIFTS_S = tuple(0.1 * step for step in range(-6, 11))
_FILTERS_S = (0.0, 0.2, 0.4)
# Where only commands are logged: late (s), rate (deg/s) and lag (s) of the steering.
_LATES_S, _RATES_DEG_PER_S, _LAGS_S = (0.0, 0.15, 0.3, 0.5), (6.0, 10.0, 16.0, 30.0), (0.1, 0.3, 0.6)


@dataclass(frozen=True)
class OtherTurning:
    """A vehicle that turns in another way than the model: ARTICULATED or REAR_STEERED, a sentence, and effects that
    only stand in for that in these logs."""

    kind: str
    words: str
    faked_ids: frozenset[str]


@dataclass(frozen=True)
class TurningMeasure:
    """What logs show, with standard errors; None where they do not show it.

    `joint_share` is the turn of the heading per change of the angle (rad/rad), `joint_gain` how much smaller it makes
    the mean squared error of turns, `antenna_m` how far the antenna is ahead of the axle that does not move sideways.
    """

    joint_share: float | None
    joint_error: float
    joint_gain: float
    antenna_m: float | None
    antenna_error_m: float
    pace_mps: float


@dataclass(frozen=True, eq=False)
class _Rows:
    """Changes over _WINDOW_S about the `chosen` rows (k,) of a segment: heading (rad), path sideways and ahead (m).

    `pace` (m/s, negative in reverse) has a value per row of the grid, `ends` (2, k) are the headings (rad) before and
    after.
    """

    part: SteeringEvidence
    pace: Array
    chosen: Rows
    turn: Array
    aside: Array
    ahead: Array
    ends: Array


def find_other_turning(logs: Sequence[Log], tractor: Tractor) -> OtherTurning | None:
    """Return how the vehicle of the logs turns; None where it turns by its front wheels, or the logs do not show it."""
    measure, base = measure_turning(logs), tractor.wheelbase_m
    share, antenna = measure.joint_share, measure.antenna_m
    if not measure.pace_mps * _WINDOW_S < _MOST_WHEELBASES * base:
        return None
    if (
        share is not None
        and max(_LEAST_JOINT_SHARE, _CLEAR_SIGMAS * measure.joint_error) < abs(share) < _MOST_JOINT_SHARE
        and measure.joint_gain > _LEAST_JOINT_GAIN
    ):
        words = (
            "These logs look like a vehicle that bends in its middle (articulated): its heading changes by "
            f"{abs(share):.2f} degrees per degree of the steering angle at any speed; the model steers its front "
            "wheels, so causes between the wheels and the positions are not named."
        )
        if antenna is not None and abs(antenna) < _STILL_SHARE * tractor.antenna_forward_m:
            words += " If it does not bend, heading_deg is the course of the antenna: leave that column out."
        return OtherTurning(ARTICULATED, words, _list_faked_by_joint(logs))
    if antenna is None or measure.antenna_error_m > KNOWN_SHARE * base:
        return None
    further_m = antenna - tractor.antenna_forward_m
    if abs(further_m + base) > _NEAR_SHARE * base:
        return None
    words = (
        "These logs look like a vehicle that steers its rear wheels: the axle that does not move sideways is "
        f"{-further_m:.1f} m further ahead than the rear axle of the tractor file, where its front axle is; the model "
        "steers its front wheels, so neither the place of the antenna nor a delay of the positions is named. If the "
        f"front wheels steer, the antenna is {-further_m:.1f} m further back than the file says."
    )
    return OtherTurning(REAR_STEERED, words, _FAKED_BY_REAR_WHEELS)


_FAKED_BY_REAR_WHEELS = frozenset(
    {"antenna_forward", "gnss_latency", "position_delay", "heading_delay", "heading_filter", "clock_offset_position",
     "clock_offset_heading"}
)  # fmt: skip


def _list_faked_by_joint(logs: Sequence[Log]) -> frozenset[str]:
    """Return the effects between wheels and positions; without a wheel angle also those between command and wheels."""
    blocks = {PATH, POSITION}
    if any(log.steering_deg is None for log in logs):
        blocks.add(STEERING)
    return frozenset(effect.id for effect in CATALOGUE if effect.block in blocks or effect.is_of_log_alone)


def measure_turning(logs: Sequence[Log]) -> TurningMeasure:
    """Measure how heading and antenna follow the wheel angle, in logs with a heading; nothing is known without one."""
    rows = _collect_rows(logs)
    if sum(len(one.turn) for one in rows) < _FEWEST_ROWS:
        return TurningMeasure(None, math.inf, 1.0, None, math.inf, 0.0)
    pace_mps = float(np.median(np.abs(np.concatenate([one.ahead for one in rows])))) / _WINDOW_S
    return TurningMeasure(*_fit_joint(rows), *_fit_antenna(rows), pace_mps)


def _collect_rows(logs: Sequence[Log]) -> list[_Rows]:
    locks = find_largest_angles(logs)
    parts = [
        (log, part)
        for log in logs
        if log.heading_deg is not None
        for part in build_evidence_segments(log, locks)
        if part.hold_s <= _MOST_HOLD_S
    ]
    seconds = sum(float(np.ptp(part.time_s)) for _, part in parts)
    stride = max(math.ceil(seconds / _THIN_S / _MOST_ROWS), 1)
    return _choose_rows([built for log, part in parts if (built := _build_rows(log, part, stride)) is not None])


def measure_compass_share(logs: Sequence[Log], ratio: float, bearing_deg: float) -> tuple[float, float]:
    """Return how much of a drift is in the headings, and its standard error (infinite where logs do not show it).

    1 is a compass that points `ratio` (rad) too far to the side of `bearing_deg`, as far as a drift of `ratio` metres
    per metre driven across that bearing seems to leave the headings; 0 is a drift.
    """
    rows = _collect_rows(logs)
    if sum(len(one.turn) for one in rows) < _FEWEST_ROWS:
        return 0.0, math.inf
    sensed = all(one.part.wheel is not None for one in rows)
    turn = np.concatenate([one.turn for one in rows])
    swings = np.concatenate([np.column_stack(_list_swings(one, ratio, math.radians(bearing_deg))) for one in rows])
    best: tuple[float, float, float] | None = None
    for steering in _list_steerings(sensed):
        turned = np.concatenate([_list_columns(one, _find_angle(one.part, sensed, *steering)) for one in rows])
        value, error, loss = fit_robustly(np.column_stack([swings, turned]), turn)
        if best is None or loss < best[0]:
            best = loss, float(value[0]), float(error[0])
    assert best is not None
    return best[1], best[2]


def _list_swings(rows: _Rows, ratio: float, bearing: float) -> tuple[Array, Array, Array]:
    """Return how a compass turns by itself in windows (k,), and what a push to two sides of the ground may turn."""
    before, after = np.sin(rows.ends - bearing)
    along = rows.ends.mean(axis=0) - bearing
    return ratio * (after - before), rows.ahead * np.sin(along), rows.ahead * np.cos(along)


def _list_steerings(sensed: bool) -> list[tuple[float, float, float]]:
    """Return how the angle that turns the vehicle may follow the one that was logged; see _find_angle."""
    if sensed:
        return [(shift, math.inf, filter_s) for shift, filter_s in itertools.product(_SHIFTS_S, _FILTERS_S)]
    return list(itertools.product(_LATES_S, _RATES_DEG_PER_S, _LAGS_S))


def _choose_rows(rows: Sequence[_Rows]) -> list[_Rows]:
    """Return the segments with a wheel angle, or those with a command where these are more."""
    sensed = [one for one in rows if one.part.wheel is not None]
    commanded = [one for one in rows if one.part.command is not None]
    return sensed if len(sensed) >= len(commanded) else commanded


def _build_rows(log: Log, part: SteeringEvidence, stride: int) -> _Rows | None:
    reach = round(0.5 * _WINDOW_S / STEP_S)
    if len(part.time_s) < 4 * reach:
        return None
    used = np.flatnonzero(log.used)
    time = log.time_s[used]
    assert log.heading_deg is not None
    heading = np.interp(part.time_s, time, np.unwrap(np.radians(log.heading_deg[used])))
    east, north = (np.interp(part.time_s, time, axis[used]) for axis in (log.easting_m, log.northing_m))
    inside = np.zeros(len(part.time_s), dtype=np.bool_)
    inside[2 * reach : -2 * reach] = True
    chosen = thin_rows(inside, _THIN_S)
    turn = heading[chosen + reach] - heading[chosen - reach]
    step = np.array([axis[chosen + reach] - axis[chosen - reach] for axis in (east, north)])
    # The mean of the headings in a window, as its middle one has all the noise of one row.
    mean = np.mean([heading[chosen + shift] for shift in range(-reach, reach + 1)], axis=0)
    ahead = step[0] * np.sin(mean) + step[1] * np.cos(mean)
    aside = step[0] * np.cos(mean) - step[1] * np.sin(mean)
    pace = np.interp(part.time_s, part.time_s[chosen], ahead / _WINDOW_S)
    ends = np.array([heading[chosen - reach], heading[chosen + reach]])
    columns = (turn, aside, ahead, ends)
    return _Rows(part, pace, chosen[::stride], *(column[..., ::stride] for column in columns))


def _fit_joint(rows: Sequence[_Rows]) -> tuple[float | None, float, float]:
    """Return the turn per change of the angle under the steering that leaves least, its standard error, and by how much
    more any steering leaves without it."""
    sensed = all(one.part.wheel is not None for one in rows)
    best, least, least_without = None, math.inf, math.inf
    turn = np.concatenate([one.turn for one in rows])
    for steering in _list_steerings(sensed):
        angles = [_find_angle(one.part, sensed, *steering) for one in rows]
        if best is None and _measure_movement(rows, angles) < math.radians(_LEAST_MOVED_DEG):
            return None, math.inf, 1.0
        columns = np.concatenate([_list_columns(one, angle) for one, angle in zip(rows, angles, strict=True)])
        fit = fit_robustly(columns, turn)
        least_without = min(least_without, fit_robustly(columns[:, 1:], turn)[2])
        if fit[2] < least:
            best, least = fit, fit[2]
    assert best is not None
    return float(best[0][0]), float(best[1][0]), least_without / least


def _find_angle(part: SteeringEvidence, sensed: bool, late_s: float, rate: float, lag_s: float) -> Array:
    """Return the angle (rad) that turns the vehicle, on the grid of a segment."""
    source = part.wheel if sensed else part.command
    assert source is not None
    shifted = np.interp(part.time_s - (late_s if sensed else 0.0), part.time_s, source)
    if sensed:
        return np.radians(follow_command(shifted, 0.0, 1e6, lag_s) if lag_s > 0.0 else shifted)
    return np.radians(follow_command(shifted, late_s, rate, lag_s))


def _measure_movement(rows: Sequence[_Rows], angles: Sequence[Array]) -> float:
    reach = round(0.5 * _WINDOW_S / STEP_S)
    moved = [angle[one.chosen + reach] - angle[one.chosen - reach] for one, angle in zip(rows, angles, strict=True)]
    return float(np.sqrt(np.sum(np.concatenate(moved) ** 2)))


def _list_columns(rows: _Rows, angle: Array) -> Array:
    """Return what the turn of windows depends on (k, n): first the change of the angle, then the path by the angle."""
    reach = round(0.5 * _WINDOW_S / STEP_S)
    pace, moved = rows.pace, angle[rows.chosen + reach] - angle[rows.chosen - reach]
    trails = [_follow_way(angle, np.abs(pace) * STEP_S, length_m) for length_m in _TRAILS_M]
    shapes = (angle, np.abs(angle), angle**3, angle * np.abs(angle), pace**2 * angle, np.ones(len(angle)), *trails)
    bends = [
        np.convolve(pace * shape, np.full(2 * reach + 1, _WINDOW_S / (2 * reach + 1)), mode="same")[rows.chosen]
        for shape in shapes
    ]
    speed = rows.ahead / _WINDOW_S
    return np.stack([moved, *bends, speed * moved], axis=1)


@compile_function
def _follow_way(angle, steps_m, length_m) -> Array:  # type: ignore[no-untyped-def]
    """Return what follows an angle (k, rad) over a way of `length_m`, as a drawn implement does."""
    out: Array = angle.copy()
    for k in range(1, len(angle)):
        out[k] = out[k - 1] + min(steps_m[k] / length_m, 1.0) * (angle[k - 1] - out[k - 1])
    return out


def _fit_antenna(rows: Sequence[_Rows]) -> tuple[float | None, float]:
    """Return how far ahead (m) of the axle without sideways motion the antenna is, and its standard error.

    Beside it: a bias of the heading, a position later than the heading, tyres that creep, all by their own columns.
    """
    turn, aside, ahead = (np.concatenate([getattr(one, name) for one in rows]) for name in ("turn", "aside", "ahead"))
    speed = ahead / _WINDOW_S
    if float(np.sqrt(np.sum(turn**2))) < math.radians(_LEAST_MOVED_DEG):
        return None, math.inf
    columns = np.stack([turn, ahead, speed * turn, speed * np.abs(speed) * turn], axis=1)
    # One speed does not separate them: no position is later by more than tenths of a second, or tyres so soft.
    value, error, _ = fit_robustly(columns, aside, np.array([100.0, 1.0, 0.3, 0.05]))
    return float(value[0]), float(error[0])


def fit_robustly(columns: Array, values: Array, prior_sd: Array | None = None) -> tuple[Array, Array, float]:
    """Return coefficients (n,), their standard errors (n,) and the mean squared residual, with outliers cut off."""
    kept, sigma = np.ones(len(values), dtype=np.bool_), 1.0
    prior = np.zeros(columns.shape[1]) if prior_sd is None else prior_sd**-2.0
    for _ in range(_PASSES):
        information = columns[kept].T @ columns[kept] + np.diag(prior * sigma**2 + 1e-12)
        theta: Array = np.linalg.solve(information, columns[kept].T @ values[kept]).astype(np.float64)
        residuals = np.abs(values - columns @ theta)
        sigma = max(1.4826 * float(np.median(residuals)), 1e-6)
        kept = residuals < _OUTLIER_SIGMAS * sigma
    errors = sigma * np.sqrt(np.diag(np.linalg.inv(information)))
    loss = float(np.mean(np.minimum(residuals, 10.0 * sigma) ** 2))
    return theta, errors, loss
