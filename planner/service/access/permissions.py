"""The caller of a request and their rights, by the scopes of a token or by a browser login."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

from fastapi import Depends
from fastapi.security import HTTPBearer
from starlette.requests import HTTPConnection, Request
from starlette.routing import BaseRoute
from starlette.websockets import WebSocket

from planner.service.access.browsers import BrowserLogins, check_origin
from planner.service.errors import ScopeError, TokenError
from planner.service.settings import ServiceSettings
from planner.service.store.database_watch import TokenCache
from planner.service.store.tables import FileRow, JobRow, Owner, TokenRow
from planner.service.store.token_table import BROWSER_TOKEN_PREFIX

BEARER_SCHEME = HTTPBearer(
    auto_error=False, description="A token of headland token new; a browser that has logged in reads without one."
)
ANONYMOUS_NAME, BROWSER_NAME = "nobody", "a browser that has logged in"

READ, PLAN, OPERATE, DRIVE, ADMINISTER = "read", "plan", "operate", "drive", "administer"
"""Rights that routes and links require."""
RIGHTS_BY_SCOPE = {
    "read": {READ},
    "planner": {READ, PLAN},
    "operator": {READ, OPERATE},
    "robot": set(),
    "admin": {READ, PLAN, OPERATE, DRIVE, ADMINISTER},
}
"""The rights of each scope; a robot may drive its own tractor and read its own fleet, see `Caller.has_right`."""
SCOPE_OPTION_BY_RIGHT = {
    READ: "read",
    PLAN: "planner",
    OPERATE: "operator",
    DRIVE: "robot --fleet ID --tractor N",
    ADMINISTER: "admin",
}
CALLER_SCOPE_KEY = "headland.who"
"""Key of the ASGI scope for the caller, where the gate has identified it before the route."""


@dataclass(frozen=True)
class RequiredRight:
    """The right that a route needs; `fleet_parameter` is the part of its path that names the fleet.

    With `allows_own_fleet` a robot may use the route too, and is shown its own fleet only.
    """

    right: str
    fleet_parameter: str | None = None
    allows_own_fleet: bool = False

    async def admit_caller(self, request: Request, _bearer: Annotated[object, Depends(BEARER_SCHEME)]) -> Caller:
        """A dependency of routes: the caller; raises TokenError or ScopeError without this right."""
        caller = await identify_caller(request, read_bearer(request))
        self.check(caller, request.path_params)
        return caller

    def check(self, caller: Caller, path_params: Mapping[str, Any]) -> None:
        """Raise TokenError or ScopeError where the caller of a route with these parts of its path lacks the right."""
        fleet = None if self.fleet_parameter is None else str(path_params.get(self.fleet_parameter))
        caller.check_right(self.right, caller.fleet if self.allows_own_fleet else fleet)


@dataclass(frozen=True)
class Caller:
    """Who sends a request: name, scopes, SHA-256 and identity of the token (None without one).

    A robot is bound to a `tractor`, counted from 1, of a `fleet`. `data_option` names the folder of the service in the
    commands that refusals give, where the caller may know it.
    """

    name: str
    scopes: tuple[str, ...]
    token_sha256: str | None = None
    fleet: str | None = None
    tractor: int | None = None
    data_option: str = ""
    identity: str | None = None

    def has_right(self, right: str, fleet: str | None = None, tractor: int | None = None) -> bool:
        """Whether the caller has a right, for a fleet and one of its tractors where these are given."""
        if any(right in RIGHTS_BY_SCOPE[scope] for scope in self.scopes):
            return True
        if "robot" not in self.scopes or fleet is None or fleet != self.fleet:
            return False
        return right == READ or (right == DRIVE and tractor is not None and tractor == self.tractor)

    def check_right(self, right: str, fleet: str | None = None, tractor: int | None = None) -> None:
        """Raise TokenError where a token is needed and missing, ScopeError where the token lacks the right."""
        if self.has_right(right, fleet, tractor):
            return
        scope = SCOPE_OPTION_BY_RIGHT[right]
        if self.token_sha256 is None:
            raise TokenError(
                f"This needs a token of the scope {scope.split()[0]!r}; send it as 'Authorization: Bearer hl_...' "
                f"({self.format_token_command(scope)} makes one)."
            )
        if "robot" in self.scopes:
            raise ScopeError(
                f"The token {self.name!r} is for tractor {self.tractor} of the fleet {self.fleet} alone, to drive and "
                f"read it; use another token ({self.format_token_command(scope)} makes one)."
            )
        raise ScopeError(
            f"The token {self.name!r} has the scope {' '.join(self.scopes)!r} and this needs {scope.split()[0]!r}; use "
            f"another token ({self.format_token_command(scope)} makes one)."
        )

    def format_token_command(self, scope: str) -> str:
        """The command that makes a token of a scope for the service."""
        return f"headland token new{self.data_option} --scope {scope}"

    @property
    def owner(self) -> Owner | None:
        """The owner of what the caller makes; None without a token and for browsers, which get a new one each time."""
        if self.identity is None or self.name.startswith(BROWSER_TOKEN_PREFIX):
            return None
        return Owner(self.name, self.identity)

    def check_may_change(self, row: FileRow | JobRow, subject: str) -> None:
        """Raise ScopeError where something belongs to another token; an administrator may change everything.

        `subject` names it at the start of the sentence. A later token of the owner's name is another token.
        """
        is_own = row.owner is None or (row.owner_identity is not None and row.owner_identity == self.identity)
        if is_own or self.has_right(ADMINISTER):
            return
        which = "an earlier token" if row.owner == self.name else "the token"
        raise ScopeError(
            f"{subject} belongs to {which} {row.owner!r}; ask who has that token or one of the scope 'admin' to change "
            "it, or make a copy of your own."
        )


def find_required_right(route: BaseRoute) -> RequiredRight | None:
    """The right that a route needs, None for a route that everybody may use."""
    dependant = getattr(route, "dependant", None)
    for dependency in dependant.dependencies if dependant is not None else ():
        required = getattr(dependency.call, "__self__", None)
        if isinstance(required, RequiredRight):
            return required
    return None


async def identify_caller(connection: HTTPConnection, token_text: str | None) -> Caller:
    """The caller of a connection: as identified before, by the token, or anonymous; raises TokenError."""
    known_caller = connection.scope.get(CALLER_SCOPE_KEY)
    if isinstance(known_caller, Caller):
        return known_caller
    settings: ServiceSettings = connection.app.state.settings
    option = settings.data_option if settings.is_own_machine else ""
    if token_text is None:
        logins: BrowserLogins = connection.app.state.logins
        is_known = logins.is_logged_in(connection)
        return Caller(BROWSER_NAME, ("read",), data_option=option) if is_known else Caller(ANONYMOUS_NAME, ())
    token_cache: TokenCache = connection.app.state.book
    return replace(build_caller(await token_cache.identify_token(token_text)), data_option=option)


async def identify_socket(websocket: WebSocket, first_frame_token: str | None = None) -> Caller:
    """The caller who opened a socket, by the token of its header or of its first frame.

    Raises ScopeError for a page of another site, TokenError for a token that is not known.
    """
    check_origin(websocket)
    return await identify_caller(websocket, read_bearer(websocket) or first_frame_token)


def build_caller(token: TokenRow) -> Caller:
    """The caller that a token stands for."""
    scopes = tuple(token.scopes.split())
    return Caller(token.name, scopes, token.sha256, token.fleet, token.tractor, identity=token.identity)


def is_operator(tokens: TokenCache, token_text: str) -> bool | None:
    """Whether the holder of a token may operate fleets, from memory only; None for an unknown token."""
    row = tokens.find_token(token_text)
    return None if row is None else build_caller(row).has_right(OPERATE)


def read_bearer(connection: HTTPConnection) -> str | None:
    """The token of the header, None without one; raises TokenError for a header of another kind."""
    header = connection.headers.get("authorization")
    if header is None:
        return None
    kind, _, token = header.partition(" ")
    if kind.lower() != "bearer" or not token.strip():
        raise TokenError("The header Authorization cannot be read; send 'Authorization: Bearer hl_...'.")
    return token.strip()


ReadAccess = Annotated[Caller, Depends(RequiredRight(READ).admit_caller)]
OwnReadAccess = Annotated[Caller, Depends(RequiredRight(READ, allows_own_fleet=True).admit_caller)]
PlanAccess = Annotated[Caller, Depends(RequiredRight(PLAN).admit_caller)]
OperateAccess = Annotated[Caller, Depends(RequiredRight(OPERATE).admit_caller)]
AdminAccess = Annotated[Caller, Depends(RequiredRight(ADMINISTER).admit_caller)]
"""Callers of routes, with the rights that these need."""
