"""How far machines may reach over the edges of a field that are not fenced."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import shapely

from fields.errors import FieldError, shorten_value
from fields.geometry.coordinates import FieldFrame
from fields.geometry.field_lines import OPEN_EDGE, clip_outline_to_line, parse_edge, parse_edge_line
from fields.raw_document import RawShape

OVERHANG = "overhang_m"  # property of a boundary or of an open edge in a field file
MAX_OVERHANG_M = 100.0
FENCE_WIDTH_M = 0.01
ARC_SEGMENTS = 4  # chords of a quarter circle round corners of the outline: 2 % short


@dataclass(frozen=True)
class EdgeOverhang:
    """A part of the outline (lines in metres) over which machines may reach farther, or less far, than elsewhere."""

    part: shapely.Geometry
    overhang_m: float


def read_edge_overhangs(
    chosen: RawShape, lines: Iterable[RawShape], frame: FieldFrame, shape: shapely.Polygon, label: str
) -> tuple[EdgeOverhang, ...]:
    """The overhangs that the file allows, the boundary's own first; of two for the same place the later one holds.

    Raises FieldError for one that is no length, or that belongs to a fence.
    """
    outline = shapely.LineString(shape.exterior.coords)
    overhangs = []
    if chosen.properties.get(OVERHANG) is not None:
        overhang_m = _parse_overhang_m(chosen.properties[OVERHANG], f"the boundary of {label}")
        overhangs.append(EdgeOverhang(outline, overhang_m))
    for raw in lines:
        if raw.properties.get(OVERHANG) is None:
            continue
        description = f"a line of {label}"
        overhang_m = _parse_overhang_m(raw.properties[OVERHANG], description)
        if parse_edge(raw.properties.get("edge"), description) != OPEN_EDGE:
            raise FieldError(
                f"The '{OVERHANG}' of {description} belongs to a fence, over which nothing may reach; use it with "
                f"'edge': '{OPEN_EDGE}'."
            )
        part = clip_outline_to_line(outline, parse_edge_line(raw, frame, description))
        if part.length > 0.0:  # in a file of several fields most lines belong to another one
            overhangs.append(EdgeOverhang(part, overhang_m))
    return tuple(overhangs)


def _parse_overhang_m(value: object, description: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= MAX_OVERHANG_M:
        raise FieldError(
            f"The '{OVERHANG}' of {description} is {shorten_value(value)}; it must be 0 to {MAX_OVERHANG_M:g} m."
        )
    return float(value)


def compute_overhang_region(
    outline: shapely.Polygon,
    fences: Sequence[shapely.LineString],
    overhangs: Sequence[EdgeOverhang],
    overhang_m: float,
) -> shapely.Geometry:
    """The ground over which parts of machines may reach: the field, and beyond its open edges what is allowed there.

    `overhang_m` holds where `overhangs` say nothing else; nothing may reach over fences. Ground behind an edge is
    limited by that edge, however much its neighbours allow.
    """
    ground = shapely.Polygon(outline.exterior)
    parts: list[tuple[shapely.Geometry, float]] = [(shapely.LineString(outline.exterior.coords), overhang_m)]
    for one in overhangs:
        here = one.part.buffer(FENCE_WIDTH_M)
        parts = [(shapely.difference(part, here), metres) for part, metres in parts] + [(one.part, one.overhang_m)]
    fenced = shapely.union_all(list(fences))
    fence_strip = fenced.buffer(FENCE_WIDTH_M)
    parts = [(shapely.difference(part, fence_strip), metres) for part, metres in parts] + [(fenced, 0.0)]
    strips = [ground]
    for part, metres in parts:
        behind = [_find_ground_behind(other, metres, ground) for other, less in parts if less < metres]
        strip = part.buffer(metres, quad_segs=ARC_SEGMENTS)
        strips.append(shapely.difference(strip, shapely.union_all(behind)))
    return shapely.union_all(strips)


def _find_ground_behind(part: shapely.Geometry, depth_m: float, ground: shapely.Polygon) -> shapely.Geometry:
    """The ground outside up to a distance from a part of the outline, and square to it."""
    pieces = shapely.get_parts(shapely.difference(part.buffer(depth_m, cap_style="flat"), ground))
    # What lies beyond the other side of a narrow field does not touch the part.
    along_m2 = shapely.area(shapely.intersection(pieces, part.buffer(FENCE_WIDTH_M)))
    return shapely.union_all(pieces[along_m2 > FENCE_WIDTH_M**2])
