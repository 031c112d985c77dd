"""KML 2.2 (OGC 12-007) and KMZ, always in longitude and latitude: fields are read, guidance is written.

Written files have a folder for the field and one for every tractor in its colour.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from xml.etree.ElementTree import Element

import numpy as np

from fields.errors import FieldError
from fields.formats.archive import ArchiveMembers, is_archive
from fields.formats.gdal import KML_DRIVERS, LayerFeatures, build_layer_document, read_layers
from fields.formats.guidance import (
    DEGREE_DECIMALS,
    DegreePoints,
    FileContents,
    GuidanceArea,
    GuidanceFormat,
    GuidedLine,
    PlanGuidance,
)
from fields.formats.markup import add_child, check_xml_root, serialise_xml
from fields.geometry.geodesy import DEGREES_CRS
from fields.raw_document import FieldDocument, FieldFormat
from fields.text_files import read_bytes

MAIN_DOCUMENT = "doc.kml"
ROOT_TAGS = ("kml", "Document", "Folder", "Placemark")
KML_NAMESPACE = "http://www.opengis.net/kml/2.2"
BOUNDARY_STYLE, HEADLAND_STYLE = "boundary", "headland"
LINE_STYLES = {BOUNDARY_STYLE: ("ff404040", "3"), HEADLAND_STYLE: ("ff909090", "2")}


def read_kml_texts(path: str, label: str) -> list[bytes]:
    """The text of a KML file, or every document of a KMZ, the main one first; raises FieldError."""
    if not is_archive(path):
        return [read_bytes(path, "a KML file", FieldError)]
    members = ArchiveMembers(path)
    names = [name for name in members if name.lower().endswith(".kml")]
    if not names:
        raise FieldError(f"{label} contains no KML; give a KMZ with a doc.kml in it.")
    names.sort(key=lambda name: PurePosixPath(name).name.lower() != MAIN_DOCUMENT)
    return [members[name] for name in names]


def _build_kml_document(texts: list[bytes], label: str) -> FieldDocument:
    """The field document of KML texts; links are not followed. Raises FieldError."""
    document = LayerFeatures(crs=DEGREES_CRS)
    for content in texts:
        check_xml_root(content, label, "KML", ROOT_TAGS)
        layers = read_layers(content, label, "KML", KML_DRIVERS)
        document.features += layers.features
        document.notes += layers.notes
    return build_layer_document(document, label, "KML")


FIELD_FORMAT = FieldFormat(
    "KML",
    (".kml", ".kmz"),
    lambda path, label: _build_kml_document(read_kml_texts(path, label), label),
    lambda names: MAIN_DOCUMENT in names,
    lambda content, label: _build_kml_document([content], label),
)


def _write_kml(guidance: PlanGuidance) -> FileContents:
    root = Element("kml", {"xmlns": KML_NAMESPACE})
    top = add_child(root, "Document")
    add_child(top, "name", guidance.field)
    tractors = {f"T{one.number}": (_convert_colour(one.colour), "2") for one in guidance.tractors}
    for name, (colour, width) in {**LINE_STYLES, **tractors}.items():
        style = add_child(top, "Style", id=name)
        stroke = add_child(style, "LineStyle")
        add_child(stroke, "color", colour)
        add_child(stroke, "width", width)
        add_child(add_child(style, "PolyStyle"), "fill", "0")
    _add_field(top, guidance)
    for tractor in guidance.tractors:
        folder = add_child(top, "Folder")
        add_child(folder, "name", f"T{tractor.number}")
        for line in tractor.lines:
            _add_line(folder, line)
    return {"guidance.kml": serialise_xml(root)}


def _convert_colour(colour: str) -> str:
    """A colour in KML's order: opacity, blue, green, red."""
    red, green, blue = (colour[at : at + 2] for at in (1, 3, 5))
    return f"ff{blue}{green}{red}".lower()


def _add_field(top: Element, guidance: PlanGuidance) -> None:
    folder = add_child(top, "Folder")
    add_child(folder, "name", "Field")
    if guidance.boundary is not None:
        _add_polygon(folder, guidance.field, BOUNDARY_STYLE, guidance.boundary)
    for area in guidance.obstacles:
        _add_polygon(folder, area.name, "obstacle", area)
    for area in guidance.headland_interior:
        for ring in area.closed_rings:
            mark = _add_placemark(folder, "inside of the headland", HEADLAND_STYLE, role=HEADLAND_STYLE)
            _add_positions(add_child(mark, "LineString"), ring)
    if guidance.entrance is not None:
        mark = _add_placemark(folder, "Entrance", None, role="entrance")
        _add_positions(add_child(mark, "Point"), np.array([guidance.entrance]))


def _add_polygon(folder: Element, name: str, role: str, area: GuidanceArea) -> None:
    mark = _add_placemark(folder, name, BOUNDARY_STYLE, role=role)
    polygon = add_child(mark, "Polygon")
    for place, ring in enumerate(area.closed_rings):
        inside = add_child(polygon, "innerBoundaryIs" if place else "outerBoundaryIs")
        _add_positions(add_child(inside, "LinearRing"), ring)


def _add_line(folder: Element, line: GuidedLine) -> None:
    values = {"tractor": str(line.tractor), "order": str(line.order), "what": line.description}
    mark = _add_placemark(folder, line.name, f"T{line.tractor}", role="guidance", **values)
    _add_positions(add_child(mark, "LineString"), line.points)


def _add_placemark(folder: Element, name: str, style: str | None, **values: str) -> Element:
    mark = add_child(folder, "Placemark")
    add_child(mark, "name", name)
    if style is not None:
        add_child(mark, "styleUrl", f"#{style}")
    data = add_child(mark, "ExtendedData")
    for key, value in values.items():
        add_child(add_child(data, "Data", name=key), "value", value)
    return mark


def _add_positions(geometry: Element, points: DegreePoints) -> None:
    places = [f"{x:.{DEGREE_DECIMALS}f},{y:.{DEGREE_DECIMALS}f}" for x, y in points.tolist()]
    add_child(geometry, "coordinates", " ".join(places))


GUIDANCE_FORMAT = GuidanceFormat(
    "kml", "KML", _write_kml, extension=".kml", media_type="application/vnd.google-earth.kml+xml"
)
