"""The fleet manager executes one plan with real tractors, without network or clock: callers pass the time.

Tractors and legs count from 0. Callers collect orders and events with `take_outputs` after each call.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from planner.fleet.manager.finish_forecast import forecast_finish_s
from planner.fleet.manager.fleet_state import DONE, FLEET_MANAGER, RUNNING
from planner.fleet.manager.operator_orders import FleetWithNeighbours, build_proximity_alarm_code
from planner.fleet.model.alarms import CRITICAL, WARNING
from planner.fleet.model.errors import FleetManagerError
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import (
    ASTRAY,
    AUTOMATIC,
    BROKEN,
    BY_HAND,
    FENCE,
    MANUAL,
    REMOTE,
    REMOTE_CONTROL,
    TOO_NEAR,
    WAITS_FOR_PLAN,
    TractorReport,
    TractorState,
)
from planner.fleet.safety.base_release import compute_base_end, find_closed_gates
from planner.fleet.safety.compliance import REPEAT_STOP_S, find_impossible_place_reason, is_disobeying, is_driving_on
from planner.fleet.safety.motion_prediction import NeighbourTractor, TractorKey
from planner.fleet.safety.safety_guard import MOVING_MPS
from planner.fleet.safety.separation import SafetyDanger
from vehicle.control.speed import compute_follower_speed

UNRECORDED = "unrecorded"
WATCH_PERIOD_S, FORECAST_PERIOD_S = 0.2, 1.0
LONGEST_STEP_S = 2.0  # between two reports that counts as driving


class FleetManager(FleetWithNeighbours):
    """Executes one plan with real tractors."""

    def connect_tractor(self, number: int, now: float) -> None:
        """The link of a tractor is up: send it its base, and stop or resume."""
        self.check_tractor_number(number)
        state = self.states[number]
        state.is_linked, state.has_disconnected, state.last_contact_s = True, False, now
        self.alarms.end_alarm("broken", number)
        state.limit_mps = self._compute_speed_limit(number)
        self._send_base(number)
        self._issue_order(number, "stop" if state.standing_ordered else "resume", **self._describe_stop_reason(number))

    def warn_of_replaced_link(self, number: int, now: float) -> None:
        """Another link claims to be this tractor; the previous one was ordered to stop and closed."""
        sentence = (
            f"Tractor {number + 1} has connected a second time: the first link was ordered to stop and closed. "
            "If that was another tractor, check who has its token."
        )
        self._raise_alarm("replaced", number, WARNING, sentence, now)
        self.alarms.end_alarm("replaced", number)  # it stays until somebody has acknowledged it
        self.log_event(f"tractor {number + 1}", "replaced", tractor=number + 1)

    def update_clock_alarm(self, number: int, clock_error: str | None, is_echoed: bool, now: float) -> None:
        """The clock of a tractor is wrong by `clock_error` (a text); None if it is right again."""
        if clock_error is None:
            self.alarms.end_alarm("clock", number)
            return
        sentence = (
            f"The clock of tractor {number + 1} is {clock_error}; its times are corrected to the clock of the service."
        )
        if not is_echoed:
            sentence += " Set it before you drive by remote control: its states may be older than they seem."
        self._raise_alarm("clock", number, WARNING, sentence, now)

    def warn_of_database(self, sentence: str, now: float) -> None:
        """Nothing is saved at present, so a restart would lose it."""
        self._raise_alarm(UNRECORDED, None, CRITICAL, sentence, now)

    def disconnect_tractor(self, number: int, now: float, is_orderly: bool) -> None:
        """The link of a tractor is down: closed by the tractor (`is_orderly`), or broken."""
        state = self.states[number]
        state.is_linked, state.has_disconnected = False, is_orderly
        if not is_orderly:
            self._alarm_broken_link(number, now)

    def take_report(
        self,
        number: int,
        report: TractorReport,
        now: float,
        age_s: float = 0.0,
        *,
        delay_s: float = 0.0,
        unsure_s: float = 0.0,
    ) -> None:
        """Take a report of a tractor; `age_s` is 0 unless the report is too old to show where it is now.

        `delay_s` is how long the report was under way, by both clocks, and `unsure_s` how much longer it may have been
        because the tractor's clock is wrong. Raises FleetManagerError for a leg that the plan does not have.
        """
        state, timed_mission = self.states[number], self.timed_missions[number]
        if not 0 <= report.leg < len(timed_mission.legs):
            raise FleetManagerError(
                f"Tractor {number + 1} reports leg {report.leg}, but its plan has {len(timed_mission.legs)} legs; "
                "send it this plan.",
                parameter="leg",
            )
        previous, state.report = state.report, report
        driving_s = self._compute_driving_s(previous, report, now - state.last_contact_s)
        state.delay_s = delay_s
        state.last_fix_s = max(state.last_fix_s, now - age_s - unsure_s)
        self._note_contact(number, age_s, now)
        if not self._check_reported_place(number, report, now):
            return
        self._advance_progress(state, timed_mission, report, driving_s)
        self.coverage_map.add_place(number, report.x_m, report.y_m, bool(report.implement))
        if report.errors and (previous is None or previous.errors != report.errors):
            self._raise_alarm(
                "error", number, WARNING, f"Tractor {number + 1} reports: {'; '.join(report.errors)}.", now
            )
        elif not report.errors:
            self.alarms.end_alarm("error", number)
        if report.done and not state.done and report.leg == len(timed_mission.legs) - 1 < state.base_end:
            state.done = True
            self.log_event(FLEET_MANAGER, "done", tractor=number + 1)

    def _note_contact(self, number: int, age_s: float, now: float) -> None:
        """Note that a report came; an old one does not show that the link works now."""
        if age_s > 0.0:
            sentence = (
                f"States of tractor {number + 1} arrive {age_s:.1f} s late: its link is slow or its clock is wrong."
            )
            self._raise_alarm("late", number, WARNING, sentence, now)
            return
        self.states[number].last_contact_s = now
        self.alarms.end_alarm("late", number)
        self.alarms.end_alarm("broken", number)

    def _check_reported_place(self, number: int, report: TractorReport, now: float) -> bool:
        """Whether the reported place is possible; if not, the tractor stops and its report is not used."""
        state = self.states[number]
        fault = find_impossible_place_reason(report, state, self.timed_missions[number])
        if fault is None:
            self.alarms.end_alarm("astray", number)
            state.holds.discard(ASTRAY)
            return True
        self._raise_alarm(
            "astray", number, CRITICAL, f"Tractor {number + 1} reports that it is {fault}: it stops.", now
        )
        if ASTRAY not in state.holds:
            state.holds.add(ASTRAY)
            self._stop_tractor(number, ASTRAY)
        return False

    def _compute_driving_s(self, previous: TractorReport | None, report: TractorReport, silent_s: float) -> float:
        """Seconds (simulated clock) that a tractor drove by its own guidance since its last report.

        The tractor's own clock counts if known, as reports that waited for a link come all at once.
        """
        if previous is not None and previous.time_s is not None and report.time_s is not None:
            silent_s = report.time_s - previous.time_s
        is_driving = report.mode == AUTOMATIC and 0.0 <= silent_s <= LONGEST_STEP_S and report.speed_mps > 0.0
        return silent_s * self.rules.times if is_driving else 0.0

    def _advance_progress(
        self, state: TractorState, timed_mission: TimedMission, report: TractorReport, driving_s: float
    ) -> None:
        if (report.leg, report.leg_m) < (state.leg, state.leg_m):
            return
        planned_s = timed_mission.compute_driven_s(report.leg, report.leg_m) - timed_mission.compute_driven_s(
            state.leg, state.leg_m
        )
        state.leg, state.leg_m = report.leg, report.leg_m
        if driving_s > 0.0:
            state.driving_s += driving_s
            state.planned_driving_s += planned_s

    def _alarm_broken_link(self, number: int, now: float) -> None:
        state = self.states[number]
        if not state.done:
            self._raise_alarm(
                "broken",
                number,
                CRITICAL,
                f"The link to tractor {number + 1} is broken: {self._describe_behaviour_offline(number)}.",
                now,
            )
        state.limit_mps = None

    def _describe_behaviour_offline(self, number: int) -> str:
        """What a tractor does while it hears nothing from the fleet manager."""
        state, timed_mission, rules = self.states[number], self.timed_missions[number], self.rules
        if state.mode == MANUAL:
            return "its driver drives it by hand"
        if state.standing_ordered and not is_driving_on(state) and state.mode != REMOTE:
            return "it was ordered to stop, and stands"
        if state.mode == REMOTE or self._compute_speed_limit(number) is not None:
            return f"it stops after {rules.silence_s:.1f} s"
        end_m = timed_mission.leg_starts_m[min(state.base_end, len(timed_mission.legs))]
        remaining_m = max(
            end_m - timed_mission.leg_starts_m[min(state.leg, len(timed_mission.legs))] - state.leg_m, 0.0
        )
        return f"it drives on for {rules.horizon_s:.1f} s, or {remaining_m:.1f} m to the end of its base, and stops"

    def update_fleet(self, now: float) -> None:
        """Do everything that depends on time; to be called ten times a second."""
        for number, state in enumerate(self.states):
            if (
                state.is_linked
                and state.get_connection(now, self.rules.silence_s) == BROKEN
                and not self._is_link_broken(number)
            ):
                self._alarm_broken_link(number, now)
            self._stop_silent_remote_control(number, now)
        if now - self._watched_at_s >= WATCH_PERIOD_S / self.rules.times:
            self._watched_at_s = now
            self._stop_or_resume_by_danger(now)
            self._clear_passed_obstacles()
            self.release_tractors_reporting_readably(now)
        self._hold_tractors_at_gates()
        self._send_stop_or_resume()
        for number in range(self.plan.tractor_count):
            self._repeat_stop(number, now)
        if self.state == RUNNING:
            self._release_legs()
        if now - self._forecast_at_s >= FORECAST_PERIOD_S:
            self._forecast_at_s = now
            self._update_forecast()

    def _is_link_broken(self, number: int) -> bool:
        return self.alarms.is_alarm_on("broken", number)

    def _stop_silent_remote_control(self, number: int, now: float) -> None:
        """Stop a tractor whose remote control has gone silent."""
        state = self.states[number]
        if state.remote_command[1] != 0.0 and now - state.commanded_s > self.rules.dead_man_s:
            steering = state.remote_command[0]
            state.remote_command = (steering, 0.0)
            self._issue_order(number, "command", steering_rad=steering, speed_mps=0.0)
            self.log_event(FLEET_MANAGER, "dead_man", tractor=number + 1)

    def _repeat_stop(self, number: int, now: float) -> None:
        """Order a tractor that drives on despite an order to stop to stop again, and raise an alarm."""
        state = self.states[number]
        if not is_disobeying(state, now, self.rules):
            if state.disobeying_motion is None:
                self.alarms.end_alarm("drives on", number)
            return
        self._raise_alarm(
            "drives on", number, CRITICAL, f"Tractor {number + 1} was ordered to stop and drives on.", now
        )
        if now - state.stop_repeated_s >= REPEAT_STOP_S:
            state.stop_repeated_s = now
            self._stop_tractor(number, next(iter(sorted(state.holds)), "not started"))

    def resend_orders(self, number: int) -> None:
        """Orders to a tractor may be lost: send all that matter again."""
        if self.version > 1:
            self._issue_order(number, "plan", base_end=self.states[number].base_end)
        self._send_base(number)
        self._issue_order(
            number, "stop" if self.states[number].standing_ordered else "resume", **self._describe_stop_reason(number)
        )

    def _release_legs(self) -> None:
        for number, state in enumerate(self.states):
            if state.has_no_more_legs or state.done:
                continue
            base_end = compute_base_end(number, self.timed_missions, self.states, self.blocked_legs[number], self.rules)
            limit_mps = self._compute_speed_limit(number)
            if base_end > state.base_end or limit_mps != state.limit_mps:
                if base_end > state.base_end == 0:
                    self._hold_behind_entrance_queue(number)
                state.update += base_end > state.base_end
                state.base_end, state.limit_mps = base_end, limit_mps
                self._send_base(number)

    def _hold_behind_entrance_queue(self, number: int) -> None:
        """A tractor that may enter now waits if others are at its entrance: they go one after the other."""
        state = self.states[number]
        if TOO_NEAR in state.holds or not self.guard.is_queueing(state, self.timed_missions[number]):
            return
        least_m = self.guard.neighbour_release_m[0]
        if any(
            self.guard.measure_neighbour_distance_m(state, neighbour) < least_m
            for neighbour in self.neighbours.find_nearby_tractors()
        ):
            state.holds.add(TOO_NEAR)
            self.log_event(FLEET_MANAGER, TOO_NEAR, tractor=number + 1)
            self._stop_tractor(number, TOO_NEAR)

    def _compute_speed_limit(self, number: int) -> float | None:
        """How fast a tractor may follow its leader (Eq. 6.1), rounded to cm/s; None without a leader.

        A leader that has failed or is silent counts as standing at its last place; without any report it is 0.
        """
        state, timed_mission = self.states[number], self.timed_missions[number]
        follow = timed_mission.legs[min(state.leg, len(timed_mission.legs) - 1)].follow
        if follow is None:
            return None
        leader = self.states[follow.tractor]
        if leader.done or leader.leg != follow.leg:
            return None
        own_report, leader_report = state.report, leader.report
        if own_report is None or leader_report is None:
            return 0.0
        is_lost = leader.failed or not self._is_report_current(follow.tractor)
        speed_mps = 0.0 if is_lost else abs(leader_report.speed_mps)
        gap_m = (leader_report.x_m - own_report.x_m) * math.cos(own_report.heading_rad) + (
            leader_report.y_m - own_report.y_m
        ) * math.sin(own_report.heading_rad)
        return round(float(compute_follower_speed(gap_m, follow.gap_m, speed_mps)), 2)

    def _stop_or_resume_by_danger(self, now: float) -> None:
        """Stop tractors in danger, and resume those out of it."""
        neighbours = self.neighbours.find_nearby_tractors()
        all_dangers = self.guard.find_dangers(self.states, self.timed_missions, neighbours)
        dangers = [danger for danger in all_dangers if not self.separation.is_parting(danger)]
        for danger in dangers:
            self._warn_of_danger(danger, {neighbour.key: neighbour.name for neighbour in neighbours}, now)
        self._clear_fence_holds({danger.first for danger in dangers if danger.second is None})
        pairs: list[tuple[int, int | TractorKey]] = [
            (i, j)
            for i in range(self.plan.tractor_count)
            for j in range(i + 1, self.plan.tractor_count)
            if self.alarms.is_alarm_on(build_proximity_alarm_code(j), i)
        ]
        pairs += self.find_neighbour_pairs()
        if pairs or self.separation.has_parting_pairs or any(TOO_NEAR in state.holds for state in self.states):
            self._resolve_near_pairs(pairs, neighbours, now)

    def _warn_of_danger(self, danger: SafetyDanger, names: Mapping[TractorKey, str], now: float) -> None:
        first, second = danger.first, danger.second
        if second is None:
            sentence = f"Tractor {first + 1} will leave the fence in {danger.in_s:.1f} s."
            hold, code = FENCE, "fence"
        else:
            self.separation.mark_endangered(first, second)
            pair_text = (
                f"s {first + 1} and {second + 1}" if isinstance(second, int) else f" {first + 1} and {names[second]}"
            )
            sentence = f"Tractor{pair_text} will come within {danger.distance_m:.2f} m in {danger.in_s:.1f} s."
            hold, code = TOO_NEAR, build_proximity_alarm_code(second)
        self._raise_alarm(code, first, CRITICAL if danger.is_urgent else WARNING, sentence, now)
        if not danger.is_urgent:
            return
        for number in (first, second):
            if not isinstance(number, int):  # a tractor of another fleet is held by its own fleet manager
                continue
            if hold not in self.states[number].holds and not self.states[number].done:
                self.states[number].holds.add(hold)
                self.log_event(FLEET_MANAGER, hold, tractor=number + 1)
                self._stop_tractor(number, hold)

    def _clear_fence_holds(self, leaving: set[int]) -> None:
        """End the fence holds of tractors that are inside and not about to leave."""
        for number, state in enumerate(self.states):
            if number not in leaving:
                self.alarms.end_alarm("fence", number)
                if self.guard.is_inside_fence(state):
                    state.holds.discard(FENCE)

    def _resolve_near_pairs(
        self, pairs: list[tuple[int, int | TractorKey]], neighbours: list[NeighbourTractor], now: float
    ) -> None:
        """Of tractors that are or were too near: end alarms, and choose who resumes."""
        close_pairs = self.guard.find_close_pairs(self.states, self.timed_missions, neighbours)
        near_states = {n: state for n, state in enumerate(self.states) if TOO_NEAR in state.holds}
        unattended = [
            n for n, state in near_states.items() if REMOTE_CONTROL not in state.holds and state.mode not in BY_HAND
        ]
        standing: list[int | TractorKey] = [
            *unattended,
            *(neighbour.key for neighbour in neighbours if neighbour.is_waiting),
        ]
        for number_a, number_b in self.separation.find_cleared_pairs(pairs, close_pairs, standing, now):
            self.alarms.end_alarm(build_proximity_alarm_code(number_b), number_a)
        for number, state in near_states.items():
            active_pairs = [
                pair
                for pair in pairs
                if number in pair and self.alarms.is_alarm_on(build_proximity_alarm_code(pair[1]), pair[0])
            ]
            if REMOTE_CONTROL in state.holds and not active_pairs:
                state.holds.discard(TOO_NEAR)  # every remote command is checked
        waiting = [
            n for n, state in near_states.items() if TOO_NEAR in state.holds and REMOTE_CONTROL not in state.holds
        ]
        movers_heard = [
            self._is_report_current(n) for n in unattended if _is_moving(near_states[n])
        ]  # of those that still move, whether they are heard
        movers_heard += [
            neighbour.is_linked for neighbour in neighbours if neighbour.is_waiting and neighbour.speed_mps > MOVING_MPS
        ]
        standing_numbers = [] if movers_heard else waiting
        is_path_clear = dict.fromkeys(waiting, False) | self.guard.find_clear_to_go(
            standing_numbers, self.states, self.timed_missions, neighbours
        )
        free_numbers = self.separation.find_tractors_free_to_resume(
            is_path_clear, now
        )  # to resume, the places of the others must be known
        neighbour_has_priority = any(
            neighbour.has_priority and neighbour.is_waiting and neighbour.is_free for neighbour in neighbours
        )
        if free_numbers and not neighbour_has_priority:
            next_number = min(free_numbers, key=lambda n: (-self._compute_metres_until_wait(n, waiting), n))
            self.states[next_number].holds.discard(TOO_NEAR)
            self.separation.start_parting(next_number, close_pairs)
            self.neighbours.restart_waiting_times()
            self.log_event(FLEET_MANAGER, "goes on", tractor=next_number + 1)
        elif not any(movers_heard) and not neighbour_has_priority:  # a silent one may be braking still
            self._alarm_stuck_pairs({*pairs, *close_pairs}, waiting, neighbours, now)

    def _is_report_current(self, number: int) -> bool:
        """Whether the last report of a tractor shows what it does now."""
        return self.states[number].is_linked and not self._is_link_broken(number)

    def _alarm_stuck_pairs(
        self,
        pairs: Collection[tuple[int, int | TractorKey]],
        waiting: list[int],
        neighbours: list[NeighbourTractor],
        now: float,
    ) -> None:
        """Raise alarms for standing pairs that cannot resume by themselves."""
        for first, neighbour in sorted(
            ((first, neighbour) for first, second in pairs for neighbour in neighbours if neighbour.key == second),
            key=lambda pair: (pair[0], pair[1].key),
        ):
            if first in waiting and self.separation.is_stuck(first, now):
                self._warn_stuck_beside(first, neighbour, now)
        for first, second in sorted((first, second) for first, second in pairs if isinstance(second, int)):
            waiting_pair = [n for n in (first, second) if n in waiting]
            if waiting_pair and all(self.separation.is_stuck(n, now) for n in waiting_pair):
                distance_m = self.guard.measure_distance_m(first, second, self.states)
                sentence = (
                    f"Tractors {first + 1} and {second + 1} stand {distance_m:.2f} m apart and cannot resume by "
                    "themselves: look there, and drive one away by remote control."
                )
                self._raise_alarm(build_proximity_alarm_code(second), first, CRITICAL, sentence, now)

    def _compute_metres_until_wait(self, number: int, waiting: list[int]) -> float:
        """Metres that a tractor can drive before it waits for one of `waiting`; infinite if it never does."""
        timed_mission, state = self.timed_missions[number], self.states[number]
        for leg in range(state.base_end, len(timed_mission.legs)):
            if any(gate.tractor in waiting for gate in find_closed_gates(timed_mission, leg, self.states)):
                return timed_mission.leg_starts_m[leg] - timed_mission.leg_starts_m[state.leg] - state.leg_m
        return math.inf

    def _update_forecast(self) -> None:
        halted = [
            self.state != RUNNING
            or bool(s.holds - {TOO_NEAR, WAITS_FOR_PLAN})
            or bool(self.blocked_legs[n])
            or s.failed
            for n, s in enumerate(self.states)
        ]
        places = [self._find_twin_place(number) for number in range(self.plan.tractor_count)]
        self.finish_in_s = [
            s / self.rules.times for s in forecast_finish_s(self.timed_missions, self.states, halted, places)
        ]
        if (
            self.state == RUNNING
            and all(s.done or s.has_no_more_legs for s in self.states)
            and any(s.done for s in self.states)
        ):
            self.state = DONE
            self.log_event(FLEET_MANAGER, "fleet done")

    def _find_twin_place(self, number: int) -> tuple[int, float] | None:
        """Leg and metres on it where the twin of a tractor is; None without a twin or off the legs."""
        state, twin_place = self.states[number], self.twins.find_place(number)
        if twin_place is None or state.mode != AUTOMATIC or state.done:
            return None
        return self.timed_missions[number].locate_ahead(state.leg, state.leg_m, state.base_end, twin_place)


def _is_moving(state: TractorState) -> bool:
    return state.report is not None and state.report.speed_mps > MOVING_MPS
