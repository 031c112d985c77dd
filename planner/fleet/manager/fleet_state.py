"""The state of a fleet: plan, tractors, who drives them, obstacles, coverage, and pending orders and events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from planner.fleet.model.alarms import AlarmRegister
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import ControlLeaseError, FleetManagerError, FleetRules
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import MOVING_MPS, FleetEvent, Hold, TractorOrder, TractorState
from planner.fleet.safety.motion_prediction import NeighbourFleets, TwinPredictions
from planner.fleet.safety.safety_guard import SafetyGuard

MOST_OBSTACLES, MOST_PER_REPORTER = 100, 20
SAME_PLACE_M = 0.5  # by which an obstacle that is reported again may have moved
Ring = tuple[tuple[float, float], ...]
COVERAGE_STEP_M = 1.0
MOST_COVERAGE_POINTS = 20_000  # per tractor: 20 km of track
CoveragePoint = tuple[float, float] | None
"""A place in metres of the plan; None where the implement was lifted."""

READY, RUNNING, STOPPED, DONE = "ready", "running", "stopped", "done"
DOUBT_CODE = "contradiction"  # of the alarm of a tractor in doubt
FLEET_MANAGER = "centre"


@dataclass(frozen=True)
class FleetObstacle:
    """One obstacle in metres of the plan."""

    id: int
    name: str
    who: str
    ring: Ring
    shape: shapely.Polygon


class ObstacleMap:
    """The present obstacles; `version` increases with every change."""

    def __init__(self, reach_m: float) -> None:
        self.reach_m = reach_m  # a leg whose line comes nearer than this to an obstacle is blocked
        self.items: dict[int, FleetObstacle] = {}
        self.version = 0
        self._last = 0

    def add(self, ring: Ring, name: str, who: str) -> FleetObstacle:
        """Add an obstacle. Raises FleetManagerError for too many, or for an outline that is not a polygon."""
        if len(self.items) >= MOST_OBSTACLES:
            raise FleetManagerError(
                f"There are {MOST_OBSTACLES} obstacles already, the most allowed; clear those that are gone first."
            )
        if sum(obstacle.who == who for obstacle in self.items.values()) >= MOST_PER_REPORTER:
            raise FleetManagerError(
                f"{who.capitalize()} has reported {MOST_PER_REPORTER} obstacles not cleared yet, the most allowed; "
                "clear those that are gone first."
            )
        shape = _build_valid_polygon(ring)
        if shape is None or shape.area <= 0.0:
            raise FleetManagerError(
                "The outline of the obstacle is not a polygon; give three or more corners that do not cross.",
                parameter="polygon_m",
            )
        self._last += 1
        obstacle = FleetObstacle(self._last, name, who, ring, shape)
        self.items[obstacle.id] = obstacle
        self.version += 1
        return obstacle

    def find_containing_obstacle(self, ring: Ring, who: str) -> FleetObstacle | None:
        """An obstacle of the same reporter that contains this outline, up to SAME_PLACE_M; None if there is none."""
        shape = _build_valid_polygon(ring)
        if shape is None:
            return None
        own = (obstacle for obstacle in self.items.values() if obstacle.who == who)
        return next(
            (obstacle for obstacle in own if shapely.buffer(obstacle.shape, SAME_PLACE_M).contains(shape)), None
        )

    def remove_obstacle(self, number: int) -> None:
        """Remove an obstacle. Raises FleetManagerError if there is none of this number."""
        if self.items.pop(number, None) is None:
            raise FleetManagerError(f"There is no obstacle {number}; it was already cleared.", parameter="obstacle")
        self.version += 1

    def find_blocked_legs(self, mission: TimedMission) -> dict[int, str]:
        """Legs that an obstacle blocks, with its name."""
        names: dict[int, str] = {}
        for obstacle in self.items.values():
            for leg in np.flatnonzero(shapely.dwithin(mission.lines, obstacle.shape, self.reach_m)).tolist():
                names.setdefault(leg, obstacle.name)
        return names

    def is_on_base(self, state: TractorState, leg_m: float) -> bool:
        """Whether an obstacle lies on the rest of the base of a tractor that is `leg_m` along its leg."""
        if not self.items or state.leg >= state.base_end:
            return False
        remaining_m = max(state.base_end_m - state.mission.leg_starts_m[state.leg] - leg_m, 0.0)
        distances_m = np.append(np.arange(0.0, remaining_m, 0.5), remaining_m)
        points = state.mission.sample_poses(state.leg, leg_m, distances_m, state.base_end)[:, :2]
        line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        return any(shapely.dwithin(line, obstacle.shape, self.reach_m) for obstacle in self.items.values())


def _build_valid_polygon(ring: Ring) -> shapely.Polygon | None:
    """The polygon of a ring; None if its corners do not make one."""
    shape = shapely.Polygon(ring) if len(ring) > 2 else None
    return shape if shape is not None and shape.is_valid else None


def join_fleet_names(names: Sequence[str]) -> str:
    """Names of fleets for a sentence: fleet 'a', fleet 'b' and fleet 'c'."""
    *first, last = [f"fleet {name!r}" for name in names]
    return f"{', '.join(first)} and {last}" if first else last


class FleetState:
    """State of a fleet, with pending orders and events.

    `lease_holders` drive tractors by remote control; a holder is one link of one operator. `coverage_lines` are those
    of the guided point of each tractor while its implement is down.
    """

    def __init__(self, plan: FleetPlan, rules: FleetRules, twins: TwinPredictions | None = None) -> None:
        self.plan, self.rules, self.twins = plan, rules, twins or TwinPredictions()
        self.version = 1
        self.state = READY
        self.started_s: float | None = None
        self.states = [TractorState(mission) for mission in plan.timed_missions]
        self.lease_holders, self.alarms = dict[int, str](), AlarmRegister()
        reach_m = 0.5 * max(plan.tractor.width_m, plan.implement.contact_width_m) + rules.obstacle_margin_m
        self.obstacles = ObstacleMap(reach_m)
        self.blocked_legs: list[dict[int, str]] = [{} for _ in plan.timed_missions]
        self.coverage_lines: list[list[CoveragePoint]] = [[] for _ in plan.timed_missions]
        self.guard = SafetyGuard(plan, rules, self.twins)
        self.neighbours = NeighbourFleets()
        self.finish_in_s, self.forecast_at_s = [math.inf] * plan.tractor_count, -math.inf
        self._orders: list[TractorOrder] = []
        self._events: list[FleetEvent] = []

    @property
    def scene_version(self) -> int:
        """Another number once the plan or the obstacles are others, whose versions only grow."""
        return self.version + self.obstacles.version

    def take_outputs(self) -> tuple[list[TractorOrder], list[FleetEvent]]:
        """Orders and events since the last call."""
        orders, events = self._orders, self._events
        self._orders, self._events = [], []
        return orders, events

    def log_event(self, who: str, what: str, **data: Any) -> None:
        """Add an event to the log."""
        self._events.append(FleetEvent(who, str(what), data))

    def raise_alarm(self, code: str, number: int | None, level: str, sentence: str, now: float) -> None:
        """Raise an alarm of a tractor, or of the fleet, and log it where an operator must see it again."""
        if self.alarms.raise_alarm(code, number, level, sentence, now):
            self.log_event(FLEET_MANAGER, "alarm", tractor=None if number is None else number + 1, sentence=sentence)

    def check_tractor_number(self, number: int) -> None:
        """Raise FleetManagerError if the fleet has no such tractor."""
        if not 0 <= number < self.plan.tractor_count:
            raise FleetManagerError(
                f"Tractor {number + 1} is not in this fleet of {self.plan.tractor_count}; "
                f"use 1 to {self.plan.tractor_count}.",
                parameter="tractor",
            )

    def hand_lease(self, number: int, who: str, takeover: bool) -> str | None:
        """Let somebody drive a tractor; returns who else drove it. Raises ControlLeaseError then without `takeover`."""
        previous_holder = self.lease_holders.get(number)
        if previous_holder not in (None, who) and not takeover:
            raise ControlLeaseError(
                f"Tractor {number + 1} is driven by {previous_holder}; take it over to drive it yourself."
            )
        self.lease_holders[number] = who
        return previous_holder if previous_holder != who else None

    def check_lease(self, number: int, who: str) -> None:
        """Raise ControlLeaseError unless `who` drives this tractor, FleetManagerError for one that there is not."""
        self.check_tractor_number(number)
        holder = self.lease_holders.get(number)
        if holder != who:
            state_text = "nobody drives it" if holder is None else f"{holder} drives it"
            raise ControlLeaseError(f"Tractor {number + 1} is not yours to drive: {state_text}. Take control first.")

    def add_coverage(self, number: int, x_m: float, y_m: float, is_working: bool) -> None:
        """Add the place of a tractor to its line of coverage."""
        line = self.coverage_lines[number]
        last = line[-1] if line else None
        if not is_working:
            if last is not None:
                line.append(None)
        elif (last is None or math.dist(last, (x_m, y_m)) >= COVERAGE_STEP_M) and len(line) < MOST_COVERAGE_POINTS:
            line.append((x_m, y_m))

    def issue_order(self, number: int, kind: str, **data: Any) -> None:
        """Add an order to a tractor."""
        self._orders.append(TractorOrder(number, kind, data))

    def send_base(self, number: int) -> None:
        """Send a tractor which legs it may drive, and how fast."""
        state = self.states[number]
        self.issue_order(
            number, "release", update=state.update, base_end=state.base_end, horizon_end=len(state.mission.legs),
            limit_mps=state.limit_mps, horizon_s=self.rules.horizon_s,
        )  # fmt: skip

    def hold_tractor(self, number: int, hold: Hold, *, is_logged: bool = False) -> None:
        """Hold a tractor and stop it, whoever drives it, unless it has this hold already."""
        if hold not in self.states[number].holds:
            self.states[number].holds.add(hold)
            if is_logged:
                self.log_event(FLEET_MANAGER, hold, tractor=number + 1)
            self.stop_tractor(number, hold)

    def end_doubt(self, who: str, number: int) -> None:
        """An operator answers for the place of a tractor whose reports contradicted each other."""
        if Hold.DOUBTED in self.states[number].holds:
            self.states[number].holds.discard(Hold.DOUBTED)
            self.log_event(who, "looked", tractor=number + 1)

    def hold_tractors_at_gates(self) -> None:
        """Hold tractors that a replanned plan makes wait where they stand, until their gates open."""
        for number, state in enumerate(self.states):
            if state.done or state.has_no_more_legs or not state.find_gates_closed_on_base(self.states):
                state.holds.discard(Hold.WAITS_FOR_PLAN)
            else:
                self.hold_tractor(number, Hold.WAITS_FOR_PLAN)

    def stop_tractor(self, number: int, reason: str) -> None:
        """Stop a tractor, whoever drives it."""
        state = self.states[number]
        state.remote_command = (state.remote_command[0], 0.0)
        state.standing_ordered = True
        self.issue_order(number, "stop", reason=reason)

    def send_stop_or_resume(self) -> None:
        """Send stop or resume to every tractor for which that has changed."""
        for number, state in enumerate(self.states):
            must_stand = bool(state.holds) or self.state in (READY, STOPPED)
            if must_stand != state.standing_ordered:
                state.standing_ordered = must_stand
                self.repeat_stop_or_resume(number)

    def repeat_stop_or_resume(self, number: int) -> None:
        """Send a tractor what it was ordered last, to stop or to resume."""
        state = self.states[number]
        if state.standing_ordered:
            self.issue_order(number, "stop", reason=state.stop_reason)
        else:
            self.issue_order(number, "resume")

    def update_blocked_legs(self) -> None:
        """Find the legs that obstacles block, and stop tractors that drive at one; to be called when these change."""
        for number, state in enumerate(self.states):
            legs = self.obstacles.find_blocked_legs(state.mission)
            self.blocked_legs[number] = {leg: name for leg, name in legs.items() if leg >= state.base_end}
            if self._is_base_obstructed(state):
                self.hold_tractor(number, Hold.OBSTACLE)
            else:
                state.holds.discard(Hold.OBSTACLE)
            steering, speed = state.remote_command
            if self.find_remote_command_harm(number, speed, steering):
                self.stop_tractor(number, Hold.OBSTACLE)
        self.send_stop_or_resume()

    def _is_base_obstructed(self, state: TractorState) -> bool:
        """Whether an obstacle lies on the base of a tractor, from where it would resume."""
        place_m, report = state.leg_m, state.report
        if Hold.REMOTE_CONTROL in state.holds and report is not None:  # led past it, it resumes from where it stands
            place = report.x_m, report.y_m
            place_m = max(place_m, state.mission.find_nearest_leg_position_m(state.leg, place, self.rules.rejoin_m))
        return not state.done and self.obstacles.is_on_base(state, place_m)

    def clear_passed_obstacles(self) -> None:
        """End the obstacle holds of tractors that were led past the obstacle."""
        for state in self.states:
            if Hold.OBSTACLE in state.holds and not self._is_base_obstructed(state):
                state.holds.discard(Hold.OBSTACLE)

    def find_remote_command_harm(self, number: int, speed_mps: float, steering_rad: float) -> str | None:
        """Why a remote command would do harm; None if it does not."""
        if abs(speed_mps) < MOVING_MPS:
            return None
        shapes = [obstacle.shape for obstacle in self.obstacles.items.values()]
        neighbours = self.neighbours.find_nearby_tractors()
        return self.guard.find_command_harm(number, speed_mps, steering_rad, self.states, shapes, neighbours)

    def is_report_current(self, number: int) -> bool:
        """Whether the last report of a tractor shows what it does now."""
        return self.states[number].is_linked and not self.alarms.is_alarm_on("broken", number)

    def find_awaited_legs(self, number: int) -> list[tuple[int, int]]:
        """The (tractor, leg) that a tractor near the end of its base waits for, without repeats: two gates may wait for
        two places on one leg."""
        state = self.states[number]
        if state.done:
            return []
        gates, next_leg = state.find_gates_closed_on_base(self.states), state.base_end
        if not gates and next_leg < len(state.mission.legs) and state.is_within_reach(next_leg, self.rules):
            gates = state.find_closed_gates(next_leg, self.states)
        return list(dict.fromkeys((gate.tractor, gate.leg) for gate in gates))

    def compute_total_worked_m(self) -> float:
        """Metres worked so far by all tractors."""
        return sum(state.worked_m for state in self.states)

    def estimate_delay_s(self, number: int, now: float) -> float | None:
        """How much later than planned a tractor will be done, in seconds of real time; None if unknown."""
        if self.started_s is None or not math.isfinite(self.finish_in_s[number]) or self.states[number].done:
            return None
        planned_s = self.plan.finish_s[number] / self.rules.times
        return now + self.finish_in_s[number] - self.started_s - planned_s
