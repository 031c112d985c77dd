"""A region for tracks cut where tracks would be interrupted, each part with the direction that suits it best.

What parallel tracks over a part cost can be told from its edges alone. With s along and q across the tracks, tracks end
on an edge every width of its extent in q; there half a turn is due, and a swath that ends aslant is driven on for half
of the edge's extent in s, shared by the swaths that end there:

    cost = area / spacing + sum over edges (turn / (2 width) |dq| + |ds| / 2 min(1, |dq| / width))

where the spacing is the width, or what is left of it when a whole number of lines shares the extent in q. Cuts are
straight lines through reflex corners, along an edge that meets there or along the tracks; one after another, that
which lowers the cost most, while it does so clearly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from fields.lines import SPAN_TOLERANCE_M, TURN_M, axes, region_edges

FloatArray = npt.NDArray[np.float64]

REFLEX_RAD = math.radians(20.0)  # beyond a straight angle: less interrupts no track worth telling
CELL_M = 40.0  # for every cell: the way to it and back into a pattern
GAIN = 0.003  # of the cost: a cut that saves less may as well cost
MOST_CELLS = 8
MOST_CORNERS = 16  # of one part, the longest edges first
SIMPLIFY_M = 1.0
LEAST_AREA = 6.0  # squared widths: no cell is smaller
GRID_M = 1e-6
TOUCHING_M = 1e-3


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a region, the direction of its tracks (radians), and what they cost as a driving length (m)."""

    region: shapely.Polygon
    bearing_rad: float
    cost_m: float


def costs_m(region: shapely.Geometry, bearings: FloatArray, width_m: float) -> FloatArray:
    """What tracks over a region cost in each of some directions (k,), as a driving length in metres."""
    edges = region_edges(region)
    turned = np.einsum("nij,kmj->knim", edges, np.array([axes(bearing) for bearing in bearings]))
    ds, dq = np.abs(turned[:, :, 1] - turned[:, :, 0]).transpose(2, 0, 1)
    across = np.ptp(turned[..., 1], axis=(1, 2)) / width_m
    lines = np.maximum(np.ceil(across - SPAN_TOLERANCE_M / width_m), 1.0)
    ends = 0.5 * (TURN_M / width_m * dq + ds * np.minimum(1.0, dq / width_m)).sum(axis=1)
    cost: FloatArray = (region.area / width_m + ends) * np.maximum(lines / across, 1.0)
    return cost


def divided(region: shapely.Geometry, bearings: FloatArray, width_m: float) -> list[Part]:
    """The region in parts, each with one of the bearings (k,), the largest first.

    All have that which is cheapest for the whole where nothing is saved clearly by others; parts that touch have
    different ones.
    """
    pieces = _polygons(region)
    if not pieces:
        return []
    cost = np.array([costs_m(piece, bearings, width_m) for piece in pieces])
    common = int(np.round(cost.sum(axis=0), 6).argmin())
    parts = [Part(piece, float(bearings[common]), float(c[common])) for piece, c in zip(pieces, cost, strict=True)]
    while len(parts) < MOST_CELLS:
        total = math.fsum(part.cost_m + CELL_M for part in parts)
        options = [
            (math.fsum(one.cost_m + CELL_M for one in new) - part.cost_m - CELL_M, index, new)
            for index, part in enumerate(parts)
            for new in ([_best(part.region, bearings, width_m)], *_cut(part, bearings, width_m))
        ]
        change, index, new = min(options, key=lambda option: round(option[0], 3))
        if change > -GAIN * total:
            break
        parts[index : index + 1] = new
    return sorted(parts, key=lambda part: -round(part.region.area, 3))


def _best(region: shapely.Polygon, bearings: FloatArray, width_m: float) -> Part:
    cost = np.round(costs_m(region, bearings, width_m), 6)
    return Part(region, float(bearings[cost.argmin()]), float(cost.min()))


def _cut(part: Part, bearings: FloatArray, width_m: float) -> Iterator[list[Part]]:
    """Every way to cut a part in two or more with different bearings."""
    for place, direction in _cuts(part):
        pieces = _pieces(part.region, place, direction)
        if len(pieces) < 2 or min(piece.area for piece in pieces) < 1e-3 * width_m**2:
            continue
        cost = np.array([costs_m(piece, bearings, width_m) for piece in pieces])
        own = np.round(cost, 6).argmin(axis=1)
        largest = int(np.argmax([round(piece.area, 3) for piece in pieces]))
        for common in sorted({int(own[largest]), int(np.argmin(np.abs(bearings - part.bearing_rad)))}):
            gain = cost[:, common] - cost[np.arange(len(pieces)), own]
            chosen = np.where(gain > CELL_M, own, common)
            if len(set(chosen.tolist())) > 1:
                joined = _joined(pieces, bearings[chosen])
                if min(region.area for region, _ in joined) >= LEAST_AREA * width_m**2:
                    yield [Part(r, b, float(costs_m(r, np.array([b]), width_m)[0])) for r, b in joined]


def _cuts(part: Part) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places and directions of cuts: through reflex corners along the edges that meet there and along the tracks."""
    along = axes(part.bearing_rad)[0]
    corners: list[tuple[float, int, FloatArray, FloatArray, FloatArray]] = []
    plain = orient(part.region.simplify(SIMPLIFY_M), 1.0)
    for ring in (plain.exterior, *plain.interiors):
        points = np.asarray(ring.coords)[:-1, :2]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        turn = np.arctan2(cross, (before * after).sum(axis=1))
        for k in np.flatnonzero(turn < -REFLEX_RAD).tolist():
            reach = float(np.hypot(*before[k]) + np.hypot(*after[k]))
            corners.append((-round(reach, 3), len(corners), points[k], before[k], after[k]))
    for _, _, place, *edges in sorted(corners, key=lambda corner: corner[:2])[:MOST_CORNERS]:
        for edge in edges:
            yield place, edge / np.hypot(*edge)
        yield place, along


def _pieces(region: shapely.Polygon, place: FloatArray, direction: FloatArray) -> list[shapely.Polygon]:
    """The polygons into which a straight line cuts a region."""
    west, south, east, north = region.bounds
    far = 2.0 * math.hypot(east - west, north - south) + 1.0
    aside = far * np.array([-direction[1], direction[0]])
    a, b = place - far * direction, place + far * direction
    half = shapely.Polygon([a, b, b + aside, a + aside])
    sides = shapely.intersection(region, half, grid_size=GRID_M), shapely.difference(region, half, grid_size=GRID_M)
    return [piece for side in sides for piece in _polygons(side)]


def _joined(pieces: list[shapely.Polygon], bearings: FloatArray) -> list[tuple[shapely.Polygon, float]]:
    """Pieces that touch and have one bearing made one."""
    return [
        (polygon, float(bearing))
        for bearing in sorted(set(bearings.tolist()))
        for polygon in _polygons(
            shapely.union_all([p for p, b in zip(pieces, bearings, strict=True) if b == bearing], grid_size=GRID_M)
        )
    ]


def _polygons(region: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(region) if part.geom_type == "Polygon" and part.area > 0.0]
