"""Refusals of this room.

    StrategyError(HeadlandError)    this strategy cannot work this field with this fleet
      NoWayError                    no way leads from one track to another
"""

from fields.errors import HeadlandError
from fields.layout import Track


class StrategyError(HeadlandError):
    """Why a strategy is not possible here: one sentence with value, rule and what would help."""


def too_many(tractors: int, tracks: int) -> StrategyError:
    """The refusal of a fleet that has fewer tracks than tractors."""
    use = "1 track of the field; use 1 tractor"
    if tracks > 1:
        use = f"{tracks} tracks of the field; use {tracks} or fewer"
    return StrategyError(f"{tractors} tractors are more than the {use}, or a bearing with more and shorter tracks.")


class NoWayError(StrategyError):
    """No way leads between two `tracks`."""

    def __init__(self, sentence: str, tracks: tuple[Track, Track]) -> None:
        super().__init__(sentence)
        self.tracks = tracks
