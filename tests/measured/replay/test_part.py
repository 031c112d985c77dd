"""Parts of long courses: circles and lines of hours, counted by hand."""

import numpy as np
import pandas as pd
import pytest

from tests.measured.drawn import SPEED_MPS, circle, course, joined, log
from vehicle.measured.replay.course import make_course
from vehicle.measured.replay.part import PIECE_S, balanced_part, cut


def weaving(seconds: float, rate_hz: float = 2.0) -> pd.DataFrame:
    """Straight driving with a circle to the right in every tenth minute, in which the implement works."""
    laps = [
        circle(0.1 if minute % 10 == 9 else 0.0, seconds=60.0, rate_hz=rate_hz).assign(implement=int(minute % 10 == 9))
        for minute in range(round(seconds / 60.0))
    ]
    return joined(*laps)


def test_a_course_that_is_short_enough_is_its_own_part() -> None:
    whole = course(circle(0.0, seconds=300.0), circle(0.1, seconds=300.0))
    part = balanced_part(whole, 600.0)
    assert part.course is whole and part.runs == (0, 1)


def test_pieces_are_cut_at_whole_pairs_of_windows_and_lose_nothing() -> None:
    (one,) = course(circle(0.05, seconds=500.0)).stretches
    pieces = list(cut(one))
    assert [piece.start_s for piece in pieces] == [0.0, PIECE_S, 2 * PIECE_S, 3 * PIECE_S], "the last takes the rest"
    for name in ("east", "north", "heading", "speed", "wheel", "working"):
        assert np.concatenate([getattr(piece, name) for piece in pieces]) == pytest.approx(getattr(one, name))
    assert all(piece.time[0] == 0.0 for piece in pieces)
    first = round(60.0 * PIECE_S)
    for name, grid in pieces[1].grids.items():
        assert grid == pytest.approx(one.grids[name][first : first + len(grid)]), name
    (short,) = course(circle(0.05, seconds=200.0)).stretches
    assert list(cut(short)) == [short]


def test_the_slope_under_a_piece_is_that_under_its_rows() -> None:
    frame = circle(0.0, seconds=300.0)
    (one,) = make_course([log(frame)]).stretches
    one.grids["across"] = 0.1 * np.sin(np.arange(len(one.grids["speed"])) / 600.0)
    first = round(60.0 * PIECE_S)
    piece = list(cut(one))[1]
    slope = one.grids["across"][first : first + len(piece.grids["across"])]
    assert piece.grids["across"] == pytest.approx(slope, abs=1e-4)


def test_a_part_has_all_times_and_what_is_rare() -> None:
    whole = course(weaving(6000.0))
    part = balanced_part(whole, 1500.0)
    assert 1500.0 <= part.course.seconds < 1500.0 + 2.0 * PIECE_S
    starts = np.array([one.start_s for one in part.course.stretches])
    assert (np.diff(starts) > 0.0).all() and len(np.unique(starts // 600.0)) == 10, "every tenth of the time"
    working = sum(float(one.working.sum()) for one in part.course.stretches) / part.course.rows
    assert 0.05 < working < 0.25, "a tenth of the driving"
    turned = [float(np.ptp(one.heading)) for one in part.course.stretches]
    assert max(turned) > 0.9 * 60.0 * 0.1 * SPEED_MPS
    assert (part.course.origin, part.course.rows_read) == (whole.origin, whole.rows_read)


def test_every_run_has_a_piece_while_there_is_room_and_runs_are_counted_anew() -> None:
    whole = course(*[circle(0.0 if run % 4 else 0.1, seconds=400.0, rate_hz=2.0) for run in range(8)])
    part = balanced_part(whole, 1000.0)
    assert part.runs == tuple(range(8)) and {one.run for one in part.course.stretches} == set(range(8))
    few = balanced_part(whole, 300.0)
    assert len(few.runs) == 3 and [one.run for one in few.course.stretches] == [0, 1, 2]
    assert few.course.names == tuple(whole.names[run] for run in few.runs)
    bent = [float(np.ptp(one.heading)) > 1.0 for one in few.course.stretches]
    assert any(bent) and not all(bent)


def test_the_same_logs_give_the_same_part() -> None:
    frame = weaving(3000.0)
    parts = [balanced_part(course(frame), 900.0).course.stretches for _ in range(2)]
    assert [one.start_s for one in parts[0]] == [one.start_s for one in parts[1]]
