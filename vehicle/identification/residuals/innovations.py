"""Innovations of measured poses given simulated increments: a Kalman filter used as a whitening filter.

The pose is a pure integrator, so an error of the simulation grows without bound while instruments are wrong by
centimetres. The filter models both: soil that turns the tractor at random, and receivers with white noise and slow
drift. Its innovations are the part of each measurement that neither explains, and are (nearly) independent; a cause
that acts for minutes stands out clearly. The filter is linear in the simulated increments, because directions are taken
from the reference heading of the segment; so the sensitivity of its output is the output for a sensitivity.

State: east, north of the centre of mass, heading minus reference, yaw disturbance per metre, drift of heading, east and
north.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.errors import VehicleError
from vehicle.fast_math import compute_cosine_sine
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.instrument_timing import compute_shown_headings, compute_timing, extract_timing
from vehicle.identification.replay.rig import ReplayRig, replay_segments
from vehicle.identification.replay.state_cache import (
    ANGLE_COLUMN,
    X_COLUMN,
    Y_COLUMN,
    make_settings_key,
    split_settings_by_block,
)
from vehicle.jit import compile_function, inline_function
from vehicle.model.effects import PATH, SPEED, STEERING, Fields, compute_effect_fields
from vehicle.model.instruments import apply_lever_arm, write_delayed_poses
from vehicle.model.tractor import Settings

STATE_SIZE, MEASUREMENT_SIZE = 7, 3  # sizes of the state and of a measurement
SOIL_MEMORY_S, DRIFT_MEMORY_S = 0.5, 60.0  # a rut or a clod at walking pace; drift of satellite positions


@dataclass(frozen=True)
class NoiseLevels:
    """Standard deviations: white position and heading, their slow drifts, yaw disturbance of the soil, speed.

    Position in m, heading in rad, soil in rad per m driven, along in m per root second.
    """

    position: float
    position_drift: float
    heading: float
    heading_drift: float
    soil: float
    along: float


@compile_function
def compute_kalman_gains(  # type: ignore[no-untyped-def]
    time, reference, ahead, aside, lever_ahead, lever_aside, noise, unknown_turns, axle_behind, gains, roots
) -> None:
    """Compute Kalman gains (k, 7, 3) and inverse Cholesky roots (k, 3, 3) of the innovation covariance.

    `ahead`, `aside` (k - 1,) are simulated displacements between rows in the tractor's frame, `noise` (6,) the fields
    of NoiseLevels in order, `unknown_turns` (k - 1,) variances (rad2) of simulated turns whose wheel angle is a guess;
    they are about the rear axle, so far behind the centre of mass (m).
    """
    cov = _make_first_covariance(noise)
    cross_cov, root, innovation_cov = (
        np.empty((STATE_SIZE, MEASUREMENT_SIZE)),
        np.zeros((MEASUREMENT_SIZE, MEASUREMENT_SIZE)),
        np.empty((MEASUREMENT_SIZE, MEASUREMENT_SIZE)),
    )
    for k in range(len(time)):
        cosine, sine = math.cos(reference[k]), math.sin(reference[k])
        lever_east, lever_north = apply_lever_arm(0.0, 0.0, cosine, sine, lever_ahead, lever_aside)
        for i in range(STATE_SIZE):
            cross_cov[i, 0] = cov[i, 0] - lever_north * cov[i, 2] + cov[i, 5]
            cross_cov[i, 1] = cov[i, 1] + lever_east * cov[i, 2] + cov[i, 6]
            cross_cov[i, 2] = cov[i, 2] + cov[i, 4]
        for j in range(MEASUREMENT_SIZE):
            innovation_cov[0, j] = cross_cov[0, j] - lever_north * cross_cov[2, j] + cross_cov[5, j]
            innovation_cov[1, j] = cross_cov[1, j] + lever_east * cross_cov[2, j] + cross_cov[6, j]
            innovation_cov[2, j] = cross_cov[2, j] + cross_cov[4, j]
        innovation_cov[0, 0] += noise[0] ** 2
        innovation_cov[1, 1] += noise[0] ** 2
        innovation_cov[2, 2] += noise[2] ** 2
        _compute_inverse_root(innovation_cov, root)
        roots[k] = root
        # The inverse of the innovation covariance, from its root.
        for i in range(MEASUREMENT_SIZE):
            for j in range(MEASUREMENT_SIZE):
                innovation_cov[i, j] = root[0, i] * root[0, j] + root[1, i] * root[1, j] + root[2, i] * root[2, j]
        for i in range(STATE_SIZE):
            for j in range(MEASUREMENT_SIZE):
                gains[k, i, j] = (
                    cross_cov[i, 0] * innovation_cov[0, j]
                    + cross_cov[i, 1] * innovation_cov[1, j]
                    + cross_cov[i, 2] * innovation_cov[2, j]
                )
        for i in range(STATE_SIZE):
            for j in range(i + 1):
                cov[i, j] -= (
                    gains[k, i, 0] * cross_cov[j, 0]
                    + gains[k, i, 1] * cross_cov[j, 1]
                    + gains[k, i, 2] * cross_cov[j, 2]
                )
                cov[j, i] = cov[i, j]
        if k + 1 == len(time):
            break
        _propagate_covariance(cov, ahead[k], aside[k], cosine, sine, time[k + 1] - time[k], noise)
        pushed_east, pushed_north = -axle_behind * sine, axle_behind * cosine  # by a turn of 1 rad
        cov[0, 0] += pushed_east * pushed_east * unknown_turns[k]
        cov[1, 1] += pushed_north * pushed_north * unknown_turns[k]
        cov[2, 2] += unknown_turns[k]
        for i, j, product in (
            (0, 1, pushed_east * pushed_north),
            (0, 2, pushed_east),
            (1, 2, pushed_north),
        ):
            cov[i, j] += product * unknown_turns[k]
            cov[j, i] += product * unknown_turns[k]


@compile_function
def _make_first_covariance(noise):  # type: ignore[no-untyped-def]
    """Return the covariance (7, 7) before the first measurement."""
    cov = np.zeros((STATE_SIZE, STATE_SIZE))
    cov[0, 0] = cov[1, 1] = 100.0 + noise[0] ** 2
    cov[2, 2] = 0.1**2
    cov[3, 3] = noise[4] ** 2
    cov[4, 4] = noise[3] ** 2
    cov[5, 5] = cov[6, 6] = noise[1] ** 2
    return cov


@compile_function
def _compute_inverse_root(square, out) -> None:  # type: ignore[no-untyped-def]
    """Return the inverse (3, 3) of the lower Cholesky root of a symmetric matrix; the upper triangle is not written."""
    a = math.sqrt(square[0, 0])
    b, c = square[1, 0] / a, square[2, 0] / a
    d = math.sqrt(square[1, 1] - b * b)
    e = (square[2, 1] - c * b) / d
    f = math.sqrt(square[2, 2] - c * c - e * e)
    out[0, 0], out[1, 1], out[2, 2] = 1.0 / a, 1.0 / d, 1.0 / f
    out[1, 0] = -b * out[0, 0] * out[1, 1]
    out[2, 1] = -e * out[1, 1] * out[2, 2]
    out[2, 0] = -(c * out[0, 0] + e * out[1, 0]) * out[2, 2]


@compile_function
def _propagate_covariance(cov, forward, right, cosine, sine, dt, noise) -> None:  # type: ignore[no-untyped-def]
    """Propagate the covariance (7, 7) to the next row, with the noise of soil, drift and speed."""
    to_east, to_north, distance = (
        right * cosine - forward * sine,
        forward * cosine + right * sine,
        math.sqrt(forward * forward + right * right),
    )
    soil, slow = math.exp(-dt / SOIL_MEMORY_S), math.exp(-dt / DRIFT_MEMORY_S)
    for j in range(STATE_SIZE):
        cov[0, j] += to_east * cov[2, j]
        cov[1, j] += to_north * cov[2, j]
        cov[2, j] += distance * cov[3, j]
        cov[3, j] *= soil
        for i in range(4, STATE_SIZE):
            cov[i, j] *= slow
    for i in range(STATE_SIZE):
        cov[i, 0] += to_east * cov[i, 2]
        cov[i, 1] += to_north * cov[i, 2]
        cov[i, 2] += distance * cov[i, 3]
        cov[i, 3] *= soil
        for j in range(4, STATE_SIZE):
            cov[i, j] *= slow
    for i in range(STATE_SIZE):  # symmetric despite rounding
        for j in range(i):
            cov[i, j] = cov[j, i] = 0.5 * (cov[i, j] + cov[j, i])
    cov[3, 3] += noise[4] ** 2 * (1.0 - soil * soil)
    cov[4, 4] += noise[3] ** 2 * (1.0 - slow * slow)
    cov[5, 5] += noise[1] ** 2 * (1.0 - slow * slow)
    cov[6, 6] += noise[1] ** 2 * (1.0 - slow * slow)
    push, side = noise[5] ** 2 * dt, (0.1 * noise[5]) ** 2 * dt
    cov[0, 0] += push * cosine * cosine + side * sine * sine
    cov[1, 1] += push * sine * sine + side * cosine * cosine
    cov[0, 1] += (push - side) * cosine * sine
    cov[1, 0] += (push - side) * cosine * sine


def compute_noise_persistence(time: Array) -> Array:
    """Return the shares of soil and instrument drift that persist from row to row (2, k - 1) at times (k, s)."""
    steps = np.diff(time)
    shares: Array = np.exp(-steps / np.array([[SOIL_MEMORY_S], [DRIFT_MEMORY_S]]))
    return shares


@inline_function
def _correct_state(gain, v0, v1, v2, e, n, h, soil, drift, drift_east, drift_north):  # type: ignore[no-untyped-def]
    """Correct the state by the innovations `v0`, `v1` and `v2`."""
    return (
        e + (gain[0, 0] * v0 + gain[0, 1] * v1 + gain[0, 2] * v2),
        n + (gain[1, 0] * v0 + gain[1, 1] * v1 + gain[1, 2] * v2),
        h + (gain[2, 0] * v0 + gain[2, 1] * v1 + gain[2, 2] * v2),
        soil + (gain[3, 0] * v0 + gain[3, 1] * v1 + gain[3, 2] * v2),
        drift + (gain[4, 0] * v0 + gain[4, 1] * v1 + gain[4, 2] * v2),
        drift_east + (gain[5, 0] * v0 + gain[5, 1] * v1 + gain[5, 2] * v2),
        drift_north + (gain[6, 0] * v0 + gain[6, 1] * v1 + gain[6, 2] * v2),
    )


@compile_function
def compute_innovations(  # type: ignore[no-untyped-def]
    memory_shares, east, north, reference, ahead, aside, turned, lever_ahead, lever_aside, bias, gains, roots, out
) -> None:
    """Whitened innovations (k, 3) of measured antenna positions and headings, for simulated increments.

    `kept` (2, k - 1) are the shares of compute_noise_persistence, `turned` (k - 1,) is the simulated change of heading
    between rows, `bias` the simulated heading error of the sensor. The measured heading is the reference itself.
    """
    rows = len(east)
    cosines, sines, distances = np.empty(rows), np.empty(rows), np.empty(rows)
    for k in range(rows):
        cosines[k], sines[k] = compute_cosine_sine(reference[k])
    for k in range(rows - 1):
        distances[k] = math.sqrt(ahead[k] * ahead[k] + aside[k] * aside[k])
    lever_east, lever_north = apply_lever_arm(0.0, 0.0, cosines[0], sines[0], lever_ahead, lever_aside)
    e, n = east[0] - lever_east, north[0] - lever_north
    h = soil = drift = drift_east = drift_north = 0.0
    for k in range(rows):
        cosine, sine, root, gain = cosines[k], sines[k], roots[k], gains[k]
        lever_east, lever_north = apply_lever_arm(0.0, 0.0, cosine, sine, lever_ahead, lever_aside)
        v0 = east[k] - (e + lever_east - lever_north * h + drift_east)
        v1 = north[k] - (n + lever_north + lever_east * h + drift_north)
        v2 = -(h + drift + bias)
        out[k, 0] = root[0, 0] * v0
        out[k, 1] = root[1, 0] * v0 + root[1, 1] * v1
        out[k, 2] = root[2, 0] * v0 + root[2, 1] * v1 + root[2, 2] * v2
        if k + 1 == rows:
            break
        e, n, h, soil, drift, drift_east, drift_north = _correct_state(
            gain, v0, v1, v2, e, n, h, soil, drift, drift_east, drift_north
        )
        f, r, slow = ahead[k], aside[k], memory_shares[1, k]
        e += f * cosine + r * sine + (r * cosine - f * sine) * h
        n += f * sine - r * cosine + (f * cosine + r * sine) * h
        h += turned[k] - (reference[k + 1] - reference[k]) + soil * distances[k]
        soil *= memory_shares[0, k]
        drift *= slow
        drift_east *= slow
        drift_north *= slow


@compile_function
def compute_turn_responses(  # type: ignore[no-untyped-def]
    time, reference, ahead, aside, lever_ahead, lever_aside, gains, roots, turned, out
) -> None:
    """Change of the innovations for additions to the simulated turns: `out` (k, 3, c) for `turned` (c, k - 1).

    The response to turns does not depend on the state, so only the additions pass through the filter, from the first
    row that they change. `out` is zero before; the arguments are those of compute_innovations.
    """
    rows = len(time)
    row_values = np.empty((rows, 7))  # values that depend on the row alone, once for all columns
    for k in range(rows):
        cosine, sine = math.cos(reference[k]), math.sin(reference[k])
        row_values[k, 0], row_values[k, 1] = apply_lever_arm(0.0, 0.0, cosine, sine, lever_ahead, lever_aside)
        if k + 1 < rows:
            f, r, dt = ahead[k], aside[k], time[k + 1] - time[k]
            row_values[k, 2], row_values[k, 3] = r * cosine - f * sine, f * cosine + r * sine
            row_values[k, 4] = math.sqrt(f * f + r * r)
            row_values[k, 5], row_values[k, 6] = math.exp(-dt / SOIL_MEMORY_S), math.exp(-dt / DRIFT_MEMORY_S)
    for column in range(len(turned)):
        first = 0
        while first < rows - 1 and turned[column, first] == 0.0:
            first += 1
        e = n = h = soil = drift = drift_east = drift_north = 0.0
        for k in range(first, rows):
            row = row_values[k]
            if k > first:
                lever_east, lever_north = row[0], row[1]
                v0 = -(e - lever_north * h + drift_east)
                v1 = -(n + lever_east * h + drift_north)
                v2 = -(h + drift)
                root, gain = roots[k], gains[k]
                out[k, 0, column] = root[0, 0] * v0
                out[k, 1, column] = root[1, 0] * v0 + root[1, 1] * v1
                out[k, 2, column] = root[2, 0] * v0 + root[2, 1] * v1 + root[2, 2] * v2
                e, n, h, soil, drift, drift_east, drift_north = _correct_state(
                    gain, v0, v1, v2, e, n, h, soil, drift, drift_east, drift_north
                )
            if k + 1 == rows:
                break
            e += row[2] * h
            n += row[3] * h
            h += turned[column, k] + soil * row[4]
            soil *= row[5]
            slow = row[6]
            drift *= slow
            drift_east *= slow
            drift_north *= slow


@dataclass(frozen=True, eq=False)
class PoseIncrements:
    """Simulated motion between rows in the tractor's frame: ahead, to the right (m), turned (rad, mathematical)."""

    ahead: Array
    aside: Array
    turned: Array


