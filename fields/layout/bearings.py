"""Candidate bearings of swaths, and the orientation and direction of an outline.

Choices made by these are mirrored on a mirrored field, and turn and shift with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats, build_directions, compute_angles
from fields.geometry.arithmetic import PARALLEL_RAD, ROUNDING, multiply

SIMPLIFY_M = 1.0
MERGE_RAD = math.radians(1.0)
EDGES_PER_BATCH = 1000
"""Edges compared with all others at a time, to limit memory."""
MAX_DIRECTIONS = 24
"""Directions tried, or twice as many with equally long edges; a curve has one per vertex."""
FAN_DEG = 2.5
"""Step of the directions tried between those of edges, counted from the longest edge."""
MAX_FANS = 4
"""Equally long edges that have a fan each; an outline with more of them looks the same from each."""
GAUSS_POINTS = (
    (-math.sqrt(0.6), 5 / 18),
    (0.0, 8 / 18),
    (math.sqrt(0.6), 5 / 18),
)  # exact for polynomials up to degree five
MARK_WEIGHT_M = 10.0
SYMMETRY_TOLERANCE = 1e-6  # in radii of gyration: smaller moments are rounding of a symmetric outline


def list_candidate_bearings(boundary: shapely.Polygon) -> list[float]:
    """Directions of the boundary edges and of the smallest rectangles around the field.

    Directions within one degree of a longer edge are dropped, and only the longest are kept. Edges of equal length
    never displace each other, so that the set turns and mirrors with the field. Angles are
    mathematical, in radians in [0, pi), that of the longest edge first.
    """
    angle, length = _measure_edge_directions(boundary)
    alive = np.ones(len(angle), dtype=bool)
    chosen: list[int] = []
    for i in np.lexsort((angle, -length)).tolist():
        shorter = length < length[i] * (1.0 - ROUNDING)
        if len(chosen) >= 2 * MAX_DIRECTIONS or (
            len(chosen) >= MAX_DIRECTIONS and length[i] < length[chosen[MAX_DIRECTIONS - 1]] * (1.0 - ROUNDING)
        ):
            break
        if alive[i]:
            chosen.append(i)
            difference = _compute_angle_between(angle, angle[i])
            alive &= ~((difference < PARALLEL_RAD) | ((difference < MERGE_RAD) & shorter))
    angles: list[float] = angle[chosen].tolist()
    around = _find_rectangle_directions(boundary)
    return angles + [one for one in around if not (_compute_angle_between(angles, one) < PARALLEL_RAD).any()]


def list_trial_bearings(boundary: shapely.Polygon) -> list[float]:
    """The candidate bearings, and between them a fan of directions every FAN_DEG, counted from the longest edge.

    With several longest edges, each has its fan, so that the set turns and mirrors with the field. Angles are
    mathematical, in radians in [0, pi), those of `list_candidate_bearings` first.
    """
    angles = list_candidate_bearings(boundary)
    edge_angle, length = _measure_edge_directions(boundary)
    longest = sorted(set(np.round(edge_angle[length >= length.max() * (1.0 - ROUNDING)], 9).tolist()))
    step = math.radians(FAN_DEG)
    for first in longest if len(longest) <= MAX_FANS else longest[:1]:
        fan = [(first + step * k) % math.pi for k in range(round(math.pi / step))]
        angles += [angle for angle in fan if float(_compute_angle_between(angles, angle).min()) > 0.25 * step]
    return angles


def _measure_edge_directions(boundary: shapely.Polygon) -> tuple[Floats, Floats]:
    """Angle in [0, pi) and length of the edges of the simplified boundary; lengths of parallel edges are added."""
    angles, lengths = [], []
    simplified = boundary.simplify(SIMPLIFY_M)
    for loop in (simplified.exterior, *simplified.interiors):
        step = np.diff(np.asarray(loop.coords)[:, :2], axis=0)
        angles.append(compute_angles(step) % math.pi)
        lengths.append(np.hypot(step[:, 0], step[:, 1]))
    angle, length = np.concatenate(angles), np.concatenate(lengths)
    is_long_enough = length > 1e-9
    angle, length = angle[is_long_enough], length[is_long_enough]
    rows = (angle[start : start + EDGES_PER_BATCH, None] for start in range(0, len(angle), EDGES_PER_BATCH))
    parallel_lengths = [multiply(_compute_angle_between(some, angle[None, :]) < PARALLEL_RAD, length) for some in rows]
    return angle, np.concatenate(parallel_lengths)


def _find_rectangle_directions(boundary: shapely.Polygon) -> list[float]:
    """Directions of the long sides of the smallest rotated rectangles; several when their areas are equal.

    One side of the smallest rectangle lies along an edge of the convex hull (Freeman and Shapira 1975).
    """
    hull = np.asarray(boundary.convex_hull.exterior.coords)[:, :2]
    step = np.diff(hull, axis=0)
    angle = compute_angles(step) % math.pi
    cosine, sine = build_directions(angle).T
    along = multiply(hull, np.stack([cosine, sine]))
    across = multiply(hull, np.stack([-sine, cosine]))
    size = np.stack([np.ptp(along, axis=0), np.ptp(across, axis=0)])
    area = size[0] * size[1]
    is_smallest = np.flatnonzero(area <= area.min() * (1.0 + ROUNDING))[:MAX_DIRECTIONS]
    quarter = np.where(size[0] >= size[1], 0.0, math.pi / 2)
    return sorted(((angle + quarter) % math.pi)[is_smallest].tolist())


def _compute_angle_between(a: npt.ArrayLike, b: npt.ArrayLike) -> Floats:
    """Angle between two undirected lines, 0 to pi / 2."""
    gap: Floats = np.abs(np.asarray(a) - np.asarray(b)) % math.pi
    return np.asarray(np.minimum(gap, math.pi - gap))


def find_handedness(rings: Sequence[Floats], marks: Sequence[tuple[float, float]] = ()) -> int:
    """1 or -1 for rings (n, 2) in metres, closed or not; the mirror image has the opposite sign, symmetric rings 1.

    `marks` are places that weigh as MARK_WEIGHT_M of outline each.

    The moment x'y'(x'^2 - y'^2) of the outline about its centroid in its principal axes, and where that vanishes the
    moments of third order, change sign in the mirror image and are invariant to translation and rotation.
    """
    points, weights = _weigh_points(rings, marks)
    (xx, xy), (_, yy) = multiply((points * weights[:, None]).T, points)
    turn = 0.5 * math.atan2(2.0 * xy, xx - yy)  # the principal axis along which they extend most
    cosine, sine = math.cos(turn), math.sin(turn)
    across, along = multiply(points, [[sine, cosine], [-cosine, sine]]).T
    fourth = multiply(weights, across * along * (along**2 - across**2))
    third = multiply(weights, along**3) * multiply(weights, along**2 * across)
    third += multiply(weights, across**3) * multiply(weights, across**2 * along)
    return next((1 if one > 0.0 else -1 for one in (fourth, third) if abs(one) > SYMMETRY_TOLERANCE), 1)


def choose_longer_reach_direction(
    bearing_rad: float, rings: Sequence[Floats], marks: Sequence[tuple[float, float]] = ()
) -> float:
    """A direction (radians) or its opposite, in (-pi, pi]: the one in which rings (n, 2) extend farther.

    If they extend equally, the one with the farther extent to its left; if that is equal too, the given one, as then
    the rings look the same from either end. `marks` as in `find_handedness`.
    """
    points, weights = _weigh_points(rings, marks)
    cosine, sine = math.cos(bearing_rad), math.sin(bearing_rad)
    along, across = multiply(points, (cosine, sine)), multiply(points, (-sine, cosine))
    moments = multiply(weights, along**3), multiply(weights, across**3)
    if next((one for one in moments if abs(one) > SYMMETRY_TOLERANCE), 1.0) > 0.0:
        return bearing_rad
    return bearing_rad + math.pi if bearing_rad <= 0.0 else bearing_rad - math.pi


def _weigh_points(rings: Sequence[Floats], marks: Sequence[tuple[float, float]]) -> tuple[Floats, Floats]:
    """Points on rings, and marks, about their centroid in radii of gyration (n, 2), and their weights (n,)."""
    places = [_sample_ring(ring) for ring in rings]
    points = np.concatenate([one for one, _ in places] + [np.array(marks).reshape(-1, 2)])
    weights = np.concatenate([one for _, one in places] + [np.full(len(marks), MARK_WEIGHT_M)])
    weights = weights / weights.sum()
    points = points - multiply(weights, points)
    return points / math.sqrt(multiply(weights, (points**2).sum(axis=1))), weights


def _sample_ring(ring: Floats) -> tuple[Floats, Floats]:
    """Gauss points on the edges of a ring (3 n, 2) and their weights in metres (3 n,)."""
    ends = np.roll(ring, -1, axis=0)
    middle, half = 0.5 * (ring + ends), 0.5 * (ends - ring)
    length = np.hypot(*(ends - ring).T)
    points = np.concatenate([middle + at * half for at, _ in GAUSS_POINTS])
    return points, np.concatenate([share * length for _, share in GAUSS_POINTS])
