"""Orders of tracks against brute force and proven optima in closed form."""

from functools import cache
from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.sequencing.tour_search import (
    MAX_MOVE_SWATHS,
    _apply_best_move,
    _swap_runs,
    find_best_order,
    sum_order_s,
    update_run_tables,
)
from tests.benchmarks.orders import parallel, starts_for

PROVEN = ((10, 2.5, 1.7321, 64.98), (12, 3.0, 4.0, 165.35), (24, 9.0, 10.9, 942.40), (40, 4.5, 5.0, 754.89))
"""Tracks, their width and the radius (m), and the least metres of turns that a circuit model proved."""


@cache
def orders(n: int) -> np.ndarray:
    """Passes of all orders and directions (how many, n)."""
    swaths = np.array(list(permutations(range(n))))
    paths = np.array(list(product((0, 1), repeat=n)))
    return (2 * swaths[:, None] + paths[None]).reshape(-1, n)


def quickest(turns: np.ndarray, first: np.ndarray, last: np.ndarray) -> float:
    """Least seconds over all orders and directions, tried one by one."""
    passes = orders(len(first) // 2)
    return float((first[passes[:, 0]] + turns[passes[:, :-1], passes[:, 1:]].sum(axis=1) + last[passes[:, -1]]).min())


tables = st.integers(2, 5).flatmap(
    lambda n: st.tuples(
        st.lists(st.integers(1, 60), min_size=4 * n * n, max_size=4 * n * n),
        st.lists(st.integers(0, 20), min_size=4 * n, max_size=4 * n),
    )
)


@given(tables)
def test_an_order_is_never_quicker_than_the_best_and_no_slower_than_its_starts(
    drawn: tuple[list[int], list[int]],
) -> None:
    n = len(drawn[1]) // 4
    turns = np.array(drawn[0], dtype=float).reshape(2 * n, 2 * n)
    first, last = np.array(drawn[1], dtype=float).reshape(2, 2 * n)
    starts = [list(range(n)), list(range(n))[::-1]]
    order, seconds = find_best_order(turns, first, last, starts)
    assert sorted(order) == list(range(n))
    assert seconds == pytest.approx(sum_order_s(order, turns, first, last))
    assert quickest(turns, first, last) - 1e-6 <= seconds
    assert seconds <= min(sum_order_s(np.array(start), turns, first, last) for start in starts) + 1e-6


@pytest.mark.parametrize(("n", "width", "radius", "proven"), PROVEN)
def test_orders_of_parallel_tracks_are_near_proven_ones(n: int, width: float, radius: float, proven: float) -> None:
    free = np.zeros(2 * n)
    _, metres = find_best_order(parallel(n, width, radius), free, free, starts_for(n, width, radius))
    assert metres == pytest.approx(proven, rel=1e-3)  # those proven were rounded, turn by turn


@pytest.mark.slow
@given(st.integers(2, 60), st.integers(0, 2**32 - 1))
def test_tables_renewed_in_part_are_those_of_the_whole_order(n: int, seed: int) -> None:
    draw = np.random.default_rng(seed)
    turns, (first, last) = draw.uniform(1.0, 60.0, (2 * n, 2 * n)), draw.uniform(0.0, 20.0, (2, 2 * n))
    order, most, free = draw.permutation(n), min(n, MAX_MOVE_SWATHS), np.zeros(2 * n)
    onward, backward = (np.empty((n, most, 2, 2)) for _ in range(2))
    shortest, head, tail = np.empty((n, most, 2)), np.empty((n, 2)), np.empty((n, 2))
    update_run_tables(order, 0, n - 1, turns, first, last, onward, backward, shortest, head, tail)
    low, high = sorted(draw.integers(0, n, 2).tolist())
    order[low : high + 1] = order[low : high + 1][::-1].copy()
    update_run_tables(order, low, high, turns, first, last, onward, backward, shortest, head, tail)
    for i, w in draw.integers(0, (n, most), (20, 2)).tolist():
        if 0 < w < n - i:
            run = order[i : i + w + 1]
            assert shortest[i, w].tolist() == [onward[i, w].min(), backward[i, w].min()]
            assert onward[i, w].min() == pytest.approx(sum_order_s(run, turns, free, free))
            assert backward[i, w].min() == pytest.approx(sum_order_s(run[::-1].copy(), turns, free, free))
        assert head[i].min() == pytest.approx(sum_order_s(order[: i + 1], turns, first, free))
        assert tail[i].min() == pytest.approx(sum_order_s(order[i:], turns, free, last))


def test_the_search_is_compiled_for_no_constant() -> None:
    """Constants handed over as such have a callee compiled for each of them; what is kept on disk is not listed."""
    find_best_order(parallel(20, 3.0, 4.0), np.zeros(40), np.zeros(40), [list(range(20))])
    kinds = [str(kind) for one in (_swap_runs, _apply_best_move, update_run_tables) for kind in one.signatures]
    assert not [kind for kind in kinds if "literal" in kind.lower()]
