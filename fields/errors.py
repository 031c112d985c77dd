"""The one error class of the fields room."""


class FieldError(ValueError):
    """A field, a field file or a layout request that cannot be used.

    The message is one sentence that names the value, the rule it breaks and the way to put it right.
    """
