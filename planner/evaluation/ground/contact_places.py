"""Where a run touches an obstacle, crosses a fence or leaves the field: what is touched, where, how deep, how far."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from fields.geometry.overlays import subtract, unite
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import InteriorCellTable, measure_excursion_m, measure_outside_m
from planner.evaluation.machine_outlines import build_body
from planner.evaluation.site import MAX_OUTSIDE_M
from reports.common.plan_records import FENCE, OBSTACLE, OUTLINE, PlanFault
from vehicle.jit import compile_function
from vehicle.missions.plan import ENTER, LEAVE
from vehicle.missions.run import SimulationRun

CHECK_ROW_STEP = 2  # rows of the 10 Hz record between checks: under half a metre of driving
TOLERANCE_M = 1e-6
MIN_OVERLAP_M = 0.01  # thinner overlaps do not count
MAX_PARTS = 50  # parts of a shape that are compared with poses one by one
BATCH_SIZE = 100_000  # poses checked together: their points take ten times the memory
Points = npt.NDArray[np.float64]
Boxes = npt.NDArray[np.object_]
MAX_FENCE_CROSSING_M = 0.02  # the thickness of wire
SAME_PLACE_ROWS = 30  # of the 10 Hz record: contacts within three seconds are one
POINT_STEP_M = 0.25  # between the points of a machine's outline whose distance from the field is measured
OVERHANG_TOLERANCE_M = 0.05  # beyond what is allowed does not count: planned paths are followed no closer
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]


class _IntrusionCheck:
    """How far a tractor or its implement is over a shape, which boxes must touch."""

    def __init__(self, context: PlanningContext, shape: shapely.Geometry) -> None:
        self._context, self._shape = context, shape
        shapely.prepare(shape)

    def find_poses_to_check(self, poses: Points) -> npt.NDArray[np.bool_]:
        """Which of the poses (t,) may have a box at the shape; elsewhere the depth is 0."""
        return _find_poses_in_shape_reach(poses, self._context, self._shape)

    def measure_intrusion_m(self, poses: Points) -> float:
        """How far (m) a box reaches over the shape, or a corner of it into a box, at poses (t, 3) of the centre."""
        if self._shape.is_empty:
            return 0.0
        boxes = place_boxes_at(poses[self.find_poses_to_check(poses)], self._context)
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
        return max(_measure_overhang_m(boxes, self._area, self._shape), _measure_post_depth_m(boxes, self._shape))


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


def place_boxes_at(poses: Points, context: PlanningContext) -> Boxes:
    """The boxes of tractor and implement at poses (t, 3) of the centre of mass, one after another for each pose."""
    body, axle_m = build_body(context.tractor, context.implement), context.tractor.rear_axle_m
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return body.place_boxes(np.column_stack([poses[:, :2] - axle_m * ahead, poses[:, 2]]))


def compute_reach_m(context: PlanningContext) -> float:
    """The farthest point (m) of tractor and implement from the centre of mass."""
    return build_body(context.tractor, context.implement).guided_reach_m + context.tractor.rear_axle_m


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


@dataclass(frozen=True)
class ContactPlace:
    """What a tractor or its implement touches or crosses, and where.

    `number` counts the obstacles (Field.solid_obstacles), then the fences of a field; None for the outline. x and y are
    the middle of the tractor where it reaches deepest.
    """

    kind: str
    number: int | None
    name: str
    tractor: int
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
    outline = () if measure_excursion_m(run, context) < MAX_OUTSIDE_M else _iter_outline_places(run, context)
    return (*outline, *_iter_fence_places(run, context), *_iter_obstacle_places(run, context))


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
        for group in _split_rows(rows):
            deepest = int(group[np.argmax(depths_m[group])])
            yield _build_place(run, OUTLINE, None, "the outline", tractor, deepest, float(depths_m[deepest]))


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
        near_rows = rows[check.find_poses_to_check(poses[rows])]
        depths_m = np.array([check.measure_intrusion_m(poses[[row]]) for row in near_rows])
        for group in _split_rows(near_rows[depths_m > MAX_FENCE_CROSSING_M]):
            deepest = int(group[np.argmax(depths_m[np.searchsorted(near_rows, group)])])
            depth_m = float(depths_m[np.searchsorted(near_rows, deepest)])
            nearest = int(np.argmin(shapely.distance(list(fences), shapely.Point(poses[deepest, :2]))))
            yield _build_place(run, FENCE, obstacle_count + nearest, "the fence", tractor, deepest, depth_m)


def _iter_obstacle_places(run: SimulationRun, context: PlanningContext) -> Iterator[ContactPlace]:
    field = context.layout.field
    names = field.obstacle_names
    cores = [shape.buffer(-MIN_OVERLAP_M) for shape in field.solid_obstacles]
    for tractor, rows, state in _iter_states(run, context) if cores else ():
        poses, reach_m = run.get_poses(tractor), compute_reach_m(state)
        rows = rows[find_poses_within_reach(poses[rows], shapely.bounds(cores), reach_m)]
        points = shapely.points(poses[rows, :2])  # made once: they take longer than the distances
        for number, core in enumerate(cores):
            shapely.prepare(core)
            near_rows = rows[shapely.dwithin(core, points, reach_m)]
            if not len(near_rows):
                continue
            boxes = place_boxes_at(poses[near_rows], state).reshape(len(near_rows), -1)
            touching_rows = near_rows[shapely.intersects(core, boxes).any(axis=1)]
            check = ObstacleIntrusionCheck(state, field.solid_obstacles[number])
            for group in _split_rows(touching_rows):
                depths_m = [check.measure_intrusion_m(poses[[row]]) for row in group]
                deepest = int(np.argmax(depths_m))
                row = int(group[deepest])
                yield _build_place(run, OBSTACLE, number, names[number], tractor, row, depths_m[deepest])


def _iter_states(run: SimulationRun, context: PlanningContext) -> Iterator[tuple[int, Rows, PlanningContext]]:
    """Every tractor with the rows of its record that are checked, those with its implement folded apart."""
    rows = np.arange(0, len(run.time_s), CHECK_ROW_STEP)
    for tractor in range(run.plan.tractors):
        is_folded = run.find_folded_rows(tractor)[rows]
        for state, here in ((context, rows[~is_folded]), (context.folded, rows[is_folded])):
            if len(here):
                yield tractor, here, state


def _split_rows(rows: npt.NDArray[np.int64]) -> list[npt.NDArray[np.int64]]:
    """Rows of a record as groups that belong to one place."""
    if not len(rows):
        return []
    return np.split(rows, np.flatnonzero(np.diff(rows) > SAME_PLACE_ROWS) + 1)


def _build_place(
    run: SimulationRun, kind: str, number: int | None, name: str, tractor: int, deepest: int, depth_m: float
) -> ContactPlace:
    """The place where a tractor reaches deepest in a row of the record."""
    x, y = run.get_poses(tractor)[deepest, :2].tolist()
    return ContactPlace(kind, number, name, tractor, x, y, depth_m)


@dataclass(frozen=True)
class Overhang:
    """The farthest that anything reaches beyond the outline, and the length driven beyond what is allowed (m)."""

    farthest_m: float
    beyond_m: float


def measure_overhang(run: SimulationRun, context: PlanningContext) -> Overhang:
    """How far tractors and implements, lifted or not, reach beyond the outline, and how long beyond what is allowed.

    On the way in and out the gate of the entrance counts as ground of the field.
    """
    field = context.layout.field
    outline = shapely.Polygon(field.whole_boundary.exterior)
    region = field.compute_overhang_region(context.request.overhang_m)
    table = InteriorCellTable(outline, compute_reach_m(context))
    grounds = [_build_grounds(outline, region, gate) for gate in (shapely.Polygon(), context.gate_area)]
    farthest_m = beyond_m = 0.0
    for tractor in range(run.plan.tractors):
        poses, passes_gate, is_folded = _list_places(run, tractor)
        is_beyond = np.zeros(len(poses))
        near = table.find_uncertain(poses)
        for state, (ground, allowed), here in _iter_parts(context, grounds, near, passes_gate, is_folded):
            shapes = place_boxes_at(poses[here], state)
            owner = np.repeat(here, len(shapes) // max(len(here), 1))
            is_out = ~shapely.covers(ground, shapes)
            owner, shapes = owner[is_out], shapes[is_out]
            farthest_m = max(farthest_m, _measure_farthest_m(shapes, ground))
            is_beyond[owner[~shapely.covers(allowed, shapes)]] = 1.0
        steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        beyond_m += float((steps_m * 0.5 * (is_beyond[1:] + is_beyond[:-1])).sum())
    return Overhang(farthest_m, beyond_m)


def _build_grounds(
    outline: shapely.Polygon, region: shapely.Geometry, gate: shapely.Geometry
) -> tuple[shapely.Geometry, shapely.Geometry]:
    """The ground of the field, and where parts of machines may be, both with the gate."""
    ground = unite([outline, gate])
    allowed = unite([region.buffer(OVERHANG_TOLERANCE_M), ground])
    shapely.prepare([ground, allowed])
    return ground, allowed


def _iter_parts(
    context: PlanningContext,
    grounds: Sequence[tuple[shapely.Geometry, shapely.Geometry]],
    near: Rows,
    passes_gate: Flags,
    is_folded: Flags,
) -> Iterator[tuple[PlanningContext, tuple[shapely.Geometry, shapely.Geometry], Rows]]:
    """The machine and the grounds, on the field and at the gate, with the places where each holds."""
    for state, has_state in ((context, ~is_folded), (context.folded, is_folded)):
        for ground, has_ground in zip(grounds, (~passes_gate, passes_gate), strict=True):
            here = near[has_state[near] & has_ground[near]]
            if len(here):
                yield state, ground, here


def _list_places(run: SimulationRun, tractor: int) -> tuple[Points, Flags, Flags]:
    """Poses (t, 3) of a tractor that are measured, whether each is on the way in or out, and with it folded."""
    poses = run.get_poses(tractor)
    rows = np.append(np.arange(0, len(poses) - 1, CHECK_ROW_STEP), len(poses) - 1)
    passes_gate = run.find_task_rows(tractor, (ENTER, LEAVE))
    return poses[rows], passes_gate[rows], run.find_folded_rows(tractor)[rows]


def _measure_farthest_m(shapes: npt.NDArray[np.object_], ground: shapely.Geometry) -> float:
    """The farthest (m) that the edge of any of some shapes is from the ground; 0 without shapes."""
    points = shapely.points(shapely.get_coordinates(shapely.segmentize(shapes, POINT_STEP_M)))
    outside = points[~shapely.intersects(ground, points)]
    return float(np.max(shapely.distance(ground, outside), initial=0.0))
