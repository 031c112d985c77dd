"""Refusals of the control centre.

CentreError(HeadlandError)   an order or a report that the centre does not take
  └── LeaseError             somebody else drives that tractor
"""

from __future__ import annotations

from fields.errors import HeadlandError


class CentreError(HeadlandError):
    """An order that cannot be carried out now: one sentence with the value, the rule and the fix."""


class LeaseError(CentreError):
    """A tractor that another operator drives."""
