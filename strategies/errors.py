"""Refusals of this room.

    StrategyError(HeadlandError)    this strategy cannot work this field with this fleet
"""

from fields.errors import HeadlandError


class StrategyError(HeadlandError):
    """Why a strategy is not possible here: one sentence with value, rule and what would help."""
