"""Stops on a fixed tour: the dynamic programme against all choices of stops."""

import math
from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.service_stops.tour_stops import TourNeeds, choose_stops
from tests.examples import count_examples

COUNTS = st.integers(1, 8)


def draw_list(draw: st.DrawFn, size: int, low: float, high: float) -> list[float]:
    return draw(st.lists(st.floats(low, high), min_size=size, max_size=size))


@st.composite
def tours(draw: st.DrawFn) -> tuple[TourNeeds, list[float]]:
    """A few lines with any needs of lines, moves and ways, and the cost of a stop in each gap."""
    n = draw(COUNTS)
    needs = TourNeeds(
        draw_list(draw, n, 0.1, 1.0),
        draw_list(draw, n, 0.0, 0.2),
        draw_list(draw, n + 1, 0.0, 0.3),
        draw_list(draw, n + 1, 0.0, 0.3),
    )
    return needs, draw_list(draw, n, 0.0, 9.0)


@settings(max_examples=count_examples(80))
@given(tours(), st.sampled_from([1.2, 1.7, 3.0, 9.0]))
def test_no_other_stops_cost_less(values: tuple[TourNeeds, list[float]], capacity: float) -> None:
    needs, costs_s = values
    n = len(costs_s)
    every = [gaps for size in range(n) for gaps in combinations(range(1, n), size)]
    fitting = [gaps for gaps in every if all(load <= capacity + 1e-9 for load in needs.list_loads(gaps))]
    found = choose_stops(needs, costs_s, capacity, lambda gap, later_s: 0.0)
    if not fitting:
        assert found is None
        return
    assert found in fitting
    least_s = min(math.fsum(costs_s[gap] for gap in gaps) for gaps in fitting)
    assert math.fsum(costs_s[gap] for gap in found) == pytest.approx(least_s, abs=1e-5)


def test_a_load_ends_early_where_the_place_is_near() -> None:
    """Three lines of one, loads of two: the stop after the first costs less than that after the second."""
    needs = TourNeeds([1.0] * 3, [0.0] * 3, [0.0] * 4, [0.0] * 4)
    assert choose_stops(needs, [0.0, 5.0, 9.0], 2.0, lambda gap, later_s: 0.0) == (1,)
    assert choose_stops(needs, [0.0, 5.0, 9.0], 2.0, lambda gap, later_s: 5.0 * (gap == 1)) == (2,), "others are there"


def test_ways_to_the_place_count_and_a_gap_without_a_move_has_a_stop() -> None:
    long_way = TourNeeds([1.0] * 2, [0.0] * 2, [0.0, 1.5, 0.0], [0.0] * 3)
    assert choose_stops(long_way, [0.0, 1.0], 1.9, lambda gap, later_s: 0.0) is None
    apart = TourNeeds([1.0] * 2, [0.0, math.inf], [0.0] * 3, [0.0] * 3)
    assert choose_stops(apart, [0.0, 1.0], 9.0, lambda gap, later_s: 0.0) == (1,)
