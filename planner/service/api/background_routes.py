"""Routes for the background of maps: what there is, its tiles, and where a field lies on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from planner.service.access.permissions import Caller, require_right
from planner.service.backgrounds.map_background import MapBackground
from planner.service.backgrounds.tile_addresses import TILE_PX
from planner.service.backgrounds.tile_grid import HIGHEST_ZOOM, Tile, place_degrees, place_metres
from planner.service.backgrounds.tile_images import MEDIA_BY_FORMAT
from planner.service.errors import ServiceError
from planner.service.gateway.responses import READ_ROUTE_ERRORS, ApiModel, document_errors

MOST_METRES = 1e8
TILE_HEADERS = {"cache-control": "private, max-age=86400"}
ReadAccess = Annotated[Caller, Depends(require_right("read"))]
background_router = APIRouter(prefix="/background", tags=["background"])


class BackgroundInfo(ApiModel):
    """The background of maps: where its tiles come from, whose they are, their zooms, and the bounds in degrees."""

    kind: Literal["none", "address", "mbtiles", "geotiff"]
    attribution: str
    least_zoom: int
    most_zoom: int
    tile_px: int
    bounds_deg: Sequence[float] | None


class PlacementInfo(ApiModel):
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


@background_router.get("", responses=READ_ROUTE_ERRORS, operation_id="read_background")
def read_background(request: Request, _who: ReadAccess) -> BackgroundInfo:
    """The background of maps; `kind` is none where the service has none."""
    background: MapBackground = request.app.state.background
    facts = background.facts
    return BackgroundInfo(
        kind=background.kind,
        attribution=background.attribution,
        least_zoom=0 if facts is None else facts.least_zoom,
        most_zoom=0 if facts is None else facts.most_zoom,
        tile_px=TILE_PX,
        bounds_deg=None if background.bounds_deg is None else list(background.bounds_deg),
    )


@background_router.get(
    "/tiles/{zoom}/{column}/{row}",
    response_class=Response,
    responses=document_errors(401, 403, 422)
    | {
        200: {"content": {media: {} for media in MEDIA_BY_FORMAT.values()}, "description": "The picture"},
        204: {"description": "There is no picture of this place at this zoom"},
    },
    operation_id="read_background_tile",
)
async def read_background_tile(
    request: Request,
    _who: ReadAccess,
    zoom: Annotated[int, Path(ge=0, le=HIGHEST_ZOOM)],
    column: Annotated[int, Path(ge=0, lt=2**HIGHEST_ZOOM)],
    row: Annotated[int, Path(ge=0, lt=2**HIGHEST_ZOOM, description="Counted from the north.")],
) -> Response:
    """A tile of the background in the grid of web maps (XYZ)."""
    background: MapBackground = request.app.state.background
    picture = await background.read_tile(Tile(zoom, column, row))
    if picture is None:
        return Response(status_code=204, headers=TILE_HEADERS)
    return Response(picture.content, media_type=picture.media, headers=TILE_HEADERS)


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
    if crs is not None and easting is not None and northing is not None and longitude is None and latitude is None:
        placement = await run_in_threadpool(place_metres, crs, easting, northing)
    elif crs is None and easting is None and northing is None and longitude is not None and latitude is not None:
        placement = await run_in_threadpool(place_degrees, longitude, latitude)
    else:
        raise ServiceError("Give crs, easting and northing, or longitude and latitude.")
    return PlacementInfo.model_validate(placement)
