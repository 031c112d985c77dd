"""What a person says of the numbers of a file that the file does not, or says wrongly: their system and their order."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from fields.document import UNKNOWN, Document
from fields.errors import FieldError, named


def told(document: Document, crs: str | None, swap: bool, label: str) -> Document:
    """The document with the coordinate system that was named, and with x and y exchanged where that was asked for.

    Raises:
        FieldError: the file names no system and nobody else does, or it names one and another was given.
    """
    if document.crs == UNKNOWN and crs is None:
        raise FieldError(
            f"{label} has no .prj, so nothing says where on earth its numbers are; put it beside the .shp, or name the "
            f"system with {named('crs')}, such as EPSG:25832 or EPSG:4326.",
            parameter="crs",
        )
    if crs is not None and document.crs not in (UNKNOWN, None, crs):
        raise FieldError(
            f"{label} says that it is in {_short(document.crs)}; leave out {named('crs')} {crs}.", parameter="crs"
        )
    document = replace(document, crs=document.crs if crs is None else crs)
    return _swapped(document) if swap else document


def _short(crs: str | None) -> str:
    """A coordinate system for a sentence: its code, or the first words of its description."""
    text = str(crs)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _swapped(document: Document) -> Document:
    return replace(
        document,
        polygons=tuple(replace(one, coordinates=_turned(one.coordinates)) for one in document.polygons),
        zones=tuple(replace(one, coordinates=_turned(one.coordinates)) for one in document.zones),
        obstacles=tuple(replace(one, coordinates=_turned(one.coordinates)) for one in document.obstacles),
        edges=tuple(replace(one, coordinates=_turned(one.coordinates)) for one in document.edges),
        lines=tuple(replace(one, coordinates=_turned(one.coordinates)) for one in document.lines),
        entrances=tuple(_turned(one) for one in document.entrances),
        refills=tuple(_turned(one) for one in document.refills),
    )


def _turned(raw: Any) -> Any:
    """Coordinates, however deep in lists, with the first two numbers of every position exchanged."""
    if not isinstance(raw, list):
        return raw
    if len(raw) >= 2 and not isinstance(raw[0], list):
        return [raw[1], raw[0], *raw[2:]]
    return [_turned(each) for each in raw]
