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

import numpy as np

from vehicle.identification.logs.schema import Array, Mask, Rows
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
    NoiseLevels,
    compute_kalman_gains,
    compute_noise_persistence,
    simulate_segment_increments,
)
from vehicle.identification.residuals.unknown_turns import (
    ANGLE_FIRST,
    compute_integrated_variance,
    compute_most_unknown_turns,
    estimate_unknown_turns,
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
MOST_UNKNOWN_SHARE = 0.25  # chosen, of the spread: the soil is seen while little else may have turned the tractor
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
    their own noise. What a slow column leaves unknown between its rows is no soil, which is seen while wheels are
    steady.
    """
    deviations = [_measure_deviation(rig, segment, settings) for segment in dataset.segments]
    unknown_turns = compute_most_unknown_turns(
        dataset, [deviation.simulated_turns for deviation in deviations], ANGLE_FIRST
    )
    span_estimates = [
        estimate
        for span in DIFFERENCE_SPANS_S
        if (estimate := _estimate_at_span(dataset, deviations, noise, span, unknown_turns)) is not None
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
    """Measured minus simulated pose of a segment, per row (k,): turn (rad), way (m); the pace, and whether it moves.

    `simulated_turns` (k - 1, rad) are those between rows.
    """

    turn: Array
    distance: Array
    pace: Array
    moving: Mask
    simulated_turns: Array


def _measure_deviation(rig: ReplayRig, segment: DriveSegment, settings: Settings) -> _PoseDeviation:
    """Compare a segment with its replay from measured wheel angle and speed."""
    states = replay_segment(rig, segment, settings, from_sensor=True, from_speed=True)
    antenna, heading = simulate_logged_antenna(rig, segment, states, settings)
    pace = np.interp(segment.time, segment.steps_s, np.abs(states[:, FORWARD_COLUMN]))
    moving = pace > 0.3 * max(float(np.median(pace)), 0.05)
    lead = _compute_along_path_lead(segment, antenna, heading)
    return _PoseDeviation(segment.heading - heading, lead, pace, moving, np.diff(heading))


def _estimate_at_span(
    dataset: DriveDataset,
    deviations: Sequence[_PoseDeviation],
    noise: NoiseLevels,
    span: float,
    unknown_turns: Sequence[Array],
) -> tuple[SpanEstimate | None, SpanEstimate] | None:
    """Estimate soil (rad per metre) and scatter along the path at one span; None with too few second differences.

    A heading derived from positions has their noise and shows no soil.
    """
    turn_differences, distance_differences, speeds, unknown = [], [], [], []
    for segment, deviation, variances in zip(dataset.segments, deviations, unknown_turns, strict=True):
        if segment.time[-1] < 4.0 * span:
            continue
        differences, keep = _compute_second_differences(segment, deviation.distance, deviation.moving, span)
        distance_differences.append(differences[keep])
        if segment.heading_measured:
            turn_differences.append(
                _compute_second_differences(segment, deviation.turn, deviation.moving, span)[0][keep]
            )
            middles = np.arange(len(differences)) * 0.25 * span + span
            speeds.append(np.interp(middles, segment.time, deviation.pace)[keep])
            summed = np.append(0.0, np.cumsum(variances))
            before, after = (np.interp(middles + side * span, segment.time, summed) for side in (-1.0, 1.0))
            unknown.append((after - before)[keep])
    if sum(map(len, distance_differences)) < FEWEST_DIFFERENCES:
        return None
    distance_estimate = _estimate_distance_scatter(np.concatenate(distance_differences), noise.position, span)
    if sum(map(len, turn_differences)) < FEWEST_DIFFERENCES:
        return None, distance_estimate
    turns = np.concatenate(turn_differences), np.concatenate(unknown)
    return _estimate_soil(*turns, np.concatenate(speeds), noise.heading, span), distance_estimate


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


def _estimate_soil(turn: Array, unknown: Array, pace: Array, heading_noise: float, span: float) -> SpanEstimate:
    """Return the soil (rad per metre) whose coloured disturbance has the measured spread of second differences at these
    paces; those with `unknown` variances (rad2) of turns that matter do not count."""
    known = _find_known_turns(turn, unknown)
    turn, pace = turn[known], pace[known]
    total_variance, instrument = _compute_robust_sigma(turn) ** 2, 6.0 * min(heading_noise, 1.0) ** 2
    spread = total_variance - instrument
    variance_once, variance_twice = compute_integrated_variance(span), compute_integrated_variance(2.0 * span)
    # Var(second difference) = 2 V(T) - 2 C with C = (V(2 T) - 2 V(T)) / 2 the covariance of neighbouring spans.
    unit = 2.0 * variance_once - (variance_twice - 2.0 * variance_once)
    soil = math.sqrt(max(spread, 0.0) / (unit * float(np.mean(pace**2)) + 1e-12))
    return SpanEstimate(
        min(max(soil, LEAST_SOIL_RAD_PER_M), MOST_SOIL_RAD_PER_M), instrument / max(total_variance, 1e-30)
    )


def _find_known_turns(turn: Array, unknown: Array) -> Rows:
    """Return the second differences (k,) whose unknown variances (k, rad2) are a small share of their spread, or those
    of which most is known, where these are few."""
    order = np.argsort(unknown, kind="stable")
    count = len(order)
    while count > FEWEST_DIFFERENCES:
        limit = MOST_UNKNOWN_SHARE * _compute_robust_sigma(turn[order[:count]]) ** 2
        fewer = max(int(np.searchsorted(unknown[order[:count]], limit, side="right")), FEWEST_DIFFERENCES)
        if fewer == count:
            break
        count = fewer
    return np.sort(order[:count])


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
    turns = estimate_unknown_turns(dataset, [move.turned for move in moves], noise, ANGLE_FIRST)
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
            rig.tractor.rear_axle_m,
            gains,
            roots,
        )
        memory_shares = compute_noise_persistence(segment.time)
        path_filters.append(PathFilter(gains, roots, lever, memory_shares, unknown_turns))
    return tuple(path_filters)


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
        interval_s = measure_reading_interval(segment)
        jitter, reach_s = TIMING_S + interval_s / np.sqrt(12.0), max(0.5, interval_s)
        wheel.append(
            _ChannelErrors(
                segment.wheel - angle,
                jitter * _compute_largest_rate(segment.time, angle, reach_s),
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


def measure_reading_interval(segment: DriveSegment, column: str = "command") -> float:
    """Return the median time (s) between rows with a measured command or wheel `angle`, of a slow one between those
    that differ."""
    measured, values = segment.measured_rows.get(column), segment.wheel if column == "angle" else segment.command
    if measured is None or values is None:
        return float(np.median(np.diff(segment.time)))
    knots = np.flatnonzero(measured)
    changes = np.diff(segment.time[knots])[np.diff(values[knots]) != 0.0]
    return float(np.median(changes if len(changes) else np.diff(segment.time)))


def _compute_largest_rate(time: Array, values: Array, reach_s: float = 0.5) -> Array:
    """Return the largest rate within so many seconds of each row."""
    rate = np.abs(np.gradient(values, time))
    width = max(1, round(reach_s / float(np.median(np.diff(time)))))
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
