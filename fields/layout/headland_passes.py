"""Headland passes: centre lines at (i - 1/2) widths inside the outline and outside every hole, split at corners.

A pass is a closed curve with the field on its left. Where a headland is too narrow for the next pass but not yet
worked, an open pass follows the middle of the strip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from fields.arrays import Floats, compute_angles
from fields.errors import FieldError
from fields.geometry.arithmetic import GRID_M, MITRE_LIMIT, SHARP_MITRE_LIMIT
from fields.geometry.field import Field
from fields.geometry.overlays import intersect, subtract

MIN_STRIP_LENGTH = 2.0  # widths
SMOOTHING_TOLERANCE = 0.1  # of the width: largest deviation from the middle
CORNER_RAD = math.radians(45.0)
SIMPLIFY_M = 0.03
MIN_RING_THICKNESS = 0.15  # of the width: a thinner closed pass would work the same line twice
MIN_RING_LENGTH = 3.0  # widths, of a closed pass
MIN_OPEN_AREA = 0.5  # squared widths: smallest unworked strip that gets a pass down its middle
MAX_HEADLAND_PASSES = 200


def find_centre_line(strip: shapely.Polygon, width_m: float) -> Floats | None:
    """The centre line of a strip narrower than the width, from end to end, shape (n, 2); None if it is too short.

    The strip is cut at right angles to its longer axis, and the line connects the middles of the cuts.
    """
    corner, along, length, across = _find_strip_axes(strip)
    if length < MIN_STRIP_LENGTH * width_m:
        return None
    pieces = max(2, math.ceil(length / width_m))
    aside = np.array([-along[1], along[0]])
    stations_m = np.clip(np.linspace(0.0, length, pieces + 1), 0.01 * length, 0.99 * length)
    foot = corner + stations_m[:, None] * along
    cuts = shapely.linestrings(np.stack([foot - aside, foot + (across + 1.0) * aside], axis=1))
    middles = shapely.centroid(intersect(strip, cuts))
    points = shapely.get_coordinates(middles[~shapely.is_empty(middles)])
    if len(points) < 2:
        return None
    return np.asarray(shapely.LineString(points).simplify(SMOOTHING_TOLERANCE * width_m).coords)[:, :2]


def _find_strip_axes(strip: shapely.Polygon) -> tuple[Floats, Floats, float, float]:
    """A corner of the smallest rectangle round the strip, the direction of its long side, and both lengths (m)."""
    box = np.asarray(shapely.minimum_rotated_rectangle(strip).exterior.coords)[:, :2]
    if shapely.LinearRing(box).is_ccw is False:
        box = box[::-1]
    first, second = math.dist(box[0], box[1]), math.dist(box[1], box[2])
    if first < second:
        box, first, second = np.roll(box[:-1], -1, axis=0), second, first
    return box[0], (box[1] - box[0]) / first, first, second


@dataclass(frozen=True, eq=False)
class HeadlandPassSide:
    """A part of a headland pass between two corners, driven without a turn.

    Attributes:
        points: centre line (n, 2) in the direction of travel, metres.
        start_turn_rad, end_turn_rad: turn of the pass at the corners, positive to the left; 0 at the ends of an open
            pass and for a pass without corners.
    """

    points: Floats
    start_turn_rad: float = 0.0
    end_turn_rad: float = 0.0

    @cached_property
    def length_m(self) -> float:
        """Length of the centre line, metres."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())


@dataclass(frozen=True, eq=False)
class HeadlandPass:
    """One pass of the headland, the field on its left.

    Attributes:
        number: 1 for the outermost, next to the outline or a hole.
        sides: its sides in order.
        is_closed: whether the last side ends where the first begins; False for the middle of a narrow strip.
        is_round_hole: whether it leads round a hole of the field.
    """

    number: int
    sides: tuple[HeadlandPassSide, ...]
    is_closed: bool = True
    is_round_hole: bool = False

    @cached_property
    def length_m(self) -> float:
        """Length of the centre line, metres."""
        return math.fsum(side.length_m for side in self.sides)


def lay_headland_passes(
    field: Field, width_m: float, count: int, corner_length_m: float = 4.0
) -> tuple[HeadlandPass, ...]:
    """`count` headland passes of a working width, outermost first; fewer where the field has no room.

    A bend of more than 45 degrees within `corner_length_m` is a corner. Raises FieldError where the width or the count
    is out of range, or the corner length is not above 0.
    """
    _check_pass_request(width_m, count, corner_length_m)
    passes: list[HeadlandPass] = []
    for number in range(1, count + 1):
        passes += _draw_passes(field, width_m, number, corner_length_m)
    return tuple(passes)


def compute_inner_region(field: Field, depth_m: float) -> shapely.Geometry:
    """The field farther than a depth from its outline and its holes; may be empty or in several parts."""
    return field.boundary.buffer(-depth_m, join_style="mitre", mitre_limit=MITRE_LIMIT)


def _check_pass_request(width_m: float, count: int, corner_length_m: float) -> None:
    if not (math.isfinite(width_m) and width_m > 0.0):
        raise FieldError(f"The working width is {width_m} m; give a width above 0 m.")
    if not 0 <= count <= MAX_HEADLAND_PASSES:
        raise FieldError(f"The number of headland passes is {count}; give 0 to {MAX_HEADLAND_PASSES}.")
    if not (math.isfinite(corner_length_m) and corner_length_m > 0.0):
        raise FieldError(f"The length of a corner is {corner_length_m} m; give a length above 0 m.")


