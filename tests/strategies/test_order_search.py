"""Programmes by local search: against brute force, closed forms, and the cost summed node by node."""

from dataclasses import replace
from functools import cache
from itertools import pairwise, permutations, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.errors import HeadlandError
from strategies.programmes.order_search import (
    OrderProblem,
    _build_tables,
    compute_cost_s,
    count_clashes,
    search_programmes,
    search_tours,
)
from strategies.programmes.order_tours import (
    RULE_S,
    SUM_SHARE,
    create_tours,
)

SEEDS = range(200)
KICKS, FEW_KICKS = 100, 10  # for few lines, and for many


def make_problem(
    seed: int, n: int, k: int, *, no_move_share: float = 0.0, stages: int = 1, clash_share: float = 0.0
) -> OrderProblem:
    """Random lines in a square, with moves that differ by direction; some moves missing, some lines worth little."""
    draw = np.random.default_rng(seed)
    size_m = 60.0 * np.sqrt(n)
    ends_m = draw.uniform(0.0, size_m, (n, 1, 2)) + np.stack([np.zeros((n, 2)), draw.normal(0.0, 60.0, (n, 2))], axis=1)
    begin_m, end_m = ends_m.reshape(-1, 2), ends_m[:, ::-1].reshape(-1, 2)
    move_s = np.linalg.norm(end_m[:, None] - begin_m[None], axis=2) * draw.uniform(0.8, 1.5, (2 * n, 2 * n))
    move_s[draw.random(move_s.shape) < no_move_share] = np.inf
    entrance_m = draw.uniform(0.0, size_m, (k, 1, 2))
    clashes = np.random.default_rng(seed).random((2, 2 * n, 2 * n)) < clash_share
    return OrderProblem.from_moves(
        move_s,
        np.linalg.norm(ends_m[:, 0] - ends_m[:, 1], axis=1),
        draw.uniform(50.0, 900.0, n),
        np.linalg.norm(entrance_m - begin_m, axis=2),
        np.linalg.norm(entrance_m - end_m, axis=2),
        tractors=k,
        allowed=draw.random((k, n)) < 0.8,
        stage=draw.integers(0, stages, n),
        clashes=clashes | clashes.transpose(0, 2, 1),
    )


