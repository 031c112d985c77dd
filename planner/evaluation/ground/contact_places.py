"""Places where a run touches an obstacle, crosses a fence or leaves the field: what is touched, where, and how deep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_checks import (
    CHECK_ROW_STEP,
    MIN_OVERLAP_M,
    FenceIntrusionCheck,
    ObstacleIntrusionCheck,
    compute_reach_m,
    find_poses_within_reach,
    place_boxes_at,
)
from planner.evaluation.ground.coverage import measure_excursion_m, measure_outside_m
from planner.evaluation.site import MAX_OUTSIDE_M
from reports.common.plan_results import FENCE, OBSTACLE, OUTLINE, PlanFault
from vehicle.missions.run import SimulationRun

MAX_FENCE_CROSSING_M = 0.02  # the thickness of wire
SAME_PLACE_ROWS = 30  # of the 10 Hz record: contacts within three seconds are one
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ContactPlace:
    """What a tractor or its implement touches or crosses, and where.

    `number` counts the obstacles (Field.solid_obstacles), then the fences of a field; None for the outline. The rows
    are those of the record between which it happens, x and y the middle of the tractor where it reaches deepest.
    """

    kind: str
    number: int | None
    name: str
    tractor: int
    first_row: int
    last_row: int
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
        depths_m = measure_outside_m(run.get_poses(tractor), context)
        rows = np.flatnonzero(depths_m >= MAX_OUTSIDE_M)
        for group in _split_rows(rows):
            deepest = int(group[np.argmax(depths_m[group])])
            yield _build_place(run, OUTLINE, None, "the outline", tractor, group, deepest, float(depths_m[deepest]))


def _iter_fence_places(run: SimulationRun, context: PlanningContext) -> Iterator[ContactPlace]:
    fences = context.layout.field.fences
    if not fences:
        return
    check, obstacle_count = FenceIntrusionCheck(context), len(context.layout.field.solid_obstacles)
    for tractor in range(run.plan.tractors):
        poses = run.get_poses(tractor)
        if check.measure_intrusion_m(poses[::CHECK_ROW_STEP]) <= MAX_FENCE_CROSSING_M:
            continue
        near_rows = CHECK_ROW_STEP * np.flatnonzero(check.find_poses_to_check(poses[::CHECK_ROW_STEP]))
        depths_m = np.array([check.measure_intrusion_m(poses[[row]]) for row in near_rows])
        for group in _split_rows(near_rows[depths_m > MAX_FENCE_CROSSING_M]):
            deepest = int(group[np.argmax(depths_m[np.searchsorted(near_rows, group)])])
            depth_m = float(depths_m[np.searchsorted(near_rows, deepest)])
            nearest = int(np.argmin(shapely.distance(list(fences), shapely.Point(poses[deepest, :2]))))
            yield _build_place(run, FENCE, obstacle_count + nearest, "the fence", tractor, group, deepest, depth_m)


def _iter_obstacle_places(run: SimulationRun, context: PlanningContext) -> Iterator[ContactPlace]:
    field = context.layout.field
    names = field.obstacle_names
    cores = [shape.buffer(-MIN_OVERLAP_M) for shape in field.solid_obstacles]
    for tractor in range(run.plan.tractors if cores else 0):
        rows = np.arange(0, len(run.time_s), CHECK_ROW_STEP)
        poses = run.get_poses(tractor)
        reach_m = compute_reach_m(context)
        rows = rows[find_poses_within_reach(poses[rows], shapely.bounds(cores), reach_m)]
        points = shapely.points(poses[rows, :2])  # made once: they take longer than the distances
        for number, core in enumerate(cores):
            shapely.prepare(core)
            near_rows = rows[shapely.dwithin(core, points, reach_m)]
            if not len(near_rows):
                continue
            boxes = place_boxes_at(poses[near_rows], context).reshape(len(near_rows), -1)
            touching_rows = near_rows[shapely.intersects(core, boxes).any(axis=1)]
            check = ObstacleIntrusionCheck(context, field.solid_obstacles[number])
            for group in _split_rows(touching_rows):
                depths_m = [check.measure_intrusion_m(poses[[row]]) for row in group]
                deepest = int(np.argmax(depths_m))
                yield _build_place(
                    run, OBSTACLE, number, names[number], tractor, group, int(group[deepest]), depths_m[deepest]
                )


def _split_rows(rows: npt.NDArray[np.int64]) -> list[npt.NDArray[np.int64]]:
    """Rows of a record as groups that belong to one place."""
    if not len(rows):
        return []
    return np.split(rows, np.flatnonzero(np.diff(rows) > SAME_PLACE_ROWS) + 1)


def _build_place(
    run: SimulationRun,
    kind: str,
    number: int | None,
    name: str,
    tractor: int,
    rows: npt.NDArray[np.int64],
    deepest: int,
    depth_m: float,
) -> ContactPlace:
    x, y = run.get_poses(tractor)[deepest, :2].tolist()
    return ContactPlace(kind, number, name, tractor, int(rows[0]), int(rows[-1]), x, y, depth_m)
