"""How rough the ground and how noisy the speed is, told from changes too quick for any effect of the catalogue.

Second differences over a few seconds of the difference between measured and simulated heading: a wheel that stands
wrong, a slope or a draft turns the tractor evenly and drops out, the soil and the receiver do not. So the noise is
known before any cause is, and what a cause leaves unexplained does not pass for rough ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array, Mask
from vehicle.measured.replay.course import Course, Stretch
from vehicle.measured.replay.replaying import Rig, antenna_seen, replay
from vehicle.measured.replay.states import FORWARD
from vehicle.measured.surprise.whitening import SOIL_MEMORY_S, Noise
from vehicle.measured.thresholds import LEAST_ALONG, LEAST_SOIL, MOST_SOIL

SPANS_S = (1.0, 2.0, 4.0)  # longer than the soil's memory, shorter than any cause that acts evenly
DROWNED = 0.6  # chosen, of the spread of second differences: what is left of it says little with more of the noise
SAMPLES = 30  # second differences: the median deviation of fewer is off by a fifth and more


@dataclass(frozen=True)
class Told:
    """What one span tells of a noise, and the share of the instruments in the spread it is told from."""

    value: float
    drowned: float


def first_noise(course: Course) -> Noise:
    """White noise of positions and headings; the soil as an ordinary field has it."""
    position, heading = [], []
    for one in course.stretches:
        position += [white_noise(one.time, one.east), white_noise(one.time, one.north)]
        if one.heading_seen:
            heading.append(white_noise(one.time, one.heading))
    p = max(float(np.median(position)), 2e-4)
    h = max(float(np.median(heading)), 2e-4) if heading else 1e3
    return Noise(p, 1.5 * p, h, min(1.0 * h, 0.1), 0.0025, 0.01)


def white_noise(time: Array, values: Array) -> float:
    """Standard deviation of white noise on a smooth signal (k,), robustly: what four rows are off a parabola.

    Third divided differences, which no parabola changes however uneven the times are.
    """
    t = np.lib.stride_tricks.sliding_window_view(time, 4)
    apart = t[:, :, None] - t[:, None, :] + np.eye(4)
    weights = 1.0 / apart.prod(axis=2)
    left = (weights * np.lib.stride_tricks.sliding_window_view(values, 4)).sum(axis=1)
    scaled = left / np.sqrt((weights * weights).sum(axis=1))
    return float(1.4826 * np.median(np.abs(scaled - np.median(scaled))))


def tuned(course: Course, rig: Rig, noise: Noise, settings: Settings) -> Noise:
    """Noise with soil and speed scatter as the second differences give them; as it was where nothing can be told.

    Where no heading was measured the soil stays as it was. The least of three spans counts: what comes and goes at the
    beat of one span drops out of another. Only, where the instruments make up most of the spread, what they leave for
    the soil is the error of their own noise.
    """
    off = [_off(rig, stretch, settings) for stretch in course.stretches]
    told = [one for span in SPANS_S if (one := _at_span(course, off, noise, span)) is not None]
    if not told:
        return noise
    soils, ways = [[one for one in column if one is not None] for column in zip(*told, strict=True)]
    return replace(noise, soil=_least(soils) if soils else noise.soil, along=_least(ways))


def _least(told: Sequence[Told]) -> float:
    """The least that spans tell, the longest of them where instruments drown every one."""
    clear = [one.value for one in told if one.drowned < DROWNED]
    return min(clear) if clear else told[-1].value


@dataclass(frozen=True, eq=False)
class _Off:
    """What a stretch has beyond its simulation, per row (k,): turn (rad), way (m); the pace, and whether it moves."""

    turn: Array
    way: Array
    pace: Array
    moving: Mask


def _off(rig: Rig, stretch: Stretch, settings: Settings) -> _Off:
    """A stretch against its replay from measured wheel angle and speed."""
    states = replay(rig, stretch, settings, from_sensor=True, from_speed=True)
    antenna, heading = antenna_seen(rig, stretch, states, settings)
    pace = np.interp(stretch.time, stretch.steps_s, np.abs(states[:, FORWARD]))
    moving = pace > 0.3 * max(float(np.median(pace)), 0.05)
    return _Off(stretch.heading - heading, _along(stretch, antenna, heading), pace, moving)


def _at_span(course: Course, off: Sequence[_Off], noise: Noise, span: float) -> tuple[Told | None, Told] | None:
    """Soil (rad per metre) and scatter of the way that one span tells; None with too few second differences.

    What was not measured tells no soil: a heading made of positions has their noise.
    """
    turns, ways, speeds = [], [], []
    for stretch, one in zip(course.stretches, off, strict=True):
        if stretch.time[-1] < 4.0 * span:
            continue
        way, keep = _second(stretch, one.way, one.moving, span)
        ways.append(way[keep])
        if stretch.heading_seen:
            turns.append(_second(stretch, one.turn, one.moving, span)[0][keep])
            speeds.append(np.interp(np.arange(len(way)) * 0.25 * span + span, stretch.time, one.pace)[keep])
    if sum(map(len, ways)) < SAMPLES:
        return None
    way_told = _way(np.concatenate(ways), noise.position, span)
    if sum(map(len, turns)) < SAMPLES:
        return None, way_told
    return _soil(np.concatenate(turns), np.concatenate(speeds), noise.heading, span), way_told


def _second(stretch: Stretch, values: Array, moving: Mask, span: float) -> tuple[Array, Mask]:
    """Second differences over a span, and which of them lie in motion throughout."""
    grid = np.arange(0.0, stretch.time[-1], 0.25 * span)
    on = np.interp(grid, stretch.time, moving.astype(np.float64)) > 0.99
    sampled = np.interp(grid, stretch.time, values)
    lag = 4
    return sampled[2 * lag :] - 2.0 * sampled[lag:-lag] + sampled[: -2 * lag], on[2 * lag :] & on[lag:-lag] & on[
        : -2 * lag
    ]


def _along(stretch: Stretch, antenna: Array, heading: Array) -> Array:
    """How much further the measured antenna has come than the simulated one, along its way."""
    de, dn = np.diff(stretch.east), np.diff(stretch.north)
    cosine, sine = np.cos(stretch.heading[:-1]), np.sin(stretch.heading[:-1])
    simulated = np.diff(antenna, axis=0)
    back, side = np.cos(heading[:-1]), np.sin(heading[:-1])
    gained = de * cosine + dn * sine - simulated[:, 0] * back - simulated[:, 1] * side
    out: Array = np.concatenate([[0.0], np.cumsum(gained)])
    return out


def _soil(turn: Array, pace: Array, heading_noise: float, span: float) -> Told:
    """Soil (rad per metre) whose coloured disturbance spreads the second differences as seen, at the paces driven."""
    whole, instrument = _robust(turn) ** 2, 6.0 * min(heading_noise, 1.0) ** 2
    spread = whole - instrument
    one, two = _integrated(span), _integrated(2.0 * span)
    # Var(second difference) = 2 V(T) - 2 C with C = (V(2 T) - 2 V(T)) / 2 the covariance of neighbouring spans.
    unit = 2.0 * one - (two - 2.0 * one)
    soil = math.sqrt(max(spread, 0.0) / (unit * float(np.mean(pace**2)) + 1e-12))
    return Told(min(max(soil, LEAST_SOIL), MOST_SOIL), instrument / max(whole, 1e-30))


def _integrated(span: float) -> float:
    """Variance of the integral of unit noise with a memory over a span: 2 m^2 (T / m - 1 + exp(-T / m))."""
    memory = SOIL_MEMORY_S
    return 2.0 * memory * memory * (span / memory - 1.0 + math.exp(-span / memory))


def _way(way: Array, position_noise: float, span: float) -> Told:
    whole, instrument = _robust(way) ** 2, 6.0 * position_noise**2
    scatter = math.sqrt(max(whole - instrument, 0.0) / (2.0 * span))
    return Told(max(scatter, LEAST_ALONG), instrument / max(whole, 1e-30))


def _robust(values: Array) -> float:
    return float(1.4826 * np.median(np.abs(values - np.median(values))))
