"""Figures of merit of a run: what was worked, how far outside, how long, how close."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from planner.ground.inside import Inside
from planner.ground.overlays import Areas, left_of, only_areas, united, within, without_slivers
from planner.ground.swept import Swept, swept_ground
from planner.site import Site
from reports.results import MissedPiece
from vehicle.compile import outline
from vehicle.run import Run

EVERY = 5  # rows of the 10 Hz record between looks at the outline: under a metre of driving
SLIVER_M = 0.2  # ground narrower than this is missed like any other, but no piece that anybody would be sent to
TOUCHING_M = 1e-3
MITRE_LIMIT = 2.0
Points = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Coverage:
    """Areas in m2: of the field without its obstacles, worked, worked again, and missed; worked + missed = field.

    `ground` is all that was missed. `largest` is the largest piece of it that an implement could work in one go: half a
    working width or less does not join two of them. None where there is none. `cut_off_m2` of the missed ground are cut
    off by obstacles: no plan can work them, and none is charged for them.
    """

    field_m2: float
    worked_m2: float
    overlap_m2: float
    missed_m2: float
    ground: shapely.Geometry
    largest: MissedPiece | None
    cut_off_m2: float = 0.0

    @cached_property
    def missed(self) -> tuple[shapely.Polygon, ...]:
        """The pieces of missed ground wider than SLIVER_M, the largest first; worked out where they are asked for."""
        return tuple(_wide(self.ground, SLIVER_M))

    @property
    def worked_pct(self) -> float:
        """Share of the field that was worked, percent."""
        return 100.0 * self.worked_m2 / self.field_m2

    @property
    def overlap_pct(self) -> float:
        """Ground worked once more than needed, percent of the field."""
        return 100.0 * self.overlap_m2 / self.field_m2

    def finished(self, driven: float) -> float:
        """Time or hourly cost of all that can be reached for `driven` until now: what is left at the plan's rate."""
        left_m2 = self.missed_m2 - self.cut_off_m2
        return driven * (1.0 + left_m2 / self.worked_m2) if self.worked_m2 > 0.0 else math.inf


def guided_point(run: Run, site: Site, tractor: int) -> Points:
    """Track of the antenna, shape (t, 2)."""
    return guided(run.poses(tractor), site)


def guided(poses: Points, site: Site) -> Points:
    """Places (t, 2) of the antenna at poses (t, 3) of the centre of mass."""
    x, y, angle = poses.T
    reach = _antenna_m(site)
    return np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])


def _antenna_m(site: Site) -> float:
    """How far the antenna is ahead of the centre of mass."""
    return site.tractor.antenna_forward_m - site.tractor.rear_axle_m


def coverage(run: Run, site: Site, swept: Swept | None = None) -> Coverage:
    """What of the field, its obstacles left out, was swept once or more, more than once, and not at all.

    `swept` is the swept ground of the run where that is known already.
    """
    boundary = site.layout.field.whole
    inside = _clipped((swept or swept_ground(run, site)).ground, boundary)
    worked = united(inside)
    missed = left_of(boundary, worked)
    area, total = float(worked.area), float(shapely.area(inside).sum())
    reached = left_of(missed, united(np.array(site.layout.field.cut_off))) if site.layout.field.cut_off else missed
    largest = _largest(reached, 0.5 * site.implement.width_m)
    return Coverage(
        boundary.area, area, max(total - area, 0.0), float(missed.area), missed, largest,
        max(0.0, float(missed.area - reached.area)),
    )  # fmt: skip


def _clipped(areas: Areas, boundary: shapely.Geometry) -> Areas:
    """The areas as far as they lie in the field."""
    shapely.prepare(boundary)
    across = ~shapely.contains_properly(boundary, areas)
    inside = areas.copy()
    inside[across] = [within(one, boundary) for one in areas[across]]
    return inside


def _largest(missed: shapely.Geometry, neck_m: float) -> MissedPiece | None:
    """The largest piece of missed ground and a place in it.

    Pieces are cut where missed ground is narrower than `neck_m`; a thin end stays with its piece, a thin link between
    two is a piece of its own.
    """
    missed = shapely.multipolygons(without_slivers(shapely.get_parts(missed), min(neck_m, SLIVER_M)))
    pieces = _wide(missed, neck_m)
    thin = _wide(left_of(missed, shapely.multipolygons(pieces)), SLIVER_M)
    if not len(pieces) + len(thin):
        return None
    areas = np.concatenate([shapely.area(pieces), np.zeros(len(thin))])
    link, piece = shapely.STRtree(pieces).query(thin, predicate="dwithin", distance=TOUCHING_M)
    for number, part in enumerate(thin):
        near = piece[link == number]
        areas[near[0] if len(near) == 1 else len(pieces) + number] += part.area
    best = int(np.argmax(areas))
    place = shapely.point_on_surface((*pieces, *thin)[best])
    return MissedPiece(float(areas[best]), float(place.x), float(place.y))


