"""Reading measured logs: gating with counts and lines, one-sentence refusals, and recognising wrong conventions."""

import os
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import count_examples, draw_seed, seldom
from tests.identification.analytic_drives import circle
from tests.identification.log_tables import BENT, HOME, SPOIL, refusal, runs, saved, table, to_degrees
from tests.truth.drives import default_programme, reversing
from tests.truth.effects import CLEAR_SIZES, OUTSIDE
from tests.truth.model import make_logs
from vehicle.identification.logs.conventions import find_convention_errors
from vehicle.identification.logs.gating import find_jumps, gate_rows
from vehicle.identification.logs.reader import build_log, count_rows_left_out, read_log, read_logs
from vehicle.identification.logs.readings import SPEED_UNITS, LogConvention, convert_columns
from vehicle.identification.logs.schema import COLUMNS, GatedRows, Log, number_segments
from vehicle.identification.logs.series import find_decreasing_entries
from vehicle.identification.logs.table import read_log_table

KNOWN = {**CLEAR_SIZES, **OUTSIDE}
CASES = [
    *(pytest.param(name, place // 3 % 3, marks=pytest.mark.matrix if place % 3 else ())
      for place, name in enumerate(sorted(KNOWN))),
    ("nothing", 0),
]  # fmt: skip
"""Effects, and the first of their runs."""
DROPPED = (
    (), ("steering_deg",), ("steering_command_deg",), ("speed_mps", "speed_command_mps"), ("heading_deg",),
)  # fmt: skip


# --- reading -----------------------------------------------------------------------------------------------------


def test_a_log_comes_back_as_it_was_written(tmp_path: Path) -> None:
    frame = runs()["steps"]
    log = read_log(saved(frame, tmp_path / "run 7.csv"))
    assert log.name == "run 7" and log.rows_used == len(frame) and log.gated == () and log.segment_count == 1
    for column in frame:
        assert np.array_equal(getattr(log, column), frame[column]), column
    assert log.roll_deg is None and log.pitch_deg is None and log.step_s == pytest.approx(0.1)


def test_absent_columns_have_the_contracts_defaults(tmp_path: Path) -> None:
    log = read_log(saved(table().assign(comment="dry", rpm=1800), tmp_path / "a.csv"))
    assert (log.shuttle == 1).all() and (log.implement == 0).all()
    assert log.steering_command_deg is None and log.speed_command_mps is None
    assert log.ignored_columns == ("comment", "rpm")


def test_an_empty_optional_column_counts_as_absent(tmp_path: Path) -> None:
    log = read_log(saved(table().assign(roll_deg=np.nan, heading_deg=np.nan), tmp_path / "a.csv"))
    assert log.roll_deg is None and log.heading_deg is None and log.rows_gated == 0


def test_bom_blanks_and_blank_lines_keep_the_line_numbers(tmp_path: Path) -> None:
    lines = table(6).to_csv(index=False).replace("time_s,", "\ufeff time_s ,").splitlines()
    path = tmp_path / "a.csv"
    path.write_text("\r\n".join([*lines[:3], ",,,,,", "", *lines[3:5], lines[5].replace("45.0", "abc"), lines[6]]))
    log = read_log(path)
    assert log.gated == (
        GatedRows("time missing or not a number", 2, 4),
        GatedRows("heading_deg missing or not a number", 1, 8),
    )
    assert log.rows_used == 5


def test_files_patterns_and_names(tmp_path: Path) -> None:
    for name, east_m in (("b", 0.0), ("a", 20.0)):
        saved(table().assign(easting_m=table().easting_m + east_m), tmp_path / f"{name}.csv")
    (tmp_path / "other").mkdir()
    saved(table(50), tmp_path / "other" / "a.csv")
    pattern = str(tmp_path / "*.csv")
    assert [log.name for log in read_logs(pattern)] == ["a", "b"]
    assert [log.name for log in read_logs([tmp_path / "b.csv", pattern])] == ["b", "a"]
    both = read_logs([tmp_path / "a.csv", tmp_path / "other" / "a.csv"])
    assert len({log.name for log in both}) == 2 and [log.rows_used for log in both] == [200, 50]
    assert "matches no file" in refusal(lambda: read_logs(str(tmp_path / "*.txt")))
    assert "No log was given" in refusal(lambda: read_logs([]))


def test_a_large_log_is_read_without_starting_threads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    path, header = tmp_path / "large.csv", "time_s,easting_m,northing_m,steering_deg\n"
    path.write_text(header + "".join(f"{row}.1,{row}.123,0,0\n" for row in range(240_000)))
    monkeypatch.setattr(threading.Thread, "start", refuse)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    frame = read_log_table(path)
    assert path.stat().st_size > 5 * 2**20 and frame.shape == (240_000, 4)
    assert list(frame.iloc[-1]) == ["239999.1", "239999.123", "0", "0"]


def test_a_log_of_a_million_columns_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text("," * 1_000_000 + "\n1,2\n")
    assert refusal(lambda: read_log(path)).endswith("has more than 200 columns; save only the columns that are needed.")


def test_parquet_is_read_or_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    try:
        table().to_parquet(path)
    except ImportError:
        path.write_bytes(b"PAR1")
        assert "install pyarrow" in refusal(lambda: read_log(path))
    else:
        assert read_log(path).rows_used == 200


# --- refusals ----------------------------------------------------------------------------------------------------


def without(*columns: str) -> str:
    return table().drop(columns=list(columns)).to_csv(index=False)


REFUSED = {
    "empty": ("", "is empty"),
    "blank": ("\n\n", "not a"),
    "header": (",".join(COLUMNS) + "\n", "a header and no row"),
    "one_row": (table(1).to_csv(index=False), "a header and one row"),
    "prose": ("Dear farmer,\nthe tractor drove well.\n", "is not a log"),
    "no_header": (table().to_csv(index=False, header=False), "is not a log"),
    "ragged": (table(5).to_csv(index=False) + "1,2,3,4,5,6,7,8\n", "is not a CSV"),
    "long_rows": (table(5).to_csv(index=False).replace("0.2\n", "0.2,9\n"), "is not a CSV"),
    "twice": ("time_s,time_s,easting_m\n1,2,3\n4,5,6\n", "column time_s more than once"),
    "no_time": (without("time_s"), "no column time_s"),
    "nearest": (without().replace("easting_m", "east_m"), 'add mapping "easting_m=east_m"'),
    "other_unit": (without().replace("time_s", "time_ms"), 'add mapping "time_ms=time_ms"'),
    "no_steering": (without("steering_deg"), "no column steering_command_deg or steering_deg"),
    "all_nan": (table().assign(easting_m=np.nan).to_csv(index=False), "no number in column easting_m"),
    "steering_nan": (table().assign(steering_deg=np.nan).to_csv(index=False), "no number in column steering"),
    "everything_nan": ((table() * np.nan).to_csv(index=False), "no number in column time_s"),
    "text": (table().assign(northing_m="north").to_csv(index=False), "its first cell is 'north'"),
    "backwards": (table()[::-1].to_csv(index=False), "sort the rows by time"),
    "standing_clock": (table().assign(time_s=5.0).to_csv(index=False), "log times with enough decimals"),
    "neutral": (table().assign(shuttle=0).to_csv(index=False), "shuttle in neutral: 200 rows from line 2"),
    "slow": (table(rate_hz=0.3).to_csv(index=False), "3.33333 s apart"),
    "fast": (table(rate_hz=1000.0).to_csv(index=False), "0.001 s apart"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_log_is_refused_in_one_sentence(case: str, tmp_path: Path) -> None:
    text, rule = REFUSED[case]
    path = tmp_path / f"{case}.csv"
    path.write_text(text, encoding="utf-8")
    message = refusal(lambda: read_log(path))
    assert rule in message and case in message


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    assert "does not exist" in refusal(lambda: read_log(tmp_path / "none.csv"))
    assert "is a directory" in refusal(lambda: read_log(tmp_path))
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR")
    assert "binary" in refusal(lambda: read_log(tmp_path / "picture.csv"))


def test_a_missing_column_names_those_that_are_there() -> None:
    message = refusal(lambda: build_log(table().drop(columns="northing_m"), "run"))
    assert message == (
        "run has no column northing_m (it has: time_s, easting_m, heading_deg, speed_mps, steering_deg); no name looks "
        "like northing_m: say which it is with mapping northing_m=NAME, or log it."
    )


# --- gating ------------------------------------------------------------------------------------------------------


def spoiled(column: str, row: int, value: float) -> pd.DataFrame:
    frame = table()
    for name in ("shuttle", "implement", "roll_deg", "speed_command_mps"):
        frame[name] = {"shuttle": 1.0, "implement": 1.0, "roll_deg": 2.0, "speed_command_mps": 1.5}[name]
    frame.loc[row, column] = value
    return frame


@pytest.mark.parametrize(
    ("column", "value", "rule"),
    [
        ("time_s", np.nan, "time missing or not a number"),
        ("time_s", 0.0, "time not increasing"),
        ("time_s", 1e9, "time not increasing"),
        ("easting_m", np.nan, "position missing or not a number"),
        ("northing_m", 1e9, "position jumps faster than 20 m/s"),
        ("easting_m", -1e9, "position jumps faster than 20 m/s"),
        ("easting_m", 520.0, "position jumps faster than 20 m/s"),
        ("heading_deg", np.inf, "heading_deg missing or not a number"),
        ("speed_mps", -0.5, "speed_mps below 0 (the direction belongs in shuttle)"),
        ("speed_mps", 1e9, "speed_mps above 20 m/s"),
        ("speed_command_mps", 60.0, "speed_command_mps above 20 m/s"),
        ("steering_deg", 130.0, "steering_deg beyond 90 deg"),
        ("steering_deg", np.nan, "steering_deg missing or not a number"),
        ("shuttle", 2.0, "shuttle not -1, 0 or 1"),
        ("shuttle", np.nan, "shuttle not -1, 0 or 1"),
        ("shuttle", 0.0, "shuttle in neutral"),
        ("implement", 0.5, "implement neither 0 nor 1"),
    ],
)
@pytest.mark.parametrize("row", [0, 57])
def test_one_bad_cell_gates_its_row_with_rule_and_line(column: str, value: float, rule: str, row: int) -> None:
    if row == 0 and value == 0.0 and column == "time_s":
        value = 200.0
    log = build_log(spoiled(column, row, value), "run")
    assert log.gated == (GatedRows(rule, 1, row + 2),)
    assert not log.used[row] and log.rows_used == 199
    for name in COLUMNS:
        values = getattr(log, name)
        assert values is None or np.isfinite(values[log.used]).all()


@given(st.sets(st.integers(0, 199), min_size=1, max_size=40), st.sampled_from(["northing_m", "heading_deg", "time_s"]))
@settings(max_examples=count_examples(40))
def test_every_row_is_used_or_counted_once(rows: set[int], column: str) -> None:
    frame = table()
    frame.loc[sorted(rows), column] = np.nan
    log = build_log(frame, "run")
    assert sum(one.rows for one in log.gated) == log.rows_gated == len(rows)
    assert log.gated[0].first_line == min(rows) + 2
    assert set(np.flatnonzero(~log.used)) == rows
    assert ((log.segment >= 0) == log.used).all()


def test_a_gap_makes_a_new_segment_and_no_rows() -> None:
    frame = table()
    keep = np.ones(200, dtype=bool)
    keep[50:55] = False  # five missing rows: a gap of six steps
    keep[100:104] = False  # four missing rows: a gap of five steps
    log = build_log(frame[keep].reset_index(drop=True), "run")
    assert log.segment_count == 2 and log.rows_gated == 0 and len(log.used) == 191
    assert log.segment[49] == 0 and log.segment[50] == 1 and log.segment[-1] == 1


def test_gated_rows_open_a_gap_as_missing_ones_do() -> None:
    frame = table()
    frame.loc[50:59, "easting_m"] = np.nan
    assert build_log(frame, "run").segment_count == 2


@given(st.lists(st.integers(0, 12), min_size=1, max_size=40))
def test_longest_increase_is_increasing_and_longest(values: list[int]) -> None:
    kept = np.array(values, dtype=float)[~find_decreasing_entries(np.array(values, dtype=float))]
    assert (np.diff(kept) > 0).all()
    best = [1] * len(values)
    for last, value in enumerate(values):
        best[last] = max([1, *(best[row] + 1 for row in range(last) if values[row] < value)])
    assert len(kept) == max(best)


def test_jumps_keep_the_longest_chain() -> None:
    time = np.arange(30) * 0.1
    east = np.where(np.arange(30) < 12, 1e6, 0.0) + time
    bad = find_jumps(time, east, np.zeros(30))
    assert bad[:12].all() and not bad[12:].any()
    lots = np.random.default_rng(3).uniform(-1e6, 1e6, 30)
    lots[::2] = time[::2]
    assert np.array_equal(find_jumps(time, lots, np.zeros(30)), np.arange(30) % 2 == 1)


def test_segments_follow_the_median_step() -> None:
    time = np.array([0.0, 1.0, 2.0, 7.0, 8.0, 14.0, 15.0])
    used = np.array([True, True, True, True, True, True, False])
    assert number_segments(time, used).tolist() == [0, 0, 0, 0, 0, 1, -1]


def test_a_clean_table_keeps_every_row() -> None:
    columns = {name: table()[name].to_numpy() for name in table()}
    used, gated = gate_rows(columns)
    assert used.all() and gated == []


# --- conventions -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BENT)
@pytest.mark.parametrize("fix", SPOIL)
def test_a_wrong_convention_is_named_and_its_fix_mends_it(fix: LogConvention, name: str) -> None:
    spoiled_frame = SPOIL[fix](runs()[name])
    message = refusal(lambda: build_log(spoiled_frame, name))
    assert f"give fixes {fix} to convert" in message and message.count("give fixes") == 1
    plain, mended = build_log(runs()[name], name), build_log(spoiled_frame, name, [fix])
    for column in ("time_s", "speed_mps", "steering_deg", "steering_command_deg"):
        assert np.allclose(getattr(mended, column), getattr(plain, column), atol=1e-9), column
    for column in ("easting_m", "northing_m"):
        one, two = getattr(mended, column), getattr(plain, column)
        assert np.allclose(one - one[0], two - two[0], atol=2e-3), column
    assert np.allclose(np.cos(np.radians(mended.heading_deg - plain.heading_deg)), 1.0, atol=1e-9)


@pytest.mark.parametrize("name", [*sorted(set(BENT))[:1], *seldom(*sorted(set(BENT))[1:])])
@pytest.mark.parametrize(
    "drop", [("steering_deg",), ("speed_mps",), ("speed_mps", "speed_command_mps"), ("heading_deg",)]
)
def test_fewer_columns_are_enough(name: str, drop: tuple[str, ...]) -> None:
    # What is found instead of the spoiling when these columns do not tell.
    found_instead = {
        "heading_deg": {LogConvention.EAST_NORTH_SWAPPED: LogConvention.STEERING_LEFT},
        "speed_mps": {fix: found for both, measured, command in SPEED_UNITS
                      for fix, found in ((command, both), (measured, None))},
    }  # fmt: skip
    for fix, spoil in SPOIL.items():
        frame = spoil(runs()[name]).drop(columns=list(drop))
        expected = found_instead.get(drop[0], {}).get(fix, fix)
        if ("heading_deg" in drop and fix.startswith("heading")) or (len(drop) == 2 and fix.startswith("speed")):
            expected = None
        if len(drop) == 2 and fix is LogConvention.POSITION_FEET:
            expected = None  # nothing says how far it was driven
        assert [one.fix for one in find_convention_errors(build_log(frame, name, check=False))] == [expected] * (
            expected is not None
        ), fix


def test_headings_are_judged_on_straight_runs_too() -> None:
    for name in ("straight_090", "straight_270", "implement_straight"):
        for fix in (LogConvention.HEADING_CCW_EAST, LogConvention.HEADING_CCW_NORTH):
            frame = SPOIL[fix](runs()[name])
            same = (
                name == "implement_straight" and fix is LogConvention.HEADING_CCW_NORTH
            )  # driven due north: the same angle
            assert [one.fix for one in find_convention_errors(build_log(frame, name, check=False))] == (
                [] if same else [fix]
            )


def test_several_wrong_conventions_are_all_named() -> None:
    frame = runs()["figure_eight"]
    wrong = (
        LogConvention.SPEED_KMH,
        LogConvention.HEADING_RADIANS,
        LogConvention.HEADING_CCW_NORTH,
        LogConvention.STEERING_RADIANS,
        LogConvention.STEERING_LEFT,
    )
    for fix in reversed(wrong):
        frame = SPOIL[fix](frame)
    message = refusal(lambda: build_log(frame, "run"))
    assert all(f"fixes {fix}" in message for fix in wrong)
    mended = build_log(frame, "run", [str(fix) for fix in wrong])
    assert np.allclose(mended.steering_deg, runs()["figure_eight"].steering_deg)


def test_a_fix_that_is_not_needed_is_refused() -> None:
    for fix in (LogConvention.STEERING_LEFT, LogConvention.HEADING_CCW_NORTH):
        message = refusal(lambda fix=fix: build_log(runs()["figure_eight"], "run", [fix]))
        assert f"after the fix {fix}" in message and "remove that fix" in message
    assert "the fixes are: time-ms" in refusal(lambda: build_log(table(), "run", ["steering"]))
    assert "not a longitude and latitude" in refusal(
        lambda: build_log(table(), "run", [LogConvention.POSITION_DEGREES])
    )


def test_columns_that_contradict_each_other_are_refused() -> None:
    frame = runs()["steps"]
    turned = frame.assign(steering_deg=-frame.steering_deg)
    assert "opposite signs" in refusal(lambda: build_log(turned, "run"))
    mixed = frame.assign(steering_command_deg=np.radians(frame.steering_command_deg))
    assert "one is in radians" in refusal(lambda: build_log(mixed, "run"))


def test_logs_in_degrees_share_one_origin(tmp_path: Path) -> None:
    frame = runs()["steps"]
    first = to_degrees(frame)
    saved(first, tmp_path / "a.csv")
    saved(first.assign(easting_m=first.easting_m + 0.001), tmp_path / "b.csv")
    one, two = read_logs(str(tmp_path / "*.csv"), ["position-degrees"])
    # A thousandth of a degree of longitude at 43.07 degrees north, by the series of the WGS 84 parallel.
    latitude = np.radians(HOME[1])
    metres = (111412.84 * np.cos(latitude) - 93.5 * np.cos(3 * latitude) + 0.118 * np.cos(5 * latitude)) / 1000.0
    assert np.allclose(two.easting_m - one.easting_m, metres, rtol=1e-4)
    assert np.allclose(two.northing_m, one.northing_m, atol=1e-9)
    assert one.easting_m[0] == 0.0 and one.northing_m[0] == 0.0


@pytest.mark.parametrize("fix", [fix for fix in SPOIL if fix is not LogConvention.POSITION_DEGREES])
def test_fixes_undo_the_spoiling_exactly(fix: LogConvention) -> None:
    frame = runs()["steps"]
    wrong = {str(name): values.to_numpy(dtype=float) for name, values in SPOIL[fix](frame).items()}
    mended = convert_columns(wrong, frozenset([fix]))
    for name in frame:
        assert np.allclose(mended[name], frame[name], atol=1e-9), name


def clean(log: Log) -> None:
    assert log.gated == () and log.ignored_columns == ()
    assert find_convention_errors(log, 2.4) == find_convention_errors(log) == []


@pytest.mark.parametrize(("name", "first"), CASES)
def test_no_effect_looks_like_a_wrong_convention(name: str, first: int) -> None:
    """Every third run of the programme; up to two more effects, rate, origin, slope, gaps and mirror are drawn."""
    seed = draw_seed()
    rng = np.random.default_rng([seed, *name.encode()])
    conditions = {
        "rate_hz": float(rng.choice([4.0, 5.0, 10.0, 20.0])),
        "origin": tuple(rng.uniform(-1e6, 1e6, 2)) if rng.random() < 0.5 else (0.0, 0.0),
        "mirrored": bool(rng.random() < 0.5),
        "uneven": float(rng.uniform(0.0, 0.8)),
        "gaps": int(rng.integers(0, 3)),
        "terrain": (0.1, float(rng.uniform(0, 360))) if rng.random() < 0.5 else None,
        "drop": DROPPED[rng.integers(len(DROPPED))],
    }
    names = {name, *rng.choice(sorted(KNOWN), rng.integers(3), replace=False).tolist()}
    effects = {one: KNOWN[one] for one in sorted(names & set(KNOWN))} if name in KNOWN else {}
    print(conditions, list(effects))
    drives = [*default_programme(), reversing()]
    for frame in make_logs(effects, seed, drives[first::3], **conditions):
        log = build_log(frame, frame.attrs["name"], check=frame.attrs["name"] != "reversing")
        if frame.attrs["name"] == "reversing":
            assert [one.rule for one in log.gated] == ["shuttle in neutral"] and find_convention_errors(log) == []
        else:
            clean(log)


@pytest.mark.slow
def test_half_an_hour_is_read_quickly(tmp_path: Path) -> None:
    frame = pd.concat([runs()["steps"]] * 55, ignore_index=True)
    frame["time_s"] = np.arange(len(frame)) * 0.05
    frame["easting_m"] = np.arange(len(frame)) * 0.07
    frame["northing_m"] = 0.0
    frame["heading_deg"] = 90.0
    path = saved(frame, tmp_path / "long.csv")
    start = time.process_time()
    log = build_log(read_log_table(path), "long", check=False)
    find_convention_errors(log)
    assert log.rows_used > 30000 and time.process_time() - start < 3.0


def test_a_jump_back_in_time_is_told_by_its_line_and_a_lost_half_by_its_run() -> None:
    """The first half goes; its first line is that of the header."""
    time = 0.1 * np.arange(100.0)
    time[40:] -= 604800.0
    still = np.zeros(100)
    _, gated = gate_rows({"time_s": time, "easting_m": 0.1 * np.arange(100.0), "northing_m": still})
    assert [(one.rows, one.first_line) for one in gated] == [(40, 42)]
    jumped = build_log(
        circle(0.03, 20.0).assign(time_s=lambda one: one.time_s - 604800.0 * (one.time_s > 8.0)), "jumped"
    )
    counts = count_rows_left_out([build_log(circle(0.03, 20.0), "whole"), jumped], jumped.rows_used + 200)
    assert counts == {"time not increasing, in jumped 40 % of all rows": 81}


def test_commands_hold_until_the_next_message() -> None:
    """Messages at 5 Hz in rows at 10 Hz: the cells between are what was commanded last; a longer gap stays open."""
    frame = runs()["speed_steps"]
    sparse = frame.copy()
    sparse.loc[sparse.index % 2 == 1, ["speed_command_mps", "steering_command_deg"]] = np.nan
    log = build_log(sparse, "sparse", check=False)
    for name in ("speed_command_mps", "steering_command_deg"):
        expected = np.repeat(frame[name].to_numpy(float)[::2], 2)[: len(frame)]
        assert getattr(log, name) == pytest.approx(expected), name
    paused = frame.copy()
    paused.loc[100:109, "speed_command_mps"] = np.nan
    log = build_log(paused, "paused", check=False)
    assert log.speed_command_mps is not None and log.rows_used == len(frame) - 10
