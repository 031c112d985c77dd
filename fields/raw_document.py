"""The content of a field file in any format, before its numbers are checked, and shapes of other libraries as text.

A shape is whatever has a `__geo_interface__` (https://gist.github.com/sgillies/2217756): shapely geometries, features,
GeoSeries, GeoDataFrames. As the name of a field it is GeoJSON in a text, which is compared, sent and saved like any
name; its `crs`, if it has one, goes with it. Imports no library, as every request needs this.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable
from zlib import crc32

LOCAL_METRES, WGS84 = "local_metres", "wgs84"
UNKNOWN_CRS = "unknown"
"""The coordinate system of a file that should name one and does not."""
SHAPE_NAME = "shape"  # in messages; a shape has none of its own


@dataclass(frozen=True)
class RawShape:
    """A feature as read, or one part of a feature that has several.

    Attributes:
        geometry_type: "Point", "LineString" or "Polygon".
        coordinates: a position, positions or rings, unchecked.
        keys: its names: feature id, properties id, properties name. Others may share them.
        properties: of its feature; its parts share them.
        key: by which one field is chosen: its first name, with a number where others have it, or its position.
    """

    geometry_type: str
    coordinates: Any
    keys: tuple[str, ...]
    properties: dict[str, Any]
    key: str = ""


@dataclass(frozen=True)
class FieldDocument:
    """The parts of a file: polygons, ground zones, obstacles, edges, entrances, coordinate system and frame.

    Attributes:
        crs: coordinate system that the file names; UNKNOWN_CRS if it should name one but does not, None if it need not.
        frame: ``"local_metres"``, ``"wgs84"`` or None when the file does not say.
        header: the GeoJSON member written by Headland, possibly empty.
        axes_swapped: the user had x and y of every position swapped.
        unused_counts: features that are not used: description and count.
        boundary_edges: lines along the outline with an ``edge`` property.
        service_points: places where tanks are filled or emptied.
        guidance_lines: lines that swaths can be laid along; without a role the file only says that it is a line.
        headland_edges: inner edges of headlands.
        unassigned: points and lines without a role; where they lie says what they are.
        notes: sentences on what the reader of the format skipped or repaired.
        is_shape: it is no file, but a shape of another library.
    """

    polygons: tuple[RawShape, ...]
    zones: tuple[RawShape, ...]
    entrances: tuple[RawShape, ...]
    crs: str | None
    frame: str | None
    header: dict[str, Any]
    source: str
    unused_counts: tuple[tuple[str, int], ...] = ()
    obstacles: tuple[RawShape, ...] = ()
    boundary_edges: tuple[RawShape, ...] = ()
    service_points: tuple[RawShape, ...] = ()
    guidance_lines: tuple[RawShape, ...] = ()
    headland_edges: tuple[RawShape, ...] = ()
    unassigned: tuple[RawShape, ...] = ()
    notes: tuple[str, ...] = ()
    is_shape: bool = False
    axes_swapped: bool = False


Content = TypeVar("Content")


@dataclass(frozen=True)
class FileFormat(Generic[Content]):
    """A format of files that come from outside: of fields, of task logs.

    Attributes:
        name: its usual name.
        extensions: of its files, lower case.
        read: reads the file, folder or archive at a path; the second argument is its name in messages. Raises
            FieldError, and LogError for task logs.
        holds: whether a folder or ZIP archive with these file names (lower case, without folders) is in this format.
    """

    name: str
    extensions: tuple[str, ...]
    read: Callable[[str, str], Content]
    holds: Callable[[frozenset[str]], bool] = lambda names: False


@dataclass(frozen=True)
class FieldFormat(FileFormat[FieldDocument]):
    """A format of field files; its extensions are in no other.

    Attributes:
        parse: parses the content of one file, as `read` does; None for a format of several files.
        has_lone_files: whether one file of these extensions is a field without others beside it.
    """

    parse: Callable[[bytes, str], FieldDocument] | None = None
    has_lone_files: bool = True


@runtime_checkable
class GeoShape(Protocol):
    """A shape of any library."""

    @property
    def __geo_interface__(self) -> Mapping[str, Any]:
        """The shape as GeoJSON has it."""


def write_shape_text(shape: GeoShape) -> str:
    """A shape with its coordinate system as the text by which `is_shape_text` knows it."""
    content, crs = shape.__geo_interface__, getattr(shape, "crs", None)
    if crs is not None and "crs" not in content:
        content = {**content, "crs": {"type": "name", "properties": {"name": convert_crs_to_text(crs)}}}
    return json.dumps(content, default=_convert_to_plain)


def is_shape_text(name: str) -> bool:
    """Whether the name of a field is the text of a shape."""
    return name.startswith("{")


def name_field(name: str) -> str:
    """The name of a field for people and tables; that of a shape differs from those of other shapes."""
    return f"{SHAPE_NAME}-{crc32(name.encode()):08x}" if is_shape_text(name) else name


def convert_crs_to_text(crs: Any) -> Any:
    """A coordinate system of pyproj as a text such as "EPSG:25832"; other values as they are."""
    return crs.to_string() if hasattr(crs, "to_string") else crs


def _convert_to_plain(value: Any) -> Any:
    """A number of numpy as Python's, anything else as a text."""
    return value.item() if hasattr(value, "item") else str(value)
