"""Blocks of lines: cut as evenly as can be."""

from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.rules.dealing import cut_balanced_blocks


@given(st.lists(st.integers(10, 400), min_size=1, max_size=9), st.data())
def test_contiguous_complete_and_as_even_as_can_be(weights: list[int], data: st.DataObject) -> None:
    count = data.draw(st.integers(1, len(weights)))
    borders = cut_balanced_blocks(weights, count)
    assert borders[0] == 0 and borders[-1] == len(weights) and len(borders) == count + 1
    assert all(a < b for a, b in pairwise(borders))
    cuts = combinations(range(1, len(weights)), count - 1)
    best = min(max(sum(weights[a:b]) for a, b in pairwise((0, *inner, len(weights)))) for inner in cuts)
    assert max(sum(weights[a:b]) for a, b in pairwise(borders)) == pytest.approx(best, rel=1e-9)
