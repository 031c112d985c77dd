"""Orders of operators: start, pause, resume, stop, remote control, failures, another plan; and orders that affect
neighbouring fleets."""

from __future__ import annotations

import math
from collections.abc import Sequence

from planner.fleet.manager.fleet_state import FLEET_MANAGER, READY, RUNNING, STOPPED
from planner.fleet.manager.obstacle_reports import FleetWithObstacles
from planner.fleet.manager.remaining_work import is_standing
from planner.fleet.model.alarms import CRITICAL, WARNING
from planner.fleet.model.errors import FleetManagerError
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import (
    FAILED,
    HALTED,
    ONLINE,
    PAUSED,
    REASSIGNED,
    REMOTE_CONTROL,
    SAFE_TO_DRIVE,
    SERVICE_RESTARTED,
    UNTIL_RESUMED,
    TractorState,
)
from planner.fleet.safety.base_release import is_passed
from planner.fleet.safety.motion_prediction import NeighbourTractor, TractorKey
from planner.fleet.safety.safety_guard import MOVING_MPS, SafetyGuard

RESTARTED, NEIGHBOUR_STOPPED = "restarted", "neighbour stopped"
STOP_SEEN_S = 1.0  # time for others to see a stop
REJOIN_RAD = math.radians(45.0)  # between a tractor and its leg, for it to resume by itself


