"""Between longitude and latitude and metres: UTM zones by arithmetic, conversion by PROJ."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from fields.errors import FieldError, named

if TYPE_CHECKING:
    from pyproj import Transformer

FloatArray = npt.NDArray[np.float64]

UTM_SOUTH_DEG, UTM_NORTH_DEG = -80.0, 84.0
"""Latitudes between which UTM is defined (NGA.STND.0037, section 7)."""


def utm_crs(longitude_deg: float, latitude_deg: float) -> str:
    """EPSG code of the 6 degree UTM zone of a point: 326zz north, 327zz south of the equator.

    Zone = floor((longitude + 180) / 6) + 1 with the longitude wrapped into [-180, 180), so that 180
    degrees east falls in zone 1. The wider zones of Norway and Svalbard are not applied: a field there
    gets the regular zone, whose scale error is still below 0.1 %.

    Raises:
        FieldError: the latitude is outside the UTM range.
    """
    if not UTM_SOUTH_DEG <= latitude_deg <= UTM_NORTH_DEG:
        raise FieldError(
            f"Latitude {latitude_deg:g} is outside the UTM range of {UTM_SOUTH_DEG:g} to {UTM_NORTH_DEG:g} "
            f"degrees; give the field in local metres with {named('local')}."
        )
    wrapped = (longitude_deg + 180.0) % 360.0
    zone = min(math.floor(wrapped / 6.0) + 1, 60)
    return f"EPSG:{(32700 if latitude_deg < 0.0 else 32600) + zone}"


def project(points: FloatArray, from_crs: str, to_crs: str) -> FloatArray:
    """Points of shape (n, 2) from one system to the other, x or longitude first on both sides.

    Raises:
        FieldError: a system is unknown, or a point cannot be converted.
    """
    if len(points) == 0:
        return np.empty((0, 2))
    x, y = _transformer(from_crs, to_crs).transform(points[:, 0], points[:, 1])
    result = np.column_stack([x, y]).astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(result).all(axis=1))
    if len(bad):
        px, py = points[bad[0]]
        raise FieldError(
            f"Point ({px:g}, {py:g}) has no place in {to_crs}; check that the coordinates are in {from_crs}."
        )
    return result


def is_longitude_latitude(crs: str) -> bool:
    """True when the system is plain WGS84 longitude and latitude, as RFC 7946 wants it.

    Raises:
        FieldError: the system is unknown.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        found = CRS.from_user_input(crs)
    except CRSError as error:
        raise FieldError(
            f"Coordinate system '{crs}' of the file is not known; "
            "name an EPSG code such as 'EPSG:28992' or convert the file to longitude and latitude."
        ) from error
    return any(found.equals(CRS.from_user_input(same)) for same in ("EPSG:4326", "OGC:CRS84"))


@lru_cache(maxsize=64)
def _transformer(from_crs: str, to_crs: str) -> Transformer:
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        return Transformer.from_crs(from_crs, to_crs, always_xy=True)
    except ProjError as error:
        raise FieldError(
            f"No conversion from {from_crs} to {to_crs}; convert the file to longitude and latitude first."
        ) from error
