"""The table of tokens, of which only the SHA-256 is stored."""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, date, datetime, time, timedelta
from itertools import count
from typing import Any, Literal, get_args

import sqlalchemy as sa

from planner.fleet.session.frame_timing import format_utc
from planner.fleet.session.inbound_frames import MOST_TRACTORS
from planner.service.errors import ConflictError, NotFoundError, ServiceError
from planner.service.settings import LIMITS
from planner.service.store.disk_storage import hash_bytes
from planner.service.store.store_part import Revocation, StorePart, check_name, is_storable_text
from planner.service.store.tables import EventRow, FleetRow, TokenRow

TokenScope = Literal["read", "planner", "operator", "robot", "admin"]
"""Scopes of tokens; their rights are in planner.service.access.permissions."""
SCOPES, ROBOT = get_args(TokenScope), "robot"
TOKEN_PREFIX = "hl_"
NEVER, ROBOT_TOKEN_LIFE = "never", "30d"
PERIOD_PATTERN = re.compile(r"([0-9]{1,6})([mhd])")
PERIOD_UNITS = {"m": "minutes", "h": "hours", "d": "days"}
BROWSER_TOKEN_PREFIX, BROWSER_SCOPES, BROWSER_TOKEN_LIFE = "browser ", "operator planner", "30d"


class TokenStore(StorePart):
    """The tokens."""

    def create_token_text(self, name: str, scopes: str | Iterable[str], **options: Any) -> str:
        """The text of a new token, as of `create_token`."""
        return self.create_token(name, scopes, **options)[0]

    def create_token(
        self,
        name: str,
        scopes: str | Iterable[str],
        *,
        fleet: str | None = None,
        tractor: int | None = None,
        expires: str | None = None,
        is_for_browser: bool = False,
    ) -> tuple[str, TokenRow]:
        """Make a token: its text, which is stored nowhere, and its row.

        `expires` is as of `parse_expiry`; without it a robot's token ends after 30 days and others never. Raises
        ServiceError, also for a name that browsers have, NotFoundError for a fleet that there is not, ConflictError.
        """
        if name.startswith(BROWSER_TOKEN_PREFIX) and not is_for_browser:
            raise ServiceError(
                f"The name {name!r} is one for browsers that log in on the machine of the service; choose a name that "
                f"does not begin with {BROWSER_TOKEN_PREFIX.strip()!r}.",
                parameter="name",
            )
        chosen = check_scopes(scopes.split() if isinstance(scopes, str) else scopes)
        check_robot_binding(chosen, fleet, tractor)
        end = parse_expiry(expires or (ROBOT_TOKEN_LIFE if ROBOT in chosen else NEVER))
        text = TOKEN_PREFIX + secrets.token_urlsafe(32)
        row = TokenRow(
            name=check_name(name), identity=secrets.token_hex(16), scopes=" ".join(chosen), sha256=hash_token(text),
            created=format_utc(), fleet=fleet, tractor=tractor, expires=end,
        )  # fmt: skip
        try:
            with self.database.open_write_session() as session:
                if fleet is not None and (not is_storable_text(fleet) or session.get(FleetRow, fleet) is None):
                    raise NotFoundError(
                        f"There is no fleet {fleet[:60]!r}; the address of its page, and /api/v1/fleets, show its id.",
                        parameter="fleet",
                    )
                session.add(row)
        except sa.exc.IntegrityError:
            sentence = f"There is a token {name!r}; choose another name or revoke it."
            raise ConflictError(sentence, parameter="name") from None
        return text, row

    def list_tokens(self) -> list[TokenRow]:
        """All tokens, the oldest first, expired ones included, without those whose revocation still waits."""
        waiting = set(self.revocations.list_waiting())  # listed before too: one that is written meanwhile waits no more
        rows = self.database.list_rows(sa.select(TokenRow).order_by(TokenRow.id))
        waiting |= set(self.revocations.list_waiting())
        return [row for row in rows if row.sha256 not in waiting]

    def create_browser_token(self) -> str | None:
        """The text of a token that plans and operates, for a browser that logs in on the machine of the service.

        None once somebody has made a token by hand: then tokens say who may do what.
        """
        names = {row.name for row in self.list_tokens()}
        if not all(name.startswith(BROWSER_TOKEN_PREFIX) for name in names):
            return None
        number = next(each for each in count(1) if f"{BROWSER_TOKEN_PREFIX}{each}" not in names)
        name = f"{BROWSER_TOKEN_PREFIX}{number}"
        return self.create_token(name, BROWSER_SCOPES, expires=BROWSER_TOKEN_LIFE, is_for_browser=True)[0]

    def revoke_token(self, name: str, who: str | None = None) -> None:
        """Revoke a token, by `who` for the list of events; raises NotFoundError.

        It holds from now on, also while nothing can be written to the database: then it waits in a file.
        """
        row = next((each for each in self.list_tokens() if each.name == name), None)
        if row is None:
            raise self.build_unknown_token_error(name)
        revocation = Revocation(row.sha256, row.name, who)
        self.revocations.add(revocation)
        with suppress(sa.exc.SQLAlchemyError, ServiceError):
            self.write_revocation(revocation)

    def build_unknown_token_error(self, name: str) -> NotFoundError:
        """The refusal of a name that no token has."""
        command = f"headland token list{self.settings.data_option}"
        return NotFoundError(f"There is no token {name!r}; {command} shows all.", parameter="name")

    def write_revocation(self, revocation: Revocation) -> None:
        """Delete a revoked token. Raises SQLAlchemyError, ServiceError where nothing can be written."""
        with self.database.open_write_session() as session:
            deleted = self.database.execute_change(
                session, sa.delete(TokenRow).where(TokenRow.sha256 == revocation.sha256)
            )
            if deleted and revocation.who is not None:
                event = EventRow(time=format_utc(), who=revocation.who[:120], what="token revoked")
                event.data = {"name": revocation.name}
                session.add(event)
        self.revocations.remove(revocation)

    def write_revocations(self) -> None:
        """Delete the tokens whose revocation waits; raises as `write_revocation` does."""
        for revocation in self.revocations.list_waiting().values():
            self.write_revocation(revocation)


