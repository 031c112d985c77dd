"""Errors of strategies."""

from __future__ import annotations

from fields.errors import HeadlandError

SOLITARY_STRATEGIES = "split-field or interleaved"
"""The strategies whose tractors work each for itself, for advice where a formation cannot."""


class StrategyError(HeadlandError):
    """Why a strategy is not possible here: one sentence with the value, the rule and what would help."""
