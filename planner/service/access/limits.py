"""How much is taken: requests a minute from one address, bytes in one body."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Callable

from sqlalchemy.exc import DBAPIError
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from planner.service.settings import MEGABYTE, Settings

API = "/api/"
UPLOADS = tuple(f"{API}v1/{kind}" for kind in ("fields", "tractors", "farms", "logs", "tables", "fleets"))
STOP = re.compile(rf"{API}v1/fleets/[^/]+/stop/?")
FORM_BYTES = 64 * 1024  # what a form may have round its file
MOST_ADDRESSES = 10_000


class Buckets:
    """So many tokens a minute for each address, at most a minute's at once (Turner's token bucket)."""

    def __init__(self, per_minute: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._clock = float(per_minute), clock
        self._left: dict[str, tuple[float, float]] = {}

    def wait_s(self, address: str) -> float:
        """Take one; seconds until there is one where there is none, else 0."""
        now = self._clock()
        left, before = self._left.get(address, (self._most, now))
        left = min(self._most, left + (now - before) * self._most / 60.0)
        taken = left >= 1.0
        if len(self._left) >= MOST_ADDRESSES:
            self._forget(now)
        self._left[address] = (left - 1.0 if taken else left, now)
        return 0.0 if taken else (1.0 - left) * 60.0 / self._most

    def _forget(self, now: float) -> None:
        """Addresses that were not heard of for a minute have all of theirs again."""
        self._left = {key: each for key, each in self._left.items() if now - each[1] < 60.0}


class Limits:
    """Answers 429 to who asks too often, and 413 to bodies that are too large, before anything reads them.

    An order to stop with a token that is known is carried out however often was asked.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app, self.settings = app, settings
        self.buckets = Buckets(settings.rate_per_minute)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As of ASGI."""
        if scope["type"] != "http" or not scope["path"].startswith(API):
            await self.app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        wait_s = self.buckets.wait_s((scope.get("client") or ("",))[0])
        if wait_s > 0 and not (_stops(scope) and await _known(scope, headers.get(b"authorization", b""))):
            sentence = f"More than {self.settings.rate_per_minute} requests in a minute; ask again later."
            await _refused(429, sentence, {"retry-after": str(int(wait_s) + 1)})(scope, receive, send)
            return
        length = headers.get(b"content-length", b"")
        most = MEGABYTE
        # Only who may send much, and does, costs a look at the database.
        if self._most(scope["path"]) > MEGABYTE and not (length.isdigit() and int(length) <= MEGABYTE):
            most = self._most(scope["path"]) if await _known(scope, headers.get(b"authorization", b"")) else MEGABYTE
        if length.isdigit() and int(length) > most:
            await _refused(413, _too_large(most), {"connection": "close"})(scope, receive, send)
            return
        await self.app(scope, _counted(receive, most), send)

    def _most(self, path: str) -> int:
        """The largest body that a path takes, bytes."""
        return self.settings.upload_bytes + FORM_BYTES if path.rstrip("/") in UPLOADS else MEGABYTE


def _stops(scope: Scope) -> bool:
    """Whether a request orders a fleet to stand: that is never refused for having asked too often."""
    return bool(scope["method"] == "POST" and STOP.fullmatch(scope["path"]))


async def _known(scope: Scope, header: bytes) -> bool:
    """Whether a request has a token that is known here."""
    kind, _, text = header.decode("latin-1").partition(" ")
    if kind.lower() != "bearer" or not text.strip():
        return False
    try:
        return await asyncio.to_thread(scope["app"].state.store.token, text.strip()) is not None
    except DBAPIError:
        return False


def _counted(receive: Receive, most: int) -> Receive:
    """The same, but a body that goes on for longer than it may is refused."""
    got = 0

    async def counting() -> Message:
        nonlocal got
        message = await receive()
        got += len(message.get("body", b""))
        if got > most:
            raise HTTPException(413, _too_large(most))
        return message

    return counting


def _too_large(most: int) -> str:
    return f"The body is larger than the {most // MEGABYTE} MB that are taken here; send less (a token may send more)."


def _refused(status: int, sentence: str, headers: dict[str, str]) -> JSONResponse:
    return JSONResponse({"error": sentence, "parameter": None}, status, headers)
