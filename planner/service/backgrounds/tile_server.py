"""A background of a tile server, asked by the service itself, so that no browser ever asks anybody else.

The administrator gives its address as a template of XYZ, WMTS or WMS. Only numbers are put into it, behind its host, so
no request can lead to another host or path. Tiles are kept on the disk of the service: at most so many bytes, those
used longest ago go first.

Tiles are those of XYZ and of the WMTS matrix set GoogleMapsCompatible (OGC 07-057r7, annex E.4): spherical mercator,
row 0 in the north. Between these and the metres of a field a polynomial of degree 3 each way is exact to a millimetre
over REACH_M.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import io
import ipaddress
import math
import os
import re
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from fields.arrays import Floats
from fields.geometry.geodesy import UTM_NORTH_DEG, find_utm_crs, project
from planner.service.errors import ServiceError, StorageError
from planner.service.settings import CONNECT_TIMEOUT_S, LIMITS, MEGABYTE_BYTES
from planner.service.store.disk_storage import check_disk_space, write_whole

if TYPE_CHECKING:
    import httpx2

MERCATOR, WGS84 = "EPSG:3857", "EPSG:4326"
HALF_WIDTH_M = math.pi * 6_378_137.0
"""Half the side of the square that the tile of zoom 0 covers, metres of mercator."""
HIGHEST_ZOOM, TILE_PX = 22, 256
REACH_M = 6_000.0
DEGREE, GRID_POINTS, UNIT_M = 3, 9, 1_000.0
MOST_TILE_BYTES = 2 * MEGABYTE_BYTES
MEDIA_BY_FORMAT = {"PNG": "image/png", "JPEG": "image/jpeg", "WEBP": "image/webp"}
EXAMPLE = "https://tiles.example/{z}/{x}/{y}.png"
NAMES = {
    "z": "zoom", "x": "column", "y": "row", "-y": "row_from_south",
    "tilematrix": "zoom", "tilecol": "column", "tilerow": "row",
    "bbox": "bounds", "bbox-epsg-3857": "bounds", "width": "width", "height": "width",
}  # fmt: skip
"""What stands in braces, in small letters, and what it becomes; the words of XYZ, TMS, WMTS and WMS."""
BRACES = re.compile(r"\{([^{}]*)\}")
LABEL = r"[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?"
HOST = re.compile(rf"(?=.{{1,253}}$){LABEL}(?:\.{LABEL})*\.?")
CACHE_FOLDER = "background-tiles"
USER_AGENT = "Headland (farm planning; tiles are fetched once and kept)"
TILE_TIMEOUT_S = 15.0
PAUSE_S = 20.0
"""Seconds until a kept tile is fetched again, and until a tile that could not be had is asked for again."""
NOTHING_STATUSES = (HTTPStatus.NO_CONTENT, HTTPStatus.NOT_FOUND)


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
    degrees = project(np.vstack([origin, origin + around]), crs, WGS84)
    if np.abs(degrees[:, 1]).max() > UTM_NORTH_DEG + 1.0:
        raise ServiceError("The place lies at a pole, where maps have no background.", parameter="crs")
    longitudes_deg = degrees[0, 0] + np.remainder(degrees[:, 0] - degrees[0, 0] + 180.0, 360.0) - 180.0
    radius_m = HALF_WIDTH_M / math.pi
    northing = radius_m * np.arctanh(np.sin(np.radians(degrees[:, 1])))
    mercator = np.column_stack([radius_m * np.radians(longitudes_deg), northing])
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


def _fit_polynomial(points_m: Floats, values_m: Floats) -> tuple[list[list[float]], float]:
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


@dataclass(frozen=True)
class TileAddress:
    """A checked template; `host` is the only one that is ever asked. Raises ServiceError."""

    template: str

    def __post_init__(self) -> None:
        _check_text(self.template)
        try:
            parts, _ = urlsplit(self.template), urlsplit(self.template).port
        except ValueError:
            shown = self.template.rpartition("@")[2]  # without a password
            raise _refuse(shown, "has a host or port that cannot be", f"give one such as {EXAMPLE}") from None
        _check_host(parts.hostname or "", self.template)
        if BRACES.search(parts.netloc):
            raise _refuse(self.template, "names no single host", f"write one host, as in {EXAMPLE}")
        if parts.username is not None or parts.password is not None:
            fix = "give a server that needs none, or a key in the query"
            raise _refuse(parts.hostname or "", "holds a name and a password", fix)
        found = {NAMES[name.lower()] for name in BRACES.findall(self.template)}
        if not (found >= {"zoom", "column"} and found & {"row", "row_from_south"}) and "bounds" not in found:
            fix = "write {z}, {x} and {y} where zoom, column and row go"
            raise _refuse(self.template, "does not say which tile", fix)

    @property
    def host(self) -> str:
        """The host that is asked, for messages."""
        return urlsplit(self.template).hostname or ""

    def build_url(self, tile: Tile) -> str:
        """The address of a tile."""
        bounds = ",".join(f"{value:.6f}" for value in tile.compute_bounds_m())
        values = asdict(tile) | {"row_from_south": tile.row_from_south, "bounds": bounds, "width": TILE_PX}
        return BRACES.sub(lambda found: str(values[NAMES[found[1].lower()]]), self.template)


def is_address(text: str) -> bool:
    """Whether a background is an address rather than a file."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", text) is not None


