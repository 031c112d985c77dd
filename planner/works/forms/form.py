"""What a form of files of driven work is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from planner.works.record import Found


@dataclass(frozen=True)
class Form:
    """A form of files.

    Attributes:
        name: what people call it.
        endings: of files of this form, lower case.
        read: the runs of the file, folder or archive at a path; messages call it by the label. Raises FieldError,
            LogError.
        holds: whether a folder or archive with these names in it (lower case, without folders) is of this form.
    """

    name: str
    endings: tuple[str, ...]
    read: Callable[[str, str], Found]
    holds: Callable[[frozenset[str]], bool]
