"""Orders of tracks beside proven and bounded ones: python -m tests.benchmarks.orders

Table 1: n parallel tracks of equal length, a path through all of them, every turn an omega or a U in closed form: the
proven optimum (a circuit model in which every arc is allowed; stated to two decimals, for small machines to three)
beside what the planner's search finds and proves. Table 2: fleets on a field whose tracks are slanted and bent at their
ends, turns by Dubins: the bound is (work + (n - m) x cheapest turn) / m. Table 3: the tracks of table 1 worked in
loads, with ways along the lower headland to a depot on it after every load: one after another, the best that a circuit
model found (proven for 12 tracks), and what the planner's search finds. Table 4: 24 tracks in three loads, the order B*
of Bochtis, Sorensen and Green (Decision Support Systems, 2012, doi 10.1016/j.dss.2011.12.005) beside ours by the same
turns.
"""

from __future__ import annotations

import math
import time
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from strategies.path_planning.primitives import MAX_PIECES, MAX_PRIMITIVES, add_forward_primitives
from strategies.sequencing.order_proof import prove_tour
from strategies.sequencing.swath_order import build_skip_pattern
from strategies.sequencing.tour_search import UNREACHABLE_S, find_best_tour
from strategies.service_stops.load_search import LoadOrderingTask, order_in_loads, split_into_loads
from strategies.split_field import balance_borders, cut_balanced_blocks

Floats = npt.NDArray[np.float64]

PROVEN = (
    (10, 2.5, 1.7321, 64.98), (12, 3.0, 4.0, 165.35), (17, 3.0, 4.0, 231.28), (20, 3.0, 4.0, 271.99),
    (24, 9.0, 6.0, 577.68), (24, 9.0, 10.9, 942.40), (30, 3.0, 6.0, 579.65), (30, 6.0, 6.0, 564.00),
    (40, 4.5, 5.0, 754.89), (50, 3.0, 4.0, 679.09), (100, 3.0, 4.0, 1357.59),
)  # fmt: skip
SMALL = ((20, 0.9652, 1.9, 123.255), (44, 0.9652, 1.9, 269.905))
"""Many narrow swaths of a small machine: 4 turning radii are as wide as 8 of them."""
FLEETS = ((130, 3), (130, 5), (130, 10), (300, 3), (300, 5), (300, 10))
IN_LOADS = ((12, 4, 0.0, 575.80, 485.04), (24, 8, 103.5, 1001.54, 744.37))
"""Tracks, tracks per load, metres of the depot along the headland; one after another, and the best known."""
LOADS_WIDTH_M, LOADS_RADIUS_M = 9.0, 6.0
STOP_S = 1e4  # for a stop: as few loads as can be
B_STAR = (1, 3, 5, 7, 8, 6, 4, 2, 9, 11, 13, 15, 16, 14, 12, 10, 17, 19, 21, 23, 24, 22, 20, 18)
WORK_MPS, TURN_MPS, RADIUS_M, WIDTH_M = 1.4, 1.0, 4.0, 3.0


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


def starts_for(n: int, width: float, radius: float) -> list[list[int]]:
    """One after another, and the two smallest jumps whose turns are wide."""
    wide = math.ceil(2.0 * radius / width)
    return [list(range(n))] + [build_skip_pattern(n, jump) for jump in (wide, wide + 1) if 1 < jump < n]


def proven_rows() -> None:
    """Print table 1."""
    print(f"{'n':>4} {'w m':>5} {'R m':>7} {'proven':>9} {'ours':>9} {'above %':>8} {'own gap %':>10} {'CPU s':>6}")
    for n, width, radius, proven in (*PROVEN, *SMALL):
        turns, free = parallel(n, width, radius), np.zeros(2 * n)
        begun = time.process_time()
        best = prove_tour(find_best_tour(turns, free, free, starts_for(n, width, radius)))
        took = time.process_time() - begun
        above = 100.0 * (best.seconds / proven - 1.0)
        print(f"{n:4} {width:6.3f} {radius:7.4f} {proven:9.2f} {best.seconds:9.2f} {above:8.3f} {best.gap_pct:10.3f} "
              f"{took:6.2f}")  # fmt: skip


