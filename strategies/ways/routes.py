"""What a route through a region is found with: its corners and its rings.

A corner is a vertex the region bends round (a concave corner of the field or a corner of an obstacle); the
shortest way between two points runs straight from corner to corner (visibility graph). A ring is a closed curve
inside the region whose convex corners are rounded to the turning radius, cut into poses both ways round.
"""

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from strategies.ways.paths import Pose

Floats = NDArray[np.float64]

_MOST_CORNERS = 90
_MOST_REACHED = 5000  # ends of ways whose view of the corners is remembered
_LEAST_BEND_RAD = 1e-6
_RING_INSETS = (1.0, 0.5, 0.1)  # radii
_RING_STEP = 1.5  # radii between poses


class Corners:
    """Visibility graph of the corners of `region` (Polygon or MultiPolygon); `guard` is what sight must stay in."""

    def __init__(self, region: BaseGeometry, guard: BaseGeometry) -> None:
        self._guard = guard
        self._reached: dict[tuple[float, float], Floats] = {}
        self.points = _corner_points(region)
        count = len(self.points)
        self._length = np.full((count, count), np.inf)
        first, second = np.triu_indices(count, 1)
        seen = self._sees(self.points[first], self.points[second])
        steps = np.hypot(*(self.points[first] - self.points[second]).T)
        self._length[first, second] = self._length[second, first] = np.where(seen, steps, np.inf)
        np.fill_diagonal(self._length, 0.0)
        self._next = np.where(np.isfinite(self._length), np.arange(count)[None, :], -1)
        for k in range(count):
            through = self._length[:, k, None] + self._length[None, k, :]
            better = through < self._length - 1e-9
            self._length = np.where(better, through, self._length)
            self._next = np.where(better, self._next[:, k, None], self._next)

    def ways(self, a: Pose, b: Pose, most: int = 4) -> list[list[tuple[float, float]]]:
        """Up to `most` short ways from a to b, each the points passed with both ends, the shortest first.

        Every way after the first begins or ends at a corner that none before it did. A straight line, where it
        stays in the region, is the first.
        """
        ways = [[a[:2], b[:2]]] if self._sees(np.array([a[:2]]), np.array([b[:2]]))[0] else []
        if not len(self.points):
            return ways
        from_a = self._reach(a[:2])
        to_b = self._reach(b[:2])
        total = from_a[:, None] + self._length + to_b[None, :]
        firsts, lasts = set[int](), set[int]()
        for flat in np.argsort(total, axis=None, kind="stable"):
            i, j = divmod(int(flat), len(self.points))
            if len(ways) >= most or not np.isfinite(total[i, j]):
                break
            if i in firsts and j in lasts:
                continue
            firsts.add(i)
            lasts.add(j)
            ways.append([a[:2], *(self._spot(k) for k in self._between(i, j)), b[:2]])
        return ways

    def _spot(self, corner: int) -> tuple[float, float]:
        x, y = self.points[corner].tolist()
        return x, y

    def _between(self, i: int, j: int) -> list[int]:
        passed = [i]
        while passed[-1] != j:
            passed.append(int(self._next[passed[-1], j]))
        return passed

    def _reach(self, point: tuple[float, float]) -> Floats:
        """Distance from the point to every corner it sees, infinite for the rest; remembered, as ways share ends."""
        if point not in self._reached:
            if len(self._reached) >= _MOST_REACHED:
                self._reached.clear()
            at = np.array([point])
            seen = self._sees(np.broadcast_to(at, self.points.shape), self.points)
            self._reached[point] = np.where(seen, np.hypot(*(self.points - at).T), np.inf)
        return self._reached[point]

    def _sees(self, p: Floats, q: Floats) -> NDArray[np.bool_]:
        lines = shapely.linestrings(np.stack((p, q), axis=1))
        return np.asarray(shapely.covers(self._guard, lines), dtype=bool)


def _corner_points(region: BaseGeometry) -> Floats:
    """Corners a little inside the region, shape (n, 2); the outline is simplified until they are few enough.

    If they never are, the sharpest are kept.
    """
    for clearance in (0.25, 0.5, 1.0):
        inside = region.buffer(-clearance, join_style="mitre").simplify(0.8 * clearance)
        rings = [_bends(ring) for ring in _rings(inside)]
        corners = np.concatenate([np.empty((0, 3)), *rings])
        if len(corners) <= _MOST_CORNERS:
            break
    sharpest = np.argsort(corners[:, 2], kind="stable")[:_MOST_CORNERS]
    return corners[np.sort(sharpest), :2]


def _rings(region: BaseGeometry) -> list[Floats]:
    """Outlines and holes as open rings of points, each with the region on its left."""
    rings = []
    for part in shapely.get_parts(region):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            turned = orient(part)
            rings += [np.asarray(r.coords)[:-1, :2] for r in (turned.exterior, *turned.interiors)]
    return rings


def _bends(ring: Floats) -> Floats:
    """Vertices at which the region, on the ring's left, bends round to the right: rows of x, y, bend (rad)."""
    before = ring - np.roll(ring, 1, axis=0)
    after = np.roll(before, -1, axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    bend = np.arctan2(cross, np.sum(before * after, axis=1))
    corners: Floats = np.column_stack((ring, bend))[bend < -_LEAST_BEND_RAD]
    return corners


def corner_poses(
    before: tuple[float, float], corner: tuple[float, float], after: tuple[float, float], radius_m: float
) -> list[Pose]:
    """Poses in which to pass a corner on the way from the point before it to the point after it.

    Headings are those of the way in, the way out and between; places are the corner and points up to a radius
    away from it on the outside of the bend.
    """
    way_in = math.atan2(corner[1] - before[1], corner[0] - before[0])
    way_out = math.atan2(after[1] - corner[1], after[0] - corner[0])
    bend = math.remainder(way_out - way_in, 2.0 * math.pi)
    middle = way_in + 0.5 * bend
    outside = middle - math.copysign(0.5 * math.pi, bend)
    poses = []
    for offset in (0.0, 0.3 * radius_m, radius_m):
        x, y = corner[0] + offset * math.cos(outside), corner[1] + offset * math.sin(outside)
        poses += [(x, y, heading) for heading in (middle, way_in, way_out)]
    return poses


def ring_poses(region: BaseGeometry, radius_m: float) -> list[Pose]:
    """Poses along rings inside the region at several insets, both ways round each."""
    poses: list[Pose] = []
    for inset in _RING_INSETS:
        smooth = region.buffer(-(inset + 1.05) * radius_m, quad_segs=16).buffer(1.05 * radius_m, quad_segs=16)
        for points in _rings(smooth):
            poses += _poses_along(shapely.LinearRing(points), _RING_STEP * radius_m)
    return poses


def _poses_along(ring: shapely.LinearRing, step_m: float) -> list[Pose]:
    count = max(3, math.ceil(ring.length / step_m))
    at = np.arange(count) * ring.length / count
    near = 0.02 * step_m
    places = shapely.get_coordinates(shapely.line_interpolate_point(ring, at))
    behind = shapely.get_coordinates(shapely.line_interpolate_point(ring, (at - near) % ring.length))
    front = shapely.get_coordinates(shapely.line_interpolate_point(ring, (at + near) % ring.length))
    headings = np.arctan2(front[:, 1] - behind[:, 1], front[:, 0] - behind[:, 0])
    forth = [(float(x), float(y), float(h)) for (x, y), h in zip(places, headings, strict=True)]
    return forth + [(x, y, math.remainder(h + math.pi, 2.0 * math.pi)) for x, y, h in forth]
