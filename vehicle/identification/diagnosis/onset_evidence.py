"""What every tenth of a second of a run says of its steering and its instruments, for faults that begin in it.

Wheels may stand wherever a steering that is late, slow or offset as the catalogue allows would have put them; a path
may need any angle that such wheels and ground allow; positions may leave the middle of their neighbours as far as a
tractor brakes and turns. What is beyond that, in units of how far runs usually are, is evidence. Each channel of these
is beside what another instrument says: a path is bent only as far as heading and course both say so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from vehicle.identification.faults.steering_evidence import (
    COURSE_TURN_S,
    EITHER_WAY_S,
    STEERINGS,
    STEP_S,
    TURN_S,
    follow_command,
    slide_minimum,
)
from vehicle.identification.logs.schema import Array, Log, Mask, Rows
from vehicle.identification.logs.series import measure_spread
from vehicle.identification.logs.thresholds import (
    ALMOST_ALL_SHARE,
    CLEAR_CORRELATION,
    CLEAR_SIGMAS,
    FEWEST_LINE_ROWS,
    FEWEST_READINGS,
    GAP_STEPS,
    PATH_MPS,
    SURE_SIGMAS,
)

OFFSET_DEG = 2.5  # an offset, a dead band and play of the catalogue together
# Shares of an angle that a path may need: a patch without grip leaves half, and no cause doubles it.
LEAST_GAIN, MOST_GAIN = 0.4, 1.7
SLIDING_MPS2 = 0.3  # a path that turns less than its wheels at this lateral acceleration may be that of sliding tyres
SWING_S = 5.0  # in which the slowest steering does what was commanded
LARGEST_ACCELERATION_MPS2, BEND_S = 1.0, 0.5  # of a tractor, and the time to both sides of a position


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """One run on an even grid (k,); angles in degrees to the right, NaN where a value is not known.

    `low` and `high` bound the wheel angle that commands (without them: the sensor) allow, `usual` is that of a usual
    steering and `steered` how far any steering moves within SWING_S. `bends` (2, k, 1/m, in the sense of going ahead)
    are curvatures by heading and by course, `pace` is in m/s, `aside` (m) how far positions are from where their
    neighbours would have them. `place` (2, k) is in metres to the east and the north, `heading` (k,) in radians; the
    slower of the steering columns changes every `hold_s` only (0: in its rows).
    """

    time_s: Array
    known: Mask
    wheel: Array | None
    command: Array | None
    usual: Array
    low: Array
    high: Array
    steered: Array
    pace: Array
    bends: Array
    aside: Array
    place: Array
    heading: Array | None
    hold_s: float

    def cut(self, steps: slice) -> RunEvidence:
        """Some steps of the run."""
        values: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}
        arrays = {name: one[..., steps] for name, one in values.items() if isinstance(one, np.ndarray)}
        return replace(self, **{**values, **arrays})


@dataclass(frozen=True)
class BendScale:
    """Curvature (1/m) per degree of the wheels, and the curvature of wheels at 0; of heading and of course."""

    per_degree: float
    at_zero: float

    def find_angle(self, curvature: Array) -> Array:
        """The wheel angle (deg) that a curvature needs."""
        return (curvature - self.at_zero) / self.per_degree


def build_run_evidence(log: Log, lock_deg: float) -> RunEvidence | None:
    """Lay a run out on a grid; commands beyond `lock_deg` ask for it. None without driving."""
    rows = np.flatnonzero(log.used)
    if len(rows) < 2 or log.time_s[rows[-1]] - log.time_s[rows[0]] < 2.0 * COURSE_TURN_S:
        return None
    row_s = log.time_s[rows]
    time = np.arange(row_s[0], row_s[-1] + 1e-9, STEP_S)
    step_s = np.diff(row_s)
    after = np.clip(np.searchsorted(row_s, time), 1, len(rows) - 1)
    known = step_s[after - 1] <= 5.5 * float(np.median(step_s))
    known &= log.shuttle[rows][after] == log.shuttle[rows][after - 1]
    wheel = None if log.steering_deg is None else np.interp(time, row_s, log.steering_deg[rows])
    source, command = wheel, None
    if log.steering_command_deg is not None:
        nearest = np.searchsorted(0.5 * (row_s[1:] + row_s[:-1]), time)
        source = command = np.clip(log.steering_command_deg[rows][nearest], -lock_deg, lock_deg)
    assert source is not None
    hold_s = _measure_hold_s(log, rows)
    place = np.stack([np.interp(time, row_s, axis[rows]) for axis in (log.easting_m, log.northing_m)])
    heading, driven = None, None
    gear = np.interp(time, row_s, log.shuttle[rows])
    if log.heading_deg is not None:
        heading = np.interp(time, row_s, np.unwrap(np.radians(log.heading_deg[rows])))
    if log.speed_mps is not None:
        driven = gear * np.interp(time, row_s, log.speed_mps[rows])
    angles, bends = _bound_wheels(source, wheel, hold_s), _measure_bends(place, heading, gear, known)
    aside = _measure_aside(place, heading, driven, known)
    return RunEvidence(time, known, wheel, command, *angles, *bends, aside, place, heading, hold_s)


def _measure_hold_s(log: Log, rows: Rows) -> float:
    """How rarely (s) the slower of the steering columns changes, where that is less often than its rows."""
    holds = [0.0]
    for values in (log.steering_deg, log.steering_command_deg):
        changes = np.flatnonzero(np.diff(values[rows]) != 0.0) if values is not None else np.empty(0)
        if len(changes) >= 20:
            gaps = np.diff(log.time_s[rows][changes])
            is_slow = np.median(gaps) > GAP_STEPS * np.median(np.diff(log.time_s[rows]))
            holds.append(float(np.quantile(gaps, ALMOST_ALL_SHARE)) if is_slow else 0.0)
    return max(holds)


def _bound_wheels(source: Array, wheel: Array | None, hold_s: float) -> tuple[Array, Array, Array, Array]:
    """The angle of a usual steering, the least and the largest that commands allow, and how far all move (k, deg)."""
    start = source[0] if wheel is None else wheel[0]
    follows = [follow_command(source, *steering, start) for steering in STEERINGS]
    allowed = np.stack([source, *follows])
    reach = round((EITHER_WAY_S + hold_s) / STEP_S)
    return (
        follows[0],
        slide_minimum(allowed.min(axis=0), reach) - OFFSET_DEG,
        -slide_minimum(-allowed.max(axis=0), reach) + OFFSET_DEG,
        np.min([measure_swing(one) for one in follows], axis=0),
    )


def measure_swing(angle: Array) -> Array:
    """How far an angle (k, deg) moves within SWING_S about a step."""
    reach = round(0.5 * SWING_S / STEP_S)
    return -slide_minimum(-angle, reach) - slide_minimum(angle, reach)


def shift(values: Array, steps: int) -> Array:
    """Values (..., k) of so many steps later, those of the ends held on."""
    places = np.clip(np.arange(values.shape[-1]) + steps, 0, values.shape[-1] - 1)
    return np.asarray(values[..., places])


def _measure_bends(place: Array, heading: Array | None, gear: Array, known: Mask) -> tuple[Array, Array]:
    """Pace (k, m/s) and curvatures by heading and by course (2, k, 1/m)."""
    bends = np.full((2, len(gear)), np.nan)
    half = round(0.5 * TURN_S / STEP_S)
    pace = np.hypot(*(shift(place, half) - shift(place, -half))) / (2 * half * STEP_S)
    if heading is not None:
        bends[0] = gear * (shift(heading, half) - shift(heading, -half)) / np.maximum(pace * TURN_S, 1e-3)
        bends[0][slide_minimum(known.astype(np.float64), half) == 0.0] = np.nan
    half = round(0.5 * COURSE_TURN_S / STEP_S)
    first, second = place - shift(place, -half), shift(place, half) - place
    length = 0.5 * (np.hypot(*first) + np.hypot(*second))
    turn = np.arctan2(second[0] * first[1] - second[1] * first[0], np.sum(first * second, axis=0))
    bends[1] = gear * turn / np.maximum(length, 1e-3)
    bends[1][(slide_minimum(known.astype(np.float64), half) == 0.0) | (length < PATH_MPS * half * STEP_S)] = np.nan
    for edge in (slice(0, half), slice(-half, None)):
        bends[:, edge] = np.nan
    bends[:, (pace < PATH_MPS)] = np.nan
    return pace, bends


def _measure_aside(place: Array, heading: Array | None, pace: Array | None, known: Mask) -> Array:
    """How far (k, m) positions are from the middle of those BEND_S before and after, beyond what the tractor drove.

    Speed and heading say what it drove, or a tractor that goes straight on; what explains more counts.
    """
    half = round(BEND_S / STEP_S)

    def bend(values: Array) -> Array:
        return values - 0.5 * (shift(values, half) + shift(values, -half))

    aside = bend(place)
    apart = np.hypot(*aside)
    if heading is not None and pace is not None:
        driven = np.cumsum(pace * np.stack([np.sin(heading), np.cos(heading)]) * STEP_S, axis=1)
        apart = np.minimum(apart, np.hypot(*(aside - bend(driven))))
    apart[slide_minimum(known.astype(np.float64), half) == 0.0] = np.nan
    apart[:half], apart[-half:] = np.nan, np.nan
    return np.asarray(np.maximum(apart - 0.5 * LARGEST_ACCELERATION_MPS2 * (half * STEP_S) ** 2, 0.0))


def fit_path_scales(runs: Sequence[RunEvidence]) -> list[BendScale | None]:
    """How the curvatures by heading and by course follow the wheels of all runs; None where no line is clear."""
    angle = np.concatenate([run.usual if run.wheel is None else run.wheel for run in runs])
    return [_fit_scale(angle, np.concatenate([run.bends[number] for run in runs])) for number in range(2)]


def _fit_scale(angle: Array, curvature: Array) -> BendScale | None:
    known = np.isfinite(angle) & np.isfinite(curvature)
    angle, curvature = angle[known], curvature[known]
    if len(angle) < FEWEST_LINE_ROWS or np.std(angle) < 0.5:
        return None
    (per_degree, at_zero), _, _ = fit_robustly(np.stack([angle, np.ones(len(angle))], axis=1), curvature)
    if per_degree <= 0.0:
        return None
    apart = np.abs((curvature - at_zero) / per_degree - angle)
    kept = apart <= max(CLEAR_SIGMAS * measure_spread(apart), 1.0)
    is_clear = np.corrcoef(angle[kept], curvature[kept])[0, 1] > CLEAR_CORRELATION
    return BendScale(float(per_degree), float(at_zero)) if is_clear else None


def fit_robustly(columns: Array, values: Array, prior_sd: Array | None = None) -> tuple[Array, Array, float]:
    """Return coefficients (n,), their standard errors (n,) and the mean squared residual, with outliers cut off."""
    kept, sigma = np.ones(len(values), dtype=np.bool_), 1.0
    prior = np.zeros(columns.shape[1]) if prior_sd is None else prior_sd**-2.0
    for _ in range(4):
        information = columns[kept].T @ columns[kept] + np.diag(prior * sigma**2 + 1e-12)
        theta: Array = np.linalg.solve(information, columns[kept].T @ values[kept]).astype(np.float64)
        residuals = np.abs(values - columns @ theta)
        sigma = max(measure_spread(residuals), 1e-6)
        kept = residuals < SURE_SIGMAS * sigma
    errors = sigma * np.sqrt(np.diag(np.linalg.inv(information)))
    return theta, errors, float(np.mean(np.minimum(residuals, 10.0 * sigma) ** 2))


def list_holds(log: Log, column: str) -> tuple[Array, Array, Array]:
    """First and last time of every value that a column holds, and for how long the tractor drove in it (s)."""
    values = _get_values(log, column)
    measured = log.place_rows.get(column, log.fresh if column == "position" else None)
    rows = np.flatnonzero(log.used if measured is None else log.used & measured)
    if values is None or len(rows) < FEWEST_READINGS:
        return np.empty(0), np.empty(0), np.empty(0)
    driven = _measure_driving_time(log)
    changes = np.flatnonzero(np.append(True, (np.diff(values[:, rows], axis=1) != 0.0).any(axis=0)))
    ends = np.append(changes[1:], len(rows) - 1)
    time = log.time_s[rows]
    return time[changes], time[ends], (driven[rows][ends] - driven[rows][changes])


def _get_values(log: Log, column: str) -> Array | None:
    if column == "position":
        return np.stack([log.easting_m, log.northing_m])
    values = {"heading": log.heading_deg, "speed": log.speed_mps, "wheel": log.steering_deg}[column]
    return None if values is None else values[None, :]


def _measure_driving_time(log: Log) -> Array:
    """Seconds (n,) driven up to each row, as most of positions, speed and commanded speed say."""
    used = np.flatnonzero(log.used)
    time = log.time_s[used]
    place = np.stack([np.interp(time + shift_s, time, axis[used]) for axis in (log.easting_m, log.northing_m)
                      for shift_s in (-1.0, 1.0)])  # fmt: skip
    paces = [np.hypot(place[1] - place[0], place[3] - place[2]) / 2.0]
    paces += [values[used] for values in (log.speed_mps, log.speed_command_mps) if values is not None]
    moving = np.sort(np.stack(paces), axis=0)[-2 if len(paces) > 1 else -1] > PATH_MPS
    step = np.diff(time, prepend=time[0])
    step = np.where(step <= 5.5 * np.median(step), step, 0.0)
    driven = np.zeros(len(log.time_s))
    driven[used] = np.cumsum(step * moving)
    return driven
