"""Longitude and latitude to metres and back by PROJ, areas and distances on the ellipsoid, the plane of AgOpenGPS.

Also whether a place can be farmland: PROJ's register of coordinate systems (EPSG) says for about 2,500 countries and
parts of them between which longitudes and latitudes they lie. Boxes are larger than countries, so what lies in one may
be sea; but farmland lies in one.
"""

from __future__ import annotations

import math
import re
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fields.arrays import Floats
from fields.errors import FieldError, mark_parameter, shorten_value

if TYPE_CHECKING:
    from pyproj import CRS, Geod, Transformer


_FILE_PATH = re.compile(r"""(?:^|(?<=[\s"'=@,;|]))(?:[/\\~]|\.\.?[/\\]|[A-Za-z]:[/\\]|[A-Za-z][\w+.-]*://)[^\s"',;]+""")
_OGC_NAME = re.compile(r"https?://www\.opengis\.net/(?:def/crs|gml/srs)/[\w./#:-]+|urn:[\w.:/-]+")
"""Coordinate systems by OGC addresses, which PROJ resolves without network."""
DEGREES_CRS = "EPSG:4326"
"""Longitude and latitude on WGS84."""
UTM_SOUTH_DEG, UTM_NORTH_DEG = -80.0, 84.0
"""Latitudes between which UTM is defined (NGA.STND.0037, section 7)."""
FARMED_LATITUDES_DEG = (-56.0, 72.0)
"""No farmland lies south of Tierra del Fuego or north of the North Cape."""
MAX_BOX_DEG2 = 6.0 * UTM_NORTH_DEG
"""A zone of UTM from the equator to its end; larger boxes are regions with seas between their countries."""
_AREAS = """
    SELECT name, description, west_lon, south_lat, east_lon, north_lat FROM extent
    WHERE auth_name = 'EPSG' AND name NOT LIKE 'World%' AND name NOT LIKE 'Arctic%' AND name NOT LIKE 'Antarctica%'
      AND (east_lon - west_lon + 360 * (east_lon < west_lon)) * (north_lat - south_lat) <= ?
"""
"""Areas of the register, whose names begin with a country or continent and " - "."""


def compute_rings_area_m2(rings: Sequence[Sequence[Sequence[float]]], *, swap_axes: bool = False) -> float:
    """Area on the ellipsoid of a polygon in degrees: the first ring less the others; `swap_axes`: latitude first."""
    areas_m2 = []
    for ring in rings:
        x, y = np.array(ring, dtype=np.float64)[:, :2].T
        areas_m2.append(abs(_get_ellipsoid().polygon_area_perimeter(*((y, x) if swap_axes else (x, y)))[0]))
    return areas_m2[0] - math.fsum(areas_m2[1:])


def extend_position(start: Sequence[float], heading_deg: float, distance_m: float) -> list[float]:
    """The point at a distance from (longitude, latitude) in a heading clockwise from north."""
    longitude, latitude, _ = _get_ellipsoid().fwd(start[0], start[1], heading_deg, distance_m)
    return [longitude, latitude]


def measure_distance_m(start: Sequence[float], end: Sequence[float]) -> float:
    """The shortest way between two places (longitude, latitude) on the ellipsoid."""
    return float(_get_ellipsoid().inv(start[0], start[1], end[0], end[1])[2])


@lru_cache(maxsize=1)
def _get_ellipsoid() -> Geod:
    from pyproj import Geod

    return Geod(ellps="WGS84")


@dataclass(frozen=True)
class LocalPlane:
    """The plane of AgOpenGPS: metres about an origin in degrees, by a series of its own (AgOpenGPS.Core, LocalPlane).

    It is not UTM: degrees of latitude have their length at the origin, degrees of longitude that at the point itself.
    """

    longitude_deg: float
    latitude_deg: float

    def to_degrees(self, east_m: float, north_m: float) -> list[float]:
        """Longitude from -180 to 180 degrees and latitude of a point in metres about the origin."""
        latitude = self.latitude_deg + north_m / self._metres_per_latitude_deg
        return [
            math.remainder(self.longitude_deg + east_m / _compute_metres_per_longitude_deg(latitude), 360.0),
            latitude,
        ]

    def to_metres(self, longitude_deg: float, latitude_deg: float) -> tuple[float, float]:
        """Metres east and north of the origin; the shorter way across 180 degrees."""
        east_deg = math.remainder(longitude_deg - self.longitude_deg, 360.0)
        return east_deg * _compute_metres_per_longitude_deg(latitude_deg), (
            latitude_deg - self.latitude_deg
        ) * self._metres_per_latitude_deg

    @property
    def _metres_per_latitude_deg(self) -> float:
        """Metres of a degree of latitude at the origin."""
        latitude_rad = math.radians(self.latitude_deg)
        return (
            111132.92
            - 559.82 * math.cos(2 * latitude_rad)
            + 1.175 * math.cos(4 * latitude_rad)
            - 0.0023 * math.cos(6 * latitude_rad)
        )


def _compute_metres_per_longitude_deg(latitude_deg: float) -> float:
    """Metres of a degree of longitude at a latitude."""
    latitude_rad = math.radians(latitude_deg)
    return 111412.84 * math.cos(latitude_rad) - 93.5 * math.cos(3 * latitude_rad) + 0.118 * math.cos(5 * latitude_rad)


