"""What waits to be sent to one client, never without end: who reads slowly costs no memory and holds up nobody."""

from __future__ import annotations

import asyncio
from collections import deque

MOST = 500
WELCOME = "welcome"


class Outbox:
    """Frames in order, and apart from them the newest tick, which replaces one that was not sent yet.

    When more than `most` frames wait, they are dropped and `overflowed` is set: whoever fills it starts afresh.
    """

    def __init__(self, most: int = MOST) -> None:
        self._waiting: deque[tuple[str, str]] = deque()
        self._newest: str | None = None
        self._last: str | None = None
        self._most = most
        self._filled = asyncio.Event()
        self.overflowed = self.ended = False
        self.dropped_ticks = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, text: str, kind: str = "", *, first: bool = False) -> None:
        """One more frame; with `first` before all others that wait but a welcome, by which a client knows its plan."""
        if len(self._waiting) >= self._most:
            self._waiting.clear()
            self.overflowed = True
        if first:
            self._waiting.insert(bool(self._waiting) and self._waiting[0][1] == WELCOME, (text, kind))
        else:
            self._waiting.append((text, kind))
        self._filled.set()

    def withdraw(self, kinds: frozenset[str]) -> None:
        """Frames of these kinds that still wait are not sent any more."""
        self._waiting = deque(each for each in self._waiting if each[1] not in kinds)

    def put_newest(self, text: str) -> None:
        """A tick."""
        self.dropped_ticks += self._newest is not None
        self._newest = text
        self._filled.set()

    def end(self, last: str | None = None) -> None:
        """Nothing more is sent, but for a last frame."""
        self.ended, self._last = True, last
        self._filled.set()

    async def take(self) -> str | None:
        """The next frame to be sent, as soon as there is one; None at the end."""
        while not self.ended:
            if self._waiting:
                return self._waiting.popleft()[0]
            if self._newest is not None:
                newest, self._newest = self._newest, None
                return newest
            self._filled.clear()
            await self._filled.wait()
        last, self._last = self._last, None
        return last
