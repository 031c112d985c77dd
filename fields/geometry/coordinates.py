"""From raw coordinates of a file to checked rings and polygons in local metres, with what the user says of them.

The user may name the system and have axes swapped. A field in the sea is refused; any other whose axes seem to be
swapped is compared with other features of its file, as two countries at mirrored positions cannot be told apart.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from fields.arrays import Floats
from fields.errors import FieldError, attach_parameter, join_first, mark_parameter, shorten_middle, shorten_value
from fields.geometry.geodesy import DEGREES_CRS, can_be_farmland, find_utm_crs, is_wgs84_longitude_latitude, project
from fields.raw_document import LOCAL_METRES, UNKNOWN_CRS, WGS84, FieldDocument, RawShape

MAX_FIELD_SPAN_DEG = 1.0
NULL_ISLAND_DEG = 4.0
"""About latitude and longitude 0 is water: the nearest coast, of Ghana, is 4.7 degrees north."""
MAX_LOCAL_M = 100_000.0
"""Local metres beyond this get an origin of their own, to keep digits for the simulation."""
MAX_NEAR_DEG, MIN_FAR_DEG = MAX_FIELD_SPAN_DEG, 2.0 * MAX_FIELD_SPAN_DEG
"""Features of one farm are at most the first apart; a misplaced one is farther than the second from all others."""
MAX_COMPARED_FIELDS = 2_000
SHAPE_MEMBERS = (
    "polygons", "zones", "obstacles", "unassigned", "boundary_edges", "guidance_lines", "headland_edges", "entrances",
    "service_points",
)  # fmt: skip
MIN_FIELD_AREA_M2, MAX_FIELD_AREA_M2 = 100.0, 1.0e8
MAX_COORDINATE = 1.0e8  # more than twice the circumference of the earth in metres


@dataclass(frozen=True)
class FieldFrame:
    """How the numbers of one file become local metres.

    Attributes:
        source_crs: coordinate system of the file; None for local metres.
        crs: UTM system of the field; None for local metres.
        origin_m: easting and northing subtracted after the projection.
        crosses_180: longitudes below zero are increased by 360 degrees.
    """

    source_crs: str | None
    crs: str | None
    origin_m: tuple[float, float]
    crosses_180: bool = False

    def to_local(self, points: Floats) -> Floats:
        """Points of the file, shape (n, 2), in local metres."""
        if self.source_crs is not None and self.crs is not None:
            points = project(self.unwrap_longitudes(points), self.source_crs, self.crs)
        return np.asarray(points - np.asarray(self.origin_m))

    def read_points(self, raw: RawShape, description: str) -> Floats:
        """The positions (n, 2) of a Point or LineString in local metres; raises FieldError as parse_position."""
        entries = [raw.coordinates] if raw.geometry_type == "Point" else raw.coordinates
        positions = [parse_position(one, description) for one in (entries if isinstance(entries, list) else ())]
        return self.to_local(np.array(positions, dtype=np.float64).reshape(-1, 2))

    def unwrap_longitudes(self, points: Floats) -> Floats:
        """Longitudes without a jump at 180 degrees."""
        if not self.crosses_180:
            return points
        x, y = points.T
        return np.column_stack([np.where(x < 0.0, x + 360.0, x), y])


def build_field_frame(document: FieldDocument, rings: list[Floats], local: bool, label: str) -> FieldFrame:
    """The frame for a field with these rings (file coordinates, outer ring first).

    Raises FieldError where degrees were declared as metres or vice versa, declared and named system contradict each
    other, or the header is damaged.
    """
    if local and document.crs is not None:
        raise FieldError(
            f"{label} is in the system {document.crs}, not in local metres; leave out {mark_parameter('local')}."
        )
    if local and document.frame == WGS84:
        raise FieldError(f"{label} is in longitude and latitude by its header; leave out {mark_parameter('local')}.")
    if document.crs is None and (local or document.frame == LOCAL_METRES):
        return _build_local_frame(document, rings[0], label)
    source_crs = document.crs or DEGREES_CRS
    if document.crs is not None and not is_wgs84_longitude_latitude(source_crs):
        degrees = [project(ring, source_crs, DEGREES_CRS) for ring in rings]
        _check_place(document, source_crs, rings[0], degrees[0][0], label)
        return _build_earth_frame(document, source_crs, rings, degrees, label)
    _check_degrees(rings[0], label, has_crs=document.crs is not None)
    _check_place(document, DEGREES_CRS, rings[0], rings[0][0], label)
    return _build_earth_frame(document, DEGREES_CRS, rings, rings, label)


def looks_like_degrees(ring: Floats) -> bool:
    """Whether the numbers of a ring are longitudes and latitudes of a field: in metres it would be tiny."""
    return bool(np.ptp(ring, axis=0).max() < MAX_FIELD_SPAN_DEG and (np.abs(ring) <= (180.0, 90.0)).all())


def _build_local_frame(document: FieldDocument, outer: Floats, label: str) -> FieldFrame:
    if looks_like_degrees(outer):
        x, y = outer[0]
        raise FieldError(
            f"Coordinates of {label} such as ({x:g}, {y:g}) look like degrees; leave out {mark_parameter('local')}."
        )
    origin = _parse_stored_origin(document, label)
    if origin is None:
        max_coordinate = np.abs(outer).max() > MAX_LOCAL_M
        origin = _round_centroid_m(outer) if max_coordinate else (0.0, 0.0)
    return FieldFrame(None, None, origin)


def _build_earth_frame(
    document: FieldDocument, source_crs: str, rings: list[Floats], degrees: list[Floats], label: str
) -> FieldFrame:
    """Frame of a georeferenced field: UTM zone and origin from its centroid."""
    crosses_180 = bool(np.ptp(degrees[0][:, 0]) > 180.0)
    unwrapping = FieldFrame(None, None, (0.0, 0.0), crosses_180)
    centre = shapely.Polygon(unwrapping.unwrap_longitudes(degrees[0])).centroid
    stored = document.header.get("crs")
    crs = _parse_stored_crs(stored, label) if stored is not None else find_utm_crs(centre.x, centre.y)
    unshifted = FieldFrame(source_crs, crs, (0.0, 0.0), crosses_180 and degrees is rings)
    origin = _parse_stored_origin(document, label) or _round_centroid_m(unshifted.to_local(rings[0]))
    return FieldFrame(source_crs, crs, origin, unshifted.crosses_180)


def _check_degrees(outer: Floats, label: str, *, has_crs: bool) -> None:
    """Refuse metres, and latitude before longitude, in a file that should hold degrees."""
    x, y = outer[np.argmax(np.abs(outer).max(axis=1))]
    span = np.ptp(outer, axis=0)
    if np.abs(outer[:, 0]).max() > 180.0 or np.abs(outer[:, 1]).max() > 90.0:
        is_swapped = (np.abs(outer) <= (90.0, 180.0)).all() and span.max() < MAX_FIELD_SPAN_DEG
        swap_fix = f"look like latitude before longitude; swap them with {mark_parameter('swap_axes')}"
        metres_fix = f"look like metres; add {mark_parameter('local')}"
        if has_crs:
            metres_fix = f"look like metres; give {mark_parameter('local')} in place of {mark_parameter('crs')}"
        fix = swap_fix if is_swapped else metres_fix
        raise FieldError(f"Coordinates of {label} such as ({x:g}, {y:g}) {fix}.")
    width_deg = min(span[0], 360.0 - span[0]) if span[0] > 180.0 else span[0]
    if max(width_deg, span[1]) > MAX_FIELD_SPAN_DEG:
        raise FieldError(
            f"The boundary of {label} spans {width_deg:g} by {span[1]:g} degrees; a field spans at most "
            f"{MAX_FIELD_SPAN_DEG:g}, so if these are metres, add {mark_parameter('local')}."
        )


def _check_place(document: FieldDocument, crs: str, outer: Floats, place_deg: Floats, label: str) -> None:
    """Refuse a field in the sea that would be farmland with x and y swapped, or that is at latitude and longitude 0."""
    longitude, latitude = place_deg.tolist()
    is_certain = "crs" in document.header and not document.axes_swapped  # Headland wrote the file
    if is_certain or can_be_farmland(longitude, latitude):
        return
    try:
        swapped = project(outer[:1, ::-1], crs, DEGREES_CRS)[0].tolist()
    except FieldError:  # no place on the earth
        swapped = [math.nan, math.nan]
    option = mark_parameter("swap_axes")
    if can_be_farmland(*swapped):
        raise FieldError(
            f"{label} lies at latitude {latitude:.2f}, longitude {longitude:.2f}, in the sea; with the two "
            f"swapped it lies on land: leave out {option}."
            if document.axes_swapped
            else f"{label} lies at latitude {latitude:.2f}, longitude {longitude:.2f}, in the sea; with the two "
            f"swapped it lies on land: add {option}."
        )
    if max(abs(longitude), abs(latitude)) <= NULL_ISLAND_DEG:
        raise FieldError(
            f"{label} lies at latitude {latitude:.2f}, longitude {longitude:.2f}, in the sea off Africa, with or "
            f"without {option}; its coordinates seem to be lost, so export it again."
        )


def _parse_stored_crs(stored: Any, label: str) -> str:
    """The UTM code stored in a written file, so that reading it again gives the same metres."""
    code = stored.removeprefix("EPSG:") if isinstance(stored, str) else ""
    if not (code.isdecimal() and (32601 <= int(code) <= 32660 or 32701 <= int(code) <= 32760)):
        raise FieldError(f"The system {stored!r} stored in {label} is not UTM; use one such as 'EPSG:32654'.")
    return f"EPSG:{code}"


def _parse_stored_origin(document: FieldDocument, label: str) -> tuple[float, float] | None:
    stored = document.header.get("origin_m")
    if stored is None:
        return None
    numbers = stored if isinstance(stored, list) else []
    is_number = [isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < MAX_COORDINATE for n in numbers]
    if len(numbers) != 2 or not all(is_number):
        raise FieldError(f"The origin_m {stored!r} stored in {label} is not usable; write [easting, northing].")
    return float(numbers[0]), float(numbers[1])


def _round_centroid_m(outer: Floats) -> tuple[float, float]:
    """The centroid of a ring in whole metres."""
    centre = shapely.Polygon(outer).centroid
    return float(round(centre.x)), float(round(centre.y))


def parse_ring(raw: Any, label: str) -> Floats:
    """An open ring of shape (n, 2) from a list of positions; height and repeated points are dropped.

    Raises FieldError where a position is not two finite numbers, or fewer than 3 distinct points remain.
    """
    if not isinstance(raw, list | tuple):
        raise FieldError(f"A ring of {label} is {shorten_value(raw)}; it must be a list of [x, y] positions.")
    points = np.array([parse_position(entry, label) for entry in raw], dtype=np.float64).reshape(-1, 2)
    points = points[np.append(np.ones(len(points[:1]), bool), (points[1:] != points[:-1]).any(axis=1))]
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    distinct = len(np.unique(points, axis=0)) if len(points) else 0
    if distinct < 3:
        raise FieldError(f"A ring of {label} has {distinct} distinct points; a ring needs at least 3.")
    return np.asarray(points)


def parse_position(raw: Any, label: str) -> tuple[float, float]:
    """The first two numbers of a GeoJSON position.

    Raises FieldError where it is not a list of two or more finite numbers.
    """
    if not isinstance(raw, list | tuple) or len(raw) < 2:
        raise FieldError(f"Position {shorten_value(raw)} of {label} is not a pair; write it as [x, y].")
    return _parse_number(raw[0], label), _parse_number(raw[1], label)


def parse_rings(raw: Any, label: str) -> list[Floats]:
    """Outer ring first, then the holes, of the ``coordinates`` of a Polygon.

    Raises FieldError where there is no ring, or a ring is not usable.
    """
    if not isinstance(raw, list | tuple) or not raw:
        raise FieldError(f"The coordinates of {label} are {shorten_value(raw)}; a Polygon needs at least one ring.")
    return [parse_ring(entry, label) for entry in raw]


def build_polygon(parts: list[Floats], label: str) -> shapely.Polygon:
    """Counter-clockwise polygon of an outer ring and its holes.

    Raises FieldError where rings cross themselves or each other; the message says where, in file coordinates.
    """
    shape = shapely.Polygon(parts[0], parts[1:])
    if not shape.is_valid:
        fault, place = _explain_invalidity(shapely.is_valid_reason(shape))
        raise FieldError(f"The boundary of {label} is not clean: {fault} at {place}; redraw it there.")
    return orient(shape, 1.0)


def check_area(shape: shapely.Polygon, label: str) -> None:
    """Refuse an outline in metres that cannot be a field.

    Raises FieldError where the area is under 100 square metres or over 100 square kilometres.
    """
    if shape.area < MIN_FIELD_AREA_M2:
        raise FieldError(f"The area of {label} is {shape.area:.3g} m2; a field needs at least 100 m2.")
    if shape.area > MAX_FIELD_AREA_M2:
        raise FieldError(f"The area of {label} is {shape.area / 1e6:.4g} km2; a field may have at most 100 km2.")


def _parse_number(raw: Any, label: str) -> float:
    """One finite coordinate."""
    if raw is None:
        raise FieldError(f"A coordinate of {label} is missing; write a measured value.")
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise FieldError(f"Coordinate {shorten_value(raw)} of {label} is not a number; write plain numbers.")
    try:
        value = float(raw)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise FieldError(f"Coordinate {shorten_value(raw)} of {label} is not finite; write a measured value.")
    if abs(value) > MAX_COORDINATE:
        raise FieldError(
            f"Coordinate {shorten_value(raw)} of {label} is beyond {MAX_COORDINATE:g}; write degrees or metres."
        )
    return value


def _explain_invalidity(reason: str) -> tuple[str, str]:
    """Explanation and place from a GEOS reason such as ``Self-intersection[3 4]``."""
    match = re.fullmatch(r"(.*)\[(\S+) (\S+)\]", reason)
    if match is None:
        return reason.lower(), "an unknown place"
    explanations = {
        "Self-intersection": "it crosses itself",
        "Ring Self-intersection": "it touches itself",
        "Hole lies outside shell": "a hole lies outside",
        "Holes are nested": "one hole lies in another",
        "Interior is disconnected": "its holes cut it in two",
    }
    explanation = explanations.get(match[1], match[1].lower())
    return explanation, f"({float(match[2]):.9g}, {float(match[3]):.9g})"


def describe_swapped_axes(document: FieldDocument, axes_swapped: bool) -> tuple[str, ...]:
    """Sentences on fields whose axes seem to be swapped; `axes_swapped` says whether the user has swapped them."""
    is_degrees = document.crs is None or document.crs == WGS84 or is_wgs84_longitude_latitude(document.crs)
    if not is_degrees or document.frame == LOCAL_METRES or len(document.polygons) > MAX_COMPARED_FIELDS:
        return ()
    drawn_lines = (*document.guidance_lines, *document.headland_edges)
    fields = np.array([_find_first_point(one.coordinates) for one in document.polygons])
    lines = np.array([_find_first_point(one.coordinates) for one in drawn_lines]).reshape(-1, 2)
    suspects = [place for place in range(len(fields)) if _is_far_from_others(place, fields, lines)]
    if not suspects:
        return ()
    x, y = fields[suspects[0]]
    named = join_first([f"'{document.polygons[place].key}'" for place in suspects])
    fix = "leave out the option swap axes" if axes_swapped else "try the option swap axes"
    return (
        f"{named}: latitude {y:.2f}, longitude {x:.2f} is far from everything else in the file; "
        f"longitude and latitude seem to be swapped, so {fix}.",
    )


def _is_far_from_others(place: int, fields: Floats, lines: Floats) -> bool:
    """Whether a field is far from all others, but near some with its axes swapped; up to two fields are compared with
    the lines of the file, as of two distant fields either may be the wrong one.
    """
    others = np.delete(fields, place, axis=0) if len(fields) > 2 else lines
    others = others[np.isfinite(others).all(axis=1)]
    if not len(others) or not np.isfinite(fields[place]).all():
        return False
    distance_deg = np.abs(others - fields[place]).max(axis=1)
    swapped_distance_deg = np.abs(others - fields[place][::-1]).max(axis=1)
    return bool(distance_deg.min() > MIN_FAR_DEG and swapped_distance_deg.min() < MAX_NEAR_DEG)


def _find_first_point(raw: Any) -> tuple[float, float]:
    """The first position in nested lists of coordinates; NaN if it is not a position."""
    while isinstance(raw, list) and raw and isinstance(raw[0], list):
        raw = raw[0]
    try:
        return parse_position(raw, "")
    except FieldError:
        return math.nan, math.nan


def apply_coordinate_options(
    document: FieldDocument, local: bool, crs: str | None, swap_axes: bool, label: str
) -> FieldDocument:
    """The document with the coordinate system that the user named, and x and y swapped if requested.

    A note is added if the resulting axes still seem to be swapped. With `local` the numbers are metres, and no system
    is needed.

    Raises FieldError where neither the file nor the user names a system, or the named one is unknown or contradicts the
    file.
    """
    if crs is not None:
        _check_crs(document, crs, label)
        document = replace(document, crs=crs)
    elif document.crs == UNKNOWN_CRS and local:
        document = replace(document, crs=None)
    elif document.crs == UNKNOWN_CRS and document.is_shape:
        raise FieldError(
            f"{label} has no coordinate system; add {mark_parameter('crs')}='EPSG:4326' if its numbers are longitude "
            f"and latitude, another code if they are of a map grid, or {mark_parameter('local')}=True if they are "
            "metres without a place on the earth.",
            parameter="crs",
        )
    elif document.crs == UNKNOWN_CRS:
        raise FieldError(
            f"{label} does not name its coordinate system (a Shapefile has it in a .prj file); add it, or name it with "
            f"{mark_parameter('crs')}, such as EPSG:25832 or EPSG:4326.",
            parameter="crs",
        )
    corrected = _swap_document_axes(document) if swap_axes else document
    return replace(corrected, notes=(*corrected.notes, *describe_swapped_axes(corrected, swap_axes)))


def _check_crs(document: FieldDocument, crs: str, label: str) -> None:
    """Refuse a system that is unknown, contradicts the file or does not fit its numbers."""
    if not crs.strip():
        raise FieldError(
            f"{mark_parameter('crs')} is empty; name a system such as EPSG:25832, or leave it out.", parameter="crs"
        )
    with attach_parameter("crs"):
        is_degrees = is_wgs84_longitude_latitude(crs)
    frame_names = {None: document.crs, LOCAL_METRES: "local metres", WGS84: "longitude and latitude"}
    stated_system = frame_names[document.frame]
    if stated_system not in (UNKNOWN_CRS, None, crs):
        shown = shorten_middle(str(stated_system), 40, 0)
        raise FieldError(
            f"{label} is in {shown} by its own header; leave out {mark_parameter('crs')} {crs}.", parameter="crs"
        )
    x, y = _find_first_point(document.polygons[0].coordinates)
    if not is_degrees and abs(x) <= 180.0 and abs(y) <= 180.0:
        raise FieldError(
            f"Coordinates of {label} such as ({x:g}, {y:g}) look like degrees; "
            f"leave out {mark_parameter('crs')} {crs}.",
            parameter="crs",
        )


def _swap_document_axes(document: FieldDocument) -> FieldDocument:
    swapped: dict[str, Any] = {
        name: tuple(replace(one, coordinates=_swap_positions(one.coordinates)) for one in getattr(document, name))
        for name in SHAPE_MEMBERS
    }
    return replace(document, axes_swapped=True, **swapped)


def _swap_positions(raw: Any) -> Any:
    """Nested lists of coordinates with the first two numbers of every position swapped."""
    if not isinstance(raw, list):
        return raw
    if len(raw) >= 2 and not isinstance(raw[0], list):
        return [raw[1], raw[0], *raw[2:]]
    return [_swap_positions(each) for each in raw]
