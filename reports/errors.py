"""The one error class of the reports room."""

from fields.errors import HeadlandError


class ReportError(HeadlandError):
    """A result that cannot be drawn or written.

    The message is one sentence that names the value, the rule it breaks and the way to put it right.
    """
