"""How late each run follows its commands: by its wheel angle where that is logged, else by the curvature of its path.

All runs are laid on one steering (dead time, rate and lag), the one that follows best in most of them. What is left
goes with the rate of turning where a run is later than that.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.faults.run_regression import FEWEST_ROWS, RunRegression, thin_rows
from vehicle.identification.faults.steering_evidence import (
    STEP_S,
    TURN_S,
    SteeringEvidence,
    build_evidence_segments,
    follow_command,
)
from vehicle.identification.logs.schema import Array, Log, Mask
from vehicle.identification.logs.vehicle_size import compute_file_curvature
from vehicle.model.tractor import Tractor

_Steering = tuple[float, float, float]  # dead time (s), rate (deg/s) and lag (s)
# Of the steering that all runs are laid on: those of the catalogue and slower ones.
_LATE_STEP_S, _RATE_FACTOR, _LAG_FACTOR = 0.2, 1.5, 2.0
_LATES_S = tuple(_LATE_STEP_S * step for step in range(4))
_RATES_DEG_PER_S = tuple(7.0 * _RATE_FACTOR**step for step in range(4))
_LAGS_S = tuple(0.1 * _LAG_FACTOR**step for step in range(4))
_LEVELS = 4  # of the grid, each with half the steps of the one before
_LEAST_MISS_DEG2 = 1e-3  # chosen: noise of a wheel sensor
_SHIFTS_S = tuple(0.1 * step for step in range(-8, 16))  # of a run against that steering
_LEAST_COMMANDED_DEG = 1.0  # chosen: runs with a smaller range of commands do not show how wheels follow
_LEAST_RATE_DEG_PER_S = 0.5  # chosen, over two seconds: slower movements do not show when they were commanded
_THIN_S = 0.2  # between rows: angles are averages over two seconds, movements last for about as long
_MOVEMENT_S = 2.0  # over which movements of commands are measured, as long as angles are averaged
# Chosen: dead bands and play take smaller movements; valves open wide for larger ones.
_SMALL_DEG, _LARGE_DEG = 2.0, 10.0
_SETTLING_S = 4.0  # chosen: until wheels follow that stood elsewhere when the log began
_LARGEST_DEG = 60.0  # of a wheel
_MOST_HOLD_S = 1.0  # chosen: columns that change more rarely do not show when


@dataclass(frozen=True, eq=False)
class _Response:
    """One segment: the command on a grid (k,), and the angle of the wheels, or the one that the path needs (NaN: not
    known), averaged over twice the time over which curvature is taken."""

    run: int
    command: Array
    angle: Array
    pace: Array


def build_delay_regression(logs: Sequence[Log], tractor: Tractor, ground: str) -> RunRegression | None:
    """Build what wheels, or paths, miss of one steering by the rate of turning; own differences are delays in s.

    None without commands, with columns that change too rarely, and with too little turning.
    """
    # Of wheels that never reached a short peak of their commands, the largest angle is no lock.
    locks = (tractor.max_steering_deg, tractor.max_steering_deg)
    segments = [build_evidence_segments(log, locks) for log in logs]
    parts = [part for run_parts in segments for part in run_parts]
    if not parts or any(part.command is None or part.hold_s > _MOST_HOLD_S for part in parts):
        return None
    by_wheel = all(part.wheel is not None for part in parts)
    responses = [
        _build_response(run, part, by_wheel, tractor, ground)
        for run, run_parts in enumerate(segments)
        for part in run_parts
    ]
    steering = _fit_steering(responses, len(logs))
    columns = [_lay_on_steering(group, steering) for group in _group_by_run(responses, len(logs)) if group]
    rows = [column for column in columns if column is not None]
    if not rows:
        return None
    gap, rate, angle, pace, size, steadiness, number = np.concatenate(rows, axis=1)
    nuisance = [rate, np.abs(rate), rate * np.abs(rate) / 10.0, angle, np.ones(len(gap))]
    prior_sd = [2.0, 0.2, 0.2, 0.1, 1.0]
    # A valve that opens wide only for large movements, or for those at once.
    nuisance += [rate * np.minimum(size / _LARGE_DEG, 1.0), rate * steadiness]
    prior_sd += [1.0, 1.0]
    if not by_wheel:
        nuisance += [rate / np.maximum(pace, 0.4), np.abs(angle)]
        prior_sd += [0.3, 0.1]
    return RunRegression(gap, number, np.stack(nuisance, 1), np.array(prior_sd), rate[:, None])


def average_over_turn(values: Array) -> Array:
    """Return the mean (k,) over the time over which curvature is taken."""
    width = 2 * round(0.5 * TURN_S / STEP_S) + 1
    padded = np.pad(values, width // 2, mode="edge")
    mean: Array = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return mean


def _build_response(run: int, part: SteeringEvidence, by_wheel: bool, tractor: Tractor, ground: str) -> _Response:
    assert part.command is not None
    known = np.isfinite(part.curvature)
    if by_wheel:
        assert part.wheel is not None
        angle, known = part.wheel, np.ones(len(known), dtype=np.bool_)
    elif known.any():
        grid, rows = np.linspace(-_LARGEST_DEG, _LARGEST_DEG, 481), np.arange(len(known))
        curvature = np.interp(rows, rows[known], part.curvature[known])
        angle = np.interp(curvature, compute_file_curvature(grid, tractor, ground), grid)
    else:
        angle = part.curvature
    # A path bends as its wheels do on average over TURN_S; twice that leaves movements that a line can shift.
    smooth = average_over_turn(average_over_turn(angle) if by_wheel else angle)
    near = average_over_turn(known.astype(np.float64)) > 1.0 - 1e-6
    near[: round(_SETTLING_S / STEP_S)] = False
    return _Response(run, part.command, np.where(near, smooth, np.nan), part.pace)


def _group_by_run(responses: Sequence[_Response], runs: int) -> list[list[_Response]]:
    return [[response for response in responses if response.run == run] for run in range(runs)]


def _fit_steering(responses: Sequence[_Response], runs: int) -> _Steering:
    """Return the steering that most of the runs that turn follow best, from a grid that grows finer about it."""
    groups = [
        group
        for group in _group_by_run(responses, runs)
        if any(float(np.ptp(part.command)) > _LEAST_COMMANDED_DEG for part in group)
        and sum(np.count_nonzero(np.isfinite(part.angle)) for part in group) >= FEWEST_ROWS
    ]
    grid = list(itertools.product(_LATES_S, _RATES_DEG_PER_S, _LAGS_S))
    if not groups:
        return grid[0]
    for level in range(_LEVELS):
        misses = {
            steering: np.array(
                [_measure_miss(group, [_simulate(part, steering) for part in group]) for group in groups]
            )
            for steering in grid
        }
        # Logarithms: a run of another steering, or one with large angles, does not decide.
        late, rate, lag = min(misses, key=lambda steering: float(np.sum(np.log(misses[steering] + _LEAST_MISS_DEG2))))
        share = 0.5 ** (level + 1)
        ways = (-share, 0.0, share)
        grid = [
            (max(late + _LATE_STEP_S * to_late, 0.0), rate * _RATE_FACTOR**to_rate, lag * _LAG_FACTOR**to_lag)
            for to_late, to_rate, to_lag in itertools.product(ways, ways, ways)
        ]
    return late, rate, lag


def _simulate(response: _Response, steering: _Steering) -> Array:
    late, rate, lag = steering
    return average_over_turn(average_over_turn(_delay(follow_command(response.command, 0.0, rate, lag), late)))


def _measure_miss(group: Sequence[_Response], models: Sequence[Array]) -> float:
    """Return the mean square (deg2) that the angles of a run miss of a steering, beside offset and scale."""
    angle, model = np.concatenate([response.angle for response in group]), np.concatenate(models)
    known = np.isfinite(angle)
    columns = np.column_stack([model[known], np.ones(np.count_nonzero(known))])
    residuals = angle[known] - columns @ np.linalg.lstsq(columns, angle[known], rcond=None)[0]
    return float(np.mean(residuals**2))


def _lay_on_steering(group: Sequence[_Response], steering: _Steering) -> Array | None:
    """Return the rows (7, k) of a run: gap, its change per second of delay, angle, pace, size of the movement of the
    command, its steadiness and run; without the scale and the offset of the run. None where nothing turns.

    Gaps are linear about the delay at which the run misses least.
    """
    if sum(np.count_nonzero(np.isfinite(response.angle)) for response in group) < FEWEST_ROWS:
        return None
    models = [_simulate(response, steering) for response in group]
    misses = {shift: _measure_miss(group, [_delay(model, shift) for model in models]) for shift in _SHIFTS_S}
    late_s = min(_SHIFTS_S, key=lambda shift: misses[shift])
    rows = []
    for response, model in zip(group, models, strict=True):
        late = _delay(model, late_s)
        change = -np.gradient(late, STEP_S)
        chosen = thin_rows(np.isfinite(response.angle), _THIN_S)
        size, steadiness = (_delay(one, late_s + steering[0]) for one in _measure_movement(response.command))
        columns = [response.angle - late + late_s * change, change, late, response.pace, size, steadiness]
        values = np.stack(columns)[:, chosen]
        rows.append(np.vstack([values, np.full(len(chosen), float(response.run))]))
    all_rows = np.concatenate(rows, axis=1)
    gap, change, angle, size = all_rows[[0, 1, 2, 4]]
    moving: Mask = (np.abs(change) > _LEAST_RATE_DEG_PER_S) & (size > _SMALL_DEG)
    if np.count_nonzero(moving) < FEWEST_ROWS:
        return None
    own_columns = np.column_stack([change, angle, np.ones(len(gap))])
    own = np.linalg.lstsq(own_columns, gap, rcond=None)[0]
    all_rows[0] -= own_columns[:, 1:] @ own[1:]
    return all_rows[:, moving]


def _measure_movement(command: Array) -> tuple[Array, Array]:
    """Return how far (deg) commands moved just before each row, and what share of that was not in one step."""
    reach = round(_MOVEMENT_S / STEP_S)
    padded = np.pad(command, (reach, 0), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, reach + 1)
    steps = np.abs(np.diff(windows, axis=1))
    total = np.sum(steps, axis=1)
    return np.ptp(windows, axis=1), 1.0 - np.max(steps, axis=1) / np.maximum(total, 1e-9)


def _delay(values: Array, seconds: float) -> Array:
    rows = np.arange(len(values), dtype=np.float64)
    delayed: Array = np.interp(rows - seconds / STEP_S, rows, values)
    return delayed