class FleetWithOperators(FleetWithObstacles):
    """A fleet that takes orders; `who` gives them, for the log."""

    def start_fleet_work(self, who: str, now: float) -> None:
        """Let all tractors drive. Raises FleetManagerError within STOP_SEEN_S of a stop by somebody else."""
        self._check_recent_stop(who, None, now)
        self.started_s = now if self.started_s is None else self.started_s
        self.state = RUNNING
        for state in self.states:
            state.holds -= UNTIL_RESUMED
        self._end_fleet_alarms()
        self.log_event(who, "started")
        self._send_stop_or_resume()

    def pause_tractors(self, who: str, number: int | None, now: float) -> None:
        """Pause one tractor or all, until they are resumed."""
        for chosen in self._list_addressed_numbers(number):
            self.states[chosen].holds.add(PAUSED)
            self._stop_tractor(chosen, PAUSED)
            self._last_stops[chosen] = who, now
        self.log_event(who, "paused", tractor=None if number is None else number + 1)
        self._send_stop_or_resume()

    def resume_tractors(self, who: str, number: int | None, now: float) -> None:
        """Resume one tractor or all; resuming one also confirms a look at its unreadable obstacle.

        Raises FleetManagerError if the one stands too far off its leg or across it, or within STOP_SEEN_S of a stop by
        somebody else.
        """
        self._check_recent_stop(who, number, now)
        if number is not None:
            self.check_inspection_possible(number, now)
        for chosen in self._list_addressed_numbers(number):
            self._resume_if_on_leg(chosen, is_single=number is not None)
        self._end_fleet_alarms()
        if number is not None:
            self.confirm_obstacle_inspection(who, number, now)
        if self.state in (READY, STOPPED) and number is None:
            self.started_s = now if self.started_s is None else self.started_s
            self.state = RUNNING
        self.log_event(who, "resumed", tractor=None if number is None else number + 1)
        self._send_stop_or_resume()

    def _check_recent_stop(self, who: str, number: int | None, now: float) -> None:
        """Raise FleetManagerError if somebody else has stopped a tractor less than STOP_SEEN_S ago."""
        for chosen in self._list_addressed_numbers(number):
            stopped_by, stopped_at_s = self._last_stops[chosen]
            if stopped_by != who and now - stopped_at_s < STOP_SEEN_S:
                raise FleetManagerError(
                    f"Tractor {chosen + 1} was just stopped by {stopped_by}; find out why, then resume it."
                )

    def _resume_if_on_leg(self, number: int, is_single: bool) -> None:
        state = self.states[number]
        offset_m = heading_offset_rad = 0.0
        if state.report is not None and REMOTE_CONTROL in state.holds:
            place = state.report.x_m, state.report.y_m
            offset_m = self.timed_missions[number].compute_distance_to_leg_m(state.leg, place)
            heading_offset_rad = self.timed_missions[number].compute_heading_offset_rad(
                state.leg, place, state.report.heading_rad
            )
        is_leased = self.control_leases.get_holder(number) is not None
        if is_single and is_leased:
            raise FleetManagerError(
                f"Tractor {number + 1} is driven by {self.control_leases.get_holder(number)}; "
                "they must give it back first."
            )
        if is_single and REASSIGNED in state.holds:
            raise FleetManagerError(
                f"The tracks of tractor {number + 1} were given to others; drive it by remote control only.",
                parameter="tractor",
            )
        if is_single and offset_m > self.rules.rejoin_m:
            raise FleetManagerError(
                f"Tractor {number + 1} stands {offset_m:.1f} m off its leg; drive it back to within "
                f"{self.rules.rejoin_m:g} m first."
            )
        if is_single and heading_offset_rad > REJOIN_RAD:
            raise FleetManagerError(
                f"Tractor {number + 1} heads {math.degrees(heading_offset_rad):.0f} degrees away from its leg; "
                f"turn it to within {math.degrees(REJOIN_RAD):.0f} degrees first."
            )
        state.holds -= UNTIL_RESUMED
        if not is_leased and offset_m <= self.rules.rejoin_m and heading_offset_rad <= REJOIN_RAD:
            state.holds.discard(REMOTE_CONTROL)

    def hold_after_restart(self, now: float) -> None:
        """The service restarted while this fleet was driven: all tractors stand until somebody resumes them."""
        for state in self.states:
            state.holds.add(SERVICE_RESTARTED)
        sentence = (
            "The service restarted: all tractors of this fleet stand. Look where they are, then resume all "
            "of them, or one after the other."
        )
        self._raise_alarm(RESTARTED, None, WARNING, sentence, now)

    def _end_fleet_alarms(self) -> None:
        """End the alarms of a standing fleet once it does not stand any more."""
        for code, hold in ((RESTARTED, SERVICE_RESTARTED), (NEIGHBOUR_STOPPED, HALTED)):
            if not any(hold in state.holds for state in self.states):
                self.alarms.end_alarm(code, None)

    def stop_all(self, who: str, now: float) -> None:
        """Stop all tractors, whoever drives them; also those offline, once they are back."""
        self._stop_own_tractors(who, now)
        self.log_event(who, "stop_all")

    def _stop_own_tractors(self, who: str, now: float) -> None:
        self.state = STOPPED
        for number, state in enumerate(self.states):
            state.holds.add(HALTED)
            state.standing_ordered = True
            self._issue_order(number, "stop", reason=HALTED)
            self._last_stops[number] = who, now

    def take_lease(self, who: str, number: int, takeover: bool, now: float) -> str | None:
        """Lease a tractor for remote control; returns the previous holder. Raises ControlLeaseError."""
        self.check_tractor_number(number)
        if self.states[number].failed:
            raise FleetManagerError(
                f"Tractor {number + 1} has failed; mark it as working again first.", parameter="tractor"
            )
        previous_holder = self.control_leases.take_lease_of(number, who, takeover)
        state = self.states[number]
        state.holds.add(REMOTE_CONTROL)
        state.holds -= {PAUSED, SERVICE_RESTARTED}  # REMOTE_CONTROL holds it instead
        state.commanded_s, state.remote_command = -math.inf, (0.0, 0.0)
        self._end_fleet_alarms()
        self._stop_tractor(number, REMOTE_CONTROL)  # whatever it does by earlier orders
        self.log_event(who, "lease", tractor=number + 1, taken_from=previous_holder)
        self._send_stop_or_resume()
        return previous_holder

    def return_lease(self, who: str, number: int, now: float) -> None:
        """Give a tractor back; it stands until it is resumed."""
        if self.control_leases.end_lease_of(number, who):
            self._stop_tractor(number, "remote control ended")
            self.log_event(who, "leave", tractor=number + 1)

    def disconnect_operator(self, who: str, now: float) -> list[int]:
        """The link of an operator is down: their leased tractors stop. Returns these."""
        leased_numbers = self.control_leases.list_tractors_leased_by(who)
        for number in leased_numbers:
            self.return_lease(who, number, now)
        return leased_numbers

    def send_command(self, who: str, number: int, steering_rad: float, speed_mps: float, now: float) -> None:
        """Drive a tractor by remote control: `steering_rad` positive right, `speed_mps` negative backwards.

        Both are limited to what the rules and the tractor allow. Raises ControlLeaseError without a lease, and
        FleetManagerError, after stopping the tractor, if the command would do harm or the tractor must stand.
        """
        self.check_tractor_number(number)
        self.control_leases.check_holder(number, who)
        state = self.states[number]
        lock_rad = math.radians(self.plan.tractor.max_steering_deg)
        steering = min(max(steering_rad, -lock_rad), lock_rad)
        speed = min(max(speed_mps, -self.rules.remote_mps), self.rules.remote_mps)
        speed = 0.0 if abs(speed) < MOVING_MPS else speed  # the guard ignores tractors slower than this
        state.commanded_s = now
        fault = self._find_command_refusal(number, speed, steering, now)
        if fault:
            speed = 0.0
        if (steering, speed) != state.remote_command:
            self.log_event(
                who,
                "command",
                tractor=number + 1,
                steering_deg=round(math.degrees(steering), 2),
                speed_mps=round(speed, 3),
            )
        state.remote_command = (steering, speed)
        self._issue_order(number, "command", steering_rad=steering, speed_mps=speed)
        if fault:
            raise FleetManagerError(f"Tractor {number + 1} stands: {fault}.")

    def _find_command_refusal(self, number: int, speed_mps: float, steering_rad: float, now: float) -> str | None:
        state = self.states[number]
        barring_holds = sorted(state.holds - SAFE_TO_DRIVE)
        if barring_holds:
            return barring_holds[0]
        if state.get_connection(now, self.rules.silence_s) != ONLINE:
            return "its link is broken"
        if now - state.last_fix_s > self.rules.silence_s:
            return "its present place is unknown"
        return self._find_remote_command_harm(number, speed_mps, steering_rad)

    def mark_failed(self, who: str, number: int, now: float) -> None:
        """A tractor has failed; those that wait for it wait until the rest is replanned."""
        self.check_tractor_number(number)
        self.states[number].failed = True
        self.states[number].holds.add(FAILED)
        self._stop_tractor(number, FAILED)
        holder = self.control_leases.get_holder(number)
        if holder is not None:
            self.control_leases.end_lease_of(number, holder)
        self._raise_alarm(
            "failed",
            number,
            CRITICAL,
            f"Tractor {number + 1} has failed; plan its remaining tracks for the others.",
            now,
        )
        self.log_event(who, "fail", tractor=number + 1)
        self._send_stop_or_resume()

    def mark_repaired(self, who: str, number: int, now: float) -> None:
        """A failed tractor works again; it stands until it is resumed.

        If its tracks were given to others, only remote control can drive it. Raises FleetManagerError if it has not
        failed.
        """
        self.check_tractor_number(number)
        state = self.states[number]
        if not state.failed:
            raise FleetManagerError(
                f"Tractor {number + 1} has not failed; there is nothing to undo.", parameter="tractor"
            )
        state.failed = False
        state.holds.discard(FAILED)
        state.holds.add(REMOTE_CONTROL)  # it may have been moved: it resumes only on its leg
        self._stop_tractor(number, REMOTE_CONTROL)
        self.alarms.end_alarm("failed", number)
        self.log_event(who, "recover", tractor=number + 1)
        self._send_stop_or_resume()

    def adopt_plan(self, who: str, plan: FleetPlan, now: float, without: Sequence[int] = ()) -> None:
        """Continue by another plan with the same base legs; raises FleetManagerError if these differ.

        Tractors in `without` have no part in the plan and drive no more.
        """
        for number, (state, old, new) in enumerate(
            zip(self.states, self.timed_missions, plan.timed_missions, strict=True)
        ):
            if number in without:
                continue
            if not state.has_no_more_legs and not _has_same_base(old, new, state.base_end):
                raise FleetManagerError(
                    f"Tractor {number + 1} has driven on since the plan was made; replan.",
                    parameter="proposal",
                )
            waits_at = {state.leg} if is_standing(state) else set()
            is_closed = (
                _has_new_closed_gate(old, new, leg, self.states) for leg in range(state.base_end) if leg not in waits_at
            )
            if not state.has_no_more_legs and any(is_closed):
                raise FleetManagerError(
                    f"Tractor {number + 1} already drives where the new plan makes it wait; replan.",
                    parameter="proposal",
                )
        for number in without:
            if not self.states[number].has_no_more_legs:
                self.mark_failed(who, number, now)
            self.states[number].holds.add(REASSIGNED)
            self.alarms.reword("failed", number, f"Tractor {number + 1} has failed; its tracks were given to others.")
        self.plan = plan
        self.version += 1
        self.guard = SafetyGuard(plan, self.rules, self.twins)
        for number, state in enumerate(self.states):
            state.done = state.done and state.leg >= len(self.timed_missions[number].legs) - 1
            self._issue_order(number, "plan", base_end=state.base_end)
        self.log_event(who, "accept", version=self.version)
        self._hold_tractors_at_gates()
        self._update_blocked_legs()
        self._forecast_at_s = -math.inf

    def _list_addressed_numbers(self, number: int | None) -> range:
        if number is None:
            return range(self.plan.tractor_count)
        self.check_tractor_number(number)
        return range(number, number + 1)


