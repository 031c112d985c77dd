"""What is said about columns and rows that were not used."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import count_examples
from tests.identification.log_tables import refusal, saved, table
from vehicle.identification.logs.reader import build_log, count_rows_left_out, find_log_files, list_remarks, read_logs
from vehicle.identification.replay.drive_segments import build_dataset


def said(**columns: object) -> list[str]:
    return list_remarks(build_log(table().assign(**columns), "run"))


def test_a_plain_log_needs_no_remark() -> None:
    assert said() == []


def test_ignored_columns_are_named_with_what_they_may_be() -> None:
    frame = table().drop(columns=["heading_deg", "speed_mps"]).assign(heading=45.0, speed_ms=1.5, Roll=0.0, rpm=1800)
    assert list_remarks(build_log(frame, "run")) == [
        "run: column 'heading' is unknown and was ignored; map it to heading_deg if that is what it holds.",
        "run: column 'speed_ms' is unknown and was ignored; map it to speed_mps if that is what it holds.",
        "run: column 'Roll' is unknown and was ignored; map it to roll_deg if that is what it holds.",
        "run: column 'rpm' is unknown and was ignored.",
    ]
    assert said(heading=1.0) == ["run: column 'heading' is unknown and was ignored."]  # heading_deg is there


def test_roll_and_pitch_cost_no_row() -> None:
    roll = np.full(200, 2.0)
    roll[[10, 30]] = np.nan, 75.0
    log = build_log(table().assign(roll_deg=roll, pitch_deg=1.0), "run")
    assert log.rows_gated == 0
    (one,) = list_remarks(log)
    assert one.startswith(
        "run: roll_deg is missing or beyond 60 deg in 2 rows (first in line 12); values are interpolated"
    )


def test_rows_left_out_are_told_with_rule_and_line() -> None:
    heading = np.full(200, 45.0)
    heading[[3, 7]] = np.nan
    assert said(heading_deg=heading) == ["run: 2 rows left out: heading_deg missing or not a number (first in line 5)."]


def test_short_segments_are_told_and_reverse_is_used() -> None:
    frame = table(400)
    frame["shuttle"] = np.where(np.arange(400) < 290, 1, -1)
    frame.loc[60:69, "easting_m"] = np.nan
    log = build_log(frame, "run", check=False)
    assert list_remarks(log)[1:] == ["run: 60 rows not used: in segments shorter than 5 s (first in line 2)."]
    short = build_log(table(60), "short")
    assert list_remarks(short) == ["short: 60 rows not used: no segment lasts 5 s (first in line 2)."]


@given(st.sets(st.integers(0, 399), max_size=30), st.sets(st.integers(0, 399), max_size=60))
@settings(max_examples=count_examples(40))
def test_every_row_that_no_replay_sees_is_told_once(missing: set[int], back: set[int]) -> None:
    frame = table(400)
    frame["shuttle"] = [-1 if row in back else 1 for row in range(400)]
    frame.loc[sorted(missing), "northing_m"] = np.nan
    log = build_log(frame, "run", check=False)
    told = sum(int(one.split()[1]) for one in list_remarks(log) if "left out" in one or "not used" in one)
    long = build_log(table(), "long")
    course = build_dataset([log, long])
    assert told == course.rows_read - course.rows
    counts = list(count_rows_left_out([log, long], course.rows).values())
    assert sum(counts) == told and counts == sorted(counts, reverse=True) and 0 not in counts


def test_rows_that_repeat_a_position_are_left_out_for_that_reason() -> None:
    log = replace(build_log(table(400), "run"), fresh=np.arange(400) % 4 == 0)
    course = build_dataset([log])
    assert count_rows_left_out([log], course.rows) == {"positions repeat the row before": 300}


def test_a_file_given_twice_counts_once_and_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = saved(table(), tmp_path / "run.csv")
    (log,) = read_logs(["run.csv", path, "./r*.csv"])
    assert list_remarks(log) == [f"run: the file was given 3 times (also as {path}, run.csv) and counts once."]
    (tmp_path / "link.csv").symlink_to(path)
    assert find_log_files(["link.csv", "run.csv"]) == {Path("link.csv"): ("run.csv",)}


@pytest.mark.parametrize("column", ["heading_deg", "northing_m"])
def test_a_column_that_costs_most_rows_is_refused(column: str) -> None:
    """Rows thinned to one in ten would take the commands between them along."""
    sparse = table()
    sparse.loc[np.arange(200) % 10 > 0, column] = np.nan
    message = refusal(lambda: build_log(sparse, "sparse"))
    assert message.startswith("sparse: 180 of 200 rows are unusable: ") and "(first in line 3)" in message
    assert column.split("_")[0] in message.replace("position", "northing") and "remove it" in message


def test_nothing_long_enough_says_which_file_and_why() -> None:
    frame = table()
    frame.loc[np.arange(200) // 20 % 3 == 1, "heading_deg"] = np.nan
    broken, short = build_log(frame, "broken"), build_log(table(60), "short")
    message = refusal(lambda: build_dataset([broken, short]))
    assert "in broken the longest lasts 2.0 s, 60 of 200 rows are unusable: heading_deg missing" in message
    assert "(first in line 22)" in message and "in short the longest lasts 3.0 s" in message


def test_few_rows_left_out_do_not_end_a_segment_but_a_gear_does() -> None:
    frame = table()
    frame.loc[[60, 61, 120], "heading_deg"] = np.nan
    (one,) = build_dataset([build_log(frame, "run")]).segments
    assert one.rows == 197 and one.time[-1] == pytest.approx(199 / 20.0)
    for gear in (0, -1):
        shifted = frame.assign(shuttle=1)
        shifted.loc[110, "shuttle"] = gear
        (first,) = build_dataset([build_log(shifted, "run", check=False)]).segments
        assert first.rows == 108  # what is left after it is shorter than a segment must be
