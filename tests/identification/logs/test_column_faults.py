"""Frozen columns and lost fixes: found with their times at any onset, never in clean logs."""

import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.identification.fault_logs import RUNS, START_S, clean_frames, degrade, freeze, rows_of
from tests.identification.log_tables import runs
from vehicle.identification.diagnosis.log_notes import list_onset_faults
from vehicle.identification.logs.column_faults import collect_fault_rows, correct_position_jumps, find_column_faults
from vehicle.identification.logs.motion import build_raw_motion
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.standing_columns import find_standing_spans
from vehicle.identification.logs.table import extract_columns

POSITION, BENT = ("easting_m", "northing_m"), ("right", "left", "steps")
onsets = st.floats(12.0, 34.0)
lengths = st.one_of(st.none(), st.floats(10.0, 20.0))

AXES = ("easting_m", "northing_m")


def found(frame):  # type: ignore[no-untyped-def]
    """The faults of a log: id, and times since its start."""
    log = build_log(frame, "run")
    return [(one.id, one.from_s - START_S, None if one.to_s is None else one.to_s - START_S) for one in log.faults]


def assert_one(faults, fault_id, from_s, to_s):  # type: ignore[no-untyped-def]
    assert [one[0] for one in faults] == [fault_id]
    assert faults[0][1] == pytest.approx(from_s, abs=5.0)
    if to_s is None or faults[0][2] is None:
        assert faults[0][2] is None or faults[0][2] > 50.0
    else:
        assert faults[0][2] == pytest.approx(to_s, abs=5.0)


@settings(max_examples=4)
@given(st.sampled_from(RUNS), onsets, lengths)
def test_frozen_positions_are_found_at_any_onset(name: str, from_s: float, length_s: float | None) -> None:
    to_s = None if length_s is None else from_s + length_s
    assert_one(found(freeze(clean_frames()[name], POSITION, from_s, to_s)), "position_frozen", from_s, to_s)


def is_far_from_repeated(frame, from_s, to_s, at_least_deg, seconds):  # type: ignore[no-untyped-def]
    """Whether the wheel leaves the angle repeated so far, beyond half of it (sliding tyres), for so many seconds."""
    rows, angle = rows_of(frame, from_s, to_s), frame.steering_deg.to_numpy()
    repeated = angle[rows[0] - 1]
    excess = np.abs(angle[rows] - repeated) - 0.5 * abs(repeated)
    return np.count_nonzero(excess > at_least_deg) >= 10.0 * seconds


def is_pace_changed(frame, from_s, to_s):  # type: ignore[no-untyped-def]
    """Whether the speed changes by half a metre per second and by 40 % while its column repeats a value."""
    slow, middle, fast = np.quantile(frame.speed_mps.to_numpy()[rows_of(frame, from_s, to_s)], (0.05, 0.5, 0.95))
    return fast - slow > max(0.5, 0.4 * middle)


@settings(max_examples=4)
@given(
    st.sampled_from([
        ("heading_deg", "heading_frozen", BENT), ("speed_mps", "speed_frozen", RUNS),
        ("steering_deg", "wheel_sensor_frozen", ("steps", "lines")),
    ]), st.integers(0, 7), onsets, lengths,
)  # fmt: skip
def test_one_frozen_column_is_found_at_any_onset(what, place, from_s, length_s) -> None:  # type: ignore[no-untyped-def]
    column, fault_id, names = what
    to_s = None if length_s is None else from_s + length_s
    clean = clean_frames()[names[place % len(names)]]
    if column == "steering_deg":  # a wheel that hardly moves along a row is as if frozen: see the next test
        assume(is_far_from_repeated(clean, from_s, to_s, 8.0, 1.5))
    if column == "speed_mps":  # at a steady pace only lost noise shows it, beside ten windows of 3 s without a halt
        halts = clean.speed_mps[30:].min() < 0.3
        assume(is_pace_changed(clean, from_s, to_s) or (length_s is not None and length_s < 17.0 and not halts))
    assert_one(found(freeze(clean, (column,), from_s, to_s)), fault_id, from_s, to_s)


@pytest.mark.parametrize("from_s, to_s, told", [(34.0, 44.0, False), (18.0, 28.0, True)])
def test_a_wheel_angle_frozen_along_a_row_is_not_told_but_one_frozen_in_a_turn_is(
    from_s: float, to_s: float, told: bool
) -> None:
    clean = clean_frames()["lines"]
    assert bool(is_far_from_repeated(clean, from_s, to_s, 4.0, 0.1)) is told
    faults = found(freeze(clean, ("steering_deg",), from_s, to_s))
    assert [fault[0] for fault in faults] == (["wheel_sensor_frozen"] if told else [])


