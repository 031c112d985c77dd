"""Refusals of measured logs."""

from __future__ import annotations

from vehicle.errors import VehicleError


class LogError(VehicleError):
    """A log that cannot be used: the message names the file, the rule and the fix."""
