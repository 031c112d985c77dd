"""Loads as tours of the search for programmes, against known answers.

Parallel tracks of equal length are worked in loads, with ways along the lower headland to a depot on it after every
load, and every turn an omega or a U in closed form. IN_LOADS has the best that a circuit model found (proven for 12
tracks), B_STAR the order of Bochtis, Sorensen and Green (Decision Support Systems, 2012, doi
10.1016/j.dss.2011.12.005) for 24 tracks in three loads.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from fields.arrays import Floats
from strategies.programmes.order_search import OrderProblem, compute_cost_s, search_programmes

IN_LOADS = ((12, 4, 0.0, 575.80, 485.04), (24, 8, 103.5, 1001.54, 744.37))
"""Tracks, tracks per load, metres of the depot along the headland; one after another, and the best known."""
LOADS_WIDTH_M, LOADS_RADIUS_M = 9.0, 6.0
LINE_VALUE_S = 1e4
B_STAR = (1, 3, 5, 7, 8, 6, 4, 2, 9, 11, 13, 15, 16, 14, 12, 10, 17, 19, 21, 23, 24, 22, 20, 18)


def measure_turn_m(spacing: float, radius: float) -> float:
    """Length of the omega or the U over a spacing."""
    if spacing < 2.0 * radius:
        return radius * (math.pi + 4.0 * math.acos((0.5 * spacing + radius) / (2.0 * radius)))
    return math.pi * radius + spacing - 2.0 * radius


def tabulate_turns(n: int, width: float, radius: float) -> Floats:
    """Turns between the nodes of n equal tracks (2 n, 2 n)."""
    turns = np.full((2 * n, 2 * n), np.inf)
    for i, j in zip(*np.nonzero(~np.eye(n, dtype=bool)), strict=True):
        turns[2 * i, 2 * j + 1] = turns[2 * i + 1, 2 * j] = measure_turn_m(abs(int(i) - int(j)) * width, radius)
    return turns


def pose_loads(turns: Floats, load: int, begin_s: Floats, end_s: Floats) -> OrderProblem:
    """Tracks in as few loads as can be, each with ways to its first and from its last (metres for seconds)."""
    n = len(turns) // 2
    count = math.ceil(n / load)
    return OrderProblem(
        move_s=turns,
        work_s=np.zeros(n),
        value_s=np.full(n, LINE_VALUE_S),
        begin_s=np.repeat(begin_s[None], count, axis=0),
        end_s=np.repeat(end_s[None], count, axis=0),
        allowed=np.ones((count, n), bool),
        stage=np.zeros(n, np.int64),
        need=np.full(n, 1.0 / load),
        sum_share=1.0,
    )


def pose_from_depot(n: int, load: int, depot_m: float) -> OrderProblem:
    """n parallel tracks; every load begins and ends at a depot on the lower headland."""
    along = np.abs(LOADS_WIDTH_M * np.arange(n) - depot_m)
    begin_s, end_s = np.full(2 * n, np.inf), np.full(2 * n, np.inf)
    begin_s[0::2], end_s[1::2] = along, along
    return pose_loads(tabulate_turns(n, LOADS_WIDTH_M, LOADS_RADIUS_M), load, begin_s, end_s)


def cut_row(order: list[int], load: int) -> list[list[int]]:
    """Tracks in this order, up and down in turn, in full loads."""
    nodes = [2 * track + place % load % 2 for place, track in enumerate(order)]
    return [nodes[first : first + load] for first in range(0, len(nodes), load)]


@pytest.mark.parametrize(("n", "load", "depot_m", "in_a_row", "known"), IN_LOADS)
def test_known_answers_from_a_depot(n: int, load: int, depot_m: float, in_a_row: float, known: float) -> None:
    """Full loads leave no room to move a track, so a single search may end 5 % above the best known."""
    problem = pose_from_depot(n, load, depot_m)
    start = cut_row(list(range(n)), load)
    assert compute_cost_s(problem, start) == pytest.approx(in_a_row, abs=0.005)
    costs = []
    for seed in range(1, 7):
        found = search_programmes(problem, 10 * problem.kicks, seed, start)
        assert [len(tour) for tour in found] == [load] * (n // load)
        costs.append(compute_cost_s(problem, found))
    assert max(costs) <= known * 1.05
    assert min(costs) <= known * 1.005
    if n == 12:
        assert min(costs) >= known - 0.02, "proven: nothing is below but rounding"


@pytest.mark.parametrize("radius", [6.0, 10.9])
def test_an_order_in_loads_is_never_dearer_than_the_printed_one(radius: float) -> None:
    problem = pose_loads(tabulate_turns(24, LOADS_WIDTH_M, radius), 8, np.zeros(48), np.zeros(48))
    printed = cut_row([track - 1 for track in B_STAR], 8)
    found = search_programmes(problem, problem.kicks, 1, cut_row(list(range(24)), 8))
    assert compute_cost_s(problem, found) <= compute_cost_s(problem, printed)


def test_a_tour_that_takes_more_than_a_load_is_split() -> None:
    problem = pose_from_depot(4, 2, 0.0)
    assert sorted(map(len, search_programmes(problem, problem.kicks, 1, [[0, 3, 4, 7], []]))) == [2, 2]


def test_a_line_that_no_load_has_room_for_is_left() -> None:
    problem = pose_loads(tabulate_turns(4, LOADS_WIDTH_M, LOADS_RADIUS_M), 2, np.zeros(8), np.zeros(8))
    first = {name: getattr(problem, name)[:1] for name in ("begin_s", "end_s", "allowed")}
    one = replace(problem, **first)
    assert [len(tour) for tour in search_programmes(one, one.kicks, 1)] == [2]
