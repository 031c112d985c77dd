"""The back office: the process for files, jobs, exports and pages, and the forwarding of requests to it.

It is started again whenever it ends, and trusts the control process to name the caller.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import logging
import multiprocessing
import secrets
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import asdict
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import TYPE_CHECKING, Protocol

from starlette.responses import Response, StreamingResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from planner.pipeline.executors import hold_interrupts
from planner.service.access.permissions import CALLER_SCOPE_KEY, Caller
from planner.service.gateway.request_gate import build_message_response
from planner.service.settings import ServiceSettings

if TYPE_CHECKING:
    import httpx2


SECRET_HEADER, CALLER_HEADER, CLIENT_HEADER = b"x-headland-secret", b"x-headland-who", b"x-headland-client"
UNFORWARDED_HEADERS = {
    b"connection",
    b"keep-alive",
    b"proxy-connection",
    b"te",
    b"trailer",
    b"transfer-encoding",
    b"upgrade",
    SECRET_HEADER,
    CALLER_HEADER,
    CLIENT_HEADER,
}
MOST_REQUESTS_PER_CLIENT, MOST_REQUESTS_IN_ALL = 32, 256
RESPONSE_TIMEOUT_S = 300.0
READ_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
OFFICE_STARTING = "Files, jobs and pages are starting; try again in a few seconds. Fleets and stops work."
OFFICE_LOST = "The process for files, jobs and pages ended during this request; try again."


class BackOfficeAddress(Protocol):
    """Address of the back office (None while it does not run), and the secret that it shares."""

    secret: str

    @property
    def url(self) -> str | None:
        """The address, such as http://127.0.0.1:40000."""


