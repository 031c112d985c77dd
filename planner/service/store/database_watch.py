"""Threads that ask the database every second: one keeps all tokens in memory, one tries whether it takes writes."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future

from sqlalchemy.exc import SQLAlchemyError

from planner.service.errors import DatabaseError, ServiceError, TokenError
from planner.service.settings import LIMITS
from planner.service.store.database import shorten_error
from planner.service.store.service_store import Store
from planner.service.store.store_part import Revocation
from planner.service.store.tables import TokenRow
from planner.service.store.token_table import TOKEN_PREFIX, has_expired, hash_token

PERIOD_S = 1.0
TIMEOUT_S, STALE_S = 2.0 * PERIOD_S, 5.0 * PERIOD_S
"""How long others wait for the database, and until what it said last is old."""
SHORTEST_PERIOD_S = PERIOD_S / 5
UNKNOWN_TOKEN = "This token is unknown; it may have been revoked."
UNREACHABLE_DATABASE = "This token is unknown, and a new one cannot be looked up now: the database does not answer."
EXPIRED_TOKEN = "This token expired at {expires}; make a new one with headland token new."
REVOKED_LINK_TOKEN = "The token of this link was revoked; link again with another one."
REVOKED_UNTIL_RESTART = (
    "The token {name!r} is refused from now on, but only until a restart, as nothing can be stored now; revoke it "
    "again once the database and the disk can be used."
)
EXPIRED_LINK_TOKEN = "The token of this link has expired; link again with another one."


class DatabaseThread:
    """Does something with the database every second in a thread of its own, and knows when that last went well."""

    def __init__(self, name: str, act: Callable[[], bool], clock: Callable[[], float]) -> None:
        self._name, self._act, self._clock = name, act, clock
        self._succeeded_at = -math.inf
        self._closing, self._is_first_over = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self.last_error: str | None = None

    @property
    def age_s(self) -> float:
        """Seconds since it last went well; infinite before the first time."""
        return self._clock() - self._succeeded_at

    @property
    def is_fresh(self) -> bool:
        """Whether it went well in the last seconds."""
        return self.age_s <= STALE_S

    def start(self) -> None:
        """Start; returns after the first time, or after two seconds."""
        if self._thread is None:
            self._closing.clear()
            self._is_first_over.clear()
            self._thread = threading.Thread(target=self._act_forever, name=self._name, daemon=True)
            self._thread.start()
            self._is_first_over.wait(TIMEOUT_S)

    def close(self) -> None:
        """Stop; what waits for the database is left to itself."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(TIMEOUT_S)
            self._thread = None

    def note_success(self) -> None:
        """It went well just now."""
        self._succeeded_at, self.last_error = self._clock(), None

    def note_error(self, message: str, error: Exception) -> None:
        """It failed; the message is logged once, not every second."""
        words = shorten_error(getattr(error, "orig", None) or error)
        if self.last_error is None:
            logging.getLogger(__name__).error(message, words)
        self.last_error = words

    def pause(self) -> None:
        """Wait until the next time."""
        self._closing.wait(PERIOD_S)

    def _act_forever(self) -> None:
        while not self._closing.is_set():
            try:
                self._act()
            except Exception:  # without this thread the service would never be ready again, and no token be revoked
                logging.getLogger(__name__).exception("The thread %s", self._name)
            self._is_first_over.set()
            self.pause()


