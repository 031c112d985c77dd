"""ISOXML (ISO 11783-10), versions 3 and 4: a TASKDATA folder or ZIP archive, external XFR files included.

A partfield (PFD) holds polygons (PLN) of line strings (LSG) of points (PNT, latitude C and longitude D), and guidance
patterns (GPN) in groups (GGP); version 3 has guidance lines as line strings of type 5 beside the polygons. The numbers
of types are those of the standard's lists PolygonType, LineStringType, PointType and GuidancePatternType.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

from shapely import Polygon

from fields.document import Document, Format
from fields.errors import FieldError
from fields.formats.archive import Members, file_beside, is_archive
from fields.formats.degrees import onwards, rings_area_m2
from fields.formats.features import Feature, document_of
from fields.formats.markup import root_of
from fields.formats.vector import WGS84
from fields.reading import read_bytes, some

TASKDATA = "taskdata.xml"
BOUNDARY, MAINFIELD, OBSTACLES = "1", "9", {"3": "water", "4": "building", "5": "road", "6": "area"}
HEADLAND = "10"
OUTER, INNER, GUIDANCE = "1", "2", "5"
ENTRANCE, OBSTACLE_POINT = "3", "5"
PATTERNS = {"1": "AB", "2": "A+", "3": "curve", "4": "pivot", "5": "spiral"}
SHOWN = 5
AREA_OFF = 1.2
"""A stated area and the area of the ring that differ by more than this factor are worth a remark."""


def _read(path: str, label: str) -> Document:
    place = Path(path)
    roots = list(_roots(Members(place), label) if place.is_dir() or is_archive(place) else _of_file(place, label))
    features: list[Feature] = []
    notes: list[str] = []
    empty: list[str] = []
    seen: Counter[str] = Counter()
    for element in (one for root in roots for one in root.iter("PFD")):
        seen[element.get("A") or ""] += 1
        one = _partfield(element, notes)
        features += one
        empty += [] if one else [_name(element)]
    twice = [name for name, count in seen.items() if name and count > 1]
    if twice:
        notes.append(
            f"{some(len(twice), 'id')} of partfields used twice or more (such as {twice[0]}); choose those by position."
        )
    if empty:
        more = f" and {len(empty) - SHOWN} more" if len(empty) > SHOWN else ""
        notes.append(f"Partfields without a boundary are left out: {', '.join(empty[:SHOWN])}{more}.")
    if not features:
        raise FieldError(f"{label} is ISOXML without a partfield that has points; export the fields with boundaries.")
    return document_of(features, label, crs=WGS84, source="ISOXML", notes=tuple(notes))


def _roots(members: Members, label: str) -> Iterator[Element]:
    """The root of every TASKDATA.XML and of every external file that they name and that is there."""
    mains = members.named(TASKDATA)
    if not mains:
        raise FieldError(f"{label} holds no TASKDATA.XML; name the folder or archive that has one.")
    for main in mains:
        yield from roots_of(members, main, label)


def roots_of(members: Members, main: str, label: str) -> Iterator[Element]:
    """The root of one TASKDATA.XML of a folder or archive, and of the external files it names; raises FieldError."""
    root = root_of(members[main], f"{PurePosixPath(main).name} of {label}")
    yield root
    yield from _outside(root, label, partial(members.beside, main))


def rings_of(element: Element) -> list[list[list[float]]]:
    """Longitude and latitude of the rings of a partfield's boundary, the outer one first; nothing without one."""
    for polygon in element.findall("PLN"):
        if polygon.get("A") in (BOUNDARY, MAINFIELD, None):
            parts = _boundary(polygon, {"name": _name(element)}, [])
            if parts:
                rings: list[list[list[float]]] = parts[0]["geometry"]["coordinates"]
                return rings
    return []


def _of_file(place: Path, label: str) -> Iterator[Element]:
    """The root of one file, and of the external files that it names in its folder."""
    root = root_of(read_bytes(place, "an ISOXML file", FieldError), label)
    if root.tag != "ISO11783_TaskData":
        raise FieldError(f"{label} is XML but not ISOXML (its root is '{root.tag[:40]}'); give a TASKDATA.XML.")
    yield root
    yield from _outside(root, label, partial(file_beside, place))


