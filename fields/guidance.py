"""Guidance lines that came with a field: lines by name that its tracks can be laid along."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from fields.document import Document
from fields.errors import FieldError, named, nearest
from fields.fences import NEAR_M
from fields.frame import Frame
from fields.outline import position

SHOWN = 8


@dataclass(frozen=True)
class GuidanceLine:
    """A line with a name, in metres in the frame of the field."""

    name: str
    line: shapely.LineString

    @property
    def bearing_deg(self) -> float:
        """Direction from its first to its last point, clockwise from north, 0 to 360 degrees.

        Of a line that comes back to its start, that of its longest straight piece.
        """
        points = shapely.get_coordinates(self.line)
        way = points[-1] - points[0]
        if float(np.hypot(*way)) < 0.1 * self.line.length:
            steps = np.diff(points, axis=0)
            way = steps[int(np.argmax(np.hypot(*steps.T)))]
        return math.degrees(math.atan2(way[0], way[1])) % 360.0


def guidance_lines(document: Document, frame: Frame, shape: shapely.Polygon, several: bool) -> tuple[GuidanceLine, ...]:
    """Lines of a file that can be used, in its order; in a file of several fields those of this one."""
    found = []
    for number, raw in enumerate(document.lines):
        try:
            points = frame.local(np.array([position(entry, "a line") for entry in raw.coordinates]))
        except (FieldError, TypeError, ValueError):
            continue
        if len(points) < 2 or not np.ptp(points, axis=0).any():
            continue
        line = shapely.LineString(points)
        if not several or shape.distance(line) <= NEAR_M:
            found.append(GuidanceLine(raw.keys[0] if raw.keys else f"line {number + 1}", line))
    return tuple(found)


def bearing_along(lines: Sequence[GuidanceLine], name: str, label: str) -> float:
    """Bearing in degrees of the line of this name, whatever its case.

    Raises:
        FieldError: there is no such line, or several of this name do not agree.
    """
    matches = [one for one in lines if one.name.lower() == name.strip().lower()]
    if not matches:
        known = ", ".join(f"'{one.name}'" for one in lines[:SHOWN]) or "none"
        more = f" and {len(lines) - SHOWN} more" if len(lines) > SHOWN else ""
        raise FieldError(
            f"{label} has no line '{name}' for {named('along')}{nearest(name, [one.name for one in lines])}; it has "
            f"{known}{more}.",
            parameter="along",
        )
    bearings = [one.bearing_deg for one in matches]
    apart = max(abs(math.remainder(one - bearings[0], 180.0)) for one in bearings)
    if apart > 0.01:
        raise FieldError(
            f"{len(matches)} lines of {label} are called '{name}' and do not agree; give {named('bearing_deg')} in "
            "place of a name.",
            parameter="along",
        )
    return bearings[0]