class DatabaseWatch(DatabaseThread):
    """How long ago a write went through, and how long it took; revocations that wait are written first."""

    def __init__(self, store: Store, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__("headland-watch", self.write_once, clock)
        self._store = store
        self.last_write_s = math.nan

    def write_once(self) -> bool:
        """Try a write; whether it went through."""
        begun_at = self._clock()
        try:
            self._store.write_revocations()
            self._store.check_write()
        except (SQLAlchemyError, ServiceError, OSError) as error:
            self.note_error("The database takes no writes: %s", error)
            return False
        self.note_success()
        self.last_write_s = self._clock() - begun_at
        return True


class TokenCache(DatabaseThread):
    """The tokens of a store by their SHA-256, as they were when the database last answered.

    A thread reads them every second from `start` to `close`. While the database does not answer, known tokens stay
    valid until they expire. Every method may be called from any thread.
    """

    def __init__(self, store: Store, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__("headland-tokens", self.refresh, clock)
        self._store = store
        self._rows: dict[str, TokenRow] = {}
        self._revoked: set[str] = set()
        self._waiting: list[Future[None]] = []
        self._lock, self._refresh_lock = threading.Lock(), threading.Lock()
        self._refresh_requested = threading.Event()

    def close(self) -> None:
        """Stop reading."""
        self._closing.set()
        self._refresh_requested.set()
        super().close()

    def find_token(self, token_text: str) -> TokenRow | None:
        """The token of a text, from memory only: never waits. None for an unknown or expired one."""
        row = self._rows.get(hash_token(token_text))
        return None if row is None or has_expired(row) else row

    async def identify_token(self, token_text: str) -> TokenRow:
        """The token of a text; an unknown one is looked up once more, which may take two seconds.

        Raises TokenError for an unknown or expired token.
        """
        can_be_new = token_text.startswith(TOKEN_PREFIX) and len(token_text) <= LIMITS.longest_token_chars
        if can_be_new and hash_token(token_text) not in self._rows:
            if self._thread is None:
                await asyncio.to_thread(self.refresh)
            else:
                with contextlib.suppress(TimeoutError):
                    future: Future[None] = Future()
                    with self._lock:
                        self._waiting.append(future)
                    self._refresh_requested.set()
                    async with asyncio.timeout(TIMEOUT_S):
                        await asyncio.wrap_future(future)
        row = self._rows.get(hash_token(token_text))
        if row is None:
            raise TokenError(UNKNOWN_TOKEN if self.is_fresh else UNREACHABLE_DATABASE, parameter="token")
        if has_expired(row):
            raise TokenError(EXPIRED_TOKEN.format(expires=row.expires), parameter="token")
        return row

    async def revoke_token(self, name: str, who: str) -> None:
        """Revoke a token: it is refused when this returns, whatever the database does, and stays so after a restart.

        Raises NotFoundError, and DatabaseError where it holds only until a restart, as nothing can be stored.
        """
        row = self._find_by_name(name)
        if row is None and await asyncio.to_thread(self.refresh):
            row = self._find_by_name(name)
        if row is None:
            raise self._store.build_unknown_token_error(name)
        with self._lock:
            self._revoked.add(row.sha256)
            self._rows = {sha256: each for sha256, each in self._rows.items() if sha256 != row.sha256}
        revocation, is_kept = Revocation(row.sha256, row.name, who), False
        with contextlib.suppress(ServiceError, OSError):
            await asyncio.to_thread(self._store.revocations.add, revocation)
            is_kept = True
        writing = asyncio.create_task(asyncio.to_thread(self._store.write_revocation, revocation))
        done, _ = await asyncio.wait([writing], timeout=TIMEOUT_S if is_kept else None)
        if writing in done and (error := writing.exception()) is not None and not is_kept:
            raise DatabaseError(REVOKED_UNTIL_RESTART.format(name=name)) from error

    def _find_by_name(self, name: str) -> TokenRow | None:
        return next((row for row in self._rows.values() if row.name == name), None)

    def refresh(self) -> bool:
        """Read all tokens now; False where the database does not answer, which leaves all as it was."""
        with self._refresh_lock:
            with self._lock:
                waiting, self._waiting = self._waiting, []
            try:
                rows = {row.sha256: row for row in self._store.list_tokens()}
            except (SQLAlchemyError, ServiceError, OSError) as error:
                self.note_error("Tokens cannot be read; known ones stay valid: %s", error)
            else:
                with self._lock:  # what was revoked while they were read stays revoked
                    self._rows = {sha256: row for sha256, row in rows.items() if sha256 not in self._revoked}
                self.note_success()
            finally:
                for future in waiting:
                    if future.set_running_or_notify_cancel():
                        future.set_result(None)
            return self.last_error is None

    def find_invalid_tokens(self, token_digests: Iterable[str]) -> dict[str, str]:
        """Of these tokens, by SHA-256, the revoked and expired ones, each with the sentence that ends its link."""
        rows, reasons = self._rows, {}
        if math.isinf(self.age_s):
            return {}
        for sha256 in token_digests:
            row = rows.get(sha256)
            if row is None or has_expired(row):
                reasons[sha256] = REVOKED_LINK_TOKEN if row is None else EXPIRED_LINK_TOKEN
        return reasons

    def pause(self) -> None:
        """Wait until somebody asks for a reading, or a second; overrides DatabaseThread.pause.

        However many unknown texts arrive, the database is read at most five times a second.
        """
        self._closing.wait(SHORTEST_PERIOD_S)
        self._refresh_requested.wait(PERIOD_S - SHORTEST_PERIOD_S)
        self._refresh_requested.clear()