def compute_increments(x: Array, y: Array, angle: Array) -> PoseIncrements:
    """Compute the increments of a simulated centre of mass from poses per row."""
    out = np.empty((3, len(x) - 1))
    _fill_increments(x, y, angle, out)
    return PoseIncrements(*out)


@compile_function
def _fill_increments(x, y, angle, out) -> None:  # type: ignore[no-untyped-def]
    """Write the increments (3, k - 1) of poses (k,)."""
    ahead, aside, turned = out[0], out[1], out[2]
    for k in range(len(x) - 1):
        cosine, sine = compute_cosine_sine(angle[k])
        dx, dy = x[k + 1] - x[k], y[k + 1] - y[k]
        ahead[k], aside[k] = dx * cosine + dy * sine, dx * sine - dy * cosine
    for k in range(len(x) - 1):
        turned[k] = angle[k + 1] - angle[k]


def simulate_segment_increments(rig: ReplayRig, segment: DriveSegment, settings: Settings) -> PoseIncrements:
    """Simulate increments between the rows of a segment from measured wheel angle and speed, with the latency of the
    settings."""
    return simulate_all_increments(rig, [segment], settings)[0]


def simulate_all_increments(
    rig: ReplayRig, segments: Sequence[DriveSegment], settings: Settings
) -> list[PoseIncrements]:
    """Return the increments of simulate_segment_increments for many segments."""
    return simulate_increments_of_each(rig, segments, [settings])[0]


