"""Columns that are slower than the log count where they were measured, and commands that were really held stay."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pandas as pd
import pytest

from fields.arrays import Flags, Floats
from tests.identification.fault_logs import clean_frames
from tests.identification.log_tables import held
from tests.truth.drives import drive, stairs, straight, triangle
from tests.truth.second import Second
from vehicle.identification.diagnosis.corrections import (
    find_held_knots,
    find_knots,
    find_line_knots,
    mark_stale_columns,
    mark_stale_columns_of_set,
)
from vehicle.identification.diagnosis.log_notes import describe_columns
from vehicle.identification.diagnosis.results import NAMED, REFUTED, Finding
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log

WAVES = drive("waves", 60.0, triangle(15.0, 9.0), stairs((20.0, 1.0), (20.0, 1.8), (20.0, 1.2)))
STEPS = drive("steps", 60.0, stairs(*[(6.0, 12.0), (6.0, -9.0), (6.0, 4.0)] * 4), 1.4)


@lru_cache
def frame_of(name: str) -> pd.DataFrame:
    return Second({}, 3).log({"waves": WAVES, "steps": STEPS}[name])


def refresh(frame: pd.DataFrame, name: str, every_s: float, uneven: float = 0.0, lines: bool = False) -> pd.DataFrame:
    """The log with a column that is refreshed every so often, and repeated or interpolated in between."""
    rng, time = np.random.default_rng(4), frame.time_s.to_numpy()
    gaps = every_s * (1.0 + uneven * rng.uniform(-1.0, 1.0, int(np.ptp(time) / every_s) + 2))
    rows = np.unique(np.searchsorted(time, time[0] + np.concatenate([[0.0], np.cumsum(gaps)])).clip(0, len(time) - 1))
    values = frame[name].to_numpy()
    held = values[rows][np.searchsorted(rows, np.arange(len(time)), side="right") - 1]
    return frame.assign(**{name: np.interp(time, time[rows], values[rows]) if lines else held})


def read(frame: pd.DataFrame, name: str = "run") -> Log:
    return build_log(frame, name)


def measure_hold_s(time: Floats, measured: Flags) -> float:
    return float(np.median(np.diff(time[measured])))


@pytest.mark.parametrize("name", ["waves", "steps"])
def test_columns_as_fast_as_the_log_are_left_alone(name: str) -> None:
    log = read(frame_of(name))
    assert mark_stale_columns(log) is log
    assert describe_columns([log], []) == ()


@pytest.mark.parametrize("column", ["steering_deg", "speed_mps"])
@pytest.mark.parametrize(("every_s", "uneven", "lines"), [(0.5, 0.0, False), (2.0, 0.5, False), (1.0, 0.0, True)])
def test_slow_columns_are_told_with_sizes(column: str, every_s: float, uneven: float, lines: bool) -> None:
    log = mark_stale_columns(read(refresh(frame_of("waves"), column, every_s, uneven, lines)))
    knots, shown = log.measured_rows[column], getattr(log, column)
    assert measure_hold_s(log.time_s, knots) == pytest.approx(every_s, rel=0.2)
    assert np.mean(~knots) == pytest.approx(1.0 - 0.1 / every_s, abs=0.06)
    assert np.allclose(shown, np.interp(log.time_s, log.time_s[knots], shown[knots]))
    (told,) = describe_columns([log], [])
    assert told.hold_s == pytest.approx(every_s, rel=0.2) and "is refreshed every" in told.words
    assert ("a tenth of the time" in told.words) is (uneven > 0.0)


def test_an_angle_that_looks_held_in_one_log_alone_is_a_wheel_that_was_held() -> None:
    """In the other logs of the same instrument it changes from row to row."""
    held, moving = read(refresh(frame_of("waves"), "steering_deg", 1.0), "held"), read(frame_of("waves"), "moving")
    assert "steering_deg" in mark_stale_columns_of_set([held])[0].measured_rows
    assert all("steering_deg" not in log.measured_rows for log in mark_stale_columns_of_set([held, moving, moving]))


def test_a_held_column_is_nearer_to_the_truth_than_before() -> None:
    frame = frame_of("waves")
    held = refresh(frame, "steering_deg", 1.0)
    log = mark_stale_columns(read(held))
    assert log.steering_deg is not None
    before, after = (float(np.std(values - frame.steering_deg)) for values in (held.steering_deg, log.steering_deg))
    assert after < 0.5 * before


def test_commands_in_steps_are_commands_and_late_ones_are_stale() -> None:
    """Wheels that move before a held command does show that it was logged late."""
    assert "steering_command_deg" not in mark_stale_columns(read(frame_of("steps"))).measured_rows
    late = mark_stale_columns(read(refresh(frame_of("waves"), "steering_command_deg", 2.0)))
    assert measure_hold_s(late.time_s, late.measured_rows["steering_command_deg"]) == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize(("name", "every_s", "is_stale"), [("waves", 2.1, True), ("steps", None, False)])
def test_a_slow_wheel_angle_tells_as_well_whether_commands_are_late(
    name: str, every_s: float | None, is_stale: bool
) -> None:
    """Read at other times than the commands, it moves before those that are late, and after those that are steps."""
    frame = refresh(frame_of(name), "steering_deg", 1.7)
    frame = refresh(frame, "steering_command_deg", every_s) if every_s else frame
    measured = mark_stale_columns(read(frame)).measured_rows
    assert "steering_deg" in measured and ("steering_command_deg" in measured) is is_stale


def test_too_few_readings_do_not_make_a_command_late() -> None:
    frame = refresh(refresh(frame_of("waves"), "steering_deg", 0.3), "steering_command_deg", 0.25)
    measured = mark_stale_columns(read(frame.iloc[:36].reset_index(drop=True))).measured_rows
    assert "steering_command_deg" not in measured


def test_a_command_at_rest_was_read_with_the_wheel_angle() -> None:
    """Only its steps show when a held command was read; noise of a wheel angle of the same readings shows all."""
    frame = frame_of("steps")
    for column in ("steering_deg", "steering_command_deg"):
        frame = refresh(frame, column, 1.6)
    waves = frame_of("waves")
    for column in ("steering_deg", "steering_command_deg"):
        waves = refresh(waves, column, 1.6)
    log = mark_stale_columns_of_set([read(waves, "waves"), read(frame, "steps")])[1]
    readings = log.measured_rows["steering_command_deg"]
    assert np.array_equal(readings, log.measured_rows["steering_deg"])
    assert measure_hold_s(log.time_s, readings) == pytest.approx(1.6, abs=0.1)


def test_what_is_slow_in_one_log_is_slow_in_another_of_the_same_instruments() -> None:
    slow = [read(refresh(frame_of(name), "steering_deg", 2.0), name) for name in ("waves", "steps")]
    marked = mark_stale_columns_of_set(slow)
    assert all("steering_deg" in log.measured_rows for log in marked)
    fast = read(frame_of("steps"))
    assert mark_stale_columns_of_set([slow[0], fast])[1] is fast


def test_few_lines_of_a_command_are_slow_where_other_logs_show_it() -> None:
    """A command that moves twice in a run says nothing alone of how often it was logged."""
    quiet = drive("quiet", 60.0, stairs((20.0, 6.0), (20.0, 12.0), (20.0, 6.0)), 1.4)
    frames = {"waves": frame_of("waves"), "quiet": Second({}, 3).log(quiet)}
    both = ("steering_deg", "steering_command_deg")
    logs = []
    for name, frame in frames.items():
        for column in both:
            frame = refresh(frame, column, 1.5, lines=True)
        logs.append(read(frame, name))
    assert "steering_command_deg" not in mark_stale_columns(logs[1]).measured_rows
    marked = mark_stale_columns_of_set(logs)[1].measured_rows["steering_command_deg"]
    rows = np.flatnonzero(marked)
    assert rows[0] == 0 and rows[-1] == len(marked) - 1 and np.diff(rows)[[1, 3]].tolist() == [15, 15]
    assert np.diff(logs[1].steering_command_deg[rows])[[0, 2, 4]] == pytest.approx(0.0)


def test_interpolated_positions_count_at_their_knots() -> None:
    frame = frame_of("waves")
    for name in ("easting_m", "northing_m"):
        frame = refresh(frame, name, 0.5, lines=True)
    log = mark_stale_columns(read(frame))
    assert log.fresh is not None and float(np.mean(log.fresh)) == pytest.approx(0.2, abs=0.03)
    assert mark_stale_columns(log).fresh is log.fresh


def test_noise_bends_and_rests_are_no_slow_columns() -> None:
    rng, time = np.random.default_rng(2), np.arange(0.0, 60.0, 0.1)
    noise, bend = rng.normal(0.0, 1.0, len(time)), np.sin(0.7 * time)
    coarse, line = np.round(3.0 * bend, 0), np.where(time < 30.0, 0.0, time - 30.0)
    for values in (noise, bend, coarse, line, np.zeros(len(time)), bend + np.round(0.02 * noise, 2)):
        assert find_knots(time, values) is None
    assert find_held_knots(np.repeat(rng.normal(0.0, 1.0, 60), 10)) is not None
    knots = find_line_knots(time, np.interp(time, time[::10], noise[::10]))
    assert knots is not None and set(range(0, 600, 10)) <= {*knots.tolist()}


# --- Ages of columns are those of the effects found ---


def finding(name: str, value: float | None, status: str = NAMED) -> Finding:
    values = None if value is None else {"time_s": value}
    return Finding(name, status, values, description=f"{name} it is.")


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
            frame = held(frame, rows, *columns[what], interpolated=interpolated)
        logs.append(build_log(frame, name))
    told = {one.column: one for one in describe_columns(mark_stale_columns_of_set(logs), [])}
    assert {name: one.hold_s for name, one in told.items()} == pytest.approx(told_s, rel=0.05)
    for name, one in told.items():
        assert one.words.count("every") == 1 and f"is refreshed every {told_s[name]:.1f} s" in one.words
        assert one.stale_share == pytest.approx(1.0 - 1.0 / holds[name], abs=0.05)


def test_how_often_a_column_is_read_is_told_by_the_logs_in_which_it_changes() -> None:
    """On lines a command hardly changes, which says little of how often it was read."""
    frames = clean_frames()
    slow = {name: held(frame, 15, "steering_deg", "steering_command_deg") for name, frame in frames.items()}
    for frame in slow.values():
        frame["steering_deg"] = frame["steering_deg"].round(0)
    logs = mark_stale_columns_of_set([build_log(frame, name) for name, frame in slow.items()])
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


def test_a_correction_of_all_runs_is_told_of_all_and_one_of_some_by_the_first() -> None:
    frame = Second({}, 3).log(straight(90.0, seconds=60.0))
    fast = [build_log(frame.assign(speed_mps=1.4 * frame.speed_mps), name) for name in ("one", "two")]
    assert describe_columns(fast, [])[0].words.startswith("all 2 runs: speed_mps reads 40 % more")
    (told,) = describe_columns(fast[:1], [])
    assert told.column == "speed" and told.words.startswith("one: speed_mps reads 40 % more")
    (told,) = describe_columns([*fast, build_log(frame, "three")], [])
    assert told.words.startswith("one and 1 more: speed_mps reads 40 % more")
