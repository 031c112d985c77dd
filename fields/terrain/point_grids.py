"""A grid of heights from scattered points: local quadratic surfaces with Gaussian weights of a stated length.

Around every node the surface a + b x + c y + d x2 + e x y + f y2 is fitted to the points with weights
exp(-r2 / (2 L2)); a is the height. L grows with the distance between passes, so that several of them count, and is at
least MIN_LENGTH_M, over which the centimetres of RTK average out: with 2 cm for each point and 3 cm for each pass, 3 m
apart, slopes are good to half a percent. Planes come out exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely

from fields.arrays import Flags, Floats, Integers
from fields.terrain.checks import MAX_SLOPE, check_height_range, describe_spikes
from fields.terrain.elevation_grid import ElevationError, ElevationGrid, NodeFrame, fill_gaps, lay_nodes

MIN_LENGTH_M = 5.0
LENGTH_PER_PASS_SPACING = 0.75
MAX_PASS_SPACING_M = 60.0
DISTANCES_PER_PASS_SPACING = 4.0
"""Places between passes are on average (median) a quarter of their spacing from the nearest point."""
NODES_PER_LENGTH = 1.5
MIN_NODE_SPACING_M, MAX_NODE_SPACING_M = 2.0, 10.0
MAX_WIDENING = 2.0
"""Largest factor by which nodes may be wider apart because there were too many."""
CELLS_PER_LENGTH, MAX_NEIGHBOURS = 2.0, 96
"""Points are averaged over cells of L / 2 first; so many of these are within 2.7 L of a node."""
MAX_DISTANCE_LENGTHS = 1.2
"""Nodes farther from the nearest point, in lengths L, count as gaps."""
CURVATURE_RIDGE, MIN_SPREAD = 0.01, 0.02
"""Share of the weight that holds curvatures near 0 where points lie to one side; and smallest eigenvalue of the second
moments of points (in L) for a slope: on a single pass nothing says the slope across."""
MIN_SPIKE_M, SPIKE_NEIGHBOURS = 2.0, 9
CHUNK_NODES = 10_000
TRACK_CELL_M = 5.0
"""Tracks are compared in square cells of this size: half a pass wide, and slopes change little within."""
MIN_SHARED_CELLS = 5
ANCHOR_WEIGHT = 1e-6
"""Pull of all offsets to 0; it only sets the mean of tracks that are levelled to each other."""


def build_point_grid(
    points: Floats,
    heights_m: Floats,
    region: shapely.Geometry,
    margin_m: float,
    label: str,
    name_place: Callable[[float, float], str],
) -> ElevationGrid:
    """The surface through points (n, 2) over a region and a margin round it, without spikes.

    Messages call the source of the heights `label`, and a place in metres what `name_place` says. Raises ElevationError
    where the heights are of no farmland, too far apart or full of spikes.
    """
    check_height_range(heights_m, label)
    length_m = choose_length_m(points, region, label)
    is_spike, deviations = find_spikes(points, heights_m, length_m)
    spikes = points[is_spike]
    remarks = describe_spikes(
        deviations[is_spike], lambda number: name_place(*spikes[number].tolist()), len(heights_m), label
    )
    grid, scatter_m = fit_surface(points[~is_spike], heights_m[~is_spike], region, length_m, margin_m)
    source = (
        f"{len(heights_m) - len(spikes)} points of {label}, smoothed over {length_m:.3g} m (Gaussian), on a grid of "
        f"{grid.spacing_m:.3g} m; points scatter {100.0 * scatter_m:.2g} cm about it"
    )
    return replace(grid, source=source, remarks=tuple(remarks))


def choose_length_m(points: Floats, region: shapely.Geometry, label: str) -> float:
    """L for points (n, 2) over a region.

    Raises ElevationError where the points are too far apart to say the slopes of a field.
    """
    from scipy.spatial import cKDTree

    frame = lay_nodes(region, 2.0, 0.0)
    inside = frame.find_inside(region).ravel()
    places = frame.list_places()[inside] if inside.any() else shapely.get_coordinates(region.representative_point())
    distances, _ = cKDTree(points).query(places)
    spacing_m = DISTANCES_PER_PASS_SPACING * float(np.median(distances))
    if spacing_m > MAX_PASS_SPACING_M:
        raise ElevationError(
            f"Half of the field is more than {spacing_m / DISTANCES_PER_PASS_SPACING:.0f} m from the nearest height of "
            f"{label}; {MAX_PASS_SPACING_M / DISTANCES_PER_PASS_SPACING:.0f} m are allowed, so give heights from "
            f"passes at most {MAX_PASS_SPACING_M:.0f} m apart."
        )
    return max(MIN_LENGTH_M, LENGTH_PER_PASS_SPACING * spacing_m)


def find_spikes(points: Floats, heights_m: Floats, length_m: float) -> tuple[Flags, Floats]:
    """Points that stand out from the median of the cells around, and by how much (n,).

    Ground of MAX_SLOPE over the distance of these cells is no spike.
    """
    from scipy.spatial import cKDTree

    centres, levels = _average_cells(points, heights_m, length_m, use_median=True)
    count = min(SPIKE_NEIGHBOURS, len(levels))
    distances, neighbours = cKDTree(centres).query(points, k=count)
    distances, neighbours = distances.reshape(len(points), count), neighbours.reshape(len(points), count)
    deviations = heights_m - np.median(levels[neighbours], axis=1)
    return np.abs(deviations) > np.maximum(MIN_SPIKE_M, MAX_SLOPE * distances[:, -1]), deviations


def fit_surface(
    points: Floats, heights_m: Floats, region: shapely.Geometry, length_m: float, margin_m: float
) -> tuple[ElevationGrid, float]:
    """The surface through points (n, 2) over a region and a margin round it, and how far the points scatter about it.

    `length_m` is L of the weights. The scatter is a standard deviation in metres: 1.4826 times the median deviation.

    Raises ElevationError where the points are on one line, or reach too far for a grid.
    """
    spacing_m = float(np.clip(length_m / NODES_PER_LENGTH, MIN_NODE_SPACING_M, MAX_NODE_SPACING_M))
    frame = lay_nodes(region, spacing_m, margin_m)
    if frame.spacing_m > MAX_WIDENING * spacing_m:
        size_km = 1e-3 * frame.spacing_m * np.array([frame.columns, frame.rows])
        raise ElevationError(
            f"The points with heights reach over {size_km[0]:.1f} by {size_km[1]:.1f} km, too far for one grid; give "
            "those of one field."
        )
    near = frame.find_inside(region.buffer(margin_m + spacing_m, join_style="mitre"))
    centres, levels = _average_cells(points, heights_m, length_m)
    fitted = np.full(near.shape, np.nan)
    fitted[near] = _fit_nodes(frame.list_places()[near.ravel()], centres, levels, length_m)
    measured = np.isfinite(fitted)
    if not measured.any():
        raise ElevationError("The points with heights lie on a single line; give heights from several passes.")
    heights = fill_gaps(fitted, near)
    grid = ElevationGrid(frame.west_m, frame.south_m, frame.spacing_m, heights, measured)
    return grid, _measure_scatter(frame, heights, points, heights_m)


def _average_cells(
    points: Floats, heights_m: Floats, length_m: float, use_median: bool = False
) -> tuple[Floats, Floats]:
    """Mean places and mean or median heights of the points in square cells, so that dense logs cost no more."""
    _, owners, counts = _group_cells(points * (CELLS_PER_LENGTH / length_m))
    centres = np.column_stack([np.bincount(owners, points[:, axis]) for axis in (0, 1)]) / counts[:, None]
    if not use_median:
        return centres, np.bincount(owners, heights_m) / counts
    order = np.lexsort((heights_m, owners))
    middle = np.cumsum(counts) - counts + counts // 2
    return centres, heights_m[order][middle]


def _group_cells(places: Floats) -> tuple[Integers, Integers, Integers]:
    """Cells (n, 2) that hold places, given in sides of a cell; the number of each place's cell; and their counts."""
    own_cells = np.floor(places).astype(np.int64)
    cells, owners, counts = np.unique(own_cells, axis=0, return_inverse=True, return_counts=True)
    return cells, owners.ravel(), counts


