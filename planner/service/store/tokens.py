"""Tokens: made, found, listed, revoked. What is kept of one is its SHA-256."""

from __future__ import annotations

import hashlib
import secrets

import sqlalchemy as sa

from planner.service.errors import MissingError, ServiceError, TakenError
from planner.service.store.base import Part, checked_name, is_text, now
from planner.service.store.models import Token

SCOPES = ("read", "control", "admin")
"""What a token may do: each also what those before it may."""
PREFIX = "hl_"


class Tokens(Part):
    """The tokens."""

    def new_token(self, name: str, scope: str) -> str:
        """Make a token; its text is known to nobody afterwards. Raises ServiceError, TakenError."""
        if scope not in SCOPES:
            raise ServiceError(f"The scope {scope!r} is unknown; use {', '.join(SCOPES)}.", parameter="scope")
        text = PREFIX + secrets.token_urlsafe(32)
        row = Token(name=checked_name(name), scope=scope, sha256=digest(text), created=now())
        try:
            with self.database.writes() as session:
                session.add(row)
        except sa.exc.IntegrityError:
            sentence = f"There is a token {name!r}; choose another name or revoke it."
            raise TakenError(sentence, parameter="name") from None
        return text

    def token(self, text: str) -> Token | None:
        """What a text gives leave to, None where it is no token."""
        with self.database.reads() as session:
            return session.scalar(sa.select(Token).where(Token.sha256 == digest(text)))

    def tokens(self) -> list[Token]:
        """All tokens, the oldest first."""
        with self.database.reads() as session:
            return list(session.scalars(sa.select(Token).order_by(Token.id)))

    def revoke_token(self, name: str) -> None:
        """A token that is worth nothing from now on; raises MissingError."""
        with self.database.writes() as session:
            row = session.scalar(sa.select(Token).where(Token.name == name)) if is_text(name) else None
            if row is None:
                raise MissingError(f"There is no token {name!r}; headland token list shows all.", parameter="name")
            session.delete(row)


def digest(text: str) -> str:
    """The SHA-256 of a token."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