def find_utm_crs(longitude_deg: float, latitude_deg: float) -> str:
    """EPSG code of the 6 degree UTM zone of a point: 326zz north, 327zz south of the equator.

    Zone = floor((longitude + 180) / 6) + 1 with the longitude wrapped into [-180, 180), so that 180
    degrees east falls in zone 1. The wider zones of Norway and Svalbard are not applied: a field there
    gets the regular zone, whose scale error is still below 0.1 %.

    Raises FieldError where the latitude is outside the UTM range.
    """
    if not UTM_SOUTH_DEG <= latitude_deg <= UTM_NORTH_DEG:
        raise FieldError(
            f"Latitude {latitude_deg:g} is outside the UTM range of {UTM_SOUTH_DEG:g} to {UTM_NORTH_DEG:g} "
            f"degrees; give the field in local metres with {mark_parameter('local')}."
        )
    wrapped = (longitude_deg + 180.0) % 360.0
    zone = min(math.floor(wrapped / 6.0) + 1, 60)
    return f"EPSG:{(32700 if latitude_deg < 0.0 else 32600) + zone}"


def project(points: Floats, from_crs: str, to_crs: str) -> Floats:
    """Points of shape (n, 2) from one system to the other, x or longitude first on both sides.

    Raises FieldError where a system is unknown, or a point cannot be converted.
    """
    if len(points) == 0:
        return np.empty((0, 2))
    x, y = _get_transformer(from_crs, to_crs).transform(points[:, 0], points[:, 1])
    result = np.column_stack([x, y]).astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(result).all(axis=1))
    if len(bad):
        px, py = points[bad[0]]
        raise FieldError(
            f"Point ({px:g}, {py:g}) cannot be converted to {to_crs}; check that the coordinates are in {from_crs}."
        )
    return result


def is_wgs84_longitude_latitude(crs: str) -> bool:
    """Whether the system is WGS84 longitude and latitude, as RFC 7946 requires.

    Raises FieldError where the system is unknown.
    """
    return any(is_same_crs(crs, plain_system) for plain_system in (DEGREES_CRS, "OGC:CRS84"))


def is_same_crs(crs: str, other: str) -> bool:
    """Whether two texts name the same coordinate system; raises FieldError where a system is unknown."""
    return bool(_parse_crs(crs).equals(_parse_crs(other)))


def _parse_crs(crs: str) -> CRS:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    _check_crs_without_files(crs)
    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        raise FieldError(
            f"The coordinate system {shorten_value(crs, 60)} is unknown; name an EPSG code such as 'EPSG:28992' or "
            "convert the file to longitude and latitude."
        ) from error


@lru_cache(maxsize=64)
def _get_transformer(from_crs: str, to_crs: str) -> Transformer:
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    for crs in (from_crs, to_crs):
        _check_crs_without_files(crs)
    try:
        return Transformer.from_crs(from_crs, to_crs, always_xy=True)
    except ProjError as error:
        raise FieldError(
            f"There is no conversion from {shorten_value(from_crs, 60)} to {shorten_value(to_crs, 60)}; convert the "
            "file to longitude and latitude first."
        ) from error


def _check_crs_without_files(crs: str) -> None:
    """Raise FieldError for a system that names a local or remote file, which PROJ would open."""
    place = _FILE_PATH.search("" if _OGC_NAME.fullmatch(crs) else crs)
    if place:
        raise FieldError(
            f"The coordinate system {shorten_value(crs, 60)} names the file {shorten_value(place[0], 40)}; give an "
            "EPSG code such as 'EPSG:28992' instead."
        )


def can_be_farmland(longitude_deg: float, latitude_deg: float) -> bool:
    """Whether a place lies at the latitudes of farmland and in the box of a country or of a part of one."""
    west, south, east, north = _read_land_boxes().T
    crosses_180 = (west > east) & ((longitude_deg >= west) | (longitude_deg <= east))
    in_longitude = (west <= longitude_deg) & (longitude_deg <= east) | crosses_180
    is_farmed = FARMED_LATITUDES_DEG[0] <= latitude_deg <= FARMED_LATITUDES_DEG[1]
    return is_farmed and bool((in_longitude & (south <= latitude_deg) & (latitude_deg <= north)).any())


@lru_cache(maxsize=1)
def _read_land_boxes() -> Floats:
    """West, south, east and north in degrees of areas on land, and of countries with their sea that have no such area.

    Empty if the register has another form.
    """
    from pyproj.datadir import get_data_dir

    register = Path(get_data_dir()) / "proj.db"
    try:
        with closing(sqlite3.connect(f"{register.as_uri()}?mode=ro&immutable=1", uri=True)) as connection:
            areas = connection.execute(_AREAS, (MAX_BOX_DEG2,)).fetchall()
    except sqlite3.Error:
        areas = []
    on_land = [(name, *box) for name, description, *box in areas if "offshore" not in description.lower()]
    countries = {name.partition(" - ")[0] for name, *_ in on_land}
    boxes = [box for _, *box in on_land]
    boxes += [
        box
        for name, description, *box in areas
        if "onshore and offshore" in description.lower() and name.partition(" - ")[0] not in countries
    ]
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)