def refuse_spinning_simulation(rig: ReplayRig, segments: Sequence[DriveSegment]) -> None:
    """Raise VehicleError where the simulation turns by more than half a turn between two rows, as no vehicle does."""
    turned = np.concatenate([np.zeros(1), *(part.turned for part in simulate_all_increments(rig, segments, {}))])
    if not float(np.max(np.abs(turned))) <= math.pi:  # a value that is no number is more, too
        raise VehicleError(
            f"The simulation of {rig.tractor.name} spins where these logs drive; the axles, the mass, the length and "
            "the width in its tractor file cannot be those of one vehicle."
        )


def simulate_increments_of_each(
    rig: ReplayRig, segments: Sequence[DriveSegment], settings_list: Sequence[Settings]
) -> list[list[PoseIncrements]]:
    """Return the increments of simulate_all_increments for many settings, all driven side by side."""
    requests = [request for settings in settings_list for request in _build_increment_requests(rig, segments, settings)]
    cached = {request.key: rig.cache.find_cached_arrays(request.key) for request in requests}
    missing = list({request.key: request for request in requests if cached[request.key] is None}.values())
    states = replay_segments(
        rig, [(request.segment, request.settings) for request in missing], from_sensor=True, from_speed=True
    )
    for request, segment_states in zip(missing, states, strict=True):
        cached[request.key] = rig.cache.store(request.key, _compute_delayed_increments(rig, request, segment_states))
    increments = [PoseIncrements(*arrays) for request in requests if (arrays := cached[request.key]) is not None]
    return [increments[first : first + len(segments)] for first in range(0, len(increments), len(segments))]


