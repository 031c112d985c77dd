"""Column by column: the tractors of a formation turn strictly one after another."""

from __future__ import annotations

from strategies.formations.compose import FormationRule
from strategies.formations.queue_rules import queue_by_columns
from strategies.strategy_record import Strategy

NAME = "col-by-col"

STRATEGY = Strategy(
    NAME,
    "side by side, turning by sides",
    formation=FormationRule(queue_by_columns, in_file=True),
)
