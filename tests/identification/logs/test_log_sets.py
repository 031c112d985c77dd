"""Sets of logs: parked ones and copies are left out and named; units of time and heading; the reason of lost rows."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.identification.log_tables import refusal, runs, saved
from vehicle.identification.logs.column_quality import is_parked, merge_copies
from vehicle.identification.logs.conventions import find_convention_errors
from vehicle.identification.logs.reader import build_log, list_shared_remarks, read_logs
from vehicle.identification.logs.readings import LogConvention


def parked(frame: pd.DataFrame, noise_m: float, seed: int = 1) -> pd.DataFrame:
    """The same instruments beside a tractor that stands with its wheels straight."""
    rng, rows = np.random.default_rng(seed), len(frame)
    return frame.assign(
        easting_m=7.0 + noise_m * rng.standard_normal(rows),
        northing_m=9.0 + noise_m * rng.standard_normal(rows),
        heading_deg=30.0 + 0.1 * rng.standard_normal(rows),
        speed_mps=0.0,
        speed_command_mps=0.0,
        steering_deg=0.0,
        steering_command_deg=0.0,
    )


@pytest.mark.parametrize("noise_m", [0.0, 0.01, 0.2])
def test_a_parked_log_is_left_out_of_a_set_and_named(noise_m: float, tmp_path: Path) -> None:
    yard = saved(parked(runs()["steps"], noise_m), tmp_path / "yard.csv")
    paths = [saved(runs()[name], tmp_path / f"{name}.csv") for name in ("circles_right", "steps")]
    logs = read_logs([yard, *paths])
    assert [log.name for log in logs] == ["circles_right", "steps"]
    assert list_shared_remarks(logs)[0] == "yard: the tractor never moves, so it was left out."
    assert "never moves" in refusal(lambda: read_logs([yard]))


def test_a_log_that_shows_no_steering_is_left_out_of_a_set_and_named(tmp_path: Path) -> None:
    silent = saved(runs()["steps"].assign(steering_deg=0.0, steering_command_deg=0.0), tmp_path / "hand.csv")
    other = saved(runs()["circles_right"], tmp_path / "circles_right.csv")
    logs = read_logs([silent, other])
    assert [log.name for log in logs] == ["circles_right"]
    told = "hand: steering_command_deg is 0 in every row while the path bends to both sides, so it shows nothing"
    assert list_shared_remarks(logs)[0] == f"{told} about the steering; it was left out."
    assert refusal(lambda: read_logs([silent])).startswith(told)


def test_a_drive_is_not_parked_because_its_speed_sensor_is_dead() -> None:
    assert not is_parked(build_log(runs()["steps"].assign(speed_mps=0.0), "steps", check=False))


def test_a_copy_counts_once_whatever_its_name_and_columns(tmp_path: Path) -> None:
    frame = runs()["steps"]
    paths = [
        saved(frame, tmp_path / "run.csv"),
        saved(frame.drop(columns=["heading_deg"]).round(3), tmp_path / "again.csv"),
        saved(frame.iloc[100:], tmp_path / "end.csv"),
        saved(runs()["circles_left"], tmp_path / "other.csv"),
    ]
    run, other = read_logs(paths)
    assert (run.name, run.other_names, other.other_names) == ("run", ("again", "end"), ())
    assert run.heading_deg is not None


def test_two_drives_of_one_programme_are_no_copies() -> None:
    logs = [build_log(frame, name) for name, frame in runs().items()]
    assert [log.name for log in merge_copies(logs)] == list(runs())
    shifted = build_log(runs()["steps"].assign(easting_m=runs()["steps"].easting_m + 0.01), "beside")
    assert len(merge_copies([build_log(runs()["steps"], "steps"), shifted])) == 2


@pytest.mark.parametrize(
    ("fix", "per_second"), [(LogConvention.TIME_MS, 1e3), (LogConvention.TIME_US, 1e6), (LogConvention.TIME_NS, 1e9)]
)
@pytest.mark.parametrize("origin_s", [0.0, 1.7e9])
def test_times_of_the_day_in_small_units_are_named_by_their_unit(
    fix: LogConvention, per_second: float, origin_s: float
) -> None:
    frame = runs()["straight_090"]
    small = frame.assign(time_s=np.round((frame.time_s + origin_s) * per_second))
    message = refusal(lambda: build_log(small, "run"))
    assert str(fix) in message
    log = build_log(small, "run", [fix])
    assert np.diff(log.time_s) == pytest.approx(np.diff(frame.time_s), abs=1e-3)


@pytest.mark.parametrize("name", ["circles_right", "figure_eight", "steps"])
@pytest.mark.parametrize("counts_on", [False, True])
def test_radians_are_radians_however_they_are_counted(name: str, counts_on: bool) -> None:
    """Several circles without a wrap exceed 6.28; they looked like degrees counter-clockwise."""
    frame = runs()[name]
    radians = np.radians(frame.heading_deg)
    frame = frame.assign(heading_deg=np.unwrap(radians) + 40.0 * np.pi if counts_on else radians)
    message = refusal(lambda: build_log(frame, "run"))
    assert "heading_deg is in radians" in message and "counter-clockwise" not in message
    assert build_log(frame, "run", [LogConvention.HEADING_RADIANS]).rows_gated == 0


@pytest.mark.parametrize("seed", range(12))
def test_a_poor_heading_in_degrees_is_not_in_radians(seed: int) -> None:
    """Few of its changes are small, and their ratio to the turns of the path is chance."""
    frame = runs()["figure_eight"]
    rng = np.random.default_rng(seed)
    frame = frame.assign(heading_deg=(frame.heading_deg + rng.normal(0.0, 12.0, len(frame))) % 360.0)
    suspicions = find_convention_errors(build_log(frame, "run", check=False))
    assert LogConvention.HEADING_RADIANS not in [suspicion.fix for suspicion in suspicions]
