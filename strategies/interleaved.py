"""Interleaved: each of n tractors takes every n-th track, one behind the other."""

from __future__ import annotations

from collections.abc import Sequence

from strategies.rules.dealing import DealtLine, LineDeal, free_other_lines, group_swath_lines
from strategies.rules.driving_rules import DrivingRules
from strategies.strategy_record import Strategy

NAME = "interleaved"


def deal_in_turn(lines: Sequence[DealtLine], rules: DrivingRules, tractors: int) -> LineDeal:
    """Every n-th swath to each of n tractors, which begin one after the other."""
    allowed = free_other_lines(lines, tractors)
    for place, numbers in enumerate(group_swath_lines(lines, tractors)):
        allowed[place % tractors, numbers] = True
    return LineDeal(allowed, rules.stagger_m)


STRATEGY = Strategy(NAME, "the tractors take the tracks in turn", deal_in_turn, beside=True)
