"""Fields of odd shapes in local metres: what hand-drawn and real parcels have in the extreme."""

import math
from collections.abc import Iterable

import numpy as np
import shapely

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle


def build_odd_shapes() -> dict[str, Field]:
    """The fields by their names."""
    ring = shapely.Point(0.0, 0.0).buffer(70.0, quad_segs=12).difference(shapely.Point(0.0, 0.0).buffer(60.0))
    lane = shapely.box(120, 42, 190, 48)
    trees = list_points(range(18, 73, 6), range(15, 46, 6), "tree", 0.5)
    poles = list_points(range(12, 145, 14), range(9, 115, 14), "pole", 0.25)
    rows = list_rows(10.0, 120.0, [5.0 + 4.0 * number for number in range(14)], 0.25)
    ditch = Obstacle("ditch", shapely.LineString([(-5, 50), (185, 65)]), 0.75)
    shapes: dict[str, tuple[shapely.Polygon, Iterable[Obstacle]]] = {
        "orchard": (shapely.box(0, 0, 90, 60), trees),
        "vineyard": (shapely.box(0, 0, 130, 62), rows),
        "pivot-circle": (shapely.Point(0, 0).buffer(100.0), [Obstacle("pole", shapely.Point(0, 0), 0.5)]),
        "triangle": (shapely.Polygon([(0, 0), (210, 0), (60, 150)]), ()),
        "hourglass-8": (build_hourglass(8.0), ()),
        "hourglass-5": (build_hourglass(5.0), ()),
        "ditch-across": (shapely.box(0, 0, 180, 120), [ditch]),
        "strip-8": (shapely.box(0, 0, 220, 8), ()),
        "garden": (shapely.box(0, 0, 36, 28), ()),
        "points-400": (build_waved_outline(400), ()),
        "two-parts": (shapely.union_all([shapely.box(0, 0, 120, 90), lane, shapely.box(190, 0, 300, 80)]), ()),
        "thin-ring": (ring, ()),
        "l-shape": (shapely.Polygon([(0, 0), (500, 0), (500, 180), (200, 180), (200, 550), (0, 550)]), ()),
        "hole-1-ha": (shapely.box(0, 0, 105, 100).difference(shapely.box(40, 38, 62, 60)), ()),
        "points-all-over": (shapely.box(0, 0, 150, 120), poles),
    }
    return {name: Field(name, shape, obstacles=tuple(obstacles)) for name, (shape, obstacles) in shapes.items()}


def build_hourglass(neck_m: float) -> shapely.Polygon:
    """Two trapeziums of 100 m that meet in a neck of 10 m length."""
    half = 0.5 * neck_m
    west, east = [(100, half), (0, 50), (0, -50), (100, -half)], [(110, -half), (210, -50), (210, 50), (110, half)]
    return shapely.Polygon([*west, *east])


def build_waved_outline(points: int) -> shapely.Polygon:
    """An ellipse with waves of several lengths, about 3.3 ha."""
    angle = math.tau * np.arange(points) / points
    reach = 1.0 + 0.08 * np.sin(3 * angle + 0.4) + 0.05 * np.sin(7 * angle) + 0.01 * np.sin(31 * angle + 1.0)
    return shapely.Polygon(np.column_stack([130.0 * reach * np.cos(angle), 80.0 * reach * np.sin(angle)]))


def list_points(xs: Iterable[int], ys: Iterable[int], kind: str, radius_m: float) -> tuple[Obstacle, ...]:
    """Round obstacles on a grid."""
    heights = list(ys)
    return tuple(Obstacle(kind, shapely.Point(x, y), radius_m, f"{x}/{y}") for x in xs for y in heights)


def list_rows(west: float, east: float, ys: Iterable[float], half_m: float) -> tuple[Obstacle, ...]:
    """Rows of plants from west to east."""
    lines = (shapely.LineString([(west, y), (east, y)]) for y in ys)
    return tuple(Obstacle("hedge", line, half_m, f"row {number}") for number, line in enumerate(lines))
