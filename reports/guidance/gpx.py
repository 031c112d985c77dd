"""GPX 1.1: the boundary as a track and the lines as routes in driving order, a file for every tractor.

A track that comes back to where it began is read as a boundary, by Headland and by others, so there is one of these
alone: holes, obstacles and the headland have no place in it. (A round without corners looks like one, too.)
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from reports.guidance.form import Files, Form
from reports.guidance.lines import Degrees, Guidance
from reports.guidance.markup import child, document

NAMESPACE = "http://www.topografix.com/GPX/1/1"
DECIMALS = 9


def _write(guidance: Guidance) -> Files:
    root = Element("gpx", {"xmlns": NAMESPACE, "version": "1.1", "creator": "Headland"})
    child(child(root, "metadata"), "name", guidance.field)
    if guidance.entrance is not None:
        child(_point(root, "wpt", *guidance.entrance), "name", "Entrance")
    for number, line in enumerate(guidance.lines, start=1):
        route = child(root, "rte")
        child(route, "name", line.name)
        child(route, "desc", line.words)
        child(route, "number", str(number))
        _points(route, "rtept", line.points)
    if guidance.boundary is not None:
        ring = guidance.boundary.rings[0]
        track = child(root, "trk")
        child(track, "name", guidance.field)
        _points(child(track, "trkseg"), "trkpt", np.concatenate([ring, ring[:1]]))
    return {"guidance.gpx": document(root)}


def _points(parent: Element, tag: str, points: Degrees) -> None:
    for longitude, latitude in points.tolist():
        _point(parent, tag, longitude, latitude)


def _point(parent: Element, tag: str, longitude: float, latitude: float) -> Element:
    return child(parent, tag, lat=f"{latitude:.{DECIMALS}f}", lon=f"{longitude:.{DECIMALS}f}")


FORM = Form(
    "gpx", "GPX", _write, ending=".gpx", media="application/gpx+xml", apart=True,
    lacks=("headland", "obstacles", "holes of the boundary"),
)  # fmt: skip
