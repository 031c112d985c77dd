"""Work lines of a field that is worked in part: which leave, which are cut, and where standing tractors begin."""

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from strategies.lines.done_lines import (
    START_OVERLAP_M,
    begin_where_tractors_stand,
    build_round_corners,
    find_orders,
    leave_done_lines,
    list_places_ahead,
)
from strategies.lines.work_line import WorkLine
from strategies.rules.legs import PATH_STEP_M
from vehicle.missions.plan import SWATH, Leg, LegTask

WIDTH_M, TOOL_M, LENGTH_M = 4.0, 2.0, 100.0


def draw_line(number: int) -> WorkLine:
    """A swath eastwards, whose implement works from x = 0 to 100 m at y = 4 m times its number."""
    y = WIDTH_M * number
    ahead = np.array([[TOOL_M, y], [LENGTH_M + TOOL_M, y]])
    back = np.array([[LENGTH_M - TOOL_M, y], [-TOOL_M, y]])
    return WorkLine(LegTask(SWATH, number), (SWATH, number), (ahead, back), TOOL_M)


def make_site(done: shapely.Geometry | None, lines: int = 3) -> Any:
    whole = shapely.box(0.0, -0.5 * WIDTH_M, LENGTH_M, WIDTH_M * (lines - 0.5))
    left = whole if done is None else shapely.difference(whole, done)
    rules = SimpleNamespace(tool_m=TOOL_M)
    return SimpleNamespace(
        layout=SimpleNamespace(field=SimpleNamespace(done=done)), width_m=WIDTH_M, work_ground=left, rules=rules
    )


def measure_worked_x(line: WorkLine) -> tuple[float, float]:
    west, _, east, _ = line.build_strip(WIDTH_M).bounds
    return west, east


def leave(done: shapely.Geometry, error_m: float = 0.0) -> list[WorkLine]:
    return leave_done_lines(make_site(done), [draw_line(number) for number in range(3)], error_m)


def test_nothing_done_changes_nothing() -> None:
    lines = [draw_line(0)]
    assert leave_done_lines(make_site(None), lines, 0.1) == lines


@pytest.mark.parametrize("error_m", [0.0, 0.3])
def test_a_line_half_done_is_cut_where_it_ends_with_the_overlap_of_a_start(error_m: float) -> None:
    done = shapely.box(0.0, -2.0, 40.0, 2.0)
    cut, *others = leave(done, error_m)
    join_m = START_OVERLAP_M + error_m
    west, east = measure_worked_x(cut)
    assert 40.0 - join_m <= west <= 40.0 - join_m + error_m + PATH_STEP_M and east == LENGTH_M
    back = cut.paths[1]
    assert back[0, 0] == LENGTH_M - TOOL_M and back[-1, 0] == pytest.approx(west - TOOL_M)
    assert cut.both_ways and cut.own_m2 == pytest.approx(60.0 * WIDTH_M)
    assert [measure_worked_x(line) for line in others] == [(0.0, LENGTH_M)] * 2


def test_a_line_that_is_done_leaves_and_its_neighbour_stays() -> None:
    left = leave(shapely.box(-5.0, -2.0, 105.0, 2.0), 0.1)
    assert [line.task.number for line in left] == [1, 2]


def test_what_position_errors_leave_is_no_reason_to_drive_a_line_again() -> None:
    done = shapely.box(-5.0, -2.0, 105.0, 5.8)  # 0.2 m short of the edge of line 1
    assert [line.task.number for line in leave(done, 0.3)] == [2]
    wide = shapely.box(-5.0, -2.0, 105.0, 4.0)  # half of line 1
    assert [line.task.number for line in leave(wide, 0.3)] == [1, 2]


def test_work_in_the_middle_leaves_two_pieces_with_numbers_of_their_own() -> None:
    first, second, *_ = leave(shapely.box(30.0, -2.0, 60.0, 2.0))
    assert [(line.task.number, line.task.piece) for line in (first, second)] == [(0, 0), (0, 1)]
    assert measure_worked_x(first)[1] == pytest.approx(31.0, abs=PATH_STEP_M)
    assert measure_worked_x(second)[0] == pytest.approx(59.0, abs=PATH_STEP_M)


def test_a_rest_has_the_name_of_its_line_where_what_came_before_is_not_gone_back_for() -> None:
    """A metre and a half at the begin of the line is left, and its end."""
    first, *_ = leave(shapely.box(1.5, -2.0, 40.0, 2.0))
    assert (first.task.piece, first.task.is_piece) == (0, False) and measure_worked_x(first)[1] == LENGTH_M


def test_a_gap_that_two_joins_would_close_is_driven_through() -> None:
    first, second, _ = leave(shapely.box(50.0, -2.0, 51.5, 2.0))
    assert measure_worked_x(first) == (0.0, LENGTH_M) and second.task.number == 1


@pytest.mark.parametrize(("left_m", "stays"), [(1.5, False), (2.5, True)])
def test_less_than_half_a_square_of_the_width_is_no_piece_to_go_back_for(left_m: float, stays: bool) -> None:
    left = leave(shapely.box(0.0, -2.0, LENGTH_M - left_m, 2.0))
    assert [line.task.number for line in left] == ([0] if stays else []) + [1, 2]


def bend(radius_m: float, turn: float, implement: bool = True) -> Leg:
    """A bend to the left from the origin, that comes in eastwards."""
    angles = np.linspace(0.0, turn, 30)
    return Leg(radius_m * np.column_stack([np.sin(angles), 1.0 - np.cos(angles)]), 1.0, implement=implement)


