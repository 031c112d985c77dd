"""The gate before every route: rate, caller, right and size are checked before a body is read.

A refused request is read to its end where it is short, so that the sender can read the answer. Unknown parameters of a
query or a form are refused as well.
"""

from __future__ import annotations

import asyncio
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from urllib.parse import unquote, urlsplit

from fastapi import APIRouter
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse
from starlette.routing import compile_path
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from planner.errors import suggest_name
from planner.service.access.permissions import (
    CALLER_SCOPE_KEY,
    Caller,
    RequiredRight,
    find_required_right,
    identify_caller,
    read_bearer,
)
from planner.service.errors import BusyError, ServiceError
from planner.service.gateway.connection_limits import RateLimiter, compute_network_key
from planner.service.gateway.responses import build_error_response, build_refusal_response
from planner.service.settings import LIMITS, MEGABYTE_BYTES, ServiceSettings

BODIES_FOLDER = "bodies"
KILOBYTE_BYTES = 1024
UNCOUNTED_BYTES = 64 * KILOBYTE_BYTES  # of each body; orders to fleets are no longer, and never wait for uploads

GrowShare = Callable[[int], bool]
"""Takes as much of a budget as a body of this size, in bytes, needs; False, and nothing is taken, without room."""

FORM_OVERHEAD_BYTES = 64 * KILOBYTE_BYTES  # of a form besides its file
LARGE_BODY_KEY = "x-headland-large"
"""Key in the `openapi_extra` of a route whose body may be as large as an upload."""
API_PATH = "/api/"
STOP_PATH = re.compile(rf"{API_PATH}v1/fleets/[^/]+/stop/?")
MISSING_PATH = "The request names no path; ask for one such as /api/v1/health."
BODIES_FULL = (
    "Too many large bodies are under way; wait until yours, or those of others, are through, then send it again."
)
BODIES_RETRY = {"retry-after": "5", "connection": "close"}
MOST_DRAINED_BYTES, DRAIN_TIMEOUT_S = MEGABYTE_BYTES, 2.0


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
    def open_share(self, client: str) -> Iterator[GrowShare]:
        """The share of one body, given back at the end."""
        share_bytes = 0

        def grow_share(size_bytes: int) -> bool:
            nonlocal share_bytes
            added_bytes = size_bytes - UNCOUNTED_BYTES - share_bytes
            if added_bytes <= 0:
                return True
            of_client = self._by_client[client] + added_bytes
            if of_client > LIMITS.share_of_client * self.most_bytes or self.held_bytes + added_bytes > self.most_bytes:
                return False
            self._by_client[client] = of_client
            share_bytes += added_bytes
            return True

        try:
            yield grow_share
        finally:
            self._by_client[client] -= share_bytes
            self._by_client += Counter()  # clients without a body are forgotten


async def refuse_unknown_query(connection: HTTPConnection) -> None:
    """A dependency of all routes; raises ServiceError for the first query parameter that the route does not have."""
    route = connection.scope.get("route")
    if not isinstance(route, APIRoute):
        return
    known_names = sorted(set(_list_query_names(route.dependant)))
    _refuse_unknown_names(connection.query_params, known_names, "parameter of this address")


async def refuse_unknown_form_parts(request: Request) -> None:
    """A dependency of uploads; raises ServiceError for the first part of the form that the route does not have."""
    route = request.scope["route"]
    known_names = sorted(each.alias for each in route.dependant.body_params)
    _refuse_unknown_names(await request.form(), known_names, "part of this form")


def _refuse_unknown_names(names: Iterable[str], known_names: Sequence[str], what: str) -> None:
    """Raise ServiceError for the first name that is not known."""
    for name in names:
        if name not in known_names:
            accepted, close = ", ".join(known_names) or "none", suggest_name(name, known_names)
            raise ServiceError(f"{name[:40]!r} is not a {what}; it takes {accepted}{close}.", parameter=name[:40])


def _list_query_names(dependant: Dependant) -> Iterator[str]:
    yield from (each.alias for each in dependant.query_params)
    for each in dependant.dependencies:
        yield from _list_query_names(each)


@dataclass(frozen=True)
class RouteRule:
    """One route: methods, path as an expression, the right it needs (None: no right), and the largest body in bytes."""

    methods: frozenset[str]
    path: re.Pattern[str]
    required_right: RequiredRight | None
    most_bytes: int


def list_route_rules(
    routers: Iterable[APIRouter], prefix: str, settings: ServiceSettings, *, are_orders: bool = False
) -> list[RouteRule]:
    """The rules of all routes of routers below a prefix; orders to fleets (`are_orders`) have short bodies."""
    most_bytes = UNCOUNTED_BYTES if are_orders else MEGABYTE_BYTES
    rules = []
    for route in (route for router in routers for route in router.routes if isinstance(route, APIRoute)):
        parts = route.dependant.body_params
        has_file = any("multipart" in str(getattr(each.field_info, "media_type", "")) for each in parts)
        is_large = has_file or (route.openapi_extra or {}).get(LARGE_BODY_KEY, False)
        rule_bytes = settings.upload_bytes + FORM_OVERHEAD_BYTES if is_large else most_bytes
        path = compile_path(prefix + route.path)[0]
        rules.append(RouteRule(frozenset(route.methods or ()), path, find_required_right(route), rule_bytes))
    return rules


def find_route_rule(rules: Iterable[RouteRule], method: str, path: str) -> tuple[RouteRule, dict[str, str]] | None:
    """The rule for a request, and the parts of its path; None where there is no such route."""
    for rule in rules:
        if method in rule.methods and (match := rule.path.match(path)):
            return rule, match.groupdict()
    return None


