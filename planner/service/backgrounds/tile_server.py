"""A background of a tile server, asked by the service itself, so that no browser ever asks anybody else."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Literal

from starlette.concurrency import run_in_threadpool

from planner.service.backgrounds.tile_addresses import TileAddress
from planner.service.backgrounds.tile_cache import TileCache
from planner.service.backgrounds.tile_grid import Tile
from planner.service.backgrounds.tile_images import MOST_TILE_BYTES, TileError, identify_tile

if TYPE_CHECKING:
    import httpx2

USER_AGENT = "Headland (farm planning; tiles are fetched once and kept)"
CONNECT_TIMEOUT_S, TILE_TIMEOUT_S, QUEUE_TIMEOUT_S = 5.0, 15.0, 30.0
MOST_FETCHES = 4
FRESH_S, PAUSE_S = 30 * 86_400.0, 20.0
"""Seconds until a kept tile is fetched again, and until a tile that could not be had is asked for again."""
MOST_REMEMBERED = 5_000
NOTHING_STATUSES = (204, 404)


class TileServer:
    """Tiles by an address, from the cache or the server; several requests for one tile fetch it once."""

    kind: Literal["address"] = "address"

    def __init__(self, address: TileAddress, cache: TileCache) -> None:
        self.address, self._cache = address, cache
        self._client: httpx2.AsyncClient | None = None
        self._running: dict[Tile, asyncio.Task[bytes | None]] = {}
        self._failed: dict[Tile, tuple[float, TileError | None]] = {}
        self._slots = asyncio.Semaphore(MOST_FETCHES)

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
        if kept is not None and kept[1] < FRESH_S:
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
            task.add_done_callback(lambda done: self._forget_fetch(tile, done))
        return await asyncio.shield(task)

    def _forget_fetch(self, tile: Tile, done: asyncio.Task[bytes | None]) -> None:
        self._running.pop(tile, None)
        if not done.cancelled():
            done.exception()  # who asked may have gone

    async def _fetch_and_keep(self, tile: Tile) -> bytes | None:
        try:
            async with asyncio.timeout(QUEUE_TIMEOUT_S), self._slots:
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
        if len(self._failed) >= MOST_REMEMBERED:
            self._failed.clear()
        self._failed[tile] = time.monotonic(), error

    async def _fetch_tile(self, tile: Tile) -> bytes | None:
        import httpx2

        try:
            async with asyncio.timeout(TILE_TIMEOUT_S):
                async with self._get_client().stream("GET", self.address.build_url(tile)) as response:
                    if response.status_code in NOTHING_STATUSES:
                        return None
                    self._check_response(response)
                    content = await self._read_body(response)
        except (httpx2.HTTPError, OSError) as error:
            raise TileError(
                f"The tile server {self.address.host} cannot be reached ({type(error).__name__}); maps have no "
                "background until it can."
            ) from None
        await run_in_threadpool(identify_tile, content)
        return content

    def _check_response(self, response: httpx2.Response) -> None:
        """Refuse anything but a plain answer of the host itself; redirections are not followed."""
        if response.status_code != 200:
            raise TileError(
                f"The tile server {self.address.host} answers with status {response.status_code}; check the address."
            )
        if response.headers.get("content-encoding", "identity") != "identity":
            raise TileError(f"The tile server {self.address.host} sends compressed pictures; use another one.")

    async def _read_body(self, response: httpx2.Response) -> bytes:
        content = bytearray()
        async for part in response.aiter_raw():
            content += part
            if len(content) > MOST_TILE_BYTES:
                raise TileError(
                    f"A tile of {self.address.host} is larger than {MOST_TILE_BYTES // 2**20} MB; use another server."
                )
        return bytes(content)

    def _get_client(self) -> httpx2.AsyncClient:
        import httpx2

        if self._client is None:
            self._client = httpx2.AsyncClient(
                follow_redirects=False,
                trust_env=False,
                timeout=httpx2.Timeout(TILE_TIMEOUT_S, connect=CONNECT_TIMEOUT_S),
                limits=httpx2.Limits(max_connections=MOST_FETCHES),
                headers={
                    "user-agent": USER_AGENT,
                    "accept": "image/png,image/jpeg,image/webp",
                    "accept-encoding": "identity",
                },
            )
        return self._client
