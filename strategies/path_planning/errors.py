"""Errors of strategies."""

from __future__ import annotations

from fields.errors import HeadlandError


class StrategyError(HeadlandError):
    """Why a strategy is not possible here: one sentence with the value, the rule and what would help."""


def build_too_many_error(tractors: int, swaths: int) -> StrategyError:
    """The error for a fleet with more tractors than there are swaths."""
    if not swaths:
        return StrategyError("This machine has no room on any track of the field; use a narrower implement.")
    advice = "1 track of the field; use 1 tractor"
    if swaths > 1:
        advice = f"{swaths} tracks of the field; use {swaths} or fewer"
    return StrategyError(f"{tractors} tractors are more than the {advice}, or a bearing with more and shorter tracks.")
