"""Cells: parts of the ground for tracks, each with a bearing of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass

import shapely

ROUNDING_DEG = 1e-9


@dataclass(frozen=True, eq=False)
class Cell:
    """A part of the region for tracks whose tracks are parallel.

    Attributes:
        number: 1 and up.
        bearing_rad: direction +u of its tracks as a mathematical angle, radians, in (-pi, pi].
        region: ground that its tracks are to cover; with a headland for turning only, where their centre lines may
            lie. Cells do not overlap.
    """

    number: int
    bearing_rad: float
    region: shapely.Geometry

    @property
    def bearing_deg(self) -> float:
        """Direction of the tracks clockwise from north, degrees in [0, 180)."""
        return compass_deg(self.bearing_rad)

    @property
    def area_m2(self) -> float:
        """Area of the region, square metres."""
        return float(self.region.area)


def compass_deg(bearing_rad: float) -> float:
    """A direction without sense, given as a mathematical angle, clockwise from north, degrees in [0, 180)."""
    bearing = (90.0 - math.degrees(bearing_rad)) % 180.0
    return 0.0 if 180.0 - bearing < ROUNDING_DEG else bearing
