"""The link of a simulated robot: ten states a second, and a new connection when one is lost."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
import urllib.error
import urllib.request
from collections import deque
from http import HTTPStatus
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus

from planner.fleet.model.rules import STATE_PERIOD_S
from planner.fleet.simulated_robot import RobotDriver
from planner.service.errors import ServiceError
from planner.service.settings import CONNECT_TIMEOUT_S

MOST_STATES = 6000  # that wait for the service: ten minutes at 10 Hz
RETRY_S, DISCONNECT_TIMEOUT_S = 0.5, 1.0
SHORTEST_PERIOD_S, LONGEST_SIMULATED_S = 0.03, 0.3
REPLACED_CODE = 4001  # of links that another of the same robot takes the place of
NO_LINK_STATUSES = (
    HTTPStatus.BAD_REQUEST, HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN, HTTPStatus.NOT_FOUND,
    HTTPStatus.METHOD_NOT_ALLOWED, HTTPStatus.UPGRADE_REQUIRED,
)  # fmt: skip


class RobotClient:
    """A robot driver and its link; `token` may be None if none is needed.

    States wait until they are acknowledged. One task sends them in order over the present link, from the last sequence
    that the service knows, so that repeated and new ones leave no gap.
    """

    def __init__(self, driver: RobotDriver, url: str, fleet: str, tractor: int, token: str | None) -> None:
        self.driver, self.tractor, self.token = driver, tractor, token
        self.address = f"{url.rstrip('/').replace('http', 'ws', 1)}/api/v1/fleets/{fleet}/link"
        self.waiting: deque[tuple[int, str]] = deque(maxlen=MOST_STATES)  # sequences and texts
        self._state_added, self._disconnected = asyncio.Event(), asyncio.Event()
        self._linked = self._leaving = False

    async def run(self, seconds: float | None = None) -> None:
        """Drive until cancelled, or for some seconds. Raises ServiceError if the service does not let it in."""
        self.driver.warm_up()
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
        begin_s = due_s = time.monotonic()
        while seconds is None or time.monotonic() - begin_s < seconds:
            self.driver.set_clock(time.time(), time.monotonic())
            state = self.driver.step(time.monotonic())
            if self.driver.is_welcomed:  # before, its place is unknown
                self.add_state(state)
            pause_s = compute_period_s(self.driver.times)
            due_s = max(due_s + pause_s, time.monotonic() - pause_s)
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
        self._leaving = True
        self._state_added.set()
        if self._linked:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(DISCONNECT_TIMEOUT_S):
                    await self._disconnected.wait()

    def add_state(self, state: dict[str, Any]) -> None:
        """Add a state to those that are sent again until they are acknowledged; of too many the oldest are lost."""
        self.waiting.append((int(state["sequence"]), json.dumps(state, separators=(",", ":"))))
        self._state_added.set()

    async def _stay_linked(self) -> None:
        """Connect again and again. Raises ServiceError if that is useless."""
        while True:
            try:
                async with connect(self.address, open_timeout=CONNECT_TIMEOUT_S, proxy=None, compression=None) as link:
                    await self._exchange_frames(link)
            except InvalidStatus as answer:
                code = answer.response.status_code
                if code in NO_LINK_STATUSES:
                    raise ServiceError(
                        f"{self.address} answers with status {code}; check that it is a Headland service."
                    ) from None
            except ConnectionClosed as end:
                if end.rcvd is not None and end.rcvd.code == REPLACED_CODE:
                    raise ServiceError(
                        f"Another robot has taken the place of tractor {self.tractor}; stop one of the two."
                    ) from None
            except (OSError, InvalidHandshake, TimeoutError):
                pass  # the service is not up yet, or is stopping
            await asyncio.sleep(RETRY_S)

    async def _exchange_frames(self, link: ClientConnection) -> None:
        """Send connect, then exchange frames until the link is lost."""
        greeting = {"kind": "connect", "role": "tractor", "tractor": self.tractor, "token": self.token, "version": 1}
        await link.send(json.dumps(greeting))
        welcome = json.loads(await link.recv())
        if welcome["kind"] != "welcome":
            reason = welcome.get("sentence", "it sent no welcome.")
            raise ServiceError(f"The service does not let tractor {self.tractor} in: {reason}")
        self.driver.handle_frame(welcome, time.monotonic())
        self._linked = True
        sending = asyncio.create_task(self._send(link, welcome["last_sequence"]))
        try:
            async for message in link:
                self._handle_frame(json.loads(message))
        finally:
            self._linked = False
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _send(self, link: ClientConnection, sent: int) -> None:
        """Send all states after a sequence as they come, and disconnect after the last."""
        with contextlib.suppress(ConnectionClosed):
            while True:
                self._state_added.clear()
                for sequence, text in [state for state in self.waiting if state[0] > sent]:
                    await link.send(text)
                    sent = sequence
                if self._leaving:
                    await link.send('{"kind":"disconnect"}')
                    self._disconnected.set()
                    return
                await self._state_added.wait()

    def _handle_frame(self, frame: dict[str, Any]) -> None:
        if frame["kind"] == "ack":
            while self.waiting and self.waiting[0][0] <= frame["sequence"]:
                self.waiting.popleft()
        self.driver.handle_frame(frame, time.monotonic())


def compute_period_s(times: float) -> float:
    """Seconds between two states of a tractor that runs `times` as fast as real time.

    Ten a second, and more often if more than LONGEST_SIMULATED_S would pass in between: with rarer commands a twin
    cannot tell whether it is wrong.
    """
    return min(STATE_PERIOD_S, max(SHORTEST_PERIOD_S, LONGEST_SIMULATED_S / times))


def request_json(url: str, path: str, token: str | None, body: dict[str, Any] | None = None) -> Any:
    """The answer of a service as JSON. Raises ServiceError if there is none, or for a refusal."""
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
        sentence = f"{url} answers with status {error.code}; check that it is a Headland service."
        with contextlib.suppress(ValueError, KeyError, TypeError):  # the body may be no refusal
            sentence = str(json.loads(error.read())["error"])
        raise ServiceError(sentence) from None
    except (OSError, ValueError) as error:
        raise ServiceError(f"{url} does not answer ({error}); start headland serve, or give another --url.") from None


def find_newest_fleet(url: str, token: str | None) -> str:
    """The id of the newest fleet. Raises ServiceError if there is none."""
    items = request_json(url, "fleets", token)["items"]
    if not items:
        raise ServiceError(f"The service at {url} has no fleet; create one from a plan first.")
    return str(items[-1]["id"])