def _outside(root: Element, label: str, beside: Callable[[str], bytes | None]) -> Iterator[Element]:
    for reference in root.iter("XFR"):
        outside = f"{reference.get('A') or ''}.XML"
        content = beside(outside)
        if content is None and (reference.get("A") or "").upper().startswith("PFD"):
            raise FieldError(f"{label} names the external file {outside}, which is not there; copy the whole folder.")
        if content is not None:
            yield root_of(content, f"{outside} of {label}")


def _partfield(element: Element, notes: list[str]) -> list[Feature]:
    """Boundary, obstacles, entrance and lines of one partfield."""
    name = _name(element)
    facts = {"name": name, "id": (element.get("A") or "").strip()}
    features: list[Feature] = []
    for kind, polygon in ((each.get("A"), each) for each in element.findall("PLN")):
        if kind in (BOUNDARY, MAINFIELD, None):
            features += _boundary(polygon, facts, notes)
        elif kind in OBSTACLES:
            rings = _rings(polygon, (OUTER, INNER), name, notes)
            what = {"role": "obstacle", "kind": OBSTACLES[kind], "name": (polygon.get("B") or "").strip()}
            features += [_feature("Polygon", rings, what)] if rings else []
        elif kind == HEADLAND:
            edges = _rings(polygon, (INNER,), name, notes) or _rings(polygon, (OUTER,), name, notes)
            features += [_feature("LineString", [*edge, edge[0]], {"role": "headland"}) for edge in edges]
    boundaries = [one for one in features if one["properties"].get("role") == "boundary"]
    if not boundaries:
        return []
    _compare(element, boundaries, name, notes)
    return [
        *_once(boundaries),
        *(one for one in features if one not in boundaries),
        *_points(element),
        *_lines(element, name, notes),
    ]


def _name(element: Element) -> str:
    """What a partfield is called: its designator, else its id."""
    return (element.get("C") or "").strip() or (element.get("A") or "").strip()


def _boundary(polygon: Element, facts: dict[str, str], notes: list[str]) -> list[Feature]:
    """Boundaries of a polygon: of several outer rings each with the inner ones in it; exchanged rings are turned."""
    outer = _rings(polygon, (OUTER,), facts["name"], notes)
    inner = _rings(polygon, (INNER,), facts["name"], notes)
    around = next((ring for ring in inner if outer and _around(ring, [*outer, *inner])), None)
    if around is not None:
        notes.append(f"The outer and the inner ring of '{facts['name']}' are exchanged; they are read the other way.")
        outer, inner = [around], [ring for ring in (*outer, *inner) if ring is not around]
    if not outer and len(inner) == 1:
        notes.append(f"'{facts['name']}' has an inner ring only; it is read as the boundary.")
        outer, inner = inner, []
    shapes = [Polygon(ring) for ring in outer]
    parts = []
    placed = 0
    for ring, shape in zip(outer, shapes, strict=True):
        holes = [one for one in inner if len(outer) == 1 or (shape.is_valid and shape.contains(Polygon(one)))]
        placed += len(holes)
        parts.append(_feature("Polygon", [ring, *holes], {**facts, "role": "boundary"}))
    if placed < len(inner):
        notes.append(
            f"Left out of '{facts['name']}': {some(len(inner) - placed, 'inner ring')} in none of its outer rings."
        )
    return parts


def _around(ring: list[list[float]], rings: list[list[list[float]]]) -> bool:
    """Whether a ring has all others inside."""
    shape = Polygon(ring)
    return shape.is_valid and all(one is ring or (one != ring and shape.covers(Polygon(one))) for one in rings)


def _once(boundaries: list[Feature]) -> list[Feature]:
    """Boundaries without repetition: terminals write the same ring again into a guidance group."""
    kept: list[Feature] = []
    for one in boundaries:
        if all(one["geometry"] != other["geometry"] for other in kept):
            kept.append(one)
    return kept


def _compare(element: Element, boundaries: list[Feature], name: str, notes: list[str]) -> None:
    """A remark where the area that the file states for a partfield is not that of its boundary."""
    try:
        stated_m2 = float(element.get("D") or 0.0)
        area_m2 = sum(rings_area_m2(each["geometry"]["coordinates"]) for each in boundaries)
        turned_m2 = sum(rings_area_m2(each["geometry"]["coordinates"], swap=True) for each in boundaries)
    except ValueError:
        return
    if stated_m2 <= 0.0 or area_m2 <= 0.0 or 1.0 / AREA_OFF < stated_m2 / area_m2 < AREA_OFF:
        return
    swapped = turned_m2 > 0.0 and abs(stated_m2 / turned_m2 - 1.0) < 0.05
    why = "; with latitude and longitude exchanged it would be right, so try swap" if swapped else ""
    notes.append(f"'{name}' is {stated_m2 / 1e4:.2f} ha by its file and {area_m2 / 1e4:.2f} ha by its boundary{why}.")


