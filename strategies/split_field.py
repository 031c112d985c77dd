"""Split field: one block of neighbouring tracks per tractor, cut by the work on their lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from strategies.rules.dealing import (
    DealtLine,
    LineDeal,
    cut_balanced_blocks,
    free_other_lines,
    group_swath_lines,
)
from strategies.rules.driving_rules import DrivingRules
from strategies.strategy_record import Strategy

NAME = "split-field"
BORDER_SHARE = 0.25  # of a block on either side of its border: swaths that either of the two tractors may work


def deal_blocks(lines: Sequence[DealtLine], rules: DrivingRules, tractors: int) -> LineDeal:
    """A block of neighbouring swaths each, equal by work; the search for orders balances them over their borders.

    Where swaths are fewer than tractors, the others have the headland.
    """
    swaths = group_swath_lines(lines, tractors)
    allowed = free_other_lines(lines, tractors)
    seconds = [line.length_m / rules.work_speed_mps + rules.turn_s[1] for line in lines]  # with a turn for each
    weights = [sum(seconds[number] for number in numbers) for numbers in swaths]
    borders = cut_balanced_blocks(weights, min(tractors, len(swaths)))
    for tractor, (first, last) in enumerate(pairwise(borders)):
        low = first - math.ceil(BORDER_SHARE * (first - borders[tractor - 1])) if tractor else 0
        high = last + (math.ceil(BORDER_SHARE * (borders[tractor + 2] - last)) if last < len(swaths) else 0)
        for numbers in swaths[low:high]:
            allowed[tractor, numbers] = True
    return LineDeal(allowed)


STRATEGY = Strategy(NAME, "each tractor has its part of the field", deal_blocks)
