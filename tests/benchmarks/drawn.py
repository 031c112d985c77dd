"""Big fields drawn by a rule: a bent outline of many points, and ponds in it."""

from __future__ import annotations

import math
import random

import shapely

from fields.geometry.field import Field

BIG = {"24": (24.0, 400, 0), "60": (60.0, 900, 2), "200": (200.0, 1600, 19)}
"""Hectares without the ponds, points of the outline, ponds."""
WAVES = 7
POND_M = (12.0, 35.0)
APART_M = 45.0


def big_field(name: str, seed: int = 1) -> Field:
    """The drawn field of a name in BIG."""
    hectares, points, ponds = BIG[name]
    rng = random.Random(f"{name} {seed}")
    outline = _outline(rng, points, hectares * 1e4)
    holes = _ponds(rng, outline, ponds)
    return Field(f"drawn {name} ha", shapely.Polygon(outline.exterior, [hole.exterior for hole in holes]))


def _outline(rng: random.Random, points: int, area_m2: float) -> shapely.Polygon:
    """A rectangle of three to two whose sides are waved and whose corners are bent."""
    waves = [(k, 0.12 / k * rng.uniform(0.3, 1.0), rng.uniform(0.0, math.tau)) for k in range(2, WAVES + 2)]
    ring = []
    for place in range(points):
        angle = math.tau * place / points
        square = 1.0 / max(abs(math.cos(angle)), abs(math.sin(angle)))
        reach = square * (1.0 + sum(height * math.sin(k * angle + phase) for k, height, phase in waves))
        ring.append((1.5 * reach * math.cos(angle), reach * math.sin(angle)))
    plain = shapely.Polygon(ring)
    scale = math.sqrt(area_m2 / plain.area)
    return shapely.Polygon([(scale * x, scale * y) for x, y in ring])


def _ponds(rng: random.Random, outline: shapely.Polygon, count: int) -> list[shapely.Polygon]:
    """Ponds that keep their distance from the outline and from each other."""
    ponds: list[shapely.Polygon] = []
    west, south, east, north = outline.bounds
    while len(ponds) < count:
        middle = shapely.Point(rng.uniform(west, east), rng.uniform(south, north))
        pond = _pond(rng, middle)
        room = outline.buffer(-APART_M)
        if room.contains(pond) and all(pond.distance(other) > APART_M for other in ponds):
            ponds.append(pond)
    return ponds


def _pond(rng: random.Random, middle: shapely.Point) -> shapely.Polygon:
    long, wide, turn = rng.uniform(*POND_M), rng.uniform(*POND_M), rng.uniform(0.0, math.pi)
    ring = []
    for place in range(24):
        angle = math.tau * place / 24
        x, y = long * math.cos(angle), wide * math.sin(angle)
        ring.append((
            middle.x + x * math.cos(turn) - y * math.sin(turn), middle.y + x * math.sin(turn) + y * math.cos(turn),
        ))  # fmt: skip
    return shapely.Polygon(ring)
