"""The instruments of the third reference: every column has its own delay, hold, filter and clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.truth.cases import ColumnClock, Fault
from tests.truth.signals import colour_noise, is_within

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Sensors:
    """Standard deviations, memories and last digits of the instruments, and the jitter of the rows."""

    position_m: float = 0.008
    wander_m: float = 0.012
    wander_s: float = 25.0
    heading_deg: float = 0.08
    heading_memory_deg: float = 0.10
    heading_memory_s: float = 1.2
    heading_digit_deg: float = 0.01
    speed_mps: float = 0.02
    speed_digit_mps: float = 0.01
    wheel_deg: float = 0.05
    wheel_digit_deg: float = 0.05
    jitter_s: float = 0.004


EXACT = Sensors(0.0, 0.0, 25.0, 0.0, 0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Reading:
    """When the values of a column were true (s since the start, a row each), and which rows repeat one value."""

    when_s: Array
    group: Rows


def read_column(clock: ColumnClock, times: Array, rng: np.random.Generator) -> Reading:
    """Age of a column at the rows of a log."""
    refreshed, group = times, np.arange(len(times))
    if clock.hold_s > 0.0:
        count = int((times[-1] + 2.0 * clock.hold_s) / (clock.hold_s * (1.0 - 0.5 * min(clock.hold_jitter, 1.0)))) + 4
        gaps = clock.hold_s * (1.0 + clock.hold_jitter * rng.uniform(-1.0, 1.0, count))
        beats = np.cumsum(gaps) - gaps[0] - clock.hold_s * rng.uniform(0.0, 1.0)
        place = np.searchsorted(beats, times, side="right") - 1
        refreshed, group = beats[place], place - place[0]
    stamp = clock.offset_s + clock.drift_s_per_min * refreshed / 60.0
    return Reading(refreshed - clock.delay_s - stamp, group)


def draw_noise(reading: Reading, white: float, slow: float, memory_s: float, rng: np.random.Generator) -> Array:
    """White noise and slow wander of a column: a held value keeps the noise it was read with."""
    count = int(reading.group[-1]) + 1
    whites = rng.standard_normal(count)
    fresh = rng.standard_normal(count)
    _, first = np.unique(reading.group, return_index=True)
    times = np.zeros(count)
    known = reading.group[first]
    times[known] = reading.when_s[first]
    steps = np.maximum(np.diff(np.maximum.accumulate(times), prepend=times[0]), 0.0)
    noise = white * whites + slow * colour_noise(fresh, steps, memory_s)
    return np.asarray(noise[reading.group], dtype=float)


def freeze_values(values: Array, times: Array, faults: Sequence[Fault]) -> Array:
    """Values of a column that keeps the last one before each fault while it lasts."""
    out = values.copy()
    for fault in faults:
        rows = np.flatnonzero(is_within(fault, times))
        if len(rows):
            out[rows] = out[max(rows[0] - 1, 0)]
    return out


def lose_position(times: Array, faults: Sequence[Fault], seed: Sequence[int]) -> Array:
    """Errors of the position (rows, east and north, m) at even `times` while a fix is lost: it degrades or jumps."""
    errors = np.zeros((len(times), 2))
    for index, fault in enumerate(faults):
        rng, rows = np.random.default_rng([*seed, index]), is_within(fault, times)
        mode, size = int(fault.detail.get("mode", 0)), fault.detail.get("size_m", 1.0)
        if mode == 0:
            steps = np.diff(times, prepend=times[0])
            for axis in range(2):
                errors[rows, axis] = size * colour_noise(rng.standard_normal(len(times)), steps, 1.5)[rows]
        elif mode == 1:
            leap = np.floor((times - fault.from_s) / 5.0).astype(int)
            for axis in range(2):
                errors[rows, axis] = (size * rng.choice([-1.0, 1.0], 200) * rng.uniform(0.7, 1.3, 200))[leap[rows]]
    return errors
