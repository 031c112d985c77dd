"""Tokens for those who administer: made, listed, revoked."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel, ConfigDict, Field

from planner.service.access import Who, needs
from planner.service.api.answers import NewToken, Scope, TokenList, refusals
from planner.service.store import Store

Admin = Annotated[Who, Depends(needs("admin"))]
router = APIRouter(prefix="/tokens", tags=["tokens"])


class TokenRequest(BaseModel):
    """A token to be made."""

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(max_length=100, description="What it is called.")]
    scope: Scope


@router.get("", responses=refusals(401, 403), operation_id="list_tokens")
def listed(request: Request, _who: Admin) -> TokenList:
    """All tokens by name and scope; what they are is kept nowhere."""
    return TokenList.model_validate({"items": request.app.state.store.tokens()})


@router.post("", status_code=201, responses=refusals(401, 403, 409, 422), operation_id="make_token")
def made(request: Request, who: Admin, body: TokenRequest) -> NewToken:
    """Make a token; it is shown this once."""
    store: Store = request.app.state.store
    text = store.new_token(body.name, body.scope)
    store.add_event(None, who.name, "token made", {"name": body.name, "scope": body.scope})
    return NewToken(name=body.name, scope=body.scope, token=text)


@router.delete("/{name}", status_code=204, responses=refusals(401, 403, 404, 422), operation_id="revoke_token")
def revoked(request: Request, who: Admin, name: str) -> None:
    """Take a token back."""
    request.app.state.store.revoke_token(name)
    request.app.state.store.add_event(None, who.name, "token revoked", {"name": name})
