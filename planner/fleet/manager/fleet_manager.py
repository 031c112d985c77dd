"""The fleet manager executes one plan with real tractors, without network or clock: callers pass the time.

Tractors and legs count from 0. Callers collect orders and events with `take_outputs` after each call.
"""

from __future__ import annotations

import math

from planner.fleet.manager.danger_watch import DangerWatch
from planner.fleet.manager.finish_forecast import forecast_finish_s
from planner.fleet.manager.fleet_state import DONE, DOUBT_CODE, FLEET_MANAGER, RUNNING, FleetState
from planner.fleet.manager.obstacle_reports import ObstacleReports
from planner.fleet.manager.operator_orders import OperatorOrders
from planner.fleet.model.alarms import CRITICAL, WARNING
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import REFRESH_PERIOD_S, FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import (
    AUTOMATIC,
    BROKEN,
    BY_HAND,
    MANUAL,
    REMOTE,
    Hold,
    MotionDoubt,
    TractorReport,
)
from planner.fleet.safety.compliance import (
    REPEAT_STOP_S,
    build_area_doubt,
    describe_doubt,
    find_impossible_place_reason,
    is_disobeying,
    is_driving_on,
)
from planner.fleet.safety.credible_motion import CredibleMotion
from planner.fleet.safety.motion_prediction import TwinPredictions
from vehicle.control.speed import compute_follower_speed

WATCH_PERIOD_S = 0.2
LONGEST_STEP_S = 2.0  # between two reports that counts as driving


