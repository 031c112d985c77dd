"""Lengths and areas straight from longitude and latitude, good to a few parts in a thousand over a field."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

EQUATOR_M, ECCENTRICITY2 = 6_378_137.0, 0.006_694_38
"""Semi-major axis and squared first eccentricity of WGS84 (NGA.STND.0036)."""


def metres_per_degree(latitude_deg: float) -> tuple[float, float]:
    """Metres of one degree of longitude and of latitude on the WGS84 ellipsoid: N cos(lat) and M."""
    sine = math.sin(math.radians(latitude_deg))
    bend = 1.0 - ECCENTRICITY2 * sine * sine
    east = EQUATOR_M / math.sqrt(bend) * math.cos(math.radians(latitude_deg))
    return math.radians(east), math.radians(EQUATOR_M * (1.0 - ECCENTRICITY2) / bend**1.5)


def rings_area_m2(rings: Sequence[Sequence[Sequence[float]]], *, swap: bool = False) -> float:
    """Area of a polygon in degrees, its first ring less the others; `swap` takes latitude for longitude."""
    total_m2 = 0.0
    for place, ring in enumerate(rings):
        points = np.array(ring, dtype=np.float64)[:, :2]
        points = points[:, ::-1] if swap else points
        scale = metres_per_degree(float(points[:, 1].mean()))
        area_m2 = float(shapely.Polygon(points * scale).area)
        total_m2 += area_m2 if place == 0 else -area_m2
    return total_m2


def onwards(start: Sequence[float], heading_deg: float, distance_m: float) -> list[float]:
    """The point so far from another (longitude, latitude) in a heading clockwise from north."""
    east, north = metres_per_degree(start[1])
    turn = math.radians(heading_deg)
    return [start[0] + distance_m * math.sin(turn) / east, start[1] + distance_m * math.cos(turn) / north]
