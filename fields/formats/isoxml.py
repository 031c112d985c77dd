"""ISOXML (ISO 11783-10), versions 3 and 4: TASKDATA folders and archives are read, guidance is written.

A partfield (PFD) has polygons (PLN) of line strings (LSG) of points (PNT, latitude C and longitude D), and guidance
patterns (GPN) in groups (GGP); version 3 has guidance lines as line strings of type 5 beside the polygons. Numbers of
types are those of the standard's lists PolygonType, LineStringType, PointType and GuidancePatternType. External files
(XFR) are read too.

Written files have one partfield. In version 4 every tractor has a guidance group with a pattern for every line, in
driving order; type 1 is AB, 3 a curve. Version 3 has neither groups nor headlands, so every tractor gets its own file.
Both are valid against the schemas TaskFile V4-3 and V3-3 of the AEF.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

from shapely import Polygon

from fields.errors import FieldError, join_first
from fields.feature_words import ENTRANCE, OBSTACLE, REFILL, find_word_meaning
from fields.formats.archive import ArchiveMembers, is_archive
from fields.formats.features import Feature, build_document, build_feature
from fields.formats.guidance import (
    DEGREE_DECIMALS,
    DegreePoints,
    FileContents,
    GuidanceArea,
    GuidanceFormat,
    GuidedLine,
    PlanGuidance,
    build_designator,
)
from fields.formats.markup import add_child, parse_root, serialise_xml
from fields.geometry.geodesy import DEGREES_CRS, compute_rings_area_m2, extend_position
from fields.raw_document import FieldDocument, FieldFormat
from fields.text_files import count_noun, parse_number, read_bytes

TASKDATA_FILE = "taskdata.xml"
BOUNDARY_TYPE, MAINFIELD_TYPE, OBSTACLE_TYPES = "1", "9", {"3": "water", "4": "building", "5": "road", "6": "area"}
HEADLAND_TYPE = "10"
OUTER_RING, INNER_RING, GUIDANCE_LINE_TYPE = "1", "2", "5"
ENTRANCE_TYPE, OBSTACLE_POINT_TYPE, FLAG_TYPES = "3", "5", ("1", "2")
OBSTACLE_LINE_TYPE, DEFAULT_LINE_WIDTH_MM = "9", 1000
PATTERN_TYPES = {"1": "AB", "2": "A+", "3": "curve", "4": "pivot", "5": "spiral"}
MAX_AREA_RATIO = 1.2
"""If the stated area and the area of the ring differ by more than this factor, there is a remark."""
TASKDATA_PATH = "TASKDATA/TASKDATA.XML"
SOFTWARE_NAME = "Headland"
OBSTACLE_TYPE = "6"
OTHER_POINT_TYPE, A_TYPE, B_TYPE, BETWEEN_TYPE = "2", "6", "7", "9"
GPN_AB, GPN_CURVE = "1", "3"
GPN_BOTH_SIDES, GPN_BOTH_ENDS, GPN_DESKTOP = "1", "1", "16"
"""Extension of a pattern to both sides and ends; origin of its points (not measured)."""
FALLBACK_NAME = "Field"


def _read_isoxml(path: str, label: str) -> FieldDocument:
    place = Path(path)
    if place.is_dir() or is_archive(place):
        members = ArchiveMembers(place)
        mains = members.find_paths_by_name(TASKDATA_FILE)
        if not mains:
            raise FieldError(f"{label} contains no TASKDATA.XML; name the folder or archive that does.")
        roots = [root for main in mains for root in read_taskdata_roots(members, main, label)]
    else:
        roots = list(_read_file_roots(place, label))
    features: list[Feature] = []
    notes: list[str] = []
    empty: list[str] = []
    for element in (partfield for root in roots for partfield in root.iter("PFD")):
        partfield_features = _read_partfield(element, notes)
        features += partfield_features
        empty += [] if partfield_features else [_get_partfield_name(element)]
    if empty:
        notes.append(f"Partfields without a boundary are skipped: {join_first(empty)}.")
    if not features:
        raise FieldError(f"{label} is ISOXML without a partfield with points; export the fields with boundaries.")
    return build_document(features, label, crs=DEGREES_CRS, source="ISOXML", notes=tuple(notes))


def read_taskdata_roots(members: ArchiveMembers, taskdata_file: str, label: str) -> Iterator[Element]:
    """The root of one TASKDATA.XML of a folder or archive, and of the external files it names; raises FieldError."""
    root = parse_root(members[taskdata_file], f"{PurePosixPath(taskdata_file).name} of {label}")
    yield root
    yield from _read_external_roots(root, label, partial(members.read_member_beside, taskdata_file))


def read_boundary_rings(element: Element) -> list[list[list[float]]]:
    """Longitude and latitude of the rings of a partfield's boundary, the outer one first; empty without a boundary."""
    for polygon in element.findall("PLN"):
        if polygon.get("A") in (BOUNDARY_TYPE, MAINFIELD_TYPE, None):
            parts = _read_boundary(polygon, {"name": _get_partfield_name(element)}, [])
            if parts:
                rings: list[list[list[float]]] = parts[0]["geometry"]["coordinates"]
                return rings
    return []


