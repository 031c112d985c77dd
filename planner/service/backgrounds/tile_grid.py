"""The grid of web map tiles, and where it lies in the metres of a field.

Tiles are those of XYZ and of the WMTS matrix set GoogleMapsCompatible (OGC 07-057r7, annex E.4): spherical mercator,
row 0 in the north. A field has metres of its own; between the two a polynomial of degree 3 each way is exact to a
millimetre over REACH_M, so that pages need no library for projections. The picture of a tile is PNG, JPEG or WebP of a
usual size, told by its bytes and not by its name.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from fields.geometry.geodesy import UTM_NORTH_DEG, find_utm_crs, project
from planner.service.errors import ServiceError
from planner.service.settings import LIMITS, MEGABYTE_BYTES

MERCATOR, WGS84 = "EPSG:3857", "EPSG:4326"
HALF_WIDTH_M = math.pi * 6_378_137.0
"""Half the side of the square that the tile of zoom 0 covers, metres of mercator."""
HIGHEST_ZOOM, TILE_PX = 22, 256
REACH_M = 6_000.0
DEGREE, GRID_POINTS, UNIT_M = 3, 9, 1_000.0
FloatArray = npt.NDArray[np.float64]
MOST_TILE_BYTES = 2 * MEGABYTE_BYTES
MEDIA_BY_FORMAT = {"PNG": "image/png", "JPEG": "image/jpeg", "WEBP": "image/webp"}


@dataclass(frozen=True)
class Tile:
    """A tile: zoom, column from the west, row from the north; raises ServiceError outside the grid."""

    zoom: int
    column: int
    row: int

    def __post_init__(self) -> None:
        if not 0 <= self.zoom <= HIGHEST_ZOOM:
            raise ServiceError(f"The zoom is {self.zoom}; use 0 to {HIGHEST_ZOOM}.", parameter="zoom")
        for name, value in (("column", self.column), ("row", self.row)):
            if not 0 <= value < 2**self.zoom:
                raise ServiceError(
                    f"The {name} is {value}; at zoom {self.zoom} use 0 to {2**self.zoom - 1}.", parameter=name
                )

    @property
    def row_from_south(self) -> int:
        """The row as TMS and MBTiles count it."""
        return (1 << self.zoom) - 1 - self.row

    def compute_bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east and north in metres of mercator."""
        side_m = 2.0 * HALF_WIDTH_M / 2**self.zoom
        west, north = self.column * side_m - HALF_WIDTH_M, HALF_WIDTH_M - self.row * side_m
        return west, north - side_m, west + side_m, north


class PlacementInfo(BaseModel):
    """Where a place lies, in metres of `crs` and of web mercator (EPSG:3857), and polynomials between the two.

    `to_mercator` has the coefficients for x and for y, from metres about `origin_m` to metres about `mercator_m`;
    `to_metres` is the other way. Terms are 1, u, v, u2, uv, v2, u3, u2v, uv2, v3 with u and v in kilometres. They hold
    within `reach_m`, with errors of at most `error_m`.
    """

    crs: str
    origin_m: list[float]
    mercator_m: list[float]
    to_mercator: list[list[float]]
    to_metres: list[list[float]]
    reach_m: float
    error_m: float


def place_metres(crs: str, easting_m: float, northing_m: float) -> PlacementInfo:
    """Where a place in metres of `crs` lies; raises ServiceError for one that has no place in mercator."""
    origin = np.array([easting_m, northing_m])
    ticks = np.linspace(-REACH_M, REACH_M, GRID_POINTS)
    around = np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2)
    mercator = _project_to_mercator(np.vstack([origin, origin + around]), crs)
    centre, offsets = mercator[0], mercator[1:] - mercator[0]
    forward, forward_error = _fit_polynomial(around, offsets)
    backward, backward_error = _fit_polynomial(offsets, around)
    return PlacementInfo(
        crs=crs, origin_m=[easting_m, northing_m], mercator_m=centre.tolist(), to_mercator=forward, to_metres=backward,
        reach_m=REACH_M, error_m=round(max(forward_error, backward_error), 6),
    )  # fmt: skip


def place_degrees(longitude_deg: float, latitude_deg: float) -> PlacementInfo:
    """The same for a place in degrees, in metres of its UTM zone; easting and northing are whole metres."""
    if abs(latitude_deg) > UTM_NORTH_DEG:
        raise ServiceError(
            f"The latitude is {latitude_deg:g}; use -{UTM_NORTH_DEG:g} to {UTM_NORTH_DEG:g} degrees.",
            parameter="latitude",
        )
    crs = find_utm_crs(longitude_deg, latitude_deg)
    easting, northing = project(np.array([[longitude_deg, latitude_deg]]), WGS84, crs)[0].round()
    return place_metres(crs, float(easting), float(northing))


def _project_to_mercator(points: FloatArray, crs: str) -> FloatArray:
    degrees = project(points, crs, WGS84)
    if np.abs(degrees[:, 1]).max() > UTM_NORTH_DEG + 1.0:
        raise ServiceError("The place lies at a pole, where maps have no background.", parameter="crs")
    longitudes_deg = degrees[0, 0] + np.remainder(degrees[:, 0] - degrees[0, 0] + 180.0, 360.0) - 180.0
    radius_m = HALF_WIDTH_M / math.pi
    northing = radius_m * np.arctanh(np.sin(np.radians(degrees[:, 1])))
    return np.column_stack([radius_m * np.radians(longitudes_deg), northing])


def _fit_polynomial(points_m: FloatArray, values_m: FloatArray) -> tuple[list[list[float]], float]:
    """Coefficients for both values, by least squares, and the largest residual."""
    u, v = (points_m / UNIT_M).T
    terms = np.stack([u ** (total - j) * v**j for total in range(DEGREE + 1) for j in range(total + 1)], axis=1)
    solution = np.linalg.lstsq(terms, values_m, rcond=None)[0]
    return solution.T.tolist(), float(np.abs(terms @ solution - values_m).max())


class TileError(ServiceError):
    """A tile that cannot be had now, or is no picture."""

    http_status = 503


def identify_tile(content: bytes) -> str:
    """The media type of a tile; raises TileError for anything but a small picture. Only its header is read."""
    from PIL import Image, UnidentifiedImageError

    if len(content) > MOST_TILE_BYTES:
        raise TileError(f"A tile of the background is larger than {MOST_TILE_BYTES // 2**20} MB; use another server.")
    try:
        with Image.open(io.BytesIO(content), formats=list(MEDIA_BY_FORMAT)) as image:
            width, height, name = image.width, image.height, str(image.format)
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        raise TileError(
            "The background sent something other than a PNG, JPEG or WebP picture; check its address."
        ) from None
    if max(width, height) > LIMITS.most_side_px:
        raise TileError(
            f"A tile of the background has {width} x {height} pixels; use a server whose tiles have at most "
            f"{LIMITS.most_side_px} x {LIMITS.most_side_px}."
        )
    return MEDIA_BY_FORMAT[name]


def encode_png(pixels: npt.NDArray[np.uint8]) -> bytes:
    """PNG of an array of shape (rows, columns, 4), 8 bits."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", compress_level=3)
    return stream.getvalue()
