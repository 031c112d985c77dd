"""A deal by which tractors meet as little as can be: a block of swaths and a stretch of the headland for each."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import linear_sum_assignment

from strategies.lines.work_line import WorkLine
from strategies.program.dealing import cut_balanced_blocks
from vehicle.missions.plan import HEADLAND_PASS, SWATH

Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]


def deal_apart(lines: Sequence[WorkLine], allowed: Bools) -> Bools:
    """A deal (tractors, lines) in which no line is for two tractors, of one in which some are.

    Swaths that several may work are cut into a run for each. Of the headland every side is one tractor's in all passes:
    the ring along the edge is cut into stretches, equal by length, and rings round obstacles are whole; each is the
    tractor's whose swaths are near. Where the ring has fewer sides than there are tractors, its sides are for all.
    """
    dealt = _part_swaths(lines, allowed)
    rings = _list_rings(lines)
    if not rings or len(rings[0]) < len(allowed):
        return dealt
    homes = np.array([_find_middle([lines[number] for number in _list_swaths(lines, own)]) for own in dealt])
    dealt[:, [number for ring in rings for side in ring for number in side]] = False
    for tractor, numbers in enumerate(_cut_ring(lines, rings[0], homes)):
        dealt[tractor, numbers] = True
    for ring in rings[1:]:
        numbers = [number for side in ring for number in side]
        gaps_m = np.hypot(*(homes - _find_middle([lines[number] for number in numbers])).T)
        dealt[int(np.argmin(gaps_m)), numbers] = True
    return dealt


def _part_swaths(lines: Sequence[WorkLine], allowed: Bools) -> Bools:
    """The deal with what several tractors may work of the swaths in runs of neighbours, one for each of them."""
    shared: dict[tuple[int, ...], dict[int, list[int]]] = {}
    for number, line in enumerate(lines):
        if line.task.kind == SWATH:
            owners = tuple(np.flatnonzero(allowed[:, number]).tolist())
            shared.setdefault(owners, {}).setdefault(line.task.number or 0, []).append(number)
    dealt = allowed.copy()
    for owners, swaths in shared.items():
        runs = [swaths[swath] for swath in sorted(swaths)]
        if not 1 < len(owners) <= len(runs):
            continue
        weights = [sum(lines[number].length_m for number in run) for run in runs]
        for owner, (low, high) in zip(owners, pairwise(cut_balanced_blocks(weights, len(owners))), strict=True):
            numbers = [number for run in runs[low:high] for number in run]
            dealt[:, numbers] = False
            dealt[owner, numbers] = True
    return dealt


def _list_swaths(lines: Sequence[WorkLine], own: Bools) -> list[int]:
    return [number for number, line in enumerate(lines) if own[number] and line.task.kind == SWATH]


def _find_middle(lines: Sequence[WorkLine]) -> Floats:
    """The middle (2,) of lines by length."""
    middles = [line.paths[0][[0, -1]].mean(axis=0) for line in lines]
    return np.average(middles, axis=0, weights=[line.length_m for line in lines])


def _list_rings(lines: Sequence[WorkLine]) -> list[list[list[int]]]:
    """Rings of the headland, the longest first: their sides in order, each with the lines beside it in all passes."""
    headland = [number for number, line in enumerate(lines) if line.task.kind == HEADLAND_PASS]
    first = [number for number in headland if lines[number].task.number == 1]
    sides: dict[int, list[int]] = {number: [] for number in first}
    tree = shapely.STRtree([shapely.LineString(lines[number].paths[0]) for number in first])
    for number in headland if first else ():
        x_m, y_m, _ = lines[number].get_pose(0, 0.5 * lines[number].measure_path_m(0))
        sides[first[int(tree.nearest(shapely.Point(x_m, y_m)))]].append(number)
    rings: dict[tuple[str, int], list[list[int]]] = {}
    for number in first:
        rings.setdefault(lines[number].group, []).append(sides[number])
    return sorted(rings.values(), key=lambda ring: -sum(_measure_sides_m(lines, ring)))


def _measure_sides_m(lines: Sequence[WorkLine], ring: Sequence[Sequence[int]]) -> list[float]:
    return [sum(lines[number].length_m for number in side) for side in ring]


def _cut_ring(lines: Sequence[WorkLine], ring: list[list[int]], homes: Floats) -> list[list[int]]:
    """For each tractor the lines of its stretch of a ring, cut where the longest is short and all are near home."""
    best: list[list[int]] = []
    best_m = np.inf
    for begin in range(len(ring)):
        turned = ring[begin:] + ring[:begin]
        lengths_m = _measure_sides_m(lines, turned)
        spans = list(pairwise(cut_balanced_blocks(lengths_m, len(homes))))
        stretches = [[number for side in turned[low:high] for number in side] for low, high in spans]
        middles = np.array([_find_middle([lines[number] for number in numbers]) for numbers in stretches])
        gaps_m = np.hypot(*(homes[:, None] - middles[None]).transpose(2, 0, 1))
        tractors, numbers = linear_sum_assignment(gaps_m)
        cost_m = float(gaps_m[tractors, numbers].sum()) + max(sum(lengths_m[low:high]) for low, high in spans)
        if cost_m < best_m:
            best, best_m = [stretches[number] for number in numbers], cost_m
    return best
