"""The background of maps as the settings have it (none, a tile server, or a file), and its routes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi import Path as PathParameter
from starlette.concurrency import run_in_threadpool

from planner.service.access.permissions import ReadAccess
from planner.service.backgrounds.tile_files import (
    MOST_TEXT_CHARS,
    FileFacts,
    GeoTiffFile,
    MbtilesFile,
    open_tile_file,
)
from planner.service.backgrounds.tile_grid import (
    HIGHEST_ZOOM,
    MEDIA_BY_FORMAT,
    TILE_PX,
    PlacementInfo,
    Tile,
    identify_tile,
    place_degrees,
    place_metres,
)
from planner.service.backgrounds.tile_server import CACHE_FOLDER, TileAddress, TileCache, TileServer, is_address
from planner.service.errors import ServiceError
from planner.service.gateway.responses import READ_ROUTE_ERRORS, ApiModel, document_file
from planner.service.settings import MEGABYTE_BYTES, ServiceSettings

MOST_METRES = 1e8
TILE_HEADERS = {"cache-control": "private, max-age=86400"}


class MapBackground:
    """The background of maps, with its `kind` and `facts`. Raises ServiceError for settings that cannot be."""

    def __init__(self, settings: ServiceSettings) -> None:
        self.kind: Literal["none", "address", "mbtiles", "geotiff"] = "none"
        self.facts = FileFacts("", 0, 0, None)
        self._source = _open_source(settings)
        if self._source is None:
            return
        self.kind, attribution = self._source.kind, " ".join(settings.background_attribution.split())
        if isinstance(self._source, TileServer):
            self.facts = FileFacts("", 0, settings.background_zoom, None)
        else:
            self.facts = self._source.facts
        self.facts = replace(self.facts, attribution=attribution[:MOST_TEXT_CHARS] or self.facts.attribution)

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
    if not is_address(text):
        return open_tile_file(Path(text))
    most_bytes = settings.background_cache_mb * MEGABYTE_BYTES
    cache = TileCache(settings.data / CACHE_FOLDER, text, most_bytes, settings.reserve_mb * MEGABYTE_BYTES)
    return TileServer(TileAddress(text), cache)


background_router = APIRouter(prefix="/background", tags=["background"])


class BackgroundInfo(ApiModel):
    """The background of maps: where its tiles come from, whose they are, their zooms, and the bounds in degrees."""

    kind: Literal["none", "address", "mbtiles", "geotiff"]
    attribution: str
    least_zoom: int
    most_zoom: int
    tile_px: int
    bounds_deg: Sequence[float] | None


@background_router.get("", responses=READ_ROUTE_ERRORS, operation_id="read_background")
def read_background(request: Request, _who: ReadAccess) -> BackgroundInfo:
    """The background of maps; `kind` is none where the service has none."""
    background: MapBackground = request.app.state.background
    return BackgroundInfo(kind=background.kind, tile_px=TILE_PX, **asdict(background.facts))


@background_router.get(
    "/tiles/{zoom}/{column}/{row}",
    response_class=Response,
    responses=READ_ROUTE_ERRORS
    | document_file("The picture", MEDIA_BY_FORMAT.values())
    | {204: {"description": "There is no picture of this place at this zoom"}},
    operation_id="read_background_tile",
)
async def read_background_tile(
    request: Request,
    _who: ReadAccess,
    zoom: Annotated[int, PathParameter(ge=0, le=HIGHEST_ZOOM)],
    column: Annotated[int, PathParameter(ge=0, lt=2**HIGHEST_ZOOM)],
    row: Annotated[int, PathParameter(ge=0, lt=2**HIGHEST_ZOOM, description="Counted from the north.")],
) -> Response:
    """A tile of the background in the grid of web maps (XYZ)."""
    background: MapBackground = request.app.state.background
    picture = await background.read_tile(Tile(zoom, column, row))
    if picture is None:
        return Response(status_code=204, headers=TILE_HEADERS)
    return Response(picture[0], media_type=picture[1], headers=TILE_HEADERS)


@background_router.get("/placement", responses=READ_ROUTE_ERRORS, operation_id="read_background_placement")
async def read_background_placement(
    _who: ReadAccess,
    crs: Annotated[
        str | None, Query(pattern=r"^[A-Z]{2,10}:\d{1,6}$", description="System of easting and northing: EPSG:32632.")
    ] = None,
    easting: Annotated[float | None, Query(ge=-MOST_METRES, le=MOST_METRES, description="Metres.")] = None,
    northing: Annotated[float | None, Query(ge=-MOST_METRES, le=MOST_METRES, description="Metres.")] = None,
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
