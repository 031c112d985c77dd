"""The truth model against closed forms, and that each effect changes what it should and nothing else."""

import math

import numpy as np
import pytest

from tests.truth import body
from tests.truth.drives import Drive, constant, default_programme, drive, reversing, stairs, straight, triangle
from tests.truth.effects import CLEAR_SIZES, OUTSIDE, complete, scaled
from tests.truth.ground import EG105, measured_curvature
from tests.truth.model import Trace, Truth, mirror_frame
from tests.truth.recorder import COLUMNS
from tests.truth.sensors import PERFECT

FIVE_KMH = 5.0 / 3.6


def quiet(effects: dict[str, dict[str, float]] | None = None, **conditions: object) -> Truth:
    return Truth(effects or {}, soil_deg_per_s=0.0, instruments=PERFECT, **conditions)  # type: ignore[arg-type]


def clear(name: str) -> dict[str, dict[str, float]]:
    return {name: {**CLEAR_SIZES, **OUTSIDE}[name]}


def circle(angle_deg: float, speed_mps: float = FIVE_KMH, implement: float = 0.0, seconds: float = 30.0) -> Drive:
    return drive("circle", seconds, constant(angle_deg), speed_mps, implement)


def curvature(trace: Trace, after_s: float = 15.0, before_s: float = 1e9) -> float:
    """Curvature of the centre of mass, from three of its positions (not from the model's own rates)."""
    rows = np.flatnonzero((trace.time_s >= after_s) & (trace.time_s <= before_s))
    east, north = trace.antenna()
    a, b, c = ((east[row], north[row]) for row in (rows[0], rows[len(rows) // 2], rows[-1]))
    cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return -2.0 * cross / (math.dist(a, b) * math.dist(b, c) * math.dist(a, c))


def test_a_finer_step_gives_the_same_drive() -> None:
    ends = []
    run = drive("bends", 30.0, stairs((0.5, 0.0), (15.0, 12.0), (15.0, -4.0)), stairs((15.0, 1.0), (15.0, 2.4)))
    for step in (0.008, 0.004, 0.001):
        state = Truth(step_s=step).trace(run).states[-1]
        ends.append(state[[body.EAST, body.NORTH, body.HEADING]])
    assert np.abs(ends[1] - ends[2]).max() < 0.01
    assert np.abs(ends[1] - ends[2]).max() < np.abs(ends[0] - ends[2]).max() + 1e-4


def test_backlash_lets_the_sensor_move_before_the_wheels() -> None:
    trace = quiet(clear("steering_backlash")).trace(drive("triangle", 40.0, triangle(3.0, 10.0)))
    gap = trace.column(body.ACTUATOR) - trace.wheel_deg
    assert gap.max() == pytest.approx(0.75, abs=1e-6) and gap.min() == pytest.approx(-0.75, abs=1e-6)
    plain = quiet().trace(drive("triangle", 40.0, triangle(3.0, 10.0)))
    assert np.array_equal(trace.column(body.ACTUATOR), plain.column(body.ACTUATOR))
    assert np.array_equal(plain.column(body.ACTUATOR), plain.wheel_deg)


def test_effects_are_scaled_and_completed() -> None:
    for name, clear_size in {**CLEAR_SIZES, **OUTSIDE}.items():
        assert scaled(name, 1.0) == pytest.approx(clear_size)
    assert scaled("steering_gain", 0.5) == pytest.approx({"ratio": 1.04})
    assert scaled("side_slip", 0.5) == pytest.approx({"limit_g": 0.16})
    with pytest.raises(ValueError, match="effect 'grip' is unknown"):
        complete({"grip": {"ratio": 0.5}})
    with pytest.raises(ValueError, match="steering_gain has no parameter 'factor'"):
        complete({"steering_gain": {"factor": 1.1}})


@pytest.mark.slow
def test_instruments_add_the_noise_they_say() -> None:
    run = default_programme()[4]
    noisy, exact = Truth({}, 8).log(run), Truth({}, 8, instruments=PERFECT).log(run)
    white = np.diff(noisy.easting_m - exact.easting_m).std() / math.sqrt(2.0)
    assert white == pytest.approx(0.010, rel=0.1)
    turn = np.diff((noisy.heading_deg - exact.heading_deg + 180.0) % 360.0).std() / math.sqrt(2.0)
    assert turn == pytest.approx(0.12, rel=0.1)
    assert np.abs(noisy.steering_deg * 10 - np.round(noisy.steering_deg * 10)).max() < 1e-9
    drift = [(Truth({}, 8).log(run, k).easting_m - Truth({}, 8, instruments=PERFECT).log(run, k).easting_m).mean()
             for k in range(40)]  # fmt: skip
    assert 0.007 < np.std(drift) < 0.022


def test_soil_disturbs_the_heading_as_much_as_asked() -> None:
    """An exponentially remembered yaw rate of s deg/s with memory T turns the heading by s sqrt(2 T t) after t."""
    turns = []
    for index in range(60):
        trace = Truth({}, 2, soil_deg_per_s=0.5).trace(drive("line", 30.0, constant(0.0), FIVE_KMH), index)
        turns.append(math.degrees(trace.states[-1, body.HEADING] - trace.states[0, body.HEADING]))
    assert np.std(turns) == pytest.approx(0.5 * math.sqrt(2 * 0.5 * 28.5), rel=0.3)


@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0])
def test_logs_have_the_columns_rate_and_origin_asked_for(rate: float) -> None:
    origin = (545000.0, 4770000.0)
    plain = Truth({}, 4, rate_hz=rate).log(default_programme()[2])
    moved = Truth({}, 4, rate_hz=rate, origin=origin).log(default_programme()[2])
    assert tuple(plain) == COLUMNS[:10] and len(plain) == 60 * rate
    assert np.allclose(np.diff(plain.time_s), 1.0 / rate)
    assert np.allclose(moved.easting_m - plain.easting_m, origin[0], atol=1e-3)
    assert np.allclose(moved.northing_m - plain.northing_m, origin[1], atol=1e-3)


def test_conditions_of_logging() -> None:
    run = straight(90.0)
    frame = Truth({}, 4, uneven=0.8, gaps=2, terrain=(0.1, 180.0), drop=("heading_deg",)).log(run)
    steps = np.diff(frame.time_s)
    assert (steps > 0).all() and steps.max() > 0.9 and np.std(steps[steps < 0.2]) > 0.005
    assert "heading_deg" not in frame
    # Eastwards on a slope that falls to the south, the right side is the lower one.
    assert frame.roll_deg.iloc[0] == pytest.approx(math.degrees(math.atan(0.1)), abs=0.01)
    assert abs(frame.pitch_deg.iloc[0]) <= 0.02


def test_mirroring() -> None:
    frame = Truth({}, 4).log(default_programme()[2])
    back = mirror_frame(mirror_frame(frame))
    assert all(np.allclose(frame[name], back[name]) for name in frame)
    right, left = quiet().trace(circle(12.0)), quiet(mirrored=True).trace(circle(12.0))
    assert curvature(left) == pytest.approx(measured_curvature(-12.0, EG105), rel=2e-3)
    assert curvature(right) == pytest.approx(measured_curvature(12.0, EG105), rel=2e-3)


def test_reverse_drives_backwards_and_stands_between() -> None:
    frame = quiet().log(reversing())
    assert (frame.speed_mps >= 0).all() and set(frame.shuttle) == {-1, 0, 1}
    course = np.arctan2(np.gradient(frame.easting_m), np.gradient(frame.northing_m))
    back = (frame.shuttle == -1) & (frame.speed_mps > 0.8)
    assert (np.cos(course - np.radians(frame.heading_deg))[back] < -0.9).all()
