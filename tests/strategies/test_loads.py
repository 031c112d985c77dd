"""Orders in loads: the split against brute force, the search against known answers.

Parallel tracks of equal length are worked in loads, with ways along the lower headland to a depot on it after every
load, and every turn an omega or a U in closed form. IN_LOADS has the best that a circuit model found (proven for 12
tracks), B_STAR the order of Bochtis, Sorensen and Green (Decision Support Systems, 2012, doi
10.1016/j.dss.2011.12.005) for 24 tracks in three loads.
"""

import math
from itertools import combinations, pairwise, product

import numpy as np
import numpy.typing as npt
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

Floats = npt.NDArray[np.float64]

IN_LOADS = ((12, 4, 0.0, 575.80, 485.04), (24, 8, 103.5, 1001.54, 744.37))
"""Tracks, tracks per load, metres of the depot along the headland; one after another, and the best known."""
LOADS_WIDTH_M, LOADS_RADIUS_M = 9.0, 6.0
STOP_S = 1e4  # for a stop: as few loads as can be
B_STAR = (1, 3, 5, 7, 8, 6, 4, 2, 9, 11, 13, 15, 16, 14, 12, 10, 17, 19, 21, 23, 24, 22, 20, 18)


def turn_m(spacing: float, radius: float) -> float:
    """Length of the omega or the U over a spacing."""
    if spacing < 2.0 * radius:
        return radius * (math.pi + 4.0 * math.acos((0.5 * spacing + radius) / (2.0 * radius)))
    return math.pi * radius + spacing - 2.0 * radius


def parallel(n: int, width: float, radius: float) -> Floats:
    """Turns between the passes of n equal tracks (2 n, 2 n)."""
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * width
    turns = np.full((2 * n, 2 * n), UNREACHABLE_S)
    for i, j in zip(*np.nonzero(apart), strict=True):
        turns[2 * i, 2 * j + 1] = turns[2 * i + 1, 2 * j] = turn_m(float(apart[i, j]), radius)
    return turns


def build_skip_pattern(count: int, jump: int) -> list[int]:
    """Indices 0..count-1 in an order that jumps `jump` ahead and `jump` - 1 back, block by block of 2 `jump`."""
    order: list[int] = []
    for first in range(0, count, 2 * jump):
        size = min(2 * jump, count - first)
        half = (size + 1) // 2
        for index in range(half):
            order += [first + index, first + index + half][: 2 if index + half < size else 1]
    return order


def starts_for(n: int, width: float, radius: float) -> list[list[int]]:
    """One after another, and the two smallest jumps whose turns are wide."""
    wide = math.ceil(2.0 * radius / width)
    return [list(range(n))] + [build_skip_pattern(n, jump) for jump in (wide, wide + 1) if 1 < jump < n]


def from_depot(n: int, load: int, depot_m: float) -> LoadOrderingTask:
    """n parallel tracks in loads; every load begins and ends at a depot on the lower headland (metres for seconds)."""
    turns = parallel(n, LOADS_WIDTH_M, LOADS_RADIUS_M)
    along = np.abs(LOADS_WIDTH_M * np.arange(n) - depot_m)
    first, last = np.full(2 * n, UNREACHABLE_S), np.full(2 * n, UNREACHABLE_S)
    first[0::2], last[1::2] = along, along
    detours = np.minimum(last[:, None] + first[None, :] + STOP_S, UNREACHABLE_S)
    return LoadOrderingTask(turns, detours, first, last, np.ones(n), float(load), float(load))


def turned_only(radius: float) -> LoadOrderingTask:
    """24 tracks in loads of eight, the ways to the depot left out: the 21 turns within loads are compared."""
    turns, free = parallel(24, LOADS_WIDTH_M, radius), np.zeros(48)
    return LoadOrderingTask(turns, np.full((48, 48), STOP_S), free, free, np.ones(24), 8.0, 8.0)


def without_stops(seconds: float, task: LoadOrderingTask) -> float:
    """What is driven between the tracks: the stops that cannot be spared taken out."""
    return seconds - STOP_S * (math.ceil(float(task.need.sum()) / task.capacity) - 1)


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
