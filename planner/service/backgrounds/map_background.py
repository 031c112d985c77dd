"""The background of maps as the settings have it, and its routes: none, a tile server, or a file.

Files are of the service's own disk: MBTiles (SQLite) and GeoTIFF.
"""

from __future__ import annotations

import contextlib
import io
import sqlite3
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import Path as PathParameter
from fastapi import Query, Response
from starlette.concurrency import run_in_threadpool

from fields.geometry.coordinates import MAX_COORDINATE
from planner.service.access.permissions import ReadAccess
from planner.service.backgrounds.tile_server import (
    CACHE_FOLDER,
    HALF_WIDTH_M,
    HIGHEST_ZOOM,
    MEDIA_BY_FORMAT,
    MERCATOR,
    MOST_TILE_BYTES,
    TILE_PX,
    WGS84,
    PlacementInfo,
    Tile,
    TileAddress,
    TileCache,
    TileError,
    TileServer,
    identify_tile,
    is_address,
    place_degrees,
    place_metres,
)
from planner.service.errors import ServiceError
from planner.service.gateway.responses import ApiModel, ApiRouter, document_file, require_state
from planner.service.settings import LIMITS, MEGABYTE_BYTES, ServiceSettings

MBTILES_SUFFIX, GEOTIFF_SUFFIXES = ".mbtiles", (".tif", ".tiff")
PICTURE_FORMATS = ("png", "jpg", "jpeg", "webp")
DegreeBounds = tuple[float, float, float, float]
TILE_HEADERS = {"cache-control": "private, max-age=86400"}


class BackgroundInfo(ApiModel):
    """The background of maps: where its tiles come from, whose they are, their zooms, and the bounds in degrees (west,
    south, east, north)."""

    kind: Literal["none", "address", "mbtiles", "geotiff"] = "none"
    attribution: str = ""
    least_zoom: int = 0
    most_zoom: int = 0
    tile_px: int = TILE_PX
    bounds_deg: Sequence[float] | None = None


