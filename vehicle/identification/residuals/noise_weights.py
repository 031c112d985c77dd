"""Noise of the ground, the instruments and the speed, estimated from changes too quick for any effect, and the weights
of the residuals.

Second differences over a few seconds of measured minus simulated heading: offsets, slopes and drafts turn the tractor
evenly and drop out, while soil and receiver noise remain. So the noise is known before any cause is fitted, and what a
cause leaves unexplained does not count as rough ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vehicle.identification.logs.schema import Array, Mask
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.identification.replay.rig import (
    ReplayRig,
    compute_antenna_lever,
    replay_segment,
    simulate_logged_antenna,
    simulate_logged_values,
)
from vehicle.identification.replay.state_cache import FORWARD_COLUMN
from vehicle.identification.residuals.innovations import (
    SOIL_MEMORY_S,
    NoiseLevels,
    compute_kalman_gains,
    compute_noise_persistence,
    simulate_segment_increments,
)
from vehicle.identification.thresholds import (
    DRIVE_LINE_S,
    LEAST_ALONG_NOISE,
    LEAST_SOIL_RAD_PER_M,
    MOST_MEMORY,
    MOST_SOIL_RAD_PER_M,
    OUTLIER_SIGMAS,
    TIMING_S,
    TRANSIENT_S,
)
from vehicle.jit import compile_function
from vehicle.model.effects import compute_effect_fields
from vehicle.model.tractor import Settings

DIFFERENCE_SPANS_S = (1.0, 2.0, 4.0)  # longer than the memory of the soil, shorter than any steady cause
DROWNED_SHARE = 0.6  # chosen, of the spread of second differences: with more instrument noise the remainder says little
LEAST_UNKNOWN_SHARE = 0.02  # chosen, of the variance of steps: between measured angles nothing is known exactly
FEWEST_DIFFERENCES = 30  # second differences: with fewer, the median deviation is off by a fifth or more


@dataclass(frozen=True)
class SpanEstimate:
    """Noise estimated at one span, and the share of the instruments in the spread it is estimated from."""

    value: float
    instrument_share: float


def estimate_first_noise(dataset: DriveDataset) -> NoiseLevels:
    """Estimate white noise of positions and headings; the soil is that of an ordinary field."""
    position, heading = [], []
    for segment in dataset.segments:
        position += [
            estimate_white_noise(segment.time, segment.east),
            estimate_white_noise(segment.time, segment.north),
        ]
        if segment.heading_measured:
            heading.append(estimate_white_noise(segment.time, segment.heading))
    position_sigma = max(float(np.median(position)), 2e-4)
    heading_sigma = max(float(np.median(heading)), 2e-4) if heading else 1e3
    return NoiseLevels(position_sigma, 1.5 * position_sigma, heading_sigma, min(1.0 * heading_sigma, 0.1), 0.0025, 0.01)


def estimate_white_noise(time: Array, values: Array) -> float:
    """Estimate the standard deviation of white noise on a smooth signal (k,), robustly: the deviation of four rows from
    a parabola.

    Third divided differences, which no parabola changes however uneven the times are.
    """
    t = np.lib.stride_tricks.sliding_window_view(time, 4)
    apart = t[:, :, None] - t[:, None, :] + np.eye(4)
    weights = 1.0 / apart.prod(axis=2)
    parabola_residuals = (weights * np.lib.stride_tricks.sliding_window_view(values, 4)).sum(axis=1)
    scaled = parabola_residuals / np.sqrt((weights * weights).sum(axis=1))
    return float(1.4826 * np.median(np.abs(scaled - np.median(scaled))))


def estimate_soil_and_speed_noise(
    dataset: DriveDataset, rig: ReplayRig, noise: NoiseLevels, settings: Settings
) -> NoiseLevels:
    """Estimate soil and speed scatter from second differences; unchanged where nothing can be estimated.

    Without a measured heading the soil is not changed. The least of three spans counts: disturbances with the period of
    one span drop out of another. Where the instruments make up most of the spread, the remainder is only the error of
    their own noise.
    """
    deviations = [_measure_deviation(rig, segment, settings) for segment in dataset.segments]
    span_estimates = [
        estimate
        for span in DIFFERENCE_SPANS_S
        if (estimate := _estimate_at_span(dataset, deviations, noise, span)) is not None
    ]
    if not span_estimates:
        return noise
    soil_estimates, distance_estimates = [
        [estimate for estimate in column if estimate is not None] for column in zip(*span_estimates, strict=True)
    ]
    return replace(
        noise,
        soil=_select_least(soil_estimates) if soil_estimates else noise.soil,
        along=_select_least(distance_estimates),
    )


def _select_least(span_estimates: Sequence[SpanEstimate]) -> float:
    """Return the least estimate over the spans; the longest span where instruments dominate all of them."""
    clear_values = [estimate.value for estimate in span_estimates if estimate.instrument_share < DROWNED_SHARE]
    return min(clear_values) if clear_values else span_estimates[-1].value


@dataclass(frozen=True, eq=False)
class _PoseDeviation:
    """Measured minus simulated pose of a segment, per row (k,): turn (rad), way (m); the pace, and whether it moves."""

    turn: Array
    distance: Array
    pace: Array
    moving: Mask


def _measure_deviation(rig: ReplayRig, segment: DriveSegment, settings: Settings) -> _PoseDeviation:
    """Compare a segment with its replay from measured wheel angle and speed."""
    states = replay_segment(rig, segment, settings, from_sensor=True, from_speed=True)
    antenna, heading = simulate_logged_antenna(rig, segment, states, settings)
    pace = np.interp(segment.time, segment.steps_s, np.abs(states[:, FORWARD_COLUMN]))
    moving = pace > 0.3 * max(float(np.median(pace)), 0.05)
    return _PoseDeviation(segment.heading - heading, _compute_along_path_lead(segment, antenna, heading), pace, moving)


def _estimate_at_span(
    dataset: DriveDataset, deviations: Sequence[_PoseDeviation], noise: NoiseLevels, span: float
) -> tuple[SpanEstimate | None, SpanEstimate] | None:
    """Estimate soil (rad per metre) and scatter along the path at one span; None with too few second differences.

    A heading derived from positions has their noise and shows no soil.
    """
    turn_differences, distance_differences, speeds = [], [], []
    for segment, deviation in zip(dataset.segments, deviations, strict=True):
        if segment.time[-1] < 4.0 * span:
            continue
        differences, keep = _compute_second_differences(segment, deviation.distance, deviation.moving, span)
        distance_differences.append(differences[keep])
        if segment.heading_measured:
            turn_differences.append(
                _compute_second_differences(segment, deviation.turn, deviation.moving, span)[0][keep]
            )
            speeds.append(
                np.interp(np.arange(len(differences)) * 0.25 * span + span, segment.time, deviation.pace)[keep]
            )
    if sum(map(len, distance_differences)) < FEWEST_DIFFERENCES:
        return None
    distance_estimate = _estimate_distance_scatter(np.concatenate(distance_differences), noise.position, span)
    if sum(map(len, turn_differences)) < FEWEST_DIFFERENCES:
        return None, distance_estimate
    return _estimate_soil(
        np.concatenate(turn_differences), np.concatenate(speeds), noise.heading, span
    ), distance_estimate


def _compute_second_differences(segment: DriveSegment, values: Array, moving: Mask, span: float) -> tuple[Array, Mask]:
    """Return second differences over a span, and which of them are in motion throughout."""
    grid = np.arange(0.0, segment.time[-1], 0.25 * span)
    moving_share = np.interp(grid, segment.time, moving.astype(np.float64)) > 0.99
    sampled = np.interp(grid, segment.time, values)
    lag = 4
    return sampled[2 * lag :] - 2.0 * sampled[lag:-lag] + sampled[: -2 * lag], moving_share[2 * lag :] & moving_share[
        lag:-lag
    ] & moving_share[: -2 * lag]


def _compute_along_path_lead(segment: DriveSegment, antenna: Array, heading: Array) -> Array:
    """Return how much further the measured antenna has come than the simulated one, along its path."""
    de, dn = np.diff(segment.east), np.diff(segment.north)
    cosine, sine = np.cos(segment.heading[:-1]), np.sin(segment.heading[:-1])
    simulated = np.diff(antenna, axis=0)
    simulated_cosine, simulated_sine = np.cos(heading[:-1]), np.sin(heading[:-1])
    gained = de * cosine + dn * sine - simulated[:, 0] * simulated_cosine - simulated[:, 1] * simulated_sine
    out: Array = np.concatenate([[0.0], np.cumsum(gained)])
    return out


def _estimate_soil(turn: Array, pace: Array, heading_noise: float, span: float) -> SpanEstimate:
    """Return the soil (rad per metre) whose coloured disturbance has the measured spread of second differences at these
    paces."""
    total_variance, instrument = _compute_robust_sigma(turn) ** 2, 6.0 * min(heading_noise, 1.0) ** 2
    spread = total_variance - instrument
    variance_once, variance_twice = _compute_integrated_variance(span), _compute_integrated_variance(2.0 * span)
    # Var(second difference) = 2 V(T) - 2 C with C = (V(2 T) - 2 V(T)) / 2 the covariance of neighbouring spans.
    unit = 2.0 * variance_once - (variance_twice - 2.0 * variance_once)
    soil = math.sqrt(max(spread, 0.0) / (unit * float(np.mean(pace**2)) + 1e-12))
    return SpanEstimate(
        min(max(soil, LEAST_SOIL_RAD_PER_M), MOST_SOIL_RAD_PER_M), instrument / max(total_variance, 1e-30)
    )


def _compute_integrated_variance(span: float) -> float:
    """Variance of the integral of unit noise with a memory over a span: 2 m^2 (T / m - 1 + exp(-T / m))."""
    memory = SOIL_MEMORY_S
    return 2.0 * memory * memory * (span / memory - 1.0 + math.exp(-span / memory))


def _estimate_distance_scatter(differences: Array, position_noise: float, span: float) -> SpanEstimate:
    total_variance, instrument = _compute_robust_sigma(differences) ** 2, 6.0 * position_noise**2
    scatter = math.sqrt(max(total_variance - instrument, 0.0) / (2.0 * span))
    return SpanEstimate(max(scatter, LEAST_ALONG_NOISE), instrument / max(total_variance, 1e-30))


def _compute_robust_sigma(values: Array) -> float:
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


@dataclass(frozen=True, eq=False)
class PathFilter:
    """Gains and roots of one segment, and the shares of its rows that persist (see compute_noise_persistence).

    `unknown_turns` (k - 1,) are the variances (rad2) of turns between rows for lack of a measured wheel angle.
    """

    gains: Array
    roots: Array
    lever: tuple[float, float]
    memory_shares: Array
    unknown_turns: Array


@dataclass(frozen=True, eq=False)
class ResidualChannel:
    """Weights of a directly compared channel of one segment: standard deviation per row and memory from row to row.

    `scatter` is the part of the standard deviation that a true model would leave: the scatter within a run in steady
    driving, and the timing errors of commands and drive lines. `measured` are the rows that count (None: all).
    """

    sigma: Array
    memory: float
    scatter: Array
    measured: Mask | None = None


def apply_huber(values: Array) -> Array:
    """Return values whose squares are Huber's loss: beyond OUTLIER_SIGMAS an error counts linearly, not squared."""
    out = values.copy()
    _limit_outliers(out, OUTLIER_SIGMAS)
    return out


