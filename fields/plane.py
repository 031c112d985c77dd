"""The plane of AgOpenGPS: metres about an origin in degrees, by a series of its own.

It is not UTM: a degree is so many metres as the series say, at the origin for latitude and at the point itself for
longitude, as the program does (AgOpenGPS.Core, LocalPlane).
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Plane:
    """The program's plane about an origin in degrees."""

    longitude_deg: float
    latitude_deg: float

    def degrees(self, east_m: float, north_m: float) -> list[float]:
        """Longitude from -180 to 180 degrees and latitude of a point in metres about the origin."""
        latitude = self.latitude_deg + north_m / self._per_latitude
        return [math.remainder(self.longitude_deg + east_m / _per_longitude(latitude), 360.0), latitude]

    def metres(self, longitude_deg: float, latitude_deg: float) -> tuple[float, float]:
        """Metres east and north of the origin of a point in degrees; across 180 degrees the short way."""
        east_deg = math.remainder(longitude_deg - self.longitude_deg, 360.0)
        return east_deg * _per_longitude(latitude_deg), (latitude_deg - self.latitude_deg) * self._per_latitude

    @property
    def _per_latitude(self) -> float:
        """Metres of a degree of latitude at the origin."""
        turn = math.radians(self.latitude_deg)
        return 111132.92 - 559.82 * math.cos(2 * turn) + 1.175 * math.cos(4 * turn) - 0.0023 * math.cos(6 * turn)


def _per_longitude(latitude_deg: float) -> float:
    """Metres of a degree of longitude at a latitude."""
    turn = math.radians(latitude_deg)
    return 111412.84 * math.cos(turn) - 93.5 * math.cos(3 * turn) + 0.118 * math.cos(5 * turn)