def _wide(missed: shapely.Geometry, least_m: float) -> Areas:
    """Pieces of missed ground without what is narrower than `least_m` of it, the largest first."""
    half, parts = 0.5 * least_m, without_slivers(shapely.get_parts(only_areas(missed)), least_m)
    missed = shapely.multipolygons(parts)
    core = missed.buffer(-half, join_style="mitre", mitre_limit=MITRE_LIMIT)
    wide = core.buffer(half, join_style="mitre", mitre_limit=MITRE_LIMIT)
    parts = shapely.get_parts(within(missed, wide))
    return np.array(sorted(parts, key=_by_size), dtype=np.object_)


def _by_size(piece: shapely.Polygon) -> tuple[float, tuple[float, ...]]:
    return -piece.area, piece.bounds


@dataclass(frozen=True)
class Excursion:
    """Path length outside the boundary and the farthest distance from it, metres."""

    length_m: float
    depth_m: float


def excursion(run: Run, site: Site) -> Excursion:
    """How much of the guided points' paths lies outside the field."""
    boundary = site.layout.field.whole
    shapely.prepare(boundary)
    inside = Inside(boundary, abs(_antenna_m(site)))
    length = depth = 0.0
    for tractor in range(run.plan.tractors):
        poses = run.poses(tractor)
        near = inside.unsure(poses)
        path = guided(poses[near], site)
        outside = ~shapely.contains_xy(boundary, path[:, 0], path[:, 1])
        near, path = near[outside], path[outside]
        if len(near):
            steps = np.hypot(*np.diff(path, axis=0).T)
            length += float(steps[np.diff(near) == 1].sum())
            depth = max(depth, float(shapely.distance(shapely.points(path), boundary).max()))
    return Excursion(length, depth)


def outline_excursion_m(run: Run, site: Site) -> float:
    """Metres driven with some part of a tractor or its implement outside the field, or over an obstacle."""
    boxes = outline(site.tractor, site.implement)
    corners = _corners(boxes)
    reach = float(np.hypot(*corners.T).max())
    boundary = site.layout.field.whole
    inner = boundary.buffer(-1.01 * reach)
    shapely.prepare([boundary, inner])
    deep = Inside(inner, 0.0)
    posts = shapely.STRtree(shapely.points(shapely.get_coordinates(boundary)))
    length = 0.0
    for tractor in range(run.plan.tractors):
        poses = run.poses(tractor)
        poses = poses[np.append(np.arange(0, len(poses) - 1, EVERY), len(poses) - 1)]
        near = deep.unsure(poses)
        near = near[~shapely.contains_xy(inner, poses[near, :2])]
        outside = np.zeros(len(poses))
        x, y = _placed(corners, poses[near])
        outside[near] = ~shapely.intersects_xy(boundary, x, y).all(axis=1)
        outside[near[_over_posts(poses[near], posts, boxes, reach)]] = 1.0
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        length += float(steps @ (0.5 * (outside[1:] + outside[:-1])))
    return length


def _corners(boxes: dict[str, float]) -> Points:
    """Corners (8, 2), forward and left of the centre of mass, of the boxes of tractor and implement."""
    ends = [("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width")]
    return np.array([(boxes[end], side * boxes[half]) for *both, half in ends for end in both for side in (-1, 1)])


def _placed(corners: Points, poses: Points) -> tuple[Points, Points]:
    """x and y, each (t, 8), of the corners at poses (t, 3)."""
    (forward, left), (x, y, angle) = corners.T, poses.T[:, :, None]
    cosine, sine = np.cos(angle), np.sin(angle)
    return x + forward * cosine - left * sine, y + forward * sine + left * cosine


def _over_posts(poses: Points, posts: shapely.STRtree, boxes: dict[str, float], reach: float) -> Points:
    """Numbers of the poses (t, 3) at which a corner of the field or of an obstacle lies within a box."""
    pose, post = posts.query(shapely.points(poses[:, :2]), predicate="dwithin", distance=reach)
    off = shapely.get_coordinates(posts.geometries[post]) - poses[pose, :2]
    cosine, sine = np.cos(poses[pose, 2]), np.sin(poses[pose, 2])
    forward, left = off[:, 0] * cosine + off[:, 1] * sine, off[:, 1] * cosine - off[:, 0] * sine
    inside = np.zeros(len(pose), dtype=bool)
    for low, high, half in (("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width")):
        inside |= (boxes[low] < forward) & (forward < boxes[high]) & (np.abs(left) < boxes[half])
    return np.asarray(pose[inside])


def reversals(run: Run) -> int:
    """Gear changes planned and driven."""
    return sum(a.gear != b.gear for mission in run.plan.missions for a, b in pairwise(mission.legs))


def finite_or_none(value: float) -> float | None:
    """None for a value that does not exist."""
    return value if math.isfinite(value) else None
