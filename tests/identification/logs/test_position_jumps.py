"""Positions that jump once and stay there: told with run, time and size, and what follows is as good as before."""

import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.identification.fault_logs import RUNS, START_S, clean_frames, rows_of
from vehicle.identification.diagnosis.log_notes import list_onset_faults
from vehicle.identification.logs.column_faults import correct_position_jumps
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.table import extract_columns

AXES = ("easting_m", "northing_m")


def displace(frame: pd.DataFrame, from_s: float, east_m: float, north_m: float) -> pd.DataFrame:
    """The log with all positions from a time on displaced."""
    frame, rows = frame.copy(), rows_of(frame, from_s, None)
    for name, size_m in zip(AXES, (east_m, north_m), strict=True):
        frame.loc[rows, name] += size_m
    return frame


@settings(max_examples=12)
@given(st.sampled_from(RUNS), st.floats(5.0, 50.0), st.floats(1.0, 6.0), st.floats(0.0, 360.0), st.sampled_from([1, 2]))
def test_a_jump_is_told_and_what_follows_is_kept(
    name: str, from_s: float, size_m: float, towards_deg: float, every: int
) -> None:
    clean = clean_frames()[name].iloc[::every].reset_index(drop=True)
    side = np.radians(towards_deg)
    log = build_log(displace(clean, from_s, size_m * np.sin(side), size_m * np.cos(side)), name)
    assert [(fault.id, fault.run) for fault in log.faults] == [("position_jump", name)]
    assert log.faults[0].from_s - START_S == pytest.approx(from_s, abs=0.5)
    said = re.search(r"jump by ([0-9.]+) m", log.faults[0].words)
    assert said is not None and float(said[1]) == pytest.approx(size_m, abs=0.12)
    before = build_log(clean, name)
    both = before.used & log.used
    assert np.count_nonzero(before.used) - np.count_nonzero(both) <= 8
    apart = np.hypot(log.easting_m - before.easting_m, log.northing_m - before.northing_m)
    assert float(np.max(apart[both])) < 0.15
    cut = int(np.flatnonzero(log.time_s >= START_S + from_s)[0])
    assert log.segment[log.used & (np.arange(len(log.used)) > cut)].min() > log.segment[: cut - 8].max()


@pytest.mark.parametrize("name", RUNS)
def test_clean_runs_have_no_jump(name: str) -> None:
    columns = extract_columns(clean_frames()[name], name)[0]
    same, faults = correct_position_jumps(columns, name)
    assert faults == [] and same is columns


def test_one_wrong_position_is_no_jump() -> None:
    frame = clean_frames()["steps"].copy()
    frame.loc[200, "easting_m"] += 2.0
    assert build_log(frame, "steps").faults == ()


def test_jumps_again_and_again_are_a_lost_fix() -> None:
    frame = clean_frames()["waves"]
    for number in range(5):
        frame = displace(frame, 20.0 + 4.0 * number, (-1.0) ** number * 2.0, 0.0)
    assert {fault.id for fault in build_log(frame, "waves").faults} == {"position_lost"}


def test_two_jumps_far_from_each_other_are_two() -> None:
    frame = displace(displace(clean_frames()["right"], 12.0, 2.7, 0.0), 40.0, 0.0, -1.5)
    log = build_log(frame, "right")
    assert [round(fault.from_s - START_S) for fault in log.faults] == [12, 40]
    clean = build_log(clean_frames()["right"], "right")
    assert float(np.max(np.abs(log.northing_m - clean.northing_m)[log.used])) < 0.15


def test_the_sentence_has_time_size_and_direction() -> None:
    frame = displace(clean_frames()["tool"], 30.0, 2.7, 0.0)
    (fault,) = list_onset_faults([build_log(frame, "tool")])
    assert (fault.id, fault.run, fault.to_s) == ("position_jump", "tool", None)
    assert "jump by 2.7 m to the east" in fault.words and "(at 30 s after the start)" in fault.words
    assert fault.sentence.startswith("tool: ")
