"""Fields: boundaries, obstacles, ground zones and field files, and the swaths laid on them.

Packages: geometry, formats (field files and guidance files), documents (reading and writing), layout (swaths).
Names listed below are loaded at first use, so that importing `fields` needs no library.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fields.documents.reader import FieldSummary, list_fields, read_field
    from fields.documents.writer import write_field
    from fields.errors import FieldError
    from fields.geometry.field import Field, GroundZone
    from fields.layout.cells import Cell
    from fields.layout.swaths import Layout, Swath, lay_swaths
    from fields.sample_fields import list_sample_names

__all__ = [
    "Cell",
    "Field",
    "FieldError",
    "FieldSummary",
    "GroundZone",
    "Layout",
    "Swath",
    "lay_swaths",
    "list_fields",
    "list_sample_names",
    "read_field",
    "write_field",
]

_HOMES = {
    "documents.reader": ("FieldSummary", "list_fields", "read_field"),
    "documents.writer": ("write_field",),
    "errors": ("FieldError",),
    "geometry.field": ("Field", "GroundZone"),
    "layout.cells": ("Cell",),
    "layout.swaths": ("Layout", "Swath", "lay_swaths"),
    "sample_fields": ("list_sample_names",),
}


def __getattr__(name: str) -> Any:
    """Load a name of `__all__` from the module that defines it."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"fields.{home}"), name)
    raise AttributeError(f"module 'fields' has no attribute {name!r}")