@cache
def list_tours(n: int, size: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """All tours of `size` of n lines, in all directions (how many, size)."""
    lines = np.array(list(permutations(range(n), size)))
    turned = np.array(list(product((0, 1), repeat=size)))
    return (2 * lines[:, None] + turned[None]).reshape(-1, size)


def find_least_cost_s(problem: OrderProblem) -> float:
    """The cost of the best programme, all of them tried: for every tractor the best tour of every set of lines."""
    n, k, sum_share = len(problem.work_s), len(problem.begin_s), problem.sum_share
    move_s, begin_s, end_s = problem.tabulate_moves()
    quickest_s = np.full((k, 2**n), np.inf)
    quickest_s[:, 0] = 0.0
    for tractor, size in product(range(k), range(1, n + 1)):
        tours = list_tours(n, size)
        lines = tours // 2
        seconds = begin_s[tractor, tours[:, 0]] + end_s[tractor, tours[:, -1]] + problem.work_s[lines].sum(axis=1)
        seconds = seconds + move_s[tours[:, :-1], tours[:, 1:]].sum(axis=1)
        if problem.need is not None:
            seconds += RULE_S * np.maximum(0.0, problem.need[lines].sum(axis=1) - 1.0)
        seconds[~problem.allowed[tractor, lines].all(axis=1)] = np.inf
        np.minimum.at(quickest_s[tractor], (1 << lines).sum(axis=1), seconds)
    least_s = np.inf
    for shares in product(range(k + 1), repeat=n):
        sets = [sum(1 << line for line in range(n) if shares[line] == tractor) for tractor in range(k)]
        seconds = quickest_s[np.arange(k), sets]
        left_s = sum(problem.value_s[line] for line in range(n) if shares[line] == k)
        if np.isfinite(seconds).all():
            least_s = min(least_s, (1.0 - sum_share) * seconds.max() + sum_share * seconds.sum() + left_s)
    return float(least_s)


def limit_loads(problem: OrderProblem, seed: int) -> OrderProblem:
    """The problem with tours that are loads: what counts is their sum."""
    need = np.random.default_rng(seed).uniform(0.1, 0.9, len(problem.work_s))
    return replace(problem, need=need, sum_share=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("no_move_share", "are_loads"), [(0.0, False), (0.4, False), (0.0, True)])
def test_few_lines_are_nearly_always_in_the_best_order(no_move_share: float, are_loads: bool) -> None:
    best_count = 0
    for seed in SEEDS:
        problem = make_problem(seed, 1 + seed % 5, 1 + seed // 5 % 2, no_move_share=no_move_share, stages=1 + seed % 3)
        problem = limit_loads(problem, seed) if are_loads else problem
        cost_s = compute_cost_s(problem, search_programmes(problem, KICKS, seed))
        least_s = find_least_cost_s(problem)
        assert cost_s >= least_s - 1e-6
        assert cost_s <= 1.25 * least_s
        best_count += cost_s <= 1.01 * least_s
    assert best_count >= 0.97 * len(SEEDS)


@pytest.mark.parametrize("k", [1, 2, 5])
def test_the_cost_along_the_way_is_the_cost_node_by_node(k: int) -> None:
    for seed in range(10):
        problem = make_problem(seed, 40, k, no_move_share=0.2, stages=2, clash_share=0.3)
        problem = replace(problem, need=np.full(40, 0.03), sum_share=0.4)
        none, kicks = np.full((k, 40), -1, np.int64), seed
        found, cost_s = search_tours(_build_tables(problem), create_tours(k, 40), none, kicks, seed, False)
        tours = [tour[tour >= 0].tolist() for tour in found]
        assert sum(map(len, tours)) > 20
        assert cost_s == pytest.approx(compute_cost_s(problem, tours), rel=1e-12)


@pytest.mark.parametrize("k", [2, 3, 6])
def test_no_two_tours_begin_or_end_as_no_two_may(k: int) -> None:
    clashing = 0
    for seed in range(20):
        problem = make_problem(seed, 30, k, clash_share=0.05)
        free = replace(problem, clashes=None)
        tours, free_tours = (search_programmes(each, KICKS, seed) for each in (problem, free))
        assert count_clashes(problem, tours) == 0
        assert compute_cost_s(free, tours) < 1.1 * compute_cost_s(free, free_tours)
        clashing += count_clashes(problem, free_tours) > 0
    assert clashing, "without the rule they do"


def test_leaving_lines_that_are_worth_little_makes_no_new_clash() -> None:
    for seed in (11, 27, 38, 47, 56):
        problem = make_problem(seed, 24, 8, no_move_share=0.2, stages=2, clash_share=0.5 if seed > 40 else 0.2)
        worth = np.random.default_rng(seed).choice([0.02, 0.3, 1.0, 5.0], 24)
        problem = replace(problem, value_s=problem.value_s * worth)
        start = search_programmes(problem, 0, seed)
        found = search_programmes(problem, 60, seed + 1, start)
        assert compute_cost_s(problem, found) <= compute_cost_s(problem, start) + 1e-6
        assert count_clashes(problem, found) == 0


def test_of_two_that_would_clash_one_stays_at_home_where_there_is_no_other_way() -> None:
    problem = OrderProblem.from_moves(
        np.full((8, 8), 10.0), np.full(4, 100.0), np.full(4, 1e4), tractors=2, clashes=np.ones((2, 8, 8), bool)
    )
    assert sorted(map(len, search_programmes(problem, KICKS, 1))) == [0, 4]


def test_parallel_lines_are_driven_as_a_serpentine() -> None:
    """Turns cost 10 s and 1 s for each line between; to drive back to where a line began is not possible."""
    n, turn_s = 30, 10.0
    between = np.abs(np.arange(n)[:, None] - np.arange(n)[None]).astype(float)
    move_s = np.full((2 * n, 2 * n), np.inf)
    for forward in (0, 1):
        move_s[forward::2, 1 - forward :: 2] = np.where(between > 0.0, turn_s + between - 1.0, np.inf)
    problem = OrderProblem.from_moves(move_s, np.full(n, 100.0), np.full(n, 1000.0))
    (tour,) = search_programmes(problem, KICKS, 1)
    assert [abs(b // 2 - a // 2) for a, b in pairwise(tour)] == [1] * (n - 1)
    assert all(a % 2 != b % 2 for a, b in pairwise(tour))
    assert compute_cost_s(problem, [tour]) == pytest.approx(100.0 * n + turn_s * (n - 1))


def test_equal_lines_are_shared_evenly() -> None:
    """12 lines of 100 s and moves of 10 s between any two: 4 lines for each of 3 tractors."""
    problem = OrderProblem.from_moves(np.full((24, 24), 10.0), np.full(12, 100.0), np.full(12, 1e4), tractors=3)
    tours = search_programmes(problem, KICKS, 1)
    assert [len(tour) for tour in tours] == [4, 4, 4]
    assert compute_cost_s(problem, tours) == pytest.approx((1.0 - SUM_SHARE) * 430.0 + SUM_SHARE * 1290.0)


def test_lines_worth_less_than_they_cost_are_left() -> None:
    """Each line takes 100 s of work and 10 s to get to."""
    value_s = np.where(np.arange(9) % 3 == 0, 105.0, 115.0)
    problem = OrderProblem.from_moves(np.full((18, 18), 10.0), np.full(9, 100.0), value_s)
    (tour,) = search_programmes(problem, KICKS, 1)
    assert sorted(node // 2 for node in tour) == [1, 2, 4, 5, 7, 8]


def test_distant_lines_are_worked_where_together_they_are_worth_it() -> None:
    """Two groups of 4 lines, 300 s apart: one line more would not pay, four do; worth 60 s each they do not."""
    group = np.repeat(np.arange(8) // 4, 2)
    move_s = np.where(group[:, None] == group[None], 10.0, 300.0)
    for value_s, count in ((200.0, 8), (100.0, 4)):
        problem = OrderProblem.from_moves(move_s, np.full(8, 50.0), np.full(8, value_s))
        assert sum(map(len, search_programmes(problem, KICKS, 1))) == count


def test_lines_that_no_move_reaches_are_left_whatever_they_are_worth() -> None:
    """Two groups of lines with nothing between them, the second worth more."""
    group = np.repeat((np.arange(10) >= 4).astype(int), 2)
    move_s = np.where(group[:, None] == group[None], 10.0, np.inf)
    problem = OrderProblem.from_moves(move_s, np.full(10, 100.0), np.full(10, 5e5))
    tours = search_programmes(problem, KICKS, 1, start=[[2 * line for line in range(10)]])
    assert sorted(node // 2 for node in tours[0]) == [4, 5, 6, 7, 8, 9]
    two = OrderProblem.from_moves(move_s, np.full(10, 100.0), np.full(10, 5e5), tractors=2)
    assert sorted(map(len, search_programmes(two, KICKS, 1))) == [4, 6]


def test_no_move_is_used_that_does_not_exist() -> None:
    for seed in range(9):
        problem = make_problem(seed, 40, 1 + seed % 3, no_move_share=0.7)
        tours = search_programmes(problem, FEW_KICKS, seed)
        assert all(np.isfinite(problem.move_s[a, b]) for tour in tours for a, b in pairwise(tour))
        assert sum(map(len, tours)) > 15


def test_lines_of_a_lower_stage_come_first() -> None:
    for seed in range(9):
        problem = make_problem(seed, 30, 1 + seed % 3, stages=3)
        tours = search_programmes(problem, FEW_KICKS, seed)
        assert sum(map(len, tours)) > 15
        for tour in tours:
            stages = [problem.stage[node // 2] for node in tour]
            assert stages == sorted(stages)


def test_a_start_is_improved_after_moves_were_struck() -> None:
    for seed in range(4):
        problem = make_problem(seed, 40, 2)
        tours = search_programmes(problem, KICKS, seed)
        assert compute_cost_s(problem, search_programmes(problem, 0, 0, start=tours)) <= compute_cost_s(problem, tours)
        move_s = problem.move_s.copy()
        for tour in tours:
            for a, b in list(pairwise(tour))[::3]:
                move_s[a, b] = np.inf
        struck = OrderProblem(**{**vars(problem), "move_s": move_s})
        again = search_programmes(struck, KICKS, seed, start=tours)
        anew = search_programmes(struck, KICKS, seed)
        assert all(np.isfinite(move_s[a, b]) for tour in again for a, b in pairwise(tour))
        assert compute_cost_s(struck, again) <= 1.1 * compute_cost_s(struck, anew)


problems = st.builds(
    make_problem,
    st.integers(0, 10**6),
    st.integers(1, 25),
    st.integers(1, 4),
    no_move_share=st.sampled_from([0.0, 0.3, 0.9, 1.0]),
    stages=st.integers(1, 3),
)


@given(problems, st.integers(0, 2**40))
def test_programmes_are_lawful_and_repeat(problem: OrderProblem, seed: int) -> None:
    tours = search_programmes(problem, FEW_KICKS, seed)
    lines = [node // 2 for tour in tours for node in tour]
    assert len(lines) == len(set(lines))
    assert all(problem.allowed[tractor, node // 2] for tractor, tour in enumerate(tours) for node in tour)
    assert search_programmes(problem, FEW_KICKS, seed) == tours
    nothing_s = float(problem.value_s.sum())
    assert compute_cost_s(problem, tours) <= nothing_s + 1e-6


@given(problems, st.randoms(use_true_random=False))
def test_no_programme_costs_more_than_its_start(problem: OrderProblem, draw: Any) -> None:
    n, k = len(problem.work_s), len(problem.begin_s)
    start: list[list[int]] = [[] for _ in range(k)]
    for line in draw.sample(range(n), n):
        tractor = draw.randrange(k)
        if problem.allowed[tractor, line]:
            start[tractor].append(2 * line + draw.randrange(2))
    tours = search_programmes(problem, 3, 1, start=start)
    assert compute_cost_s(problem, tours) <= compute_cost_s(problem, start) * (1.0 + 1e-12)


def test_more_kicks_never_cost_more() -> None:
    problem = make_problem(7, 60, 2)
    costs = [compute_cost_s(problem, search_programmes(problem, kicks, 3)) for kicks in (0, 20, 100)]
    assert costs[0] >= costs[1] >= costs[2] and costs[0] > costs[2]


def test_no_lines_and_one_line() -> None:
    none = OrderProblem.from_moves(np.zeros((0, 0)), np.zeros(0), np.zeros(0), tractors=2)
    assert search_programmes(none, KICKS, 1) == [[], []]
    one = OrderProblem.from_moves(
        np.full((2, 2), np.inf), np.array([9.0]), np.array([50.0]), np.array([[3.0, 1.0]]), np.array([[3.0, 1.0]])
    )
    assert search_programmes(one, KICKS, 1) == [[1]]


def test_refusals_name_the_value_and_the_rule() -> None:
    move_s, work_s = np.full((4, 4), 10.0), np.full(2, 5.0)
    with pytest.raises(HeadlandError, match=r"value_s has the shape \(3,\); for 2 lines and 1 tractors give \(2,\)"):
        OrderProblem.from_moves(move_s, work_s, np.zeros(3))
    with pytest.raises(HeadlandError, match=r"move_s holds -1\.0"):
        OrderProblem.from_moves(np.full((4, 4), -1.0), work_s, work_s)
    with pytest.raises(HeadlandError, match="add up to 1e\\+07 s or more"):
        OrderProblem.from_moves(move_s, work_s, np.full(2, 1e7))
    with pytest.raises(HeadlandError, match="no tractor"):
        OrderProblem.from_moves(move_s, work_s, work_s, tractors=0)
    with pytest.raises(
        HeadlandError, match=r"clashes has the shape \(4, 4\); for 2 lines and 1 tractors give \(2, 4, 4\)"
    ):
        OrderProblem.from_moves(move_s, work_s, work_s, clashes=np.ones((4, 4), bool))
    problem = OrderProblem.from_moves(
        move_s, work_s, work_s, tractors=2, allowed=np.array([[True, True], [False, True]])
    )
    for start, words in (([[0]], "1 tours"), ([[0], [1]], "twice"), ([[], [0]], "tractor 2 works line 0")):
        with pytest.raises(HeadlandError, match=words):
            search_programmes(problem, 0, 1, start=start)


def test_the_order_of_tracks_is_turned_where_each_stays_as_it_is_driven() -> None:
    """Eight tracks to be worked one after its neighbour; the search begins with the seventh to the first, then the
    last."""
    tracks, ends_at_top = np.divmod(np.arange(16) ^ 1, 2)
    is_beside = abs(np.subtract.outer(tracks, tracks)) == 1
    stays_there = ends_at_top[:, None] != ends_at_top  # a track driven backward begins where one driven forward ends
    move_s = np.where(is_beside & stays_there, 10.0, 130.0)
    begin_s = 300.0 * (1 - ends_at_top)[None]  # from the bottom
    problem = OrderProblem.from_moves(move_s, np.full(8, 60.0), np.full(8, 1e4), begin_s)
    problem = replace(problem, turns_runs=True)
    found = search_programmes(problem, 0, 1, [[12, 11, 8, 7, 4, 3, 0, 15]])
    assert compute_cost_s(problem, found) == pytest.approx(8 * 60.0 + 7 * 10.0)