@compile_function
def _limit_outliers(values, limit) -> None:  # type: ignore[no-untyped-def]
    """Apply apply_huber to the values (n,) beyond `most`."""
    for k in range(len(values)):
        size = abs(values[k])
        if size > limit:
            values[k] = math.copysign(math.sqrt(2.0 * limit * size - limit * limit), values[k])


def build_filters(
    dataset: DriveDataset, rig: ReplayRig, noise: NoiseLevels, settings: Settings
) -> tuple[PathFilter, ...]:
    """Build the filters of all segments for motion simulated with the settings."""
    lever = compute_antenna_lever(rig, compute_effect_fields(settings))
    path_filters = []
    moves = [simulate_segment_increments(rig, segment, settings) for segment in dataset.segments]
    turns = estimate_unknown_turns(dataset, [move.turned for move in moves], noise, ("angle", "command"))
    for segment, increments, unknown_turns in zip(dataset.segments, moves, turns, strict=True):
        gains, roots = np.empty((segment.rows, 7, 3)), np.empty((segment.rows, 3, 3))
        compute_kalman_gains(
            segment.time,
            segment.heading,
            increments.ahead,
            increments.aside,
            *lever,
            convert_noise_to_array(noise, segment.heading_measured),
            unknown_turns,
            gains,
            roots,
        )
        memory_shares = compute_noise_persistence(segment.time)
        path_filters.append(PathFilter(gains, roots, lever, memory_shares, unknown_turns))
    return tuple(path_filters)


