"""What a route through a region is built from: its corners and its rings.

A corner is a vertex that the region bends round (a concave corner of the field or a corner of an obstacle); the
shortest line between two points runs straight from corner to corner (visibility graph). A ring is a closed curve inside
the region whose convex corners are rounded to the turning radius, cut into poses in both directions.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from strategies.path_planning.paths import Pose

Floats = NDArray[np.float64]

_MAX_CORNERS = 90
_MAX_CACHED_ENDS = 5000  # ends of lines whose view of the corners is cached
_LEAST_BEND_RAD = 1e-6
_RING_INSET_RADII = (1.0, 0.5, 0.1)  # radii
_RING_STEP_RADII = 1.5  # radii between poses


class VisibilityGraph:
    """Visibility graph of the corners of `region` (Polygon or MultiPolygon); lines of sight must stay in `guard`."""

    def __init__(self, region: BaseGeometry, guard: BaseGeometry) -> None:
        self._guard = guard
        self._reach_cache: dict[tuple[float, float], Floats] = {}
        self.points = _find_corner_points(region)
        count = len(self.points)
        self._length = np.full((count, count), np.inf)
        first, second = np.triu_indices(count, 1)
        seen = self._can_see(self.points[first], self.points[second])
        steps = np.hypot(*(self.points[first] - self.points[second]).T)
        self._length[first, second] = self._length[second, first] = np.where(seen, steps, np.inf)
        np.fill_diagonal(self._length, 0.0)
        self._next = np.where(np.isfinite(self._length), np.arange(count)[None, :], -1)
        for k in range(count):
            through = self._length[:, k, None] + self._length[None, k, :]
            better = through < self._length - 1e-9
            self._length = np.where(better, through, self._length)
            self._next = np.where(better, self._next[:, k, None], self._next)

    def find_shortest_lines(self, a: Pose, b: Pose, max_lines: int = 4) -> list[list[tuple[float, float]]]:
        """Up to `max_lines` short lines from a to b, each the points passed with both ends, the shortest first.

        Every line after the first begins or ends at a corner that none before it did. A straight line is the first if
        it stays in the region.
        """
        lines = [[a[:2], b[:2]]] if self._can_see(np.array([a[:2]]), np.array([b[:2]]))[0] else []
        if not len(self.points):
            return lines
        from_a = self._measure_visible_distances(a[:2])
        to_b = self._measure_visible_distances(b[:2])
        total = from_a[:, None] + self._length + to_b[None, :]
        firsts, lasts = set[int](), set[int]()
        for flat in np.argsort(total, axis=None, kind="stable"):
            i, j = divmod(int(flat), len(self.points))
            if len(lines) >= max_lines or not np.isfinite(total[i, j]):
                break
            if i in firsts and j in lasts:
                continue
            firsts.add(i)
            lasts.add(j)
            lines.append([a[:2], *(self._get_corner_point(k) for k in self._trace_corners(i, j)), b[:2]])
        return lines

    def _get_corner_point(self, corner: int) -> tuple[float, float]:
        x, y = self.points[corner].tolist()
        return x, y

    def _trace_corners(self, i: int, j: int) -> list[int]:
        passed_corners = [i]
        while passed_corners[-1] != j:
            passed_corners.append(int(self._next[passed_corners[-1], j]))
        return passed_corners

    def _measure_visible_distances(self, point: tuple[float, float]) -> Floats:
        """Distance from the point to every corner it sees, infinite for the rest; cached."""
        if point not in self._reach_cache:
            if len(self._reach_cache) >= _MAX_CACHED_ENDS:
                self._reach_cache.clear()
            points_at = np.array([point])
            seen = self._can_see(np.broadcast_to(points_at, self.points.shape), self.points)
            self._reach_cache[point] = np.where(seen, np.hypot(*(self.points - points_at).T), np.inf)
        return self._reach_cache[point]

    def _can_see(self, p: Floats, q: Floats) -> NDArray[np.bool_]:
        lines = shapely.linestrings(np.stack((p, q), axis=1))
        return np.asarray(shapely.covers(self._guard, lines), dtype=bool)


def _find_corner_points(region: BaseGeometry) -> Floats:
    """Corners a little inside the region, shape (n, 2); the outline is simplified until they are few enough.

    If they never are, only the sharpest are used.
    """
    for clearance in (0.25, 0.5, 1.0):
        inside = region.buffer(-clearance, join_style="mitre").simplify(0.8 * clearance)
        rings = [_find_reflex_corners(ring) for ring in _list_rings(inside)]
        corners = np.concatenate([np.empty((0, 3)), *rings])
        if len(corners) <= _MAX_CORNERS:
            break
    sharpest = np.argsort(corners[:, 2], kind="stable")[:_MAX_CORNERS]
    return corners[np.sort(sharpest), :2]


def _list_rings(region: BaseGeometry) -> list[Floats]:
    """Outlines and holes as open rings of points, each with the region on its left."""
    rings = []
    for part in shapely.get_parts(region):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            turned = orient(part)
            rings += [np.asarray(r.coords)[:-1, :2] for r in (turned.exterior, *turned.interiors)]
    return rings


def _find_reflex_corners(ring: Floats) -> Floats:
    """Vertices at which the region, on the ring's left, bends to the right: rows of x, y, bend (rad)."""
    before = ring - np.roll(ring, 1, axis=0)
    after = np.roll(before, -1, axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    bend = np.arctan2(cross, np.sum(before * after, axis=1))
    corners: Floats = np.column_stack((ring, bend))[bend < -_LEAST_BEND_RAD]
    return corners


def list_corner_poses(
    before: tuple[float, float], corner: tuple[float, float], after: tuple[float, float], radius_m: float
) -> list[Pose]:
    """Poses in which to pass a corner between the point before it and the point after it.

    Headings are those in, out and halfway; places are the corner and points up to a radius away on the outside of the
    bend.
    """
    heading_in = math.atan2(corner[1] - before[1], corner[0] - before[0])
    heading_out = math.atan2(after[1] - corner[1], after[0] - corner[0])
    bend = math.remainder(heading_out - heading_in, 2.0 * math.pi)
    heading_between = heading_in + 0.5 * bend
    outside = heading_between - math.copysign(0.5 * math.pi, bend)
    poses = []
    for offset in (0.0, 0.3 * radius_m, radius_m):
        x, y = corner[0] + offset * math.cos(outside), corner[1] + offset * math.sin(outside)
        poses += [(x, y, heading) for heading in (heading_between, heading_in, heading_out)]
    return poses


def list_ring_poses(region: BaseGeometry, radius_m: float) -> list[Pose]:
    """Poses along rings inside the region at several insets, in both directions."""
    poses: list[Pose] = []
    for inset in _RING_INSET_RADII:
        smooth = region.buffer(-(inset + 1.05) * radius_m, quad_segs=16).buffer(1.05 * radius_m, quad_segs=16)
        for points in _list_rings(smooth):
            poses += _sample_ring(shapely.LinearRing(points), _RING_STEP_RADII * radius_m)
    return poses


def _sample_ring(ring: shapely.LinearRing, step_m: float) -> list[Pose]:
    count = max(3, math.ceil(ring.length / step_m))
    distances_m = np.arange(count) * ring.length / count
    near = 0.02 * step_m
    places = shapely.get_coordinates(shapely.line_interpolate_point(ring, distances_m))
    behind = shapely.get_coordinates(shapely.line_interpolate_point(ring, (distances_m - near) % ring.length))
    front = shapely.get_coordinates(shapely.line_interpolate_point(ring, (distances_m + near) % ring.length))
    headings = np.arctan2(front[:, 1] - behind[:, 1], front[:, 0] - behind[:, 0])
    forth = [(float(x), float(y), float(h)) for (x, y), h in zip(places, headings, strict=True)]
    return forth + [(x, y, math.remainder(h + math.pi, 2.0 * math.pi)) for x, y, h in forth]