@dataclass(frozen=True, eq=False)
class _IncrementRequest:
    """Requested increments: a segment, settings, derived values, and the cache key."""

    segment: DriveSegment
    settings: Settings
    fields: Fields
    key: Hashable


def _build_increment_requests(
    rig: ReplayRig, segments: Sequence[DriveSegment], settings: Settings
) -> list[_IncrementRequest]:
    """Build the requests of all segments with the same settings."""
    fields = compute_effect_fields(settings)
    acting_key = make_settings_key(split_settings_by_block(settings, frozenset({PATH, STEERING, SPEED})))
    timing = extract_timing(fields)
    inputs = timing.speed_s, timing.speed_scale, timing.steering_s, timing.command_s
    key_parts = ("increments", tuple(rig.ranges.items()), timing.position_s, inputs, acting_key)
    return [_IncrementRequest(segment, settings, fields, (segment, *key_parts)) for segment in segments]


def _compute_delayed_increments(
    rig: ReplayRig, request: _IncrementRequest, states: Array
) -> tuple[Array, Array, Array]:
    """Return the increments of states (n, 5) with the requested latency."""
    segment, late_s, observed = (
        request.segment,
        extract_timing(request.fields).position_s,
        np.empty((3, request.segment.rows)),
    )
    write_delayed_poses(
        segment.time,
        segment.steps_s,
        states[:, X_COLUMN],
        states[:, Y_COLUMN],
        states[:, ANGLE_COLUMN],
        late_s,
        *observed,
    )
    increments_out = compute_increments(*observed)
    return increments_out.ahead, increments_out.aside, increments_out.turned


def compute_reference_headings(rig: ReplayRig, segments: Sequence[DriveSegment], settings: Settings) -> list[Array]:
    """Return the measured headings (k,) of segments as they would be at the times of the positions.

    Headings that are younger, older or smoothed differ from those by what the simulation turns in between.
    """
    timing = compute_timing(settings)
    if timing.is_heading_as_old:
        return [segment.heading for segment in segments]
    states = replay_segments(rig, [(segment, settings) for segment in segments], from_sensor=True, from_speed=True)
    as_old = replace(timing, heading_s=timing.position_s, heading_filter_s=0.0)
    references = []
    for segment, segment_states in zip(segments, states, strict=True):
        angles = segment_states[:, ANGLE_COLUMN]
        if not segment.heading_measured:
            references.append(segment.heading)
            continue
        lead = compute_shown_headings(segment, angles, timing) - compute_shown_headings(segment, angles, as_old)
        references.append(segment.heading - lead)
    return references
