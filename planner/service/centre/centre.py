"""The control centre of one fleet, without a network and without a clock: times are given to it, orders taken from it.

Tractors and legs count from 0. Whoever calls takes orders and events with `taken` after each call.
"""

from __future__ import annotations

import math

from planner.service.centre.alarms import CRITICAL, WARNING
from planner.service.centre.core import CENTRE, DONE, RUNNING
from planner.service.centre.course import Course
from planner.service.centre.errors import CentreError
from planner.service.centre.forecast import finish_in_s
from planner.service.centre.guard import MOVING_MPS, Danger
from planner.service.centre.obeying import AGAIN_S, disobeys
from planner.service.centre.operated import Operated
from planner.service.centre.plausible import fault_of
from planner.service.centre.releasing import base_end, closed_gates
from planner.service.centre.tractors import (
    ASTRAY,
    AUTOMATIC,
    BROKEN,
    BY_HAND,
    DRIVEN,
    FENCE,
    HALTED,
    NEAR,
    WAITS,
    Report,
    TractorState,
)
from planner.service.centre.tractors import STOPPED as STOOD
from vehicle.speed import follower_speed

WATCH_S, FORECAST_S = 0.2, 1.0
REMEMBER_S = 1.0  # in which states that waited for a link have come, and newer ones
LONGEST_STEP_S = 2.0  # between two reports that counts as driving


