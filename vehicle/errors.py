"""Errors of the vehicle package.

VehicleError(HeadlandError)    a parameter file or value that no tractor can have
├── MissionError             a mission that no world can execute
└── LogError (identification)   a log that cannot be used as it is
"""

from fields.errors import HeadlandError


class VehicleError(HeadlandError):
    """A tractor, ground or implement that cannot exist: the message names value, rule and fix."""


def check_range(what: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise VehicleError unless a value lies between its limits."""
    if not low <= value <= high:
        words = f" {unit}" if unit else ""
        raise VehicleError(f"{what} is {value:g}{words}; give {low:g} to {high:g}{words}.")


class MissionError(VehicleError):
    """Legs or gates that cannot be executed: the message names tractor, leg, rule and fix."""
