"""A measured signal loses the noise of its sensor and keeps its steps, its bends and the play that it opens."""

import numpy as np
import pytest

from tests.truth import rolling
from tests.truth.drives import three_speeds_programme
from tests.truth.second import Receiver, Second
from vehicle.identification.logs.series import denoise_angles, estimate_angle_noise

TIME = np.arange(0.0, 60.0, 0.1)


def noise(size: float, seed: int = 1) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(len(TIME))


def played(angles: np.ndarray, half: float) -> np.ndarray:
    """The wheels behind a play that opens half a width to both sides of the angles."""
    out, wheels = np.empty(len(angles)), angles[0]
    for row, angle in enumerate(angles):
        wheels = out[row] = min(max(wheels, angle - half), angle + half)
    return out


def width_told(angles: np.ndarray, wheels: np.ndarray) -> float:
    """Width of the play of the angles that comes nearest to the wheels."""
    widths = np.linspace(0.8, 3.2, 121)
    return float(widths[np.argmin([np.sum((played(angles, 0.5 * one) - wheels) ** 2) for one in widths])])


def test_a_clean_signal_stays_as_it_is() -> None:
    for clean in (np.full(len(TIME), 0.3), np.floor(TIME / 5.0), TIME * 1e-8):
        assert denoise_angles(TIME, clean) == pytest.approx(clean, abs=1e-6)
    assert list(denoise_angles(TIME[:2], np.array([1.0, 2.0]))) == [1.0, 2.0]


def test_noise_goes_where_the_signal_rests_and_steps_stay_sharp() -> None:
    steps = np.floor(TIME / 5.0) % 3
    out = denoise_angles(TIME, steps + noise(0.05))
    off = np.abs(out - steps)
    assert np.sqrt(np.mean(off**2)) < 0.3 * 0.05
    assert off.max() < 0.15, "a step is smeared over no row"


def test_nothing_comes_late() -> None:
    ramp = 0.02 * TIME
    out = denoise_angles(TIME, ramp + noise(0.05))
    assert abs(float(np.mean((out - ramp)[50:-50]))) < 0.005
    assert denoise_angles(TIME, (ramp + noise(0.05))[::-1])[::-1] == pytest.approx(out)


def test_the_noise_is_told_of_slow_signals_and_of_last_digits() -> None:
    assert estimate_angle_noise(5.0 * np.sin(TIME / 3.0) + noise(0.1)) == pytest.approx(0.1, rel=0.1)
    assert estimate_angle_noise(0.001 * np.round(np.sin(TIME / 3.0) + noise(0.2))) == pytest.approx(
        0.001 / np.sqrt(12.0)
    )
    assert estimate_angle_noise(np.zeros(9)) == estimate_angle_noise(np.zeros(2)) == 0.0


@pytest.mark.parametrize("size", [0.0, 0.05, 0.2, 0.4])
@pytest.mark.parametrize("name", ["right", "steps", "waves"])
def test_play_reads_alike_at_every_noise_of_the_sensor(name: str, size: float) -> None:
    """Driven by the rows as they are, a play of 1.5 degrees would read as 2.3 at a noise of 0.2."""
    index, drive = next((at, one) for at, one in enumerate(three_speeds_programme()) if one.name == name)
    second = Second({}, 501, receiver=Receiver(wheel_deg=size))
    rolled, log = second.roll(drive, index), second.log(drive, index)
    time = log.time_s.to_numpy() - 100.0
    wheels = played(np.interp(time, rolled.time_s, rolled.column(rolling.WHEEL)), 0.75)
    angles = log.steering_deg.to_numpy()
    steady = np.degrees(denoise_angles(time, np.radians(angles)))
    assert width_told(steady, wheels) == pytest.approx(1.5, abs=0.02 + 0.4 * size)
    if size >= 0.2:
        assert width_told(angles, wheels) > 1.5 + 2.0 * size