def _has_same_base(old: TimedMission, new: TimedMission, base_end: int) -> bool:
    """Whether two missions have the same base legs, apart from gates."""
    if len(new.legs) < base_end:
        return False
    return all(
        a.points.shape == b.points.shape and bool((a.points == b.points).all()) and a.gear == b.gear
        for a, b in zip(old.legs[:base_end], new.legs[:base_end], strict=True)
    )


def _has_new_closed_gate(old: TimedMission, new: TimedMission, leg: int, states: Sequence[TractorState]) -> bool:
    """Whether a leg has a new gate that is closed."""
    return any(gate not in old.legs[leg].gates and not is_passed(gate, states) for gate in new.legs[leg].gates)


NEAR_FLEET = "near fleet"
UNKNOWN_GROUND = "unknown ground"


class FleetWithNeighbours(FleetWithOperators):
    """A fleet with neighbours; Neighbourhood sets `neighbours`."""

    _neighbour_names: tuple[str, ...] = ()

    def set_neighbours(self, names: Sequence[str], unknown_names: Sequence[str], now: float) -> None:
        """Set the names of the fleets near by, and of those at an unknown distance."""
        if tuple(names) != self._neighbour_names:
            self._neighbour_names = tuple(names)
            self.log_event(FLEET_MANAGER, "neighbours", fleets=list(names))
        if not unknown_names:
            self.alarms.end_alarm(UNKNOWN_GROUND, None)
            return
        sentence = (
            f"The distance from this fleet to {_join_names(unknown_names)} cannot be known: their plans have no common "
            "coordinate system. No distance is kept between them."
        )
        self._raise_alarm(UNKNOWN_GROUND, None, WARNING, sentence, now)

    def stop_all(self, who: str, now: float) -> None:
        """Stop all tractors of this fleet and of the fleets near by, as of FleetWithOperators.stop_all."""
        super().stop_all(who, now)
        names = self.neighbours.stop_neighbour_fleets(who, now)
        if not names:
            return
        self.log_event(who, "stop_all of neighbours", fleets=names)
        sentence = (
            f"Stop-all of this fleet has stopped its neighbours too: {_join_names(names)}. Their own operators "
            "resume them."
        )
        self._raise_alarm(NEIGHBOUR_STOPPED, None, WARNING, sentence, now)

    def stop_with_neighbour(self, who: str, fleet: str, now: float) -> None:
        """Somebody stopped a fleet near by: stop all tractors of this one too."""
        self._stop_own_tractors(f"{who} of fleet {fleet!r}", now)
        self.log_event(who, "stop_all of a neighbour", fleet=fleet)
        sentence = f"{who} stopped fleet {fleet!r} near by, and this fleet with it: find out why before you resume."
        self._raise_alarm(NEIGHBOUR_STOPPED, None, CRITICAL, sentence, now)

    def find_neighbour_pairs(self) -> list[tuple[int, TractorKey]]:
        """Pairs with tractors of other fleets, whose alarm is on."""
        pairs = []
        for alarm in self.alarms.list_alarms():
            kind, _, number = alarm.code.rpartition(" ")
            if not alarm.over and alarm.tractor is not None and kind.startswith(NEAR_FLEET + "/"):
                pairs.append((alarm.tractor, (kind.removeprefix(NEAR_FLEET + "/"), int(number) - 1)))
        return pairs

    def _warn_stuck_beside(self, number: int, neighbour: NeighbourTractor, now: float) -> None:
        """Raise an alarm: a tractor stands near one of another fleet and cannot resume by itself."""
        distance_m = self.guard.measure_neighbour_distance_m(self.states[number], neighbour)
        sentence = (
            f"Tractor {number + 1} and {neighbour.name} stand {distance_m:.2f} m apart and cannot resume by "
            "themselves: look there, and drive one away by remote control"
        )
        advice = "." if neighbour.is_linked else f", or delete fleet {neighbour.fleet!r} if it is no longer there."
        self._raise_alarm(build_proximity_alarm_code(neighbour.key), number, CRITICAL, sentence + advice, now)


def build_proximity_alarm_code(other_tractor: int | TractorKey) -> str:
    """The alarm code of a tractor that comes too near another one, of its own fleet or of another."""
    if isinstance(other_tractor, int):
        return f"near {other_tractor + 1}"
    fleet, number = other_tractor
    return f"{NEAR_FLEET}/{fleet} {number + 1}"


def _join_names(names: Sequence[str]) -> str:
    quoted = [f"fleet {name!r}" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"
