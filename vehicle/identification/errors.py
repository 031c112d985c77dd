"""Refusals of measured logs."""

from __future__ import annotations

from collections.abc import Mapping

from vehicle.errors import VehicleError


class LogError(VehicleError):
    """A log that cannot be used: the message names the file, the rule and the fix."""


class ColumnError(LogError):
    """Columns that a log lacks under their names; `mapping` is what its names suggest, to look at and to read it by."""

    def __init__(self, sentence: str, mapping: Mapping[str, str] | None = None) -> None:
        super().__init__(sentence)
        self.mapping = dict(mapping or {})