def estimate_unknown_turns(
    dataset: DriveDataset, turned: Sequence[Array], noise: NoiseLevels, columns: tuple[str, str]
) -> list[Array]:
    """Return the variances (k - 1, rad2) of turns between rows for lack of a measured steering angle, per segment.

    The turns were simulated with the first of the `columns` (angle or command) that a segment has. Those of
    compute_unknown_turns hold for wheels that move in steps; where measured headings are nearer to the simulated turns
    (k - 1, rad), the wheels move more evenly, and all variances are less by one factor.
    """
    gaps = [_list_gaps(segment, columns) for segment in dataset.segments]
    variances = [compute_unknown_turns(*each) for each in zip(dataset.segments, turned, gaps, strict=True)]
    most = sum(float(part.sum()) for part in variances)
    if most == 0.0 or not all(segment.heading_measured for segment in dataset.segments):
        return variances
    squares = 0.0
    for segment, turns, part, pairs in zip(dataset.segments, turned, variances, gaps, strict=True):
        for first, last in pairs:
            if part[first] > 0.0:
                missed = segment.heading[last] - segment.heading[first] - float(turns[first:last].sum())
                squares += min(missed**2, OUTLIER_SIGMAS**2 * float(part[first:last].sum())) - 2.0 * noise.heading**2
    share = min(max(squares / most, LEAST_UNKNOWN_SHARE), 1.0)
    return [share * part for part in variances]


