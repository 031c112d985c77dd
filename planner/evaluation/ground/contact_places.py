"""Where a run touches an obstacle, crosses a fence or leaves the field: what is touched, where, how deep, how far.

Which poses touch a shape is compiled: most do not, and nothing is built for them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Flags, Floats, Integers, build_directions
from fields.geometry.arithmetic import GRID_M
from fields.geometry.overlays import subtract, unite
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import measure_outside_m
from planner.evaluation.machine_outlines import build_body
from planner.evaluation.site import MAX_OUTSIDE_M, TOLERANCE_M
from reports.common.plan_records import FENCE, OBSTACLE, OUTLINE, PlanFault
from vehicle.jit import compile_function
from vehicle.missions.plan import ENTER, LEAVE
from vehicle.missions.run import SimulationRun

CHECK_ROW_STEP = 2  # rows of the 10 Hz record between checks: under half a metre of driving
MIN_OVERLAP_M = 0.01  # thinner overlaps do not count
MAX_FENCE_CROSSING_M = 0.02  # the thickness of wire
SAME_PLACE_ROWS = 30  # of the 10 Hz record: contacts within three seconds are one
POINT_STEP_M = 0.25  # between the points of a machine's outline whose distance from the field is measured
Boxes = npt.NDArray[np.object_]
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

    def find(self, poses: Floats) -> Flags:
        """At which of poses (t, 3) of the centre of mass a box touches the shape or lies in it."""
        rows, boxes = np.ascontiguousarray(poses), np.array(self._body.boxes)
        found: Flags = find_crossed_poses(
            rows, self._axle_m, boxes, self._reach_m, self._bounds, self._firsts, self._edges
        )
        clear = np.flatnonzero(~found)
        ahead = build_directions(poses[clear, 2])
        for rear_m, front_m, _ in self._body.boxes:
            middles = poses[clear, :2] + (0.5 * (rear_m + front_m) - self._axle_m) * ahead
            found[clear] |= shapely.intersects_xy(self._areas, middles)
        return found

    def place_boxes(self, poses: Floats) -> Boxes:
        """The boxes of tractor and implement at poses (t, 3) of the centre of mass, one after another for each pose."""
        ahead = build_directions(poses[:, 2])
        return self._body.place_boxes(np.column_stack([poses[:, :2] - self._axle_m * ahead, poses[:, 2]]))


class _IntrusionCheck(TouchTable):
    """How far a tractor or its implement is over a shape, which boxes must touch; elsewhere the depth is 0."""

    def __init__(self, context: PlanningContext, shape: shapely.Geometry) -> None:
        super().__init__(context, shape)
        self._shape = shape
        shapely.prepare(shape)

    def measure_intrusion_m(self, poses: Floats) -> float:
        """How far (m) a box reaches over the shape, or a corner of it into a box, at poses (t, 3) of the centre."""
        boxes = self.place_boxes(poses[self.find(poses)])
        boxes = boxes[shapely.intersects(self._shape, boxes)]
        return self._measure_boxes_m(boxes) if len(boxes) else 0.0

    def _measure_boxes_m(self, boxes: Boxes) -> float:
        raise NotImplementedError


class FenceIntrusionCheck(_IntrusionCheck):
    """How far a tractor or its implement is over the fences of a field."""

    def __init__(self, context: PlanningContext) -> None:
        field = context.layout.field
        fence = unite(field.fences)
        if field.entrance is not None:
            fence = subtract(fence, shapely.Point(field.entrance).buffer(context.gate_half_width_m))
        super().__init__(context, fence)
        self._area = shapely.Polygon(field.whole_boundary.exterior)
        shapely.prepare(self._area)

    def _measure_boxes_m(self, boxes: Boxes) -> float:
        corners = shapely.points(shapely.get_coordinates(boxes))
        outside = shapely.distance(corners, self._area)
        nearest = shapely.distance(corners, self._shape) <= outside + GRID_M
        overhang_m = float(np.max(outside[nearest], initial=0.0))  # of the corners of boxes that touch the fence
        return max(overhang_m, _measure_post_depth_m(boxes, self._shape))


class ObstacleIntrusionCheck(_IntrusionCheck):
    """How far a tractor or its implement is over the obstacles and holes of a field."""

    def __init__(self, context: PlanningContext, obstacle: shapely.Geometry | None = None) -> None:
        """Of one obstacle, or of all of the field."""
        self._area = unite(context.layout.field.solid_obstacles if obstacle is None else [obstacle])
        super().__init__(context, self._area.buffer(-MIN_OVERLAP_M))

    def _measure_boxes_m(self, boxes: Boxes) -> float:
        corners = shapely.points(shapely.get_coordinates(boxes))
        inside = corners[shapely.contains_properly(self._area, corners)]
        over = float(np.max(shapely.distance(self._area.boundary, inside), initial=MIN_OVERLAP_M))
        return max(over, _measure_post_depth_m(boxes, self._area))


def _measure_post_depth_m(boxes: Boxes, fence: shapely.Geometry) -> float:
    """How deep the posts at the bends of a fence stand in boxes."""
    posts = shapely.points(np.unique(shapely.get_coordinates(fence), axis=0))
    box, post = shapely.STRtree(posts).query(boxes, predicate="contains_properly")
    return float(np.max(shapely.distance(shapely.boundary(boxes[box]), posts[post]), initial=0.0))


@dataclass(frozen=True)
class ContactPlace:
    """What a tractor or its implement touches or crosses, and where.

    `number` counts the obstacles (Field.solid_obstacles), then the fences of a field; None for the outline. x and y are
    the middle of the tractor where it reaches deepest.
    """

    kind: str
    number: int | None
    name: str
    x_m: float
    y_m: float
    depth_m: float

    @property
    def fault(self) -> PlanFault:
        """The place as a result has it."""
        return PlanFault(self.kind, self.number, self.x_m, self.y_m)

    @property
    def sentence(self) -> str:
        """What happens there, in words."""
        if self.kind == OBSTACLE:
            return f"a tractor or its implement touches {self.name} by {self.depth_m:.2f} m"
        if self.kind == FENCE:
            return f"a tractor or its implement crosses the fence by {self.depth_m:.2f} m"
        return f"a path leaves the field by {self.depth_m:.2f} m, more than {MAX_OUTSIDE_M} m"


def find_contact_places(run: SimulationRun, context: PlanningContext) -> tuple[ContactPlace, ...]:
    """All places of a run where it leaves the field, crosses a fence or touches an obstacle, in this order."""
    finders = _iter_outline_places, _iter_fence_places, _iter_obstacle_places
    return tuple(place for find in finders for place in find(run, context))


def describe_worst_place(places: Sequence[ContactPlace], context: PlanningContext) -> str:
    """What happens where it is worst, by the kind that comes first, and where that is."""
    worst = max((place for place in places if place.kind == places[0].kind), key=lambda place: place.depth_m)
    return f"{worst.sentence} {describe_position(worst.x_m, worst.y_m, context)}"


def describe_position(x_m: float, y_m: float, context: PlanningContext) -> str:
    """A place in degrees, or in metres for a field in local metres."""
    field = context.layout.field
    if field.crs is None:
        return f"at ({x_m:.1f}, {y_m:.1f}) m"
    lon, lat = field.to_wgs84([(x_m, y_m)])[0].tolist()
    return f"at {lon:.6f}, {lat:.6f} (longitude, latitude)"


def _iter_outline_places(run: SimulationRun, context: PlanningContext) -> Iterator[ContactPlace]:
    for tractor in range(run.plan.tractors):
        depths_m = measure_outside_m(run, tractor, context)
        rows = np.flatnonzero(depths_m >= MAX_OUTSIDE_M)
        yield from _iter_deepest(run, tractor, rows, depths_m[rows], OUTLINE, "the outline")


def _iter_fence_places(run: SimulationRun, context: PlanningContext) -> Iterator[ContactPlace]:
    fences = context.layout.field.fences
    if not fences:
        return
    obstacle_count = len(context.layout.field.solid_obstacles)
    checks = {each.implement: FenceIntrusionCheck(each) for each in (context, context.folded)}
    for tractor, rows, state in _iter_states(run, context):
        poses, check = run.get_poses(tractor), checks[state.implement]
        if check.measure_intrusion_m(poses[rows]) <= MAX_FENCE_CROSSING_M:
            continue
        rows = rows[check.find(poses[rows])]
        depths_m = np.array([check.measure_intrusion_m(poses[[row]]) for row in rows])
        over = depths_m > MAX_FENCE_CROSSING_M
        for place in _iter_deepest(run, tractor, rows[over], depths_m[over], FENCE, "the fence"):
            nearest = int(np.argmin(shapely.distance(list(fences), shapely.Point(place.x_m, place.y_m))))
            yield replace(place, number=obstacle_count + nearest)


def _iter_obstacle_places(run: SimulationRun, context: PlanningContext) -> Iterator[ContactPlace]:
    obstacles, names = context.layout.field.solid_obstacles, context.layout.field.obstacle_names
    checks = {each.implement: ObstacleIntrusionCheck(each) for each in (context, context.folded) if obstacles}
    for tractor, rows, state in _iter_states(run, context) if obstacles else ():
        poses = run.get_poses(tractor)
        rows = rows[checks[state.implement].find(poses[rows])]
        for number, obstacle in enumerate(obstacles if len(rows) else ()):
            check = ObstacleIntrusionCheck(state, obstacle)
            near = rows[check.find(poses[rows])]
            depths_m = np.array([check.measure_intrusion_m(poses[[row]]) for row in near])
            yield from _iter_deepest(run, tractor, near, depths_m, OBSTACLE, names[number], number)


def _iter_deepest(
    run: SimulationRun, tractor: int, rows: Integers, depths_m: Floats, kind: str, name: str, number: int | None = None
) -> Iterator[ContactPlace]:
    """Where a tractor reaches deepest, once for rows (n,) of its record that belong to one place."""
    for group in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > SAME_PLACE_ROWS) + 1):
        if len(group):
            deepest = group[np.argmax(depths_m[group])]
            x, y = run.get_poses(tractor)[rows[deepest], :2].tolist()
            yield ContactPlace(kind, number, name, x, y, float(depths_m[deepest]))


def _iter_states(run: SimulationRun, context: PlanningContext) -> Iterator[tuple[int, Integers, PlanningContext]]:
    """Every tractor with the rows of its record that are checked, those with its implement folded apart."""
    rows = np.arange(0, len(run.time_s), CHECK_ROW_STEP)
    for tractor in range(run.plan.tractors):
        is_folded = run.find_folded_rows(tractor)[rows]
        for state, here in ((context, rows[~is_folded]), (context.folded, rows[is_folded])):
            if len(here):
                yield tractor, here, state


@dataclass(frozen=True)
class Overhang:
    """The farthest that anything reaches beyond the outline, and the length driven beyond what is allowed (m)."""

    farthest_m: float
    beyond_m: float


def measure_overhang(run: SimulationRun, context: PlanningContext) -> Overhang:
    """How far tractors and implements, lifted or not, reach beyond the outline, and how long beyond what is allowed.

    On the way in and out the gate of the entrance counts as ground of the field.
    """
    grounds = list(_iter_grounds(context))
    farthest_m = beyond_m = 0.0
    for tractor in range(run.plan.tractors):
        poses, passes_gate, is_folded = _list_places(run, tractor)
        is_beyond = np.zeros(len(poses))
        for at_gate, folded, table, ground, allowed in grounds:
            here = np.flatnonzero((passes_gate == at_gate) & (is_folded == folded))
            here = here[table.find(poses[here])]
            shapes = table.place_boxes(poses[here])
            owner = np.repeat(here, len(shapes) // max(len(here), 1))
            is_out = ~shapely.covers(ground, shapes)
            owner, shapes = owner[is_out], shapes[is_out]
            edge = shapely.get_coordinates(shapely.segmentize(shapes, POINT_STEP_M))
            outside = shapely.points(edge[~shapely.intersects_xy(ground, edge)])
            farthest_m = max(farthest_m, float(np.max(shapely.distance(ground, outside), initial=0.0)))
            is_beyond[owner[~shapely.covers(allowed, shapes)]] = 1.0
        steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        beyond_m += float((steps_m * 0.5 * (is_beyond[1:] + is_beyond[:-1])).sum())
    return Overhang(farthest_m, beyond_m)


def _iter_grounds(
    context: PlanningContext,
) -> Iterator[tuple[bool, bool, TouchTable, shapely.Geometry, shapely.Geometry]]:
    """At the gate or not, folded or not: what is touched beyond the ground of the field with the gate, that ground, and
    where parts of machines may be."""
    field = context.layout.field
    outline = shapely.Polygon(field.whole_boundary.exterior)
    region = field.compute_overhang_region(context.request.overhang_m).buffer(TOLERANCE_M)
    for at_gate, gate in ((False, shapely.Polygon()), (True, context.gate_area)):
        ground = unite([outline, gate])
        allowed = unite([region, ground])
        shapely.prepare([ground, allowed])
        beyond = subtract(ground.envelope.buffer(1000.0, join_style="mitre"), ground)  # no machine gets farther
        for folded, state in ((False, context), (True, context.folded)):
            yield at_gate, folded, TouchTable(state, beyond), ground, allowed


def _list_places(run: SimulationRun, tractor: int) -> tuple[Floats, Flags, Flags]:
    """Poses (t, 3) of a tractor that are measured, whether each is on the way in or out, and with it folded."""
    poses = run.get_poses(tractor)
    rows = np.append(np.arange(0, len(poses) - 1, CHECK_ROW_STEP), len(poses) - 1)
    passes_gate = run.find_task_rows(tractor, (ENTER, LEAVE))
    return poses[rows], passes_gate[rows], run.find_folded_rows(tractor)[rows]
