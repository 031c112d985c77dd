"""What every tenth of a second of a run says of its steering and its instruments.

Wheels may stand wherever a steering that is late, slow or offset as the catalogue allows would have put them; a path
may need any angle that such wheels and ground allow, on the scale of the angles of the whole set of logs; positions may
leave the middle of their neighbours as far as a tractor brakes and turns. What is beyond that, in units of how far runs
usually are, is evidence. A path is bent only as far as heading and course both say so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from fields.arrays import Flags, Floats
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.series import measure_spread
from vehicle.identification.logs.thresholds import (
    ALMOST_ALL_SHARE,
    CLEAR_CORRELATION,
    CLEAR_SIGMAS,
    FEWEST_LINE_ROWS,
    GAP_STEPS,
    GRID_S,
    LOCK_QUANTILE,
    PART_S,
    PATH_MPS,
    READING_S,
    SURE_SIGMAS,
    TURN_S,
)
from vehicle.jit import compile_function

STEP_S = GRID_S  # on which evidence is compared
# Late (s), rate (deg/s) and lag (s). As the simulation steers by default, later by what valves usually are; a middling
# one, as where commands swing to and fro it is not always between an immediate and a slow one; and slower than any
# steering of the catalogue (0.25 s late, 9 deg/s, and clocks of two columns).
STEERINGS = ((0.1, 16.0, 0.15), (0.3, 9.0, 0.3), (0.6, 5.0, 0.6))
EITHER_WAY_S = 0.6  # chosen: clocks of two columns are so far apart at most, with what stands still in them
COURSE_TURN_S = 2.0 * TURN_S  # chosen: the course of the antenna is noisier
OFFSET_DEG = 2.5  # an offset, a dead band and play of the catalogue together
SWING_S = PART_S  # in which the slowest steering does what was commanded
LARGEST_ACCELERATION_MPS2 = 1.0  # of a tractor
BEND_S = 0.5 * READING_S  # the time to both sides of a position


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """One run on an even grid (k,); angles in degrees to the right, NaN where a value is not known.

    `low` and `high` bound the wheel angle that commands (without them: the sensor) allow, `usual` is that of a usual
    steering and `steered` how far any steering moves within SWING_S. `bends` (2, k, 1/m, in the sense of going ahead)
    are curvatures by heading and by course, `pace` is in m/s, `aside` (m) how far positions are from where their
    neighbours would have them. `place` (2, k) is in metres to the east and the north, `heading` (k,) in radians, `gear`
    that of the shuttle; the slower of the steering columns changes every `hold_s` only (0: in its rows).
    """

    time_s: Floats
    known: Flags
    wheel: Floats | None
    command: Floats | None
    usual: Floats
    low: Floats
    high: Floats
    steered: Floats
    pace: Floats
    bends: Floats
    aside: Floats
    place: Floats
    heading: Floats | None
    gear: Floats
    hold_s: float

    @property
    def angle(self) -> Floats:
        """The wheel angle (k, deg); without a sensor that of a usual steering."""
        return self.usual if self.wheel is None else self.wheel

    @property
    def unknown(self) -> Floats:
        """Nothing known in any step (k,)."""
        return np.full(len(self.time_s), np.nan)

    def list_needed(self, scales: Sequence[BendScale | None]) -> list[tuple[Floats, Floats]]:
        """The wheel angles (k, deg) that the path needs and its curvatures, by heading and course as far as known."""
        return [
            ((bends - scale.at_zero) / scale.per_degree, bends)
            for scale, bends in zip(scales, self.bends, strict=True)
            if scale is not None and np.isfinite(bends).any()
        ]

    def cut(self, steps: slice) -> RunEvidence:
        """Some steps of the run."""
        values: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}
        arrays = {name: one[..., steps] for name, one in values.items() if isinstance(one, np.ndarray)}
        return replace(self, **{**values, **arrays})


class BendScale(NamedTuple):
    """Curvature (1/m) per degree of the wheels, and the curvature of wheels at 0; of heading or of course."""

    per_degree: float
    at_zero: float


def find_lock(logs: Sequence[Log]) -> float:
    """How far the wheels of a set turn (deg), without a sensor how far they are steered to."""
    has_sensor = any(log.steering_deg is not None for log in logs)
    angles = [
        np.abs(values[log.used])
        for log in logs
        if (values := log.steering_deg if has_sensor else log.steering_command_deg) is not None
    ]
    values = np.concatenate([np.empty(0), *angles])
    return float(np.quantile(values, LOCK_QUANTILE)) if len(values) else math.inf


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
    hold_s = 0.0  # how rarely the slower of the steering columns changes, where that is less often than its rows
    for values in (log.steering_deg, log.steering_command_deg):
        changes = np.flatnonzero(np.diff(values[rows]) != 0.0) if values is not None else np.empty(0)
        if len(changes) >= 20:
            gaps = np.diff(row_s[changes])
            is_slow = np.median(gaps) > GAP_STEPS * np.median(step_s)
            hold_s = max(hold_s, float(np.quantile(gaps, ALMOST_ALL_SHARE)) if is_slow else 0.0)
    place = np.stack([np.interp(time, row_s, axis[rows]) for axis in (log.easting_m, log.northing_m)])
    heading, driven = None, None
    gear = np.interp(time, row_s, log.shuttle[rows])
    if log.heading_deg is not None:
        heading = np.interp(time, row_s, np.unwrap(np.radians(log.heading_deg[rows])))
    if log.speed_mps is not None:
        driven = gear * np.interp(time, row_s, log.speed_mps[rows])
    follows = [follow_command(source, *steering, source[0] if wheel is None else wheel[0]) for steering in STEERINGS]
    allowed, reach = np.stack([source, *follows]), round((EITHER_WAY_S + hold_s) / STEP_S)
    low = slide_minimum(allowed.min(axis=0), reach) - OFFSET_DEG
    high = -slide_minimum(-allowed.max(axis=0), reach) + OFFSET_DEG
    steered = np.min([measure_swing(one) for one in follows], axis=0)
    # Pace and curvatures; nothing is known of slow driving, and at the ends.
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
    aside = _measure_aside(place, heading, driven, known)
    return RunEvidence(time, known, wheel, command, follows[0], low, high, steered, pace, bends, aside, place, heading,
                       gear, hold_s)  # fmt: skip


def measure_swing(angle: Floats) -> Floats:
    """How far an angle (k, deg) moves within SWING_S about a step."""
    reach = round(0.5 * SWING_S / STEP_S)
    return -slide_minimum(-angle, reach) - slide_minimum(angle, reach)


def shift(values: Floats, steps: int) -> Floats:
    """Values (..., k) of so many steps later, those of the ends held on."""
    places = np.clip(np.arange(values.shape[-1]) + steps, 0, values.shape[-1] - 1)
    return np.asarray(values[..., places])


def _measure_aside(place: Floats, heading: Floats | None, pace: Floats | None, known: Flags) -> Floats:
    """How far (k, m) positions are from the middle of those BEND_S before and after, beyond what the tractor drove.
    Speed and heading say what it drove, or a tractor that goes straight on; what explains more counts."""
    half = round(BEND_S / STEP_S)

    def bend(values: Floats) -> Floats:
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
    angle, *bends = np.concatenate([np.empty((3, 0)), *(np.stack([run.angle, *run.bends]) for run in runs)], axis=1)
    scales: list[BendScale | None] = []
    for curvature in bends:
        known = np.isfinite(angle) & np.isfinite(curvature)
        x, y, scale = angle[known], curvature[known], None
        if len(x) >= FEWEST_LINE_ROWS and np.std(x) >= 0.5:
            (per_degree, at_zero), _, _ = fit_robustly(np.stack([x, np.ones(len(x))], axis=1), y)
            if per_degree > 0.0:
                apart = np.abs((y - at_zero) / per_degree - x)
                kept = apart <= max(CLEAR_SIGMAS * measure_spread(apart), 1.0)
                is_clear = np.corrcoef(x[kept], y[kept])[0, 1] > CLEAR_CORRELATION
                scale = BendScale(float(per_degree), float(at_zero)) if is_clear else None
        scales.append(scale)
    return scales


@compile_function
def _follow_steps(source, late, most_step, share, out) -> None:  # type: ignore[no-untyped-def]
    """Write what follows `source` (k,) `late` steps later from out[0] on, by a share of the gap up to `most_step`."""
    for k in range(1, len(source)):
        step = share * (source[max(k - late, 0)] - out[k - 1])
        out[k] = out[k - 1] + min(max(step, -most_step), most_step)


def follow_command(source: Floats, late_s: float, rate_deg_per_s: float, lag_s: float, start_deg: float) -> Floats:
    """Return what follows commands (k, deg) so late, at such a rate (deg/s) and time constant, from a start on."""
    out = np.empty(len(source))
    out[0] = start_deg
    share = 1.0 - math.exp(-STEP_S / lag_s)
    _follow_steps(np.ascontiguousarray(source), round(late_s / STEP_S), rate_deg_per_s * STEP_S, share, out)
    return out


def slide_minimum(values: Floats, reach: int) -> Floats:
    """Return the least value (k,) within `reach` steps to both sides."""
    return np.asarray(minimum_filter1d(values, 2 * reach + 1, mode="nearest"))


def fit_robustly(columns: Floats, values: Floats, prior_sd: Floats | None = None) -> tuple[Floats, Floats, float]:
    """Return coefficients (n,), their standard errors (n,) and the mean squared residual, with outliers cut off."""
    kept, sigma = np.ones(len(values), dtype=np.bool_), 1.0
    prior = np.zeros(columns.shape[1]) if prior_sd is None else prior_sd**-2.0
    for _ in range(4):
        information = columns[kept].T @ columns[kept] + np.diag(prior * sigma**2 + 1e-12)
        theta: Floats = np.linalg.solve(information, columns[kept].T @ values[kept]).astype(np.float64)
        residuals = np.abs(values - columns @ theta)
        sigma = max(measure_spread(residuals), 1e-6)
        kept = residuals < SURE_SIGMAS * sigma
    errors = sigma * np.sqrt(np.diag(np.linalg.inv(information)))
    return theta, errors, float(np.mean(np.minimum(residuals, 10.0 * sigma) ** 2))