def _read_file_roots(place: Path, label: str) -> Iterator[Element]:
    """The root of one file, and of the external files that it names."""
    root = parse_root(read_bytes(place, "an ISOXML file", FieldError), label)
    if root.tag != "ISO11783_TaskData":
        raise FieldError(f"{label} is XML but not ISOXML (its root is '{root.tag[:40]}'); give a TASKDATA.XML.")
    yield root

    def read_beside(name: str) -> bytes | None:  # only a file that names others has its folder listed
        return ArchiveMembers(place.parent, 0).read_member_beside(place.name, name)

    yield from _read_external_roots(root, label, read_beside)


def _read_external_roots(root: Element, label: str, read_beside: Callable[[str], bytes | None]) -> Iterator[Element]:
    for reference in root.iter("XFR"):
        external_file = f"{reference.get('A') or ''}.XML"
        content = read_beside(external_file)
        if content is None and (reference.get("A") or "").upper().startswith("PFD"):
            raise FieldError(
                f"{label} names the external file {external_file}, which is missing; copy the whole folder."
            )
        if content is not None:
            yield parse_root(content, f"{external_file} of {label}")


def _read_partfield(element: Element, notes: list[str]) -> list[Feature]:
    """Boundary, obstacles, entrance and lines of one partfield."""
    name = _get_partfield_name(element)
    identity = {"name": name, "id": (element.get("A") or "").strip()}
    features: list[Feature] = []
    for kind, polygon in ((each.get("A"), each) for each in element.findall("PLN")):
        if kind in (BOUNDARY_TYPE, MAINFIELD_TYPE, None):
            features += _read_boundary(polygon, identity, notes)
        elif kind in OBSTACLE_TYPES:
            rings = _read_rings(polygon, (OUTER_RING, INNER_RING), name, notes)
            properties = {"role": "obstacle", "kind": OBSTACLE_TYPES[kind], "name": (polygon.get("B") or "").strip()}
            features += [build_feature("Polygon", rings, properties)] if rings else []
        elif kind == HEADLAND_TYPE:
            edges = _read_rings(polygon, (INNER_RING,), name, notes) or _read_rings(polygon, (OUTER_RING,), name, notes)
            features += [build_feature("LineString", [*edge, edge[0]], {"role": "headland"}) for edge in edges]
    boundaries = [one for one in features if one["properties"].get("role") == "boundary"]
    if not boundaries:
        return []
    _compare_areas(element, boundaries, name, notes)
    outlines = [one["geometry"] for one in boundaries]  # terminals repeat the ring in a guidance group
    unique = [one for place, one in enumerate(boundaries) if one["geometry"] not in outlines[:place]]
    return [
        *unique,
        *(one for one in features if one not in boundaries),
        *_read_points(element),
        *_read_obstacle_lines(element, name, notes),
        *_read_guidance_lines(element, name, notes),
    ]


def _get_partfield_name(element: Element) -> str:
    """The name of a partfield: its designator, else its id."""
    return (element.get("C") or "").strip() or (element.get("A") or "").strip()


