"""What has been worked: the line of the guided point of each tractor while its implement is down."""

from __future__ import annotations

import math

STEP_M = 1.0
MOST_POINTS = 20_000  # of one tractor: twenty kilometres of track
Point = tuple[float, float] | None
"""A place in metres of the plan; None where the implement was lifted."""


class Painting:
    """Lines by tractor, growing."""

    def __init__(self, tractors: int) -> None:
        self.lines: list[list[Point]] = [[] for _ in range(tractors)]

    def at(self, tractor: int, x_m: float, y_m: float, works: bool) -> None:
        """A tractor is there, with its implement at work or not."""
        line = self.lines[tractor]
        if not works:
            if line and line[-1] is not None:
                line.append(None)
            return
        last = line[-1] if line else None
        if (last is None or math.dist(last, (x_m, y_m)) >= STEP_M) and len(line) < MOST_POINTS:
            line.append((x_m, y_m))

    def since(self, tractor: int, count: int) -> list[Point]:
        """What was painted after the first so many points."""
        return self.lines[tractor][count:]
