"""Time of the day without breaks: on this clock work and ways go on without a pause."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.scenario import DAY_S

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Clock:
    """Seconds of the day on one side, working seconds on the other; `breaks` are sorted and apart, (from, to)."""

    breaks: tuple[tuple[int, int], ...] = ()

    def working(self, at_s: float) -> float:
        """Working seconds until a time of the day; the same for all of a break."""
        return at_s - sum(min(max(at_s - start, 0.0), end - start) for start, end in self.breaks)

    def all_working(self, at_s: Array) -> Array:
        """The same for many times; infinite ones stay so."""
        lost = [np.clip(at_s - start, 0.0, end - start) for start, end in self.breaks]
        return np.asarray(at_s - np.sum(lost, axis=0)) if lost else at_s

    def begin(self, working_s: float) -> float:
        """When on the day something begins: after a break rather than before it."""
        return working_s + sum(end - start for start, end in self.breaks if self.working(start) <= working_s)

    def end(self, working_s: float) -> float:
        """When on the day something ends: before a break rather than after it."""
        return working_s + sum(end - start for start, end in self.breaks if self.working(start) < working_s)


def clock_of(breaks: Iterable[tuple[int, int]], start_s: int) -> Clock:
    """The clock of a day that begins at `start_s`; breaks that are over by then are those of the next day."""
    moved = sorted(
        (start + DAY_S, end + DAY_S) if end <= start_s else (start, end) for start, end in breaks if end > start
    )
    merged: list[tuple[int, int]] = []
    for start, end in moved:
        if merged and start <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        else:
            merged.append((start, end))
    return Clock(tuple(merged))