def _read_boundary(polygon: Element, identity: dict[str, str], notes: list[str]) -> list[Feature]:
    """Boundaries of a polygon: every outer ring with the inner rings in it; swapped rings are exchanged."""
    outer = _read_rings(polygon, (OUTER_RING,), identity["name"], notes)
    inner = _read_rings(polygon, (INNER_RING,), identity["name"], notes)
    surrounding = next((ring for ring in inner if outer and _is_surrounding(ring, [*outer, *inner])), None)
    if surrounding is not None:
        notes.append(f"The outer and inner rings of '{identity['name']}' are swapped; this was corrected.")
        outer, inner = [surrounding], [ring for ring in (*outer, *inner) if ring is not surrounding]
    if not outer and len(inner) == 1:
        notes.append(f"'{identity['name']}' has only an inner ring; it is read as the boundary.")
        outer, inner = inner, []
    shapes = [Polygon(ring) for ring in outer]
    parts = []
    placed = 0
    for ring, shape in zip(outer, shapes, strict=True):
        holes = [one for one in inner if len(outer) == 1 or (shape.is_valid and shape.contains(Polygon(one)))]
        placed += len(holes)
        parts.append(build_feature("Polygon", [ring, *holes], {**identity, "role": "boundary"}))
    if placed < len(inner):
        notes.append(
            f"Skipped in '{identity['name']}': {count_noun(len(inner) - placed, 'inner ring')} outside its outer rings."
        )
    return parts


def _is_surrounding(ring: list[list[float]], rings: list[list[list[float]]]) -> bool:
    """Whether a ring contains all others."""
    shape = Polygon(ring)
    return shape.is_valid and all(one is ring or (one != ring and shape.covers(Polygon(one))) for one in rings)


def _compare_areas(element: Element, boundaries: list[Feature], name: str, notes: list[str]) -> None:
    """Add a note if the stated area of a partfield differs from that of its boundary."""
    try:
        outlines = [each["geometry"]["coordinates"] for each in boundaries]
        stated_m2 = float(element.get("D") or 0.0)
        area_m2 = sum(map(compute_rings_area_m2, outlines))
        swapped_area_m2 = sum(compute_rings_area_m2(rings, swap_axes=True) for rings in outlines)
    except ValueError:
        return
    is_known = stated_m2 > 0.0 and area_m2 > 0.0  # places that are not on the earth have no area
    if not is_known or 1.0 / MAX_AREA_RATIO < stated_m2 / area_m2 < MAX_AREA_RATIO:
        return
    fits_swapped = swapped_area_m2 > 0.0 and abs(stated_m2 / swapped_area_m2 - 1.0) < 0.05
    why = "; latitude and longitude seem to be swapped, so try the option swap axes" if fits_swapped else ""
    notes.append(f"'{name}' is {stated_m2 / 1e4:.2f} ha by its file and {area_m2 / 1e4:.2f} ha by its boundary{why}.")


def _read_rings(polygon: Element, kinds: tuple[str, ...], name: str, notes: list[str]) -> list[list[list[float]]]:
    """Rings of a polygon of these kinds; rings with fewer than three points are skipped with a note."""
    rings = []
    short_rings = 0
    for line in polygon.findall("LSG"):
        if line.get("A") not in kinds:
            continue
        points = _read_positions(line, notes, name)
        distinct = {tuple(point) for point in points}
        if len(distinct) < 3:
            short_rings += 1
        else:
            rings.append(points)
    if short_rings:
        notes.append(f"Skipped in '{name}': {count_noun(short_rings, 'ring')} with fewer than 3 points.")
    return rings


def _read_positions(line: Element, notes: list[str], name: str) -> list[list[float]]:
    """Longitude and latitude of the points of a line; points without numbers are skipped with a note."""
    points = [_parse_position(each) for each in line.findall("PNT")]
    bad_points = sum(one is None for one in points)
    if bad_points:
        notes.append(f"Skipped in '{name}': {count_noun(bad_points, 'point')} without a valid position.")
    return [one for one in points if one is not None]


def _parse_position(point: Element) -> list[float] | None:
    place = [parse_number(point.get("D")), parse_number(point.get("C"))]
    return place if all(map(math.isfinite, place)) else None


