"""Which lines each tractor of a fleet may work, before a search puts them in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from strategies.path_planning.errors import build_too_many_error
from strategies.program.driving_rules import DrivingRules
from vehicle.missions.plan import SWATH, LegTask


class DealtLine(Protocol):
    """What a deal goes by: a work line's task and its length in metres."""

    @property
    def task(self) -> LegTask: ...

    @property
    def length_m(self) -> float: ...


@dataclass(frozen=True, eq=False)
class LineDeal:
    """What every tractor may do.

    Attributes:
        allowed: (tractors, lines) whether a tractor may work a line.
        stagger_m: each begins when the one before has worked so far; 0 where all begin at once.
    """

    allowed: npt.NDArray[np.bool_]
    stagger_m: float = 0.0


DealLines = Callable[[Sequence[DealtLine], DrivingRules, int], LineDeal]
"""Deals lines, given how tractors drive, to a number of tractors; raises StrategyError where they are too few."""


def group_swath_lines(lines: Sequence[DealtLine], tractors: int) -> list[list[int]]:
    """Numbers of the lines of each swath, neighbours after one another; raises StrategyError with too many tractors."""
    by_swath: dict[int, list[int]] = {}
    for number, line in enumerate(lines):
        if line.task.kind == SWATH:
            by_swath.setdefault(line.task.number or 0, []).append(number)
    if len(by_swath) < tractors:
        raise build_too_many_error(tractors, len(by_swath))
    return [by_swath[swath] for swath in sorted(by_swath)]


def free_other_lines(lines: Sequence[DealtLine], tractors: int) -> npt.NDArray[np.bool_]:
    """A deal (tractors, lines) of everything but swaths: whoever is near or has time may work it."""
    return np.tile([line.task.kind != SWATH for line in lines], (tractors, 1))
