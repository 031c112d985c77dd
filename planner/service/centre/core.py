"""What there is of a fleet: its plan, the state of every tractor, and what is to be told to whom."""

from __future__ import annotations

import math
from typing import Any

from planner.service.centre.alarms import Alarms
from planner.service.centre.course import Course
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan
from planner.service.centre.foresight import NoTwins, Virtual
from planner.service.centre.guard import Guard
from planner.service.centre.leases import Leases
from planner.service.centre.nearness import STUCK_S, Nearness
from planner.service.centre.obstacles import Obstacles
from planner.service.centre.orders import Event, Order
from planner.service.centre.painting import Painting
from planner.service.centre.releasing import waits_for, waits_here
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import DRIVEN, OBSTACLE, REMOTE, WAITS, TractorState

READY, RUNNING, STOPPED, DONE = "ready", "running", "stopped", "done"
CENTRE = "centre"


class Core:
    """State of a fleet, and the orders and events that wait to be taken."""

    def __init__(self, plan: FleetPlan, rules: Rules, twins: Virtual | None = None) -> None:
        self.plan, self.rules, self.twins = plan, rules, twins or NoTwins()
        self.version = 1
        self.state = READY
        self.started_s: float | None = None
        self.states = [TractorState() for _ in plan.courses]
        self.leases, self.alarms = Leases(), Alarms()
        reach_m = 0.5 * max(plan.tractor.width_m, plan.implement.contact_width_m) + rules.obstacle_margin_m
        self.obstacles = Obstacles(reach_m)
        self.blocked: list[dict[int, str]] = [{} for _ in plan.courses]
        self.painting = Painting(plan.tractors)
        self.guard = Guard(plan, rules, self.twins)
        self.near = Nearness(rules.release_s / rules.times, STUCK_S / rules.times)
        self.finish_in_s = [math.inf] * plan.tractors
        self._orders: list[Order] = []
        self._events: list[Event] = []
        self._stopped = [("", -math.inf)] * plan.tractors  # who told each to stand last, and when
        self._watched_s = self._forecast_s = -math.inf

    @property
    def courses(self) -> tuple[Course, ...]:
        """The legs of every tractor."""
        return self.plan.courses

    def taken(self) -> tuple[list[Order], list[Event]]:
        """Orders and events since the last call."""
        orders, events = self._orders, self._events
        self._orders, self._events = [], []
        return orders, events

    def note(self, who: str, what: str, **data: Any) -> None:
        """Write something into the log of who did what."""
        self._events.append(Event(who, what, data))

    def _order(self, number: int, kind: str, **data: Any) -> None:
        self._orders.append(Order(number, kind, data))

    def check_number(self, number: int) -> None:
        """Raise CentreError for a tractor that this fleet does not have."""
        if not 0 <= number < self.plan.tractors:
            raise CentreError(
                f"Tractor {number + 1} is not in this fleet of {self.plan.tractors}; use 1 to {self.plan.tractors}.",
                parameter="tractor",
            )

    def _wait(self) -> None:
        """Who has to wait where it is, by a plan made anew, stands until what it waits for has been driven."""
        for number, state in enumerate(self.states):
            if state.done or state.out or not waits_here(self.courses[number], state, self.states):
                state.holds.discard(WAITS)
            elif WAITS not in state.holds:
                state.holds.add(WAITS)
                self._stand(number, WAITS)

    def _settle(self) -> None:
        """Tell every tractor to stand or to go on, where that has changed."""
        for number, state in enumerate(self.states):
            if state.doubtful:
                continue
            stand = bool(state.holds) or self.state in (READY, STOPPED)
            if stand != state.standing_ordered:
                state.standing_ordered = stand
                self._order(number, "stop" if stand else "resume", **self._why(number))

    def _why(self, number: int) -> dict[str, Any]:
        """What an order to stand says of its reason; nothing for one to go on."""
        state = self.states[number]
        if not state.standing_ordered:
            return {}
        return {"reason": sorted(state.holds)[0] if state.holds else "not started"}

    def _stand(self, number: int, reason: str) -> None:
        """Stop a tractor whatever it does, by remote control too."""
        state = self.states[number]
        state.remote_command = (state.remote_command[0], 0.0)
        state.standing_ordered = True
        self._order(number, "stop", reason=reason)

    def _alarm(self, code: str, number: int | None, level: str, sentence: str, now: float) -> None:
        if self.alarms.raised(code, number, level, sentence, now):
            self.note(CENTRE, "alarm", tractor=None if number is None else number + 1, sentence=sentence)

    def _tell_release(self, number: int) -> None:
        state = self.states[number]
        self._order(
            number, "release", update=state.update, released=state.released,
            announced=len(self.courses[number].legs), limit_mps=state.limit_mps,
        )  # fmt: skip

    def _reblock(self) -> None:
        for number, (state, course) in enumerate(zip(self.states, self.courses, strict=True)):
            legs = self.obstacles.blocked(course)
            self.blocked[number] = {leg: name for leg, name in legs.items() if leg >= state.released}
            if self._obstructed(number):
                if OBSTACLE not in state.holds:
                    state.holds.add(OBSTACLE)
                    self._stand(number, OBSTACLE)
            else:
                state.holds.discard(OBSTACLE)
            steering, speed = state.remote_command
            if self._harm(number, speed, steering):
                self._stand(number, OBSTACLE)
        self._settle()

    def _obstructed(self, number: int) -> bool:
        """Whether an obstacle is on what a tractor may drive, from where it would go on."""
        state, course = self.states[number], self.courses[number]
        if state.done:
            return False
        at_m = state.leg_m
        if DRIVEN in state.holds and state.report is not None:  # led past it, it goes on from where it stands
            place = state.report.x_m, state.report.y_m
            at_m = max(at_m, course.nearest_m(state.leg, place, self.rules.rejoin_m))
        return self.obstacles.ahead(course, state.leg, at_m, state.released) is not None

    def _look_again(self) -> None:
        """Who stands at an obstacle and was led past it does not stand for it any more."""
        for number, state in enumerate(self.states):
            if OBSTACLE in state.holds and not self._obstructed(number):
                state.holds.discard(OBSTACLE)

    def _harm(self, number: int, speed_mps: float, steering_rad: float) -> str | None:
        """Why a remote command would do harm; None when it does not."""
        shapes = [block.shape for block in self.obstacles.items.values()]
        return self.guard.allows(number, speed_mps, steering_rad, self.states, self.courses, shapes)

    def waits_for(self, number: int) -> list[tuple[int, int]]:
        """(tractor, leg) that a tractor waits for now."""
        return waits_for(number, self.courses, self.states, self.rules)

    def done_m(self) -> float:
        """Metres worked so far by all."""
        return sum(
            course.worked_m[-1] if state.done else course.done_m(state.leg, state.leg_m)
            for course, state in zip(self.courses, self.states, strict=True)
        )

    def late_s(self, number: int, now: float) -> float | None:
        """How much later than planned a tractor will be done, in seconds of the clock; None where nobody knows."""
        if self.started_s is None or not math.isfinite(self.finish_in_s[number]) or self.states[number].done:
            return None
        planned = self.plan.finish_s[number] / self.rules.times
        return now + self.finish_in_s[number] - self.started_s - planned

    def remote(self, number: int) -> bool:
        """Whether a tractor is driven by remote control."""
        return self.states[number].mode == REMOTE
