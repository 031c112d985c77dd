"""Headings that are the course of the antenna, or the sum of a gyroscope, on kinematic truth (tests.truth.joints)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from tests.truth.drives import drive, stairs, steps
from tests.truth.joints import FRONT, JOINT, ROW_S, Jointed, drive_jointed
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.faults.heading_kind import drop_course_headings, find_double_swing, find_heading_scale
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.model.tractor import Tractor, load_tractor

BASE_M, ANTENNA_M = 2.4, 1.1
TURNS = (3.0, -3.0, 12.0, -12.0, 20.0, -20.0, 6.0, -16.0, 0.0)
PACES = stairs((12.0, 0.8), (12.0, 2.0), (12.0, 0.8), (12.0, 2.0))
LOOPS = [
    drive("right", 90.0, stairs(*[(10.0, 18.0), (10.0, 0.0)] * 4, (10.0, 18.0)), stairs((90.0, 1.4))),
    drive("left", 90.0, stairs(*[(10.0, -18.0), (10.0, 0.0)] * 4, (10.0, -18.0)), stairs((90.0, 1.4))),
    drive("eight", 90.0, stairs(*[(15.0, 18.0), (15.0, -18.0)] * 3), stairs((90.0, 1.4))),
]


def drive_runs(vehicle: Jointed) -> list[pd.DataFrame]:
    drives = [steps(TURNS, 5.0, "slow_steps", 0.9), steps(TURNS[::-1], 5.0, "fast_steps", 2.0)]
    bends = drive("bends", 48.0, stairs((24.0, 14.0), (24.0, -14.0)), PACES)
    return [drive_jointed(vehicle, run, number, True) for number, run in enumerate([*drives, bends])]


def take_course(run: pd.DataFrame, seconds: float) -> pd.DataFrame:
    """The run with the course of the last `seconds` in the place of its heading."""
    rows = round(seconds / ROW_S)
    step = run[["easting_m", "northing_m"]].diff(rows).bfill()
    return run.assign(heading_deg=np.degrees(np.arctan2(step["easting_m"], step["northing_m"])) % 360.0)


def build_logs(runs: list[pd.DataFrame]) -> list[Log]:
    return [build_log(run, run.attrs["name"], wheelbase_m=BASE_M) for run in runs]


def make_file(antenna_m: float) -> Tractor:
    tractor = load_tractor("eg105")
    axles = {"front_axle_m": 0.55 * BASE_M, "rear_axle_m": 0.45 * BASE_M, "radius": {}, "source": {}}
    return Tractor.model_validate({**tractor.model_dump(), **axles, "antenna_forward_m": antenna_m})


@pytest.mark.parametrize("seconds", [0.4, 0.8])
def test_headings_that_are_the_course_of_the_antenna_are_left_out_and_told(seconds: float) -> None:
    logs = build_logs([take_course(run, seconds) for run in drive_runs(Jointed(FRONT, BASE_M, ANTENNA_M))])
    left_out = drop_course_headings(logs, make_file(ANTENNA_M))
    assert all(log.heading_deg is None and "course over ground" in log.corrections[-1] for log in left_out)


@pytest.mark.parametrize("antenna_m", [0.0, 0.4, ANTENNA_M, 2.0])
def test_headings_of_an_antenna_anywhere_are_no_course(antenna_m: float) -> None:
    """Also where the antenna is above the axle, so that it goes where the tractor points, and the file says 1.1 m."""
    logs = build_logs(drive_runs(Jointed(FRONT, BASE_M, antenna_m)))
    assert drop_course_headings(logs, make_file(ANTENNA_M)) == logs


def test_a_joint_in_the_middle_is_no_course() -> None:
    logs = build_logs(drive_runs(Jointed(JOINT, BASE_M, ANTENNA_M)))
    assert drop_course_headings(logs, make_file(ANTENNA_M)) == logs


def scale_turns(run: pd.DataFrame, share: float) -> pd.DataFrame:
    """The run with headings of a gyroscope that turns by a share more, which a receiver holds over half a minute."""
    true = np.unwrap(np.radians(run["heading_deg"]))
    wrong, kept = np.zeros(len(true)), np.exp(-ROW_S / 30.0)
    for row in range(1, len(true)):
        wrong[row] = kept * (wrong[row - 1] + share * (true[row] - true[row - 1]))
    return run.assign(heading_deg=np.degrees(true + wrong) % 360.0)


@pytest.mark.parametrize("share", [-0.03, 0.03])
def test_a_gyroscope_is_known_by_what_its_headings_turn_more_than_the_path(share: float) -> None:
    runs = [drive_jointed(Jointed(FRONT, BASE_M, ANTENNA_M), run, number, True) for number, run in enumerate(LOOPS)]
    found = find_heading_scale(build_logs([scale_turns(run, share) for run in runs]))
    # In loops at one rate what the receiver forgets is as much as what is added.
    assert found is not None and 0.3 < found / share < 1.1


def test_a_true_heading_and_a_compass_are_no_gyroscope() -> None:
    runs = [drive_jointed(Jointed(FRONT, BASE_M, ANTENNA_M), run, number, True) for number, run in enumerate(LOOPS)]
    assert find_heading_scale(build_logs(runs)) is None and find_double_swing(build_logs(runs)) is None
    logs = build_logs([deviate(run, 4.0, 1) for run in runs])
    assert find_heading_scale(logs) is None and find_double_swing(logs) is None


def deviate(run: pd.DataFrame, largest_deg: float, swings: int) -> pd.DataFrame:
    """The run with headings of a compass that is wrong by so much, to and fro so many times per turn."""
    wrong_deg = largest_deg * np.sin(swings * np.radians(run["heading_deg"] - 20.0))
    return run.assign(heading_deg=(run["heading_deg"] + wrong_deg) % 360.0)


def test_a_compass_that_swings_twice_per_turn_is_told_as_one() -> None:
    runs = [drive_jointed(Jointed(FRONT, BASE_M, ANTENNA_M), run, number, True) for number, run in enumerate(LOOPS)]
    logs = build_logs([deviate(run, 3.0, 2) for run in runs])
    found = find_double_swing(logs)
    assert found is not None and np.degrees(found) == pytest.approx(3.0, abs=0.4)


def diagnose_loops(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Diagnosis:
    """What is found in loops with changed headings."""
    runs = [drive_jointed(Jointed(FRONT, BASE_M, ANTENNA_M), run, number, True) for number, run in enumerate(LOOPS)]
    return diagnose_logs(build_logs([change(run) for run in runs]), make_file(ANTENNA_M), "soil")


@pytest.mark.slow
@pytest.mark.parametrize(("share", "word"), [(-0.03, "less"), (0.03, "more")])
def test_a_gyroscope_has_a_hint_and_no_name(share: float, word: str) -> None:
    found = diagnose_loops(lambda run: scale_turns(run, share))
    assert f"% {word} than the path" in found.known_outside and "heading_bias" not in found.named
    assert found.hints[0].instrument == "heading"


@pytest.mark.slow
def test_a_compass_of_two_swings_has_a_hint_that_is_no_gyroscope() -> None:
    found = diagnose_loops(lambda run: deviate(run, 3.0, 2))
    assert "twice in each full turn" in found.known_outside and "gyroscope" not in found.known_outside
    assert "cross_slope_drift" not in found.named and found.hints[0].instrument == "heading"


@pytest.mark.parametrize("late_s", [0.3, 0.6])
def test_late_headings_swing_by_no_compass(late_s: float) -> None:
    runs = [drive_jointed(Jointed(FRONT, BASE_M, ANTENNA_M), run, number, True) for number, run in enumerate(LOOPS)]
    late = [run.assign(heading_deg=run["heading_deg"].shift(round(late_s / ROW_S)).bfill()) for run in runs]
    assert find_double_swing(build_logs(late)) is None
