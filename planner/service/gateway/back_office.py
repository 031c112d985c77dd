"""The back office: the process for files, jobs, exports and pages, and the forwarding of requests to it.

It is started again whenever it ends, and trusts the control process to name the caller.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import multiprocessing
import secrets
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Sequence
from dataclasses import asdict
from multiprocessing.connection import Connection

import httpx2
from starlette.requests import ClientDisconnect, Request
from starlette.responses import StreamingResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from planner.service.access.permissions import CALLER_SCOPE_KEY, Caller
from planner.service.gateway.request_gate import get_host, name_client
from planner.service.gateway.responses import build_error_response, wait_for_disconnect, wait_while_connected
from planner.service.kept_process import KeptProcess
from planner.service.settings import CONNECT_TIMEOUT_S, LIMITS, ServiceSettings

SECRET_HEADER, CALLER_HEADER, CLIENT_HEADER = b"x-headland-secret", b"x-headland-who", b"x-headland-client"
HOP_HEADERS = b"connection keep-alive proxy-connection te trailer transfer-encoding upgrade".split()
UNFORWARDED_HEADERS = {*HOP_HEADERS, SECRET_HEADER, CALLER_HEADER, CLIENT_HEADER}
READ_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
OFFICE_STARTING = "Files, jobs and pages are starting; try again in a few seconds. Fleets and stops work."
TRY_AGAIN = {"retry-after": "3", "connection": "close"}
UNREADABLE_ADDRESS = "The address cannot be read; write it in letters, digits and % codes."
OFFICE_LOST = "The process for files, jobs and pages ended during this request; try again."
LOOPBACK_HOST = "127.0.0.1"


class OfficeForwarder:
    """An ASGI app that forwards requests to the back office and returns its answers.

    `before_request` is called with the path of each request, `after_change` with that of one that may have changed
    something, before its answer is sent. At `abandoned_paths` the office is told when a client has gone, and does no
    more for it: whatever else is asked is counted until it is done.
    """

    def __init__(
        self,
        office: BackOffice,
        before_request: Callable[[str], Awaitable[None]],
        after_change: Callable[[str], Awaitable[None]],
        abandoned_paths: Collection[str] = (),
    ) -> None:
        self._abandoned_paths = abandoned_paths
        self.office, self.before_request, self.after_change = office, before_request, after_change
        self._running_requests: Counter[str] = Counter()
        limits = httpx2.Limits(max_connections=LIMITS.most_requests, max_keepalive_connections=16)
        timeout = httpx2.Timeout(LIMITS.response_timeout_s, connect=CONNECT_TIMEOUT_S)
        self._client = httpx2.AsyncClient(limits=limits, timeout=timeout, trust_env=False)

    async def close(self) -> None:
        """Close all connections."""
        await self._client.aclose()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI entry point."""
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008, "reason": "There is no link at this address."})
            return
        client = name_client(scope)
        is_own_limit = self._running_requests[client] >= LIMITS.most_requests_per_client
        if is_own_limit or self._running_requests.total() >= LIMITS.most_requests:
            requests = f"{LIMITS.most_requests} requests of all"
            if is_own_limit:
                requests = f"{LIMITS.most_requests_per_client} of your requests"
            message = f"{requests} are under way; wait for one to end, then ask again."
            await build_error_response(429, message, {"retry-after": "1", "connection": "close"})(scope, receive, send)
            return
        self._running_requests[client] += 1
        try:
            await self._forward_request(scope, receive, send)
        finally:
            self._running_requests[client] -= 1
            self._running_requests += Counter()

    async def _forward_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self.before_request(scope["path"])
        url = self.office.url
        if url is None:
            await build_error_response(503, OFFICE_STARTING, TRY_AGAIN)(scope, receive, send)
            return
        is_read = asyncio.Event()

        async def read_body() -> AsyncIterator[bytes]:
            async for part in Request(scope, receive).stream():  # raises ClientDisconnect where it ends early
                yield part
            is_read.set()

        async def wait_until_gone() -> None:  # which can be told once the whole body is read
            await is_read.wait()
            await wait_for_disconnect(receive)

        try:
            sent = self._client.send(self._build_request(url, scope, read_body()), stream=True)
            is_abandoned = scope["path"] in self._abandoned_paths
            response = await (wait_while_connected(wait_until_gone(), sent) if is_abandoned else sent)
        except httpx2.InvalidURL:
            await build_error_response(400, UNREADABLE_ADDRESS)(scope, receive, send)
            return
        except (httpx2.TransportError, OSError):
            await build_error_response(503, OFFICE_LOST, TRY_AGAIN)(scope, receive, send)
            return
        except ClientDisconnect:
            return
        try:
            if scope["method"] not in READ_METHODS:
                await self.after_change(scope["path"])
            streamed = StreamingResponse(response.aiter_raw(), response.status_code)
            headers = [(name.lower(), value) for name, value in response.headers.raw]
            streamed.raw_headers = [each for each in headers if each[0] not in UNFORWARDED_HEADERS]
            await streamed(scope, receive, send)
        finally:
            await response.aclose()

    def _build_request(self, url: str, scope: Scope, body: AsyncIterator[bytes]) -> httpx2.Request:
        headers = [(name, value) for name, value in scope["headers"] if name.lower() not in UNFORWARDED_HEADERS]
        caller: Caller | None = scope.get(CALLER_SCOPE_KEY)
        headers += [
            (SECRET_HEADER, self.office.secret.encode()),
            (CALLER_HEADER, json.dumps(None if caller is None else asdict(caller)).encode()),
            (CLIENT_HEADER, get_host(scope).encode()),
        ]
        target = scope["raw_path"] + (b"?" + scope["query_string"] if scope["query_string"] else b"")
        target = target.replace(b"#", b"%23")  # clients send no fragments, so this belongs to the path
        header_names = {name.lower() for name, _ in headers}
        chunked = any(name.lower() == b"transfer-encoding" for name, _ in scope["headers"])
        content = body if chunked or b"content-length" in header_names else None
        target_url = httpx2.URL(url).copy_with(raw_path=target)
        return httpx2.Request(scope["method"], target_url, headers=headers, content=content)


