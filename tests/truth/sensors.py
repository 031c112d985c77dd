"""What the instruments make of a drive: rates, clocks, noise, drift and the last digit."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.truth.signals import colour_noise, round_to

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Instruments:
    """Noise (standard deviations), drift (standard deviation, one minute of memory) and resolution of the sensors.

    `tilt_deg` is the noise of roll and pitch on ground that is no plane; the tractor leans out of bends.
    """

    position_m: float = 0.010
    position_drift_m: float = 0.015
    position_digit_m: float = 0.001
    heading_deg: float = 0.12
    heading_drift_deg: float = 0.10
    heading_digit_deg: float = 0.01
    speed_mps: float = 0.02
    speed_digit_mps: float = 0.01
    steering_deg: float = 0.03
    steering_digit_deg: float = 0.1
    drift_s: float = 60.0
    tilt_deg: float = 0.4
    roll_mounting_deg: float = 0.0
    pitch_mounting_deg: float = 0.0
    lean_deg_per_mps2: float = 0.4


def log_times(duration_s: float, rate_hz: float, uneven: float, gaps: int, rng: np.random.Generator) -> Array:
    """Instants of the rows: even, or each moved by up to `uneven` of half a step, with `gaps` holes of 1 to 3 s."""
    times = np.arange(0.0, duration_s - 1e-9, 1.0 / rate_hz)
    times[1:-1] += 0.5 * uneven / rate_hz * rng.uniform(-1.0, 1.0, len(times) - 2)
    for _ in range(gaps):
        middle, length = rng.uniform(0.1, 0.9) * duration_s, rng.uniform(1.0, 3.0)
        times = times[np.abs(times - middle) > 0.5 * length]
    return times


def disturbed(
    values: Array, times: Array, white: float, drift: float, digit: float, drift_s: float, rng: np.random.Generator
) -> Array:
    """Values with white noise, slow drift and the sensor's last digit."""
    steps = np.diff(times, prepend=times[0])
    slow = colour_noise(rng.standard_normal(len(times)), steps, drift_s)
    return round_to(values + white * rng.standard_normal(len(times)) + drift * slow, digit)
