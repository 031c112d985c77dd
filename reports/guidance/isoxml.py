"""ISOXML (ISO 11783-10) of versions 3 and 4: TASKDATA/TASKDATA.XML with one partfield.

Version 4 has a guidance group (GGP) for every tractor with a pattern (GPN) for every line, in driving order; type 1 is
AB, 3 a curve. Version 3 has lines of type 5 beside the polygons and knows neither groups nor headlands, so there every
tractor gets a file of its own. Both are valid against the schemas TaskFile V4-3 and V3-3 of the AEF.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from itertools import count
from xml.etree.ElementTree import Element

from reports.guidance.form import Files, Form
from reports.guidance.lines import Area, Degrees, Guidance, Line
from reports.guidance.markup import child, document
from reports.guidance.names import designator

PLACE = "TASKDATA/TASKDATA.XML"
SOFTWARE = "Headland"
BOUNDARY, OBSTACLE, HEADLAND = "1", "6", "10"
OUTER, INNER, GUIDANCE = "1", "2", "5"
OTHER, ENTRANCE, POINT_A, POINT_B, BETWEEN = "2", "3", "6", "7", "9"
AB, CURVE = "1", "3"
BOTH_SIDES, BOTH_ENDS, DESKTOP = "1", "1", "16"
"""How a pattern goes on beyond itself, and that its points were not measured."""
DECIMALS = 9
UNNAMED = "Field"


def _version_4(guidance: Guidance) -> Files:
    root, partfield = _partfield(guidance, "4")
    if guidance.boundary is not None and guidance.inside_headland:
        headland = child(partfield, "PLN", A=HEADLAND, B="Headland")
        _ring(headland, OUTER, guidance.boundary.rings[0])
        for area in guidance.inside_headland:
            _ring(headland, INNER, area.rings[0])
    if guidance.entrance is not None:
        _point(partfield, ENTRANCE, *guidance.entrance, name="Entrance")
    patterns = count(1)
    for tractor in guidance.tractors:
        if tractor.lines:
            group = child(partfield, "GGP", A=f"GGP{tractor.number}", B=f"T{tractor.number}")
            for line in tractor.lines:
                _pattern(group, f"GPN{next(patterns)}", line)
    return {PLACE: document(root)}


def _version_3(guidance: Guidance) -> Files:
    root, partfield = _partfield(guidance, "3")
    for line in guidance.lines:
        _line(partfield, line, (OTHER, OTHER, OTHER), B=designator(line.name, UNNAMED))
    return {PLACE: document(root)}


def _partfield(guidance: Guidance, major: str) -> tuple[Element, Element]:
    """The root and its partfield with boundary and obstacles."""
    root = Element("ISO11783_TaskData", {
        "VersionMajor": major, "VersionMinor": "3", "ManagementSoftwareManufacturer": SOFTWARE,
        "ManagementSoftwareVersion": _version(), "DataTransferOrigin": "1",
    })  # fmt: skip
    partfield = child(root, "PFD", A="PFD1", C=designator(guidance.field, UNNAMED), D=f"{guidance.area_m2:.0f}")
    if guidance.boundary is not None:
        _polygon(partfield, BOUNDARY, guidance.boundary)
    for area in guidance.obstacles:
        _polygon(partfield, OBSTACLE, area)
    return root, partfield


def _version() -> str:
    """The version of Headland that is installed."""
    try:
        return version("headland")
    except PackageNotFoundError:
        return "unknown"


def _polygon(partfield: Element, kind: str, area: Area) -> None:
    polygon = child(partfield, "PLN", A=kind, B=designator(area.name, UNNAMED))
    for place, ring in enumerate(area.rings):
        _ring(polygon, INNER if place else OUTER, ring)


def _ring(polygon: Element, kind: str, ring: Degrees) -> None:
    """A ring that ends where it begins."""
    line = child(polygon, "LSG", A=kind)
    for longitude, latitude in (*ring.tolist(), ring[0].tolist()):
        _point(line, OTHER, longitude, latitude)


def _pattern(group: Element, key: str, line: Line) -> None:
    pattern = child(
        group, "GPN", A=key, B=designator(line.name, key), C=AB if line.straight else CURVE, E=BOTH_SIDES, F=BOTH_ENDS,
        G=f"{line.bearing_deg % 360.0:.6f}", I=DESKTOP,
    )  # fmt: skip
    _line(pattern, line, (POINT_A, BETWEEN, POINT_B))


def _line(parent: Element, line: Line, kinds: tuple[str, str, str], **attributes: str) -> None:
    """A line whose first point, points between and last point are of these kinds."""
    element = child(parent, "LSG", A=GUIDANCE, **attributes)
    last = len(line.points) - 1
    for place, (longitude, latitude) in enumerate(line.points.tolist()):
        _point(element, kinds[0] if place == 0 else kinds[2] if place == last else kinds[1], longitude, latitude)


def _point(parent: Element, kind: str, longitude: float, latitude: float, name: str | None = None) -> None:
    place = {"C": f"{latitude:.{DECIMALS}f}", "D": f"{longitude:.{DECIMALS}f}"}
    child(parent, "PNT", A=kind, **({} if name is None else {"B": name}), **place)


FORM_4 = Form("isoxml4", "ISOXML version 4", _version_4, curves=False)
FORM_3 = Form("isoxml3", "ISOXML version 3", _version_3, apart=True, curves=False, lacks=("headland", "entrance"))
