"""Who asks, and what they may do: by a token, or by asking from this machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends
from fastapi.security import HTTPBearer
from starlette.requests import HTTPConnection, Request
from starlette.websockets import WebSocket

from planner.service.access.origin import check_origin, names_this_machine
from planner.service.errors import ScopeError, TokenError
from planner.service.settings import Settings, is_loopback
from planner.service.store import Store
from planner.service.store.tokens import SCOPES

BEARER = HTTPBearer(
    auto_error=False, description="A token of headland token new; who reads from this machine needs none."
)
NOBODY = "this machine"
FORWARDED = ("forwarded", "x-forwarded-for", "x-real-ip", "via")
"""Headers of a proxy: what comes through one does not come from this machine."""


@dataclass(frozen=True)
class Who:
    """Who asks: the name of the token, its scope (None without one), whether from this machine, and its SHA-256."""

    name: str
    scope: str | None
    loopback: bool
    token: str | None = None

    def may(self, scope: str) -> bool:
        """Whether this scope, or one that includes it, is theirs; a reader on this machine needs no token."""
        if self.scope is None:
            return self.loopback and scope == SCOPES[0]
        return SCOPES.index(self.scope) >= SCOPES.index(scope)

    def check(self, scope: str) -> None:
        """Raise TokenError without a token where one is needed, ScopeError for one that may not."""
        if self.may(scope):
            return
        if self.scope is None:
            raise TokenError(
                f"This needs a token of the scope {scope!r}; send it as 'Authorization: Bearer hl_...' (headland token "
                f"new --scope {scope} makes one)."
            )
        raise ScopeError(
            f"The token {self.name!r} has the scope {self.scope!r} and this needs {scope!r}; use another token."
        )


def needs(scope: str) -> Callable[..., Who]:
    """A dependency of routes: who asks, refused without this scope by TokenError or ScopeError."""

    def who(request: Request, _told: Annotated[object, Depends(BEARER)]) -> Who:
        asks = who_of(request, _bearer(request))
        asks.check(scope)
        return asks

    return who


def who_of(connection: HTTPConnection, token: str | None) -> Who:
    """Who a connection is by its token, or without one by where it comes from; raises TokenError."""
    settings: Settings = connection.app.state.settings
    loopback = settings.local and from_this_machine(connection)
    if token is None:
        return Who(NOBODY, None, loopback)
    store: Store = connection.app.state.store
    row = store.token(token)
    if row is None:
        raise TokenError("This token is not known here; it may have been revoked.", parameter="token")
    return Who(row.name, row.scope, loopback, row.sha256)


def who_of_socket(websocket: WebSocket, hello_token: str | None = None) -> Who:
    """Who opened a socket: by the token of its header or of its first frame.

    Asks the database: call it in a thread. Raises ScopeError for a page of another site, TokenError for a token that
    is not known.
    """
    check_origin(websocket)
    return who_of(websocket, _bearer(websocket) or hello_token)


def from_this_machine(connection: HTTPConnection) -> bool:
    """Whether a connection comes from this machine, by itself and not through a proxy or a page's other name for it."""
    client = connection.client
    direct = not any(name in connection.headers for name in FORWARDED)
    return client is not None and is_loopback(client.host) and direct and names_this_machine(connection)


def _bearer(connection: HTTPConnection) -> str | None:
    """The token of the header, None without one; raises TokenError for a header of another form."""
    header = connection.headers.get("authorization")
    if header is None:
        return None
    kind, _, token = header.partition(" ")
    if kind.lower() != "bearer" or not token.strip():
        raise TokenError("The header Authorization is of another form; send 'Authorization: Bearer hl_...'.")
    return token.strip()
