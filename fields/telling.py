"""What a person says of the numbers of a file that the file does not, or says wrongly: their system and their order."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from fields.document import LOCAL, UNKNOWN, Document
from fields.errors import FieldError, named
from fields.projection import is_longitude_latitude
from fields.whereabouts import exchanged


def told(document: Document, local: bool, crs: str | None, swap: bool, label: str) -> Document:
    """The document with the coordinate system that was named, and with x and y exchanged where that was asked for.

    A note is added where they seem to be exchanged as they then are.

    With `local` its numbers are metres, and no system is asked for.

    Raises:
        FieldError: the file names no system and nobody else does, or what was named is unknown or cannot be.
    """
    if crs is not None:
        _check(document, crs, label)
        document = replace(document, crs=crs)
    elif document.crs == UNKNOWN and local:
        document = replace(document, crs=None)
    elif document.crs == UNKNOWN:
        raise FieldError(
            f"{label} does not say which coordinate system its numbers are in (a Shapefile has it in a .prj file); add "
            f"it, or name it with {named('crs')}, such as EPSG:25832 or EPSG:4326.",
            parameter="crs",
        )
    turned = _swapped(document) if swap else document
    return replace(turned, notes=(*turned.notes, *exchanged(turned, swap)))


def _check(document: Document, crs: str, label: str) -> None:
    """Refuse a system that is none, that contradicts the file, or whose numbers these cannot be."""
    if not crs.strip():
        raise FieldError(
            f"{named('crs')} is empty; name a system such as EPSG:25832, or leave it out.", parameter="crs"
        )
    try:
        degrees = is_longitude_latitude(crs)
    except FieldError as refusal:
        refusal.parameter = "crs"
        raise
    said = "local metres" if document.frame == LOCAL else "longitude and latitude" if document.frame else document.crs
    if said not in (UNKNOWN, None, crs):
        raise FieldError(f"{label} says that it is in {_short(said)}; leave out {named('crs')} {crs}.", parameter="crs")
    x, y = _first(document.polygons[0].coordinates)
    if not degrees and abs(x) <= 180.0 and abs(y) <= 180.0:
        raise FieldError(
            f"Coordinates of {label} such as ({x:g}, {y:g}) look like degrees; leave out {named('crs')} {crs}.",
            parameter="crs",
        )


def _first(raw: Any) -> tuple[float, float]:
    """The first position of coordinates, however deep in lists; far away where it is none."""
    while isinstance(raw, list) and raw and isinstance(raw[0], list):
        raw = raw[0]
    numbers = raw[:2] if isinstance(raw, list) else []
    good = len(numbers) == 2 and all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers)
    return (float(numbers[0]), float(numbers[1])) if good else (math.inf, math.inf)


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
        headlands=tuple(replace(one, coordinates=_turned(one.coordinates)) for one in document.headlands),
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
