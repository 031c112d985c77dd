"""Refusals of this room, and the base of all refusals.

The tree is in fields.errors. The command line prints the sentence with its own names for the parameters and exits
with status 2; anything else is a fault of Headland and exits with status 1.
"""

from __future__ import annotations

from fields.errors import HeadlandError, about, named, nearest

__all__ = ["HeadlandError", "ScenarioError", "WorkerError", "about", "named", "nearest"]


class WorkerError(HeadlandError):
    """A process that was to plan is gone, or could not be started: nothing is wrong with what was asked."""

    status = 1


class ScenarioError(HeadlandError):
    """A request or a combination of its values that cannot be planned."""