def _check_text(template: str) -> None:
    if not template.isascii() or not template.isprintable() or " " in template or "\\" in template:
        raise _refuse(template, "has characters that an address cannot have", "write them as % codes")
    if len(template) > LIMITS.most_address_chars:
        raise _refuse(template, f"has {len(template)} characters", f"use at most {LIMITS.most_address_chars}")
    if not template.startswith(("https://", "http://")):
        raise _refuse(template, "is not an address of the web", f"give one such as {EXAMPLE}")
    for name in BRACES.findall(template):
        if name.lower() not in NAMES:
            raise _refuse(template, f"has {{{name[:20]}}}", "use {z}, {x}, {y}, {-y} or {bbox}")


def _check_host(host: str, template: str) -> None:
    """Refuse no host, and addresses at which only a machine's own management answers."""
    if not host:
        raise _refuse(template, "names no host", f"give one such as {EXAMPLE}")
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        if not HOST.fullmatch(BRACES.sub("a", host)):
            raise _refuse(host, "is no host that can be", f"give one such as {EXAMPLE}") from None
        return
    if address.is_link_local or address.is_multicast or address.is_unspecified:
        raise _refuse(template, f"asks {host}, where no map can be", "give the host of a tile server")


def _refuse(what: str, fault: str, fix: str) -> ServiceError:
    return ServiceError(f"The background {what[:80]!r} {fault}; {fix}.", parameter="background")


class TileCache:
    """Tiles of one background in a folder; a tile that cannot be stored is simply not kept.

    Args:
        folder: folder of all backgrounds; the limit holds for it as a whole.
        background: what names the background; others have folders of their own.
        most_bytes: the limit; 0 keeps nothing.
        reserve_bytes: bytes that stay free on the disk.
    """

    def __init__(
        self, folder: Path, background: str, most_bytes: int, reserve_bytes: int = 0,
        clock: Callable[[], float] = time.time,
    ) -> None:  # fmt: skip
        self._folder, self._most_bytes, self._reserve_bytes, self._clock = folder, most_bytes, reserve_bytes, clock
        self._own_folder = folder / hashlib.sha256(background.encode()).hexdigest()[:16]
        self._lock = threading.Lock()
        self._total_bytes: int | None = None

    def read_tile(self, tile: Tile) -> tuple[bytes, float] | None:
        """The bytes of a tile and its age in seconds; None where it is not kept."""
        path = self._get_path(tile)
        try:
            content, status = path.read_bytes(), path.stat()
        except OSError:
            return None
        with contextlib.suppress(OSError):
            os.utime(path, (self._clock(), status.st_mtime))  # read last now, fetched when it was
        return content, self._clock() - status.st_mtime

    def keep_tile(self, tile: Tile, content: bytes) -> None:
        """Keep a tile, and delete those used longest ago where the limit is passed."""
        if len(content) > self._most_bytes:
            return
        path = self._get_path(tile)
        with self._lock, contextlib.suppress(OSError, StorageError):
            check_disk_space(self._folder, len(content), self._reserve_bytes)
            before = path.stat().st_size if path.exists() else 0
            write_whole(path, content)
            os.utime(path, (self._clock(), self._clock()))
            if self._total_bytes is None:  # counted once
                self._total_bytes = sum(status.st_size for _, status in self._list_kept())
            else:
                self._total_bytes += len(content) - before
            if self._total_bytes > self._most_bytes:
                self._delete_oldest()

    def _list_kept(self) -> list[tuple[Path, os.stat_result]]:
        return [(path, path.stat()) for path in self._folder.rglob("*") if path.is_file()]

    def _delete_oldest(self) -> None:
        kept = self._list_kept()
        total = sum(status.st_size for _, status in kept)
        for path, status in sorted(kept, key=lambda one: one[1].st_atime):
            if total <= LIMITS.kept_share * self._most_bytes:
                break
            path.unlink(missing_ok=True)
            total -= status.st_size
        self._total_bytes = total

    def _get_path(self, tile: Tile) -> Path:
        return self._own_folder / str(tile.zoom) / f"{tile.column}-{tile.row}"


