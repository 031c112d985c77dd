"""Orders of operators: start, pause, resume, stop, remote control, failures, another plan; and orders that affect
neighbouring fleets."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.fleet.manager.fleet_state import READY, RUNNING, STOPPED, FleetState, join_fleet_names
from planner.fleet.manager.obstacle_reports import LOOK_DELAY_S, ObstacleReports
from planner.fleet.model.alarms import CRITICAL, WARNING
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import (
    MOVING_MPS,
    ONLINE,
    SAFE_TO_DRIVE,
    UNTIL_RESUMED,
    Hold,
    TractorState,
    is_passed,
)
from planner.fleet.safety.safety_guard import SafetyGuard

RESTARTED, NEIGHBOUR_STOPPED = "restarted", "neighbour stopped"
REJOIN_RAD = math.radians(45.0)  # between a tractor and its leg, for it to resume by itself


class OperatorOrders:
    """Carries out orders for a fleet; `who` gives them, for the log."""

    def __init__(self, fleet: FleetState, obstacle_reports: ObstacleReports) -> None:
        self.fleet, self.obstacle_reports = fleet, obstacle_reports
        self._last_stops = [("", -math.inf)] * fleet.plan.tractor_count  # who last stopped each, and when

    def start_fleet_work(self, who: str, now: float) -> None:
        """Let all tractors drive. Raises FleetManagerError within LOOK_DELAY_S of a stop by somebody else."""
        self._check_recent_stop(who, None, now)
        self.fleet.started_s = now if self.fleet.started_s is None else self.fleet.started_s
        self.fleet.state = RUNNING
        for state in self.fleet.states:
            state.holds -= UNTIL_RESUMED
        self._end_fleet_alarms()
        self.fleet.log_event(who, "started")
        self.fleet.send_stop_or_resume()

    def pause_tractors(self, who: str, number: int | None, now: float) -> None:
        """Pause one tractor or all, until they are resumed."""
        for chosen in self._list_addressed_numbers(number):
            self.fleet.states[chosen].holds.add(Hold.PAUSED)
            self.fleet.stop_tractor(chosen, Hold.PAUSED)
            self._last_stops[chosen] = who, now
        self.fleet.log_event(who, "paused", tractor=None if number is None else number + 1)
        self.fleet.send_stop_or_resume()

    def resume_tractors(self, who: str, number: int | None, now: float) -> None:
        """Resume one tractor or all; resuming one also confirms a look at its unreadable obstacle, or at its place.

        Raises FleetManagerError if the one stands too far off its leg or across it, or within LOOK_DELAY_S of a stop by
        somebody else.
        """
        self._check_recent_stop(who, number, now)
        if number is not None:
            self.obstacle_reports.check_inspection_possible(number, now)
        for chosen in self._list_addressed_numbers(number):
            self._resume_if_on_leg(chosen, is_single=number is not None)
        self._end_fleet_alarms()
        if number is not None:
            self.obstacle_reports.confirm_inspection(who, number, now)
            self.fleet.end_doubt(who, number)
        if self.fleet.state in (READY, STOPPED) and number is None:
            self.fleet.started_s = now if self.fleet.started_s is None else self.fleet.started_s
            self.fleet.state = RUNNING
        self.fleet.log_event(who, "resumed", tractor=None if number is None else number + 1)
        self.fleet.send_stop_or_resume()

    def _check_recent_stop(self, who: str, number: int | None, now: float) -> None:
        """Raise FleetManagerError if somebody else has stopped a tractor less than LOOK_DELAY_S ago."""
        for chosen in self._list_addressed_numbers(number):
            stopped_by, stopped_at_s = self._last_stops[chosen]
            if stopped_by != who and now - stopped_at_s < LOOK_DELAY_S:
                raise FleetManagerError(
                    f"Tractor {chosen + 1} was just stopped by {stopped_by}; find out why, then resume it."
                )

    def _resume_if_on_leg(self, number: int, is_single: bool) -> None:
        state = self.fleet.states[number]
        offset_m = heading_offset_rad = 0.0
        if state.report is not None and Hold.REMOTE_CONTROL in state.holds:
            place = state.report.x_m, state.report.y_m
            offset_m = state.mission.compute_distance_to_leg_m(state.leg, place)
            heading_offset_rad = state.mission.compute_heading_offset_rad(state.leg, place, state.report.heading_rad)
        holder = self.fleet.lease_holders.get(number)
        if is_single and holder is not None:
            raise FleetManagerError(f"Tractor {number + 1} is driven by {holder}; they must give it back first.")
        if is_single and Hold.REASSIGNED in state.holds:
            raise FleetManagerError(
                f"The tracks of tractor {number + 1} were given to others; drive it by remote control only.",
                parameter="tractor",
            )
        if is_single and offset_m > self.fleet.rules.rejoin_m:
            raise FleetManagerError(
                f"Tractor {number + 1} stands {offset_m:.1f} m off its leg; drive it back to within "
                f"{self.fleet.rules.rejoin_m:g} m first."
            )
        if is_single and heading_offset_rad > REJOIN_RAD:
            raise FleetManagerError(
                f"Tractor {number + 1} heads {math.degrees(heading_offset_rad):.0f} degrees away from its leg; "
                f"turn it to within {math.degrees(REJOIN_RAD):.0f} degrees first."
            )
        state.holds -= UNTIL_RESUMED
        if holder is None and offset_m <= self.fleet.rules.rejoin_m and heading_offset_rad <= REJOIN_RAD:
            state.holds.discard(Hold.REMOTE_CONTROL)

    def hold_after_restart(self, now: float) -> None:
        """The service restarted while this fleet was driven: all tractors stand until somebody resumes them."""
        for state in self.fleet.states:
            state.holds.add(Hold.SERVICE_RESTARTED)
        sentence = (
            "The service restarted: all tractors of this fleet stand. Look where they are, then resume all "
            "of them, or one after the other."
        )
        self.fleet.raise_alarm(RESTARTED, None, WARNING, sentence, now)

    def _end_fleet_alarms(self) -> None:
        """End the alarms of a standing fleet once it does not stand any more."""
        for code, hold in ((RESTARTED, Hold.SERVICE_RESTARTED), (NEIGHBOUR_STOPPED, Hold.HALTED)):
            if not any(hold in state.holds for state in self.fleet.states):
                self.fleet.alarms.end_alarm(code, None)

    def stop_all(self, who: str, now: float) -> None:
        """Stop all tractors of this fleet and of the fleets near by, whoever drives them; also those offline, once they
        are back."""
        self._stop_own_tractors(who, now)
        self.fleet.log_event(who, "stop_all")
        names = self.fleet.neighbours.stop_neighbour_fleets(who, now)
        if names:
            self.fleet.log_event(who, "stop_all of neighbours", fleets=names)
            sentence = (
                f"Stop-all of this fleet has stopped its neighbours too: {join_fleet_names(names)}. Their own "
                "operators resume them."
            )
            self.fleet.raise_alarm(NEIGHBOUR_STOPPED, None, WARNING, sentence, now)

    def stop_with_neighbour(self, who: str, fleet: str, now: float) -> None:
        """Somebody stopped a fleet near by: stop all tractors of this one too."""
        self._stop_own_tractors(f"{who} of fleet {fleet!r}", now)
        self.fleet.log_event(who, "stop_all of a neighbour", fleet=fleet)
        sentence = f"{who} stopped fleet {fleet!r} near by, and this fleet with it: find out why before you resume."
        self.fleet.raise_alarm(NEIGHBOUR_STOPPED, None, CRITICAL, sentence, now)

    def _stop_own_tractors(self, who: str, now: float) -> None:
        self.fleet.state = STOPPED
        for number, state in enumerate(self.fleet.states):
            state.holds.add(Hold.HALTED)
            state.standing_ordered = True
            self.fleet.issue_order(number, "stop", reason=Hold.HALTED)
            self._last_stops[number] = who, now

    def take_lease(self, who: str, number: int, takeover: bool, now: float) -> str | None:
        """Lease a tractor for remote control; returns the previous holder. Raises ControlLeaseError."""
        self.fleet.check_tractor_number(number)
        if self.fleet.states[number].failed:
            raise FleetManagerError(
                f"Tractor {number + 1} has failed; mark it as working again first.", parameter="tractor"
            )
        previous_holder = self.fleet.hand_lease(number, who, takeover)
        state = self.fleet.states[number]
        state.holds.add(Hold.REMOTE_CONTROL)
        state.holds -= {Hold.PAUSED, Hold.SERVICE_RESTARTED}  # remote control holds it instead
        state.commanded_s, state.remote_command = -math.inf, (0.0, 0.0)
        self._end_fleet_alarms()
        self.fleet.stop_tractor(number, Hold.REMOTE_CONTROL)  # whatever it does by earlier orders
        self.fleet.log_event(who, "lease", tractor=number + 1, taken_from=previous_holder)
        self.fleet.send_stop_or_resume()
        return previous_holder

    def return_lease(self, who: str, number: int, now: float) -> None:
        """Give a tractor back; it stands until it is resumed."""
        if self.fleet.lease_holders.get(number) == who:
            del self.fleet.lease_holders[number]
            self.fleet.stop_tractor(number, "remote control ended")
            self.fleet.log_event(who, "leave", tractor=number + 1)

    def disconnect_operator(self, who: str, now: float) -> list[int]:
        """The link of an operator is down: their leased tractors stop. Returns these."""
        leased_numbers = sorted(number for number, holder in self.fleet.lease_holders.items() if holder == who)
        for number in leased_numbers:
            self.return_lease(who, number, now)
        return leased_numbers

    def send_command(self, who: str, number: int, steering_rad: float, speed_mps: float, now: float) -> None:
        """Drive a tractor by remote control: `steering_rad` positive right, `speed_mps` negative backwards.

        Both are limited to what the rules and the tractor allow. Raises ControlLeaseError without a lease, and
        FleetManagerError, after stopping the tractor, if the command would do harm or the tractor must stand.
        """
        self.fleet.check_lease(number, who)
        state = self.fleet.states[number]
        lock_rad = math.radians(self.fleet.plan.tractor.max_steering_deg)
        steering = min(max(steering_rad, -lock_rad), lock_rad)
        speed = min(max(speed_mps, -self.fleet.rules.remote_mps), self.fleet.rules.remote_mps)
        speed = 0.0 if abs(speed) < MOVING_MPS else speed  # the guard ignores tractors slower than this
        state.commanded_s = now
        fault = self._find_command_refusal(number, speed, steering, now)
        if fault:
            speed = 0.0
        if (steering, speed) != state.remote_command:
            values = {"steering_deg": round(math.degrees(steering), 2), "speed_mps": round(speed, 3)}
            self.fleet.log_event(who, "command", tractor=number + 1, **values)
        state.remote_command = (steering, speed)
        self.fleet.issue_order(number, "command", steering_rad=steering, speed_mps=speed)
        if fault:
            raise FleetManagerError(f"Tractor {number + 1} stands: {fault}.")

    def _find_command_refusal(self, number: int, speed_mps: float, steering_rad: float, now: float) -> str | None:
        state = self.fleet.states[number]
        barring_hold = min(state.holds - SAFE_TO_DRIVE, default=None)
        if barring_hold is not None:
            return barring_hold
        if state.get_connection(now, self.fleet.rules.silence_s) != ONLINE:
            return "its link is broken"
        if now - state.last_fix_s > self.fleet.rules.silence_s:
            return "its present place is unknown"
        return self.fleet.find_remote_command_harm(number, speed_mps, steering_rad)

    def mark_failed(self, who: str, number: int, now: float) -> None:
        """A tractor has failed; those that wait for it wait until the rest is replanned."""
        self.fleet.check_tractor_number(number)
        self.fleet.states[number].failed = True
        self.fleet.states[number].holds.add(Hold.FAILED)
        self.fleet.stop_tractor(number, Hold.FAILED)
        self.fleet.lease_holders.pop(number, None)
        sentence = f"Tractor {number + 1} has failed; plan its remaining tracks for the others."
        self.fleet.raise_alarm("failed", number, CRITICAL, sentence, now)
        self.fleet.log_event(who, "fail", tractor=number + 1)
        self.fleet.send_stop_or_resume()

    def mark_repaired(self, who: str, number: int, now: float) -> None:
        """A failed tractor works again; it stands until it is resumed.

        If its tracks were given to others, only remote control can drive it. Raises FleetManagerError if it has not
        failed.
        """
        self.fleet.check_tractor_number(number)
        state = self.fleet.states[number]
        if not state.failed:
            raise FleetManagerError(
                f"Tractor {number + 1} has not failed; there is nothing to undo.", parameter="tractor"
            )
        state.failed = False
        state.holds.discard(Hold.FAILED)
        state.holds.add(Hold.REMOTE_CONTROL)  # it may have been moved: it resumes only on its leg
        self.fleet.stop_tractor(number, Hold.REMOTE_CONTROL)
        self.fleet.alarms.end_alarm("failed", number)
        self.fleet.log_event(who, "recover", tractor=number + 1)
        self.fleet.send_stop_or_resume()

    def adopt_plan(self, who: str, plan: FleetPlan, now: float, without: Sequence[int] = ()) -> None:
        """Continue by another plan with the same base legs; raises FleetManagerError if these differ.

        Tractors in `without` have no part in the plan and drive no more.
        """
        fleet = self.fleet
        for number, (state, mission) in enumerate(zip(fleet.states, plan.timed_missions, strict=True)):
            if number not in without and not state.has_no_more_legs:
                self._check_base_unchanged(number, state, mission)
        for number in without:
            fleet.hold_tractor(number, Hold.REASSIGNED)
            fleet.alarms.reword("failed", number, f"Tractor {number + 1} has failed; its tracks were given to others.")
        fleet.plan = plan
        fleet.version += 1
        fleet.guard = SafetyGuard(plan, fleet.rules, fleet.twins)
        for number, (state, mission) in enumerate(zip(fleet.states, plan.timed_missions, strict=True)):
            state.mission = mission
            state.done = state.done and state.leg >= len(mission.legs) - 1
            fleet.issue_order(number, "plan", base_end=state.base_end)
        fleet.log_event(who, "accept", version=fleet.version)
        fleet.hold_tractors_at_gates()
        fleet.update_blocked_legs()
        fleet.forecast_at_s = -math.inf

    def _check_base_unchanged(self, number: int, state: TractorState, new: TimedMission) -> None:
        """Raise FleetManagerError where a new mission has other base legs, or a closed gate on one that is driven."""
        old, base_end = state.mission, state.base_end
        is_same = len(new.legs) >= base_end and all(
            np.array_equal(a.points, b.points) and a.gear == b.gear
            for a, b in zip(old.legs[:base_end], new.legs[:base_end], strict=True)
        )
        if not is_same:
            raise FleetManagerError(
                f"Tractor {number + 1} has driven on since the plan was made; replan.", parameter="proposal"
            )
        waits_at = {state.leg} if state.is_standing else set()
        new_gates = (
            gate
            for leg in range(base_end)
            if leg not in waits_at
            for gate in new.legs[leg].gates
            if gate not in old.legs[leg].gates
        )
        if any(not is_passed(gate, self.fleet.states) for gate in new_gates):
            raise FleetManagerError(
                f"Tractor {number + 1} already drives where the new plan makes it wait; replan.", parameter="proposal"
            )

    def _list_addressed_numbers(self, number: int | None) -> range:
        if number is None:
            return range(self.fleet.plan.tractor_count)
        self.fleet.check_tractor_number(number)
        return range(number, number + 1)
