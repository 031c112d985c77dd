"""Refusals of the fleet manager.

FleetManagerError(HeadlandError)   an order or a report that the fleet manager does not accept
  └── ControlLeaseError            another operator drives that tractor
"""

from __future__ import annotations

from fields.errors import HeadlandError


class FleetManagerError(HeadlandError):
    """An order or report that cannot be accepted now: one sentence with the value, the rule and the fix."""


class ControlLeaseError(FleetManagerError):
    """Another operator drives that tractor."""
