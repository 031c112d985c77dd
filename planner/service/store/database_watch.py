"""Threads that ask the database every second; one tries whether it takes writes."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable

from sqlalchemy.exc import SQLAlchemyError

from planner.service.errors import ServiceError
from planner.service.store.database import shorten_error
from planner.service.store.service_store import Store

PERIOD_S = 1.0
TIMEOUT_S, STALE_S = 2.0 * PERIOD_S, 5.0 * PERIOD_S
"""How long others wait for the database, and until what it said last is old."""


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
