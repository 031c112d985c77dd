"""Log lines that programs can read: time, level, request and message; repeated messages are limited."""

from __future__ import annotations

import contextvars
import json
import logging
import secrets
import sys
import time
from collections.abc import Callable

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from planner.fleet.session.frame_timing import format_utc
from planner.service.settings import LIMITS

REQUEST_ID: contextvars.ContextVar[str | None] = contextvars.ContextVar("request_id", default=None)
REQUEST_ID_HEADER = b"x-request-id"
ObserveRequest = Callable[[str, int, float], None]


class LogfmtFormatter(logging.Formatter):
    """One record as `time=... level=... logger=... request=... message="..."`, always in one line."""

    def format(self, record: logging.LogRecord) -> str:
        """Overrides logging.Formatter.format."""
        message = record.getMessage()
        if record.exc_info:
            message += " " + self.formatException(record.exc_info)
        parts = {"time": format_utc(record.created), "level": record.levelname.lower(), "logger": record.name}
        if (request := REQUEST_ID.get()) is not None:
            parts["request"] = request
        words = " ".join(f"{name}={value}" for name, value in parts.items())
        most_chars = LIMITS.longest_message_chars
        if len(message) > most_chars:  # keep the beginning and the end
            message = f"{message[: most_chars // 4]} ... {message[-3 * most_chars // 4 :]}"
        return f"{words} message={json.dumps(message, ensure_ascii=False)}"


class RepeatFilter(logging.Filter):
    """Passes the same message of the same logger only a few times a minute."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._counts: dict[tuple[str, str], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Overrides logging.Filter.filter; the last message that passes says that further ones are left out."""
        key, now = (record.name, str(record.msg)[:200]), self._clock()
        since, count = self._counts.get(key, (now, 0))
        if now - since >= LIMITS.repeat_period_s:
            since, count = now, 0
        if len(self._counts) >= LIMITS.most_tracked_messages:
            self._counts.clear()
        self._counts[key] = since, count + 1
        if count + 1 == LIMITS.most_repeats:
            record.msg = f"{record.msg} (this is not logged again within {LIMITS.repeat_period_s:.0f} s)"
        return count < LIMITS.most_repeats


def set_up_logs() -> None:
    """Log every logger to standard error in this format."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(LogfmtFormatter())
    handler.addFilter(RepeatFilter())
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
        logging.getLogger(name).handlers.clear()
        logging.getLogger(name).propagate = True


class RequestIdMiddleware:
    """Gives each request an id, which its log lines and its answer have, and says how long it took.

    An id that comes with the request is kept with `trusts_header` only, as between the parts of the service.
    """

    def __init__(self, app: ASGIApp, *, trusts_header: bool = False, observe: ObserveRequest | None = None) -> None:
        self.app, self._trusts_header, self._observe = app, trusts_header, observe

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI entry point."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        header_id = dict(scope["headers"]).get(REQUEST_ID_HEADER, b"").decode("latin-1") if self._trusts_header else ""
        request_id = header_id or secrets.token_hex(6)
        scope["headers"] = [
            *(each for each in scope["headers"] if each[0].lower() != REQUEST_ID_HEADER),
            (REQUEST_ID_HEADER, request_id.encode()),
        ]
        begun_s, status = time.perf_counter(), 500

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)["x-request-id"] = request_id
            await send(message)

        reset_token = REQUEST_ID.set(request_id)
        try:
            await self.app(scope, receive, send_with_id)
        finally:
            REQUEST_ID.reset(reset_token)
            if self._observe is not None and scope["type"] == "http":
                self._observe(str(scope["method"]), status, time.perf_counter() - begun_s)