def _read_points(element: Element) -> list[Feature]:
    """Point features: the entrance, obstacles, and flags that are named like either; one of several entrances is chosen
    by the user, who knows those of one name by their places.
    """
    features = []
    entrances = [point for point in element.findall("PNT") if point.get("A") == ENTRANCE_TYPE]
    names = Counter(point.get("B") or ENTRANCE for point in entrances)
    for point in element.findall("PNT"):
        place, kind, name = _parse_position(point), point.get("A"), point.get("B") or ""
        if place is None:
            continue
        if kind == ENTRANCE_TYPE:
            name = name or ENTRANCE
            name = name if names[name] == 1 else "{} at {:.6f},{:.6f}".format(name, *place)
            choice = {"role": ENTRANCE} if len(entrances) == 1 else {"kind": ENTRANCE, "name": name}
            features.append(build_feature("Point", place, choice))
        elif kind == OBSTACLE_POINT_TYPE:
            features.append(build_feature("Point", place, {"role": "obstacle", "kind": "pole", "name": name}))
        elif kind in FLAG_TYPES and find_word_meaning(name).use in (OBSTACLE, ENTRANCE, REFILL):
            features.append(build_feature("Point", place, {"name": name.strip()}))
    return features


def _read_obstacle_lines(element: Element, name: str, notes: list[str]) -> list[Feature]:
    """Lines of the type obstacle, with their width in millimetres (attribute C)."""
    features = []
    for line in element.findall("LSG"):
        points = _read_positions(line, notes, name) if line.get("A") == OBSTACLE_LINE_TYPE else []
        width_mm = line.get("C") or ""
        if len(points) > 1:
            width_m = (int(width_mm) if width_mm.isdecimal() and int(width_mm) else DEFAULT_LINE_WIDTH_MM) / 1000.0
            properties = {"role": "obstacle", "name": (line.get("B") or "").strip(), "width_m": width_m}
            features.append(build_feature("LineString", points, properties))
    return features


def _read_guidance_lines(element: Element, field: str, notes: list[str]) -> list[Feature]:
    """Guidance lines: AB, A+ with its heading, and curves; others are skipped with a note."""
    plain_lines = [one for one in element.findall("LSG") if one.get("A") == GUIDANCE_LINE_TYPE]
    features = [_read_line(line, line.get("B") or f"line {place + 1}") for place, line in enumerate(plain_lines)]
    for pattern in element.iter("GPN"):
        kind = PATTERN_TYPES.get(pattern.get("C") or "", "")
        line = next((one for one in pattern.findall("LSG") if one.get("A") == GUIDANCE_LINE_TYPE), None)
        if line is None or kind in ("pivot", "spiral"):
            features.append(None)
            continue
        name = (pattern.get("B") or "").strip() or (pattern.get("A") or "line")
        features.append(_read_line(line, name, parse_number(pattern.get("G")) if kind == "A+" else math.nan))
    lines = [one for one in features if one is not None]
    if len(lines) < len(features):
        unread = len(features) - len(lines)
        notes.append(
            f"Skipped in '{field}': {count_noun(unread, 'guidance pattern')} (pivots, spirals, or without points)."
        )
    return lines


def _read_line(line: Element, name: str, heading_deg: float = math.nan) -> Feature | None:
    """A line through its points; through only one, A of an A+ line, 100 m in its heading (attribute G of a pattern,
    degrees from north)."""
    points = [one for one in map(_parse_position, line.findall("PNT")) if one is not None]
    if len(points) == 1 and math.isfinite(heading_deg):
        points.append(extend_position(points[0], heading_deg, 100.0))
    return None if len(points) < 2 else build_feature("LineString", points, {"role": "guidance", "name": name})


FIELD_FORMAT = FieldFormat("ISOXML", (".xml",), _read_isoxml, lambda names: TASKDATA_FILE in names)


def _write_version_4(guidance: PlanGuidance) -> FileContents:
    root, partfield = _build_partfield(guidance, "4")
    if guidance.boundary is not None and guidance.headland_interior:
        headland = add_child(partfield, "PLN", A=HEADLAND_TYPE, B="Headland")
        _add_ring(headland, OUTER_RING, guidance.boundary.closed_rings[0])
        for area in guidance.headland_interior:
            _add_ring(headland, INNER_RING, area.closed_rings[0])
    if guidance.entrance is not None:
        _add_point(partfield, ENTRANCE_TYPE, *guidance.entrance, name="Entrance")
    patterns = count(1)
    for tractor in guidance.tractors:
        if tractor.lines:
            group = add_child(partfield, "GGP", A=f"GGP{tractor.number}", B=f"T{tractor.number}")
            for line in tractor.lines:
                _add_pattern(group, f"GPN{next(patterns)}", line)
    return {TASKDATA_PATH: serialise_xml(root)}