def compute_unknown_turns(segment: DriveSegment, turned: Array, gaps: Sequence[tuple[int, int]]) -> Array:
    """Return the variance (k - 1, rad2) of simulated turns (k - 1, rad) between rows for lack of a steering angle in
    gaps, pairs of rows in which it was measured.

    Between two measured angles the wheels are taken to move evenly, and may have moved at once at any time: a turn of
    rates that differ by r over T s is off by r T / sqrt(12), the standard deviation of a uniform distribution.
    """
    out, steps = np.zeros(len(turned)), np.diff(segment.time)
    rates = turned / steps
    for first, last in gaps:
        change = rates[min(last, len(rates) - 1)] - rates[first]
        out[first:last] = change**2 * (segment.time[last] - segment.time[first]) * steps[first:last] / 12.0
    return out


def _list_gaps(segment: DriveSegment, columns: tuple[str, str]) -> list[tuple[int, int]]:
    """Return pairs of rows with a measured steering angle, and rows without one in between."""
    has_column = {"angle": segment.wheel is not None, "command": segment.command is not None}
    measured = segment.measured_rows.get(columns[0] if has_column[columns[0]] else columns[1])
    knots = np.arange(segment.rows) if measured is None else np.flatnonzero(measured)
    return [(int(first), int(last)) for first, last in pairwise(knots) if last > first + 1]


def convert_noise_to_array(noise: NoiseLevels, heading_measured: bool) -> Array:
    """Return noise as an array for the filter; a heading that was not measured gets no weight."""
    heading = noise.heading if heading_measured else 1e3
    return np.array([noise.position, noise.position_drift, heading, noise.heading_drift, noise.soil, noise.along])


