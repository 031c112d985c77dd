"""Predicted paths of tractors for the next seconds: along base legs, or on the arc of their steering; their outlines,
and where one in doubt may be: a circle that grows with its last credible speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fields.arrays import Floats
from fields.geometry.overlays import unite
from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import AUTOMATIC, MANUAL, REMOTE, TractorReport, TractorState
from strategies.path_planning.machine_body import MachineBody, MachineBox
from vehicle.model.tractor import Tractor

STEP_S = 0.5
STRAIGHT_RAD = 1e-4
ROUNDING_M = 0.01  # rounding, of distances that must not become smaller
PREDICTION_ERROR_M = 0.15  # of poses predicted along legs

AnyArray = npt.NDArray[Any]
TractorKey = tuple[str, int]
"""Id of a fleet, and the number of its tractor from 0."""
NearPair = tuple[int, int | TractorKey]
"""A tractor, and another one of its fleet or of a neighbouring fleet."""


class TwinPredictions:
    """Predictions of the twins, in metres of the plan at the guided point; these here know no tractor."""

    def find_place(self, number: int) -> tuple[float, float] | None:
        """Where a tractor is now: x, y; None if unknown."""
        return None

    def predict_path(self, number: int, times_s: Floats) -> Floats | None:
        """Poses (steps, 3) of a tractor at times from now on, if its command stays the same; None if unknown."""
        return None


def build_time_steps(rules: FleetRules) -> Floats:
    """The times (steps,) ahead of predictions, seconds from 0."""
    return np.arange(0.0, rules.ahead_s + 0.5 * STEP_S, STEP_S)


def build_standing_path(report: TractorReport, rules: FleetRules) -> Floats:
    """The poses (steps, 3) of an antenna that does not move."""
    return np.tile([report.x_m, report.y_m, report.heading_rad], (len(build_time_steps(rules)), 1))


def predict_path(
    state: TractorState,
    tractor: Tractor,
    rules: FleetRules,
    *,
    goes_on: bool = False,
    twin_path: Floats | None = None,
    times_s: Floats | None = None,
) -> Floats:
    """Predict poses (steps, 3) of the antenna at `times_s` from now, by default those of `build_time_steps`: x, y (m)
    and mathematical heading (rad).

    With `goes_on` it drives on at the speed of its leg despite its holds. `twin_path` is the prediction of its twin,
    used when it is driven by hand: the twin models the lag of steering and engine.
    """
    report = state.report
    assert report is not None
    times_s = build_time_steps(rules) if times_s is None else times_s
    if goes_on or (report.mode == AUTOMATIC and state.doubt is None):  # else its progress on its leg is not believed
        speed_mps = max(abs(report.speed_mps), abs(report.speed_command_mps))
        metres = speed_mps * times_s
        if goes_on:
            metres = max(speed_mps, state.present_leg.speed_mps) * times_s
        elif state.holds:
            metres = np.minimum(metres, compute_braking_distance_m(speed_mps, rules))
        leg = min(state.leg, len(state.mission.legs) - 1)
        poses = state.mission.sample_poses(leg, state.leg_m, metres, state.base_end)
        poses[0] = report.x_m, report.y_m, report.heading_rad
        return poses
    if twin_path is not None and report.mode in (REMOTE, MANUAL):
        return twin_path
    return predict_arc(report, tractor, report.velocity_mps, get_wheel_angle_rad(report), rules, times_s)


def get_wheel_angle_rad(report: TractorReport) -> float:
    """The wheel angle of a report: measured if there is one, else commanded."""
    return report.steering_command_rad if report.steering_rad is None else report.steering_rad


def predict_arc(
    report: TractorReport,
    tractor: Tractor,
    velocity_mps: float,
    steering_rad: float,
    rules: FleetRules,
    times_s: Floats | None = None,
) -> Floats:
    """Poses (steps, 3) at constant speed and wheel angle (positive right): a kinematic bicycle model."""
    times_s = build_time_steps(rules) if times_s is None else times_s
    antenna_forward_m = tractor.antenna_forward_m
    x = report.x_m - antenna_forward_m * math.cos(report.heading_rad)
    y = report.y_m - antenna_forward_m * math.sin(report.heading_rad)
    curvature = -math.tan(steering_rad) / (tractor.front_axle_m + tractor.rear_axle_m)
    headings_rad = report.heading_rad + curvature * velocity_mps * times_s
    if abs(curvature) < STRAIGHT_RAD:
        rear_x = x + velocity_mps * times_s * math.cos(report.heading_rad)
        rear_y = y + velocity_mps * times_s * math.sin(report.heading_rad)
    else:
        radius_m = 1.0 / curvature
        rear_x = x + radius_m * (np.sin(headings_rad) - math.sin(report.heading_rad))
        rear_y = y - radius_m * (np.cos(headings_rad) - math.cos(report.heading_rad))
    antenna_x = rear_x + antenna_forward_m * np.cos(headings_rad)
    return np.column_stack([antenna_x, rear_y + antenna_forward_m * np.sin(headings_rad), headings_rad])


def compute_braking_distance_m(speed_mps: float, rules: FleetRules) -> float:
    """Braking distance, metres."""
    return speed_mps * speed_mps / (2.0 * rules.deceleration_mps2)


def compute_stopping_time_s(speed_mps: float, rules: FleetRules) -> float:
    """Seconds (of the simulated clock) from an order to stop to standstill, reaction included."""
    return abs(speed_mps) / rules.deceleration_mps2 + rules.reaction_s * rules.times


def compute_centre_poses(poses: Floats, tractor: Tractor) -> Floats:
    """Poses of the centre of mass from poses (..., 3) of the antenna."""
    moved = poses.copy()
    moved[..., 0] -= tractor.guide_m * np.cos(poses[..., 2])
    moved[..., 1] -= tractor.guide_m * np.sin(poses[..., 2])
    return moved


def is_leading_away(path: Floats, place: Floats, distances_m: Floats, least_m: float) -> bool:
    """Whether a path (steps, 3) leads away to `least_m` from a machine at `place`, and not back; judged by the
    distances (steps,) of the outlines, and by the distance of the centres until then."""
    far_steps = np.flatnonzero(distances_m >= least_m)
    far_step = int(far_steps[0]) + 1 if len(far_steps) else len(distances_m)
    centre_distances_m = np.hypot(*(path[:far_step, :2] - place[:2]).T)
    if (np.maximum.accumulate(centre_distances_m) - centre_distances_m).max() > PREDICTION_ERROR_M:
        return False
    return bool(
        (distances_m >= min(distances_m[0] - ROUNDING_M, least_m)).all() and (distances_m[far_step:] >= least_m).all()
    )


def list_boxes(model: AnyArray) -> tuple[MachineBox, ...]:
    """The boxes of the tractor and implement of a compiled record: tail, nose and half width from the centre of mass
    (m)."""
    names = ("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width")
    return tuple((float(model[rear]), float(model[front]), float(model[half])) for rear, front, half in names)


def place_outlines(model: AnyArray, poses: Floats) -> npt.NDArray[np.object_]:
    """The outlines of the machine of a compiled record at poses (n, 3) of its centre of mass."""
    boxes = MachineBody(list_boxes(model), 0.0).place_boxes(poses)
    return np.array([unite(of_one) for of_one in boxes.reshape(len(poses), -1)], dtype=np.object_)


@dataclass(frozen=True)
class SafetyDanger:
    """Two tractors will be too near, or one will leave the fence (`second` is None), in `in_s` seconds.

    `is_urgent` if only the time to stop remains. `distance_m` is the first distance that is too small, and
    `least_distance_m` the smallest predicted. `second` may be a tractor of another fleet.
    """

    first: int
    second: int | TractorKey | None
    in_s: float
    distance_m: float
    is_urgent: bool
    least_distance_m: float = 0.0


def sort_pair(first: int, second: int | TractorKey) -> NearPair:
    """A pair of one fleet has its lower number first."""
    return (min(first, second), max(first, second)) if isinstance(second, int) else (first, second)


@dataclass(frozen=True, eq=False)
class PossibleArea:
    """The ground that may be under a machine: within `radii_m` (steps,) of `centre` (2,), in metres of the observing
    fleet and at its time steps. Others keep `clearance_m` from it, and `release_m` if they stand and would resume."""

    key: int | TractorKey
    centre: Floats
    radii_m: Floats
    clearance_m: float
    release_m: float

    def measure_distances_m(self, poses: Floats, boxes: Floats) -> Floats:
        """Distances (..., steps), negative inside, from machines with `boxes` (n, 3) of tail, nose and half width.

        `poses` (..., steps, 3) are of their centre of mass, at the first of the time steps.
        """
        east_m, north_m = self.centre[0] - poses[..., 0], self.centre[1] - poses[..., 1]
        cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
        ahead_m, aside_m = (cos * east_m + sin * north_m)[..., None], (cos * north_m - sin * east_m)[..., None]
        tail_m, nose_m, half_m = boxes.T
        beyond_m = np.maximum(np.maximum(tail_m - ahead_m, ahead_m - nose_m), 0.0)
        beside_m = np.maximum(np.abs(aside_m) - half_m, 0.0)
        distances_m: Floats = np.hypot(beyond_m, beside_m).min(axis=-1) - self.radii_m[: poses.shape[-2]]
        return distances_m


@dataclass(frozen=True, eq=False)
class WatchedTractor:
    """A tractor that others keep away from, in metres and at the time steps of the observing fleet.

    `path` (steps, 3) are predicted poses of its centre of mass, `model` is its compiled record. `is_queueing` means
    that it stands at its entrance, see `SafetyGuard.is_queueing`; tractors of the observing fleet do not count as such.
    """

    path: AnyArray
    model: AnyArray
    is_queueing: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class NeighbourTractor(WatchedTractor):
    """A tractor of another fleet, in seconds of the observing fleet.

    `is_waiting` means that it stands because another is near and will resume by itself, `is_free` that its path is
    clear now, `has_priority` that its fleet has the right of way, and `is_linked` that orders can reach it. `area` is
    where it may be if it is in doubt.
    """

    key: TractorKey
    name: str
    fleet: str
    speed_mps: float
    braking_s: float
    is_waiting: bool
    is_free: bool
    has_priority: bool
    is_linked: bool
    area: PossibleArea | None


class NeighbourFleets:
    """The other fleets near one: here none; see planner.fleet.manager.neighbourhood."""

    def find_nearby_tractors(self) -> list[NeighbourTractor]:
        """The tractors of other fleets that could come near."""
        return []

    def stop_neighbour_fleets(self, who: str, now: float) -> list[str]:
        """Stop all neighbouring fleets; returns their names."""
        return []

    def restart_waiting_times(self) -> None:
        """A tractor of this fleet resumes: waiting tractors of the others start their waiting time again."""
