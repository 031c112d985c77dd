"""Ten awkward fields of one to two hectares, drawn in local metres, for maps that are compared with stored ones."""

import math

import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle

Corners = list[tuple[float, float]]

L_SHAPE: Corners = [(0, 0), (140, 0), (140, 60), (70, 60), (70, 140), (0, 140)]
U_SHAPE: Corners = [(0, 0), (150, 0), (150, 120), (100, 120), (100, 50), (50, 50), (50, 120), (0, 120)]
COMB: Corners = [
    (0, 0), (160, 0), (160, 100), (124, 100), (124, 45), (98, 45), (98, 100), (62, 100), (62, 45), (36, 45), (36, 100),
    (0, 100),
]  # fmt: skip
SLANTED: Corners = [(0, 0), (110, 0), (190, 120), (80, 120)]
ISLAND = Obstacle("rocks", shapely.Polygon([(60, 78), (80, 70), (95, 80), (90, 110), (65, 110)]))


def _ring(radius_m: float, corners: int, other_m: float | None = None) -> Corners:
    """Corners round the origin, every second one at another radius."""
    radii = (radius_m, radius_m if other_m is None else other_m)
    turns = [2.0 * math.pi * k / corners for k in range(corners)]
    return [(radii[k % 2] * math.sin(turn), radii[k % 2] * math.cos(turn)) for k, turn in enumerate(turns)]


STAR = _ring(95.0, 10, 50.0)


def _drawn(name: str, outline: Corners, holes: tuple[Corners, ...] = (), obstacles: tuple[Obstacle, ...] = ()) -> Field:
    return Field(name, shapely.Polygon(outline, holes), obstacles=obstacles)


SHAPES = {
    "L": _drawn("L", L_SHAPE),
    "U": _drawn("U", U_SHAPE),
    "comb": _drawn("comb", COMB),
    "star": _drawn("star", STAR),
    "triangle": _drawn("triangle", [(0, 0), (180, 0), (60, 130)]),
    "thin strip": _drawn("thin strip", [(0, 0), (420, 20), (419, 45), (-1, 25)]),
    "donut": _drawn("donut", _ring(70.0, 48), (_ring(25.0, 24),)),
    "two ponds": _drawn(
        "two ponds", [(0, 0), (150, 0), (150, 100), (0, 100)],
        ([(35, 40), (55, 35), (60, 60), (40, 65)], [(100, 30), (118, 38), (110, 55), (95, 45)]),
    ),
    "island at the edge": _drawn("island at the edge", [(0, 0), (150, 0), (150, 95), (0, 95)], obstacles=(ISLAND,)),
    "slanted headlands": _drawn("slanted headlands", SLANTED),
}  # fmt: skip
