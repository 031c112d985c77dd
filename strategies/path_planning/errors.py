"""Errors of strategies."""

from __future__ import annotations

from fields.errors import HeadlandError


class StrategyError(HeadlandError):
    """Why a strategy is not possible here: one sentence with the value, the rule and what would help."""
