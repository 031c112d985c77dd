"""Whether any part of a tractor or an implement crosses a fence or touches an obstacle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

from planner.evaluation.context import PlanningContext
from planner.evaluation.machine_outlines import build_body
from vehicle.jit import compile_function

CHECK_ROW_STEP = 2  # rows of the 10 Hz record between checks: under half a metre of driving
TOLERANCE_M = 1e-6
MIN_OVERLAP_M = 0.01  # thinner overlaps do not count
MAX_PARTS = 50  # parts of a shape that are compared with poses one by one
BATCH_SIZE = 100_000  # poses checked together: their points take ten times the memory
Points = npt.NDArray[np.float64]
Boxes = npt.NDArray[np.object_]


class FenceIntrusionCheck:
    """How far a tractor or its implement is over the fences of a field."""

    def __init__(self, context: PlanningContext) -> None:
        field = context.layout.field
        self._context = context
        self._fence = shapely.union_all(field.fences)
        if field.entrance is not None:
            self._fence = shapely.difference(
                self._fence, shapely.Point(field.entrance).buffer(context.gate_half_width_m)
            )
        self._area = shapely.Polygon((field.original_boundary or field.boundary).exterior)
        shapely.prepare([self._fence, self._area])

    def find_poses_to_check(self, poses: Points) -> npt.NDArray[np.bool_]:
        """Which of the poses (t,) may have a box at a fence; elsewhere the depth is 0."""
        return _find_poses_in_shape_reach(poses, self._context, self._fence)

    def measure_intrusion_m(self, poses: Points) -> float:
        """How far (m) a box reaches over a fence, or a post into a box, at poses (t, 3) of the centre of mass."""
        if self._fence.is_empty:
            return 0.0
        boxes = _build_boxes_within_reach(poses, self._context, self._fence)
        boxes = boxes[shapely.intersects(self._fence, boxes)]
        return (
            max(_measure_overhang_m(boxes, self._area, self._fence), _measure_post_depth_m(boxes, self._fence))
            if len(boxes)
            else 0.0
        )


class ObstacleIntrusionCheck:
    """How far a tractor or its implement is over the obstacles and holes of a field."""

    def __init__(self, context: PlanningContext, obstacle: shapely.Geometry | None = None) -> None:
        """Of one obstacle, or of all of the field."""
        self._context = context
        self._obstacle_area = shapely.union_all(
            context.layout.field.solid_obstacles if obstacle is None else [obstacle]
        )
        self._core = self._obstacle_area.buffer(-MIN_OVERLAP_M)
        shapely.prepare(self._core)

    def find_poses_to_check(self, poses: Points) -> npt.NDArray[np.bool_]:
        """Which of the poses (t,) may have a box at an obstacle; elsewhere the depth is 0."""
        return _find_poses_in_shape_reach(poses, self._context, self._core)

    def measure_intrusion_m(self, poses: Points) -> float:
        """How far (m) a box reaches over an obstacle, or a corner of one into a box, at poses (t, 3) of the centre."""
        if self._core.is_empty:
            return 0.0
        boxes = _build_boxes_within_reach(poses, self._context, self._core)
        boxes = boxes[shapely.intersects(self._core, boxes)]
        if not len(boxes):
            return 0.0
        corners = shapely.points(shapely.get_coordinates(boxes))
        inside = corners[shapely.contains_properly(self._obstacle_area, corners)]
        over = float(np.max(shapely.distance(self._obstacle_area.boundary, inside), initial=MIN_OVERLAP_M))
        return max(over, _measure_post_depth_m(boxes, self._obstacle_area))


def _build_boxes_within_reach(poses: Points, context: PlanningContext, shape: shapely.Geometry) -> Boxes:
    """Boxes of tractor and implement at the poses where they could touch a shape."""
    return place_boxes_at(poses[_find_poses_in_shape_reach(poses, context, shape)], context)


def place_boxes_at(poses: Points, context: PlanningContext) -> Boxes:
    """The boxes of tractor and implement at poses (t, 3) of the centre of mass, one after another for each pose."""
    body, axle_m = build_body(context.tractor, context.implement), context.tractor.rear_axle_m
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return body.place_boxes(np.column_stack([poses[:, :2] - axle_m * ahead, poses[:, 2]]))


def compute_reach_m(context: PlanningContext) -> float:
    """The farthest point (m) of tractor and implement from the centre of mass."""
    return build_body(context.tractor, context.implement).reach_m + context.tractor.rear_axle_m


@compile_function
def find_poses_within_reach(poses, boxes, reach):  # type: ignore[no-untyped-def]
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


def _find_poses_in_shape_reach(
    poses: Points, context: PlanningContext, shape: shapely.Geometry
) -> npt.NDArray[np.bool_]:
    """Which of the poses (t,) may have a box of tractor or implement touching a shape."""
    reach_m, parts = compute_reach_m(context), shapely.get_parts(shape)
    is_near: npt.NDArray[np.bool_] = find_poses_within_reach(
        poses, shapely.bounds(parts if len(parts) <= MAX_PARTS else [shape]), reach_m
    )
    rows = np.flatnonzero(is_near)
    for batch in np.array_split(rows, 1 + len(rows) // BATCH_SIZE):
        is_near[batch] = shapely.dwithin(shape, shapely.points(poses[batch, :2]), reach_m)
    return is_near


def _measure_overhang_m(boxes: Boxes, area: shapely.Polygon, fence: shapely.Geometry) -> float:
    """How far the corners of boxes that touch a fence are beyond it."""
    corners = shapely.points(shapely.get_coordinates(boxes))
    outside = shapely.distance(corners, area)
    nearest = shapely.distance(corners, fence) <= outside + TOLERANCE_M
    return float(np.max(outside[nearest], initial=0.0))


def _measure_post_depth_m(boxes: Boxes, fence: shapely.Geometry) -> float:
    """How deep the posts at the bends of a fence stand in boxes."""
    posts = shapely.points(np.unique(shapely.get_coordinates(fence), axis=0))
    box, post = shapely.STRtree(posts).query(boxes, predicate="contains_properly")
    return float(np.max(shapely.distance(shapely.boundary(boxes[box]), posts[post]), initial=0.0))
