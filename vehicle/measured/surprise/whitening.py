"""What is surprising about measured poses, given simulated increments: a Kalman filter used as a whitening filter.

The pose is a pure integrator, so an error of the simulation grows for ever while instruments are wrong by centimetres.
The filter knows both: soil that turns the tractor at random along the way, and receivers with white noise and slow
drift. Its innovations are the part of each measurement that neither explains, and are (nearly) independent; a cause
that acts for minutes stands out of them by far. The filter is linear in the simulated increments, because directions
are taken from the reference heading of the stretch; so the sensitivity of its output is the output of a sensitivity.

State: east, north of the centre of mass, heading minus reference, yaw disturbance per metre, drift of heading, east
and north.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.effects import PATH, SPEED, STEERING, STEP_HZ, Fields, effect_fields
from vehicle.instruments import late_rows, lever
from vehicle.jit import compiled, inlined
from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.keeping import key_of, of_blocks
from vehicle.measured.replay.replaying import Rig, replays
from vehicle.measured.replay.states import ANGLE, X, Y
from vehicle.series import cosine_sine

SIZE, SEEN = 7, 3  # numbers of the state and of a measurement
SOIL_MEMORY_S, DRIFT_MEMORY_S = 0.5, 60.0  # a rut or a clod at walking pace; what satellites and fixing let wander


@dataclass(frozen=True)
class Noise:
    """Standard deviations: white position and heading, their slow drifts, yaw disturbance of the soil, speed.

    Position in m, heading in rad, soil in rad per m driven, along in m per root second.
    """

    position: float
    position_drift: float
    heading: float
    heading_drift: float
    soil: float
    along: float


@compiled
def make_gains(  # type: ignore[no-untyped-def]
    time, reference, ahead, aside, lever_ahead, lever_aside, noise, gains, roots
) -> None:
    """Kalman gains (k, 7, 3) and inverse Cholesky roots (k, 3, 3) of the innovations' covariance.

    `ahead`, `aside` (k - 1,) are simulated displacements between rows in the tractor's frame, `noise` (6,) the fields
    of Noise in order.
    """
    cov = _first_covariance(noise)
    cross, low, other = np.empty((SIZE, SEEN)), np.zeros((SEEN, SEEN)), np.empty((SEEN, SEEN))
    for k in range(len(time)):
        cosine, sine = math.cos(reference[k]), math.sin(reference[k])
        lever_east, lever_north = lever(0.0, 0.0, cosine, sine, lever_ahead, lever_aside)
        for i in range(SIZE):
            cross[i, 0] = cov[i, 0] - lever_north * cov[i, 2] + cov[i, 5]
            cross[i, 1] = cov[i, 1] + lever_east * cov[i, 2] + cov[i, 6]
            cross[i, 2] = cov[i, 2] + cov[i, 4]
        for j in range(SEEN):
            other[0, j] = cross[0, j] - lever_north * cross[2, j] + cross[5, j]
            other[1, j] = cross[1, j] + lever_east * cross[2, j] + cross[6, j]
            other[2, j] = cross[2, j] + cross[4, j]
        other[0, 0] += noise[0] ** 2
        other[1, 1] += noise[0] ** 2
        other[2, 2] += noise[2] ** 2
        _inverse_root(other, low)
        roots[k] = low
        # The inverse of the covariance of what is seen, from its root.
        for i in range(SEEN):
            for j in range(SEEN):
                other[i, j] = low[0, i] * low[0, j] + low[1, i] * low[1, j] + low[2, i] * low[2, j]
        for i in range(SIZE):
            for j in range(SEEN):
                gains[k, i, j] = cross[i, 0] * other[0, j] + cross[i, 1] * other[1, j] + cross[i, 2] * other[2, j]
        for i in range(SIZE):
            for j in range(i + 1):
                cov[i, j] -= gains[k, i, 0] * cross[j, 0] + gains[k, i, 1] * cross[j, 1] + gains[k, i, 2] * cross[j, 2]
                cov[j, i] = cov[i, j]
        if k + 1 == len(time):
            break
        _moved_on(cov, ahead[k], aside[k], cosine, sine, time[k + 1] - time[k], noise)


@compiled
def _first_covariance(noise):  # type: ignore[no-untyped-def]
    """Covariance (7, 7) before the first measurement."""
    cov = np.zeros((SIZE, SIZE))
    cov[0, 0] = cov[1, 1] = 100.0 + noise[0] ** 2
    cov[2, 2] = 0.1**2
    cov[3, 3] = noise[4] ** 2
    cov[4, 4] = noise[3] ** 2
    cov[5, 5] = cov[6, 6] = noise[1] ** 2
    return cov


@compiled
def _inverse_root(square, out) -> None:  # type: ignore[no-untyped-def]
    """Inverse (3, 3) of the lower Cholesky root of a symmetric matrix; nothing is written above the diagonal."""
    a = math.sqrt(square[0, 0])
    b, c = square[1, 0] / a, square[2, 0] / a
    d = math.sqrt(square[1, 1] - b * b)
    e = (square[2, 1] - c * b) / d
    f = math.sqrt(square[2, 2] - c * c - e * e)
    out[0, 0], out[1, 1], out[2, 2] = 1.0 / a, 1.0 / d, 1.0 / f
    out[1, 0] = -b * out[0, 0] * out[1, 1]
    out[2, 1] = -e * out[1, 1] * out[2, 2]
    out[2, 0] = -(c * out[0, 0] + e * out[1, 0]) * out[2, 2]


@compiled
def _moved_on(cov, f, r, cosine, sine, dt, noise) -> None:  # type: ignore[no-untyped-def]
    """The covariance (7, 7) after the way to the next row, with what soil, drift and speed add to it."""
    to_east, to_north, distance = r * cosine - f * sine, f * cosine + r * sine, math.sqrt(f * f + r * r)
    soil, slow = math.exp(-dt / SOIL_MEMORY_S), math.exp(-dt / DRIFT_MEMORY_S)
    for j in range(SIZE):
        cov[0, j] += to_east * cov[2, j]
        cov[1, j] += to_north * cov[2, j]
        cov[2, j] += distance * cov[3, j]
        cov[3, j] *= soil
        for i in range(4, SIZE):
            cov[i, j] *= slow
    for i in range(SIZE):
        cov[i, 0] += to_east * cov[i, 2]
        cov[i, 1] += to_north * cov[i, 2]
        cov[i, 2] += distance * cov[i, 3]
        cov[i, 3] *= soil
        for j in range(4, SIZE):
            cov[i, j] *= slow
    for i in range(SIZE):  # what rounding parts
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


def fades(time: Array) -> Array:
    """Shares that the soil, then the drift of instruments keep from row to row (2, k - 1) at times (k, s)."""
    steps = np.diff(time)
    kept: Array = np.exp(-steps / np.array([[SOIL_MEMORY_S], [DRIFT_MEMORY_S]]))
    return kept


@inlined
def _corrected(gain, v0, v1, v2, e, n, h, soil, drift, drift_east, drift_north):  # type: ignore[no-untyped-def]
    """The state after what was seen parts from it by `v0`, `v1` and `v2`."""
    return (
        e + (gain[0, 0] * v0 + gain[0, 1] * v1 + gain[0, 2] * v2),
        n + (gain[1, 0] * v0 + gain[1, 1] * v1 + gain[1, 2] * v2),
        h + (gain[2, 0] * v0 + gain[2, 1] * v1 + gain[2, 2] * v2),
        soil + (gain[3, 0] * v0 + gain[3, 1] * v1 + gain[3, 2] * v2),
        drift + (gain[4, 0] * v0 + gain[4, 1] * v1 + gain[4, 2] * v2),
        drift_east + (gain[5, 0] * v0 + gain[5, 1] * v1 + gain[5, 2] * v2),
        drift_north + (gain[6, 0] * v0 + gain[6, 1] * v1 + gain[6, 2] * v2),
    )


@compiled
def innovations(  # type: ignore[no-untyped-def]
    kept, east, north, reference, ahead, aside, turned, lever_ahead, lever_aside, bias, gains, roots, out
) -> None:
    """Whitened innovations (k, 3) of measured antenna positions and headings, for simulated increments.

    `kept` (2, k - 1) are the shares of `fades`, `turned` (k - 1,) is the simulated change of heading between rows,
    `bias` the simulated heading error of the sensor. The measured heading is the reference itself.
    """
    rows = len(east)
    cosines, sines, ways = np.empty(rows), np.empty(rows), np.empty(rows)
    for k in range(rows):
        cosines[k], sines[k] = cosine_sine(reference[k])
    for k in range(rows - 1):
        ways[k] = math.sqrt(ahead[k] * ahead[k] + aside[k] * aside[k])
    lever_east, lever_north = lever(0.0, 0.0, cosines[0], sines[0], lever_ahead, lever_aside)
    e, n = east[0] - lever_east, north[0] - lever_north
    h = soil = drift = drift_east = drift_north = 0.0
    for k in range(rows):
        cosine, sine, root, gain = cosines[k], sines[k], roots[k], gains[k]
        lever_east, lever_north = lever(0.0, 0.0, cosine, sine, lever_ahead, lever_aside)
        v0 = east[k] - (e + lever_east - lever_north * h + drift_east)
        v1 = north[k] - (n + lever_north + lever_east * h + drift_north)
        v2 = -(h + drift + bias)
        out[k, 0] = root[0, 0] * v0
        out[k, 1] = root[1, 0] * v0 + root[1, 1] * v1
        out[k, 2] = root[2, 0] * v0 + root[2, 1] * v1 + root[2, 2] * v2
        if k + 1 == rows:
            break
        e, n, h, soil, drift, drift_east, drift_north = _corrected(
            gain, v0, v1, v2, e, n, h, soil, drift, drift_east, drift_north
        )
        f, r, slow = ahead[k], aside[k], kept[1, k]
        e += f * cosine + r * sine + (r * cosine - f * sine) * h
        n += f * sine - r * cosine + (f * cosine + r * sine) * h
        h += turned[k] - (reference[k + 1] - reference[k]) + soil * ways[k]
        soil *= kept[0, k]
        drift *= slow
        drift_east *= slow
        drift_north *= slow


@compiled
def turn_responses(  # type: ignore[no-untyped-def]
    time, reference, ahead, aside, lever_ahead, lever_aside, gains, roots, turned, out
) -> None:
    """Change of the innovations for additions to the simulated turns: `out` (k, 3, c) for `turned` (c, k - 1).

    What the filter does with turns does not depend on its state, so each addition is driven through it alone, from the
    first row that it changes. `out` is zero before; the arguments are those of innovations.
    """
    rows = len(time)
    known = np.empty((rows, 7))  # what depends on the row alone, once for all columns
    for k in range(rows):
        cosine, sine = math.cos(reference[k]), math.sin(reference[k])
        known[k, 0], known[k, 1] = lever(0.0, 0.0, cosine, sine, lever_ahead, lever_aside)
        if k + 1 < rows:
            f, r, dt = ahead[k], aside[k], time[k + 1] - time[k]
            known[k, 2], known[k, 3] = r * cosine - f * sine, f * cosine + r * sine
            known[k, 4] = math.sqrt(f * f + r * r)
            known[k, 5], known[k, 6] = math.exp(-dt / SOIL_MEMORY_S), math.exp(-dt / DRIFT_MEMORY_S)
    for column in range(len(turned)):
        first = 0
        while first < rows - 1 and turned[column, first] == 0.0:
            first += 1
        e = n = h = soil = drift = drift_east = drift_north = 0.0
        for k in range(first, rows):
            row = known[k]
            if k > first:
                lever_east, lever_north = row[0], row[1]
                v0 = -(e - lever_north * h + drift_east)
                v1 = -(n + lever_east * h + drift_north)
                v2 = -(h + drift)
                root, gain = roots[k], gains[k]
                out[k, 0, column] = root[0, 0] * v0
                out[k, 1, column] = root[1, 0] * v0 + root[1, 1] * v1
                out[k, 2, column] = root[2, 0] * v0 + root[2, 1] * v1 + root[2, 2] * v2
                e, n, h, soil, drift, drift_east, drift_north = _corrected(
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
class Increments:
    """Simulated motion between rows in the tractor's frame: ahead, to the right (m), turned (rad, mathematical)."""

    ahead: Array
    aside: Array
    turned: Array


