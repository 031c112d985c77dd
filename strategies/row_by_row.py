"""Row by row: a row leaves the queue when the row before it is in its place for the next round."""

from __future__ import annotations

from strategies.formations.compose import FormationRule
from strategies.formations.queue_rules import queue_by_rows
from strategies.strategy_record import Strategy

NAME = "row-by-row"

STRATEGY = Strategy(
    NAME,
    "side by side, turning one after the other",
    formation=FormationRule(queue_by_rows, in_rows=True),
)
