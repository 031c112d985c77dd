"""Results that may be looked at once without a token: a frame of a page cannot send one."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable

from planner.service.errors import BusyError, MissingError
from planner.service.store.models import Result

VALID_S, MOST = 60.0, 1000


class Views:
    """Views that were given out and not yet used; whoever has the name of one may look."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._open: dict[str, tuple[float, Result]] = {}

    def add(self, result: Result) -> str:
        """The name of a new view; raises BusyError where too many wait."""
        now, name = self._clock(), secrets.token_urlsafe(24)
        with self._lock:
            self._open = {key: each for key, each in self._open.items() if each[0] > now}
            if len(self._open) >= MOST:
                raise BusyError(f"{MOST} views wait to be looked at; ask again in a minute.")
            self._open[name] = (now + VALID_S, result)
        return name

    def take(self, name: str) -> Result:
        """What a view shows; it is gone then. Raises MissingError."""
        with self._lock:
            until, result = self._open.pop(name, (0.0, None))
        if result is None or until <= self._clock():
            raise MissingError("There is no such view, or it was looked at; ask for another.", parameter="view")
        return result