@settings(max_examples=4)
@given(st.sampled_from(RUNS), onsets, lengths, st.floats(0.6, 2.5), st.integers(0, 999))
def test_a_lost_fix_is_found_at_any_onset(
    name: str, from_s: float, length_s: float | None, size_m: float, seed: int
) -> None:
    to_s = None if length_s is None else from_s + length_s
    assert_one(found(degrade(clean_frames()[name], from_s, to_s, size_m, seed)), "position_lost", from_s, to_s)


@pytest.mark.parametrize("name", ["there", "right", "waves"])
@pytest.mark.parametrize("to_s", [None, 34.0])
def test_a_fix_that_wanders_smoothly_from_row_to_row_is_lost(name: str, to_s: float | None) -> None:
    frame, rng = clean_frames()[name].copy(), np.random.default_rng(8)
    rows = rows_of(frame, 20.0, to_s)
    for axis in ("easting_m", "northing_m"):
        knots = rng.normal(0.0, 0.9, len(rows) // 5 + 2)
        frame.loc[rows, axis] += np.interp(np.arange(len(rows)) / 5.0, np.arange(len(knots)), knots)
    assert_one(found(frame), "position_lost", 20.0, to_s)


def test_a_fault_from_the_first_row_and_one_that_comes_and_goes() -> None:
    frame = clean_frames()["lines"]
    (first,) = found(freeze(frame, POSITION, 0.0, 20.0))
    assert first[:2] == ("position_frozen", 0.0) and first[2] == pytest.approx(20.0, abs=1.0)
    twice = found(freeze(freeze(frame, POSITION, 10.0, 18.0), POSITION, 30.0, 40.0))
    assert [(one[0], round(one[1])) for one in twice] == [("position_frozen", 10), ("position_frozen", 30)]


@pytest.mark.parametrize("name", RUNS)
def test_clean_runs_have_no_fault(name: str) -> None:
    assert found(clean_frames()[name]) == []


def test_no_run_of_the_first_reference_has_a_fault_even_without_noise_or_at_rest() -> None:
    for name, frame in runs().items():
        assert build_log(frame, name, check=False).faults == (), name
    still = clean_frames()["there"].copy()
    rows = rows_of(still, 20.0, 30.0)
    later = np.arange(len(still)) > rows[-1]
    for column in POSITION:
        jump = still[column][rows[-1]] - still[column][rows[0]]
        still.loc[rows, column] = still[column][rows[0]]
        still.loc[later, column] -= jump
    still.loc[rows, ["speed_mps", "speed_command_mps"]] = 0.0
    still.loc[rows, "heading_deg"] = still.heading_deg[rows[0]]
    assert found(still) == [], "a halt is no fault"


def test_rows_of_a_fault_are_left_out_by_a_rule_of_its_own() -> None:
    frame = freeze(clean_frames()["lines"], POSITION, 20.0, 30.0)
    columns = {name: frame[name].to_numpy(float) for name in frame.columns}
    faults = find_column_faults(columns, "run")
    ((rule, rows),) = collect_fault_rows(faults).items()
    assert rule.startswith("position frozen: ") and 98 <= len(rows) <= 102
    log = build_log(frame, "run")
    assert [one.rows for one in log.gated] == [len(rows)] and not log.used[rows].any() and log.segment_count == 2


def test_evidence_of_a_drive_by_hand() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    columns = {"time_s": time, "easting_m": 2.0 * time, "northing_m": 0.0 * time, "speed_mps": 2.0 + 0.0 * time}
    motion = build_raw_motion(columns, np.arange(len(time)))
    assert motion.pace == pytest.approx(np.full(len(time), 2.0)) and motion.moving.all()
    assert np.nanmean(motion.course) == pytest.approx(np.pi / 2) and motion.total_s == pytest.approx(19.9)
    assert motion.is_contradicted("position", (0, 50)) and not motion.is_contradicted("position", (0, 5))
    assert not motion.is_contradicted("heading", (0, 150))


@pytest.mark.parametrize("column, fault_id", [("heading_deg", "heading_frozen"), ("speed_mps", "speed_frozen")])
def test_lost_noise_shows_a_long_standstill_on_a_straight_row_from_its_first_quarter_on(
    column: str, fault_id: str
) -> None:
    assert_one(found(freeze(clean_frames()["there"], (column,), 17.0, None)), fault_id, 17.0, None)


@pytest.mark.parametrize("noise_deg, told", [(0.02, False), (0.2, True)])
@pytest.mark.parametrize("seed", [7, 52])
def test_only_noise_beyond_a_digit_shows_that_a_wheel_angle_stood_still(
    seed: int, noise_deg: float, told: bool
) -> None:
    """Straight on at 0.05 degrees, told as 0.0 or 0.1 by the slightest noise, and at 0.0 from 12 to 16 s: no fault."""
    time = np.arange(0.0, 30.0, 0.1)
    stands = (time > 12.0) & (time < 16.0)
    noise = noise_deg * np.random.default_rng(seed).standard_normal(len(time))
    wheel = np.where(stands, 0.0, np.round(0.05 + noise, 1) + 0.0)
    columns = {"time_s": time, "easting_m": 0.0 * time, "northing_m": 2.0 * time, "steering_deg": wheel}
    assert bool(find_column_faults(columns, "run")) is told


@pytest.mark.parametrize("digit_deg", [0.1, 0.5, 1.0, 2.0])
def test_headings_in_steps_are_not_frozen(digit_deg: float) -> None:
    for name, clean in clean_frames().items():
        stepped = clean.assign(heading_deg=(clean.heading_deg / digit_deg).round() * digit_deg)
        assert not [one for one in found(stepped) if one[0] == "heading_frozen"], name


def test_a_speed_of_0_below_a_threshold_is_a_limit_of_the_sensor_and_no_fault() -> None:
    """A radar shows nothing below 0.9 m/s; the same zeros at any pace are a sensor that lost its wire."""
    time = np.arange(0.0, 90.0, 0.1)
    pace = np.where((time > 30.0) & (time < 50.0), 0.6, 1.6) + 0.01 * np.sin(40.0 * time)
    columns = {"time_s": time, "easting_m": np.cumsum(0.1 * pace), "northing_m": 0.0 * time}
    (limit,) = find_column_faults({**columns, "speed_mps": np.where(pace < 0.9, 0.0, pace)}, "run")
    (rule,) = collect_fault_rows([limit])
    assert limit.fault.id == "speed_threshold" and rule.startswith("speed threshold: speed_mps is 0 while")
    assert limit.rows == pytest.approx(np.flatnonzero(pace < 0.9), abs=2)
    lost = np.where((time > 40.0) & (time < 60.0), 0.0, pace)
    (fault,) = find_column_faults({**columns, "speed_mps": lost}, "run")
    assert fault.fault.id == "speed_frozen"


def test_a_fast_tight_bend_that_speed_and_heading_show_too_is_no_lost_fix() -> None:
    """A model car at 2.4 m/s on a circle of 0.6 m: 9.6 m/s2, more than any tractor; without its heading it is lost."""
    time = np.arange(0.0, 60.0, 0.05)
    angle = np.cumsum(0.05 * np.where(np.sin(0.2 * time) > 0.0, 4.0, 0.1))
    east, north = (np.cumsum(0.05 * 2.4 * swing) for swing in (np.sin(angle), np.cos(angle)))
    columns = {"time_s": time, "easting_m": east, "northing_m": north, "speed_mps": 2.4 + 0.0 * time}
    headings = {"heading_deg": np.mod(np.degrees(angle), 360.0)}
    assert find_column_faults({**columns, **headings}, "run") == []
    assert find_column_faults({**columns, "heading_deg": 0.0 * time}, "run") != []


@pytest.mark.parametrize("name, column, noise", [
    ("there", "easting_m", 0.01), ("right", "easting_m", 0.03), ("right", "heading_deg", 0.2),
    ("steps", "heading_deg", 0.1), ("lines", "speed_mps", 0.02),
])  # fmt: skip
@pytest.mark.parametrize("to_s", [None, 40.0])
def test_a_column_that_stands_within_its_noise_is_frozen(
    name: str, column: str, noise: float, to_s: float | None
) -> None:
    """Also where it thaws: positions that jump then are no jump of their own."""
    columns, rng = (POSITION if column == "easting_m" else (column,)), np.random.default_rng(4)
    frame = freeze(clean_frames()[name], columns, 20.5, to_s)
    if column == "speed_mps":  # which has one pace for most of the run: as if it had driven at another before
        frame.loc[rows_of(frame, 20.5, to_s), column] = 0.6
    for each in columns:
        frame.loc[rows_of(frame, 20.5, to_s), each] += rng.normal(0.0, noise, len(rows_of(frame, 20.5, to_s)))
    fault_id = {"easting_m": "position_frozen", "heading_deg": "heading_frozen", "speed_mps": "speed_frozen"}[column]
    assert_one(found(frame), fault_id, 20.5, to_s)


def drive_by_hand(pace, turn_deg_per_s, seed=2):  # type: ignore[no-untyped-def]
    """Columns of a drive at a pace (k,) and a rate of turning, 10 Hz, with noise."""
    time, rng = 0.1 * np.arange(len(pace)), np.random.default_rng(seed)
    heading = np.cumsum(0.1 * np.radians(turn_deg_per_s))
    east, north = np.cumsum(0.1 * pace * np.sin(heading)), np.cumsum(0.1 * pace * np.cos(heading))
    noise = rng.standard_normal((4, len(pace)))
    return {
        "time_s": time, "easting_m": east + 0.01 * noise[0], "northing_m": north + 0.01 * noise[1],
        "heading_deg": (np.degrees(heading) + 0.2 * noise[2]) % 360.0, "speed_mps": pace + 0.02 * noise[3],
    }  # fmt: skip


def test_a_tractor_that_stands_or_drives_straight_for_long_has_no_frozen_column() -> None:
    pace = np.repeat([1.4, 0.0, 1.4, 0.0, 2.0], 300).astype(float)
    columns = drive_by_hand(pace, np.zeros(1500))
    assert find_column_faults(columns, "run") == []
    slipping = np.where(np.arange(1500) % 300 < 150, 0.75, 1.0)  # wheels that turn evenly on soft ground
    ground = drive_by_hand(1.4 * slipping, np.zeros(1500))
    assert find_column_faults({**ground, "speed_mps": 1.4 + columns["speed_mps"] - pace}, "run") == []


def test_stopped_positions_are_told_from_a_stopped_speed_by_the_target() -> None:
    """From 30 s to 45 s the positions stay and the speed does not: either of them may be frozen."""
    pace = np.repeat([1.0, 1.6, 0.0, 1.6], 150).astype(float)
    turning = np.where(np.arange(600) % 200 < 60, 8.0, 0.0)
    columns = drive_by_hand(pace, turning)
    stated = {**columns, "speed_mps": np.where(pace == 0.0, 1.6, pace) + columns["speed_mps"] - pace}
    driven = {**stated, "speed_command_mps": np.where(pace == 0.0, 1.6, pace)}
    (fault,) = find_column_faults(driven, "run")
    assert fault.fault.id == "position_frozen" and fault.fault.from_s == pytest.approx(30.0, abs=1.0)
    halted = {**stated, "speed_command_mps": pace}
    (fault,) = find_column_faults(halted, "run")
    assert fault.fault.id == "speed_frozen"
    assert fault.fault.between_s == pytest.approx((15.0, 30.0), abs=1.5)


def test_means_of_a_heading_that_stands_while_the_course_turns() -> None:
    """From 40 s on, 0.2 degrees of noise about one value, on a circle of 15 m at 1.5 m/s."""
    time = np.arange(0.0, 90.0, 0.1)
    heading = np.where(time < 10.0, 0.0, (time - 10.0) * 0.1)
    east, north = (np.cumsum(0.15 * swing) for swing in (np.sin(heading), np.cos(heading)))
    noise = 0.2 * np.random.default_rng(3).standard_normal(len(time))
    shown = np.degrees(np.where(time < 40.0, heading, 3.0)) + noise
    columns = {"time_s": time, "easting_m": east, "northing_m": north, "heading_deg": shown % 360.0}
    columns["speed_mps"] = np.full(len(time), 1.5)
    ((first, last, _),) = find_standing_spans(build_raw_motion(columns, np.arange(len(time))), "heading")
    assert time[first] == pytest.approx(40.0, abs=1.5) and last >= len(time) - 11
    right = {**columns, "heading_deg": (np.degrees(heading) + noise) % 360.0}
    assert find_standing_spans(build_raw_motion(right, np.arange(len(time))), "heading") == []


# --- Positions that jump once and stay there: told with run, time and size, and what follows is as good as before ---


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
