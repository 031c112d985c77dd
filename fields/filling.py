"""Parallel pieces that cover a region whole: a swath that meets any of it is driven as far as it does."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

from fields.lines import Comb, CombRules, axes, positions, region_edges

FloatArray = npt.NDArray[np.float64]

LEAST_AREA = 0.25  # squared widths: what less is open is not worth a turn
SPECK = 0.02  # of the width: parts of a swath joined by less than this are apart
GRID_M = 1e-6


def filled(region: shapely.Geometry, bearing_rad: float, rules: CombRules) -> Comb | None:
    """Pieces over a region (in metres), in track coordinates; None where it is nowhere worth one.

    Every piece begins and ends where its swath does, also at slanted edges, and is at least `rules.shortest_m` long:
    a shorter one reaches over what it covers at both ends. Lines keep `rules.apart_m`, so that the swaths of the outer
    ones may reach beyond the region, by less than half a width. `rules.trim_m` is not used. The cost is the length
    driven and nothing for what is left, as nothing is.
    """
    frame = axes(bearing_rad)
    turned = shapely.transform(region, lambda points: points @ frame.T)
    edges = region_edges(turned)
    if not len(edges):
        return None
    half = 0.5 * rules.width_m
    low, high = float(edges[..., 1].min()) + half, float(edges[..., 1].max()) - half
    if high < low:
        low = high = 0.5 * (low + high)
    q = _apart(positions(low, high, rules.width_m), min(rules.apart_m, rules.width_m))
    west, _, east, _ = turned.bounds
    swaths = shapely.intersection(shapely.box(west - 1.0, q - half, east + 1.0, q + half), turned, grid_size=GRID_M)
    line: list[int] = []
    ends: list[tuple[float, float]] = []
    for number, swath in enumerate(swaths):
        for first, last in _spans(swath, rules):
            line.append(number)
            ends.append((first, last))
    if not line:
        return None
    s = np.array(ends)
    cost = float((s[:, 1] - s[:, 0]).sum())
    return Comb(q, np.array(line, dtype=np.int64), s[:, 0], s[:, 1], cost)


def _apart(q: FloatArray, least_m: float) -> FloatArray:
    """Evenly spaced lines no nearer to each other than so much: what they then overlap, the outer ones do outside."""
    if len(q) < 2 or q[1] - q[0] >= least_m:
        return q
    spread: FloatArray = 0.5 * (q[0] + q[-1]) + least_m * (np.arange(len(q)) - 0.5 * (len(q) - 1))
    return spread


def _spans(swath: shapely.Geometry, rules: CombRules) -> list[tuple[float, float]]:
    """Where a swath meets the region, from west to east; spans that touch are one."""
    speck = 0.5 * SPECK * rules.width_m
    solid = shapely.buffer(shapely.buffer(swath, -speck, join_style="mitre"), speck, join_style="mitre")
    spans: list[tuple[float, float]] = []
    parts = [part for part in shapely.get_parts(solid) if part.area >= LEAST_AREA * rules.width_m**2]
    for first, last in sorted((part.bounds[0], part.bounds[2]) for part in parts):
        short = max(rules.shortest_m - (last - first), 0.0)
        first, last = first - 0.5 * short, last + 0.5 * short
        if spans and first <= spans[-1][1]:
            before = spans.pop()
            first, last = before[0], max(last, before[1])
        spans.append((first, last))
    return spans
