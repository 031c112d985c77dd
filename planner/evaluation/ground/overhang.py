"""How far tractors and implements reach beyond the outline of a field, measured from the record of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import InteriorCellTable
from planner.evaluation.machine_outlines import build_body
from strategies.path_planning.machine_body import MachineBody
from vehicle.missions.plan import ENTER, LEAVE
from vehicle.missions.run import SimulationRun

ROW_STEP = 2  # rows of the 10 Hz record between places that are measured
POINT_STEP_M = 0.25  # between the points of a machine's outline whose distance from the field is measured
TOLERANCE_M = 0.05  # reaching less far beyond what is allowed does not count: planned paths are followed no closer
Points = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


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
    outline = shapely.Polygon((field.original_boundary or field.boundary).exterior)
    region = field.compute_overhang_region(context.request.overhang_m)
    body, axle_m = build_body(context.tractor, context.implement), context.tractor.rear_axle_m
    table = InteriorCellTable(outline, body.reach_m + axle_m)
    grounds = [_build_grounds(outline, region, gate) for gate in (shapely.Polygon(), context.gate_area)]
    farthest_m = beyond_m = 0.0
    for tractor in range(run.plan.tractors):
        poses, passes_gate = _list_places(run, tractor)
        is_beyond = np.zeros(len(poses))
        near = table.find_uncertain(poses)
        for (ground, allowed), here in zip(grounds, (near[~passes_gate[near]], near[passes_gate[near]]), strict=True):
            owner, shapes = _place_machines(body, axle_m, poses[here])
            is_out = ~shapely.covers(ground, shapes)
            owner, shapes = here[owner[is_out]], shapes[is_out]
            farthest_m = max(farthest_m, _measure_farthest_m(shapes, ground))
            is_beyond[owner[~shapely.covers(allowed, shapes)]] = 1.0
        steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        beyond_m += float(steps_m @ (0.5 * (is_beyond[1:] + is_beyond[:-1])))
    return Overhang(farthest_m, beyond_m)


def _build_grounds(
    outline: shapely.Polygon, region: shapely.Geometry, gate: shapely.Geometry
) -> tuple[shapely.Geometry, shapely.Geometry]:
    """The ground of the field, and where parts of machines may be, both with the gate."""
    ground = shapely.union(outline, gate)
    allowed = shapely.union(region.buffer(TOLERANCE_M), ground)
    shapely.prepare([ground, allowed])
    return ground, allowed


def _list_places(run: SimulationRun, tractor: int) -> tuple[Points, Flags]:
    """Poses (t, 3) of a tractor that are measured, and whether each is on the way in or out."""
    poses = run.get_poses(tractor)
    rows = np.append(np.arange(0, len(poses) - 1, ROW_STEP), len(poses) - 1)
    passes_gate = np.array([leg.task.kind in (ENTER, LEAVE) for leg in run.plan.missions[tractor].legs], dtype=bool)
    return poses[rows], passes_gate[run.get_leg_numbers(tractor)[rows]]


def _place_machines(
    body: MachineBody, axle_m: float, poses: Points
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.object_]]:
    """The boxes of tractor and implement at poses (t, 3) of the centre of mass, and the number of the pose of each."""
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    boxes = body.place_boxes(np.column_stack([poses[:, :2] - axle_m * ahead, poses[:, 2]]))
    return np.repeat(np.arange(len(poses)), len(body.boxes)), boxes


def _measure_farthest_m(shapes: npt.NDArray[np.object_], ground: shapely.Geometry) -> float:
    """The farthest (m) that the edge of any of some shapes is from the ground; 0 without shapes."""
    points = shapely.points(shapely.get_coordinates(shapely.segmentize(shapes, POINT_STEP_M)))
    outside = points[~shapely.intersects(ground, points)]
    return float(np.max(shapely.distance(ground, outside), initial=0.0))