def increments(x: Array, y: Array, angle: Array) -> Increments:
    """Increments of a simulated centre of mass, from poses per row."""
    out = np.empty((3, len(x) - 1))
    _increase(x, y, angle, out)
    return Increments(*out)


@compiled
def _increase(x, y, angle, out) -> None:  # type: ignore[no-untyped-def]
    """Increments (3, k - 1) of poses (k,)."""
    ahead, aside, turned = out[0], out[1], out[2]
    for k in range(len(x) - 1):
        cosine, sine = cosine_sine(angle[k])
        dx, dy = x[k + 1] - x[k], y[k + 1] - y[k]
        ahead[k], aside[k] = dx * cosine + dy * sine, dx * sine - dy * cosine
    for k in range(len(x) - 1):
        turned[k] = angle[k + 1] - angle[k]


def simulated_increments(rig: Rig, stretch: Stretch, settings: Settings) -> Increments:
    """Increments between the rows of a stretch, replayed from measured wheel angle and speed and seen as late as the
    settings say."""
    return all_increments(rig, [stretch], settings)[0]


def all_increments(rig: Rig, stretches: Sequence[Stretch], settings: Settings) -> list[Increments]:
    """The increments of simulated_increments for many stretches."""
    return increments_of_each(rig, stretches, [settings])[0]


