"""What a file of fields holds, whatever its format, before any of its numbers are believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

LOCAL, WGS84 = "local_metres", "wgs84"
UNKNOWN = "unknown"
"""Stands for the system of numbers of which a file says none though it should."""


@dataclass(frozen=True)
class RawPolygon:
    """Coordinates of one polygon with what its feature says about it.

    Attributes:
        coordinates: rings as read, unchecked.
        keys: names it can be chosen by: feature id, properties id, properties name.
        properties: of its feature; the parts of a MultiPolygon have the same.
    """

    coordinates: Any
    keys: tuple[str, ...]
    properties: dict[str, Any]


@dataclass(frozen=True)
class RawObstacle:
    """An obstacle or a line along the outline as read: "Point", "LineString" or "Polygon", its coordinates, unchecked,
    and its properties.
    """

    form: str
    coordinates: Any
    keys: tuple[str, ...]
    properties: dict[str, Any]


@dataclass(frozen=True)
class RawLine:
    """A guidance line or headland edge as read: its positions, unchecked, and the names it can be asked for by."""

    coordinates: Any
    keys: tuple[str, ...]


@dataclass(frozen=True)
class Document:
    """A file taken apart: polygons, ground zones, obstacles, edges, entrance points, coordinate system and frame.

    Attributes:
        crs: coordinate system that the file names, UNKNOWN where it should and does not, None where it need not.
        frame: ``"local_metres"``, ``"wgs84"`` or None when the file does not say.
        header: the foreign member of this program, possibly empty.
        edges: lines that say what the outline is along them.
        refills: places where tanks are filled or emptied.
        unused: what no part of a field is read from: kind of feature in words, and how many.
        lines: guidance lines that tracks can be laid along.
        headlands: inner edges of headlands.
        notes: sentences on what the reader of the form left out or mended.
    """

    polygons: tuple[RawPolygon, ...]
    zones: tuple[RawPolygon, ...]
    entrances: tuple[Any, ...]
    crs: str | None
    frame: str | None
    header: dict[str, Any]
    source: str
    unused: tuple[tuple[str, int], ...] = ()
    obstacles: tuple[RawObstacle, ...] = ()
    edges: tuple[RawObstacle, ...] = ()
    refills: tuple[Any, ...] = ()
    lines: tuple[RawLine, ...] = ()
    headlands: tuple[RawLine, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Format:
    """A form of field files.

    Attributes:
        name: what people call it.
        endings: of files of this form, lower case.
        read: takes the file at a path apart; messages call it by the label. Raises FieldError.
        holds: whether a folder, or a ZIP archive, with these names in it (lower case, without folders) is of this form.
    """

    name: str
    endings: tuple[str, ...]
    read: Callable[[str, str], Document]
    holds: Callable[[frozenset[str]], bool] = lambda names: False
