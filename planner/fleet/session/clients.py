"""Linked clients of a fleet and their outboxes, which are bounded: a slow reader costs no memory and delays nobody."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from dataclasses import dataclass, field
from typing import Any

MOST_FRAMES = 500
WELCOME = "welcome"
TRACTOR, CONTROL = "tractor", "control"


class FrameOutbox:
    """Frames in order, and separately the newest tick, which replaces one not sent yet.

    When more than `most` frames wait, they are dropped and `overflowed` is set: the sender must send everything again.
    """

    def __init__(self, most: int = MOST_FRAMES) -> None:
        self._waiting: deque[tuple[str, str]] = deque()
        self._newest: str | None = None
        self._last: str | None = None
        self._most = most
        self._filled = asyncio.Event()
        self.overflowed = self.ended = False

    def __len__(self) -> int:
        return len(self._waiting)

    def put_frame(self, text: str, kind: str = "", *, is_first: bool = False) -> None:
        """Add a frame; with `is_first` before all others except a welcome, which must come first."""
        if len(self._waiting) >= self._most:
            self._waiting.clear()
            self.overflowed = True
        if is_first:
            self._waiting.insert(bool(self._waiting) and self._waiting[0][1] == WELCOME, (text, kind))
        else:
            self._waiting.append((text, kind))
        self._filled.set()

    def drop_frames_of_kinds(self, kinds: frozenset[str]) -> None:
        """Drop waiting frames of these kinds."""
        self._waiting = deque(waiting for waiting in self._waiting if waiting[1] not in kinds)

    def replace_waiting_tick(self, text: str) -> None:
        """Replace the waiting tick."""
        self._newest = text
        self._filled.set()

    def end_with_frame(self, last: str | None = None) -> None:
        """Send nothing more except a last frame."""
        self.ended, self._last = True, last
        self._filled.set()

    async def take_next_frame(self) -> str | None:
        """The next frame to send, as soon as there is one; None at the end."""
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


@dataclass(eq=False)
class FleetClient:
    """One linked client; `who` is its name in the log, `tractor` counts from 0, `token` is the SHA-256 of its token.

    `expulsion_reason` is set once it is expelled; `refusals` counts frames that its role may not send.
    """

    role: str
    who: str
    tractor: int | None = None
    outbox: FrameOutbox = field(default_factory=FrameOutbox)
    has_disconnected: bool = False
    command_sequence: int = 0
    token: str | None = None
    expulsion_reason: str | None = None
    refusals: int = 0

    @property
    def is_watcher(self) -> bool:
        """Whether it is shown the whole fleet."""
        return self.role != TRACTOR

    def expel(self, sentence: str) -> None:
        """End its link and ignore its frames; a tractor is ordered to stop first."""
        self.expulsion_reason = sentence
        self.outbox.end_with_frame(encode_frame({"kind": "stop", "reason": sentence}) if self.role == TRACTOR else None)

    def send(self, frame: dict[str, Any], *, first: bool = False) -> None:
        """Send a frame to this client."""
        self.outbox.put_frame(encode_frame(frame), frame["kind"], is_first=first)


def encode_frame(frame: dict[str, Any]) -> str:
    """A frame as text."""
    return json.dumps(frame, separators=(",", ":"), allow_nan=False)
