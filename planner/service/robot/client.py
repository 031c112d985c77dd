"""The link of a robot: ten states a second, and again and again a new connection when one is lost."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
import urllib.error
import urllib.request
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from planner.service.errors import ServiceError
from planner.service.robot.driver import Driver
from planner.service.robot.sending import Unacknowledged

PERIOD_S, AGAIN_S, OPEN_S = 0.1, 0.5, 5.0
REFUSED = 1008


class Robot:
    """A driver and its link. `token` may be None where none is needed."""

    def __init__(self, driver: Driver, url: str, fleet: str, tractor: int, token: str | None) -> None:
        self.driver, self.tractor, self.token = driver, tractor, token
        self.address = f"{url.rstrip('/').replace('http', 'ws', 1)}/api/v1/fleets/{fleet}/link"
        self.waiting = Unacknowledged()
        self._link: ClientConnection | None = None

    async def run(self, seconds: float | None = None) -> None:
        """Drive until cancelled, done or for so long. Raises ServiceError when the service does not let it in."""
        linking = asyncio.create_task(self._stay_linked())
        driving = asyncio.create_task(self._drive(seconds))
        try:
            done, _ = await asyncio.wait({linking, driving}, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            linking.cancel()
            driving.cancel()
            await asyncio.gather(linking, driving, return_exceptions=True)

    async def _drive(self, seconds: float | None) -> None:
        begin = due = time.monotonic()
        while seconds is None or time.monotonic() - begin < seconds:
            state = self.driver.step(time.monotonic())
            if self.driver.welcomed:  # before, it does not know where it is
                await self._send(self.waiting.add(state))
            due = max(due + PERIOD_S, time.monotonic() - PERIOD_S)
            await asyncio.sleep(max(0.0, due - time.monotonic()))
        await self._send('{"kind":"goodbye"}')

    async def _send(self, text: str) -> None:
        if self._link is not None:
            with contextlib.suppress(ConnectionClosed, asyncio.TimeoutError):
                await asyncio.wait_for(self._link.send(text), PERIOD_S)

    async def _stay_linked(self) -> None:
        while True:
            try:
                async with connect(self.address, open_timeout=OPEN_S, proxy=None, compression=None) as link:
                    await self._linked(link)
            except (OSError, ConnectionClosed, TimeoutError):
                pass
            finally:
                self._link = None
            await asyncio.sleep(AGAIN_S)

    async def _linked(self, link: ClientConnection) -> None:
        hello = {"kind": "hello", "role": "tractor", "tractor": self.tractor, "token": self.token, "version": 1}
        await link.send(json.dumps(hello))
        welcome = json.loads(await link.recv())
        if welcome["kind"] == "refused":
            raise ServiceError(f"The service does not let tractor {self.tractor} in: {welcome['sentence']}")
        self.waiting.acknowledged(welcome["last_sequence"])
        self.driver.heard(welcome, time.monotonic())
        for text in self.waiting.texts():
            await link.send(text)
        self._link = link
        async for message in link:
            self._hear(json.loads(message))

    def _hear(self, frame: dict[str, Any]) -> None:
        if frame["kind"] == "ack":
            self.waiting.acknowledged(frame["sequence"])
        self.driver.heard(frame, time.monotonic())


def asked(url: str, path: str, token: str | None, body: dict[str, Any] | None = None) -> Any:
    """The answer of a service as JSON. Raises ServiceError where there is none, or a refusal."""
    request = urllib.request.Request(f"{url.rstrip('/')}/api/v1/{path}", headers={"content-type": "application/json"})
    if token is not None:
        request.add_header("authorization", f"Bearer {token}")
    if body is not None:
        request.data = json.dumps(body).encode()
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=120) as answer:
            return json.loads(answer.read())
    except urllib.error.HTTPError as error:
        raise ServiceError(_refusal(error.read()) or f"{url} answers {error.code}; is it a Headland service?") from None
    except (OSError, ValueError) as error:
        raise ServiceError(f"{url} does not answer ({error}); start headland serve, or give another --url.") from None


def _refusal(body: bytes) -> str | None:
    """The sentence of a refusal; None where it is none."""
    try:
        return str(json.loads(body)["error"])
    except (ValueError, KeyError, TypeError):
        return None


def newest_fleet(url: str, token: str | None) -> str:
    """The id of the fleet made last. Raises ServiceError where there is none."""
    items = asked(url, "fleets", token)["items"]
    if not items:
        raise ServiceError(f"The service at {url} has no fleet; make one of the plan first.")
    return str(items[-1]["id"])