def test_a_corner_that_was_worked_round_counts_whole() -> None:
    (corner,) = build_round_corners([bend(6.0, 0.5 * math.pi)], 6.0, WIDTH_M)
    # Two strips of 6 m that meet in the tip (6, 0), and the square of 2 m by 2 m outside of it that they have not.
    assert corner.area == pytest.approx(2 * 6.0 * WIDTH_M, rel=0.05)
    assert corner.bounds == pytest.approx((0.0, -2.0, 8.0, 6.0), abs=0.4)


def test_a_bent_line_a_turn_and_a_straight_line_are_no_corners() -> None:
    legs = [bend(30.0, 0.5 * math.pi), bend(6.0, 0.5 * math.pi, implement=False), bend(6.0, 3.0), bend(6.0, 0.1)]
    assert build_round_corners(legs, 6.0, WIDTH_M) == []


def test_a_tractor_on_its_line_goes_on_from_its_place_and_nobody_else_may() -> None:
    site = make_site(shapely.box(0.0, -2.0, 40.0, 2.0))
    left = leave_done_lines(site, [draw_line(number) for number in range(3)], 0.1)
    lines, (start,) = begin_where_tractors_stand(site, left, [((40.0 + TOOL_M, 0.1, 0.0), False)], 0.1)
    assert start == 0 and len(lines) == 3 and not lines[0].both_ways
    assert lines[0].get_begin(0) == pytest.approx((40.0 + TOOL_M, 0.0, 0.0), abs=1e-6)
    assert lines[0].get_end(0)[0] == LENGTH_M + TOOL_M


def test_a_tractor_beside_lines_drives_from_its_place_onto_the_nearest() -> None:
    """0.7 m beside it: by 0.2 rad it is on its line 3.5 m on. Another, listed before it, is 0.9 m away."""
    site = make_site(shapely.box(0.0, -4.0, 40.0, 2.0))
    near, shift_m = draw_line(0), np.array([0.0, -1.6])
    far = WorkLine(LegTask(SWATH, 9), (SWATH, 9), tuple(path + shift_m for path in near.paths), TOOL_M)
    lines, (start,) = begin_where_tractors_stand(site, [far, near], [((40.0 + TOOL_M, -0.7, 0.0), False)], 45.0)
    assert start == 2 and lines[0] is far
    expected = [[40.0 + TOOL_M, -0.7], [43.5 + TOOL_M, 0.0], [LENGTH_M + TOOL_M, 0.0]]
    assert lines[1].paths[0] == pytest.approx(np.array(expected))


@pytest.mark.parametrize(
    "pose",
    [
        pytest.param((40.0 + TOOL_M, 3.0, 0.0), id="beside"),
        pytest.param((40.0 + TOOL_M, 0.0, 0.5 * math.pi), id="across"),
        pytest.param((40.0 + TOOL_M, 0.0, math.pi), id="facing what is done"),
        pytest.param((70.0, 0.0, 0.0), id="far along"),
    ],
)
def test_a_tractor_elsewhere_begins_at_its_place(pose: tuple[float, float, float]) -> None:
    site = make_site(shapely.box(0.0, -2.0, 40.0, 2.0))
    left = leave_done_lines(site, [draw_line(number) for number in range(3)], 0.1)
    lines, (start,) = begin_where_tractors_stand(site, left, [(pose, False)], 0.1)
    place = lines[start // 2]
    assert place.is_place and lines[:3] == left
    x, y, heading = place.get_end(0)
    assert (x, y) == pytest.approx(pose[:2]) and math.cos(heading - pose[2]) == pytest.approx(1.0)


def test_two_tractors_never_begin_with_the_same_line() -> None:
    site = make_site(shapely.box(0.0, -2.0, 40.0, 2.0))
    left = leave_done_lines(site, [draw_line(number) for number in range(3)], 0.1)
    poses = [(42.0, 0.0, 0.0), (42.2, 0.0, 0.0)]
    lines, starts = begin_where_tractors_stand(site, left, [(pose, False) for pose in poses], 0.1)
    assert starts == (0, 6) and lines[3].is_place


def test_the_order_of_before_is_found_again_line_by_line() -> None:
    site = make_site(shapely.box(0.0, -2.0, 40.0, 2.0))
    left = leave_done_lines(site, [draw_line(number) for number in range(3)], 0.1)
    lines, starts = begin_where_tractors_stand(site, left, [((40.0 + TOOL_M, 0.0, 0.0), False)], 0.1)
    rest, turn, second, first = (
        Leg(np.array([[42.0, 0.0], [102.0, 0.0]]), 1.0, implement=True, task=LegTask(SWATH, 0)),
        bend(6.0, 3.0, implement=False),
        Leg(np.array([[98.0, 8.0], [-2.0, 8.0]]), 1.0, implement=True, task=LegTask(SWATH, 2)),
        Leg(np.array([[2.0, 4.0], [102.0, 4.0]]), 1.0, implement=True, task=LegTask(SWATH, 1)),
    )
    round_corner, raised = bend(6.0, 3.0), dataclasses.replace(second, implement=False)
    ahead = list_places_ahead([rest, turn, round_corner, second, raised, first])
    assert len(ahead) == 3 and ahead[1] == pytest.approx((48.0, 8.0, math.pi))
    assert find_orders(site, lines, starts, [ahead]) == ((0, 5, 2),)
