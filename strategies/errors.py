"""Refusals of this room.

    StrategyError(ValueError)    this strategy cannot work this field with this fleet
"""


class StrategyError(ValueError):
    """Why a strategy is not possible here: one sentence with value, rule and what would help."""
