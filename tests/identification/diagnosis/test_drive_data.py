"""Logs laid out in windows: which windows there are, what their cells hold, and columns that are missing."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.analytic_drives import SPEED_MPS, circle, course
from vehicle.identification.diagnosis.drive_data import PATH_STEP_S, POSE_CELLS, STRIDE, DriveData, build_drive_data
from vehicle.identification.errors import LogError
from vehicle.identification.logs.thresholds import WINDOW_S


def line(seconds: float, rate_hz: float = 10.0, **columns: float) -> pd.DataFrame:
    """A line to the north with all columns."""
    own = {"steering_command_deg": 0.0, "speed_command_mps": SPEED_MPS} | columns
    return circle(0.0, seconds, rate_hz).assign(**own)


def lay(*frames: pd.DataFrame) -> DriveData:
    return build_drive_data(course(*frames))


@pytest.mark.parametrize(("seconds", "windows"), [(34.0, 3), (35.2, 4), (40.0, 4), (44.0, 4)])
def test_windows_follow_one_another_and_the_last_may_be_half_empty(seconds: float, windows: int) -> None:
    data = lay(line(seconds))
    assert data.windows == windows and set(data.window_runs) == {0}
    assert np.allclose(np.diff(data.window_starts) * PATH_STEP_S, WINDOW_S)
    filled, rest = data.north.observed.mean(axis=1), seconds / WINDOW_S - windows + 1
    assert np.all(filled[:-1] == 1.0) and filled[-1] == pytest.approx(min(rest, 1.0), abs=0.05)


def test_runs_and_segments_have_their_own_windows_and_steps() -> None:
    data = lay(line(20.0), line(31.0))
    assert data.window_runs.tolist() == data.window_segments.tolist() == [0, 0, 1, 1, 1] and data.runs == 2
    assert data.step_starts[-1] == STRIDE * data.path_starts[-1] == len(data.command) == STRIDE * len(data.path_runs)
    assert data.window_starts[2] == data.path_starts[1]
    assert np.array_equal(np.bincount(data.path_runs), np.diff(data.path_starts))


@pytest.mark.parametrize("rate_hz", [10.0, 7.0, 2.0])
def test_a_cell_holds_the_means_of_its_rows(rate_hz: float) -> None:
    """On a line at a steady speed a mean place is the place at the mean time."""
    data = lay(line(40.0, rate_hz))
    time = data.north.average(data.north.places * PATH_STEP_S)
    seen = data.north.observed
    way = data.north.values - data.north.values[0, 0] - SPEED_MPS * (time - time[0, 0])
    assert np.abs(way[seen]).max() < 1e-6
    assert np.all(data.north.values[~seen] == 0.0)
    starts = data.window_starts[:, None] * PATH_STEP_S + WINDOW_S / POSE_CELLS * np.arange(POSE_CELLS)
    assert np.abs((time - starts - 0.5 * WINDOW_S / POSE_CELLS)[seen]).max() <= 0.5 / rate_hz + 0.2
    assert seen.mean() == pytest.approx(min(rate_hz * WINDOW_S / POSE_CELLS, 1.0), abs=0.05)


@pytest.mark.parametrize(
    ("dropped", "unseen"),
    [("heading_deg", {"heading"}), ("speed_command_mps", {"speed"}), ("speed_mps", {"speed"}),
     ("steering_command_deg", {"wheel"}), ("steering_deg", {"wheel"})],
)  # fmt: skip
def test_what_is_missing_is_not_observed(dropped: str, unseen: set[str]) -> None:
    data = lay(line(40.0).drop(columns=dropped))
    names = {"east", "north", "heading", "wheel", "speed"}
    assert {name for name in names if not getattr(data, name).observed.any()} == unseen
    assert bool(data.has_wheel[0]) is (dropped != "steering_deg")


def test_a_wheel_angle_that_is_missing_is_its_command_and_the_other_way_round() -> None:
    turned = line(40.0, steering_command_deg=4.0, steering_deg=3.0)
    for dropped, angle_deg in (("steering_deg", 4.0), ("steering_command_deg", 3.0)):
        data = lay(turned.drop(columns=dropped))
        assert np.allclose(np.degrees([*data.command, *data.path["wheel"]]), angle_deg)


def test_too_little_driving_is_refused() -> None:
    with pytest.raises(LogError, match="give longer runs"):
        lay(line(24.0))
    with pytest.raises(LogError, match="give longer runs"):
        lay(line(60.0).assign(speed_mps=0.1, northing_m=lambda frame: 700.0 + 0.1 * frame.time_s))
