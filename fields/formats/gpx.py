"""GPX 1.1: fields are read, guidance is written. Closed tracks are boundaries, other tracks and routes guidance lines.

A written file has the boundary as its only track, since closed tracks are read as boundaries, and lines as routes in
driving order. It has no place for holes, obstacles and the headland, and there is a file for every tractor.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np
import shapely

from fields.arrays import measure_along
from fields.errors import FieldError
from fields.formats.features import BOUNDARY, Feature
from fields.formats.gdal import GPX_DRIVER, build_layer_document, read_layers
from fields.formats.guidance import DEGREE_DECIMALS, DegreePoints, FileContents, GuidanceFormat, PlanGuidance
from fields.formats.markup import add_child, check_xml_root, serialise_xml
from fields.geometry.geodesy import DEGREES_CRS
from fields.raw_document import FieldDocument, FieldFormat
from fields.text_files import read_bytes

MAX_CLOSING_SHARE = 0.05
"""A track is closed when its ends are nearer than this share of its length."""
MIN_CLOSING_SHARE = 0.75
"""Share of its length after which a track may be back at its start."""
GPX_NAMESPACE = "http://www.topografix.com/GPX/1/1"


def parse_gpx(content: bytes, label: str) -> FieldDocument:
    """Parse a GPX text; raises FieldError."""
    check_xml_root(content, label, "GPX", ("gpx",))
    layers = read_layers(content, label, "GPX", (GPX_DRIVER,), ("waypoints", "routes", "tracks"))
    layers.features, layers.crs = [close_boundary_polygon(feature) for feature in layers.features], DEGREES_CRS
    if layers.features and not any(one["geometry"].get("type") == "Polygon" for one in layers.features):
        raise FieldError(
            f"{label} has no track that returns to its start, so no boundary; record a track all round the field."
        )
    return build_layer_document(layers, label, "GPX")


def close_boundary_polygon(feature: Feature) -> Feature:
    """A line that returns to its start as a polygon; any other feature unchanged."""
    geometry = feature["geometry"]
    lines = {"LineString": [geometry.get("coordinates")], "MultiLineString": geometry.get("coordinates")}
    points = [point for line in lines.get(geometry.get("type", ""), ()) for point in line or ()]
    if len(points) < 4:
        return feature
    # The track up to where it is nearest to its start again, without the overlap at its end
    places = np.array(points)[:, :2]
    travelled_deg = measure_along(places)
    if travelled_deg[-1] == 0.0:  # the receiver stood still
        return feature
    late = np.flatnonzero(travelled_deg >= MIN_CLOSING_SHARE * travelled_deg[-1])
    distance_deg = np.hypot(*(places[late] - places[0]).T)
    points = points[: int(late[int(np.argmin(distance_deg))]) + 1]
    track = shapely.LineString(points)
    if shapely.distance(shapely.Point(points[0]), shapely.Point(points[-1])) > MAX_CLOSING_SHARE * track.length:
        return feature
    properties = {**feature["properties"], "role": BOUNDARY}
    return {**feature, "properties": properties, "geometry": {"type": "Polygon", "coordinates": [[*points, points[0]]]}}


FIELD_FORMAT = FieldFormat(
    "GPX", (".gpx",), lambda path, label: parse_gpx(read_bytes(path, "a GPX file", FieldError), label), parse=parse_gpx
)


def _write_gpx(guidance: PlanGuidance) -> FileContents:
    root = Element("gpx", {"xmlns": GPX_NAMESPACE, "version": "1.1", "creator": "Headland"})
    add_child(add_child(root, "metadata"), "name", guidance.field)
    if guidance.entrance is not None:
        add_child(_add_point(root, "wpt", *guidance.entrance), "name", "Entrance")
    for number, line in enumerate(guidance.lines, start=1):
        route = add_child(root, "rte")
        add_child(route, "name", line.name)
        add_child(route, "desc", line.description)
        add_child(route, "number", str(number))
        _add_points(route, "rtept", line.points)
    if guidance.boundary is not None:
        track = add_child(root, "trk")
        add_child(track, "name", guidance.field)
        _add_points(add_child(track, "trkseg"), "trkpt", guidance.boundary.closed_rings[0])
    return {"guidance.gpx": serialise_xml(root)}


def _add_points(parent: Element, tag: str, points: DegreePoints) -> None:
    for longitude, latitude in points.tolist():
        _add_point(parent, tag, longitude, latitude)


def _add_point(parent: Element, tag: str, longitude: float, latitude: float) -> Element:
    return add_child(parent, tag, lat=f"{latitude:.{DEGREE_DECIMALS}f}", lon=f"{longitude:.{DEGREE_DECIMALS}f}")


GUIDANCE_FORMAT = GuidanceFormat(
    "gpx",
    "GPX",
    _write_gpx,
    extension=".gpx",
    media_type="application/gpx+xml",
    per_tractor=True,
    unsupported_parts=("headland", "obstacles", "holes of the boundary"),
)
