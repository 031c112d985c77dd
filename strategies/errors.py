"""Refusals of this room.

    StrategyError(HeadlandError)    this strategy cannot work this field with this fleet
      NoWayError                    no way leads from one track to another
"""

from fields.errors import HeadlandError
from fields.layout import Track


class StrategyError(HeadlandError):
    """Why a strategy is not possible here: one sentence with value, rule and what would help."""


class NoWayError(StrategyError):
    """No way leads between two `tracks`."""

    def __init__(self, sentence: str, tracks: tuple[Track, Track]) -> None:
        super().__init__(sentence)
        self.tracks = tracks