def increments_of_each(rig: Rig, stretches: Sequence[Stretch], each: Sequence[Settings]) -> list[list[Increments]]:
    """The increments of all_increments for many settings, all of them driven side by side."""
    asked = [one for settings in each for one in _asked(rig, stretches, settings)]
    found = {one.key: rig.kept.find(one.key) for one in asked}
    missing = list({one.key: one for one in asked if found[one.key] is None}.values())
    states = replays(rig, [(one.stretch, one.settings) for one in missing], from_sensor=True, from_speed=True)
    for one, driven in zip(missing, states, strict=True):
        found[one.key] = rig.kept.keep(one.key, _moved(rig, one, driven))
    made = [Increments(*kept) for one in asked if (kept := found[one.key]) is not None]
    return [made[first : first + len(stretches)] for first in range(0, len(made), len(stretches))]


@dataclass(frozen=True, eq=False)
class _Asked:
    """Increments that are asked for: a stretch, settings with their fields, and the key they are kept under."""

    stretch: Stretch
    settings: Settings
    fields: Fields
    key: Hashable


def _asked(rig: Rig, stretches: Sequence[Stretch], settings: Settings) -> list[_Asked]:
    """What is asked for of all stretches with the same settings."""
    fields = effect_fields(settings)
    acting = key_of(of_blocks(settings, frozenset({PATH, STEERING, SPEED})))
    under = ("increments", tuple(rig.ranges.items()), fields["latency"], acting)
    return [_Asked(stretch, settings, fields, (stretch, *under)) for stretch in stretches]


def _moved(rig: Rig, asked: _Asked, states: Array) -> tuple[Array, Array, Array]:
    """Increments of states (n, 5), seen as late as is asked for."""
    stretch, late_s, late = asked.stretch, asked.fields["latency"] / STEP_HZ, np.empty((3, asked.stretch.rows))
    late_rows(stretch.time, stretch.steps_s, states[:, X], states[:, Y], states[:, ANGLE], late_s, *late)
    move = increments(*late)
    return move.ahead, move.aside, move.turned