def _fit_nodes(nodes: Floats, points: Floats, heights: Floats, length_m: float) -> Floats:
    """Heights (n,) of the local surfaces at nodes (n, 2); NaN where the points are too far or on one line."""
    from scipy.spatial import cKDTree

    tree, count = cKDTree(points), min(MAX_NEIGHBOURS, len(points))
    base, parts = float(heights.mean()), []
    ridge = np.diag([0.0, 0.0, 0.0, CURVATURE_RIDGE, CURVATURE_RIDGE, CURVATURE_RIDGE])
    for start in range(0, len(nodes), CHUNK_NODES):
        chunk = nodes[start : start + CHUNK_NODES]
        distances, near = (found.reshape(len(chunk), count) for found in tree.query(chunk, k=count))
        x, y = np.moveaxis((points[near] - chunk[:, None]) / length_m, -1, 0)
        weights = np.exp(-0.5 * (distances / length_m) ** 2)
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
        weighted = terms * weights[..., None]
        moments = np.matmul(weighted.transpose(0, 2, 1), terms)
        values = np.matmul(weighted.transpose(0, 2, 1), (heights[near] - base)[..., None])
        middle = moments[:, 0, 1:3]
        spread = moments[:, 1:3, 1:3] - middle[:, :, None] * middle[:, None, :]  # second moments about the middle
        is_spread = np.linalg.eigvalsh(spread)[:, 0] >= MIN_SPREAD
        is_fit = (distances[:, 0] <= MAX_DISTANCE_LENGTHS * length_m) & is_spread
        fitted = np.full(len(chunk), np.nan)
        if is_fit.any():
            fitted[is_fit] = np.linalg.solve(moments[is_fit] + ridge, values[is_fit])[:, 0, 0] + base
        parts.append(fitted)
    return np.concatenate(parts)


