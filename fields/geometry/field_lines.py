"""Lines of a field: fenced sides of its outline, how far machines may reach over the others, guidance lines, and inner
edges of headlands from its file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import shapely

from fields.errors import FieldError, join_first, mark_parameter, shorten_value, suggest_name
from fields.geometry.arithmetic import GRID_M, MACHINE_WIDTH_M, NEAR_FIELD_M
from fields.geometry.coordinates import FieldFrame
from fields.geometry.overlays import intersect, subtract, unite
from fields.raw_document import RawShape

FENCE, OPEN_EDGE = "fence", "open"
EDGE_KINDS = (FENCE, OPEN_EDGE)
OVERHANG = "overhang_m"  # property of a boundary or of an open edge in a field file
MAX_OVERHANG_M = 100.0
FENCE_WIDTH_M = 0.01
MIN_HEADLAND_WIDTH_M = 0.5
"""A line nearer to the boundary is the outer edge of the headland, thus the boundary itself."""


@dataclass(frozen=True)
class EdgeOverhang:
    """A part of the outline (lines in metres) over which machines may reach farther, or less far, than elsewhere."""

    part: shapely.Geometry
    overhang_m: float


def read_edges(
    chosen: RawShape,
    lines: Iterable[RawShape],
    frame: FieldFrame,
    shape: shapely.Polygon,
    multiple_fields: bool,
    label: str,
) -> tuple[tuple[shapely.LineString, ...], tuple[EdgeOverhang, ...], tuple[str, ...]]:
    """The fenced parts of the outline, the overhangs that the file allows, and remarks on lines partly off it.

    The ``edge`` and overhang of the field apply all round; those of lines, in the order of the file, along them.

    Raises FieldError where an ``edge`` is unknown, a line is nowhere along the outline, or an overhang is no length or
    belongs to a fence.
    """
    outline, own = shapely.LineString(shape.exterior.coords), f"the boundary of {label}"
    own_edge, own_overhang = chosen.properties.get("edge"), chosen.properties.get(OVERHANG)
    is_fenced = own_edge is not None and parse_edge(own_edge, own) == FENCE
    fenced: shapely.Geometry = outline if is_fenced else shapely.LineString()
    overhangs = [] if own_overhang is None else [EdgeOverhang(outline, _parse_overhang_m(own_overhang, own))]
    remarks = []
    for raw in lines:
        name = f"'{raw.keys[0]}' " if raw.keys else ""
        edge = parse_edge(raw.properties.get("edge"), f"a line {name}of {label}")
        description = f"line {name}with edge '{edge}' of {label}"
        line = parse_edge_line(raw, frame, description)
        away_m = float(shapely.distance(outline, line))
        if multiple_fields and away_m > NEAR_FIELD_M:
            continue
        side = clip_outline_to_line(outline, line)
        if side.length < min(1.0, 0.5 * line.length):
            raise FieldError(
                f"The {description} does not follow the boundary, which is {away_m:.1f} m away; draw it within "
                f"{MACHINE_WIDTH_M:g} m of the boundary or make it an obstacle."
            )
        if side.length < 0.8 * line.length:
            remarks.append(
                f"Only {side.length:.0f} of {line.length:.0f} m of a {description} follow the boundary; the rest is "
                "not used."
            )
        fenced = unite([fenced, side]) if edge == FENCE else subtract(fenced, _buffer_line(line))
        overhang = raw.properties.get(OVERHANG)
        if overhang is not None:
            overhangs.append(EdgeOverhang(side, _parse_overhang_m(overhang, f"a line of {label}", edge)))
    return _merge_lines(fenced), tuple(overhangs), tuple(remarks)


def clip_outline_to_line(outline: shapely.LineString, line: shapely.LineString) -> shapely.Geometry:
    """The part of an outline within MACHINE_WIDTH_M of a line."""
    return intersect(outline, _buffer_line(line))


def _buffer_line(line: shapely.LineString) -> shapely.Geometry:
    return line.buffer(MACHINE_WIDTH_M, cap_style="flat", join_style="mitre")


def parse_edge(edge: object, description: str) -> str:
    """The kind of an edge, `fence` or `open`; raises FieldError for any other."""
    if isinstance(edge, str) and edge.strip().lower() in EDGE_KINDS:
        return edge.strip().lower()
    raise FieldError(f"The 'edge' of {description} is {shorten_value(edge)}; use '{FENCE}' or '{OPEN_EDGE}'.")


def parse_edge_line(raw: RawShape, frame: FieldFrame, description: str) -> shapely.LineString:
    """The line in local metres; raises FieldError for one of fewer than 2 distinct positions."""
    points = frame.read_points(raw, description)
    line = shapely.LineString(points) if len(points) > 1 else shapely.LineString()
    if line.length == 0.0:
        raise FieldError(f"The {description} has fewer than 2 distinct positions; a LineString needs 2 or more.")
    return line


def _read_usable_lines(shapes: Sequence[RawShape], frame: FieldFrame) -> list[tuple[int, shapely.LineString]]:
    """Lines in local metres with their places in the file, without those that cannot be used."""
    lines = []
    for place, raw in enumerate(shapes):
        with suppress(FieldError):
            lines.append((place, parse_edge_line(raw, frame, "line")))
    return lines


def _merge_lines(fenced: shapely.Geometry) -> tuple[shapely.LineString, ...]:
    """The lines of a geometry, joined where they meet, in an order independent of GEOS."""
    merged = fenced if fenced.geom_type == "LineString" else shapely.line_merge(fenced)
    parts = [part for part in shapely.get_parts(merged) if part.geom_type == "LineString" and part.length > GRID_M]
    return tuple(sorted(parts, key=lambda part: [tuple(np.round(xy, 3)) for xy in part.coords]))


def check_fence_opening(
    outline: shapely.Polygon, fences: tuple[shapely.LineString, ...], entrance: tuple[float, float] | None, name: str
) -> None:
    """Refuse a fence all round without an entrance.

    Raises FieldError where the fence has neither an opening of MACHINE_WIDTH_M nor an entrance.
    """
    if not fences or entrance is not None:
        return
    open_outline = subtract(outline.exterior, shapely.buffer(unite(fences), FENCE_WIDTH_M))
    merged = open_outline if open_outline.geom_type == "LineString" else shapely.line_merge(open_outline)
    # An opening across the start of the ring is in two parts until they are merged.
    if max((part.length for part in shapely.get_parts(merged)), default=0.0) < MACHINE_WIDTH_M:
        raise FieldError(
            f"The fence round field '{name}' has no opening; add a Point with role 'entrance' as its gate, or a "
            f"LineString with edge '{OPEN_EDGE}' of {MACHINE_WIDTH_M:g} m or more along it."
        )


@dataclass(frozen=True)
class GuidanceLine:
    """A named line that swaths can be laid along, in metres in the frame of the field."""

    name: str
    line: shapely.LineString

    @property
    def bearing_deg(self) -> float:
        """Direction from first to last point, clockwise from north, 0 to 360 degrees.

        For a line that returns to its start, the direction of its longest straight piece.
        """
        points = shapely.get_coordinates(self.line)
        direction = points[-1] - points[0]
        if float(np.hypot(*direction)) < 0.1 * self.line.length:
            steps = np.diff(points, axis=0)
            direction = steps[int(np.argmax(np.hypot(*steps.T)))]
        return math.degrees(math.atan2(direction[0], direction[1])) % 360.0


def read_guidance_lines(
    shapes: Sequence[RawShape], frame: FieldFrame, shape: shapely.Polygon, multiple_fields: bool
) -> tuple[GuidanceLine, ...]:
    """Usable lines in the order of the file; in a file of several fields only those of this field."""
    lines = []
    for place, line in _read_usable_lines(shapes, frame):
        keys = shapes[place].keys
        if not multiple_fields or shape.distance(line) <= NEAR_FIELD_M:
            lines.append(GuidanceLine(keys[0] if keys else f"line {place + 1}", line))
    return tuple(lines)


def find_line_bearing_deg(lines: Sequence[GuidanceLine], name: str, label: str) -> float:
    """Bearing in degrees of the line with this name; case is ignored.

    Raises FieldError where there is no such line, or several of this name have different bearings.
    """
    matches = [one for one in lines if one.name.lower() == name.strip().lower()]
    if not matches:
        known_names = join_first([f"'{one.name}'" for one in lines]) or "none"
        raise FieldError(
            f"{label} has no line '{name}' for {mark_parameter('guidance_line')}"
            f"{suggest_name(name, [line.name for line in lines])}; it has {known_names}.",
            parameter="guidance_line",
        )
    bearings = [one.bearing_deg for one in matches]
    max_difference_deg = max(abs(math.remainder(one - bearings[0], 180.0)) for one in bearings)
    if max_difference_deg > 0.01:
        raise FieldError(
            f"{len(matches)} lines of {label} are called '{name}' and have different bearings; give "
            f"{mark_parameter('bearing_deg')} instead of a name.",
            parameter="guidance_line",
        )
    return bearings[0]


@dataclass(frozen=True)
class HeadlandEdge:
    """The inner edge of a headland, in metres in the frame of the field, and its distance from the boundary or a hole:
    smallest, median and largest width.
    """

    line: shapely.LineString
    min_width_m: float
    median_width_m: float
    max_width_m: float


def read_headland_edges(
    shapes: Sequence[RawShape], frame: FieldFrame, shape: shapely.Polygon
) -> tuple[HeadlandEdge, ...]:
    """Usable headland edges on this field, in the order of the file."""
    edges = []
    for _, line in _read_usable_lines(shapes, frame):
        if len(line.coords) < 3 or not (shape.contains(line.centroid) or shape.intersects(line)):
            continue
        places = shapely.points(shapely.get_coordinates(shapely.segmentize(line, 5.0)))
        width_m = shapely.distance(places, shape.boundary)
        if np.median(width_m) >= MIN_HEADLAND_WIDTH_M:
            edges.append(HeadlandEdge(line, float(width_m.min()), float(np.median(width_m)), float(width_m.max())))
    return tuple(edges)


def _parse_overhang_m(value: object, description: str, edge: str = OPEN_EDGE) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= MAX_OVERHANG_M:
        raise FieldError(
            f"The '{OVERHANG}' of {description} is {shorten_value(value)}; it must be 0 to {MAX_OVERHANG_M:g} m."
        )
    if edge != OPEN_EDGE:
        raise FieldError(
            f"The '{OVERHANG}' of {description} belongs to a fence, over which nothing may reach; use it with "
            f"'edge': '{OPEN_EDGE}'."
        )
    return float(value)


def compute_overhang_region(
    outline: shapely.Polygon, fences: Sequence[shapely.LineString], overhangs: Sequence[EdgeOverhang], overhang_m: float
) -> shapely.Geometry:
    """The ground over which parts of machines may reach: the field, and beyond its open edges what is allowed there.

    `overhang_m` holds where `overhangs` say nothing else; nothing may reach over fences. Ground behind an edge is
    limited by that edge, however much its neighbours allow.
    """
    ground = shapely.Polygon(outline.exterior)
    parts: list[tuple[shapely.Geometry, float]] = [(shapely.LineString(outline.exterior.coords), overhang_m)]
    for one in overhangs:
        here = one.part.buffer(FENCE_WIDTH_M)
        parts = [(subtract(part, here), metres) for part, metres in parts] + [(one.part, one.overhang_m)]
    fenced = unite(list(fences))
    fence_strip = fenced.buffer(FENCE_WIDTH_M)
    parts = [(subtract(part, fence_strip), metres) for part, metres in parts] + [(fenced, 0.0)]
    strips = [ground]
    for part, metres in parts:
        behind = [_find_ground_behind(other, metres, ground) for other, less in parts if less < metres]
        strip = part.buffer(metres, quad_segs=4)  # round corners of the outline: 2 % short
        strips.append(subtract(strip, unite(behind)))
    return unite(strips)


def _find_ground_behind(part: shapely.Geometry, depth_m: float, ground: shapely.Polygon) -> shapely.Geometry:
    """The ground outside up to a distance from a part of the outline, and square to it."""
    pieces = shapely.get_parts(subtract(part.buffer(depth_m, cap_style="flat"), ground))
    # What lies beyond the other side of a narrow field does not touch the part.
    along_m2 = shapely.area(intersect(pieces, part.buffer(FENCE_WIDTH_M)))
    return unite(pieces[along_m2 > FENCE_WIDTH_M**2])
