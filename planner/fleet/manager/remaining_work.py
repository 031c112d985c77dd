"""The remaining work of a live fleet: a copy to replan from, and the check that it still holds."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from fields.arrays import SHORTEST_PIECE_M, Floats
from planner.fleet.manager.fleet_state import FleetState
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.model.tractor_state import BY_HAND, MANUAL, REMOTE, Hold, TractorState
from planner.fleet.safety.motion_prediction import compute_braking_distance_m

STAND_TOLERANCE_M = 1.0  # of a tractor that stands
LOST_STEP_M = 1.0  # between the places that one who hears nothing may go on to: a part of its length


@dataclass(frozen=True, eq=False)
class RemainingWork:
    """A snapshot of a fleet: plan, tractors, excluded tractors, and obstacles.

    `paths` are the poses (steps, 3) that excluded tractors may have gone on to which were heard last as they moved.
    """

    plan: FleetPlan
    states: tuple[TractorState, ...]
    excluded: tuple[int, ...]
    obstacles: tuple[shapely.Polygon, ...]
    elapsed_s: float
    times: float
    paths: Mapping[int, Floats] = field(default_factory=dict)

    def has_tractor_driven(self, number: int) -> bool:
        """Whether a tractor has driven anything of its plan."""
        state = self.states[number]
        return state.leg > 0 or state.leg_m > SHORTEST_PIECE_M

    def count_base_legs(self, number: int) -> int:
        """How many legs a tractor cannot be told to wait on, from the present one on: it drives, or they are
        released."""
        state = self.states[number]
        return max(state.base_end - state.leg, 1 if self.has_tractor_driven(number) else 0)

    def stays(self, number: int, leg_count: int) -> bool:
        """Whether a tractor drives no more: it is excluded, or at the end of its `leg_count` legs."""
        state = self.states[number]
        return number in self.excluded or (state.done and state.leg >= leg_count - 1)

    def is_on_road(self, number: int) -> bool:
        """Whether a tractor stands on the road: it has not entered yet, or has left."""
        mission = self.plan.plan.missions[number]
        return (mission.enters and not self.has_tractor_driven(number)) or (mission.leaves and self.states[number].done)

    def get_pose(self, number: int) -> tuple[float, float, float]:
        """The reported pose of a tractor, or the one by its progress: x, y (m), heading (rad)."""
        state = self.states[number]
        if state.report is not None:
            return state.report.x_m, state.report.y_m, state.report.heading_rad
        leg, leg_count = min(state.leg, len(state.mission.legs) - 1), len(state.mission.legs)
        x, y, heading = state.mission.find_pose(leg, state.leg_m, leg_count)
        return float(x), float(y), float(heading)


def extract_remaining_work(fleet: FleetState, without: Sequence[int], now: float) -> RemainingWork:
    """The remaining work of a fleet without these tractors and the failed ones. Raises FleetManagerError."""
    excluded = tuple(sorted({*without, *(n for n, state in enumerate(fleet.states) if state.has_no_more_legs)}))
    if len(excluded) == len(fleet.states):
        raise FleetManagerError("No tractor remains to take over; keep at least one.", parameter="without")
    if fleet.plan.field is None:
        raise FleetManagerError(
            "The field of this plan is unknown; create the fleet with its field file.", parameter="field"
        )
    _check_on_legs(fleet, excluded)
    states = tuple(copy.copy(state) for state in fleet.states)
    elapsed_s = 0.0 if fleet.started_s is None else (now - fleet.started_s) * fleet.rules.times
    shapes = tuple(block.shape for block in fleet.obstacles.items.values())
    lost = [number for number in excluded if _is_lost_in_motion(fleet, number)]
    paths = {number: _predict_lost_path(fleet, number) for number in lost}
    return RemainingWork(fleet.plan, states, excluded, shapes, elapsed_s, fleet.rules.times, paths)


def _is_lost_in_motion(fleet: FleetState, number: int) -> bool:
    """Whether a tractor moved when it was heard last: it is watched as going on from there."""
    return fleet.states[number].is_moving and not fleet.is_report_current(number)


def _predict_lost_path(fleet: FleetState, number: int) -> Floats:
    """The poses (steps, 3) that a tractor which hears nothing may go on to: to the end of its base, by its guidance."""
    state = fleet.states[number]
    if state.mode in BY_HAND:
        predicted: Floats = fleet.guard.predict_paths(fleet.states, [number])[0]
        return predicted
    ahead_m = np.arange(0.0, max(state.base_end_m - state.position_m, 0.0) + LOST_STEP_M, LOST_STEP_M)
    return state.mission.sample_poses(state.leg, state.leg_m, ahead_m, state.base_end)


def _check_on_legs(fleet: FleetState, excluded: Sequence[int]) -> None:
    """Raise FleetManagerError for a tractor that was led off its leg but is to drive on: plans start on the leg."""
    for number, state in enumerate(fleet.states):
        report = state.report
        is_led = Hold.REMOTE_CONTROL in state.holds or state.mode in (REMOTE, MANUAL)
        if number in excluded or state.done or report is None or not is_led:
            continue
        offset_m = state.mission.compute_distance_to_leg_m(state.leg, (report.x_m, report.y_m))
        if offset_m > fleet.rules.rejoin_m:
            raise FleetManagerError(
                f"Tractor {number + 1} stands {offset_m:.1f} m off its leg; drive it back to within "
                f"{fleet.rules.rejoin_m:g} m, or plan without it.",
                parameter="without",
            )


def check_proposal_still_fits(
    remaining: RemainingWork, fleet: FleetState, proposed_plan: FleetPlan | None = None
) -> None:
    """Raise FleetManagerError if `proposed_plan`, made of this remaining work, does not fit the fleet any more.

    That is so if another plan is driven, if a tractor has failed since, or if one that was excluded, or has to wait
    where it stood, has moved by more than its braking, or was lost in motion. The progress of the others is checked
    when the plan is adopted.
    """
    if fleet.plan is not remaining.plan:
        raise FleetManagerError("Another plan was accepted since this one was made; replan.", parameter="proposal")
    for number, (state, previous) in enumerate(zip(fleet.states, remaining.states, strict=True)):
        if state.failed and number not in remaining.excluded:
            raise FleetManagerError(
                f"Tractor {number + 1} has failed since the plan was made; replan.", parameter="proposal"
            )
        if number in remaining.excluded and number not in remaining.paths and _is_lost_in_motion(fleet, number):
            raise FleetManagerError(
                f"The link to tractor {number + 1} broke as it moved, after the plan was made; replan.",
                parameter="proposal",
            )
        moved_m, speed_mps = 0.0, 0.0 if previous.report is None else previous.report.speed_mps
        if state.report is not None:
            moved_m = math.inf if previous.report is None else math.dist(state.report[:2], previous.report[:2])
        may_roll_m = (
            STAND_TOLERANCE_M
            + speed_mps * fleet.rules.reaction_s * remaining.times
            + compute_braking_distance_m(speed_mps, fleet.rules)
        )
        has_moved = state.leg > previous.leg or moved_m > may_roll_m
        must_wait = (
            proposed_plan is not None
            and remaining.has_tractor_driven(number)
            and bool(proposed_plan.timed_missions[number].legs[previous.leg].gates)
        )
        if must_wait and has_moved:
            raise FleetManagerError(
                f"Tractor {number + 1} was to wait where it stood and has moved {moved_m:.1f} m; pause it and replan.",
                parameter="proposal",
            )
        if number in remaining.excluded and has_moved:
            raise FleetManagerError(
                f"Tractor {number + 1} has moved {moved_m:.1f} m since the plan was made without it; "
                "stop it and replan.",
                parameter="proposal",
            )
    _check_on_legs(fleet, remaining.excluded)
