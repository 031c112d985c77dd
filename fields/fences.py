"""Sides of a field's outline that are fenced: read from lines along it, and whether they leave a way in."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely

from fields.document import RawObstacle, RawPolygon
from fields.errors import FieldError
from fields.frame import Frame
from fields.outline import position
from fields.reading import brief

FENCE, OPEN = "fence", "open"
EDGES = (FENCE, OPEN)
ALONG_M = 3.0  # a line drawn so near the outline is meant to lie on it
OPENING_M = 3.0  # a shorter opening is no way in for a tractor
NEAR_M = 50.0  # in a file of several fields, lines farther away belong to another one
GRID_M = 1e-6


def read_fences(
    chosen: RawPolygon, lines: Iterable[RawObstacle], frame: Frame, shape: shapely.Polygon, several: bool, label: str
) -> tuple[tuple[shapely.LineString, ...], tuple[str, ...]]:
    """The fenced parts of the outline of a shape, and remarks on lines that leave it.

    The field's own ``edge`` holds all round; lines, in the order of the file, change what lies along them.

    Raises:
        FieldError: an ``edge`` is unknown, or a line lies nowhere along the outline.
    """
    outline = shapely.LineString(shape.exterior.coords)
    own = chosen.properties.get("edge")
    fenced: shapely.Geometry = shapely.LineString()
    if own is not None and _known(own, f"the boundary of {label}") == FENCE:
        fenced = outline
    remarks = []
    for raw in lines:
        name = f"'{raw.keys[0]}' " if raw.keys else ""
        edge = _known(raw.properties.get("edge"), f"a line {name}of {label}")
        what = f"line {name}with edge '{edge}' of {label}"
        line = _line(raw, frame, what)
        away_m = float(shapely.distance(outline, line))
        if several and away_m > NEAR_M:
            continue
        side = along(outline, line)
        if side.length < min(1.0, 0.5 * line.length):
            raise FieldError(
                f"The {what} lies nowhere along the boundary, which is {away_m:.1f} m away; draw it on the boundary "
                f"(within {ALONG_M:g} m) or make it an obstacle."
            )
        if side.length < 0.8 * line.length:
            remarks.append(
                f"Of {line.length:.0f} m of a {what}, {side.length:.0f} m lie along the boundary; the rest is not used."
            )
        fenced = shapely.union(fenced, side) if edge == FENCE else shapely.difference(fenced, _band(line))
    return _lines(fenced), tuple(remarks)


def along(outline: shapely.LineString, line: shapely.LineString) -> shapely.Geometry:
    """The part of an outline that lies beside a line, within ALONG_M of it."""
    return shapely.intersection(outline, _band(line))


def _band(line: shapely.LineString) -> shapely.Geometry:
    return line.buffer(ALONG_M, cap_style="flat", join_style="mitre")


def _known(edge: object, what: str) -> str:
    if isinstance(edge, str) and edge.strip().lower() in EDGES:
        return edge.strip().lower()
    raise FieldError(f"The 'edge' of {what} is {brief(edge)}; use '{FENCE}' or '{OPEN}'.")


def _line(raw: RawObstacle, frame: Frame, what: str) -> shapely.LineString:
    """Its line in local metres."""
    entries = raw.coordinates if isinstance(raw.coordinates, list) else []
    points = frame.local(np.array([position(entry, what) for entry in entries]).reshape(-1, 2))
    line = shapely.LineString(points) if len(points) > 1 else shapely.LineString()
    if line.length == 0.0:
        raise FieldError(f"The {what} has fewer than 2 positions apart from each other; a LineString needs 2 or more.")
    return line


def _lines(fenced: shapely.Geometry) -> tuple[shapely.LineString, ...]:
    """The lines of a geometry, in an order that does not hang on GEOS; pieces that meet are joined."""
    merged = fenced if fenced.geom_type == "LineString" else shapely.line_merge(fenced)
    parts = [part for part in shapely.get_parts(merged) if part.geom_type == "LineString" and part.length > GRID_M]
    return tuple(sorted(parts, key=lambda part: [tuple(np.round(xy, 3)) for xy in part.coords]))


def check_way_in(
    outline: shapely.Polygon, fences: tuple[shapely.LineString, ...], entrance: tuple[float, float] | None, name: str
) -> None:
    """Refuse a fence that no tractor comes through: it has neither an opening nor an entrance.

    Raises:
        FieldError: there is no way in.
    """
    if not fences or entrance is not None:
        return
    left = shapely.difference(outline.exterior, shapely.buffer(shapely.union_all(fences), 0.01))
    merged = left if left.geom_type == "LineString" else shapely.line_merge(left)
    # A ring begins somewhere: an opening across that place is in two parts until they are merged.
    if max((part.length for part in shapely.get_parts(merged)), default=0.0) < OPENING_M:
        raise FieldError(
            f"The fence round field '{name}' has no way in; add a Point with role 'entrance' as its gate, or a "
            f"LineString with edge '{OPEN}' of {OPENING_M:g} m or more along it."
        )
