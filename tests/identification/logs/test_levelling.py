"""Means over time, and what the mounting of a sensor is told by."""

import numpy as np
import pandas as pd
import pytest

from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.terrain import GroundFall, measure_ground_fall, smooth_values, split_per_log


def line(bearing_deg: float, seconds: float = 40.0, **columns: object) -> pd.DataFrame:
    """A straight drive at 1.5 m/s that begins at the origin."""
    time = np.arange(0.0, seconds, 0.1)
    turn = np.radians(bearing_deg)
    place = {"easting_m": 1.5 * time * np.sin(turn), "northing_m": 1.5 * time * np.cos(turn)}
    return pd.DataFrame({"time_s": time, **place, "heading_deg": bearing_deg, "steering_deg": 0.0, **columns})


def logs_of(*frames: pd.DataFrame) -> list[Log]:
    return [build_log(frame, f"run {k}") for k, frame in enumerate(frames)]


def noisy(mean_deg: float, seed: int) -> np.ndarray:
    return mean_deg + np.random.default_rng(seed).normal(0.0, 0.3, 400)


def test_means_are_of_the_rows_about_and_of_their_own_stretch() -> None:
    (log,) = logs_of(line(0.0))
    ramp = np.arange(400.0)
    assert smooth_values(log, ramp, 0.4)[[0, 200, 399]] == pytest.approx([1.0, 200.0, 398.0])
    (parted,) = logs_of(line(0.0).drop(index=range(100, 200)))
    assert smooth_values(parted, np.repeat([0.0, 1.0], [100, 200]), 4.0) == pytest.approx(
        np.repeat([0.0, 1.0], [100, 200])
    )


def test_there_and_back_the_mounting_is_what_does_not_change_its_sign() -> None:
    """A plane that falls 3 degrees to the east, a sensor mounted 1 degree to the right."""
    logs = logs_of(line(0.0, roll_deg=noisy(4.0, 1)), line(180.0, roll_deg=noisy(-2.0, 2)))
    level = measure_ground_fall(logs, "roll_deg")
    assert isinstance(level, GroundFall)
    assert level.mounting_deg == pytest.approx(1.0, abs=0.1) and level.rms_fall == pytest.approx(0.0524, abs=0.002)
    there, back = split_per_log(logs, level.fall)
    assert float(there.mean()) == pytest.approx(0.0524, abs=0.002)
    assert float(back.mean()) == pytest.approx(-0.0524, abs=0.002)
    logs = logs_of(line(90.0, pitch_deg=noisy(-2.0, 1)), line(270.0, pitch_deg=noisy(4.0, 2)))
    nose_down = measure_ground_fall(logs, "pitch_deg")
    assert isinstance(nose_down, GroundFall) and nose_down.mounting_deg == pytest.approx(1.0, abs=0.1)
    assert float(nose_down.fall[:400].mean()) == pytest.approx(0.0524, abs=0.002)


def test_one_way_tells_no_mounting() -> None:
    said = measure_ground_fall(
        logs_of(line(0.0, roll_deg=noisy(4.0, 1)), line(0.0, roll_deg=noisy(4.0, 2))), "roll_deg"
    )
    assert isinstance(said, str) and "there and back" in said
