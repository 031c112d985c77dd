"""Parts of long courses: circles and lines of hours, counted by hand."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.analytic_drives import SPEED_MPS, circle, course, joined, log
from vehicle.identification.replay.data_subset import SUBSET_PIECE_S, cut_segment, select_balanced_subset
from vehicle.identification.replay.drive_segments import build_dataset


def weaving(seconds: float, rate_hz: float = 2.0) -> pd.DataFrame:
    """Straight driving with a circle to the right in every tenth minute, in which the implement works."""
    laps = [
        circle(0.1 if minute % 10 == 9 else 0.0, seconds=60.0, rate_hz=rate_hz).assign(implement=int(minute % 10 == 9))
        for minute in range(round(seconds / 60.0))
    ]
    return joined(*laps)


def test_a_course_that_is_short_enough_is_its_own_part() -> None:
    whole = course(circle(0.0, seconds=300.0), circle(0.1, seconds=300.0))
    part = select_balanced_subset(whole, 600.0)
    assert part.dataset is whole and part.runs == (0, 1)


def test_pieces_are_cut_at_whole_pairs_of_windows_and_lose_nothing() -> None:
    (one,) = course(circle(0.05, seconds=500.0)).segments
    pieces = list(cut_segment(one))
    assert [piece.start_s for piece in pieces] == [0.0, SUBSET_PIECE_S, 2 * SUBSET_PIECE_S, 3 * SUBSET_PIECE_S], (
        "the last takes the rest"
    )
    for name in ("east", "north", "heading", "speed", "wheel", "working"):
        assert np.concatenate([getattr(piece, name) for piece in pieces]) == pytest.approx(getattr(one, name))
    assert all(piece.time[0] == 0.0 for piece in pieces)
    first = round(60.0 * SUBSET_PIECE_S)
    for name, grid in pieces[1].grids.items():
        assert grid == pytest.approx(one.grids[name][first : first + len(grid)]), name
    (short,) = course(circle(0.05, seconds=200.0)).segments
    assert list(cut_segment(short)) == [short]


def test_the_slope_under_a_piece_is_that_under_its_rows() -> None:
    frame = circle(0.0, seconds=300.0)
    (one,) = build_dataset([log(frame)]).segments
    one.grids["across"] = 0.1 * np.sin(np.arange(len(one.grids["speed"])) / 600.0)
    first = round(60.0 * SUBSET_PIECE_S)
    piece = list(cut_segment(one))[1]
    slope = one.grids["across"][first : first + len(piece.grids["across"])]
    assert piece.grids["across"] == pytest.approx(slope, abs=1e-4)


def test_a_part_has_all_times_and_what_is_rare() -> None:
    whole = course(weaving(6000.0))
    part = select_balanced_subset(whole, 1500.0)
    assert 1500.0 <= part.dataset.seconds < 1500.0 + 2.0 * SUBSET_PIECE_S
    starts = np.array([one.start_s for one in part.dataset.segments])
    assert (np.diff(starts) > 0.0).all() and len(np.unique(starts // 600.0)) == 10, "every tenth of the time"
    working = sum(float(one.working.sum()) for one in part.dataset.segments) / part.dataset.rows
    assert 0.05 < working < 0.25, "a tenth of the driving"
    turned = [float(np.ptp(one.heading)) for one in part.dataset.segments]
    assert max(turned) > 0.9 * 60.0 * 0.1 * SPEED_MPS
    assert (part.dataset.origin, part.dataset.rows_read) == (whole.origin, whole.rows_read)


def test_every_run_has_a_piece_while_there_is_room_and_runs_are_counted_anew() -> None:
    whole = course(*[circle(0.0 if run % 4 else 0.1, seconds=400.0, rate_hz=2.0) for run in range(8)])
    part = select_balanced_subset(whole, 1000.0)
    assert part.runs == tuple(range(8)) and {one.run for one in part.dataset.segments} == set(range(8))
    few = select_balanced_subset(whole, 300.0)
    assert len(few.runs) == 3 and [one.run for one in few.dataset.segments] == [0, 1, 2]
    assert few.dataset.names == tuple(whole.names[run] for run in few.runs)
    bent = [float(np.ptp(one.heading)) > 1.0 for one in few.dataset.segments]
    assert any(bent) and not all(bent)


def test_the_same_logs_give_the_same_part() -> None:
    frame = weaving(3000.0)
    parts = [select_balanced_subset(course(frame), 900.0).dataset.segments for _ in range(2)]
    assert [one.start_s for one in parts[0]] == [one.start_s for one in parts[1]]
