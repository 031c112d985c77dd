"""The order of tracks for one tractor: cells, patterns, corners, and what a good order is estimated to take."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fields import Swath
from strategies.program.field_job import FieldJob, SwathPass
from strategies.sequencing.swath_order import (
    build_skip_pattern,
    estimate_layout_s,
    group_same_bearing_cells,
    list_jumps,
    order_swaths,
)
from strategies.sequencing.turn_table import TurnTable
from tests.examples import count_examples

QUICK = settings(max_examples=count_examples(40))
WHOLE = [(0.0, 100.0)]
SPLIT = [(0.0, 40.0), (60.0, 100.0)]
AROUND_HOLE = [WHOLE] * 3 + [SPLIT] * 4 + [WHOLE] * 3
CORNERS = [(last, path) for last in (False, True) for path in (1, -1)]


@st.composite
def spans(draw: Any) -> list[list[tuple[float, float]]]:
    """Up to 16 lines of one to three pieces each, cut by holes that come and go."""
    lines = []
    for _ in range(draw(st.integers(1, 16))):
        cuts = sorted(draw(st.lists(st.integers(0, 30), min_size=2, max_size=6, unique=True)))
        cuts = cuts[: len(cuts) // 2 * 2]
        lines.append([(10.0 * a, 10.0 * b - 2.0) for a, b in zip(cuts[::2], cuts[1::2], strict=True)])
    return lines


def keys(swaths: list[Swath]) -> list[tuple[int, int]]:
    return [(swath.line, swath.piece) for swath in swaths]


def taken(order: list[SwathPass]) -> list[tuple[int, int]]:
    return [(this.swath.line, this.swath.piece) for this in order]


class TestCells:
    def test_a_hole_makes_four_cells(self, jobs: Any) -> None:
        cells = group_same_bearing_cells(list(jobs.drawn(AROUND_HOLE).layout.swaths), 0.0)
        assert sorted(keys(cell) for cell in cells) == sorted(
            [
                [(0, 0), (1, 0), (2, 0)],
                [(3, 0), (4, 0), (5, 0), (6, 0)],
                [(3, 1), (4, 1), (5, 1), (6, 1)],
                [(7, 0), (8, 0), (9, 0)],
            ]
        )

    def test_lines_without_interruption_are_one_cell(self, jobs: Any) -> None:
        assert len(group_same_bearing_cells(list(jobs.drawn([WHOLE] * 12).layout.swaths), 0.0)) == 1

    def test_a_hole_laid_in_a_real_field_is_worked_around(self, jobs: Any) -> None:
        from shapely import box

        job = jobs.rectangle(20, 100.0, hole=box(24, 50, 36, 65))
        cells = group_same_bearing_cells(list(job.layout.swaths), job.layout.bearing_rad)
        split = sum(swath.piece for swath in job.layout.swaths)
        assert split > 0
        sizes = sorted(len(cell) for cell in cells)
        assert len(cells) == 4 and sizes.count(split) >= 2 and sum(sizes) == len(job.layout.swaths)

    @QUICK
    @given(spans=spans(), bearing=st.floats(-1.5, 1.5))
    def test_cells_share_out_all_tracks_and_climb(self, jobs: Any, spans: Any, bearing: float) -> None:
        swaths = list(jobs.drawn(spans, bearing_rad=bearing).layout.swaths)
        cells = group_same_bearing_cells(swaths, bearing)
        assert sorted(keys([swath for cell in cells for swath in cell])) == sorted(keys(swaths))
        for cell in cells:
            assert all(b.line == a.line + 1 for a, b in pairwise(cell))

    @QUICK
    @given(spans=spans(), bearing=st.floats(-1.5, 1.5))
    def test_neighbours_in_a_cell_lie_side_by_side(self, jobs: Any, spans: Any, bearing: float) -> None:
        for cell in group_same_bearing_cells(list(jobs.drawn(spans, bearing_rad=bearing).layout.swaths), bearing):
            for a, b in pairwise(cell):
                (a0, a1), (b0, b1) = spans[a.line][a.piece], spans[b.line][b.piece]
                assert max(a0, b0) < min(a1, b1)


class TestSkipPattern:
    @QUICK
    @given(st.integers(1, 200), st.integers(1, 12))
    def test_every_index_once(self, count: int, jump: int) -> None:
        assert sorted(build_skip_pattern(count, jump)) == list(range(count))

    @QUICK
    @given(st.integers(1, 8), st.integers(2, 9))
    def test_whole_blocks_jump_as_said(self, blocks: int, jump: int) -> None:
        order = build_skip_pattern(blocks * 2 * jump, jump)
        for block in range(blocks):
            steps = [b - a for a, b in pairwise(order[block * 2 * jump : (block + 1) * 2 * jump])]
            assert steps == [jump, -(jump - 1)] * (jump - 1) + [jump]

    def test_by_hand(self) -> None:
        assert build_skip_pattern(6, 3) == [0, 3, 1, 4, 2, 5]
        assert build_skip_pattern(9, 3) == [0, 3, 1, 4, 2, 5, 6, 8, 7]
        assert build_skip_pattern(1, 4) == [0]

    def test_jumps_leave_room_for_a_u_turn(self, jobs: Any) -> None:
        assert list_jumps(jobs.drawn([WHOLE], radius_m=4.3)) == [1, 3, 4]  # 2 x 4.3 m over lines 3 m apart
        assert list_jumps(jobs.drawn([WHOLE], radius_m=1.4)) == [1]


class TestOrder:
    @QUICK
    @given(spans=spans(), jump=st.integers(1, 5), corner=st.sampled_from(CORNERS))
    def test_every_track_exactly_once(self, jobs: Any, spans: Any, jump: int, corner: tuple[bool, int]) -> None:
        job = jobs.drawn(spans)
        order = order_swaths(list(job.layout.swaths), job, jump, corner)
        assert sorted(taken(order)) == sorted(keys(list(job.layout.swaths)))
        assert {this.direction for this in order} <= {1, -1}

    @pytest.mark.parametrize("corner", CORNERS)
    @pytest.mark.parametrize("jump", [1, 3, 4])
    def test_begins_in_the_corner_asked_for_and_alternates(self, jobs: Any, jump: int, corner: Any) -> None:
        job = jobs.drawn([WHOLE] * 14)
        order = order_swaths(list(job.layout.swaths), job, jump, corner)
        assert order[0] == SwathPass(job.layout.swaths[-1 if corner[0] else 0], corner[1])
        assert all(a.direction == -b.direction for a, b in pairwise(order))

    def test_one_after_another_is_in_line_order(self, jobs: Any) -> None:
        job = jobs.drawn([WHOLE] * 7)
        order = order_swaths(list(job.layout.swaths), job, 1, (True, 1))
        assert [line for line, _ in taken(order)] == [6, 5, 4, 3, 2, 1, 0]

    def test_a_cell_is_finished_before_the_next_is_begun(self, jobs: Any) -> None:
        job = jobs.drawn(AROUND_HOLE)
        order = order_swaths(list(job.layout.swaths), job, 1, (False, 1))
        cell = {
            key: number
            for number, c in enumerate(group_same_bearing_cells(list(job.layout.swaths), 0.0))
            for key in keys(c)
        }
        visits = [cell[key] for key in taken(order)]
        assert sum(a != b for a, b in pairwise(visits)) == 3

    def test_begins_on_the_outermost_line_where_a_notch_makes_a_late_cell(self, jobs: Any) -> None:
        job = jobs.drawn([[(0.0, 40.0)]] * 5 + [SPLIT] * 2 + [[(0.0, 40.0)]] * 3)
        swaths = list(job.layout.swaths)
        assert order_swaths(swaths, job, 1, (True, 1))[0].swath.line == 9
        assert order_swaths(swaths, job, 1, (False, 1))[0].swath.line == 0


class TestEstimate:
    def test_no_pattern_from_any_corner_is_estimated_quicker(self, jobs: Any) -> None:
        job: FieldJob = jobs.rectangle(14, 60.0)
        swaths, table = list(job.layout.swaths), TurnTable(job, list(job.layout.swaths), 4)
        place = {swath: index for index, swath in enumerate(swaths)}

        def sum_s(order: list[SwathPass]) -> float:
            passes = [2 * place[one.swath] + (one.direction < 0) for one in order]
            return sum(swath.length_m for swath in swaths) / 1.5 + sum(table.seconds[p, q] for p, q in pairwise(passes))

        others = [order_swaths(swaths, job, jump, corner) for jump in (1, 2, 3, 4) for corner in CORNERS]
        assert estimate_layout_s(job, 4) <= min(map(sum_s, others)) + 1e-6

    def test_three_tracks_by_hand(self, jobs: Any) -> None:
        # 300 m at 1.5 m/s; turns over one line of 30 s and over two of 26 s; each ends 2.3 m farther on.
        job = jobs.drawn([WHOLE] * 3)
        assert estimate_layout_s(job, 0) == pytest.approx(300 / 1.5 + 30.0 + 26.0 + 2 * jobs.tool_m / 1.5, abs=2e-3)

    def test_an_entrance_adds_the_drive_in_and_out(self, jobs: Any) -> None:
        job: FieldJob = jobs.rectangle(10, 80.0)
        inside = estimate_layout_s(job, 4)
        for x, y in ((0, 0), (30, 0), (0, 98), (30, 98)):
            assert inside < estimate_layout_s(jobs.rectangle(10, 80.0, entrance=(x, y)), 4) < inside + 60.0
