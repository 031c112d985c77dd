"""The content of a field file in any format, before its numbers are checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

LOCAL_METRES, WGS84 = "local_metres", "wgs84"
UNKNOWN_CRS = "unknown"
"""The coordinate system of a file that should name one and does not."""


@dataclass(frozen=True)
class RawPolygon:
    """The coordinates of one polygon and the properties of its feature.

    Attributes:
        coordinates: rings as read, unchecked.
        keys: its names: feature id, properties id, properties name. Others may share them.
        properties: of its feature; the parts of a MultiPolygon share them.
        key: what it alone is chosen by: its first name, with a number where others have that name, or its position.
    """

    coordinates: Any
    keys: tuple[str, ...]
    properties: dict[str, Any]
    key: str = ""


@dataclass(frozen=True)
class RawShape:
    """An obstacle or a line along the outline as read: geometry type ("Point", "LineString" or "Polygon"), unchecked
    coordinates, keys and properties.
    """

    geometry_type: str
    coordinates: Any
    keys: tuple[str, ...]
    properties: dict[str, Any]


@dataclass(frozen=True)
class RawLine:
    """A guidance line or headland edge as read: its unchecked positions and the names it can be chosen by.

    `is_assumed`: the file does not say that it is one, only that it is a line.
    """

    coordinates: Any
    keys: tuple[str, ...]
    is_assumed: bool = False


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
        guidance_lines: lines that swaths can be laid along.
        headland_edges: inner edges of headlands.
        unassigned: points and lines without a role; where they lie says what they are.
        notes: sentences on what the reader of the format skipped or repaired.
    """

    polygons: tuple[RawPolygon, ...]
    zones: tuple[RawPolygon, ...]
    entrances: tuple[Any, ...]
    crs: str | None
    frame: str | None
    header: dict[str, Any]
    source: str
    unused_counts: tuple[tuple[str, int], ...] = ()
    obstacles: tuple[RawShape, ...] = ()
    boundary_edges: tuple[RawShape, ...] = ()
    service_points: tuple[Any, ...] = ()
    guidance_lines: tuple[RawLine, ...] = ()
    headland_edges: tuple[RawLine, ...] = ()
    unassigned: tuple[RawShape, ...] = ()
    notes: tuple[str, ...] = ()
    axes_swapped: bool = False


@dataclass(frozen=True)
class FieldFormat:
    """A format of field files.

    Attributes:
        name: its usual name.
        extensions: of its files, lower case.
        read: reads the file at a path; the second argument is its name in messages. Raises FieldError.
        holds: whether a folder or ZIP archive with these file names (lower case, without folders) is in this format.
        parse: parses the content of one file, as `read` does; None for a format of several files.
    """

    name: str
    extensions: tuple[str, ...]
    read: Callable[[str, str], FieldDocument]
    holds: Callable[[frozenset[str]], bool] = lambda names: False
    parse: Callable[[bytes, str], FieldDocument] | None = None