class OfficeForwarder:
    """An ASGI app that forwards requests to the back office and returns its answers.

    `before` is called with the path of each request, `after` with that of one that may have changed something, before
    its answer is sent.
    """

    def __init__(
        self,
        office: BackOfficeAddress,
        before_request: Callable[[str], Awaitable[None]],
        after_change: Callable[[str], Awaitable[None]],
    ) -> None:
        self.office, self.before_request, self.after_change = office, before_request, after_change
        self._running_requests: Counter[str] = Counter()
        self._client: httpx2.AsyncClient | None = None

    async def close(self) -> None:
        """Close all connections."""
        if self._client is not None:
            await self._client.aclose()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI entry point."""
        client = _get_queue_key(scope)
        if (
            self._running_requests[client] >= MOST_REQUESTS_PER_CLIENT
            or self._running_requests.total() >= MOST_REQUESTS_IN_ALL
        ):
            which = (
                "of your requests" if self._running_requests[client] >= MOST_REQUESTS_PER_CLIENT else "requests of all"
            )
            count = min(
                self._running_requests.total(),
                MOST_REQUESTS_PER_CLIENT if which.startswith("of") else MOST_REQUESTS_IN_ALL,
            )
            message = f"{count} {which} are under way; wait for one to end, then ask again."
            await build_message_response(429, message, {"retry-after": "1", "connection": "close"})(
                scope, receive, send
            )
            return
        self._running_requests[client] += 1
        try:
            await self._forward_request(scope, receive, send)
        finally:
            self._running_requests[client] -= 1
            self._running_requests += Counter()

    async def _forward_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        import httpx2

        await self.before_request(scope["path"])
        url = self.office.url
        if url is None:
            await build_message_response(503, OFFICE_STARTING, {"retry-after": "3", "connection": "close"})(
                scope, receive, send
            )
            return
        try:
            request = self._build_request(url, scope, receive)
        except httpx2.InvalidURL:
            await build_message_response(400, "The address cannot be read; write it in letters, digits and % codes.")(
                scope, receive, send
            )
            return
        try:
            response = await self._get_client().send(request, stream=True)
        except (httpx2.TransportError, OSError):
            await build_message_response(503, OFFICE_LOST, {"retry-after": "3", "connection": "close"})(
                scope, receive, send
            )
            return
        try:
            if scope["method"] not in READ_METHODS:
                await self.after_change(scope["path"])
            await _build_streaming_response(response)(scope, receive, send)
        finally:
            await response.aclose()

    def _get_client(self) -> httpx2.AsyncClient:
        import httpx2

        if self._client is None:
            limits = httpx2.Limits(max_connections=MOST_REQUESTS_IN_ALL, max_keepalive_connections=16)
            timeout = httpx2.Timeout(RESPONSE_TIMEOUT_S, connect=5.0)
            self._client = httpx2.AsyncClient(limits=limits, timeout=timeout, trust_env=False)
        return self._client

    def _build_request(self, url: str, scope: Scope, receive: Receive) -> httpx2.Request:
        import httpx2

        headers = [(name, value) for name, value in scope["headers"] if name.lower() not in UNFORWARDED_HEADERS]
        caller: Caller | None = scope.get(CALLER_SCOPE_KEY)
        address = str((scope.get("client") or ("",))[0])
        headers += [
            (SECRET_HEADER, self.office.secret.encode()),
            (CALLER_HEADER, dump_caller(caller).encode()),
            (CLIENT_HEADER, address.encode()),
        ]
        target = scope["raw_path"] + (b"?" + scope["query_string"] if scope["query_string"] else b"")
        target = target.replace(b"#", b"%23")  # clients send no fragments, so this belongs to the path
        header_names = {name.lower() for name, _ in headers}
        chunked = any(name.lower() == b"transfer-encoding" for name, _ in scope["headers"])
        content = _read_body(receive) if chunked or b"content-length" in header_names else None
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
            await build_message_response(403, "This address is internal; use the one that headland serve printed.")(
                scope, receive, send
            )
            return
        scope[CALLER_SCOPE_KEY] = load_caller(headers.get(CALLER_HEADER, b"null").decode())
        scope["client"] = (headers.get(CLIENT_HEADER, b"").decode("latin-1"), 0)
        await self.app(scope, receive, send)


def dump_caller(caller: Caller | None) -> str:
    """The caller as the text of a header."""
    return json.dumps(None if caller is None else asdict(caller))


def load_caller(text: str) -> Caller | None:
    """The caller from the text of a header."""
    values = json.loads(text)
    return None if values is None else Caller(**values | {"scopes": tuple(values["scopes"])})


def _get_queue_key(scope: Scope) -> str:
    """Key by which requests are counted together: the token, or the address without one."""
    caller: Caller | None = scope.get(CALLER_SCOPE_KEY)
    return caller.name if caller is not None and caller.token_sha256 else str((scope.get("client") or ("",))[0])


async def _read_body(receive: Receive) -> AsyncIterator[bytes]:
    while True:
        message: Message = await receive()
        if message["type"] == "http.disconnect":
            raise ConnectionResetError("The client went away.")
        if body := message.get("body", b""):
            yield body
        if not message.get("more_body", False):
            return


def _build_streaming_response(response: httpx2.Response) -> Response:
    """The answer of the office, streamed."""
    streamed = StreamingResponse(response.aiter_raw(), response.status_code)
    streamed.raw_headers = [
        (name.lower(), value) for name, value in response.headers.raw if name.lower() not in UNFORWARDED_HEADERS
    ]
    return streamed


OFFICE_POLL_S, SHORT_LIFE_S, LONGEST_RESTART_PAUSE_S, TERMINATE_TIMEOUT_S = 0.2, 5.0, 30.0, 30.0
LOOPBACK_HOST = "127.0.0.1"


class BackOffice:
    """Keeps the process of the office, whose main function is `run` (settings, secret, where to send its port).

    `url` is where it listens, None while it does not; `starts` counts them.
    """

    def __init__(self, settings: ServiceSettings, run: Callable[[ServiceSettings, str, Connection], None]) -> None:
        self.settings, self._run, self.secret = settings, run, secrets.token_urlsafe(32)
        self.url: str | None = None
        self.starts = 0
        self._process: SpawnProcess | None = None
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Start the process, and again whenever it ends."""
        self._task = asyncio.create_task(self._keep_running())

    async def wait_until_ready(self) -> None:
        """Wait until the process listens, however slow the machine is."""
        while self.url is None:
            await asyncio.sleep(0.05)

    async def stop(self) -> None:
        """End the process and its work."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        await asyncio.to_thread(self._end_process)

    async def _keep_running(self) -> None:
        pause_s = 0.0
        while True:
            await asyncio.sleep(pause_s)
            begun_s = time.monotonic()
            try:
                await self._run_once()
            except OSError:
                logging.getLogger(__name__).exception("The office cannot be started")
            lived_s = time.monotonic() - begun_s
            pause_s = min(max(2.0 * pause_s, 0.5), LONGEST_RESTART_PAUSE_S) if lived_s < SHORT_LIFE_S else 0.0

    async def _run_once(self) -> None:
        context = multiprocessing.get_context("spawn")
        receiver, sender = context.Pipe(duplex=False)
        self._process = process = context.Process(
            target=self._run, args=(self.settings, self.secret, sender), name="headland-office"
        )
        await asyncio.to_thread(_start_process, process)
        sender.close()
        self.starts += 1
        try:
            while process.exitcode is None:
                if self.url is None and receiver.poll():
                    with contextlib.suppress(EOFError):
                        self.url = f"http://{LOOPBACK_HOST}:{receiver.recv()}"
                await asyncio.sleep(OFFICE_POLL_S)
        finally:
            self.url = None
            receiver.close()
        logging.getLogger(__name__).warning(
            "The back office ended with status %s and is started again.", process.exitcode
        )

    def _end_process(self) -> None:
        process = self._process
        if process is None or process.pid is None:
            return
        process.terminate()
        process.join(TERMINATE_TIMEOUT_S)
        if process.exitcode is None:
            process.kill()
            process.join()


def _start_process(process: SpawnProcess) -> None:
    """Start a process that ignores Ctrl-C."""
    with hold_interrupts():
        process.start()
