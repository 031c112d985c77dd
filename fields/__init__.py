"""Fields: boundaries, obstacles, ground zones, field files and the tracks laid on them."""

from fields.errors import FieldError
from fields.field import Field, GroundZone
from fields.layout import Layout, Track, lay_tracks
from fields.read import Listed, list_fields, read_field
from fields.samples_index import sample_names
from fields.write import write_field

__all__ = [
    "Field",
    "FieldError",
    "GroundZone",
    "Layout",
    "Listed",
    "Track",
    "lay_tracks",
    "list_fields",
    "read_field",
    "sample_names",
    "write_field",
]