def slanted(n: int, per_swath_m: float = 0.75) -> tuple[Floats, Floats]:
    """Working seconds (n,) and turning seconds (2 n, 2 n) of n tracks whose ends are slanted and bent.

    In the west each track begins `per_swath_m` further on than the one before.
    """
    i = np.arange(n)
    west, east, north = per_swath_m * i, 252.0 + 0.225 * i + 30.0 * np.sin(i / 9.0), WIDTH_M * i
    out, kinds = np.empty((MAX_PRIMITIVES, MAX_PIECES, 3)), np.empty(MAX_PRIMITIVES, np.int64)
    turns = np.full((2 * n, 2 * n), UNREACHABLE_S)
    for a in range(n):
        for b in range(n):
            if a == b:
                continue
            ends = ((2 * a, 2 * b + 1, east, 0.0, math.pi), (2 * a + 1, 2 * b, west, math.pi, 0.0))
            for p, q, side, leaving, entering in ends:
                start, goal = np.array([side[a], north[a], leaving]), np.array([side[b], north[b], entering])
                add_forward_primitives(start, goal, RADIUS_M, out, kinds, 0)
                turns[p, q] = out[0, :, 0].sum() / TURN_MPS
    return (east - west) / WORK_MPS, turns


def fleet(work: Floats, turns: Floats, tractors: int) -> float:
    """Seconds until the last tractor is done, with blocks and the best orders inside them."""
    known: dict[tuple[int, int], float] = {}

    def cost(first: int, last: int) -> float:
        if (first, last) not in known:
            part = turns[2 * first : 2 * last, 2 * first : 2 * last]
            free = np.zeros(2 * (last - first))
            order = find_best_tour(part, free, free, starts_for(last - first, WIDTH_M, RADIUS_M))
            known[first, last] = float(work[first:last].sum()) + order.seconds
        return known[first, last]

    turn_s = float(turns.min())
    borders = balance_borders(cut_balanced_blocks((work + turn_s).tolist(), tractors), cost)
    return max(cost(first, last) for first, last in pairwise(borders))


def fleet_rows() -> None:
    """Print table 2."""
    print(f"\n{'n':>4} {'tractors':>8} {'bound s':>8} {'ours s':>8} {'ours / bound':>12} {'CPU s':>6}")
    for n, tractors in FLEETS:
        work, turns = slanted(n)
        bound = (float(work.sum()) + (n - tractors) * float(turns.min())) / tractors
        begun = time.process_time()
        ours = fleet(work, turns, tractors)
        took = time.process_time() - begun
        print(f"{n:4} {tractors:8} {bound:8.0f} {ours:8.0f} {ours / bound:12.4f} {took:6.2f}")


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


def loads_rows() -> None:
    """Print tables 3 and 4."""
    print(f"\n{'n':>4} {'load':>5} {'depot m':>8} {'in a row':>9} {'stated':>9} {'best known':>10} {'ours':>9} "
          f"{'above %':>8} {'CPU s':>6}")  # fmt: skip
    for n, load, depot_m, stated, known in IN_LOADS:
        task, row = from_depot(n, load, depot_m), np.arange(n)
        begun = time.process_time()
        ours = without_stops(order_in_loads(task, starts_for(n, LOADS_WIDTH_M, LOADS_RADIUS_M)).seconds, task)
        took = time.process_time() - begun
        in_a_row = without_stops(split_into_loads(row, task).seconds, task)
        print(f"{n:4} {load:5} {depot_m:8.1f} {in_a_row:9.2f} {stated:9.2f} {known:10.2f} {ours:9.2f} "
              f"{100.0 * (ours / known - 1.0):8.3f} {took:6.2f}")  # fmt: skip
    print(f"\n{'n':>4} {'R m':>7} {'B*':>9} {'ours':>9} {'below %':>8}")
    for radius in (LOADS_RADIUS_M, 10.9):
        task = turned_only(radius)
        printed = without_stops(split_into_loads(np.array(B_STAR) - 1, task).seconds, task)
        ours = without_stops(order_in_loads(task, starts_for(24, LOADS_WIDTH_M, radius)).seconds, task)
        print(f"{24:4} {radius:7.1f} {printed:9.2f} {ours:9.2f} {100.0 * (1.0 - ours / printed):8.2f}")


if __name__ == "__main__":
    warm = np.zeros(10)
    prove_tour(find_best_tour(parallel(5, 3.0, 4.0), warm, warm, [list(range(5))]))
    proven_rows()
    fleet_rows()
    loads_rows()
