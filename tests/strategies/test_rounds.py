"""Rounds of neighbouring columns: runs, how they are divided, and where tractors stand, by hand."""

import math

import pytest

from strategies.formations.columns import Column, find_runs
from strategies.formations.rounds import (
    APPROACH_M,
    ColumnRound,
    ColumnTraffic,
    compute_needed_length_m,
    divide_runs,
    get_neighbour,
    get_row,
    has_room,
    place_tractors,
)
from strategies.rules.driving_rules import DrivingRules
from vehicle.missions.plan import MAX_JOINT_GAP_M

RULES = DrivingRules(2.0, 2.0, 1.0, 5.0, 1.0)  # rows 10 m apart, 8 m held back
NORTH, SOUTH = 0.5 * math.pi, -0.5 * math.pi


def draw_column(swath: int, south_m: float = 0.0, north_m: float = 100.0) -> Column:
    """A swath of 3 m from south to north."""
    x = 3.0 * swath
    ends = (x, south_m, NORTH), (x, north_m, NORTH)
    return Column(swath, (2 * swath,), ends, ((x, north_m, SOUTH), (x, south_m, SOUTH)))


def draw_round(tractors: int, north_m: float = 100.0) -> ColumnRound:
    return ColumnRound(0, tuple(draw_column(swath, 0.0, north_m) for swath in range(tractors)))


@pytest.mark.parametrize(("tractors", "rows"), [(2, [1, 2]), (3, [2, 1, 2]), (4, [2, 1, 2, 3]), (5, [3, 2, 1, 2, 3])])
def test_rows_lead_from_the_middle(tractors: int, rows: list[int]) -> None:
    assert [get_row(tractor, tractors) for tractor in range(tractors)] == rows
    for tractor, row in enumerate(rows):
        neighbour = get_neighbour(tractor, tractors)
        assert (neighbour is None) == (row == 1)
        assert neighbour is None or (rows[neighbour] == row - 1 and abs(neighbour - tractor) == 1)


@pytest.mark.parametrize("way", [0, 1])
def test_places_are_a_gap_apart_and_the_queue_is_clear_of_the_headland(way: int) -> None:
    places = place_tractors(draw_round(5), way, RULES)
    assert [place.place_m for place in places] == [0.0, 10.0, 20.0, 10.0, 0.0]
    assert [place.hold_m for place in places] == [72.0, 82.0, 92.0, 82.0, 72.0]
    assert [place.up_m for place in places] == [(82.0, 92.0), (92.0,), (), (92.0,), (82.0, 92.0)]


def test_who_passes_moves_places_on_and_the_queue_back() -> None:
    busy = ColumnTraffic(lambda place_m: place_m + 5.0, lambda place_m: place_m - 4.0, join_m=2.0, leave_m=3.0)
    places = place_tractors(draw_round(3), 0, RULES, [busy, ColumnTraffic(), ColumnTraffic()])
    assert places[0].place_m == 7.0 and places[0].hold_m == 100.0 - 3.0 - 8.0 - 10.0 - 4.0
    assert places[1].place_m == 17.0, "a gap ahead of the last of the row behind"


@pytest.mark.parametrize("tractors", [2, 3, 5])
def test_the_least_length_has_just_room(tractors: int) -> None:
    rows = max(get_row(tractor, tractors) for tractor in range(tractors))
    needed_m = compute_needed_length_m(RULES, rows)
    assert needed_m == pytest.approx((rows - 1) * 10.0 + 8.0 + APPROACH_M + MAX_JOINT_GAP_M)
    assert has_room(draw_round(tractors, needed_m + 1e-6), RULES)
    assert not has_room(draw_round(tractors, needed_m - 1e-3), RULES)


def test_runs_follow_the_larger_overlap_round_a_hole() -> None:
    whole = [draw_column(0), draw_column(3)]
    pieces = [draw_column(swath, *span) for swath in (1, 2) for span in ((0.0, 60.0), (70.0, 100.0))]
    runs = find_runs(sorted([*whole, *pieces], key=lambda column: column.swath), 3.0)
    assert [[(column.swath, column.length_m) for column in run] for run in runs] == [
        [(0, 100.0), (1, 60.0), (2, 60.0), (3, 100.0)],
        [(1, 30.0), (2, 30.0)],
    ]


def test_rounds_leave_the_shortest_columns_over() -> None:
    run = [draw_column(swath, 0.0, 60.0 if swath in (0, 4) else 100.0) for swath in range(8)]
    rounds = divide_runs([run], 3, RULES)
    assert [[column.swath for column in one.columns] for one in rounds] == [[1, 2, 3], [5, 6, 7]]
    assert divide_runs([run[:2]], 3, RULES) == []
