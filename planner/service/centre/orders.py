"""What leaves the centre: orders to tractors, and the log of who did what."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Order:
    """A frame to one tractor; `kind` and `data` as the link sends them, angles in radians."""

    tractor: int
    kind: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Event:
    """Somebody did something, or something happened (`who` is "centre")."""

    who: str
    what: str
    data: dict[str, Any] = field(default_factory=dict)
