"""Ages of columns are those of the effects found."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tests.identification.fault_logs import clean_frames, clean_logs
from tests.truth.drives import straight
from tests.truth.second import Second
from vehicle.identification.diagnosis.corrections import mark_stale_columns_of_set
from vehicle.identification.diagnosis.log_notes import describe_columns
from vehicle.identification.diagnosis.results import NAMED, REFUTED, Finding
from vehicle.identification.logs.reader import build_log


def finding(name: str, value: float | None, status: str = NAMED) -> Finding:
    values = None if value is None else {"time_s": value}
    return Finding(name, status, values, None, None, None, None, "s", "position to antenna", f"{name} it is.")


def test_ages_come_from_what_was_found() -> None:
    found = [finding("position_delay", 0.3), finding("heading_filter", 0.6), finding("clock_offset_speed", -0.2)]
    by_column = {told.column: told for told in describe_columns([], [*found, finding("heading_delay", None, REFUTED)])}
    assert set(by_column) == {"position", "heading", "speed"}
    assert by_column["position"].delay_s == 0.3 and by_column["position"].words == "position_delay it is."
    assert by_column["heading"].filter_s == 0.6 and by_column["heading"].delay_s is None
    assert by_column["speed"].clock_offset_s == -0.2


def test_a_late_receiver_is_late_in_both_columns() -> None:
    told = describe_columns([], [finding("gnss_latency", 0.25)])
    assert [(one.column, one.delay_s) for one in told] == [("position", 0.25), ("heading", 0.25)]


def test_what_was_corrected_is_told_with_its_log() -> None:
    frame = Second({}, 3).log(straight(90.0, seconds=60.0))
    log = build_log(frame.assign(speed_mps=1.4 * frame.speed_mps), "line")
    (told,) = describe_columns([log], [])
    assert told.column == "speed" and told.words.startswith("line: speed_mps reads 40 % more")


def hold(frame: pd.DataFrame, names: tuple[str, ...], rows: int, interpolated: bool = False) -> pd.DataFrame:
    """The log with columns refreshed every so many rows, repeated or drawn straight in between."""
    place, time = np.arange(len(frame)), frame.time_s.to_numpy()
    out = frame.copy()
    for name in names:
        values = np.unwrap(frame[name].to_numpy(), period=360.0) if name == "heading_deg" else frame[name].to_numpy()
        held = np.interp(time, time[::rows], values[::rows]) if interpolated else values[place // rows * rows]
        out[name] = held % 360.0 if name == "heading_deg" else held
    return out


@pytest.mark.parametrize("interpolated", [False, True])
@pytest.mark.parametrize(
    ("holds", "told_s"),
    [
        ({"heading": 5}, {"heading": 0.5}),
        ({"position": 4}, {"position": 0.4}),
        ({"heading": 10, "position": 4}, {"position": 0.4, "heading": 1.0}),
    ],
)
def test_each_held_column_of_the_receiver_is_told(
    holds: dict[str, int], told_s: dict[str, float], interpolated: bool
) -> None:
    columns = {"heading": ("heading_deg",), "position": ("easting_m", "northing_m")}
    logs = []
    for name in ("right", "left", "steps"):
        frame = clean_frames()[name]
        for what, rows in holds.items():
            frame = hold(frame, columns[what], rows, interpolated)
        logs.append(build_log(frame, name))
    told = {one.column: one for one in describe_columns(mark_stale_columns_of_set(logs), [])}
    assert {name: one.hold_s for name, one in told.items()} == pytest.approx(told_s, rel=0.05)
    for name, one in told.items():
        assert one.words.count("every") == 1 and f"is refreshed every {told_s[name]:.1f} s" in one.words
        assert one.stale_share == pytest.approx(1.0 - 1.0 / holds[name], abs=0.05)


def test_how_often_a_column_is_read_is_told_by_the_logs_in_which_it_changes() -> None:
    """On lines a command hardly changes, which says little of how often it was read."""
    frames = clean_frames()
    held = {name: hold(frame, ("steering_deg", "steering_command_deg"), 15) for name, frame in frames.items()}
    for frame in held.values():
        frame["steering_deg"] = frame["steering_deg"].round(0)
    logs = mark_stale_columns_of_set([build_log(frame, name) for name, frame in held.items()])
    told = {one.column: one.hold_s for one in describe_columns(logs, [])}
    assert told["steering_command"] == pytest.approx(1.5, abs=0.2)


def test_a_command_at_rest_is_no_older_than_a_moving_one() -> None:
    """A controller of 10 Hz in a log of 25 Hz repeats three of five rows, also where it holds an angle for long."""
    time = np.arange(0.0, 120.0, 0.04)
    changed = np.unique(np.searchsorted(time, np.arange(0.0, 120.0, 0.1) - 1e-9))
    moving = changed[changed < len(time) // 2]
    measured = np.isin(np.arange(len(time)), [*moving, *range(len(time) // 2, len(time), 80)])
    columns = {"time_s": time, "easting_m": 0.4 * time, "northing_m": 0.01 * time, "steering_command_deg": 0.0 * time}
    log = build_log(pd.DataFrame(columns), "rest", check=False)
    (told,) = describe_columns([replace(log, measured_rows={"steering_command_deg": measured})], [])
    assert np.mean(~measured) > 0.75
    assert told.stale_share == pytest.approx(0.6, abs=0.02)
    assert "is refreshed every 0.1 s: 60 % of its rows" in told.words  # both times round to the same


def test_a_heading_of_every_row_is_no_held_one() -> None:
    assert describe_columns(mark_stale_columns_of_set(list(clean_logs().values())), []) == ()


def test_a_correction_of_all_runs_is_told_of_all_and_one_of_some_by_the_first() -> None:
    frame = Second({}, 3).log(straight(90.0, seconds=60.0))
    fast = [build_log(frame.assign(speed_mps=1.4 * frame.speed_mps), name) for name in ("one", "two")]
    assert describe_columns(fast, [])[0].words.startswith("all 2 runs: speed_mps reads 40 % more")
    (told,) = describe_columns([*fast, build_log(frame, "three")], [])
    assert told.words.startswith("one and 1 more: speed_mps reads 40 % more")