class TileServer:
    """Tiles by an address, from the cache or the server; several requests for one tile fetch it once."""

    def __init__(self, address: TileAddress, cache: TileCache) -> None:
        self.address, self._cache = address, cache
        self._client: httpx2.AsyncClient | None = None
        self._running: dict[Tile, asyncio.Task[bytes | None]] = {}
        self._failed: dict[Tile, tuple[float, TileError | None]] = {}
        self._slots = asyncio.Semaphore(LIMITS.most_fetches)

    async def close(self) -> None:
        """End all requests."""
        for task in self._running.values():
            task.cancel()
        if self._client is not None:
            await self._client.aclose()
            self._client = None

    async def read_tile(self, tile: Tile) -> bytes | None:
        """The bytes of a tile, None where the server has none. Raises TileError.

        A kept tile is used even where it is old and the server cannot be reached.
        """
        kept = await run_in_threadpool(self._cache.read_tile, tile)
        if kept is not None and kept[1] < LIMITS.fresh_s:
            return kept[0]
        try:
            return await self._fetch_shared(tile)
        except TileError:
            if kept is None:
                raise
            return kept[0]

    async def _fetch_shared(self, tile: Tile) -> bytes | None:
        failed_s, error = self._failed.get(tile, (0.0, None))
        if failed_s > time.monotonic() - PAUSE_S and tile in self._failed:
            if error is not None:
                raise error
            return None
        task = self._running.get(tile)
        if task is None:
            task = self._running[tile] = asyncio.create_task(self._fetch_and_keep(tile))

            def forget_fetch(done: asyncio.Task[bytes | None]) -> None:
                self._running.pop(tile, None)
                if not done.cancelled():
                    done.exception()  # who asked may have gone

            task.add_done_callback(forget_fetch)
        return await asyncio.shield(task)

    async def _fetch_and_keep(self, tile: Tile) -> bytes | None:
        try:
            async with asyncio.timeout(LIMITS.queue_timeout_s), self._slots:
                content = await self._fetch_tile(tile)
        except TimeoutError:
            self._remember_failure(tile, error := TileError(f"The tile server {self.address.host} is too slow now."))
            raise error from None
        except TileError as error:
            self._remember_failure(tile, error)
            raise
        if content is None:
            self._remember_failure(tile, None)
        else:
            await run_in_threadpool(self._cache.keep_tile, tile, content)
        return content

    def _remember_failure(self, tile: Tile, error: TileError | None) -> None:
        if len(self._failed) >= LIMITS.most_remembered:
            self._failed.clear()
        self._failed[tile] = time.monotonic(), error

    async def _fetch_tile(self, tile: Tile) -> bytes | None:
        """Take nothing but a plain answer of the host itself: redirections are not followed."""
        import httpx2

        content = bytearray()
        try:
            async with (
                asyncio.timeout(TILE_TIMEOUT_S),
                self._get_client().stream("GET", self.address.build_url(tile)) as response,
            ):
                if response.status_code in NOTHING_STATUSES:
                    return None
                if response.status_code != HTTPStatus.OK:
                    raise TileError(
                        f"The tile server {self.address.host} answers with status {response.status_code}; check the "
                        "address."
                    )
                if response.headers.get("content-encoding", "identity") != "identity":
                    raise TileError(f"The tile server {self.address.host} sends compressed pictures; use another one.")
                async for part in response.aiter_raw():
                    content += part
                    if len(content) > MOST_TILE_BYTES:
                        raise TileError(
                            f"A tile of {self.address.host} is larger than {MOST_TILE_BYTES // MEGABYTE_BYTES} MB; use "
                            "another server."
                        )
        except (httpx2.HTTPError, OSError) as error:
            raise TileError(
                f"The tile server {self.address.host} cannot be reached ({type(error).__name__}); maps have no "
                "background until it can."
            ) from None
        picture = bytes(content)
        await run_in_threadpool(identify_tile, picture)
        return picture

    def _get_client(self) -> httpx2.AsyncClient:
        import httpx2

        if self._client is None:
            headers = {"user-agent": USER_AGENT, "accept": ",".join(MEDIA_BY_FORMAT.values())}
            self._client = httpx2.AsyncClient(
                follow_redirects=False, trust_env=False, headers=headers | {"accept-encoding": "identity"},
                timeout=httpx2.Timeout(TILE_TIMEOUT_S, connect=CONNECT_TIMEOUT_S),
                limits=httpx2.Limits(max_connections=LIMITS.most_fetches),
            )  # fmt: skip
        return self._client
