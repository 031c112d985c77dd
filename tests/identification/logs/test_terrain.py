"""The slope of the ground from measured roll: what of it is mounting and lean, and when it is not used."""

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.hiding import brief_programme
from tests.truth.body import Ground, falls
from tests.truth.model import Truth, make_logs
from tests.truth.sensors import Instruments
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.terrain import (
    CrossSlope,
    GroundFall,
    estimate_cross_slope,
    measure_ground_fall,
    smooth_values,
    split_per_log,
)

HILLS = Ground(wave_m=0.6, length_m=45.0, drift=0.4)
MOUNTED = Instruments(roll_mounting_deg=2.0)


@pytest.fixture(scope="module")
def frames() -> list[pd.DataFrame]:
    """Seven runs on hills that fall nowhere on the whole."""
    return make_logs({}, 4, brief_programme(), rate_hz=10.0, ground=HILLS, instruments=MOUNTED)


def read(frames: list[pd.DataFrame], **columns: object) -> list[Log]:
    return [build_log(frame.assign(**columns), frame.attrs["name"]) for frame in frames]


def told(logs: list[Log]) -> CrossSlope:
    """What is found of logs whose roll must not be used."""
    found = estimate_cross_slope(logs)
    assert found.across == () and len(found.remarks) == 1
    return found


@pytest.mark.slow
def test_the_slope_is_that_of_the_ground(frames: list[pd.DataFrame]) -> None:
    """Noise of 0.4 degrees (0.7 % of slope), a mounting of 2 degrees and a lean: less than a fifth of them is left."""
    found = estimate_cross_slope(read(frames))
    assert found.across and "its mounting (+" in found.remarks[0]
    off = []
    for index, (drive, frame) in enumerate(zip(brief_programme(), frames, strict=True)):
        trace = Truth({}, 4, rate_hz=10.0, ground=HILLS, instruments=MOUNTED).trace(drive, index)
        true = np.array([falls(*row[:3], HILLS)[0] for row in trace.states])
        rows = frame.time_s.to_numpy() - frame.time_s.iloc[0]
        off.append(found.across[index] - np.interp(rows, trace.time_s, true))
    assert float(np.std(np.concatenate(off))) < 0.005
    assert float(np.sqrt(np.mean(np.concatenate(found.across) ** 2))) == pytest.approx(found.rms_slope, abs=1e-4)
    assert found.rms_slope == pytest.approx(0.04, abs=0.01) and found.mean_plane[0] < 0.015


@pytest.mark.parametrize("bearing", [0.0, 70.0, 200.0])
def test_a_plane_is_found_with_its_fall_and_bearing(bearing: float) -> None:
    turn = np.radians(bearing)
    ground = Ground(0.06 * np.sin(turn), 0.06 * np.cos(turn))
    logs = read(make_logs({}, 2, brief_programme(), rate_hz=10.0, ground=ground, instruments=MOUNTED))
    fall, towards, _ = estimate_cross_slope(logs).mean_plane
    assert fall == pytest.approx(0.06, abs=0.004)
    assert abs((towards - bearing + 180.0) % 360.0 - 180.0) < 5.0


def test_without_roll_nothing_is_said(frames: list[pd.DataFrame]) -> None:
    assert estimate_cross_slope(read([frame.drop(columns="roll_deg") for frame in frames])).remarks == ()


def test_a_sensor_that_is_off_is_not_used(frames: list[pd.DataFrame]) -> None:
    rng = np.random.default_rng(1)
    assert "it is constant" in told(read(frames, roll_deg=1.7)).remarks[0]
    noise = [frame.assign(roll_deg=rng.normal(1.0, 0.5, len(frame))) for frame in frames]
    for frame, other in zip(noise, frames, strict=True):
        frame.attrs = other.attrs
    assert "no slope above its noise" in told(read(noise)).remarks[0]
    some = [build_log(frames[0], "a"), build_log(frames[1].drop(columns="roll_deg"), "b")]
    assert "logged in 1 of 2 logs" in told(some).remarks[0]
    assert "it also needs heading_deg" in told(read([frame.drop(columns="heading_deg") for frame in frames])).remarks[0]


def test_one_way_only_does_not_tell_ground_from_mounting(frames: list[pd.DataFrame]) -> None:
    assert "ground from the mounting" in told(read(frames[:1])).remarks[0]


def test_roll_of_the_other_sign_is_told_by_the_drift_and_mended_by_its_fix(frames: list[pd.DataFrame]) -> None:
    wrong = [frame.assign(roll_deg=-frame.roll_deg) for frame in frames]
    assert (
        "no tractor drifts uphill" in told(read(wrong)).remarks[0] and "roll-left-down" in told(read(wrong)).remarks[0]
    )
    mended = estimate_cross_slope([build_log(frame, "run", ["roll-left-down"]) for frame in wrong])
    assert mended.across
    for one, other in zip(mended.across, estimate_cross_slope(read(frames)).across, strict=True):
        assert np.array_equal(one, other)


def test_missing_rows_of_roll_cost_nothing_but_themselves(frames: list[pd.DataFrame]) -> None:
    holes = [frame.assign(roll_deg=frame.roll_deg.where(frame.index % 7 != 0)) for frame in frames]
    for one, other in zip(
        estimate_cross_slope(read(holes)).across, estimate_cross_slope(read(frames)).across, strict=True
    ):
        assert float(np.max(np.abs(one - other))) < 0.01


# --- Means over time, and what the mounting of a sensor is told by ---


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
