"""Refusals of measured logs."""

from vehicle.errors import VehicleError


class LogError(VehicleError):
    """A log that cannot be used as it is: the message names the file, the rule and the fix."""
