"""Slopes of a grid of heights: gradients, along and across a direction, quantiles of a field, shading and contours.

Slopes are metres of height per metre along the ground's plan; a percentage is a hundred times that.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely

from fields.arrays import Floats, build_directions, compute_angles
from fields.terrain.elevation_grid import ElevationGrid

LIGHT_AZIMUTH_DEG, LIGHT_HEIGHT_DEG = 315.0, 45.0
"""Light from the north-west, as maps have it: from below, hills would look like hollows."""
CONTOUR_INTERVALS_M = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
MAX_CONTOURS = 12
FALL_LINE_RAD, ERODIBLE_SLOPE = math.radians(10.0), 0.05
"""Swaths this near to the fall line, on slopes above this one, count as leading water downhill.

A convention of Headland without a source: published rules go by soil and field, as K S R L of the USLE does."""


@dataclass(frozen=True)
class SlopeSummary:
    """Slopes over a field.

    Attributes:
        median, p90, steepest: slopes in m/m that half and 90 % of the ground stay below, and the largest.
        steepest_place_m: x and y of the largest.
        aspect_deg: direction in which the field as a whole falls, clockwise from north of the plane; None if it does
            not fall in any.
        aspect_share: mean slope in that direction over the mean of all slopes, 1 for a plane.
        lowest_m, highest_m: heights.
    """

    median: float
    p90: float
    steepest: float
    steepest_place_m: tuple[float, float]
    aspect_deg: float | None
    aspect_share: float
    lowest_m: float
    highest_m: float


def compute_gradients(grid: ElevationGrid) -> Floats:
    """(dz/dx, dz/dy) at the nodes, shape (rows, columns, 2), by central differences."""
    north, east = np.gradient(grid.heights_m, grid.spacing_m, edge_order=2)
    return np.stack([east, north], axis=-1)


def interpolate_gradients(grid: ElevationGrid, points: Floats) -> Floats:
    """(dz/dx, dz/dy) at places (n, 2), shape (n, 2), bilinear between nodes; beyond an edge, those of the edge."""
    rows, columns = grid.heights_m.shape
    east = np.clip((points[:, 0] - grid.west_m) / grid.spacing_m, 0.0, columns - 1.0)
    north = np.clip((points[:, 1] - grid.south_m) / grid.spacing_m, 0.0, rows - 1.0)
    column, row = np.minimum(east.astype(np.int64), columns - 2), np.minimum(north.astype(np.int64), rows - 2)
    across, up = (east - column)[:, None], (north - row)[:, None]
    nodes = compute_gradients(grid)
    low = (1.0 - across) * nodes[row, column] + across * nodes[row, column + 1]
    high = (1.0 - across) * nodes[row + 1, column] + across * nodes[row + 1, column + 1]
    return np.asarray((1.0 - up) * low + up * high)


def compute_directional_slopes(gradients: Floats, headings_rad: Floats | float) -> tuple[Floats, Floats]:
    """Slopes along and across headings (...), for gradients of shape (..., 2); headings counter-clockwise from east.

    Along is positive uphill; across is positive where the ground falls to the right.
    """
    cosine, sine = np.moveaxis(build_directions(headings_rad), -1, 0)
    along = gradients[..., 0] * cosine + gradients[..., 1] * sine
    across = gradients[..., 1] * cosine - gradients[..., 0] * sine
    return np.asarray(along), np.asarray(across)


def summarise_slopes(grid: ElevationGrid, region: shapely.Geometry) -> SlopeSummary | None:
    """Slopes at the nodes inside a region; None if there is no node in it."""
    inside = grid.frame.find_inside(region)
    if not inside.any():
        return None
    gradients = compute_gradients(grid)[inside]
    slopes = np.hypot(gradients[:, 0], gradients[:, 1])
    row, column = np.argwhere(inside)[int(np.argmax(slopes))]
    mean_east, mean_north = gradients.mean(axis=0)
    mean = math.hypot(mean_east, mean_north)
    median, p90, steepest = np.quantile(slopes, [0.5, 0.9, 1.0]).tolist()
    heights = grid.heights_m[inside]
    return SlopeSummary(
        median,
        p90,
        steepest,
        (float(grid.xs_m[column]), float(grid.ys_m[row])),
        math.degrees(math.atan2(-mean_east, -mean_north)) % 360.0 if mean > 1e-6 else None,
        mean / float(slopes.mean()) if mean > 1e-6 else 0.0,
        float(heights.min()),
        float(heights.max()),
    )


def compute_hill_shade(grid: ElevationGrid, exaggeration: float = 1.0) -> Floats:
    """Brightness of the nodes (rows, columns) from 0 (dark) to 1: Lambert's cosine law for light from the north-west.

    Level ground has sin(45 degrees) = 0.71; `exaggeration` multiplies heights, as fields are flat.
    """
    gradients = exaggeration * compute_gradients(grid)
    azimuth, height = math.radians(LIGHT_AZIMUTH_DEG), math.radians(LIGHT_HEIGHT_DEG)
    light = (math.cos(height) * math.sin(azimuth), math.cos(height) * math.cos(azimuth), math.sin(height))
    facing = light[2] - gradients[..., 0] * light[0] - gradients[..., 1] * light[1]
    return np.asarray(np.clip(facing / np.sqrt(1.0 + (gradients**2).sum(axis=-1)), 0.0, 1.0))


def choose_contour_interval_m(grid: ElevationGrid, region: shapely.Geometry) -> float:
    """The smallest usual interval with at most MAX_CONTOURS heights in a region."""
    summary = summarise_slopes(grid, region)
    span_m = 0.0 if summary is None else summary.highest_m - summary.lowest_m
    return next((one for one in CONTOUR_INTERVALS_M if span_m <= MAX_CONTOURS * one), CONTOUR_INTERVALS_M[-1])


def trace_height(grid: ElevationGrid, height_m: float) -> list[Floats]:
    """The pieces of the line of one height, points (n, 2) in metres each; a closed one ends where it begins."""
    from contourpy import contour_generator

    generator = contour_generator(grid.xs_m, grid.ys_m, grid.heights_m)
    return [np.asarray(points, dtype=np.float64) for points in generator.lines(height_m)]


def trace_contours(grid: ElevationGrid, interval_m: float) -> list[tuple[float, Floats]]:
    """Lines of equal height at multiples of an interval: height and points (n, 2) in metres of each piece."""
    first = math.ceil(float(grid.heights_m.min()) / interval_m)
    last = math.floor(float(grid.heights_m.max()) / interval_m)
    heights_m = [number * interval_m for number in range(first, last + 1)]
    return [(height_m, points) for height_m in heights_m for points in trace_height(grid, height_m)]


def cut_into_steps(points: Floats, step_m: float = 2.0) -> tuple[Floats, Floats]:
    """Middles and vectors (n, 2) of steps of at most `step_m` along a polyline (k, 2)."""
    places = shapely.get_coordinates(shapely.segmentize(shapely.LineString(points), step_m))
    return 0.5 * (places[1:] + places[:-1]), np.diff(places, axis=0)


def measure_fall_line_share(lines: Iterable[Floats], grid: ElevationGrid) -> float:
    """The share of the length of lines (n, 2) within FALL_LINE_RAD of the fall line on slopes over ERODIBLE_SLOPE."""
    vectors, gradients = _measure_steps(lines, grid)
    length, slope = np.hypot(*vectors.T), np.hypot(*gradients.T)
    downhill = np.abs((gradients * vectors).sum(axis=1)) >= math.cos(FALL_LINE_RAD) * slope * length
    return float(length[downhill & (slope > ERODIBLE_SLOPE)].sum() / length.sum())


def measure_cross_slope(lines: Iterable[Floats], grid: ElevationGrid) -> float:
    """The largest slope (m/m) across lines (n, 2), to either side."""
    vectors, gradients = _measure_steps(lines, grid)
    _, across = compute_directional_slopes(gradients, compute_angles(vectors))
    return float(np.abs(across).max())


def _measure_steps(lines: Iterable[Floats], grid: ElevationGrid) -> tuple[Floats, Floats]:
    """Vectors of short steps along all lines, and the gradients at their middles, (n, 2) each."""
    steps = [cut_into_steps(points) for points in lines]
    middles = np.concatenate([middle for middle, _ in steps])
    return np.concatenate([vector for _, vector in steps]), interpolate_gradients(grid, middles)
