"""Which lines each tractor of a fleet may work, before a search puts them in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fields.arrays import Flags
from strategies.path_planning.errors import StrategyError
from strategies.rules.driving_rules import DrivingRules
from vehicle.missions.plan import SWATH, LegTask

WEIGHT_RESOLUTION = 1e-6  # of the heaviest line


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
        places: (lines,) by which every tractor works its lines, the lowest first, unless only another order can be
            driven; None where any order will do. Whether headland or swaths come first is settled before that.
    """

    allowed: Flags
    stagger_m: float = 0.0
    places: Sequence[int] | None = None

    def rank(self, stages: Sequence[int]) -> list[int]:
        """Stages of lines in which those of one stage have an order."""
        if self.places is None:
            return list(stages)
        later = 1 + max(self.places, default=0)
        return [stage * later + place for stage, place in zip(stages, self.places, strict=True)]


DealLines = Callable[[Sequence[DealtLine], DrivingRules, int], LineDeal]
"""Deals lines, given how tractors drive, to a number of tractors; raises StrategyError where they are too few."""


def group_swath_lines(lines: Sequence[DealtLine], tractors: int = 0) -> list[list[int]]:
    """Numbers of the lines of each swath, neighbours after one another.

    Raises StrategyError where lines of all kinds are fewer than the tractors, who have one each at least.
    """
    by_swath: dict[int, list[int]] = {}
    for number, line in enumerate(lines):
        if line.task.kind == SWATH:
            by_swath.setdefault(line.task.number or 0, []).append(number)
    if (count := len(lines)) < tractors:
        raise StrategyError(
            f"{tractors} tractors are more than the {count} tracks and sides of headland passes of the field; use "
            f"{count} or fewer, or a bearing with more and shorter tracks."
        )
    return [by_swath[swath] for swath in sorted(by_swath)]


def free_other_lines(lines: Sequence[DealtLine], tractors: int) -> Flags:
    """A deal (tractors, lines) of everything but swaths: whoever is near or has time may work it."""
    return np.tile([line.task.kind != SWATH for line in lines], (tractors, 1))


def cut_balanced_blocks(weights: Sequence[float], count: int) -> list[int]:
    """Borders 0 = b0 < b1 < ... = n of `count` runs, the heaviest as light as possible; n must be at least `count`.

    Without weights and runs 0 twice.

    Weights count to a millionth of the heaviest, so that rounding errors decide nothing where two cuts are as good.
    """
    heaviest = max(weights, default=1.0)
    shares = [round(weight / heaviest / WEIGHT_RESOLUTION) for weight in weights]
    low, high = max(shares, default=0), sum(shares)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if len(_pack_runs(shares, middle)) <= count else (middle + 1, high)
    sizes = _split_largest_runs(_pack_runs(shares, high), count)
    borders = [0]
    for size in sizes:
        borders.append(borders[-1] + size)
    return borders


def _pack_runs(weights: Sequence[int], max_weight: int) -> list[int]:
    """Sizes of the fewest runs none of which weighs more than `max_weight`."""
    sizes, total = [0], 0
    for weight in weights:
        if sizes[-1] and total + weight > max_weight:
            sizes.append(0)
            total = 0
        sizes[-1] += 1
        total += weight
    return sizes


def _split_largest_runs(sizes: list[int], count: int) -> list[int]:
    """Split the largest runs until there are `count` of them."""
    sizes = list(sizes)
    while len(sizes) < count:
        largest = max(range(len(sizes)), key=lambda i: sizes[i])
        half = sizes[largest] // 2
        sizes[largest : largest + 1] = [sizes[largest] - half, half]
    return sizes
