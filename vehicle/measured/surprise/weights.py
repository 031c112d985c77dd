"""How much each difference between a log and a simulation weighs: filters of the path, spreads of wheel and speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.effects import effect_fields
from vehicle.jit import compiled
from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Course
from vehicle.measured.replay.replaying import Rig, antenna_lever, replay, seen
from vehicle.measured.surprise.whitening import Noise, fades, make_gains, simulated_increments
from vehicle.measured.thresholds import DRIVE_LINE_S, MOST_MEMORY, OUTLIER, TIMING_S, TRANSIENT_S


@dataclass(frozen=True, eq=False)
class Filter:
    """Gains and roots of one stretch, and what its rows keep of the rows before (see whitening.fades)."""

    gains: Array
    roots: Array
    lever: tuple[float, float]
    kept: Array


@dataclass(frozen=True, eq=False)
class Channel:
    """Weights of a directly compared channel of one stretch: standard deviation per row and memory from row to row.

    `scatter` is the part of the standard deviation that a true model would leave: how far the channel scatters in a run
    while nothing changes, and how far commands and drive lines are off in time.
    """

    sigma: Array
    memory: float
    scatter: Array


def huber(values: Array) -> Array:
    """Values whose squares are the loss of Huber: beyond OUTLIER an error counts by its size, not by its square."""
    out = values.copy()
    _curb(out, OUTLIER)
    return out


@compiled
def _curb(values, most) -> None:  # type: ignore[no-untyped-def]
    """Take the values (n,) beyond `most` in by huber."""
    for k in range(len(values)):
        size = abs(values[k])
        if size > most:
            values[k] = math.copysign(math.sqrt(2.0 * most * size - most * most), values[k])


def filters(course: Course, rig: Rig, noise: Noise, settings: Settings) -> tuple[Filter, ...]:
    """Filters of all stretches for motion simulated with the settings."""
    lever = antenna_lever(rig, effect_fields(settings))
    made = []
    for stretch in course.stretches:
        move = simulated_increments(rig, stretch, settings)
        gains, roots = np.empty((stretch.rows, 7, 3)), np.empty((stretch.rows, 3, 3))
        make_gains(
            stretch.time, stretch.heading, move.ahead, move.aside, *lever,
            noise_row(noise, stretch.heading_seen), gains, roots,
        )  # fmt: skip
        made.append(Filter(gains, roots, lever, fades(stretch.time)))
    return tuple(made)


def noise_row(noise: Noise, heading_seen: bool) -> Array:
    """Noise as the filter takes it; a heading that was not measured says nothing."""
    heading = noise.heading if heading_seen else 1e3
    return np.array([
        noise.position, noise.position_drift, heading, noise.heading_drift, noise.soil, noise.along
    ])  # fmt: skip


def channels(
    course: Course, rig: Rig, settings: Settings
) -> tuple[tuple[Channel | None, ...], tuple[Channel | None, ...]]:
    """Weights of wheel and speed from what is left: spread while steady, timing while moving, memory of all runs."""
    wheel: list[tuple[Array, Array] | None] = []
    speed: list[tuple[Array, Array] | None] = []
    for stretch in course.stretches:
        states = replay(rig, stretch, settings, from_sensor=False, from_speed=False)
        _, _, angle, pace = seen(rig, stretch, states, settings)
        both = stretch.wheel is not None and stretch.command is not None
        step = float(np.median(np.diff(stretch.time)))
        jitter = TIMING_S + step / np.sqrt(12.0)
        wheel.append((stretch.wheel - angle, jitter * _rate(stretch.time, angle)) if both else None)  # type: ignore[operator]
        speed.append(
            (stretch.speed - pace, TRANSIENT_S * _rate(stretch.time, pace)) if stretch.target is not None else None
        )
    return _weights(wheel, 5e-4, 1.0), _weights(speed, 0.005, DRIVE_LINE_S / TRANSIENT_S)


def _rate(time: Array, values: Array) -> Array:
    """Largest rate within half a second around each row."""
    rate = np.abs(np.gradient(values, time))
    width = max(1, round(0.5 / float(np.median(np.diff(time)))))
    padded = np.pad(rate, width, mode="edge")
    out: Array = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).max(axis=1)
    return out


def _weights(pairs: list[tuple[Array, Array] | None], least: float, share: float) -> tuple[Channel | None, ...]:
    """Weights of all stretches; `share` is how much of being off in time a true model would have as well."""
    known = [pair for pair in pairs if pair is not None]
    if not known:
        return tuple(None for _ in pairs)
    moving = float(np.median(np.concatenate([two for _, two in known])))
    steady = np.concatenate([_about_middle(off[rate <= moving]) for off, rate in known])
    low, high = np.quantile(steady, (0.16, 0.84))
    spread = max(0.5 * float(high - low), least)
    scaled = [one / np.hypot(spread, two) for one, two in known]
    before, after = np.concatenate([s[:-1] for s in scaled]), np.concatenate([s[1:] for s in scaled])
    clipped = [np.clip(part, -4.0, 4.0) for part in (before, after)]
    memory = float(clipped[0] @ clipped[1] / max(clipped[0] @ clipped[0], 1e-9))
    memory = min(max(memory, 0.0), MOST_MEMORY)
    fresh = huber((np.concatenate([s[1:] - memory * s[:-1] for s in scaled])) / np.sqrt(1.0 - memory * memory))
    size = max(float(np.sqrt(np.mean(fresh * fresh))), 0.3)
    wide = [None if pair is None else np.hypot(spread, pair[1]) for pair in pairs]
    scatters = [None if pair is None else np.hypot(spread, share * pair[1]) for pair in pairs]
    return tuple(
        None if one is None or plain is None else Channel(size * one, memory, plain)
        for one, plain in zip(wide, scatters, strict=True)
    )


def _about_middle(values: Array) -> Array:
    """Values about their own median: what differs from run to run is no noise."""
    return values - np.median(values) if len(values) else values