def _write_version_3(guidance: PlanGuidance) -> FileContents:
    root, partfield = _build_partfield(guidance, "3")
    for line in guidance.lines:
        _add_line(
            partfield,
            line,
            (OTHER_POINT_TYPE, OTHER_POINT_TYPE, OTHER_POINT_TYPE),
            B=build_designator(line.name, FALLBACK_NAME),
        )
    return {TASKDATA_PATH: serialise_xml(root)}


def _build_partfield(guidance: PlanGuidance, major: str) -> tuple[Element, Element]:
    """The root and its partfield with boundary and obstacles."""
    attributes = {
        "VersionMajor": major,
        "VersionMinor": "3",
        "ManagementSoftwareManufacturer": SOFTWARE_NAME,
        "ManagementSoftwareVersion": _find_software_version(),
        "DataTransferOrigin": "1",
    }
    root = Element("ISO11783_TaskData", attributes)
    partfield = add_child(
        root, "PFD", A="PFD1", C=build_designator(guidance.field, FALLBACK_NAME), D=f"{guidance.area_m2:.0f}"
    )
    if guidance.boundary is not None:
        _add_polygon(partfield, BOUNDARY_TYPE, guidance.boundary)
    for area in guidance.obstacles:
        _add_polygon(partfield, OBSTACLE_TYPE, area)
    return root, partfield


def _find_software_version() -> str:
    """The installed version of Headland."""
    try:
        return version("headland")
    except PackageNotFoundError:
        return "unknown"


def _add_polygon(partfield: Element, kind: str, area: GuidanceArea) -> None:
    polygon = add_child(partfield, "PLN", A=kind, B=build_designator(area.name, FALLBACK_NAME))
    for place, ring in enumerate(area.closed_rings):
        _add_ring(polygon, INNER_RING if place else OUTER_RING, ring)


def _add_ring(polygon: Element, kind: str, ring: DegreePoints) -> None:
    line = add_child(polygon, "LSG", A=kind)
    for longitude, latitude in ring.tolist():
        _add_point(line, OTHER_POINT_TYPE, longitude, latitude)


def _add_pattern(group: Element, key: str, line: GuidedLine) -> None:
    pattern = add_child(
        group,
        "GPN",
        A=key,
        B=build_designator(line.name, key),
        C=GPN_AB if line.is_straight else GPN_CURVE,
        E=GPN_BOTH_SIDES,
        F=GPN_BOTH_ENDS,
        G=f"{line.bearing_deg % 360.0:.6f}",
        I=GPN_DESKTOP,
    )
    _add_line(pattern, line, (A_TYPE, BETWEEN_TYPE, B_TYPE))


def _add_line(parent: Element, line: GuidedLine, kinds: tuple[str, str, str], **attributes: str) -> None:
    """A line with these kinds of its first point, intermediate points and last point."""
    element = add_child(parent, "LSG", A=GUIDANCE_LINE_TYPE, **attributes)
    last = len(line.points) - 1
    for place, (longitude, latitude) in enumerate(line.points.tolist()):
        _add_point(element, kinds[0] if place == 0 else kinds[2] if place == last else kinds[1], longitude, latitude)


def _add_point(parent: Element, kind: str, longitude: float, latitude: float, name: str | None = None) -> None:
    place = {"C": f"{latitude:.{DEGREE_DECIMALS}f}", "D": f"{longitude:.{DEGREE_DECIMALS}f}"}
    add_child(parent, "PNT", A=kind, **({} if name is None else {"B": name}), **place)


GUIDANCE_FORMAT_4 = GuidanceFormat("isoxml4", "ISOXML version 4", _write_version_4, older="isoxml3")
GUIDANCE_FORMAT_3 = GuidanceFormat(
    "isoxml3",
    "ISOXML version 3",
    _write_version_3,
    per_tractor=True,
    takes_curves=False,
    unsupported_parts=("headland", "entrance"),
)
