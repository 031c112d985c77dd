"""Whether any part of a tractor or an implement crosses a fence or touches an obstacle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import shapely

from planner.site import Site, body_of
from vehicle.run import Run

EVERY = 2  # rows of the 10 Hz record between looks: under half a metre of driving
GATE_M = 5.0  # so far to either side of the entrance a fence has its gate
SAME_M = 1e-6
TOUCH_M = 0.01  # overlaps thinner than this are none
HOLE = "a hole of the field"
Boxes = npt.NDArray[np.object_]


def fence_crossed_m(run: Run, site: Site) -> float:
    """How far (m) a box of tractor or implement ever reaches over a fence, or a post of one into a box; 0 for never."""
    field = site.layout.field
    if not field.fences or field.outline is None:
        return 0.0
    fence = shapely.union_all(field.fences)
    if field.entrance is not None:
        fence = shapely.difference(fence, shapely.Point(field.entrance).buffer(GATE_M))
    area = shapely.Polygon(field.outline.exterior)
    shapely.prepare([fence, area])
    hit = [boxes[shapely.intersects(boxes, fence)] for boxes in _near(run, site, fence)]
    return max((max(_over(boxes, area, fence), _into(boxes, fence)) for boxes in hit if len(boxes)), default=0.0)


def obstacle_touched(run: Run, site: Site) -> str | None:
    """What a box of tractor or implement touches, in words; None for nothing."""
    field = site.layout.field
    names = [str(one)[0].lower() + str(one)[1:] for one in field.obstacles]
    holes = [HOLE] * (len(field.solid) - len(names))
    for shape, name in zip(field.solid, [*holes, *names], strict=True):
        core = shape.buffer(-TOUCH_M)
        shapely.prepare(core)
        if any(shapely.intersects(boxes, core).any() for boxes in _near(run, site, core)):
            return name
    return None


def _near(run: Run, site: Site, shape: shapely.Geometry) -> Iterator[Boxes]:
    """Boxes of each tractor and its implement whenever they could touch a shape."""
    body, axle_m = body_of(site.tractor, site.implement), site.tractor.rear_axle_m
    for tractor in range(run.plan.tractors):
        poses = run.poses(tractor)[::EVERY]
        poses = poses[shapely.dwithin(shapely.points(poses[:, :2]), shape, body.reach_m + axle_m)]
        ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        yield body.placed(np.column_stack([poses[:, :2] - axle_m * ahead, poses[:, 2]]))


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
