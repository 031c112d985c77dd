"""Noise with a memory, filters, last digits and faults of signals: formulas that references share."""

import math

import numba
import numpy as np
import numpy.typing as npt

from tests.truth.cases import ColumnClock, Fault

Array = npt.NDArray[np.float64]
NO_CLOCK = ColumnClock()


@numba.njit(cache=True)
def colour_noise(white: Array, steps_s: Array, memory_s: float) -> Array:
    """Unit-variance noise with an exponential memory (s) from unit white noise at these steps (s)."""
    out = np.empty(len(white))
    out[0] = white[0]
    for row in range(1, len(white)):
        keep = math.exp(-steps_s[row] / memory_s)
        out[row] = keep * out[row - 1] + math.sqrt(1.0 - keep * keep) * white[row]
    return out


def draw_coloured(rng: np.random.Generator, count: int, step_s: float, memory_s: float) -> Array:
    """Unit-variance noise (count,) with a memory at even steps."""
    return colour_noise(rng.standard_normal(count), np.full(count, step_s), memory_s)


@numba.njit(cache=True)
def low_pass(values: Array, step_s: float, time_s: float) -> Array:
    """First-order low pass of values at even steps; 0 s leaves them as they are."""
    if time_s <= 0.0:
        return values
    out, share = values.copy(), 1.0 - math.exp(-step_s / time_s)
    for row in range(1, len(values)):
        out[row] = out[row - 1] + share * (values[row] - out[row - 1])
    return out


def round_to(values: Array, digit: float) -> Array:
    """Values at the last digit of a sensor; 0 leaves them as they are."""
    return np.round(values / digit) * digit if digit > 0.0 else values


def pick_held(values: Array, at_s: Array, step_s: float) -> Array:
    """The row in force at other times, never a mean of two."""
    out: Array = values[np.clip((at_s / step_s + 1e-6).astype(int), 0, len(values) - 1)]
    return out


def is_within(fault: Fault, times: Array) -> npt.NDArray[np.bool_]:
    """The rows during which a fault lasts."""
    return (times >= fault.from_s) & (times < (math.inf if fault.to_s is None else fault.to_s))