def _draw_passes(field: Field, width_m: float, number: int, corner_length_m: float) -> Iterator[HeadlandPass]:
    """Every pass of a number: rings first, then middles of narrow strips."""
    middle = compute_inner_region(field, (number - 0.5) * width_m - GRID_M)
    wide = [part for part in _sort_polygons(middle) if 2.0 * part.area / part.length >= MIN_RING_THICKNESS * width_m]
    for part in wide:
        for place, ring in enumerate((part.exterior, *part.interiors)):
            if ring.length >= MIN_RING_LENGTH * width_m:
                sides = _split_into_sides(np.asarray(ring.simplify(SIMPLIFY_M).coords)[:-1, :2], corner_length_m)
                yield HeadlandPass(number, sides, is_round_hole=place > 0)
    worked = shapely.MultiPolygon(wide).buffer(0.5 * width_m, join_style="mitre", mitre_limit=SHARP_MITRE_LIMIT)
    if number > 1:
        ground = compute_inner_region(field, (number - 1) * width_m)
    else:  # the outermost pass is not laid where the field is narrower than the implement
        wide_enough = middle.buffer(0.5 * width_m, join_style="mitre", mitre_limit=MITRE_LIMIT)
        ground = intersect(wide_enough, field.boundary)
    for part in _sort_polygons(subtract(ground, worked)):
        line = find_centre_line(part, width_m) if part.area >= MIN_OPEN_AREA * width_m**2 else None
        if line is not None:
            yield HeadlandPass(number, (HeadlandPassSide(line),), is_closed=False)


def _sort_polygons(region: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons of a region, counter-clockwise, in an order independent of GEOS."""
    parts = [orient(part, 1.0) for part in shapely.get_parts(region) if part.geom_type == "Polygon" and part.area > 0]
    return sorted(parts, key=lambda part: (-round(part.area, 3), *np.round(part.centroid.coords[0], 3)))


def _split_into_sides(ring: Floats, corner_length_m: float) -> tuple[HeadlandPassSide, ...]:
    """An open ring (n, 2) split at its corners; one closed side if it has none."""
    corners, ring = _find_corners(ring, corner_length_m)
    if not corners:
        return (HeadlandPassSide(np.concatenate([ring, ring[:1]])),)
    turn = _compute_deflections(ring)
    sides = []
    for first, last in zip(corners, (*corners[1:], corners[0]), strict=True):
        stop = last if last > first else last + len(ring)
        sides.append(
            HeadlandPassSide(ring[np.arange(first, stop + 1) % len(ring)], float(turn[first]), float(turn[last]))
        )
    return tuple(sides)


def _compute_deflections(ring: Floats) -> Floats:
    """Turn to the left at each vertex of a ring (n,), radians."""
    step = np.roll(ring, -1, axis=0) - ring
    heading = compute_angles(step)
    turn: Floats = (heading - np.roll(heading, 1) + math.pi) % (2.0 * math.pi) - math.pi
    return turn


def _find_corners(ring: Floats, corner_length_m: float) -> tuple[list[int], Floats]:
    """Indices of the corners, and the ring with each sharp bend of several vertices merged into one."""
    turn, count = _compute_deflections(ring), len(ring)
    step = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    bends: list[tuple[float, int, int]] = []
    for first in range(count):
        length, total = 0.0, float(turn[first])
        best = (abs(total), 1)
        for size in range(2, min(count - 2, 60)):
            length += step[(first + size - 2) % count]
            if length > corner_length_m:
                break
            total += float(turn[(first + size - 1) % count])
            best = max(best, (abs(total), size), key=lambda bend: (round(bend[0], 6), -bend[1]))
        if best[0] > CORNER_RAD:
            bends.append((best[0], first, best[1]))
    is_taken = np.zeros(count, dtype=bool)
    chosen = []
    for _, first, size in sorted(bends, key=lambda bend: (-round(bend[0], 6), bend[2], bend[1])):
        members = np.arange(first, first + size) % count
        if not is_taken[members].any():
            is_taken[members] = True
            chosen.append((first, size))
    return _merge_bends(ring, sorted(chosen), corner_length_m)


def _merge_bends(ring: Floats, bends: list[tuple[int, int]], corner_length_m: float) -> tuple[list[int], Floats]:
    """Indices of the corners, and the ring with every bend (first vertex, vertex count) merged into one vertex.

    Where the lines before and after a bend do not meet nearby, as at the end of a strip, the bend becomes two corners.
    """
    count = len(ring)
    is_dropped, vertex = np.zeros(count, dtype=bool), ring.copy()
    corners = []
    for first, size in bends:
        members = np.arange(first, first + size) % count
        corners.append(first)
        if size == 1:
            continue
        before, after = ring[(first - 1) % count], ring[(first + size) % count]
        meet = _intersect_lines(before, ring[first], ring[members[-1]], after)
        if meet is None or math.dist(meet, ring[members[size // 2]]) > corner_length_m:
            is_dropped[members[1:-1]] = True
            corners.append(int(members[-1]))
        else:
            is_dropped[members[1:]] = True
            vertex[first] = meet
    place = np.cumsum(~is_dropped) - 1
    return sorted(int(place[corner]) for corner in corners if not is_dropped[corner]), vertex[~is_dropped]


def _intersect_lines(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats | None:
    """Intersection of the line from a beyond b with the one from d beyond c; None without one."""
    u, v, w = b - a, c - d, c - b
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < 1e-3 * float(np.hypot(*u) * np.hypot(*v)):
        return None
    forward = (w[0] * v[1] - w[1] * v[0]) / cross
    backward = (w[0] * u[1] - w[1] * u[0]) / cross
    return b + forward * u if forward >= -1e-9 and backward >= -1e-9 else None