class SharedSecretMiddleware:
    """In front of the office: passes requests with the secret, and takes the caller from the control process."""

    def __init__(self, app: ASGIApp, secret: str) -> None:
        self.app, self._secret = app, secret.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI entry point."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        if not hmac.compare_digest(headers.get(SECRET_HEADER, b""), self._secret):
            message = "This address is internal; use the one that headland serve printed."
            await build_error_response(403, message)(scope, receive, send)
            return
        caller = json.loads(headers.get(CALLER_HEADER, b"null"))
        scope[CALLER_SCOPE_KEY] = caller and Caller(**caller | {"scopes": tuple(caller["scopes"])})
        scope["client"] = (headers.get(CLIENT_HEADER, b"").decode("latin-1"), 0)
        await self.app(scope, receive, send)


class BackOffice:
    """Keeps the process of the office, whose main function is `run` (settings, secret, where to send its port).

    `url` is where it listens, None while it does not.
    """

    def __init__(self, settings: ServiceSettings, run: Callable[[ServiceSettings, str, Connection], None]) -> None:
        self.settings, self.secret = settings, secrets.token_urlsafe(32)
        self.url: str | None = None
        self.kept_process = KeptProcess(
            run, self._prepare, self._conclude, short_life_s=5.0, patience_s=30.0, look=self._receive_port
        )

    @property
    def pid(self) -> int:
        """The number of the process, 0 where there is none."""
        process = self.kept_process.process
        return 0 if process is None else process.pid or 0

    async def wait_until_ready(self) -> None:
        """Wait until the process listens, however slow the machine is."""
        while self.url is None:
            await asyncio.sleep(0.05)

    async def stop(self) -> None:
        """End the process and its work."""
        await asyncio.to_thread(self.kept_process.stop)
        self.url = None

    def _prepare(self) -> tuple[str, Sequence[object]]:
        self._port_receiver, self._port_sender = multiprocessing.get_context("spawn").Pipe(duplex=False)
        return "headland-office", (self.settings, self.secret, self._port_sender)

    def _receive_port(self) -> None:
        if self.url is None and self._port_receiver.poll():
            self.url = f"http://{LOOPBACK_HOST}:{self._port_receiver.recv()}"

    def _conclude(self, _name: str, _status: int) -> bool:
        self.url = None
        for end in (self._port_receiver, self._port_sender):
            end.close()
        return True
