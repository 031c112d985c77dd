"""Bodies of requests: a budget for all of them together, and a file for one that is large."""

from __future__ import annotations

import asyncio
import secrets
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from planner.service.settings import LIMITS, ServiceSettings
from planner.service.store.disk_storage import translate_disk_full

BODIES_FOLDER = "bodies"
UNCOUNTED_BYTES = 64 * 1024  # of each body; orders to fleets are no longer, and never wait for uploads of others
WRITTEN_BYTES = 2**18  # written at a time


class BodyBudget:
    """Bytes of bodies that are under way, of all clients and of each."""

    def __init__(self, settings: ServiceSettings) -> None:
        self.most_bytes = LIMITS.uploads_at_a_time * settings.upload_bytes
        self._by_client: Counter[str] = Counter()

    @property
    def held_bytes(self) -> int:
        """Bytes of all bodies under way beyond what is not counted."""
        return self._by_client.total()

    @contextmanager
    def open_share(self, client: str) -> Iterator[BodyShare]:
        """The share of one body, given back at the end."""
        share = BodyShare(self, client)
        try:
            yield share
        finally:
            self._add(client, -share.held_bytes)

    def _add(self, client: str, added_bytes: int) -> None:
        self._by_client[client] += added_bytes
        self._by_client += Counter()  # clients without a body are forgotten

    def has_room(self, client: str, added_bytes: int) -> bool:
        """Whether a body of a client may grow by so many bytes."""
        of_client = self._by_client[client] + added_bytes
        is_within = (
            of_client <= LIMITS.share_of_client * self.most_bytes and self.held_bytes + added_bytes <= self.most_bytes
        )
        return added_bytes <= 0 or is_within


class BodyShare:
    """What one body has of the budget."""

    def __init__(self, budget: BodyBudget, client: str) -> None:
        self._budget, self._client = budget, client
        self.held_bytes = 0

    def grow_to(self, size_bytes: int) -> bool:
        """Take as much as a body of this size needs; False, and nothing is taken, where there is no room."""
        added_bytes = max(size_bytes - UNCOUNTED_BYTES, self.held_bytes) - self.held_bytes
        if not self._budget.has_room(self._client, added_bytes):
            return False
        if added_bytes:
            self._budget._add(self._client, added_bytes)
            self.held_bytes += added_bytes
        return True


@asynccontextmanager
async def spool_body(stream: AsyncIterator[bytes], folder: Path) -> AsyncIterator[Path]:
    """A body in a file, which is gone afterwards; a thread writes it, so it takes no memory and nobody waits for it.

    Raises StorageError where there is no room.
    """
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / secrets.token_hex(8)
    try:
        with translate_disk_full(), open(path, "xb") as file:
            waiting, waiting_bytes = list[bytes](), 0
            async for part in stream:
                waiting.append(part)
                waiting_bytes += len(part)
                if waiting_bytes >= WRITTEN_BYTES:
                    await asyncio.to_thread(file.writelines, waiting)
                    waiting, waiting_bytes = [], 0
            await asyncio.to_thread(file.writelines, waiting)
        yield path
    finally:
        path.unlink(missing_ok=True)
