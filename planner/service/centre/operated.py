"""What operators order: start, pause, resume, stop, remote control, tractors that have failed, another plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

from planner.service.centre.alarms import CRITICAL
from planner.service.centre.core import READY, RUNNING, STOPPED
from planner.service.centre.course import Course
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan
from planner.service.centre.guard import MOVING_MPS, Guard
from planner.service.centre.releasing import passed
from planner.service.centre.remaining import stands
from planner.service.centre.seeing import Seeing
from planner.service.centre.tractors import DRIVEN, FAILED, GIVEN, HALTED, ONLINE, PAUSED, SAFE_TO_DRIVE, TractorState

SEEN_S = 1.0  # in which a stop is shown to all who watch, and seen
REJOIN_RAD = math.radians(45.0)  # between the heading of a tractor that goes on by itself and that of its leg


class Operated(Seeing):
    """A fleet that takes orders; `who` gave each is in the log."""

    def start(self, who: str, now: float) -> None:
        """Let everybody drive. Raises CentreError right after somebody else has told them to stand."""
        self._check_stopped(who, None, now)
        self.started_s = now if self.started_s is None else self.started_s
        self.state = RUNNING
        for state in self.states:
            state.holds -= {PAUSED, HALTED}
            state.doubtful = False
        self.note(who, "started")
        self._settle()

    def pause(self, who: str, number: int | None, now: float) -> None:
        """One tractor or all stand until they are resumed."""
        for each in self._chosen(number):
            self.states[each].holds.add(PAUSED)
            self._stand(each, PAUSED)
            self._stopped[each] = who, now
        self.note(who, "paused", tractor=None if number is None else number + 1)
        self._settle()

    def resume(self, who: str, number: int | None, now: float) -> None:
        """One tractor or all go on by themselves; raises CentreError for one that stands too far off its leg, or
        across it, and right after somebody else has told them to stand. Who lets one go on has looked what it sees."""
        self._check_stopped(who, number, now)
        if number is not None:
            self.check_looked(number, now)
        for each in self._chosen(number):
            self._rejoin(each, alone=number is not None)
        if number is not None:
            self.looked(who, number, now)
        if self.state in (READY, STOPPED) and number is None:
            self.started_s = now if self.started_s is None else self.started_s
            self.state = RUNNING
        self.note(who, "resumed", tractor=None if number is None else number + 1)
        self._settle()

    def _check_stopped(self, who: str, number: int | None, now: float) -> None:
        """Who orders tractors to go on must have had the time to see that somebody else has just stopped them."""
        for each in self._chosen(number):
            by, at_s = self._stopped[each]
            if by != who and now - at_s < SEEN_S:
                raise CentreError(f"Tractor {each + 1} was stopped by {by} just now; look why, and let it go on then.")

    def _rejoin(self, number: int, alone: bool) -> None:
        state = self.states[number]
        off_m = off_rad = 0.0
        if state.report is not None and DRIVEN in state.holds:
            place = state.report.x_m, state.report.y_m
            off_m = self.courses[number].off_m(state.leg, place)
            off_rad = self.courses[number].off_rad(state.leg, place, state.report.heading_rad)
        held = self.leases.holder(number) is not None
        if alone and held:
            raise CentreError(f"Tractor {number + 1} is driven by {self.leases.holder(number)}; they must leave first.")
        if alone and GIVEN in state.holds:
            raise CentreError(f"The tracks of tractor {number + 1} were given to others; it can be driven by remote "
                              "control alone.", parameter="tractor")  # fmt: skip
        if alone and off_m > self.rules.rejoin_m:
            raise CentreError(
                f"Tractor {number + 1} stands {off_m:.1f} m off its leg; drive it back to within "
                f"{self.rules.rejoin_m:g} m first."
            )
        if alone and off_rad > REJOIN_RAD:
            raise CentreError(
                f"Tractor {number + 1} heads {math.degrees(off_rad):.0f} degrees away from its leg; turn it to within "
                f"{math.degrees(REJOIN_RAD):.0f} degrees first."
            )
        state.holds -= {PAUSED, HALTED}
        state.doubtful = False
        self.alarms.ended("stood", number)
        if not held and off_m <= self.rules.rejoin_m and off_rad <= REJOIN_RAD:
            state.holds.discard(DRIVEN)

    def stop_all(self, who: str, now: float) -> None:
        """Everybody stands, whoever drives; also who is offline, once it is back."""
        self.state = STOPPED
        for number, state in enumerate(self.states):
            state.holds.add(HALTED)
            state.standing_ordered = True
            self._order(number, "stop", reason=HALTED)
            self._stopped[number] = who, now
        self.note(who, "stop_all")

    def lease(self, who: str, number: int, takeover: bool, now: float) -> str | None:
        """Let somebody drive a tractor by remote control; returns from whom it was taken. Raises LeaseError."""
        self.check_number(number)
        if self.states[number].failed:
            raise CentreError(f"Tractor {number + 1} has failed; nobody drives it.", parameter="tractor")
        before = self.leases.take(number, who, takeover)
        state = self.states[number]
        state.holds.add(DRIVEN)
        state.holds.discard(PAUSED)  # it stands for its operator instead, and one who drives it is paused anew
        state.commanded_s, state.remote_command = -math.inf, (0.0, 0.0)
        self._stand(number, DRIVEN)  # whatever it does by the orders of somebody else, or by older ones
        self.note(who, "lease", tractor=number + 1, taken_from=before)
        self._settle()
        return before

    def leave(self, who: str, number: int, now: float) -> None:
        """Give a tractor back: it stands until it is resumed."""
        if self.leases.leave(number, who):
            self._stand(number, "remote control ended")
            self.note(who, "leave", tractor=number + 1)

    def gone(self, who: str, now: float) -> list[int]:
        """An operator's link is down: what they drove stands. Returns those tractors."""
        held = self.leases.held_by(who)
        for number in held:
            self.leave(who, number, now)
        return held

    def command(self, who: str, number: int, steering_rad: float, speed_mps: float, now: float) -> None:
        """Drive a tractor by remote control: `steering_rad` positive right, `speed_mps` negative backwards.

        Both are kept within what the rules and the tractor allow. Raises LeaseError without a lease, CentreError for
        what would do harm or a tractor that must stand; the tractor then stands.
        """
        self.check_number(number)
        self.leases.check(number, who)
        state = self.states[number]
        lock = math.radians(self.plan.tractor.max_steering_deg)
        steering = min(max(steering_rad, -lock), lock)
        speed = min(max(speed_mps, -self.rules.remote_mps), self.rules.remote_mps)
        speed = 0.0 if abs(speed) < MOVING_MPS else speed  # the guard does not look at who creeps
        state.commanded_s = now
        fault = self._not_now(number, speed, steering, now)
        if fault:
            speed = 0.0
        if (steering, speed) != state.remote_command:
            self.note(who, "command", tractor=number + 1, steering_deg=round(math.degrees(steering), 2),
                      speed_mps=round(speed, 3))  # fmt: skip
        state.remote_command = (steering, speed)
        self._order(number, "command", steering_rad=steering, speed_mps=speed)
        if fault:
            raise CentreError(f"Tractor {number + 1} stands: {fault}.")

    def _not_now(self, number: int, speed_mps: float, steering_rad: float, now: float) -> str | None:
        state = self.states[number]
        barred = sorted(state.holds - SAFE_TO_DRIVE)
        if barred:
            return barred[0]
        if state.connection(now, self.rules.silence_s) != ONLINE:
            return "its link is broken"
        if now - state.seen_s > self.rules.silence_s:
            return "nobody knows where it is now"
        return self._harm(number, speed_mps, steering_rad)

    def fail(self, who: str, number: int, now: float) -> None:
        """A tractor drives no more; who waits for it waits until the rest is planned anew."""
        self.check_number(number)
        self.states[number].failed = True
        self.states[number].holds.add(FAILED)
        self._stand(number, FAILED)
        holder = self.leases.holder(number)
        if holder is not None:
            self.leases.leave(number, holder)
        self._alarm(
            "failed", number, CRITICAL, f"Tractor {number + 1} has failed; plan the rest of its tracks for the others.",
            now,
        )
        self.note(who, "fail", tractor=number + 1)
        self._settle()

    def repaired(self, who: str, number: int, now: float) -> None:
        """A tractor that has failed can drive again: it stands until it is resumed.

        Where its tracks were given to others it can be driven by remote control alone. Raises CentreError for one that
        has not failed.
        """
        self.check_number(number)
        state = self.states[number]
        if not state.failed:
            raise CentreError(f"Tractor {number + 1} has not failed; nothing is to be taken back.", parameter="tractor")
        state.failed = False
        state.holds.discard(FAILED)
        state.holds.add(DRIVEN)  # it may have been moved meanwhile: it goes on only where it stands on its leg
        self._stand(number, DRIVEN)
        self.alarms.ended("failed", number)
        self.note(who, "repaired", tractor=number + 1)
        self._settle()

    def adopt(self, who: str, plan: FleetPlan, now: float, without: Sequence[int] = ()) -> None:
        """Go on by another plan, whose released legs are the same; raises CentreError where they are not.

        Those `without` whom it was made drive no more from now on.
        """
        for number, (state, old, new) in enumerate(zip(self.states, self.courses, plan.courses, strict=True)):
            if number in without:
                continue
            if not state.out and not _same_base(old, new, state.released):
                raise CentreError(
                    f"Tractor {number + 1} has gone on since the plan was made; plan the rest anew.",
                    parameter="proposal",
                )
            waits_at = {state.leg} if stands(state) else set()
            closed = (_newly_closed(old, new, leg, self.states) for leg in range(state.released) if leg not in waits_at)
            if not state.out and any(closed):
                raise CentreError(
                    f"Tractor {number + 1} drives already where it would have to wait now; plan the rest anew.",
                    parameter="proposal",
                )
        for number in without:
            if not self.states[number].out:
                self.fail(who, number, now)
            self.states[number].holds.add(GIVEN)
            self.alarms.reworded("failed", number, f"Tractor {number + 1} has failed; its tracks were given to others.")
        self.plan = plan
        self.version += 1
        self.guard = Guard(plan, self.rules, self.twins)
        for number, state in enumerate(self.states):
            state.done = state.done and state.leg >= len(self.courses[number].legs) - 1
            self._order(number, "plan", released=state.released)
        self.note(who, "accept", version=self.version)
        self._wait()
        self._reblock()
        self._forecast_s = -math.inf

    def _chosen(self, number: int | None) -> range:
        if number is None:
            return range(self.plan.tractors)
        self.check_number(number)
        return range(number, number + 1)


def _same_base(old: Course, new: Course, released: int) -> bool:
    """Whether two courses have the same first legs, gates aside."""
    if len(new.legs) < released:
        return False
    return all(
        a.points.shape == b.points.shape and bool((a.points == b.points).all()) and a.gear == b.gear
        for a, b in zip(old.legs[:released], new.legs[:released], strict=True)
    )


def _newly_closed(old: Course, new: Course, leg: int, states: Sequence[TractorState]) -> bool:
    """Whether a leg has a gate now that it had not, and that is not open."""
    return any(gate not in old.legs[leg].gates and not passed(gate, states) for gate in new.legs[leg].gates)
