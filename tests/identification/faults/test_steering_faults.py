"""Steering that stops following, found at any onset; no effect, no closed loop and no sliding tyre is a fault."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.diagnosis.sets import drawn
from tests.examples import seldom
from tests.identification.fault_logs import START_S, clean_frames, degrade, ignore_commands, rows_of
from tests.truth.drives import three_speeds_programme
from tests.truth.second import second_logs
from vehicle.identification.diagnosis.log_notes import format_time, list_onset_faults
from vehicle.identification.faults.steering_evidence import (
    build_evidence_segments,
    find_largest_angles,
    fit_path_scale,
    follow_command,
)
from vehicle.identification.faults.steering_faults import mark_steering_faults
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log


def logs_with(changed: dict) -> list[Log]:  # type: ignore[type-arg]
    frames = clean_frames() | changed
    return [build_log(frame, name) for name, frame in frames.items()]


@settings(max_examples=2)
@given(
    st.sampled_from(["there", "back", "waves", "lines"]), st.floats(12.0, 30.0),
    st.one_of(st.none(), st.floats(12.0, 20.0)),
    st.sampled_from(["wheel", "linkage", "no sensor"]),
)  # fmt: skip
def test_steering_that_stops_following_is_found(name: str, from_s: float, length_s: float | None, kind: str) -> None:
    to_s = None if length_s is None else from_s + length_s
    frame = ignore_commands(clean_frames()[name], from_s, to_s, kind == "linkage")
    logs = logs_with({name: frame})
    if kind == "no sensor":
        logs = [build_log(clean.drop(columns="steering_deg"), run) for run, clean in
                (clean_frames() | {name: frame}).items()]  # fmt: skip
    faults = [fault for log in mark_steering_faults(logs) for fault in log.faults]
    assert faults and {(fault.id, fault.run) for fault in faults} == {("steering_loose", name)}
    assert faults[0].from_s - START_S == pytest.approx(from_s, abs=5.0)


@pytest.mark.parametrize("name", ["there", "waves", "lines"])
@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_a_heading_that_leaves_the_course_is_no_fault_of_the_steering(name: str, noise_m: float) -> None:
    frame, rows = clean_frames()[name].copy(), rows_of(clean_frames()[name], 20.0, 32.0)
    seconds = frame.time_s.to_numpy()[rows] - frame.time_s[rows[0]]
    frame.loc[rows, "heading_deg"] = (frame.heading_deg[rows] + 30.0 * np.sin(np.pi * seconds / 6.0)) % 360.0
    every_row = degrade(frame, 0.0, None, noise_m, 4)
    faults = [fault for log in mark_steering_faults(logs_with({name: every_row})) for fault in log.faults]
    assert [(fault.id, fault.run) for fault in faults] == [("position_lost", name)]
    assert faults[0].from_s - START_S == pytest.approx(20.0, abs=5.0) and "heading_deg" in faults[0].words
    assert faults[0].to_s is not None and faults[0].to_s - START_S == pytest.approx(32.0, abs=2.0)


@pytest.mark.slow
def test_clean_runs_have_no_fault_with_and_without_columns() -> None:
    for dropped in ([], ["steering_deg"], ["steering_command_deg"], ["heading_deg"], ["heading_deg", "steering_deg"]):
        logs = [build_log(frame.drop(columns=dropped), name) for name, frame in clean_frames().items()]
        marked = mark_steering_faults(logs)
        assert [fault for log in marked for fault in log.faults] == [] and [log.rows_used for log in marked] == [
            log.rows_used for log in logs
        ], dropped


@pytest.mark.parametrize(
    "name",
    ["steering_deadband", "steering_gain", *seldom("steering_dead_time", "steering_rate", "side_slip", "grip_patch")],
)
def test_no_effect_of_the_catalogue_is_a_fault(name: str) -> None:
    rng = np.random.default_rng(7)
    frames = second_logs({name: drawn(name, 1.25, rng)}, 62, three_speeds_programme())
    for dropped in ([], ["steering_deg"]):
        logs = [build_log(frame.drop(columns=dropped), frame.attrs["name"]) for frame in frames]
        assert [fault for log in mark_steering_faults(logs) for fault in log.faults] == []


def test_a_fault_is_told_by_the_time_of_the_day_or_since_the_start() -> None:
    frame = ignore_commands(clean_frames()["lines"], 20.0, None, False)
    (fault,) = list_onset_faults(mark_steering_faults(logs_with({"lines": frame})))
    assert (fault.id, fault.run) == ("steering_loose", "lines")
    assert "s after the start the wheels do not follow" in fault.words and ", until " in fault.words
    assert format_time(1785073400.0, 1785073000.0) == "13:43:20 UTC" and format_time(130.4, 100.0).startswith("30 s")


def test_the_scale_of_a_path_ignores_the_rows_of_a_fault() -> None:
    frames = clean_frames() | {"lines": ignore_commands(clean_frames()["lines"], 12.0, None, True)}
    scales = []
    for some in (clean_frames(), frames):
        logs = [build_log(frame, name) for name, frame in some.items()]
        locks = find_largest_angles(logs)
        assert min(locks) > 15.0
        scales.append(fit_path_scale([part for log in logs for part in build_evidence_segments(log, locks)]))
    assert scales[0] is not None and scales[1] is not None
    assert scales[1].per_degree == pytest.approx(scales[0].per_degree, rel=0.05)
    assert fit_path_scale([]) is None


def test_commands_to_and_fro_allow_wheels_that_are_on_their_way_back() -> None:
    """A slow steering has not come to the right yet when the command is to the left again; a usual one has."""
    time = np.arange(0.0, 60.0, 0.1)
    command = np.select([time < 15.0, time < 18.2], [-25.0, 29.0], -13.0)
    wheel = follow_command(command, 0.1, 16.0, 0.15)
    columns = {"time_s": time, "easting_m": 1.5 * time, "northing_m": np.sin(time), "steering_deg": wheel}
    log = build_log(pd.DataFrame({**columns, "steering_command_deg": command}), "swing", check=False)
    (part,) = build_evidence_segments(log, (30.0, 30.0))
    assert part.wheel is not None
    assert np.max(np.maximum(part.low - part.wheel, part.wheel - part.high)) < 1.0
