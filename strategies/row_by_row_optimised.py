"""Row by row without a queue: each tractor leaves as soon as the scheduler of the plan finds its way clear."""

from __future__ import annotations

from strategies.formations.compose import FormationRule
from strategies.formations.queue_rules import leave_when_clear
from strategies.strategy_record import Strategy

NAME = "row-by-row-optimised"

STRATEGY = Strategy(
    NAME,
    "the same with the least waiting",
    formation=FormationRule(leave_when_clear, move_up=False),
)
