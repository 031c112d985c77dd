"""Split field: one block of neighbouring tracks per tractor, cut by the work on their lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from strategies.program.dealing import DealtLine, LineDeal, free_other_lines, group_swath_lines
from strategies.program.driving_rules import DrivingRules
from strategies.strategy_record import Strategy

WEIGHT_RESOLUTION = 1e-6  # of the heaviest line


def cut_balanced_blocks(weights: Sequence[float], count: int) -> list[int]:
    """Borders 0 = b0 < b1 < ... = n of `count` runs, the heaviest as light as possible; n must be at least `count`.

    Weights count to a millionth of the heaviest, so that rounding errors decide nothing where two cuts are as good.
    """
    heaviest = max(weights)
    shares = [round(weight / heaviest / WEIGHT_RESOLUTION) for weight in weights]
    low, high = max(shares), sum(shares)
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


NAME = "split-field"
BORDER_SHARE = 0.25  # of a block on either side of its border: swaths that either of the two tractors may work


def deal_blocks(lines: Sequence[DealtLine], rules: DrivingRules, tractors: int) -> LineDeal:
    """A block of neighbouring swaths each, equal by work; the search for orders balances them over their borders."""
    swaths = group_swath_lines(lines, tractors)
    borders = cut_balanced_blocks([_weigh_swath_s(lines, numbers, rules) for numbers in swaths], tractors)
    allowed = free_other_lines(lines, tractors)
    for tractor, (first, last) in enumerate(pairwise(borders)):
        low = first - math.ceil(BORDER_SHARE * (first - borders[tractor - 1])) if tractor else 0
        high = last + (math.ceil(BORDER_SHARE * (borders[tractor + 2] - last)) if tractor < tractors - 1 else 0)
        for numbers in swaths[low:high]:
            allowed[tractor, numbers] = True
    return LineDeal(allowed)


def _weigh_swath_s(lines: Sequence[DealtLine], numbers: Sequence[int], rules: DrivingRules) -> float:
    """Seconds of the pieces of a swath, with a turn for each."""
    return sum(lines[number].length_m / rules.work_speed_mps + rules.turn_s[1] for number in numbers)


STRATEGY = Strategy(NAME, "each tractor has its part of the field", deal_blocks)
