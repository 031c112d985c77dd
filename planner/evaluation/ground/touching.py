"""Which poses of a machine touch a shape, compiled: most do not, and nothing is built for them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

from planner.evaluation.context import PlanningContext
from planner.evaluation.machine_outlines import build_body
from vehicle.jit import compile_function

Points = npt.NDArray[np.float64]
Boxes = npt.NDArray[np.object_]
Flags = npt.NDArray[np.bool_]
EDGES_TOGETHER = 32  # are passed over where their bounds are out of reach


@compile_function
def enters_box(x, y, dx, dy, length, width) -> bool:  # type: ignore[no-untyped-def]
    """Whether a straight edge from (x, y) by (dx, dy) touches a box from the origin (Liang and Barsky 1984)."""
    begin, end = 0.0, 1.0
    for start, step, size in ((x, dx, length), (y, dy, width)):
        if step == 0.0:
            if start < 0.0 or start > size:
                return False
            continue
        near, far = -start / step, (size - start) / step
        begin, end = max(begin, min(near, far)), min(end, max(near, far))
        if begin > end:
            return False
    return True


@compile_function
def is_crossed(x, y, cosine, sine, axle, boxes, reach, edges) -> bool:  # type: ignore[no-untyped-def]
    """Whether an edge (m, 4) touches a box of a machine at a place, heading by cosine and sine (find_crossed_poses)."""
    for k in range(len(edges)):
        ax, ay, bx, by = edges[k, 0] - x, edges[k, 1] - y, edges[k, 2] - x, edges[k, 3] - y
        if min(ax, bx) > reach or max(ax, bx) < -reach or min(ay, by) > reach or max(ay, by) < -reach:
            continue
        start, left = ax * cosine + ay * sine + axle, ay * cosine - ax * sine
        ahead, aside = (bx - ax) * cosine + (by - ay) * sine, (by - ay) * cosine - (bx - ax) * sine
        for number in range(len(boxes)):
            rear, front, half = boxes[number]
            if enters_box(start - rear, left + half, ahead, aside, front - rear, 2.0 * half):
                return True
    return False


@compile_function
def find_crossed_poses(poses, axle, boxes, reach, bounds, firsts, edges):  # type: ignore[no-untyped-def]
    """At which poses (t, 3) of a point `axle` ahead of its rear axle a machine has a box that an edge touches.

    Boxes are (n, 3): rear, front and half width, all within `reach` of that point. Edges (m, 4) are straight; those
    from `firsts[k]` on lie within the bounds (k, 4) of west, south, east and north.
    """
    found = np.zeros(len(poses), np.bool_)
    for row in range(len(poses)):
        x, y = poses[row, 0], poses[row, 1]
        cosine, sine = np.cos(poses[row, 2]), np.sin(poses[row, 2])
        for part in range(len(bounds)):
            west, south, east, north = bounds[part]
            if not (west < x + reach and x - reach < east and south < y + reach and y - reach < north):
                continue
            if is_crossed(x, y, cosine, sine, axle, boxes, reach, edges[firsts[part] : firsts[part + 1]]):
                found[row] = True
                break
    return found


class TouchTable:
    """Finds where a machine touches a shape of polygons, lines or both; points are passed over."""

    def __init__(self, context: PlanningContext, shape: shapely.Geometry) -> None:
        """For tractor and implement of a context."""
        parts = shapely.get_parts(shape)
        areas = parts[shapely.get_dimensions(parts) == 2]
        rings = shapely.get_parts(shapely.get_rings(areas))
        lines = np.concatenate([rings, parts[shapely.get_dimensions(parts) == 1]])
        points, owner = shapely.get_coordinates(lines, return_index=True)
        joined = np.flatnonzero(owner[1:] == owner[:-1])
        self._edges = np.column_stack([points[joined], points[joined + 1]])
        self._firsts = np.append(np.arange(0, len(joined), EDGES_TOGETHER), len(joined))
        ends, firsts = np.stack([points[joined], points[joined + 1]]), self._firsts[:-1]
        low, high = np.minimum.reduceat(ends.min(axis=0), firsts), np.maximum.reduceat(ends.max(axis=0), firsts)
        self._bounds = np.column_stack([low, high])
        self._body, self._axle_m = build_body(context.tractor, context.implement), context.tractor.rear_axle_m
        self._reach_m = self._body.guided_reach_m + self._axle_m
        self._areas = shapely.multipolygons(areas)
        shapely.prepare(self._areas)

    def find(self, poses: Points) -> Flags:
        """At which of poses (t, 3) of the centre of mass a box touches the shape or lies in it."""
        rows, boxes = np.ascontiguousarray(poses), np.array(self._body.boxes)
        found: Flags = find_crossed_poses(
            rows, self._axle_m, boxes, self._reach_m, self._bounds, self._firsts, self._edges
        )
        clear = np.flatnonzero(~found)
        ahead = np.column_stack([np.cos(poses[clear, 2]), np.sin(poses[clear, 2])])
        for rear_m, front_m, _ in self._body.boxes:
            middles = poses[clear, :2] + (0.5 * (rear_m + front_m) - self._axle_m) * ahead
            found[clear] |= shapely.intersects_xy(self._areas, middles)
        return found

    def place_boxes(self, poses: Points) -> Boxes:
        """The boxes of tractor and implement at poses (t, 3) of the centre of mass, one after another for each pose."""
        ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        return self._body.place_boxes(np.column_stack([poses[:, :2] - self._axle_m * ahead, poses[:, 2]]))
