"""Routes for tokens (make, list, revoke) and for events."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, ConfigDict, Field

from planner.service.access.permissions import AdminAccess, ReadAccess
from planner.service.access.token_cache import TokenCache
from planner.service.gateway.responses import (
    CHANGE_ERRORS,
    ITEM_ERRORS,
    LIST_ERRORS,
    READ_ROUTE_ERRORS,
    EventList,
    NewToken,
    TokenInfo,
    TokenList,
    TokenScope,
)
from planner.service.store.service_store import Store

LARGEST_EVENT_ID = 2**53
events_router = APIRouter(tags=["events"])


@events_router.get("/events", responses=READ_ROUTE_ERRORS)
def list_events(
    request: Request,
    _caller: ReadAccess,
    since: Annotated[int, Query(ge=0, le=LARGEST_EVENT_ID, description="Only events of a higher number.")] = 0,
    fleet: Annotated[str | None, Query(max_length=32, description="Only events of this fleet.")] = None,
) -> EventList:
    """Events after a number, the oldest first, at most 1000; for more, ask again from the last number."""
    store: Store = request.app.state.store
    return EventList.model_validate({"items": store.list_events(since, fleet)})


tokens_router = APIRouter(prefix="/tokens", tags=["tokens"])


class TokenRequest(BaseModel):
    """A new token; one of the scope robot is bound to a `tractor`, counted from 1, of a `fleet`, by its id.

    `expires` is a period (90m, 12h, 30d), a date, a time or never; by default a robot's token expires after 30 days and
    others never.
    """

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(max_length=100, description="Name of the token.")]
    scopes: Annotated[list[TokenScope], Field(min_length=1, max_length=5)]
    fleet: Annotated[str, Field(max_length=32)] | None = None
    tractor: Annotated[int, Field(ge=1, le=999)] | None = None
    expires: Annotated[str, Field(max_length=40)] | None = None


@tokens_router.get("", responses=LIST_ERRORS, operation_id="list_tokens")
def list_tokens(request: Request, _caller: AdminAccess) -> TokenList:
    """All tokens with name, scopes and expiry; their texts are stored nowhere."""
    return TokenList.model_validate({"items": request.app.state.store.list_tokens()})


@tokens_router.post("", status_code=201, responses=CHANGE_ERRORS, operation_id="make_token")
def create_token(request: Request, caller: AdminAccess, body: TokenRequest) -> NewToken:
    """Make a token; its text is shown only once."""
    store: Store = request.app.state.store
    text, row = store.create_token(body.name, body.scopes, fleet=body.fleet, tractor=body.tractor, expires=body.expires)
    _refresh_token_cache(request)
    info = TokenInfo.model_validate(row)
    store.add_event(None, caller.name, "token made", info.model_dump(exclude_none=True, exclude={"created"}))
    return NewToken(**info.model_dump(), token=text)


@tokens_router.delete("/{name}", status_code=204, responses=ITEM_ERRORS, operation_id="revoke_token")
def revoke_token(request: Request, caller: AdminAccess, name: str) -> None:
    """Revoke a token."""
    request.app.state.store.revoke_token(name)
    _refresh_token_cache(request)
    request.app.state.store.add_event(None, caller.name, "token revoked", {"name": name})


def _refresh_token_cache(request: Request) -> None:
    """Read the tokens again in this process; a separate control process does so itself."""
    token_cache: TokenCache | None = getattr(request.app.state, "book", None)
    if token_cache is not None:
        token_cache.refresh()
