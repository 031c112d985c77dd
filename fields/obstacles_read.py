"""Obstacles of a field file in local metres, their sizes checked, and those that are off the field told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from fields.document import Document, RawObstacle, RawPolygon
from fields.errors import FieldError
from fields.frame import Frame
from fields.obstacles import AREA, MOST_M, POINT, USUAL_RADIUS_M, USUAL_WIDTH_M, Obstacle
from fields.outline import polygon, position, rings
from fields.reading import brief

BESIDE_M = 20.0  # what stands farther from a field is reached by nothing that turns in it
MOST_NAMED = 5


def read_obstacle(raw: RawObstacle, frame: Frame, label: str) -> Obstacle:
    """One obstacle; raises FieldError where its coordinates or its size cannot be used."""
    name = raw.keys[0] if raw.keys else ""
    kind = str(raw.properties.get("kind") or "").strip().lower()
    what = f"obstacle '{name or kind}' of {label}" if name or kind else f"an obstacle of {label}"
    if raw.form == AREA:
        parts = [frame.local(part) for part in rings(raw.coordinates, what)]
        return Obstacle(kind or "area", polygon(parts, what), name=name)
    if raw.form == POINT:
        place = frame.local(np.array([position(raw.coordinates, what)]))[0]
        return Obstacle(kind or "point", shapely.Point(place), _size(raw, "radius_m", kind, USUAL_RADIUS_M, what), name)
    line = raw.coordinates if isinstance(raw.coordinates, list) else []
    if len(line) < 2:
        raise FieldError(f"The line of {what} has {len(line)} positions; a LineString needs 2 or more.")
    points = frame.local(np.array([position(entry, what) for entry in line]))
    width_m = _size(raw, "width_m", kind, USUAL_WIDTH_M, what)
    return Obstacle(kind or "line", shapely.LineString(points), width_m / 2.0, name)


def _size(raw: RawObstacle, key: str, kind: str, usual: dict[str, float], what: str) -> float:
    """Radius or width of an obstacle: its own, else the usual one of its kind."""
    value = raw.properties.get(key)
    if value is None and kind in usual:
        return usual[kind]
    if value is None:
        raise FieldError(
            f"The {raw.form} of {what} has no '{key}'; give one, or a 'kind' that has a usual one: {', '.join(usual)}."
        )
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= MOST_M:
        raise FieldError(f"The '{key}' of {what} is {brief(value)}; it must be a number above 0, at most {MOST_M:g}.")
    return float(value)


def on_field(
    read: Sequence[Obstacle], shape: shapely.Polygon, several: bool, label: str
) -> tuple[tuple[Obstacle, ...], tuple[str, ...]]:
    """Obstacles in and close beside a field, and remarks on the others and on those that only stand beside it.

    In a file of several fields those of other fields are counted only. Raises FieldError where all are away from the
    one field of a file: then its coordinates or theirs are wrong.
    """
    outline = shapely.Polygon(shape.exterior)
    told = [(one, float(outline.distance(one.shape))) for one in read]
    kept = tuple(one for one, away_m in told if away_m <= BESIDE_M)
    away = [(str(one), away_m) for one, away_m in told if away_m > BESIDE_M]
    beside = [(str(one), away_m) for one, away_m in told if 0.0 < away_m <= BESIDE_M]
    if several:
        one = len(away) == 1
        lie = f"{'An obstacle' if one else f'{len(away)} obstacles'} of {label} {'lies' if one else 'lie'}"
        return kept, (f"{lie} away from this field and {'is' if one else 'are'} left out.",) if away else ()
    if away and len(away) == len(told):
        least = min(away_m for _, away_m in away)
        raise FieldError(
            f"{_named([name for name, _ in away])} of {label} {'lies' if len(away) == 1 else 'all lie'} outside the "
            f"field, {least:.0f} m away{'' if len(away) == 1 else ' or more'}; check the coordinates (easting or "
            "longitude first), or take the role 'obstacle' away."
        )
    return kept, (*_left_out(away), *_beside(beside))


def _left_out(away: Sequence[tuple[str, float]]) -> tuple[str, ...]:
    """A sentence on obstacles outside a field, each with its distance in metres; none for none."""
    if not away:
        return ()
    one = len(away) == 1
    told = _named([f"{name}, {away_m:.0f} m away," if one else name for name, away_m in away])
    return (f"{told} {'lies' if one else 'lie'} outside the field and {'is' if one else 'are'} left out.",)


def _beside(told: Sequence[tuple[str, float]]) -> tuple[str, ...]:
    """A sentence on obstacles close beside a field."""
    if not told:
        return ()
    stand = f"{_named([name for name, _ in told])} {'stands' if len(told) == 1 else 'stand'}"
    return (f"{stand} beside the field, not in it; only what reaches over the boundary keeps off.",)


def _named(names: Sequence[str]) -> str:
    """The first few of some names, and how many more there are."""
    shown = [name if place == 0 else name[0].lower() + name[1:] for place, name in enumerate(names[:MOST_NAMED])]
    more = [f"{len(names) - MOST_NAMED} more"] if len(names) > MOST_NAMED else []
    parts = [*shown, *more]
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def polygons_inside(document: Document, chosen: RawPolygon, frame: Frame, shape: shapely.Polygon) -> list[Obstacle]:
    """Other polygons of a file that lie wholly inside the chosen one: nobody works one field within another."""
    inside = []
    for raw in document.polygons:
        ring = None if raw is chosen else _outer(raw, frame, shape)
        if ring is not None and shapely.contains_properly(shape, ring):
            inside.append(Obstacle("area", ring, name=raw.keys[0] if raw.keys else ""))
    return inside


def _outer(raw: RawPolygon, frame: Frame, shape: shapely.Polygon) -> shapely.Polygon | None:
    """The outline of a polygon that may lie inside a shape; None where it does not, or is unusable."""
    try:
        first: Any = raw.coordinates[0][0]
        place = frame.local(np.array([position(first, "")]))[0]
        if not shapely.intersects_xy(shapely.box(*shape.bounds), *place):
            return None
        ring = shapely.Polygon(frame.local(rings(raw.coordinates, "")[0]))
    except (FieldError, TypeError, LookupError):
        return None
    return ring if ring.is_valid else None
