"""Whether the database takes writes: one is tried every second, in a thread of its own."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable

from sqlalchemy.exc import SQLAlchemyError

from planner.service.errors import ServiceError
from planner.service.store.database import shorten_error
from planner.service.store.service_store import Store

WRITE_PERIOD_S, FIRST_WRITE_TIMEOUT_S, STALE_S = 1.0, 2.0, 5.0


class DatabaseWatch:
    """How long ago a write went through, and how long it took; revocations that wait are written first."""

    def __init__(self, store: Store, clock: Callable[[], float] = time.monotonic) -> None:
        self._store, self._clock = store, clock
        self._written_at = -math.inf
        self._closing, self._is_first_over = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self.last_write_s = math.nan
        self.last_error: str | None = None

    @property
    def age_s(self) -> float:
        """Seconds since a write went through; infinite before the first."""
        return self._clock() - self._written_at

    @property
    def is_writable(self) -> bool:
        """Whether a write went through in the last seconds."""
        return self.age_s <= STALE_S

    def start(self) -> None:
        """Start writing; returns after the first write, or after two seconds."""
        if self._thread is None:
            self._closing.clear()
            self._is_first_over.clear()
            self._thread = threading.Thread(target=self._write_forever, name="headland-watch", daemon=True)
            self._thread.start()
            self._is_first_over.wait(FIRST_WRITE_TIMEOUT_S)

    def close(self) -> None:
        """Stop writing; a write that waits for the database is left to itself."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(FIRST_WRITE_TIMEOUT_S)
            self._thread = None

    def write_once(self) -> bool:
        """Try a write; whether it went through."""
        begun_at = self._clock()
        try:
            self._store.write_revocations()
            self._store.check_write()
        except (SQLAlchemyError, ServiceError, OSError) as error:
            if self.last_error is None:  # logged once, not every second
                logging.getLogger(__name__).error("The database takes no writes: %s", error)
            self.last_error = shorten_error(getattr(error, "orig", None) or error)
            return False
        self._written_at = self._clock()
        self.last_write_s, self.last_error = self._written_at - begun_at, None
        return True

    def _write_forever(self) -> None:
        while not self._closing.is_set():
            with contextlib.suppress(Exception):  # without this thread the service would never be ready again
                self.write_once()
            self._is_first_over.set()
            self._closing.wait(WRITE_PERIOD_S)
