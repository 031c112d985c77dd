"""Orders of tracks against brute force, proven optima in closed form, and the bounds beside them."""

import math
from collections.abc import Sequence
from functools import cache
from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.sequencing.directed_bounds import _find_arborescence, bound_by_pass_prices
from strategies.sequencing.order_proof import PROVEN_GAP, prove_tour, solve_circuit
from strategies.sequencing.swath_order import build_skip_pattern
from strategies.sequencing.tour_bounds import bound_by_swath_prices, compute_least_between_s, find_best_order
from strategies.sequencing.tour_search import (
    MAX_MOVE_SWATHS,
    UNREACHABLE_S,
    TurnSeconds,
    _apply_best_move,
    _swap_runs,
    compute_order_seconds,
    find_best_tour,
    sharpen_bound,
    update_run_tables,
)
from tests.benchmarks.orders import (
    PROVEN,
    RADIUS_M,
    SMALL,
    WIDTH_M,
    fleet,
    parallel,
    slanted,
    starts_for,
    turn_m,
)


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
def test_bounds_hold_and_small_orders_are_the_best(drawn: tuple[list[int], list[int]]) -> None:
    n = len(drawn[1]) // 4
    turns = np.array(drawn[0], dtype=float).reshape(2 * n, 2 * n)
    first, last = np.array(drawn[1], dtype=float).reshape(2, 2 * n)
    best = find_best_tour(turns, first, last, [list(range(n)), list(range(n))[::-1]])
    exact = quickest(turns, first, last)
    assert sorted(best.passes // 2) == list(range(n))
    assert best.bound_s - 1e-6 <= exact <= best.seconds + 1e-6
    assert best.seconds == pytest.approx(TurnSeconds(turns, first, last).sum_order(best.passes))
    if n >= 4:
        assert best.seconds <= exact * 1.0005 + 1e-3
    assert bound_by_swath_prices(compute_least_between_s(turns, first, last), math.inf) <= exact + 1e-6
    bound = bound_by_pass_prices(turns, first, last, best.seconds)
    assert bound.bound_s <= exact + 1e-6
    passes = find_best_order(turns, first, last, math.inf)
    assert sorted(passes // 2) == list(range(n))
    assert TurnSeconds(turns, first, last).sum_order(passes) == pytest.approx(exact)
    assert len(find_best_order(turns, first, last, exact)) == 0  # nothing takes less than the best
    steps = bound.reduced_s[[2 * n, *passes], [*passes, 2 * n]]
    assert steps.min() >= -1e-6 and steps.sum() <= exact - bound.bound_s + 1e-6  # no turn of the best is ruled out


def test_prices_per_pass_see_that_a_tour_comes_to_both_ends_of_a_track() -> None:
    """Ends in the south are 1 s from each other, those in the north 9 s: half of all turns have to be there."""
    n = 6
    turns = np.where(np.arange(2 * n)[:, None] % 2 == 0, 9.0, 1.0) * np.ones(2 * n)
    same = np.arange(2 * n)[:, None] % 2 == np.arange(2 * n) % 2
    turns[same | (np.arange(2 * n)[:, None] // 2 == np.arange(2 * n) // 2)] = UNREACHABLE_S
    free = np.zeros(2 * n)
    exact = 3 * 1.0 + 2 * 9.0
    assert quickest_of(turns, free) == exact
    assert bound_by_swath_prices(compute_least_between_s(turns, free, free), math.inf) == pytest.approx(5.0)
    assert 0.999 * exact <= bound_by_pass_prices(turns, free, free, exact).bound_s <= exact + 1e-6


def test_prices_per_pass_see_that_one_way_round_takes_longer() -> None:
    """A turn ahead takes 9 s, the turn back between the same swaths 1 s: of both ways round only one can be driven."""
    turns = np.full((12, 12), 9.0)
    turns[np.arange(12)[:, None] // 2 > np.arange(12) // 2] = 1.0
    free = np.zeros(12)
    assert bound_by_pass_prices(turns, free, free, 5.0).bound_s == pytest.approx(5.0)
    first = np.full(12, 9.0)
    first[:2] = 0.0  # who has to begin with the first swath drives ahead once at least
    exact = quickest_of(turns, free, first)
    assert exact == 9.0 + 4 * 1.0
    between = compute_least_between_s(turns, first, free)
    assert bound_by_swath_prices(between, math.inf) == pytest.approx(5.0)
    assert 0.99 * exact <= bound_by_pass_prices(turns, first, free, exact).bound_s <= exact + 1e-6


@pytest.mark.slow
@given(st.integers(1, 5).flatmap(lambda n: st.lists(st.integers(0, 30), min_size=n * n + n, max_size=n * n + n)))
def test_arborescences_are_the_cheapest_tried_one_by_one(drawn: list[int]) -> None:
    n = round(math.sqrt(len(drawn) + 0.25) - 0.5)
    cost = np.array(drawn, dtype=float).reshape(n + 1, n)
    cost[np.arange(n), np.arange(n)] = np.inf
    parent, dual, above = np.empty(n, np.int64), np.empty(2 * n), np.empty(2 * n, np.int64)
    total = _find_arborescence(cost, parent, dual, above)
    assert total == pytest.approx(sum(cost[parent[j], j] for j in range(n)))
    assert is_rooted(parent.tolist())
    others = (choice for choice in product(range(n + 1), repeat=n) if is_rooted(choice))
    assert total == pytest.approx(min(sum(cost[i, j] for j, i in enumerate(choice)) for choice in others))


def is_rooted(parents: Sequence[int]) -> bool:
    """Whether every node hangs from the last one, which has no parent."""
    n = len(parents)
    for j in range(n):
        for _ in range(n + 1):
            j = parents[j] if j < n else j
        if j < n:
            return False
    return True


def quickest_of(turns: np.ndarray, free: np.ndarray, first: np.ndarray | None = None) -> float:
    """Seconds of the best order, proven."""
    times = TurnSeconds(turns, free if first is None else first, free)
    return times.sum_order(find_best_order(*times, math.inf))


def test_a_turn_in_closed_form() -> None:
    assert turn_m(3.0, 4.0) == pytest.approx(25.5705, abs=1e-4)
    assert turn_m(9.0, 4.0) == pytest.approx(13.5664, abs=1e-4)


@pytest.mark.parametrize(("n", "width", "radius", "proven"), [row for row in PROVEN if row[0] <= 50])
def test_proven_optima(n: int, width: float, radius: float, proven: float) -> None:
    """Optima of a circuit model with every arc allowed, given to two decimals of a turn's length each."""
    turns, free = parallel(n, width, radius), np.zeros(2 * n)
    best = find_best_tour(turns, free, free, starts_for(n, width, radius))
    assert best.seconds <= proven * 1.0005
    assert best.seconds >= best.bound_s >= 0.99 * proven
    for start in starts_for(n, width, radius):
        assert best.seconds <= compute_order_seconds(np.array(start), turns, free, free) + 1e-6


@pytest.mark.parametrize(("n", "width", "radius", "proven"), SMALL)
def test_a_small_machine_on_a_tight_radius(n: int, width: float, radius: float, proven: float) -> None:
    """Known optima of many narrow swaths, found and proven; the turns are given to a millimetre each."""
    turns, free = parallel(n, width, radius), np.zeros(2 * n)
    best = prove_tour(find_best_tour(turns, free, free, starts_for(n, width, radius)))
    assert best.seconds == pytest.approx(proven, rel=1e-4)
    assert best.gap_pct <= 0.05 and best.seconds < 0.75 * compute_order_seconds(np.arange(n), turns, free, free)


def test_what_the_search_leaves_on_slanted_ends_is_proven_to_a_percent() -> None:
    """28 swaths of a triangle: a turn ahead is longer than the turn back, and the quicker one alone bounds nothing."""
    n = 28
    work, turns = slanted(n, per_swath_m=3.0)
    free = np.zeros(2 * n)
    searched = find_best_tour(turns, free, free, starts_for(n, WIDTH_M, RADIUS_M), bounded=False)
    assert searched.gap_pct > 4.0
    proven = prove_tour(searched)
    assert proven.seconds <= searched.seconds and proven.gap_pct <= 100.0 * PROVEN_GAP
    assert prove_tour(searched).passes.tolist() == proven.passes.tolist()
    assert prove_tour(proven).gap_pct <= proven.gap_pct and len(work) == n


def test_the_same_bytes_twice() -> None:
    turns, free = parallel(33, 3.0, 5.0), np.zeros(66)
    one, two = (find_best_tour(turns, free, free, [list(range(33)), build_skip_pattern(33, 4)]) for _ in range(2))
    assert one.passes.tobytes() == two.passes.tobytes() and one.seconds == two.seconds


def test_few_tracks_are_proven_where_the_bound_is_weak_as_by_a_circuit_model() -> None:
    turns, free = parallel(12, 3.0, 4.0), np.zeros(24)
    assert bound_by_swath_prices(compute_least_between_s(turns, free, free), math.inf) < 0.995 * 165.32
    best = find_best_tour(turns, free, free, [list(range(12))])
    assert best.gap_pct < 0.01 and best.seconds == pytest.approx(165.32, abs=0.05)
    solved = solve_circuit(TurnSeconds(turns, free, free), best.passes, np.ones((25, 25), dtype=bool), 1.0)
    assert solved is not None and (1.0 - PROVEN_GAP) * best.seconds - 0.02 <= solved[1] <= best.seconds + 1e-6


@pytest.mark.parametrize(("n", "tractors"), [(40, 1), (40, 3), (60, 4)])
def test_a_fleet_keeps_near_its_bound(n: int, tractors: int) -> None:
    work, turns = slanted(n)
    bound = (float(work.sum()) + (n - tractors) * float(turns.min())) / tractors
    assert bound <= fleet(work, turns, tractors) <= 1.06 * bound


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
            assert onward[i, w].min() == pytest.approx(compute_order_seconds(run, turns, free, free))
            assert backward[i, w].min() == pytest.approx(compute_order_seconds(run[::-1].copy(), turns, free, free))
        assert head[i].min() == pytest.approx(compute_order_seconds(order[: i + 1], turns, first, free))
        assert tail[i].min() == pytest.approx(compute_order_seconds(order[i:], turns, free, last))


def test_a_bound_may_be_sharpened_afterwards() -> None:
    turns, free = parallel(60, 3.0, 4.0), np.zeros(120)
    plain = find_best_tour(turns, free, free, [list(range(60))], bounded=False)
    whole = find_best_tour(turns, free, free, [list(range(60))])
    later = sharpen_bound(plain)
    assert plain.bound_s <= later.bound_s == whole.bound_s and plain.seconds == later.seconds == whole.seconds
    assert plain.passes.tolist() == later.passes.tolist() == whole.passes.tolist()


def test_a_bound_is_sharpened_once() -> None:
    rng = np.random.default_rng(5)
    turns, (first, last) = rng.uniform(10.0, 60.0, (48, 48)), rng.uniform(0.0, 90.0, (2, 48))
    plain = find_best_tour(turns, first, last, [list(range(24))], bounded=False)
    assert plain.bound_s < 0.99 * plain.seconds
    sharp = sharpen_bound(plain)
    assert plain.bound_s < sharp.bound_s <= plain.seconds
    assert sharpen_bound(sharp).bound_s == sharp.bound_s


def test_the_search_is_compiled_for_no_constant() -> None:
    """Constants handed over as such have a callee compiled for each of them; what is kept on disk is not listed."""
    find_best_tour(parallel(20, 3.0, 4.0), np.zeros(40), np.zeros(40), [list(range(20))])
    kinds = [str(kind) for one in (_swap_runs, _apply_best_move, update_run_tables) for kind in one.signatures]
    assert not [kind for kind in kinds if "literal" in kind.lower()]
