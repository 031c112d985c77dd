"""Rounds of the headland: centre lines at (i - 1/2) widths inside the outline and outside every hole, cut at corners.

A round is laid as a closed curve with the field on its left. Where a headland is too narrow for the next round but not
yet worked, a line down its middle takes the place of that round.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from fields.errors import FieldError
from fields.field import Field
from fields.spines import spine

FloatArray = npt.NDArray[np.float64]

CORNER_RAD = math.radians(45.0)
SIMPLIFY_M = 0.03
MITRE_LIMIT = 2.0
RESTORE_LIMIT = 20.0  # sharp corners of a headland are no place that a round is too wide for
SLACK_M = 1e-6
BEND_M = 4.0
THIN = 0.15  # of the width: a closed round about less than this would work the same line twice
SHORTEST = 3.0  # widths round a closed round
OPEN_AREA = 0.5  # squared widths that a line down the middle must still find open
MOST_ROUNDS = 200


@dataclass(frozen=True, eq=False)
class Side:
    """A stretch of a round that is driven in one go.

    Attributes:
        points: centre line (n, 2) in the direction of travel, metres.
        before_rad, after_rad: deflection of the round at its beginning and its end, positive to the left; 0 at the
            ends of an open round and of a round without corners.
    """

    points: FloatArray
    before_rad: float = 0.0
    after_rad: float = 0.0

    @cached_property
    def length_m(self) -> float:
        """Length of the centre line, metres."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the headland, the field on its left.

    Attributes:
        number: 1 for the outermost, next to the outline or a hole.
        ring: 0 and up among the rounds of one number.
        sides: its sides, one after another.
        closed: whether the last side ends where the first begins; False for a line down the middle of a narrow place.
    """

    number: int
    ring: int
    sides: tuple[Side, ...]
    closed: bool = True

    @cached_property
    def length_m(self) -> float:
        """Length of the centre line, metres."""
        return math.fsum(side.length_m for side in self.sides)

    @cached_property
    def line(self) -> shapely.LineString:
        """The whole centre line."""
        return shapely.LineString(np.concatenate([side.points for side in self.sides]))


def lay_rounds(field: Field, width_m: float, count: int, bend_m: float = BEND_M) -> tuple[Round, ...]:
    """`count` rounds of the headland, outermost first.

    Args:
        field: the field.
        width_m: working width.
        count: rounds wanted; fewer where the field has no room for more.
        bend_m: a bend of more than 45 degrees within this length is a corner, whatever its vertices.

    Raises:
        FieldError: the width or the count is out of range, or the bend is not above 0.
    """
    _check(width_m, count, bend_m)
    rounds: list[Round] = []
    for number in range(1, count + 1):
        lines = _lines(field.boundary, width_m, number, bend_m)
        rounds += [Round(number, ring, sides, closed) for ring, (sides, closed) in enumerate(lines)]
    return tuple(rounds)


def inner_region(field: Field, depth_m: float) -> shapely.Geometry:
    """What of the field lies farther than a depth from its outline and its holes; may be empty or in parts."""
    return field.boundary.buffer(-depth_m, join_style="mitre", mitre_limit=MITRE_LIMIT)


def _check(width_m: float, count: int, bend_m: float) -> None:
    if not (math.isfinite(width_m) and width_m > 0.0):
        raise FieldError(f"Working width {width_m} m is not usable; give a width above 0 m.")
    if not 0 <= count <= MOST_ROUNDS:
        raise FieldError(f"{count} rounds of the headland are not usable; give 0 to {MOST_ROUNDS}.")
    if not (math.isfinite(bend_m) and bend_m > 0.0):
        raise FieldError(f"Length of a bend {bend_m} m is not usable; give a length above 0 m.")


def _lines(
    boundary: shapely.Polygon, width_m: float, number: int, bend_m: float
) -> Iterator[tuple[tuple[Side, ...], bool]]:
    """Sides of every round of a number, and whether it is closed: rings first, then lines down narrow places."""
    middle = _inset(boundary, (number - 0.5) * width_m - SLACK_M)
    wide = [part for part in _parts(middle) if 2.0 * part.area / part.length >= THIN * width_m]
    for part in wide:
        for ring in (part.exterior, *part.interiors):
            if ring.length >= SHORTEST * width_m:
                yield _sides(np.asarray(ring.simplify(SIMPLIFY_M).coords)[:-1, :2], bend_m), True
    if number == 1:
        return  # what is narrower than the implement has no room for it
    worked = shapely.MultiPolygon(wide).buffer(0.5 * width_m, join_style="mitre", mitre_limit=RESTORE_LIMIT)
    left = _inset(boundary, (number - 1) * width_m).difference(worked)
    for part in _parts(left):
        line = spine(part, width_m) if part.area >= OPEN_AREA * width_m**2 else None
        if line is not None:
            yield (Side(line),), False


def _inset(boundary: shapely.Polygon, depth_m: float) -> shapely.Geometry:
    return boundary.buffer(-depth_m, join_style="mitre", mitre_limit=MITRE_LIMIT)


def _parts(region: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons of a region, outlines counter-clockwise, in an order that does not hang on GEOS."""
    parts = [orient(part, 1.0) for part in shapely.get_parts(region) if part.geom_type == "Polygon" and part.area > 0]
    return sorted(parts, key=lambda part: (-round(part.area, 3), *np.round(part.centroid.coords[0], 3)))