class MbtilesFile:
    """Tiles in an SQLite file (MBTiles 1.3), opened for reading only."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.facts = self._read_facts()

    def read_tile(self, tile: Tile) -> bytes | None:
        """The bytes of a tile, None where the file has none. Raises TileError."""
        query = (
            "SELECT length(tile_data), CASE WHEN length(tile_data) <= ? THEN tile_data END FROM tiles "
            "WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        )
        values = (MOST_TILE_BYTES, tile.zoom, tile.column, tile.row_from_south)
        with self._open_database() as database:
            found = database.execute(query, values).fetchone()
        if found is None or not found[0]:
            return None
        if not isinstance(found[1], bytes):
            raise TileError(f"A tile of {self.path.name} is no picture or larger than {MOST_TILE_BYTES // 2**20} MB.")
        return found[1]

    def _read_facts(self) -> BackgroundInfo:
        with self._open_database() as database:
            pairs = database.execute("SELECT name, value FROM metadata").fetchmany(1_000)
            least, most = database.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
        values = {str(name): str(value) for name, value in pairs}
        form = values.get("format", "png")
        if form not in PICTURE_FORMATS:
            raise ServiceError(
                f"The tiles of {self.path.name} are {form[:20]!r}; give an MBTiles file of PNG, JPEG or WebP pictures.",
                parameter="background",
            )
        if not (isinstance(least, int) and isinstance(most, int) and 0 <= least <= most):
            raise ServiceError(f"{self.path.name} has no tiles; give another file.", parameter="background")
        attribution = values.get("attribution", "")[: LIMITS.longest_text_chars]
        return BackgroundInfo(
            kind="mbtiles", attribution=attribution, least_zoom=least, most_zoom=min(most, HIGHEST_ZOOM),
            bounds_deg=_parse_bounds(values.get("bounds", "")),
        )  # fmt: skip

    @contextlib.contextmanager
    def _open_database(self) -> Iterator[sqlite3.Connection]:
        try:
            with contextlib.closing(sqlite3.connect(f"{self.path.resolve().as_uri()}?mode=ro", uri=True)) as database:
                yield database
        except sqlite3.Error as error:
            raise TileError(
                f"{self.path.name} cannot be read as MBTiles ({error}); give another file.", parameter="background"
            ) from None


class GeoTiffFile:
    """A GeoTIFF of 8 bits, grey or in colours, drawn anew for every tile; needs the library rasterio."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()  # a dataset of GDAL belongs to one thread at a time
        try:
            import rasterio
            import rasterio.errors
        except ImportError:
            raise ServiceError(
                "A GeoTIFF as background needs rasterio; install it with pip install 'headland[geotiff]', or give an "
                "MBTiles file.",
                parameter="background",
            ) from None
        self._rasterio: Any = rasterio
        self.facts = self._read_facts()

    def read_tile(self, tile: Tile) -> bytes | None:
        """PNG of a tile, None where the picture does not reach. Raises TileError."""
        from PIL import Image
        from rasterio.enums import ColorInterp, Resampling
        from rasterio.vrt import WarpedVRT

        west, south, _, north = tile.compute_bounds_m()
        pixel_m = (north - south) / TILE_PX
        place = self._rasterio.Affine(pixel_m, 0.0, west, 0.0, -pixel_m, north)
        with self._lock, self._open_picture() as picture:
            has_alpha = ColorInterp.alpha in picture.colorinterp
            with WarpedVRT(
                picture, crs=MERCATOR, transform=place, width=TILE_PX, height=TILE_PX,
                resampling=Resampling.bilinear, add_alpha=not has_alpha,
            ) as warped:  # fmt: skip
                bands = warped.read()
        alpha = bands[-1]
        if not alpha.any():
            return None
        colours = bands[:3] if len(bands) > 3 else np.repeat(bands[:1], 3, axis=0)
        pixels = np.ascontiguousarray(np.moveaxis(np.vstack([colours, alpha[None]]), 0, -1))
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, "PNG", compress_level=3)
        return stream.getvalue()

    def _read_facts(self) -> BackgroundInfo:
        from rasterio.enums import ColorInterp
        from rasterio.warp import transform_bounds

        with self._open_picture() as picture:
            if picture.crs is None:
                raise self._refuse("does not say where on the earth it lies", "give one with a coordinate system")
            if any(kind != "uint8" for kind in picture.dtypes):
                raise self._refuse(
                    f"has values of {picture.dtypes[0]}", "convert it with gdal_translate -ot Byte -scale"
                )
            if ColorInterp.palette in picture.colorinterp:
                raise self._refuse("has a palette", "convert it with gdal_translate -expand rgb")
            west, south, east, north = transform_bounds(picture.crs, MERCATOR, *picture.bounds)
            pixel_m = min((east - west) / picture.width, (north - south) / picture.height)
            bounds = transform_bounds(picture.crs, WGS84, *picture.bounds)
            has_overviews = bool(picture.overviews(1))
        # The first zoom whose pixels are no larger than those of the picture.
        zoom = int(np.ceil(np.log2(2.0 * HALF_WIDTH_M / (TILE_PX * max(pixel_m, 1e-3)))))
        finest = min(max(zoom, 0), HIGHEST_ZOOM)
        widest = int(np.log2(LIMITS.most_pixels_per_tile / TILE_PX**2) / 2)
        least = 0 if has_overviews else max(0, finest - widest)
        return BackgroundInfo(kind="geotiff", least_zoom=least, most_zoom=finest, bounds_deg=tuple(bounds))

    @contextlib.contextmanager
    def _open_picture(self) -> Iterator[Any]:
        try:
            with self._rasterio.open(self.path, driver="GTiff") as picture:
                yield picture
        except (self._rasterio.errors.RasterioError, self._rasterio.errors.CRSError) as error:
            raise TileError(
                f"{self.path.name} cannot be read as a GeoTIFF ({error}); give another file.", parameter="background"
            ) from None

    def _refuse(self, fault: str, fix: str) -> ServiceError:
        return ServiceError(f"{self.path.name} {fault}; {fix}.", parameter="background")


