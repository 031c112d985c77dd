"""Which runs of a diagnosis are held out, as a user names them."""

from dataclasses import replace

import numpy as np
import pytest

from planner.pipeline.diagnosis import HeldOut, split_held_out_runs
from tests.identification.log_tables import refusal, table
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log

ONE = build_log(table(), "one")
LOGS = [replace(ONE, name=f"day{number}-north") for number in range(1, 9)]


def held_out(asked: HeldOut, logs: list[Log] = LOGS) -> list[int]:
    """Numbers of the runs held out; the others are all used, in their order."""
    used, unseen, words = split_held_out_runs(logs, asked)
    names = [log.name for log in logs]
    chosen = [names.index(log.name) for log in unseen]
    assert [log.name for log in used] == [name for k, name in enumerate(names) if k not in chosen]
    assert all(names[number] in words for number in chosen)
    return chosen


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ("day3-north", [2]), ("runs/day3-north.csv", [2]), ("day[12]*", [0, 1]), ("#8", [7]),
        ("day8-north, #1", [0, 7]), (["day2-north", "day2*"], [1]), ("auto", [2, 6]), (2, [2, 6]),
        ("3", [1, 4, 6]), (1, [4]),
    ],
)  # fmt: skip
def test_runs_are_those_that_were_asked_for(asked: HeldOut, expected: list[int]) -> None:
    assert held_out(asked) == expected


@pytest.mark.parametrize("count", range(1, 8))
def test_runs_are_chosen_evenly(count: int) -> None:
    chosen = held_out(count)
    assert len(set(chosen)) == count
    gaps = np.diff([chosen[-1] - len(LOGS), *chosen])
    assert gaps.max() - gaps.min() <= 1


def test_a_run_of_a_number_comes_before_that_many_runs() -> None:
    logs = [replace(ONE, name=name) for name in ("1", "2", "3", "auto")]
    assert held_out("2", logs) == [1] and held_out("auto", logs) == [3]


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("day9", "none of the runs"), ("#9", "none of the runs"), ("*", "8 of 8 runs"), (8, "8 of 8 runs"),
        (99, "leave no run"), (0, "0 runs held out"), ("", "No run is held out"), ([], "No run is held out"),
    ],
)  # fmt: skip
def test_what_cannot_be_held_out_is_refused(asked: HeldOut, said: str) -> None:
    assert said in refusal(lambda: split_held_out_runs(LOGS, asked))


def test_a_single_run_is_cut_in_time() -> None:
    log = build_log(table(rows=2400), "long")
    (used,), (unseen,), words = split_held_out_runs([log], "auto")
    assert used.time_s[-1] < unseen.time_s[0] and len(used.time_s) + len(unseen.time_s) == 2400
    assert np.ptp(unseen.time_s) == pytest.approx(0.25 * np.ptp(log.time_s), abs=0.1)
    assert unseen.segment[0] == 0 and unseen.segment_count == 1 and "the last 30 s of long" in words
    assert "log a second run" in refusal(lambda: split_held_out_runs([ONE], "auto"))
    assert "1 of 1 run" in refusal(lambda: split_held_out_runs([log], 1))


def test_segments_of_a_part_are_numbered_from_0() -> None:
    frame = table(rows=4000)
    log = build_log(
        frame[(frame.index < 1000) | ((frame.index > 1400) & (frame.index < 3500)) | (frame.index > 3700)], "r"
    )
    (unseen,) = split_held_out_runs([log], "auto")[1]
    assert log.segment_count == 3 and sorted(set(unseen.segment)) == list(range(unseen.segment_count))
