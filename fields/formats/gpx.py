"""GPX 1.1: a track walked or driven round a field is its boundary, any other track or route a guidance line."""

from __future__ import annotations

import numpy as np
import shapely

from fields.document import Document, Format
from fields.errors import FieldError
from fields.formats.features import BOUNDARY, Feature, document_of
from fields.formats.markup import refuse_entities
from fields.formats.vector import WGS84, named_lines, read_layers
from fields.reading import read_bytes

CLOSED_SHARE = 0.05
"""A track is closed when its ends are nearer than this share of its length: who walks round a field comes back."""
LATE_SHARE = 0.75
"""After this share of its length a track may be back at its start."""


def _read(path: str, label: str) -> Document:
    refuse_entities(read_bytes(path, "a GPX file", FieldError), label)
    found = read_layers(path, label, "GPX", ("waypoints", "routes", "tracks"))
    features = [closed(feature) for feature in found.features]
    if features and not any(feature["geometry"].get("type") == "Polygon" for feature in features):
        raise FieldError(
            f"{label} has no track that comes back to where it began, so no boundary; record one all round the field."
        )
    return document_of(named_lines(features), label, crs=WGS84, source="GPX", notes=tuple(found.notes))


def closed(feature: Feature) -> Feature:
    """A line that comes back to its start as a polygon; anything else as it is."""
    geometry = feature["geometry"]
    lines = {"LineString": [geometry.get("coordinates")], "MultiLineString": geometry.get("coordinates")}
    points = [point for line in lines.get(geometry.get("type", ""), ()) for point in line or ()]
    if len(points) < 4:
        return feature
    points = _once_round(points)
    way = shapely.LineString(points)
    if shapely.distance(shapely.Point(points[0]), shapely.Point(points[-1])) > CLOSED_SHARE * way.length:
        return feature
    properties = {**feature["properties"], "role": BOUNDARY}
    return {**feature, "properties": properties, "geometry": {"type": "Polygon", "coordinates": [[*points, points[0]]]}}


def _once_round(points: list[list[float]]) -> list[list[float]]:
    """A track up to where it comes nearest to its start again: who walks round a field often goes on a little."""
    places = np.array(points)[:, :2]
    steps = np.hypot(*np.diff(places, axis=0).T)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    late = np.flatnonzero(gone >= LATE_SHARE * gone[-1])
    away = np.hypot(*(places[late] - places[0]).T)
    return points[: int(late[int(np.argmin(away))]) + 1]


FORMAT = Format("GPX", (".gpx",), _read)