def _parse_bounds(text: str) -> DegreeBounds | None:
    """Bounds as MBTiles has them: four numbers with commas."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        return None
    is_usable = -180.0 <= west <= east <= 180.0 and -90.0 <= south <= north <= 90.0
    return (west, south, east, north) if is_usable else None


class MapBackground:
    """The background of maps, with its `facts`. Raises ServiceError for settings that cannot be."""

    def __init__(self, settings: ServiceSettings) -> None:
        self._source = _open_source(settings)
        self.facts = BackgroundInfo()
        if isinstance(self._source, TileServer):
            self.facts = BackgroundInfo(kind="address", most_zoom=settings.background_zoom)
        elif self._source is not None:
            self.facts = self._source.facts
        attribution = " ".join(settings.background_attribution.split())[: LIMITS.longest_text_chars]
        if self._source is not None and attribution:
            self.facts = self.facts.model_copy(update={"attribution": attribution})

    async def read_tile(self, tile: Tile) -> tuple[bytes, str] | None:
        """The bytes of a tile and their media type, None where there is none. Raises TileError."""
        source = self._source
        if source is None or not self.facts.least_zoom <= tile.zoom <= self.facts.most_zoom:
            return None
        if isinstance(source, TileServer):
            content = await source.read_tile(tile)
        else:
            content = await run_in_threadpool(source.read_tile, tile)
        return None if content is None else (content, await run_in_threadpool(identify_tile, content))

    async def close(self) -> None:
        """End all requests to a tile server."""
        if isinstance(self._source, TileServer):
            await self._source.close()


def _open_source(settings: ServiceSettings) -> TileServer | MbtilesFile | GeoTiffFile | None:
    text = settings.background.strip()
    if not text:
        return None
    if not 1 <= settings.background_zoom <= HIGHEST_ZOOM:
        raise ServiceError(
            f"The finest zoom of the background is {settings.background_zoom}; use 1 to {HIGHEST_ZOOM}.",
            parameter="background_zoom",
        )
    if settings.background_cache_mb < 0:
        raise ServiceError(
            f"The room for tiles is {settings.background_cache_mb} MB; use 0 or more.", parameter="background_cache_mb"
        )
    if is_address(text):
        most_bytes = settings.background_cache_mb * MEGABYTE_BYTES
        cache = TileCache(settings.data / CACHE_FOLDER, text, most_bytes, settings.reserve_mb * MEGABYTE_BYTES)
        return TileServer(TileAddress(text), cache)
    path = Path(text)
    if path.suffix.lower() not in (MBTILES_SUFFIX, *GEOTIFF_SUFFIXES):
        raise ServiceError(
            f"The background {str(path)[:80]!r} is neither an address nor an .mbtiles or .tif file; give one of these.",
            parameter="background",
        )
    if not path.is_file():
        raise ServiceError(
            f"There is no background {str(path)[:80]!r}; check its name and its folder.", parameter="background"
        )
    return MbtilesFile(path) if path.suffix.lower() == MBTILES_SUFFIX else GeoTiffFile(path)


background_router = ApiRouter(prefix="/background", tags=["background"])
BackgroundAccess = Annotated[MapBackground, require_state("background")]


@background_router.get("", operation_id="read_background")
def read_background(background: BackgroundAccess, _who: ReadAccess) -> BackgroundInfo:
    """The background of maps; `kind` is none where the service has none."""
    return background.facts


@background_router.get(
    "/tiles/{zoom}/{column}/{row}",
    response_class=Response,
    responses=document_file("The picture", MEDIA_BY_FORMAT.values())
    | {204: {"description": "There is no picture of this place at this zoom"}},
    operation_id="read_background_tile",
)
async def read_background_tile(
    background: BackgroundAccess,
    _who: ReadAccess,
    zoom: Annotated[int, PathParameter(ge=0, le=HIGHEST_ZOOM)],
    column: Annotated[int, PathParameter(ge=0, lt=2**HIGHEST_ZOOM)],
    row: Annotated[int, PathParameter(ge=0, lt=2**HIGHEST_ZOOM, description="Counted from the north.")],
) -> Response:
    """A tile of the background in the grid of web maps (XYZ)."""
    picture = await background.read_tile(Tile(zoom, column, row))
    if picture is None:
        return Response(status_code=204, headers=TILE_HEADERS)
    return Response(picture[0], media_type=picture[1], headers=TILE_HEADERS)


@background_router.get("/placement", operation_id="read_background_placement")
async def read_background_placement(
    _who: ReadAccess,
    crs: Annotated[
        str | None, Query(pattern=r"^[A-Z]{2,10}:\d{1,6}$", description="System of easting and northing: EPSG:32632.")
    ] = None,
    easting: Annotated[float | None, Query(ge=-MAX_COORDINATE, le=MAX_COORDINATE, description="Metres.")] = None,
    northing: Annotated[float | None, Query(ge=-MAX_COORDINATE, le=MAX_COORDINATE, description="Metres.")] = None,
    longitude: Annotated[float | None, Query(ge=-180, le=180, description="Degrees.")] = None,
    latitude: Annotated[float | None, Query(ge=-90, le=90, description="Degrees.")] = None,
) -> PlacementInfo:
    """Where a place lies on the background: in metres of a system, or in degrees and metres of its UTM zone."""
    is_in_metres, is_in_degrees = (longitude, latitude) == (None, None), (crs, easting, northing) == (None, None, None)
    if is_in_metres and crs is not None and easting is not None and northing is not None:
        return await run_in_threadpool(place_metres, crs, easting, northing)
    if is_in_degrees and longitude is not None and latitude is not None:
        return await run_in_threadpool(place_degrees, longitude, latitude)
    raise ServiceError("Give crs, easting and northing, or longitude and latitude.")