def hash_token(token_text: str) -> str:
    """The SHA-256 of a token."""
    return hash_bytes(token_text.encode("utf-8", "surrogatepass"))


def has_expired(row: TokenRow) -> bool:
    """Whether a token has expired."""
    return row.expires is not None and row.expires <= format_utc()


def check_scopes(scopes: Iterable[str]) -> tuple[str, ...]:
    """Scopes in alphabetical order, each once; raises ServiceError for none or an unknown one."""
    chosen = tuple(sorted(set(scopes)))
    unknown = next((each for each in chosen if each not in SCOPES), None)
    if unknown is not None or not chosen:
        problem = "No scope is given" if unknown is None else f"The scope {unknown[:40]!r} is unknown"
        raise ServiceError(f"{problem}; use {', '.join(SCOPES[:-1])} or {SCOPES[-1]}.", parameter="scope")
    return chosen


def check_robot_binding(scopes: tuple[str, ...], fleet: str | None, tractor: int | None) -> None:
    """Check that a robot's token, and no other, is bound to one tractor of one fleet; raises ServiceError."""
    if ROBOT not in scopes:
        if fleet is not None or tractor is not None:
            raise ServiceError(
                f"A token of the scope {' '.join(scopes)} is bound to no tractor; leave out fleet and tractor, or use "
                "the scope robot.",
                parameter="tractor" if fleet is None else "fleet",
            )
        return
    if scopes != (ROBOT,):
        raise ServiceError("A token of the scope robot has no other scope; make one for each.", parameter="scope")
    if fleet is None or tractor is None:
        lacking = "fleet" if fleet is None else "tractor"
        raise ServiceError(
            f"A token of the scope robot is for one tractor of one fleet; give its {lacking} too.", parameter=lacking
        )
    if not 1 <= tractor <= MOST_TRACTORS:
        raise ServiceError(f"The tractor is {tractor}; use 1 to {MOST_TRACTORS}.", parameter="tractor")


def parse_expiry(text: str) -> str | None:
    """When a token expires, in UTC; None for never.

    `text` is a period ("90m", "12h", "30d"), a date, whose day is included, a time in ISO 8601 (UTC where it names no
    zone), or "never". Raises ServiceError for others, and for an end that is past or further off than ten years.
    """
    if text == NEVER:
        return None
    begin, period = datetime.now(UTC), PERIOD_PATTERN.fullmatch(text)
    try:
        if period is not None:
            end = begin + timedelta(**{PERIOD_UNITS[period[2]]: int(period[1])})
        elif len(text) == len("2027-01-31"):
            end = datetime.combine(date.fromisoformat(text), time.min, UTC) + timedelta(days=1)
        else:
            end = datetime.fromisoformat(text)
            end = end.replace(tzinfo=UTC) if end.tzinfo is None else end.astimezone(UTC)
    except (ValueError, OverflowError):
        raise ServiceError(
            f"The end {text[:40]!r} cannot be read; write 30d, 12h, 90m, a date such as 2027-01-31, a time such as "
            "2027-01-31T18:00:00Z, or never.",
            parameter="expires",
        ) from None
    if not begin < end <= begin + timedelta(days=LIMITS.longest_life_days):
        shown = format_utc(end.timestamp())
        raise ServiceError(
            f"The end {text[:40]!r} is {shown}; choose one that is to come, within ten years, or never.",
            parameter="expires",
        )
    return format_utc(end.timestamp())