def build_channels(
    dataset: DriveDataset, rig: ReplayRig, settings: Settings
) -> tuple[tuple[ResidualChannel | None, ...], tuple[ResidualChannel | None, ...]]:
    """Estimate the weights of wheel and speed from their residuals: spread in steady driving, timing while moving,
    memory over all runs."""
    wheel: list[_ChannelErrors | None] = []
    speed: list[_ChannelErrors | None] = []
    for segment in dataset.segments:
        states = replay_segment(rig, segment, settings, from_sensor=False, from_speed=False)
        _, _, angle, pace = simulate_logged_values(rig, segment, states, settings)
        jitter = TIMING_S + _measure_command_interval(segment) / np.sqrt(12.0)
        wheel.append(
            _ChannelErrors(
                segment.wheel - angle,
                jitter * _compute_largest_rate(segment.time, angle),
                segment.measured_rows.get("wheel"),
            )
            if segment.wheel is not None and segment.command is not None
            else None
        )
        speed.append(
            _ChannelErrors(
                segment.speed - pace,
                TRANSIENT_S * _compute_largest_rate(segment.time, pace),
                segment.measured_rows.get("speed"),
            )
            if segment.target is not None
            else None
        )
    return _build_channels(wheel, 5e-4, 1.0), _build_channels(speed, 0.005, DRIVE_LINE_S / TRANSIENT_S)


@dataclass(frozen=True, eq=False)
class _ChannelErrors:
    """Measured minus simulated values (k,), their errors by timing, and the rows that count (None: all)."""

    deviation: Array
    timing_error: Array
    measured: Mask | None

    def select(self, values: Array) -> Array:
        """Return the values of the rows that count."""
        return values if self.measured is None else values[self.measured]


def _measure_command_interval(segment: DriveSegment) -> float:
    """Return the median time (s) between rows with a measured command."""
    measured = segment.measured_rows.get("command", np.ones(segment.rows, dtype=np.bool_))
    return float(np.median(np.diff(segment.time[measured] if np.count_nonzero(measured) > 1 else segment.time)))


def _compute_largest_rate(time: Array, values: Array) -> Array:
    """Return the largest rate within half a second of each row."""
    rate = np.abs(np.gradient(values, time))
    width = max(1, round(0.5 / float(np.median(np.diff(time)))))
    padded = np.pad(rate, width, mode="edge")
    out: Array = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).max(axis=1)
    return out


def _build_channels(
    segments: Sequence[_ChannelErrors | None], least_spread: float, share: float
) -> tuple[ResidualChannel | None, ...]:
    """Build the weights of all segments; a true model would have this `share` of the timing error as well."""
    known = [
        (errors.select(errors.deviation), errors.select(errors.timing_error))
        for errors in segments
        if errors is not None and (errors.measured is None or errors.measured.any())
    ]
    if not known:
        return tuple(None for _ in segments)
    moving = float(np.median(np.concatenate([timing_error for _, timing_error in known])))
    steady = np.concatenate([_subtract_median(deviation[error <= moving]) for deviation, error in known])
    low, high = np.quantile(steady, (0.16, 0.84))
    spread = max(0.5 * float(high - low), least_spread)
    scaled = [deviation / np.hypot(spread, timing_error) for deviation, timing_error in known]
    before, after = (
        np.concatenate([scaled_values[:-1] for scaled_values in scaled]),
        np.concatenate([scaled_values[1:] for scaled_values in scaled]),
    )
    clipped = [np.clip(part, -4.0, 4.0) for part in (before, after)]
    memory = float(clipped[0] @ clipped[1] / max(clipped[0] @ clipped[0], 1e-9))
    memory = min(max(memory, 0.0), MOST_MEMORY)
    innovations = apply_huber(
        (np.concatenate([scaled_values[1:] - memory * scaled_values[:-1] for scaled_values in scaled]))
        / np.sqrt(1.0 - memory * memory)
    )
    size = max(float(np.sqrt(np.mean(innovations * innovations))) if len(innovations) else 1.0, 0.3)
    return tuple(
        None
        if errors is None or (errors.measured is not None and not errors.measured.any())
        else ResidualChannel(
            size * np.hypot(spread, errors.timing_error),
            memory,
            np.hypot(spread, share * errors.timing_error),
            errors.measured,
        )
        for errors in segments
    )


def _subtract_median(values: Array) -> Array:
    """Return values about their median: differences between runs are not noise."""
    return values - np.median(values) if len(values) else values
