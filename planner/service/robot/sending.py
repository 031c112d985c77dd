"""States that wait to be acknowledged: sent again when the link comes back; too many lose the oldest."""

from __future__ import annotations

import json
from collections import deque
from typing import Any

MOST = 6000  # ten minutes at 10 Hz


class Unacknowledged:
    """States in order of their sequences."""

    def __init__(self, most: int = MOST) -> None:
        self._waiting: deque[tuple[int, str]] = deque(maxlen=most)
        self.lost = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, state: dict[str, Any]) -> str:
        """One more; its text."""
        text = json.dumps(state, separators=(",", ":"))
        self.lost += len(self._waiting) == self._waiting.maxlen
        self._waiting.append((int(state["sequence"]), text))
        return text

    def acknowledged(self, sequence: int) -> None:
        """All up to this one are kept by the centre."""
        while self._waiting and self._waiting[0][0] <= sequence:
            self._waiting.popleft()

    def after(self, sequence: int) -> list[tuple[int, str]]:
        """What is to be sent when all up to a sequence was: sequences and texts."""
        return [each for each in self._waiting if each[0] > sequence]
