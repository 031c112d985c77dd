"""From the raw coordinate arrays of a file to checked rings and polygons."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from fields.errors import FieldError
from fields.reading import brief

FloatArray = npt.NDArray[np.float64]

SMALLEST_M2, LARGEST_M2 = 100.0, 1.0e8
FARTHEST_M = 1.0e8  # more than twice round the earth


def ring(raw: Any, label: str) -> FloatArray:
    """An open ring of shape (n, 2) from a list of positions; height and repeated points are dropped.

    Raises:
        FieldError: a position is not two finite numbers, or fewer than 3 distinct points remain.
    """
    if not isinstance(raw, list):
        raise FieldError(f"A ring of {label} is {brief(raw)}; it must be a list of [x, y] positions.")
    points = np.array([position(entry, label) for entry in raw], dtype=np.float64).reshape(-1, 2)
    keep = [i for i in range(len(points)) if i == 0 or (points[i] != points[i - 1]).any()]
    points = points[keep]
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    distinct = len(np.unique(points, axis=0)) if len(points) else 0
    if distinct < 3:
        raise FieldError(f"A ring of {label} has {distinct} distinct points; a ring needs at least 3.")
    return points


def position(raw: Any, label: str) -> tuple[float, float]:
    """The first two numbers of a GeoJSON position.

    Raises:
        FieldError: it is not a list of two or more finite numbers.
    """
    if not isinstance(raw, list) or len(raw) < 2:
        raise FieldError(f"Position {brief(raw)} of {label} is not a pair; write it as [x, y].")
    return _number(raw[0], label), _number(raw[1], label)


def rings(raw: Any, label: str) -> list[FloatArray]:
    """Outer ring first, then the holes, of the ``coordinates`` of a Polygon.

    Raises:
        FieldError: there is no ring, or a ring is not usable.
    """
    if not isinstance(raw, list) or not raw:
        raise FieldError(f"The coordinates of {label} are {brief(raw)}; a Polygon needs at least one ring.")
    return [ring(entry, label) for entry in raw]


def polygon(parts: list[FloatArray], label: str) -> shapely.Polygon:
    """Counter-clockwise polygon of an outer ring and its holes.

    Raises:
        FieldError: rings cross themselves or each other; the message says where, in file coordinates.
    """
    shape = shapely.Polygon(parts[0], parts[1:])
    if not shape.is_valid:
        what, where = _fault(shapely.is_valid_reason(shape))
        raise FieldError(f"The boundary of {label} is not clean: {what} at {where}; redraw it there.")
    return orient(shape, 1.0)


def check_area(shape: shapely.Polygon, label: str) -> None:
    """Refuse an outline in metres that cannot be a field.

    Raises:
        FieldError: the area is under 100 square metres or over 100 square kilometres.
    """
    if shape.area < SMALLEST_M2:
        raise FieldError(f"The area of {label} is {shape.area:.3g} m2; a field needs at least 100 m2.")
    if shape.area > LARGEST_M2:
        raise FieldError(f"The area of {label} is {shape.area / 1e6:.4g} km2; a field may have at most 100 km2.")


def _number(raw: Any, label: str) -> float:
    """One finite coordinate."""
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise FieldError(f"Coordinate {brief(raw)} of {label} is not a number; write plain numbers.")
    try:
        value = float(raw)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise FieldError(f"Coordinate {brief(raw)} of {label} is not finite; write a measured value.")
    if abs(value) > FARTHEST_M:
        raise FieldError(f"Coordinate {brief(raw)} of {label} lies beyond {FARTHEST_M:g}; no map reaches so far.")
    return value


def _fault(reason: str) -> tuple[str, str]:
    """Words and place out of a GEOS reason such as ``Self-intersection[3 4]``."""
    match = re.fullmatch(r"(.*)\[(\S+) (\S+)\]", reason)
    if match is None:
        return reason.lower(), "an unknown place"
    words = {
        "Self-intersection": "it crosses itself",
        "Ring Self-intersection": "it touches itself",
        "Hole lies outside shell": "a hole lies outside",
        "Holes are nested": "one hole lies in another",
        "Interior is disconnected": "its holes cut it in two",
    }
    what = words.get(match[1], match[1].lower())
    return what, f"({float(match[2]):.9g}, {float(match[3]):.9g})"