class RequestGate:
    """Passes a request to its route, with its `Caller` in the scope, or answers in one sentence.

    An order to stop from a caller with the right is passed however many requests were sent.
    """

    def __init__(self, app: ASGIApp, settings: ServiceSettings, rules: Sequence[RouteRule], bodies: BodyBudget) -> None:
        self.app, self.settings, self.rules, self.bodies = app, settings, rules, bodies
        self.rate_limiter = RateLimiter(settings.rate_per_minute / 60.0, settings.rate_per_minute)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI entry point."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        if not scope["path"].startswith("/") and not _set_path_from_url(scope):
            await build_error_response(400, MISSING_PATH, {"connection": "close"})(scope, receive, send)
            return
        matched = find_route_rule(self.rules, scope["method"], scope["path"])
        most_bytes = 0 if matched is None else matched[0].most_bytes  # an unknown address takes no body
        refusal = await self._find_refusal(scope, matched, most_bytes)
        if refusal is not None:
            if not await _drain_body(scope, receive):
                refusal.headers["connection"] = "close"
            await refusal(scope, receive, send)
            return
        with self.bodies.open_share(name_client(scope)) as grow_share:
            if not grow_share(_get_length(scope)):
                await build_error_response(BusyError.http_status, BODIES_FULL, BODIES_RETRY)(scope, receive, send)
                return
            await self.app(scope, _limit_body(receive, most_bytes, grow_share), send)

    async def _find_refusal(
        self, scope: Scope, matched: tuple[RouteRule, dict[str, str]] | None, most_bytes: int
    ) -> JSONResponse | None:
        """The refusal of a request; None where it may pass."""
        connection = HTTPConnection(scope)
        is_stop = scope["method"] == "POST" and STOP_PATH.fullmatch(scope["path"]) is not None
        wait_s = self.rate_limiter.take_token(_find_network(scope)) if scope["path"].startswith(API_PATH) else 0.0
        if wait_s > 0.0 and not is_stop:
            return self._build_rate_refusal(wait_s)
        try:
            caller = scope[CALLER_SCOPE_KEY] = await identify_caller(connection, read_bearer(connection))
            if matched is not None and matched[0].required_right is not None:
                matched[0].required_right.check(caller, matched[1])
        except ServiceError as error:
            return self._build_rate_refusal(wait_s) if wait_s > 0.0 else build_refusal_response(error)
        if _get_length(scope) > most_bytes:
            return build_error_response(413, _build_too_large_message(most_bytes), {"connection": "close"})
        return None

    def _build_rate_refusal(self, wait_s: float) -> JSONResponse:
        message = f"More than {self.settings.rate_per_minute} requests in a minute; ask again later."
        return build_error_response(429, message, {"retry-after": str(int(wait_s) + 1), "connection": "close"})


def _set_path_from_url(scope: Scope) -> bool:
    """Take the path from a whole address, as requests to proxies have it; whether there is one."""
    try:
        parts = urlsplit(scope["raw_path"].decode("ascii"))
    except ValueError:
        return False
    if parts.scheme not in ("http", "https") or not parts.netloc:
        return False
    path = parts.path or "/"
    scope["path"], scope["raw_path"] = unquote(path), path.encode()
    return True


async def _drain_body(scope: Scope, receive: Receive) -> bool:
    """Read and drop a short body, as closing before its end would lose the answer; whether it ended."""
    if b"expect" in dict(scope["headers"]) or _get_length(scope) > MOST_DRAINED_BYTES:
        return False
    remaining_bytes = MOST_DRAINED_BYTES
    try:
        async with asyncio.timeout(DRAIN_TIMEOUT_S):
            while remaining_bytes > 0:
                message = await receive()
                remaining_bytes -= len(message.get("body", b""))
                if not message.get("more_body", False):
                    return True
    except TimeoutError:
        return False
    return False


def _get_length(scope: Scope) -> int:
    """The length that the header of a request gives, 0 without one."""
    length = dict(scope["headers"]).get(b"content-length", b"")
    return int(length[:18]) if length.isdigit() else 0


def name_client(scope: Scope) -> str:
    """Whose share of bodies, queues and limits a request takes: that of its token, or of its network without one."""
    caller: Caller | None = scope.get(CALLER_SCOPE_KEY)
    return _find_network(scope) if caller is None or caller.token_sha256 is None else caller.token_sha256


def _find_network(scope: Scope) -> str:
    """What counts as one address among callers without a token."""
    return compute_network_key(get_host(scope))


def get_host(scope: Scope) -> str:
    """The address that a request comes from; "" where it is not known."""
    return str((scope.get("client") or ("",))[0])


def _limit_body(receive: Receive, most_bytes: int, grow_share: GrowShare) -> Receive:
    """The same, but a body that is longer than allowed, or has no room beside others, is refused."""
    received_bytes = 0

    async def receive_counted() -> Message:
        nonlocal received_bytes
        message = await receive()
        received_bytes += len(message.get("body", b""))
        if received_bytes > most_bytes:
            raise HTTPException(413, _build_too_large_message(most_bytes), {"connection": "close"})
        if not grow_share(received_bytes):
            raise HTTPException(BusyError.http_status, BODIES_FULL, BODIES_RETRY)
        return message

    return receive_counted


def _build_too_large_message(most_bytes: int) -> str:
    if most_bytes == 0:
        return "No route at this address takes a body; the API is documented at /api/v1/docs."
    is_large = most_bytes >= MEGABYTE_BYTES
    size = f"{most_bytes // MEGABYTE_BYTES} MB" if is_large else f"{most_bytes // KILOBYTE_BYTES} KB"
    return f"The body is larger than {size}, the limit here; send less."