class Centre(Operated):
    """Executes one plan with real tractors."""

    def joined(self, number: int, now: float) -> None:
        """The link of a tractor is up: it is told at once what it may do."""
        self.check_number(number)
        state = self.states[number]
        state.linked, state.said_goodbye, state.heard_s, state.joined_s = True, False, now, now
        self.alarms.ended("broken", number)
        state.limit_mps = self._limit(number)
        self._tell_release(number)
        if state.holds or not state.doubtful:  # it may be held for what was seen since the memory ends
            self._order(number, "stop" if state.standing_ordered else "resume", **self._why(number))

    def left(self, number: int, now: float, goodbye: bool) -> None:
        """The link of a tractor is down, with a goodbye or broken."""
        state = self.states[number]
        state.linked, state.said_goodbye = False, goodbye
        if not goodbye:
            self._broken(number, now)

    def reported(
        self, number: int, report: Report, now: float, age_s: float = 0.0, *, delay_s: float = 0.0
    ) -> None:
        """A tractor says where it is, or was `age_s` ago where the report is much too old to say where it is.

        `delay_s` is how long the report has been on its way, by the clocks of both. Raises CentreError for a leg that
        it does not have.
        """
        state, course = self.states[number], self.courses[number]
        if not 0 <= report.leg < len(course.legs):
            raise CentreError(
                f"Tractor {number + 1} reports leg {report.leg} of {len(course.legs)}; it drives another plan.",
                parameter="leg",
            )
        before, state.report = state.report, report
        driving_s = self._driving_s(before, report, now - state.heard_s)
        state.delay_s = delay_s
        state.seen_s = max(state.seen_s, now - age_s)
        self._heard(number, age_s, now)
        if not self._believed(number, report, now):
            return
        self._progressed(state, course, report, driving_s)
        self.painting.at(number, report.x_m, report.y_m, bool(report.implement))
        if report.errors and (before is None or before.errors != report.errors):
            self._alarm("error", number, WARNING, f"Tractor {number + 1} reports: {'; '.join(report.errors)}.", now)
        elif not report.errors:
            self.alarms.ended("error", number)
        if report.done and not state.done and report.leg == len(course.legs) - 1 < state.released:
            state.done = True
            self.note(CENTRE, "done", tractor=number + 1)

    def _heard(self, number: int, age_s: float, now: float) -> None:
        """A report has come; one that is old is no sign of a link that works now."""
        if age_s > 0.0:
            told = f"States of tractor {number + 1} come {age_s:.1f} s late: its link is slow, or its clock is wrong."
            self._alarm("late", number, WARNING, told, now)
            return
        self.states[number].heard_s = now
        self.alarms.ended("late", number)
        self.alarms.ended("broken", number)

    def _believed(self, number: int, report: Report, now: float) -> bool:
        """Whether a tractor can be where it says; if not it stands, and nothing is released by it."""
        state = self.states[number]
        fault = fault_of(report, state, self.courses[number])
        if fault is None:
            self.alarms.ended("astray", number)
            state.holds.discard(ASTRAY)
            return True
        self._alarm("astray", number, CRITICAL, f"Tractor {number + 1} says it is {fault}: it stands.", now)
        if ASTRAY not in state.holds:
            state.holds.add(ASTRAY)
            self._stand(number, ASTRAY)
        return False

    def _driving_s(self, before: Report | None, report: Report, silent_s: float) -> float:
        """Seconds of the plan's time that a tractor drove by its own guidance since it reported last.

        Its own clock counts where it has one, as reports that waited for a link come all at once.
        """
        if before is not None and before.time_s is not None and report.time_s is not None:
            silent_s = report.time_s - before.time_s
        drove = report.mode == AUTOMATIC and 0.0 <= silent_s <= LONGEST_STEP_S and report.speed_mps > 0.0
        return silent_s * self.rules.times if drove else 0.0

    def _progressed(self, state: TractorState, course: Course, report: Report, driving_s: float) -> None:
        if (report.leg, report.leg_m) < (state.leg, state.leg_m):
            return
        planned = course.driven_s(report.leg, report.leg_m) - course.driven_s(state.leg, state.leg_m)
        state.leg, state.leg_m = report.leg, report.leg_m
        if driving_s > 0.0:
            state.driving_s += driving_s
            state.driven_plan_s += planned

    def _broken(self, number: int, now: float) -> None:
        state = self.states[number]
        if not state.done:
            self._alarm(
                "broken", number, CRITICAL, f"The link to tractor {number + 1} is broken: it ends its released leg "
                "and stops.", now,
            )  # fmt: skip
        state.limit_mps = None

    def _remember(self, number: int, now: float) -> None:
        """Ask one that drove when the centre's memory ends whether it was told to stand after that.

        It is neither told to stand nor to go on until it has reported for a while; those that follow stand by the
        silence of the centre alone.
        """
        state = self.states[number]
        if not state.doubtful or not state.linked:
            return
        if now - state.joined_s < REMEMBER_S or state.seen_s <= state.joined_s:
            return
        state.doubtful = False
        follows = self.courses[number].legs[min(state.leg, len(self.courses[number].legs) - 1)].follow is not None
        if state.mode != STOOD or follows or state.done:
            return
        state.holds.add(HALTED)
        told = f"Tractor {number + 1} was told to stand just before the service ended, or begun anew: let it go on."
        self._alarm("stood", number, WARNING, told, now)

    def tick(self, now: float) -> None:
        """Look after everything that only time brings about; to be called ten times a second."""
        for number in range(self.plan.tractors):
            self._remember(number, now)
        for number, state in enumerate(self.states):
            if state.linked and state.connection(now, self.rules.silence_s) == BROKEN and not self._is_on(number):
                self._broken(number, now)
            self._dead_man(number, now)
        if now - self._watched_s >= WATCH_S / self.rules.times:
            self._watched_s = now
            self._watch(now)
            self._look_again()
            self.read_again(now)
        self._wait()
        self._settle()
        for number in range(self.plan.tractors):
            self._insist(number, now)
        if self.state == RUNNING:
            self._release()
        if now - self._forecast_s >= FORECAST_S:
            self._forecast_s = now
            self._forecast()

    def _is_on(self, number: int) -> bool:
        return self.alarms.on("broken", number)

    def _dead_man(self, number: int, now: float) -> None:
        """Nobody says any more how a tractor is to be driven: it stands."""
        state = self.states[number]
        if state.remote_command[1] != 0.0 and now - state.commanded_s > self.rules.dead_man_s:
            steering = state.remote_command[0]
            state.remote_command = (steering, 0.0)
            self._order(number, "command", steering_rad=steering, speed_mps=0.0)
            self.note(CENTRE, "dead_man", tractor=number + 1)

    def _insist(self, number: int, now: float) -> None:
        """One that drives on though it was told to stand is told again, and so is everybody who watches."""
        state = self.states[number]
        if not disobeys(state, now, self.rules):
            if state.driving_on is None:
                self.alarms.ended("drives on", number)
            return
        self._alarm("drives on", number, CRITICAL, f"Tractor {number + 1} was told to stand and drives on.", now)
        if now - state.told_again_s >= AGAIN_S:
            state.told_again_s = now
            self._stand(number, next(iter(sorted(state.holds)), "not started"))

    def told_anew(self, number: int) -> None:
        """What a tractor was told may be lost: all that counts is told once more."""
        if self.version > 1:
            self._order(number, "plan", released=self.states[number].released)
        self._tell_release(number)
        self._order(number, "stop" if self.states[number].standing_ordered else "resume", **self._why(number))

    def _release(self) -> None:
        for number, state in enumerate(self.states):
            if state.out or state.done:
                continue
            base = base_end(number, self.courses, self.states, self.blocked[number], self.rules)
            limit = self._limit(number)
            if base > state.released or limit != state.limit_mps:
                state.update += base > state.released
                state.released, state.limit_mps = base, limit
                self._tell_release(number)

    def _limit(self, number: int) -> float | None:
        """How fast a tractor may follow its leader (Eq. 6.1), rounded to centimetres a second; None for no leader.

        One that has failed or is not heard of counts as standing where it was last; where nobody knows, nobody drives.
        """
        state, course = self.states[number], self.courses[number]
        follow = course.legs[min(state.leg, len(course.legs) - 1)].follow
        if follow is None:
            return None
        leader = self.states[follow.tractor]
        if leader.done or leader.leg != follow.leg:
            return None
        mine, its = state.report, leader.report
        if mine is None or its is None:
            return 0.0
        lost = leader.failed or not leader.linked or self._is_on(follow.tractor)
        speed_mps = 0.0 if lost else abs(its.speed_mps)
        gap = (its.x_m - mine.x_m) * math.cos(mine.heading_rad) + (its.y_m - mine.y_m) * math.sin(mine.heading_rad)
        return round(float(follower_speed(gap, follow.gap_m, speed_mps)), 2)

    def _watch(self, now: float) -> None:
        """Hold those in danger, let go those out of it."""
        dangers = [danger for danger in self.guard.dangers(self.states, self.courses) if not self.near.parts(danger)]
        for danger in dangers:
            self._warn(danger, now)
        self._inside({danger.first for danger in dangers if danger.second is None})
        pairs = [(i, j) for i in range(self.plan.tractors) for j in range(i + 1, self.plan.tractors)
                 if self.alarms.on(_near(j), i)]  # fmt: skip
        if pairs or self.near.watched or any(NEAR in state.holds for state in self.states):
            self._part(pairs, now)

    def _warn(self, danger: Danger, now: float) -> None:
        one, other = danger.first, danger.second
        if other is None:
            told = f"Tractor {one + 1} leaves the fence in {danger.in_s:.1f} s."
            hold, code = FENCE, "fence"
        else:
            self.near.endangered(one, other)
            told = f"Tractors {one + 1} and {other + 1} come within {danger.metres:.2f} m in {danger.in_s:.1f} s."
            hold, code = NEAR, _near(other)
        self._alarm(code, one, CRITICAL if danger.urgent else WARNING, told, now)
        if not danger.urgent:
            return
        for number in (one, other):
            if number is not None and hold not in self.states[number].holds and not self.states[number].done:
                self.states[number].holds.add(hold)
                self.note(CENTRE, hold, tractor=number + 1)
                self._stand(number, hold)

    def _inside(self, leaving: set[int]) -> None:
        """Those within the fence, and not about to leave it, do not stand for it any more."""
        for number, state in enumerate(self.states):
            if number not in leaving:
                self.alarms.ended("fence", number)
                if self.guard.inside(state):
                    state.holds.discard(FENCE)

    def _part(self, pairs: list[tuple[int, int]], now: float) -> None:
        """Of those that are too near, or were: whose alarm is over, and who goes on."""
        close = self.guard.close(self.states, self.courses)
        near = {n: state for n, state in enumerate(self.states) if NEAR in state.holds}
        alone = [n for n, state in near.items() if DRIVEN not in state.holds and state.mode not in BY_HAND]
        for one, other in self.near.over(pairs, close, alone, now):
            self.alarms.ended(_near(other), one)
        for number, state in near.items():
            on = [pair for pair in pairs if number in pair and self.alarms.on(_near(pair[1]), pair[0])]
            if DRIVEN in state.holds and not on:
                state.holds.discard(NEAR)  # what its operator may do is asked at every command
        waiting = [n for n, state in near.items() if NEAR in state.holds and DRIVEN not in state.holds]
        reports = [near[n].report for n in alone]
        moving = any(report is not None and report.speed_mps > MOVING_MPS for report in reports)
        still = [] if moving else waiting
        ways = dict.fromkeys(waiting, False) | self.guard.may_go(still, self.states, self.courses)
        free = self.near.free(ways, now)  # whoever goes on must know where the others stand
        if free:
            first = min(free, key=lambda n: (-self._free_m(n, waiting), n))
            self.states[first].holds.discard(NEAR)
            self.near.goes(first, close)
            self.note(CENTRE, "goes on", tractor=first + 1)
        elif not moving:
            self._tell_stuck(sorted({*pairs, *close}), waiting, now)

    def _tell_stuck(self, pairs: list[tuple[int, int]], waiting: list[int], now: float) -> None:
        """Nobody of a pair that stands can go on: an operator has to help."""
        for one, other in pairs:
            held = [n for n in (one, other) if n in waiting]
            if held and all(self.near.stuck(n, now) for n in held):
                metres = self.guard.apart_m(one, other, self.states)
                told = (f"Tractors {one + 1} and {other + 1} stand {metres:.2f} m apart, and no way on is clear: look "
                        "there, and lead one away by remote control.")  # fmt: skip
                self._alarm(_near(other), one, CRITICAL, told, now)

    def _free_m(self, number: int, others: list[int]) -> float:
        """Metres that a tractor drives before it has to wait for one of these; infinite for one that never has to."""
        course, state = self.courses[number], self.states[number]
        for leg in range(state.released, len(course.legs)):
            if any(gate.tractor in others for gate in closed_gates(course, leg, self.states)):
                return course.before_m[leg] - course.before_m[state.leg] - state.leg_m
        return math.inf

    def _forecast(self) -> None:
        halted = [self.state != RUNNING or bool(s.holds - {NEAR, WAITS}) or bool(self.blocked[n]) or s.failed
                  for n, s in enumerate(self.states)]  # fmt: skip
        places = [self._place(number) for number in range(self.plan.tractors)]
        self.finish_in_s = [s / self.rules.times for s in finish_in_s(self.courses, self.states, halted, places)]
        if self.state == RUNNING and all(s.done or s.out for s in self.states) and any(s.done for s in self.states):
            self.state = DONE
            self.note(CENTRE, "fleet done")

    def _place(self, number: int) -> tuple[int, float] | None:
        """The leg and the metres on it where the twin of a tractor is; None where it has none or leaves its legs."""
        state, seen = self.states[number], self.twins.place(number)
        if seen is None or state.mode != AUTOMATIC or state.done:
            return None
        return self.courses[number].onward(state.leg, state.leg_m, state.released, seen)


def _near(other: int) -> str:
    """The code of the alarm of a tractor with a later one that it comes too near."""
    return f"near {other + 1}"
