"""The background of maps as the settings have it: none, a tile server, or a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from starlette.concurrency import run_in_threadpool

from planner.service.backgrounds.tile_addresses import TileAddress, is_address
from planner.service.backgrounds.tile_cache import CACHE_FOLDER, TileCache
from planner.service.backgrounds.tile_files import (
    MOST_TEXT_CHARS,
    DegreeBounds,
    FileFacts,
    GeoTiffFile,
    MbtilesFile,
    open_tile_file,
)
from planner.service.backgrounds.tile_grid import HIGHEST_ZOOM, Tile
from planner.service.backgrounds.tile_images import identify_tile
from planner.service.backgrounds.tile_server import TileServer
from planner.service.errors import ServiceError
from planner.service.settings import MEGABYTE_BYTES, ServiceSettings


@dataclass(frozen=True)
class TilePicture:
    """A tile as it is sent."""

    content: bytes
    media: str


class MapBackground:
    """The background of maps; `facts` are None without one. Raises ServiceError for settings that cannot be."""

    def __init__(self, settings: ServiceSettings) -> None:
        self._source = _open_source(settings)
        self.kind: Literal["none", "address", "mbtiles", "geotiff"] = (
            "none" if self._source is None else self._source.kind
        )
        self.facts = self._find_facts(settings)

    @property
    def attribution(self) -> str:
        """Whose picture it is; shown on every map."""
        return "" if self.facts is None else self.facts.attribution

    @property
    def bounds_deg(self) -> DegreeBounds | None:
        """West, south, east and north of what there is, degrees; None for everywhere."""
        return None if self.facts is None else self.facts.bounds_deg

    async def read_tile(self, tile: Tile) -> TilePicture | None:
        """A tile, None where there is none. Raises TileError."""
        source = self._source
        if source is None or self.facts is None or not self.facts.least_zoom <= tile.zoom <= self.facts.most_zoom:
            return None
        if isinstance(source, TileServer):
            content = await source.read_tile(tile)
        else:
            content = await run_in_threadpool(source.read_tile, tile)
        return None if content is None else TilePicture(content, await run_in_threadpool(identify_tile, content))

    async def close(self) -> None:
        """End all requests to a tile server."""
        if isinstance(self._source, TileServer):
            await self._source.close()

    def _find_facts(self, settings: ServiceSettings) -> FileFacts | None:
        if self._source is None:
            return None
        given = " ".join(settings.background_attribution.split())[:MOST_TEXT_CHARS]
        if isinstance(self._source, TileServer):
            return FileFacts(given, 0, settings.background_zoom, None)
        facts = self._source.facts
        return FileFacts(given or facts.attribution, facts.least_zoom, facts.most_zoom, facts.bounds_deg)


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
