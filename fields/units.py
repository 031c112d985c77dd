"""Units that files and people use, in SI, and the points of the compass: for every package."""

from __future__ import annotations

MINUTE_S, HOUR_S, DAY_S = 60.0, 3600.0, 86_400
KMH_PER_MPS = 3.6
MPS_PER_KMH = 1.0 / KMH_PER_MPS
FOOT_M, MILE_KM = 0.3048, 1.609344
KILO, PCT = 1000.0, 100.0
J_PER_KWH = KILO * HOUR_S
_COMPASS_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def name_compass_point(bearing_deg: float) -> str:
    """The nearest of the eight points of the compass, in a word; bearings are clockwise from north."""
    return _COMPASS_POINTS[round(bearing_deg / 45.0) % 8]
