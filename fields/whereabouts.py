"""Whether longitude and latitude seem to be exchanged, by where fields fall.

No map is at hand, so this is told of a field alone only where it falls beyond all farmland; else it takes something in
the same file that it should lie beside. Two countries whose land lies across from each other cannot be told apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fields.document import LOCAL, WGS84, Document
from fields.errors import FieldError
from fields.outline import position
from fields.projection import is_longitude_latitude

FARMED_DEG = (-56.0, 72.0)
"""No farmland lies south of Tierra del Fuego or north of the North Cape."""
NEAR_DEG, FAR_DEG = 1.0, 2.0
"""What belongs together lies so near in longitude and latitude; what lies so far from all the rest does not."""
MOST_COMPARED, MOST_NAMED = 2_000, 5


def exchanged(document: Document, swap: bool) -> tuple[str, ...]:
    """Sentences on fields whose longitude and latitude seem to be exchanged; `swap` tells that they were already."""
    degrees = document.crs is None or document.crs == WGS84 or is_longitude_latitude(document.crs)
    if not degrees or document.frame == LOCAL or len(document.polygons) > MOST_COMPARED:
        return ()
    fields = np.array([_first(one.coordinates) for one in document.polygons])
    lines = np.array([_first(one.coordinates) for one in (*document.lines, *document.headlands)]).reshape(-1, 2)
    names = [one.keys[0] if one.keys else f"#{place}" for place, one in enumerate(document.polygons)]
    odd = [place for place in range(len(fields)) if _beyond(fields[place]) or _apart(place, fields, lines)]
    if not odd:
        return ()
    x, y = fields[odd[0]]
    called = ", ".join(f"'{names[place]}'" for place in odd[:MOST_NAMED])
    more = f" and {len(odd) - MOST_NAMED} more" if len(odd) > MOST_NAMED else ""
    why = "beyond all farmland" if _beyond(fields[odd[0]]) else "far from all else in the file"
    fix = "leave out swap" if swap else "try swap"
    return (
        f"{called}{more}: at latitude {y:.2f}, longitude {x:.2f}, {why}; with the two exchanged it would be right, so "
        f"{fix}.",
    )


def _beyond(place: npt.NDArray[np.float64]) -> bool:
    """Whether a place is beyond all farmland, and not with its numbers exchanged."""
    x, y = place.tolist()
    low, high = FARMED_DEG
    return abs(x) <= 90.0 and low <= x <= high and not low <= y <= high and abs(y) <= 90.0


def _apart(place: int, fields: npt.NDArray[np.float64], lines: npt.NDArray[np.float64]) -> bool:
    """Whether a field lies far from all others, or from all lines where it is alone, and exchanged beside some.

    Of two fields nobody can say which one is right, so both are left as they are; with a third, the lone one is.
    """
    rest = np.delete(fields, place, axis=0) if len(fields) > 2 else lines
    rest = rest[np.isfinite(rest).all(axis=1)]
    if not len(rest) or not np.isfinite(fields[place]).all():
        return False
    away = np.abs(rest - fields[place]).max(axis=1)
    turned = np.abs(rest - fields[place][::-1]).max(axis=1)
    return bool(away.min() > FAR_DEG and turned.min() < NEAR_DEG)


def _first(raw: Any) -> Sequence[float]:
    """The first position of coordinates, however deep in lists; not finite where it is none."""
    while isinstance(raw, list) and raw and isinstance(raw[0], list):
        raw = raw[0]
    try:
        x, y = position(raw, "")
    except (FieldError, TypeError, ValueError):
        return (np.nan, np.nan)
    return (float(x), float(y))
