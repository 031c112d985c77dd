"""Cells: parts of the ground with swaths in a direction of their own, cut where swaths would be interrupted.

The cost of parallel swaths over a part follows from its edges alone. With s along and q across the swaths, a swath ends
on an edge every working width of the edge's extent in q; each end costs half a turn, and an oblique end half the edge's
extent in s, shared by the swaths that end there:

    cost = area / spacing + sum over edges (turn / (2 width) |dq| + |ds| / 2 min(1, |dq| / width))

The spacing is the width, or less so that a whole number of lines fits the extent in q. Cuts are straight lines through
reflex corners, along an edge that meets there or along the swaths, and across necks, from a reflex corner to the
nearest place of the outline that is much farther along the outline. They are made one after another, each time the one
that lowers the cost most, as long as it does so clearly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.polygon import orient
from shapely.ops import split

from fields.arrays import Floats, compute_angles
from fields.geometry.arithmetic import CURVE_M, EDGE_M, ROUNDING
from fields.geometry.overlays import intersect_on_grid, subtract_on_grid, unite_on_grid
from fields.layout.bearings import SIMPLIFY_M
from fields.layout.parallel_lines import TURN_COST_M, collect_edges, compute_axes

REFLEX_RAD = math.radians(20.0)  # beyond a straight angle; a smaller angle hardly interrupts swaths
CELL_COST_M = 40.0  # for every cell: the way to it and into its pattern
NECK_RATIO = 4.0  # a neck is so many times longer along the outline, either way, than across
MAX_NECK_EDGES = 4  # nearest edges beyond a corner that are tried
MIN_GAIN_SHARE = 0.003  # of the cost: a smaller gain is within the error of the estimate
MAX_CELLS = 8
MAX_CORNERS = 16  # of one part, the longest edges first
MIN_CELL_AREA = 6.0  # squared widths: no cell is smaller


@dataclass(frozen=True, eq=False)
class Cell:
    """A part of the region for swaths with parallel swaths.

    Attributes:
        number: 1 and up.
        bearing_rad: direction +u of its swaths as a mathematical angle, radians, in (-pi, pi].
        region: ground that its swaths have to cover; with a headland for turning only, the region of their centre
            lines. Cells do not overlap.
    """

    number: int
    bearing_rad: float
    region: shapely.Geometry

    @property
    def bearing_deg(self) -> float:
        """Direction of the swaths clockwise from north, degrees in [0, 180)."""
        return convert_to_compass_deg(self.bearing_rad)

    @property
    def area_m2(self) -> float:
        """Area of the region, square metres."""
        return float(self.region.area)


def convert_to_compass_deg(bearing_rad: float) -> float:
    """An undirected mathematical angle (radians) as a bearing clockwise from north, degrees in [0, 180)."""
    bearing = (90.0 - math.degrees(bearing_rad)) % 180.0
    return 0.0 if 180.0 - bearing < ROUNDING else bearing


@dataclass(frozen=True, eq=False)
class RegionPart:
    """A part of a region, the direction of its swaths (radians), and their cost as a driving length (m)."""

    region: shapely.Polygon
    bearing_rad: float
    cost_m: float


@dataclass(frozen=True)
class EffortRates:
    """What driving off work costs, in metres that could be worked meanwhile.

    Attributes:
        turns_m: turns over 1, 2 ... lines with ends side by side.
        cell_m: the way to another cell and into its pattern.
        offset: for every metre between ends that are not side by side.
    """

    turns_m: tuple[float, ...] = (TURN_COST_M,)
    cell_m: float = CELL_COST_M
    offset: float = 0.0

    @property
    def turn_m(self) -> float:
        """The cheapest turn."""
        return min(self.turns_m)


PLAIN_RATES = EffortRates()


def estimate_costs_m(
    region: shapely.Geometry, bearings: Floats, width_m: float, rates: EffortRates = PLAIN_RATES
) -> Floats:
    """Cost of swaths over a region for each bearing (k,), as a driving length in metres (k,)."""
    edges = collect_edges(region)
    turned = np.einsum("nij,kmj->knim", edges, np.array([compute_axes(bearing) for bearing in bearings]))
    ds, dq = np.abs(turned[:, :, 1] - turned[:, :, 0]).transpose(2, 0, 1)
    across = np.ptp(turned[..., 1], axis=(1, 2)) / width_m
    lines = np.maximum(np.ceil(across - CURVE_M / width_m), 1.0)
    slant_m = (1.0 + rates.offset) * ds * np.minimum(1.0, dq / width_m)
    ends = 0.5 * (rates.turn_m / width_m * dq + slant_m).sum(axis=1)
    cost: Floats = (region.area / width_m + ends) * np.maximum(lines / across, 1.0)
    return cost


def divide_region(
    region: shapely.Geometry, bearings: Floats, width_m: float, rates: EffortRates = PLAIN_RATES
) -> list[RegionPart]:
    """The region divided into parts, each with one of the bearings (k,), the largest first.

    All parts have the cheapest bearing for the whole unless another one clearly saves driving; touching parts have
    different bearings.
    """
    pieces = _collect_polygons(region)
    if not pieces:
        return []
    cost = np.array([estimate_costs_m(piece, bearings, width_m, rates) for piece in pieces])
    common = int(np.round(cost.sum(axis=0), 6).argmin())
    parts = [
        RegionPart(piece, float(bearings[common]), float(c[common])) for piece, c in zip(pieces, cost, strict=True)
    ]
    while len(parts) < MAX_CELLS:
        total = math.fsum(part.cost_m + rates.cell_m for part in parts)
        options = [
            (math.fsum(one.cost_m + rates.cell_m for one in new) - part.cost_m - rates.cell_m, index, new)
            for index, part in enumerate(parts)
            for new in (
                [_choose_bearing(part.region, bearings, width_m, rates)],
                *_list_cut_divisions(part, bearings, width_m, rates),
            )
        ]
        change, index, new = min(options, key=lambda option: round(option[0], 3))
        if change > -MIN_GAIN_SHARE * total:
            break
        parts[index : index + 1] = new
    return sorted(parts, key=lambda part: -round(part.region.area, 3))


def _choose_bearing(region: shapely.Polygon, bearings: Floats, width_m: float, rates: EffortRates) -> RegionPart:
    cost = np.round(estimate_costs_m(region, bearings, width_m, rates), 6)
    return RegionPart(region, float(bearings[cost.argmin()]), float(cost.min()))


def _list_cut_divisions(
    part: RegionPart, bearings: Floats, width_m: float, rates: EffortRates
) -> Iterator[list[RegionPart]]:
    """Every way to cut a part into two or more with different bearings."""
    for pieces in _list_cuts(part):
        if len(pieces) < 2 or min(piece.area for piece in pieces) < 1e-3 * width_m**2:
            continue
        cost = np.array([estimate_costs_m(piece, bearings, width_m, rates) for piece in pieces])
        own = np.round(cost, 6).argmin(axis=1)
        largest = int(np.argmax([round(piece.area, 3) for piece in pieces]))
        for common in sorted({int(own[largest]), int(np.argmin(np.abs(bearings - part.bearing_rad)))}):
            gain = cost[:, common] - cost[np.arange(len(pieces)), own]
            chosen = np.where(gain > rates.cell_m, own, common)
            if len(set(chosen.tolist())) > 1:
                regions = _join_pieces_by_bearing(pieces, bearings[chosen])
                if min(region.area for region, _ in regions) >= MIN_CELL_AREA * width_m**2:
                    yield [
                        RegionPart(r, b, float(estimate_costs_m(r, np.array([b]), width_m, rates)[0]))
                        for r, b in regions
                    ]


def _list_cuts(part: RegionPart) -> Iterator[list[shapely.Polygon]]:
    """The pieces left by every cut: through reflex corners along their edges and the swaths, and across necks."""
    along = compute_axes(part.bearing_rad)[0]
    for place, *edges in _find_reflex_corners(part.region):
        for direction in (*(edge / np.hypot(*edge) for edge in edges), along):
            yield _split_region(part.region, place, direction)
        far_side = _find_far_side(part.region, place)
        if far_side is not None:
            yield _split_across(part.region, place, far_side)


def _find_reflex_corners(region: shapely.Polygon) -> list[tuple[Floats, Floats, Floats]]:
    """Reflex corners with the edges before and after them, those with the longest edges first."""
    corners: list[tuple[float, int, Floats, Floats, Floats]] = []
    simplified = orient(region.simplify(SIMPLIFY_M), 1.0)
    for ring in (simplified.exterior, *simplified.interiors):
        points = np.asarray(ring.coords)[:-1, :2]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        turn = compute_angles(np.column_stack([(before * after).sum(axis=1), cross]))
        for k in np.flatnonzero(turn < -REFLEX_RAD).tolist():
            reach = float(np.hypot(*before[k]) + np.hypot(*after[k]))
            corners.append((-round(reach, 3), len(corners), points[k], before[k], after[k]))
    return [corner[2:] for corner in sorted(corners, key=lambda corner: corner[:2])[:MAX_CORNERS]]


def _find_far_side(region: shapely.Polygon, place: Floats) -> Floats | None:
    """The nearest point of the outline across a neck from a place on it; None if there is no neck."""
    ring = np.asarray(region.exterior.coords)[:, :2]
    start, step = ring[:-1], np.diff(ring, axis=0)
    length = np.hypot(*step.T)
    share = np.clip(((place - start) * step).sum(axis=1) / np.maximum(length, 1e-12) ** 2, 0.0, 1.0)
    nearest = start + share[:, None] * step
    distance = np.hypot(*(nearest - place).T)
    if distance.min() > 1e-6:
        return None  # the place is on a hole
    station = np.concatenate([[0.0], np.cumsum(length)])[:-1] + share * length
    way = np.abs(station - station[int(distance.argmin())])
    way = np.minimum(way, length.sum() - way)
    is_across = (way > NECK_RATIO * distance) & (distance > 1e-6)
    order = np.flatnonzero(is_across)[np.lexsort((way[is_across], np.round(distance[is_across], 3)))][:MAX_NECK_EDGES]
    ground = region.buffer(EDGE_M)
    return next((nearest[k] for k in order.tolist() if ground.covers(shapely.LineString([place, nearest[k]]))), None)


def _split_across(region: shapely.Polygon, place: Floats, far_side: Floats) -> list[shapely.Polygon]:
    """The polygons into which the segment between two places on the outline cuts a region."""
    beyond = EDGE_M * (far_side - place) / math.dist(place, far_side)
    return _collect_polygons(split(region, shapely.LineString([place - beyond, far_side + beyond])))


def _split_region(region: shapely.Polygon, place: Floats, direction: Floats) -> list[shapely.Polygon]:
    """The polygons into which a straight line cuts a region."""
    west, south, east, north = region.bounds
    reach_m = 2.0 * math.hypot(east - west, north - south) + 1.0
    aside = reach_m * np.array([-direction[1], direction[0]])
    a, b = place - reach_m * direction, place + reach_m * direction
    half = shapely.Polygon([a, b, b + aside, a + aside])
    sides = intersect_on_grid(region, half), subtract_on_grid(region, half)
    return [piece for side in sides for piece in _collect_polygons(side)]


def _join_pieces_by_bearing(pieces: list[shapely.Polygon], bearings: Floats) -> list[tuple[shapely.Polygon, float]]:
    """The pieces, with touching pieces of the same bearing joined."""
    return [
        (polygon, float(bearing))
        for bearing in sorted(set(bearings.tolist()))
        for polygon in _collect_polygons(
            unite_on_grid([p for p, b in zip(pieces, bearings, strict=True) if b == bearing])
        )
    ]


def _collect_polygons(region: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(region) if part.geom_type == "Polygon" and part.area > 0.0]
