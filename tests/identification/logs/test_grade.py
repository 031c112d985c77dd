"""What pitch explains of the speed, and when it is not used."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.hiding import brief_programme
from tests.truth.body import Ground, falls
from tests.truth.drives import constant
from tests.truth.model import Truth, make_logs
from tests.truth.sensors import Instruments
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.terrain import estimate_grade_speed
from vehicle.identification.replay.drive_segments import build_dataset

HILLS = Ground(wave_m=0.6, length_m=45.0, climb=0.8)
MOUNTED = Instruments(pitch_mounting_deg=-1.5)


@pytest.fixture(scope="module")
def frames() -> list[pd.DataFrame]:
    """Seven runs on hills; uphill the tractor loses 8 % of its speed on 10 %."""
    return make_logs({}, 4, brief_programme(), rate_hz=10.0, ground=HILLS, instruments=MOUNTED)


def read(frames: list[pd.DataFrame], **columns: object) -> list[Log]:
    return [build_log(frame.assign(**columns), f"run {k}") for k, frame in enumerate(frames)]


def told(logs: list[Log]) -> str:
    """The remark on logs whose pitch must not be used."""
    share, (remark,) = estimate_grade_speed(logs)
    assert share == ()
    return remark


def gain_of(remark: str) -> float:
    """Share of the speed per slope, as the remark has it."""
    return 0.1 * float(remark.split(" % slower")[0].split()[-1])


@pytest.mark.slow
def test_the_share_of_the_speed_is_that_of_the_ground(frames: list[pd.DataFrame]) -> None:
    share, (remark,) = estimate_grade_speed(read(frames))
    assert gain_of(remark) == pytest.approx(HILLS.climb, rel=0.15) and "mounting of the sensor (-1." in remark
    off = []
    for index, (drive, frame) in enumerate(zip(brief_programme(), frames, strict=True)):
        trace = Truth({}, 4, rate_hz=10.0, ground=HILLS, instruments=MOUNTED).trace(drive, index)
        true = 1.0 + HILLS.climb * np.array([falls(*row[:3], HILLS)[1] for row in trace.states])
        off.append(share[index] - np.interp(frame.time_s - frame.time_s.iloc[0], trace.time_s, true))
    assert float(np.std(np.concatenate(off))) < 0.01 < float(np.std(np.concatenate(share)))


def test_commands_are_taken_for_what_the_grade_leaves_of_them(frames: list[pd.DataFrame]) -> None:
    logs = read(frames)
    share, course = estimate_grade_speed(logs)[0][0], build_dataset(logs)
    target, command = course.segments[0].target, logs[0].speed_command_mps
    assert target is not None and command is not None
    rows = np.searchsorted(logs[0].time_s - logs[0].time_s[0], course.segments[0].time + 1e-9) - 1
    assert target == pytest.approx((command * share)[rows])
    assert any(one.startswith("pitch_deg explains speed") for one in course.remarks)


def test_backwards_it_is_the_way_back_that_counts() -> None:
    drives = [replace(one, shuttle=constant(-1.0)) for one in brief_programme()]
    logs = read(make_logs({}, 4, drives, rate_hz=10.0, ground=HILLS, instruments=MOUNTED))
    assert gain_of(estimate_grade_speed(logs)[1][0]) == pytest.approx(HILLS.climb, rel=0.25)


@pytest.mark.slow
def test_pitch_that_explains_nothing_is_not_used(frames: list[pd.DataFrame]) -> None:
    level = make_logs({}, 4, brief_programme(), rate_hz=10.0, ground=Ground(wave_m=0.6, length_m=45.0, drift=0.3))
    assert "the speed does not depend on it" in told(read(level))
    assert "nose down" in told(read([frame.assign(pitch_deg=-frame.pitch_deg) for frame in frames]))
    assert "it is constant" in told(read(frames, pitch_deg=0.0))
    rng = np.random.default_rng(3)
    assert "above its noise" in told(read([one.assign(pitch_deg=rng.normal(0, 0.5, len(one))) for one in frames]))
    assert "it also needs speed_mps" in told(read([one.drop(columns="speed_mps") for one in frames]))
    assert estimate_grade_speed(read([one.drop(columns="pitch_deg") for one in frames]))[1] == ()
