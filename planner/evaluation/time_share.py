"""The computing time that one field may take of a day, asked for before every search, simulation and layout.

It is the time of the thread that computes, so that other work on the machine takes nothing of it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

from fields.errors import StopError


class TimeSpentError(StopError):
    """The share is spent: who tries another plan must stop too."""


class TimeShare:
    """Seconds of the thread in which it is made; `is_cut` tells whether something was left undone for lack of them."""

    def __init__(self, seconds: float = math.inf) -> None:
        self.is_cut = False
        self._seconds, self._part = seconds, 1.0
        self._begun_s = time.thread_time()

    def is_spent(self) -> bool:
        """Whether nothing more may be begun; who asks leaves it undone."""
        is_spent = time.thread_time() - self._begun_s > self._part * self._seconds
        self.is_cut = self.is_cut or is_spent
        return is_spent

    def check(self) -> None:
        """Raise TimeSpentError if the share is spent."""
        if self.is_spent():
            raise TimeSpentError

    @contextmanager
    def save_half(self) -> Iterator[TimeShare]:
        """Let the body use no more than the first half of the share."""
        self._part = 0.5
        try:
            yield self
        finally:
            self._part = 1.0

    def lift(self) -> None:
        """End the limit, to write down what is known."""
        self._seconds = math.inf


NO_LIMIT = TimeShare()
