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
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus

from planner.service.errors import ServiceError
from planner.service.robot.driver import Driver
from planner.service.robot.sending import Unacknowledged

PERIOD_S, AGAIN_S, OPEN_S, GOODBYE_S = 0.1, 0.5, 5.0, 1.0
SHORTEST_S, LIVED_S = 0.03, 0.3
REPLACED = 4001
NO_SUCH_PAGE = (400, 401, 403, 404, 405, 426)


class Robot:
    """A driver and its link. `token` may be None where none is needed.

    A state waits until it is acknowledged. One task sends them in order over the link there is, from the last one that
    the service has seen on, so that none is left out between those sent again and those that come new.
    """

    def __init__(self, driver: Driver, url: str, fleet: str, tractor: int, token: str | None) -> None:
        self.driver, self.tractor, self.token = driver, tractor, token
        self.address = f"{url.rstrip('/').replace('http', 'ws', 1)}/api/v1/fleets/{fleet}/link"
        self.waiting = Unacknowledged()
        self._fresh, self._gone = asyncio.Event(), asyncio.Event()
        self._linked = self._leaving = False

    async def run(self, seconds: float | None = None) -> None:
        """Drive until cancelled, done or for so long. Raises ServiceError when the service does not let it in."""
        self.driver.warm()
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
            self.driver.dated(time.time(), time.monotonic())
            state = self.driver.step(time.monotonic())
            if self.driver.welcomed:  # before, it does not know where it is
                self.waiting.add(state)
                self._fresh.set()
            pause_s = period_s(self.driver.times)
            due = max(due + pause_s, time.monotonic() - pause_s)
            await asyncio.sleep(max(0.0, due - time.monotonic()))
        self._leaving = True
        self._fresh.set()
        if self._linked:
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._gone.wait(), GOODBYE_S)

    async def _stay_linked(self) -> None:
        """Link again and again. Raises ServiceError where that is of no use."""
        while True:
            try:
                async with connect(self.address, open_timeout=OPEN_S, proxy=None, compression=None) as link:
                    await self._speak(link)
            except InvalidStatus as answer:
                code = answer.response.status_code
                if code in NO_SUCH_PAGE:
                    raise ServiceError(f"{self.address} answers {code}; is it a Headland service?") from None
            except ConnectionClosed as end:
                if end.rcvd is not None and end.rcvd.code == REPLACED:
                    raise ServiceError(
                        f"Another robot has taken the place of tractor {self.tractor}; end one of the two."
                    ) from None
            except (OSError, InvalidHandshake, TimeoutError):
                pass  # nobody is there yet, or somebody who is just going
            await asyncio.sleep(AGAIN_S)

    async def _speak(self, link: ClientConnection) -> None:
        """Say hello, then send and hear until the link is lost."""
        hello = {"kind": "hello", "role": "tractor", "tractor": self.tractor, "token": self.token, "version": 1}
        await link.send(json.dumps(hello))
        welcome = json.loads(await link.recv())
        if welcome["kind"] != "welcome":
            why = welcome.get("sentence", "it says no welcome.")
            raise ServiceError(f"The service does not let tractor {self.tractor} in: {why}")
        self.driver.heard(welcome, time.monotonic())
        self._linked = True
        sending = asyncio.create_task(self._send(link, welcome["last_sequence"]))
        try:
            async for message in link:
                self._hear(json.loads(message))
        finally:
            self._linked = False
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _send(self, link: ClientConnection, sent: int) -> None:
        """Send all states after one as they come, and goodbye after the last."""
        with contextlib.suppress(ConnectionClosed):
            while True:
                self._fresh.clear()
                for sequence, text in self.waiting.after(sent):
                    await link.send(text)
                    sent = sequence
                if self._leaving:
                    await link.send('{"kind":"goodbye"}')
                    self._gone.set()
                    return
                await self._fresh.wait()

    def _hear(self, frame: dict[str, Any]) -> None:
        if frame["kind"] == "ack":
            self.waiting.acknowledged(frame["sequence"])
        self.driver.heard(frame, time.monotonic())


def period_s(times: float) -> float:
    """Seconds between two states of a tractor that lives so much faster than real time.

    Ten a second, and oftener where it would live more than LIVED_S in between: a twin that sees its commands more
    rarely cannot tell whether it is wrong.
    """
    return min(PERIOD_S, max(SHORTEST_S, LIVED_S / times))


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
