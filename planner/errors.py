"""The base of all refusals, and those of the planner.

The command line prints a refusal with its own names for parameters and exits with its `status`, 2 unless it says
otherwise. Any other exception is a bug in Headland and exits with status 1.
"""

from __future__ import annotations

from fields.errors import (
    FieldError,
    HeadlandError,
    attach_parameter,
    mark_parameter,
    shorten_value,
    suggest_name,
)

__all__ = [
    "FieldError", "HeadlandError", "RequestError", "WorkerError", "attach_parameter", "mark_parameter", "shorten_value",
    "suggest_name",
]  # fmt: skip


class WorkerError(HeadlandError):
    """A planning process ended or could not be started; the request itself is fine."""

    status = 1


class RequestError(HeadlandError):
    """A request or a combination of its values that cannot be planned."""
