"""KML 2.2 (OGC 07-147): a folder for the field and one for every tractor, each with a colour of its own."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from reports.guidance.form import Files, Form
from reports.guidance.lines import Area, Degrees, Guidance, Line
from reports.guidance.markup import child, document
from reports.palette import tractor_colour

NAMESPACE = "http://www.opengis.net/kml/2.2"
DECIMALS = 9
BOUNDARY, HEADLAND = "boundary", "headland"
STYLES = {BOUNDARY: ("ff404040", "3"), HEADLAND: ("ff909090", "2")}


def _write(guidance: Guidance) -> Files:
    root = Element("kml", {"xmlns": NAMESPACE})
    top = child(root, "Document")
    child(top, "name", guidance.field)
    _styles(top, guidance)
    _field(top, guidance)
    for tractor in guidance.tractors:
        folder = child(top, "Folder")
        child(folder, "name", f"T{tractor.number}")
        for line in tractor.lines:
            _line(folder, line)
    return {"guidance.kml": document(root)}


def _styles(top: Element, guidance: Guidance) -> None:
    tractors = {f"T{one.number}": (_colour(one.number), "2") for one in guidance.tractors}
    for name, (colour, width) in {**STYLES, **tractors}.items():
        style = child(top, "Style", id=name)
        stroke = child(style, "LineStyle")
        child(stroke, "color", colour)
        child(stroke, "width", width)
        child(child(style, "PolyStyle"), "fill", "0")


def _colour(tractor: int) -> str:
    """The colour of a tractor as KML has it: opacity, blue, green, red."""
    red, green, blue = (tractor_colour(tractor - 1)[at : at + 2] for at in (1, 3, 5))
    return f"ff{blue}{green}{red}".lower()


def _field(top: Element, guidance: Guidance) -> None:
    folder = child(top, "Folder")
    child(folder, "name", "Field")
    if guidance.boundary is not None:
        _polygon(folder, guidance.field, BOUNDARY, guidance.boundary)
    for area in guidance.obstacles:
        _polygon(folder, area.name, "obstacle", area)
    for area in guidance.inside_headland:
        for ring in area.rings:
            mark = _placemark(folder, "inside of the headland", HEADLAND, role=HEADLAND)
            _positions(child(mark, "LineString"), _closed(ring))
    if guidance.entrance is not None:
        mark = _placemark(folder, "Entrance", None, role="entrance")
        _positions(child(mark, "Point"), np.array([guidance.entrance]))


def _polygon(folder: Element, name: str, role: str, area: Area) -> None:
    mark = _placemark(folder, name, BOUNDARY, role=role)
    polygon = child(mark, "Polygon")
    for place, ring in enumerate(area.rings):
        inside = child(polygon, "innerBoundaryIs" if place else "outerBoundaryIs")
        _positions(child(inside, "LinearRing"), _closed(ring))


def _line(folder: Element, line: Line) -> None:
    values = {"tractor": str(line.tractor), "order": str(line.order), "what": line.words}
    mark = _placemark(folder, line.name, f"T{line.tractor}", role="guidance", **values)
    _positions(child(mark, "LineString"), line.points)


def _placemark(folder: Element, name: str, style: str | None, **values: str) -> Element:
    mark = child(folder, "Placemark")
    child(mark, "name", name)
    if style is not None:
        child(mark, "styleUrl", f"#{style}")
    data = child(mark, "ExtendedData")
    for key, value in values.items():
        child(child(data, "Data", name=key), "value", value)
    return mark


def _closed(ring: Degrees) -> Degrees:
    return np.concatenate([ring, ring[:1]])


def _positions(geometry: Element, points: Degrees) -> None:
    child(geometry, "coordinates", " ".join(f"{x:.{DECIMALS}f},{y:.{DECIMALS}f}" for x, y in points.tolist()))


FORM = Form("kml", "KML", _write, ending=".kml", media="application/vnd.google-earth.kml+xml")
