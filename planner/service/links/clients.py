"""Who is linked to a fleet."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from planner.service.links.outbox import Outbox

TRACTOR, TWIN, CONTROL, VIEWER = "tractor", "twin", "control", "viewer"


@dataclass(eq=False)
class Client:
    """One linked client; `who` is its name in the log, `tractor` counts from 0, `token` is the SHA-256 of its token.

    `refused` is why it is turned out, None for one that is not; `refusals` counts frames that were none for its role.
    """

    role: str
    who: str
    tractor: int | None = None
    outbox: Outbox = field(default_factory=Outbox)
    said_goodbye: bool = False
    command_sequence: int = 0
    token: str | None = None
    refused: str | None = None
    refusals: int = 0

    @property
    def watches(self) -> bool:
        """Whether it is shown the fleet."""
        return self.role != TRACTOR

    def turn_out(self, sentence: str) -> None:
        """Its link ends, and nothing that it says is taken any more; a tractor is told to stand before."""
        self.refused = sentence
        self.outbox.end(packed({"kind": "stop", "reason": sentence}) if self.role == TRACTOR else None)

    def tell(self, frame: dict[str, Any], *, first: bool = False) -> None:
        """Send it a frame."""
        self.outbox.put(packed(frame), frame["kind"], first=first)


def packed(frame: dict[str, Any]) -> str:
    """A frame as text."""
    return json.dumps(frame, separators=(",", ":"), allow_nan=False)
