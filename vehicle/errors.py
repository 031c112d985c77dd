"""Errors of the vehicle package.

VehicleError(HeadlandError)    a parameter file or value that no tractor can have
├── MissionError             a mission that no world can execute
└── LogError (identification)   a log that cannot be used as it is
"""

from fields.errors import HeadlandError


class VehicleError(HeadlandError):
    """A tractor, ground or implement that cannot exist: the message names value, rule and fix."""


class MissionError(VehicleError):
    """Legs or gates that cannot be executed: the message names tractor, leg, rule and fix."""
