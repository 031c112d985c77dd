"""Whether any part of a tractor or an implement crosses a fence or touches an obstacle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

from planner.site import Site, body_of
from vehicle.jit import compiled
from vehicle.run import Run

EVERY = 2  # rows of the 10 Hz record between looks: under half a metre of driving
SAME_M = 1e-6
TOUCH_M = 0.01  # overlaps thinner than this are none
APART = 50  # parts of a shape that poses are held against one by one
AT_ONCE = 100_000  # poses looked at together: points take ten times their room
HOLE = "a hole of the field"
Points = npt.NDArray[np.float64]
Boxes = npt.NDArray[np.object_]


class FenceCheck:
    """How far a tractor or its implement is over the fences of a field."""

    def __init__(self, site: Site) -> None:
        field = site.layout.field
        self._site = site
        self._fence = shapely.union_all(field.fences)
        if field.entrance is not None:
            self._fence = shapely.difference(self._fence, shapely.Point(field.entrance).buffer(site.gate_m))
        self._area = shapely.Polygon((field.outline or field.boundary).exterior)
        shapely.prepare([self._fence, self._area])

    def reached(self, poses: Points) -> npt.NDArray[np.bool_]:
        """At which of the poses (t,) a box could be at a fence; elsewhere the depth is 0."""
        return _within_reach(poses, self._site, self._fence)

    def depth_m(self, poses: Points) -> float:
        """How far (m) a box reaches over a fence, or a post into a box, at poses (t, 3) of the centre of mass."""
        if self._fence.is_empty:
            return 0.0
        boxes = _near(poses, self._site, self._fence)
        boxes = boxes[shapely.intersects(self._fence, boxes)]
        return max(_over(boxes, self._area, self._fence), _into(boxes, self._fence)) if len(boxes) else 0.0


class ObstacleCheck:
    """How far a tractor or its implement is over the obstacles and holes of a field."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._taken = shapely.union_all(site.layout.field.solid)
        self._core = self._taken.buffer(-TOUCH_M)
        shapely.prepare(self._core)

    def reached(self, poses: Points) -> npt.NDArray[np.bool_]:
        """At which of the poses (t,) a box could be at an obstacle; elsewhere the depth is 0."""
        return _within_reach(poses, self._site, self._core)

    def depth_m(self, poses: Points) -> float:
        """How far (m) a box reaches over an obstacle, or a corner of one into a box, at poses (t, 3) of the centre."""
        if self._core.is_empty:
            return 0.0
        boxes = _near(poses, self._site, self._core)
        boxes = boxes[shapely.intersects(self._core, boxes)]
        if not len(boxes):
            return 0.0
        corners = shapely.points(shapely.get_coordinates(boxes))
        inside = corners[shapely.contains_properly(self._taken, corners)]
        over = float(np.max(shapely.distance(self._taken.boundary, inside), initial=TOUCH_M))
        return max(over, _into(boxes, self._taken))


def fence_crossed_m(run: Run, site: Site) -> float:
    """How far (m) anything ever reaches over a fence; 0 for never."""
    check = FenceCheck(site)
    return max(check.depth_m(run.poses(tractor)[::EVERY]) for tractor in range(run.plan.tractors))


def obstacle_touched(run: Run, site: Site) -> str | None:
    """What a box of tractor or implement touches, in words; None for nothing."""
    field = site.layout.field
    names = [str(one)[0].lower() + str(one)[1:] for one in field.obstacles]
    holes = [HOLE] * (len(field.solid) - len(names))
    cores = [shape.buffer(-TOUCH_M) for shape in field.solid]
    courses = [run.poses(tractor)[::EVERY] for tractor in range(run.plan.tractors)]
    courses = [poses[in_boxes(poses, shapely.bounds(cores), _reach_m(site))] for poses in courses if cores]
    for core, name in zip(cores, [*holes, *names], strict=True):
        shapely.prepare(core)
        if any(shapely.intersects(core, _near(poses, site, core)).any() for poses in courses):
            return name
    return None


def _near(poses: Points, site: Site, shape: shapely.Geometry) -> Boxes:
    """Boxes of tractor and implement at those poses at which they could touch a shape."""
    body, axle_m = body_of(site.tractor, site.implement), site.tractor.rear_axle_m
    poses = poses[_within_reach(poses, site, shape)]
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return body.placed(np.column_stack([poses[:, :2] - axle_m * ahead, poses[:, 2]]))


def _reach_m(site: Site) -> float:
    """How far anything of tractor and implement is from the centre of mass at most."""
    return body_of(site.tractor, site.implement).reach_m + site.tractor.rear_axle_m


@compiled
def in_boxes(poses, boxes, reach):  # type: ignore[no-untyped-def]
    """Which poses (t, 2 or more) are within `reach` of any of the boxes (n, 4) of west, south, east and north."""
    out = np.zeros(len(poses), np.bool_)
    west, south, east, north = boxes[:, 0] - reach, boxes[:, 1] - reach, boxes[:, 2] + reach, boxes[:, 3] + reach
    for k in range(len(poses)):
        x, y = poses[k, 0], poses[k, 1]
        for number in range(len(boxes)):
            if x > west[number] and x < east[number] and y > south[number] and y < north[number]:
                out[k] = True
                break
    return out


def _within_reach(poses: Points, site: Site, shape: shapely.Geometry) -> npt.NDArray[np.bool_]:
    """At which of the poses (t,) a box of tractor or implement could touch a shape."""
    reach_m, parts = _reach_m(site), shapely.get_parts(shape)
    near: npt.NDArray[np.bool_] = in_boxes(poses, shapely.bounds(parts if len(parts) <= APART else [shape]), reach_m)
    rows = np.flatnonzero(near)
    for some in np.array_split(rows, 1 + len(rows) // AT_ONCE):
        near[some] = shapely.dwithin(shape, shapely.points(poses[some, :2]), reach_m)
    return near


def _over(boxes: Boxes, area: shapely.Polygon, fence: shapely.Geometry) -> float:
    """How far the corners of boxes that touch a fence are beyond it."""
    corners = shapely.points(shapely.get_coordinates(boxes))
    outside = shapely.distance(corners, area)
    nearest = shapely.distance(corners, fence) <= outside + SAME_M
    return float(np.max(outside[nearest], initial=0.0))


def _into(boxes: Boxes, fence: shapely.Geometry) -> float:
    """How deep the posts at the bends of a fence stand in boxes."""
    posts = shapely.points(np.unique(shapely.get_coordinates(fence), axis=0))
    box, post = shapely.STRtree(posts).query(boxes, predicate="contains_properly")
    return float(np.max(shapely.distance(shapely.boundary(boxes[box]), posts[post]), initial=0.0))