def _rings(polygon: Element, kinds: tuple[str, ...], name: str, notes: list[str]) -> list[list[list[float]]]:
    """Rings of a polygon of these kinds; those with fewer than three points are left out and counted."""
    found = []
    short = 0
    for line in polygon.findall("LSG"):
        if line.get("A") not in kinds:
            continue
        points = _positions(line, notes, name)
        distinct = {tuple(point) for point in points}
        if len(distinct) < 3:
            short += 1
        else:
            found.append(points)
    if short:
        notes.append(f"Left out of '{name}': {some(short, 'ring')} with fewer than 3 points.")
    return found


def _positions(line: Element, notes: list[str], name: str) -> list[list[float]]:
    """Longitude and latitude of the points of a line; those that are no numbers are left out and counted."""
    points = [_position(each) for each in line.findall("PNT")]
    bad = sum(one is None for one in points)
    if bad:
        notes.append(f"Left out of '{name}': {some(bad, 'point')} without numbers for a position.")
    return [one for one in points if one is not None]


def _position(point: Element) -> list[float] | None:
    try:
        place = [float(point.get("D") or ""), float(point.get("C") or "")]
    except ValueError:
        return None
    return place if all(map(math.isfinite, place)) else None


def _points(element: Element) -> list[Feature]:
    """The entrance and obstacles that are points."""
    features = []
    for point in element.findall("PNT"):
        place = _position(point)
        if place is not None and point.get("A") == ENTRANCE:
            features.append(_feature("Point", place, {"role": "entrance"}))
        elif place is not None and point.get("A") == OBSTACLE_POINT:
            features.append(
                _feature("Point", place, {"role": "obstacle", "kind": "pole", "name": point.get("B") or ""})
            )
    return features


def _lines(element: Element, field: str, notes: list[str]) -> list[Feature]:
    """Guidance lines: AB, A+ with its heading, and curves; others are counted and left out."""
    plain = [one for one in element.findall("LSG") if one.get("A") == GUIDANCE]
    features = [_line(line, line.get("B") or f"line {place + 1}") for place, line in enumerate(plain)]
    for pattern in element.iter("GPN"):
        kind = PATTERNS.get(pattern.get("C") or "", "")
        line = next((one for one in pattern.findall("LSG") if one.get("A") == GUIDANCE), None)
        if line is None or kind in ("pivot", "spiral"):
            features.append(None)
            continue
        name = (pattern.get("B") or "").strip() or (pattern.get("A") or "line")
        feature = _line(line, name)
        if kind == "A+" and feature is None:
            feature = _from_heading(line, pattern, name)
        features.append(feature)
    found = [one for one in features if one is not None]
    if len(found) < len(features):
        left = len(features) - len(found)
        notes.append(f"Left out of '{field}': {some(left, 'guidance pattern')} (pivots, spirals, or without points).")
    return found


def _line(line: Element, name: str) -> Feature | None:
    points = [one for one in (_position(each) for each in line.findall("PNT")) if one is not None]
    if len(points) < 2:
        return None
    return _feature("LineString", points, {"role": "guidance", "name": name})


def _from_heading(line: Element, pattern: Element, name: str) -> Feature | None:
    """An A+ line: its point A, and a second one 100 m on by its heading (attribute G, degrees from north)."""
    try:
        heading_deg = float(pattern.get("G") or "")
    except ValueError:
        return None
    start = next((one for one in (_position(each) for each in line.findall("PNT")) if one is not None), None)
    if start is None:
        return None
    return _feature("LineString", [start, onwards(start, heading_deg, 100.0)], {"role": "guidance", "name": name})


def _feature(kind: str, coordinates: object, properties: dict[str, str]) -> Feature:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def _holds(names: frozenset[str]) -> bool:
    return TASKDATA in names


FORMAT = Format("ISOXML", (".xml",), _read, _holds)