def _measure_scatter(frame: NodeFrame, heights: Floats, points: Floats, heights_m: Floats) -> float:
    """How far points lie from the surface, as a standard deviation by their median."""
    from scipy.interpolate import RectBivariateSpline

    rows, columns = (points[:, axis] - low for axis, low in ((1, frame.south_m), (0, frame.west_m)))
    rows, columns = rows / frame.spacing_m, columns / frame.spacing_m
    is_on = (rows >= 0.0) & (rows <= frame.rows - 1) & (columns >= 0.0) & (columns <= frame.columns - 1)
    spline = RectBivariateSpline(np.arange(frame.rows), np.arange(frame.columns), heights)
    return 1.4826 * float(np.median(np.abs(spline.ev(rows[is_on], columns[is_on]) - heights_m[is_on])))


def level_tracks(tracks: Sequence[Floats]) -> Floats:
    """How much the heights of each track (n, 3) lie above those of the others, mean 0 (least squares over cells).

    Tracks that share fewer than MIN_SHARED_CELLS cells say nothing about each other.
    """
    levels = []
    for track in tracks:
        cells, owners, counts = _group_cells(track[:, :2] / TRACK_CELL_M)
        levels.append(dict(zip(map(tuple, cells.tolist()), np.bincount(owners, track[:, 2]) / counts, strict=True)))
    rows, differences = [], []
    for first in range(len(tracks)):
        for second in range(first + 1, len(tracks)):
            shared = levels[first].keys() & levels[second].keys()
            if len(shared) < MIN_SHARED_CELLS:
                continue
            row = np.zeros(len(tracks))
            row[first], row[second] = 1.0, -1.0
            weight = np.sqrt(len(shared))
            rows.append(row * weight)
            differences.append(
                weight * float(np.median([levels[first][cell] - levels[second][cell] for cell in shared]))
            )
    anchors = np.sqrt(ANCHOR_WEIGHT) * np.eye(len(tracks))
    right = np.concatenate([differences, np.zeros(len(tracks))])
    return np.asarray(np.linalg.lstsq(np.vstack([*rows, anchors]), right, rcond=None)[0])
