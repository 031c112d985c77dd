"""Orders in loads: the split against brute force, the search against known answers."""

from itertools import combinations, pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.service_stops.load_search import (
    UNREACHABLE_S,
    LoadOrderingTask,
    compute_load_begins,
    count_swaths_of_load,
    order_in_loads,
    search_with_kicks,
    split_into_loads,
)
from tests.examples import count_examples
from tests.strategies.known_orders import (
    B_STAR,
    IN_LOADS,
    LOADS_RADIUS_M,
    LOADS_WIDTH_M,
    from_depot,
    starts_for,
    turned_only,
    without_stops,
)


@st.composite
def tasks(draw: st.DrawFn, most: int = 5) -> LoadOrderingTask:
    """A few tracks with any seconds and needs, none above a load."""
    n = draw(st.integers(1, most))
    random = np.random.default_rng(draw(st.integers(0, 10_000)))
    turns, detours = random.uniform(1.0, 50.0, (2, 2 * n, 2 * n))
    need, capacity = random.uniform(0.2, 1.0, n), draw(st.sampled_from([1.0, 1.3, 2.0, 4.0]))
    room = max(float(need.max()), capacity * draw(st.sampled_from([0.5, 1.0])))
    return LoadOrderingTask(turns, detours, *random.uniform(0.0, 30.0, (2, 2 * n)), need, room, capacity)


def cost_of(passes: list[int], cuts: tuple[int, ...], task: LoadOrderingTask) -> float:
    """Seconds of an order with these directions and stops, added up one by one."""
    total = float(task.first[passes[0]] + task.last[passes[-1]])
    for k in range(1, len(passes)):
        total += float((task.detours if k in cuts else task.turns)[passes[k - 1], passes[k]])
    return total


def enough(order: list[int], cuts: tuple[int, ...], task: LoadOrderingTask) -> bool:
    """Whether no load is above what a tank holds, the first above what is left in it."""
    edges = [0, *cuts, len(order)]
    loads = [sum(task.need[t] for t in order[a:b]) for a, b in pairwise(edges)]
    return all(load <= (task.first_load if k == 0 else task.capacity) + 1e-9 for k, load in enumerate(loads))


def brute(order: list[int], task: LoadOrderingTask) -> float:
    """The least over all directions and all stops."""
    n = len(order)
    every_cut = [cuts for size in range(n) for cuts in combinations(range(1, n), size) if enough(order, cuts, task)]
    every_way = [[2 * t + path for t, path in zip(order, paths, strict=True)] for paths in product((0, 1), repeat=n)]
    return min(cost_of(passes, cuts, task) for cuts in every_cut for passes in every_way)


@settings(max_examples=count_examples(60))
@given(tasks())
def test_the_split_of_an_order_is_exact(task: LoadOrderingTask) -> None:
    order = list(range(len(task.need)))
    found = split_into_loads(np.array(order), task)
    assert found.seconds == pytest.approx(brute(order, task), abs=1e-9)
    assert (found.passes // 2).tolist() == order
    assert cost_of(found.passes.tolist(), found.cuts, task) == pytest.approx(found.seconds, abs=1e-9), "as it says"
    assert enough(order, found.cuts, task), "no load is above the tank"


@settings(max_examples=count_examples(25))
@given(tasks(most=8), st.integers(0, 5))
def test_the_search_promises_what_the_split_keeps(task: LoadOrderingTask, seed: int) -> None:
    arrays = task.turns, task.detours, task.first, task.last, task.need, task.first_load, task.capacity
    order, seconds = search_with_kicks(np.arange(len(task.need)), *arrays, count_swaths_of_load(task), 20_000, seed)
    assert sorted(order.tolist()) == list(range(len(task.need)))
    assert split_into_loads(order, task).seconds == pytest.approx(seconds, abs=1e-6), "tables of parts give the whole"
    assert seconds <= split_into_loads(np.arange(len(task.need)), task).seconds + 1e-6


def test_the_search_finds_the_best_of_all_orders() -> None:
    from itertools import permutations

    task = from_depot(6, 2, 13.0)
    best = min(split_into_loads(np.array(order), task).seconds for order in permutations(range(6)))
    assert order_in_loads(task, [list(range(6))]).seconds == pytest.approx(best)


@pytest.mark.parametrize(("n", "load", "depot_m", "in_a_row", "known"), IN_LOADS)
def test_known_answers_from_a_depot(n: int, load: int, depot_m: float, in_a_row: float, known: float) -> None:
    task = from_depot(n, load, depot_m)
    assert without_stops(split_into_loads(np.arange(n), task).seconds, task) == pytest.approx(in_a_row, abs=0.005)
    found = order_in_loads(task, starts_for(n, LOADS_WIDTH_M, LOADS_RADIUS_M))
    assert len(found.cuts) == n // load - 1
    ours = without_stops(found.seconds, task)
    assert ours <= known * 1.005
    if n == 12:
        assert ours >= known - 0.02, "proven: nothing is below but rounding"


@pytest.mark.parametrize("radius", [6.0, 10.9])
def test_an_order_in_loads_is_never_dearer_than_the_printed_one(radius: float) -> None:
    task = turned_only(radius)
    printed = split_into_loads(np.array(B_STAR) - 1, task)
    assert printed.cuts == (8, 16)
    assert order_in_loads(task, starts_for(24, LOADS_WIDTH_M, radius)).seconds <= printed.seconds


def test_the_same_input_gives_the_same_order() -> None:
    task = from_depot(12, 4, 40.0)
    one, two = (order_in_loads(task, [list(range(12))]) for _ in range(2))
    assert (one.passes.tolist(), one.cuts, one.seconds) == (two.passes.tolist(), two.cuts, two.seconds)


def test_an_order_that_cannot_be_is_far() -> None:
    task = from_depot(3, 1, 0.0)  # every load begins and ends below, and one track alone ends above
    assert split_into_loads(np.arange(3), task).seconds >= UNREACHABLE_S


def test_tables_of_starts_grow_by_the_place() -> None:
    task, begun = from_depot(6, 2, 0.0), np.empty((6, 2))
    compute_load_begins(
        np.arange(6), 0, task.turns, task.detours, task.first, task.need, task.first_load, task.capacity, begun
    )
    assert begun[0].tolist() == task.first[:2].tolist()
    assert begun[2, 0] < UNREACHABLE_S <= begun[1, 0], "after one track the depot is on the other side"
