"""Orders of tracks in loads that are known, and their problems.

Parallel tracks of equal length are worked in loads, with ways along the lower headland to a depot on it after every
load, and every turn an omega or a U in closed form. IN_LOADS has the best that a circuit model found (proven for 12
tracks), B_STAR the order of Bochtis, Sorensen and Green (Decision Support Systems, 2012, doi
10.1016/j.dss.2011.12.005) for 24 tracks in three loads.
"""

import math

import numpy as np
import numpy.typing as npt

from strategies.service_stops.load_search import UNREACHABLE_S, LoadOrderingTask

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