class FleetManager(FleetState):
    """Executes one plan with real tractors: `operators` order, `obstacle_reports` come in, `dangers` are watched."""

    def __init__(self, plan: FleetPlan, rules: FleetRules, twins: TwinPredictions | None = None) -> None:
        super().__init__(plan, rules, twins)
        self.obstacle_reports, self.dangers = ObstacleReports(self), DangerWatch(self)
        self.operators = OperatorOrders(self, self.obstacle_reports)
        self.motions = [
            CredibleMotion(plan.tractor.antenna_forward_m, rules.rejoin_m, rules.times) for _ in self.states
        ]
        self._watched_at_s = -math.inf

    def connect_tractor(self, number: int, now: float) -> None:
        """The link of a tractor is up: send it its base, and stop or resume."""
        self.check_tractor_number(number)
        state = self.states[number]
        state.is_linked, state.has_disconnected, state.last_contact_s = True, False, now
        self.alarms.end_alarm("broken", number)
        state.limit_mps = self._compute_speed_limit(number)
        self.send_base(number)
        self.repeat_stop_or_resume(number)

    def warn_of_replaced_link(self, number: int, now: float) -> None:
        """Another link claims to be this tractor; the previous one was ordered to stop and closed."""
        sentence = (
            f"Tractor {number + 1} has connected a second time: the first link was ordered to stop and closed. "
            "If that was another tractor, check who has its token."
        )
        self.raise_alarm("replaced", number, WARNING, sentence, now)
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
        self.raise_alarm("clock", number, WARNING, sentence, now)

    def disconnect_tractor(self, number: int, now: float, is_orderly: bool) -> None:
        """The link of a tractor is down: closed by the tractor (`is_orderly`), or broken."""
        state = self.states[number]
        state.is_linked, state.has_disconnected = False, is_orderly
        if not is_orderly or state.is_moving:  # who moves as it leaves may go anywhere
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
        state, legs = self.states[number], self.states[number].mission.legs
        if not 0 <= report.leg < len(legs):
            raise FleetManagerError(
                f"Tractor {number + 1} reports leg {report.leg}, but its plan has {len(legs)} legs; send it this plan.",
                parameter="leg",
            )
        previous, state.report = state.report, report
        driving_s = self._compute_driving_s(previous, report, now - state.last_contact_s)
        state.delay_s = delay_s
        state.last_fix_s = max(state.last_fix_s, now - age_s - unsure_s)
        self._note_contact(number, age_s, now)
        is_possible = self._check_reported_place(number, report, now)
        self._check_reported_motion(number, report, is_possible, now, delay_s)
        if not is_possible or state.doubt is not None:
            return
        if (report.leg, report.leg_m) >= (state.leg, state.leg_m):  # legs never go back
            before_s = state.mission.compute_driven_s(state.leg, state.leg_m)
            state.leg, state.leg_m = report.leg, report.leg_m
            if driving_s > 0.0:
                state.driving_s += driving_s
                state.planned_driving_s += state.mission.compute_driven_s(state.leg, state.leg_m) - before_s
        self.add_coverage(number, report.x_m, report.y_m, bool(report.implement))
        if report.errors and (previous is None or previous.errors != report.errors):
            sentence = f"Tractor {number + 1} reports: {'; '.join(report.errors)}."
            self.raise_alarm("error", number, WARNING, sentence, now)
        elif not report.errors:
            self.alarms.end_alarm("error", number)
        if report.done and not state.done and report.leg == len(legs) - 1 < state.base_end:
            state.done = True
            self.log_event(FLEET_MANAGER, "done", tractor=number + 1)

    def _note_contact(self, number: int, age_s: float, now: float) -> None:
        """Note that a report came; an old one does not show that the link works now."""
        if age_s > 0.0:
            sentence = (
                f"States of tractor {number + 1} arrive {age_s:.1f} s late: its link is slow or its clock is wrong."
            )
            self.raise_alarm("late", number, WARNING, sentence, now)
            return
        self.states[number].last_contact_s = now
        self.alarms.end_alarm("late", number)
        self.alarms.end_alarm("broken", number)

    def _check_reported_place(self, number: int, report: TractorReport, now: float) -> bool:
        """Whether the reported place is possible; if not, the tractor stops and its report is not used."""
        state = self.states[number]
        fault = find_impossible_place_reason(report, state)
        if fault is None:
            self.alarms.end_alarm("astray", number)
            state.holds.discard(Hold.ASTRAY)
            return True
        sentence = f"Tractor {number + 1} reports that it is {fault}: it stops."
        self.raise_alarm("astray", number, CRITICAL, sentence, now)
        self.hold_tractor(number, Hold.ASTRAY)
        return False

    def _check_reported_motion(
        self, number: int, report: TractorReport, is_place_possible: bool, now: float, delay_s: float
    ) -> None:
        """Doubt a tractor whose reports contradict each other, by its own clock, as reports may be late."""
        state, motion = self.states[number], self.motions[number]
        if report.time_s is None:
            return
        leg_pose = None
        if is_place_possible and report.mode not in BY_HAND:
            leg_pose = state.mission.find_pose(report.leg, report.leg_m, state.base_end)
        times = self.rules.times
        motion.add_report(report, leg_pose, times * report.time_s, times * now, times * delay_s)
        state.is_moving_unreported = motion.is_moving_unreported
        if state.doubt is not None:
            state.doubt.speed_mps = max(state.doubt.speed_mps, motion.measure_speed_mps())
        if state.doubt is None and motion.doubt is not None:
            self._start_doubt(number, motion.doubt, now)

    def _start_doubt(self, number: int, doubt: MotionDoubt, now: float) -> None:
        """Hold a tractor in doubt until an operator has looked; others keep away from where it may be."""
        self.states[number].doubt = doubt
        doubt.since_s = now - doubt.over_s / self.rules.times
        self.raise_alarm(DOUBT_CODE, number, WARNING, describe_doubt(number, doubt), now)
        self.hold_tractor(number, Hold.DOUBTED, is_logged=True)

    def _update_doubt(self, number: int, now: float) -> None:
        """Let the area of a doubted tractor grow; the doubt ends with its hold, which an operator ends."""
        state = self.states[number]
        if Hold.DOUBTED not in state.holds:
            self.alarms.end_alarm(DOUBT_CODE, number)
            if state.doubt is not None:
                state.doubt, state.is_moving_unreported, state.stood_at = None, False, None
                self.motions[number].restart()
            return
        if state.doubt is not None:
            state.doubt.radius_m = state.doubt.speed_mps * self.rules.times * (now - state.doubt.since_s)

    def _compute_driving_s(self, previous: TractorReport | None, report: TractorReport, silent_s: float) -> float:
        """Seconds (simulated clock) that a tractor drove by its own guidance since its last report.

        The tractor's own clock counts if known, as reports that waited for a link come all at once.
        """
        if previous is not None and previous.time_s is not None and report.time_s is not None:
            silent_s = report.time_s - previous.time_s
        is_driving = report.mode == AUTOMATIC and 0.0 <= silent_s <= LONGEST_STEP_S and report.speed_mps > 0.0
        return silent_s * self.rules.times if is_driving else 0.0

    def _alarm_broken_link(self, number: int, now: float) -> None:
        state = self.states[number]
        if not state.done:
            sentence = f"The link to tractor {number + 1} is broken: {self._describe_behaviour_offline(number)}."
            self.raise_alarm("broken", number, CRITICAL, sentence, now)
        state.limit_mps = None

    def _describe_behaviour_offline(self, number: int) -> str:
        """What a tractor does while it hears nothing from the fleet manager."""
        state, rules = self.states[number], self.rules
        if state.mode == MANUAL:
            return "its driver drives it by hand"
        if state.standing_ordered and not is_driving_on(state) and state.mode != REMOTE:
            return "it was ordered to stop, and stands"
        if state.mode == REMOTE or self._compute_speed_limit(number) is not None:
            return f"it stops after {rules.silence_s:.1f} s"
        remaining_m = max(state.base_end_m - state.position_m, 0.0)
        return f"it drives on for {rules.horizon_s:.1f} s, or {remaining_m:.1f} m to the end of its base, and stops"

    def update_fleet(self, now: float) -> None:
        """Do everything that depends on time; to be called ten times a second."""
        for number, state in enumerate(self.states):
            if self.is_report_current(number) and state.get_connection(now, self.rules.silence_s) == BROKEN:
                self._alarm_broken_link(number, now)
            self._stop_silent_remote_control(number, now)
            self._update_doubt(number, now)
        self.dangers.hold_unplaced_fleet()
        if now - self._watched_at_s >= WATCH_PERIOD_S / self.rules.times:
            self._watched_at_s = now
            self.dangers.stop_or_resume_by_danger(now)
            self.clear_passed_obstacles()
            self.obstacle_reports.release_tractors_reporting_readably(now)
        self.hold_tractors_at_gates()
        self.send_stop_or_resume()
        for number in range(self.plan.tractor_count):
            self._repeat_stop(number, now)
        if self.state == RUNNING:
            self._release_legs()
        if now - self.forecast_at_s >= REFRESH_PERIOD_S:
            self.forecast_at_s = now
            self._update_forecast()

    def _stop_silent_remote_control(self, number: int, now: float) -> None:
        """Stop a tractor whose remote control has gone silent."""
        state = self.states[number]
        if state.remote_command[1] != 0.0 and now - state.commanded_s > self.rules.dead_man_s:
            steering = state.remote_command[0]
            state.remote_command = (steering, 0.0)
            self.issue_order(number, "command", steering_rad=steering, speed_mps=0.0)
            self.log_event(FLEET_MANAGER, "dead_man", tractor=number + 1)

    def _repeat_stop(self, number: int, now: float) -> None:
        """Order a tractor that drives on despite an order to stop to stop again, and raise an alarm."""
        state = self.states[number]
        if not is_disobeying(state, now, self.rules):
            if state.disobeying_motion is None:
                self.alarms.end_alarm("drives on", number)
            return
        sentence = f"Tractor {number + 1} was ordered to stop and drives on."
        self.raise_alarm("drives on", number, CRITICAL, sentence, now)
        if state.doubt is None and state.report is not None and state.mode != MANUAL:  # else a driver looks
            state.stop_repeated_s = now
            self._start_doubt(number, build_area_doubt(state.report, state.report.speed_mps), now)
        if now - state.stop_repeated_s >= REPEAT_STOP_S:
            state.stop_repeated_s = now
            self.stop_tractor(number, state.stop_reason)

    def resend_orders(self, number: int) -> None:
        """Orders to a tractor may be lost: send all that matter again."""
        if self.version > 1:
            self.issue_order(number, "plan", base_end=self.states[number].base_end)
        self.send_base(number)
        self.repeat_stop_or_resume(number)

    def _release_legs(self) -> None:
        for number, state in enumerate(self.states):
            if state.has_no_more_legs or state.done:
                continue
            base_end = state.compute_base_end(self.states, self.blocked_legs[number], self.rules)
            limit_mps = self._compute_speed_limit(number)
            if base_end > state.base_end or limit_mps != state.limit_mps:
                if base_end > state.base_end == 0:
                    self._hold_behind_entrance_queue(number)
                state.update += base_end > state.base_end
                state.base_end, state.limit_mps = base_end, limit_mps
                self.send_base(number)

    def _hold_behind_entrance_queue(self, number: int) -> None:
        """A tractor that may enter now waits if others are at its entrance: they go one after the other."""
        state = self.states[number]
        if Hold.TOO_NEAR not in state.holds and self.guard.is_queueing(state):
            neighbours, least_m = self.neighbours.find_nearby_tractors(), self.guard.neighbour_release_m[0]
            if any(self.guard.measure_distance_m(state, neighbour) < least_m for neighbour in neighbours):
                self.hold_tractor(number, Hold.TOO_NEAR, is_logged=True)

    def _compute_speed_limit(self, number: int) -> float | None:
        """How fast a tractor may follow its leader (Eq. 6.1), rounded to cm/s; None without a leader.

        A leader that has failed, is silent or in doubt counts as standing at its last place; without reports it is 0.
        """
        state = self.states[number]
        follow = state.present_leg.follow
        if follow is None:
            return None
        leader = self.states[follow.tractor]
        if leader.done or leader.leg != follow.leg:
            return None
        own_report, leader_report = state.report, leader.report
        if own_report is None or leader_report is None:
            return 0.0
        is_lost = leader.failed or leader.doubt is not None or not self.is_report_current(follow.tractor)
        speed_mps = 0.0 if is_lost else abs(leader_report.speed_mps)
        gap_m = (leader_report.x_m - own_report.x_m) * math.cos(own_report.heading_rad) + (
            leader_report.y_m - own_report.y_m
        ) * math.sin(own_report.heading_rad)
        return round(float(compute_follower_speed(gap_m, follow.gap_m, speed_mps)), 2)

    def _update_forecast(self) -> None:
        halted = [
            self.state != RUNNING
            or bool(s.holds - {Hold.TOO_NEAR, Hold.WAITS_FOR_PLAN})
            or bool(self.blocked_legs[n])
            or s.failed
            for n, s in enumerate(self.states)
        ]
        places = [self._find_twin_place(number) for number in range(self.plan.tractor_count)]
        self.finish_in_s = [s / self.rules.times for s in forecast_finish_s(self.states, halted, places)]
        are_all_done = all(s.done or s.has_no_more_legs for s in self.states) and any(s.done for s in self.states)
        if self.state == RUNNING and are_all_done:
            self.state = DONE
            self.log_event(FLEET_MANAGER, "fleet done")

    def _find_twin_place(self, number: int) -> tuple[int, float] | None:
        """Leg and metres on it where the twin of a tractor is; None without a twin or off the legs."""
        state, twin_place = self.states[number], self.twins.find_place(number)
        if twin_place is None or state.mode != AUTOMATIC or state.done:
            return None
        return state.mission.locate_ahead(state.leg, state.leg_m, state.base_end, twin_place)