def _sides(ring: FloatArray, bend_m: float) -> tuple[Side, ...]:
    """A ring (n, 2), not repeated at its end, cut at its corners; one closed side where it has none."""
    corners, ring = _corners(ring, bend_m)
    if not corners:
        return (Side(np.concatenate([ring, ring[:1]])),)
    turn = _deflections(ring)
    sides = []
    for first, last in zip(corners, (*corners[1:], corners[0]), strict=True):
        stop = last if last > first else last + len(ring)
        sides.append(Side(ring[np.arange(first, stop + 1) % len(ring)], float(turn[first]), float(turn[last])))
    return tuple(sides)


def _deflections(ring: FloatArray) -> FloatArray:
    """By how much a ring turns to the left at each vertex (n,), radians."""
    step = np.roll(ring, -1, axis=0) - ring
    heading = np.arctan2(step[:, 1], step[:, 0])
    turn: FloatArray = (heading - np.roll(heading, 1) + math.pi) % (2.0 * math.pi) - math.pi
    return turn


def _corners(ring: FloatArray, bend_m: float) -> tuple[list[int], FloatArray]:
    """Vertices that are corners, and the ring with each sharp bend of several vertices drawn together in one."""
    turn, count = _deflections(ring), len(ring)
    step = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    bends: list[tuple[float, int, int]] = []
    for first in range(count):
        length, total = 0.0, float(turn[first])
        best = (abs(total), 1)
        for size in range(2, min(count - 2, 60)):
            length += step[(first + size - 2) % count]
            if length > bend_m:
                break
            total += float(turn[(first + size - 1) % count])
            best = max(best, (abs(total), size), key=lambda bend: (round(bend[0], 6), -bend[1]))
        if best[0] > CORNER_RAD:
            bends.append((best[0], first, best[1]))
    taken = np.zeros(count, dtype=bool)
    chosen = []
    for _, first, size in sorted(bends, key=lambda bend: (-round(bend[0], 6), bend[2], bend[1])):
        members = np.arange(first, first + size) % count
        if not taken[members].any():
            taken[members] = True
            chosen.append((first, size))
    return _drawn_together(ring, sorted(chosen), bend_m)


def _drawn_together(ring: FloatArray, bends: list[tuple[int, int]], bend_m: float) -> tuple[list[int], FloatArray]:
    """The ring with every bend (first vertex, vertices) as one vertex, and the places of these.

    Where the lines that lead to a bend and from it meet nowhere near, as at the end of a strip, it is two corners.
    """
    count = len(ring)
    gone, vertex = np.zeros(count, dtype=bool), ring.copy()
    kept = []
    for first, size in bends:
        members = np.arange(first, first + size) % count
        kept.append(first)
        if size == 1:
            continue
        before, after = ring[(first - 1) % count], ring[(first + size) % count]
        meet = _meeting(before, ring[first], ring[members[-1]], after)
        if meet is None or math.dist(meet, ring[members[size // 2]]) > bend_m:
            gone[members[1:-1]] = True
            kept.append(int(members[-1]))
        else:
            gone[members[1:]] = True
            vertex[first] = meet
    place = np.cumsum(~gone) - 1
    return sorted(int(place[corner]) for corner in kept if not gone[corner]), vertex[~gone]


def _meeting(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray | None:
    """Where the line from a through b, drawn on, meets the one from d through c; None where it does not."""
    u, v, w = b - a, c - d, c - b
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < 1e-3 * float(np.hypot(*u) * np.hypot(*v)):
        return None
    on = (w[0] * v[1] - w[1] * v[0]) / cross
    back = (w[0] * u[1] - w[1] * u[0]) / cross
    return b + on * u if on >= -1e-9 and back >= -1e-9 else None
