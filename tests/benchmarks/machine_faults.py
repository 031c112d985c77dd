"""Where in a run a plan failed: the leg, the place, speed and bend at the worst excursion, contact or crossing."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import shapely

from fields.arrays import Floats
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import FenceIntrusionCheck, ObstacleIntrusionCheck
from planner.evaluation.ground.coverage import locate_antenna
from planner.evaluation.machine_outlines import build_body
from vehicle.missions.plan import ENTER, LEAVE
from vehicle.missions.run import DONE, SimulationRun
from vehicle.records import REC_SPEED, REC_STEERING

Measure = Callable[[Floats], float]
BEND_BEFORE_M, BEND_SPAN_M, BEND_STEP_M, MIN_BEND_RAD = 30.0, 4.0, 0.5, 0.02
CHUNK_ROWS = 20  # rows of the 10 Hz record searched together
OVERHANG_ROW_STEP = 3
LOST_M = 0.4  # a swath that starts farther beside its line is listed
MIN_REPORTED_M = 0.01


@dataclass(frozen=True)
class FaultPlace:
    """The worst row of a run by one measure: how deep, on which leg, and how it was driven there.

    `bend_deg` and `bend_radius_m` are of the planned leg there and shortly before (radius inf where it is straight),
    `offset_m` is how far the guided point was beside it.
    """

    what: str
    depth_m: float
    tractor: int
    leg: int
    kind: str
    gear: int
    works: bool
    x_m: float
    y_m: float
    speed_kmh: float
    planned_kmh: float
    steering_deg: float
    bend_deg: float
    bend_radius_m: float
    offset_m: float

    def __str__(self) -> str:
        bend = "a straight path"
        if not math.isinf(self.bend_radius_m):
            bend = f"a bend of {self.bend_deg:.0f} deg with {self.bend_radius_m:.1f} m radius"
        way = "reverse" if self.gear < 0 else "forward"
        tool = "working" if self.works else "lifted"
        return (
            f"{self.what} {self.depth_m:.2f} m: tractor {self.tractor + 1} leg {self.leg} ({self.kind}, {way}, "
            f"{tool}) at ({self.x_m:.1f}, {self.y_m:.1f}), {self.speed_kmh:.1f} of {self.planned_kmh:.1f} km/h, "
            f"in {bend}, wheels {self.steering_deg:.0f} deg, {self.offset_m:.2f} m beside its path"
        )


def find_faults(run: SimulationRun, context: PlanningContext) -> list[FaultPlace]:
    """The worst excursion, fence crossing, obstacle contact and start beside a line of a run, those that occur."""
    faults = [fault for what, measure in list_measures(context) if (fault := find_worst(run, context, what, measure))]
    if run.outcome == DONE:
        offset_m, tractor, row = max(_iter_starts(run, context), default=(0.0, 0, 0))
        if offset_m > LOST_M:
            faults.append(_describe_row(run, context, "start beside line", offset_m, tractor, row))
    return faults


def _iter_starts(run: SimulationRun, context: PlanningContext) -> Iterator[tuple[float, int, int]]:
    """How far beside its line work starts after every interruption (m), with tractor and row."""
    for tractor, mission in enumerate(run.plan.missions):
        legs, places = mission.legs, locate_antenna(run.get_poses(tractor), context.tractor.guide_m)
        for number in range(1, len(legs)):
            if legs[number].implement and not legs[number - 1].implement:
                row = int(np.searchsorted(run.get_leg_numbers(tractor), number))
                line, off = np.diff(legs[number].points[:2], axis=0)[0], places[row] - legs[number].points[0]
                yield abs(float(line[0] * off[1] - line[1] * off[0])) / math.hypot(*line), tractor, row


def list_measures(context: PlanningContext) -> Iterator[tuple[str, Measure]]:
    """What is measured of poses (t, 3) of the centre of mass: the greatest depth in metres, 0 for none."""
    ground = context.layout.field.region_without_obstacles
    shapely.prepare(ground)

    def measure_path_outside_m(poses: Floats) -> float:
        path = locate_antenna(poses, context.tractor.guide_m)
        path = path[~shapely.contains_xy(ground, path)]
        return float(np.max(shapely.distance(shapely.points(path), ground), initial=0.0))

    yield "path outside", measure_path_outside_m
    yield "fence crossed", FenceIntrusionCheck(context).measure_intrusion_m
    yield "obstacle touched", ObstacleIntrusionCheck(context).measure_intrusion_m


def find_worst(run: SimulationRun, context: PlanningContext, what: str, measure: Measure) -> FaultPlace | None:
    """The row of a run with the greatest depth; None if it is nowhere over MIN_REPORTED_M."""
    worst_m, place = MIN_REPORTED_M, None
    for tractor in range(run.plan.tractors):
        poses = run.get_poses(tractor)
        if measure(poses) <= worst_m:
            continue
        for first in range(0, len(poses), CHUNK_ROWS):
            if measure(poses[first : first + CHUNK_ROWS]) > worst_m:
                depths = [measure(poses[row : row + 1]) for row in range(first, min(first + CHUNK_ROWS, len(poses)))]
                worst_m, place = max(depths), (tractor, first + int(np.argmax(depths)))
    return None if place is None else _describe_row(run, context, what, worst_m, *place)


def _describe_row(
    run: SimulationRun, context: PlanningContext, what: str, depth_m: float, tractor: int, row: int
) -> FaultPlace:
    number = int(run.get_leg_numbers(tractor)[row])
    leg = run.plan.missions[tractor].legs[number]
    point = locate_antenna(run.get_poses(tractor)[row : row + 1], context.tractor.guide_m)[0]
    bend_rad, bend_radius_m = find_sharpest_bend(leg.points, point)
    speed_mps, steering_rad = run.record[row, tractor, [REC_SPEED, REC_STEERING]].tolist()
    return FaultPlace(
        what=what,
        depth_m=round(depth_m, 3),
        tractor=tractor,
        leg=number,
        kind=leg.task.kind,
        gear=leg.gear,
        works=leg.implement,
        x_m=round(float(point[0]), 2),
        y_m=round(float(point[1]), 2),
        speed_kmh=round(3.6 * speed_mps, 2),
        planned_kmh=round(3.6 * leg.speed_mps, 2),
        steering_deg=round(math.degrees(steering_rad), 1),
        bend_deg=round(math.degrees(bend_rad), 1),
        bend_radius_m=round(bend_radius_m, 2),
        offset_m=round(float(shapely.LineString(leg.points).distance(shapely.Point(point))), 2),
    )


def find_sharpest_bend(line: Floats, place: Floats) -> tuple[float, float]:
    """The turning angle (rad) and the radius (m, over BEND_SPAN_M) of the sharpest bend of a polyline near a place.

    Near is from BEND_BEFORE_M before the point of the line that is closest to BEND_SPAN_M after it; a straight line has
    the angle 0 and the radius inf.
    """
    path = shapely.LineString(line)
    at_m = path.project(shapely.Point(place))
    along = np.arange(max(0.0, at_m - BEND_BEFORE_M), min(path.length, at_m + BEND_SPAN_M), BEND_STEP_M)
    points = shapely.get_coordinates(shapely.line_interpolate_point(path, along))
    if len(points) < 3:
        return 0.0, math.inf
    steps = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    span = min(round(BEND_SPAN_M / BEND_STEP_M), len(heading) - 1)
    turned = float(np.max(np.abs(heading[span:] - heading[:-span])))
    return float(np.ptp(heading)), span * BEND_STEP_M / turned if turned > MIN_BEND_RAD else math.inf


def measure_overhang_m(run: SimulationRun, context: PlanningContext) -> float:
    """How far any corner of tractor or implement was beyond the outline, metres; not on the way in and out."""
    area = shapely.Polygon((context.layout.field.original_boundary or context.layout.field.boundary).exterior)
    body, axle_m = build_body(context.tractor, context.implement), context.tractor.rear_axle_m
    shapely.prepare(area)
    depth_m = 0.0
    for tractor in range(run.plan.tractors):
        passes_gate = np.array([leg.task.kind in (ENTER, LEAVE) for leg in run.plan.missions[tractor].legs])
        inside = ~passes_gate[run.get_leg_numbers(tractor)[::OVERHANG_ROW_STEP]]
        x, y, angle = run.get_poses(tractor)[::OVERHANG_ROW_STEP][inside].T
        axles = np.column_stack([x - axle_m * np.cos(angle), y - axle_m * np.sin(angle), angle])
        corners = np.unique(shapely.get_coordinates(body.place_boxes(axles)), axis=0)
        corners = corners[~shapely.intersects_xy(area, corners)]
        depth_m = max(depth_m, float(np.max(shapely.distance(shapely.points(corners), area), initial=0.0)))
    return depth_m


def measure_driven_km(run: SimulationRun) -> float:
    """Kilometres driven by all tractors of a run."""
    paths = (run.get_poses(tractor)[:, :2] for tractor in range(run.plan.tractors))
    return sum(float(np.hypot(*np.diff(path, axis=0).T).sum()) for path in paths) / 1000.0


def measure_longest_reverse_m(run: SimulationRun) -> float:
    """The longest way (m) driven in reverse in one go, over several legs where they follow each other."""
    longest_m = 0.0
    for mission in run.plan.missions:
        for gear, legs in groupby(mission.legs, key=lambda leg: leg.gear):
            longest_m = max(longest_m, sum(leg.length_m for leg in legs) if gear < 0 else 0.0)
    return longest_m
