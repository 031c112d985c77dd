"""Deals by which tractors meet as little as can be: stretches of the headland, runs of swaths."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Flags, Floats
from strategies.lines.work_line import WorkLine
from strategies.rules.dealing import cut_balanced_blocks, group_swath_lines
from vehicle.missions.plan import HEADLAND_PASS, SWATH

Tours = Sequence[Sequence[int]]
SketchTours = Callable[[Flags], Tours]
"""Sketches tours by a deal of lines."""


def list_deals_apart(
    lines: Sequence[WorkLine], allowed: Flags, sketch_tours: SketchTours, places: Floats | None = None
) -> list[Flags]:
    """Deals (tractors, lines) after one in which several may work the same, where they meet less and less.

    First headland is dealt in stretches, by the `places` (tractors, 2) where tractors stand, then the swaths that
    several may work are dealt too, in runs near those of tours by that.
    """
    sides = deal_sides(lines, allowed, places)
    deals = [allowed, sides, deal_runs(lines, sides, sketch_tours(sides))]
    return [deal for before, deal in pairwise(deals) if not np.array_equal(before, deal)]


def deal_sides(lines: Sequence[WorkLine], allowed: Flags, places: Floats | None = None) -> Flags:
    """The deal in which every side of the headland is one tractor's in all passes.

    The ring along the edge is cut into stretches, equal by length, and rings round obstacles are whole; each is the
    tractor's that is near, by the `places` (tractors, 2) where they stand, else by their swaths. Where the ring has
    fewer sides than there are tractors, or one of them neither place nor swaths, its sides are as dealt before.
    """
    rings = list_rings(lines)
    is_placed = places is not None or all(_list_swaths(lines, own) for own in allowed)
    if not (is_placed and rings and len(rings[0]) >= len(allowed)):
        return allowed
    return _deal_rings(lines, allowed, rings, find_swath_middles(lines, allowed) if places is None else places)


def deal_tours(allowed: Flags, tours: Tours) -> Flags:
    """The deal in which every line of some tours is that tractor's alone."""
    dealt = allowed.copy()
    for tractor, tour in enumerate(tours):
        numbers = [node // 2 for node in tour]
        dealt[:, numbers], dealt[tractor, numbers] = False, True
    return dealt


def deal_runs(lines: Sequence[WorkLine], allowed: Flags, tours: Tours) -> Flags:
    """The deal in which the swaths of each tractor are a run of neighbours, as long as those of its tour.

    Tractors come along the swaths in the order of the middles of their own. Swaths stay as dealt where one of them may
    not have such a run.
    """
    runs = group_swath_lines(lines)
    worked_by = {node // 2: tractor for tractor, tour in enumerate(tours) for node in tour}
    own_m = np.zeros((len(runs), len(allowed)))
    for place, run in enumerate(runs):
        for number in set(run) & set(worked_by):
            own_m[place, worked_by[number]] += lines[number].length_m
    middles = (own_m * np.arange(len(runs))[:, None]).sum(axis=0) / np.maximum(own_m.sum(axis=0), 1e-9)
    order = np.argsort(middles, kind="stable")
    swaths_m, borders_m = own_m.sum(axis=1), np.cumsum(own_m.sum(axis=0)[order])
    places_m = np.cumsum(swaths_m) - 0.5 * swaths_m
    owners = order[np.searchsorted(np.round(borders_m[:-1], 3), np.round(places_m, 3))]
    dealt = allowed.copy()
    for run, owner in zip(runs, owners, strict=True):
        if not allowed[owner, run].all():
            return allowed
        dealt[:, run], dealt[owner, run] = False, True
    return dealt


def list_rings(lines: Sequence[WorkLine]) -> list[list[list[int]]]:
    """Rings of the headland, the longest first: the sides of the outermost pass in order, each with the lines beside it
    in all passes."""
    headland = [number for number, line in enumerate(lines) if line.task.kind == HEADLAND_PASS]
    outermost = min((lines[number].task.number or 0 for number in headland), default=0)
    first = [number for number in headland if lines[number].task.number == outermost]
    sides: dict[int, list[int]] = {number: [] for number in first}
    tree = shapely.STRtree([shapely.LineString(lines[number].paths[0]) for number in first])
    for number in headland if first else ():
        x_m, y_m, _ = lines[number].get_pose(0, 0.5 * lines[number].measure_path_m(0))
        beside = first[int(tree.nearest(shapely.Point(x_m, y_m)))]
        sides[number if number in sides else beside].append(number)  # pieces of a side may lie on one another
    rings: dict[tuple[str, int], list[list[int]]] = {}
    for number in first:
        rings.setdefault(lines[number].group, []).append(sides[number])
    return sorted(rings.values(), key=lambda ring: -sum(_measure_sides_m(lines, ring)))


def find_swath_middles(lines: Sequence[WorkLine], blocks: Flags) -> Floats:
    """The middle (tractors, 2) of the swaths of each tractor."""
    return np.array([_find_middle([lines[number] for number in _list_swaths(lines, own)]) for own in blocks])


def find_near_blocks(middles: Floats, places: Floats) -> npt.NDArray[np.intp]:
    """For each tractor at a place (tractors, 2) the number of its block by the middles (n, 2), near for all."""
    from scipy.optimize import linear_sum_assignment

    gaps_m = np.hypot(*(places[:, None] - middles[None]).transpose(2, 0, 1))
    blocks: npt.NDArray[np.intp] = linear_sum_assignment(gaps_m)[1]
    return blocks


def _deal_rings(lines: Sequence[WorkLine], allowed: Flags, rings: list[list[list[int]]], homes: Floats) -> Flags:
    """The deal with rings of the headland in stretches or whole, near the homes (tractors, 2)."""
    dealt = allowed.copy()
    dealt[:, [number for ring in rings for side in ring for number in side]] = False
    for tractor, numbers in enumerate(_cut_ring(lines, rings[0], homes)):
        dealt[tractor, numbers] = True
    for ring in rings[1:]:
        numbers = [number for side in ring for number in side]
        gaps_m = np.hypot(*(homes - _find_middle([lines[number] for number in numbers])).T)
        dealt[int(np.argmin(gaps_m)), numbers] = True
    return dealt


def _list_swaths(lines: Sequence[WorkLine], own: Flags) -> list[int]:
    return [number for number, line in enumerate(lines) if own[number] and line.task.kind == SWATH]


def _find_middle(lines: Sequence[WorkLine]) -> Floats:
    """The middle (2,) of lines by length."""
    middles = [line.paths[0][[0, -1]].mean(axis=0) for line in lines]
    return np.average(middles, axis=0, weights=[line.length_m for line in lines])


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
        side_groups = [[number for side in turned[low:high] for number in side] for low, high in spans]
        middles = np.array([_find_middle([lines[number] for number in numbers]) for numbers in side_groups])
        numbers = find_near_blocks(middles, homes)
        gaps_m = np.hypot(*(homes - middles[numbers]).T)
        cost_m = float(gaps_m.sum()) + max(sum(lengths_m[low:high]) for low, high in spans)
        if cost_m < best_m:
            best, best_m = [side_groups[number] for number in numbers], cost_m
    return best
