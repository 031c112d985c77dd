"""Blocks of lines: cut as evenly as can be, then balanced by what they really cost."""

from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.split_field import balance_borders, cut_balanced_blocks


@given(st.lists(st.integers(10, 400), min_size=1, max_size=9), st.data())
def test_contiguous_complete_and_as_even_as_can_be(weights: list[int], data: st.DataObject) -> None:
    count = data.draw(st.integers(1, len(weights)))
    borders = cut_balanced_blocks(weights, count)
    assert borders[0] == 0 and borders[-1] == len(weights) and len(borders) == count + 1
    assert all(a < b for a, b in pairwise(borders))
    cuts = combinations(range(1, len(weights)), count - 1)
    best = min(max(sum(weights[a:b]) for a, b in pairwise((0, *inner, len(weights)))) for inner in cuts)
    assert max(sum(weights[a:b]) for a, b in pairwise(borders)) == pytest.approx(best, rel=1e-9)


@given(st.lists(st.integers(1, 50), min_size=4, max_size=14), st.integers(2, 4))
def test_balancing_never_makes_the_last_later(costs: list[int], count: int) -> None:
    def cost(first: int, last: int) -> float:
        return float(sum(costs[first:last])) + 3.0 * ((last - first) % 3)

    begun = cut_balanced_blocks([1.0] * len(costs), count)
    ended = balance_borders(begun, cost)
    assert all(a < b for a, b in pairwise(ended)) and (ended[0], ended[-1]) == (0, len(costs))
    worst = [max(cost(a, b) for a, b in pairwise(borders)) for borders in (begun, ended)]
    assert worst[1] <= worst[0]


def test_a_line_moves_to_the_lighter_side() -> None:
    assert balance_borders([0, 5, 6], lambda first, last: float(last - first)) == [0, 3, 6]
