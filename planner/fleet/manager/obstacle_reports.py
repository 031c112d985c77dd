"""Obstacles that tractors report and operators draw, including unreadable reports.

A tractor that reports an unreadable obstacle (no polygon, too many corners, a truncated frame) sees something at an
unknown place. Driving on would bet that it is small and aside; stopping everybody would let one faulty sensor stop a
fleet. So only that tractor is held, however it is driven, as the obstacle is near it. Its states are still used. It is
held until

- an operator has looked and acknowledges the alarm, which says why the frame was refused. That holds for the place: the
  tractor may pass and report it again within CLEARED_RADIUS_M; farther on an unreadable report holds it again;
- or it reports a readable obstacle, and no unreadable one for SETTLED_S: that is then what it sees, and it blocks the
  legs that it touches. A state does not count: it says where the tractor is, not what it sees.

Frames without any sign of an obstacle hold nobody. A tractor that sends nothing else is silent, and stops for that.
"""

from __future__ import annotations

import math

from planner.fleet.manager.fleet_state import DOUBT_CODE, FleetObstacle, FleetState, Ring
from planner.fleet.model.alarms import CRITICAL, WARNING
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.model.tractor_state import Hold

LOOK_DELAY_S = 1.0  # after a report or a stop, in which nobody can have seen it
CLEARED_RADIUS_M = 15.0  # around the place that an operator has looked at
SETTLED_S = 2.0  # without an unreadable frame, after which a readable one replaces it
UNREADABLE_CODE = "unread obstacle"
LOOKED_AT = {UNREADABLE_CODE: Hold.UNREADABLE, DOUBT_CODE: Hold.DOUBTED}
"""Alarms that operators acknowledge once they have looked, and the holds that this ends."""


class ObstacleReports:
    """Takes the obstacles that tractors report and operators draw, for a fleet."""

    def __init__(self, fleet: FleetState) -> None:
        self.fleet = fleet

    def add(self, who: str, ring: Ring, name: str, now: float, reporting_tractor: int | None = None) -> FleetObstacle:
        """Add an obstacle of a tractor (`reporting_tractor`) or an operator: it blocks legs and stops who drives at it.

        A repeated report adds nothing. Raises FleetManagerError for one that cannot be added; the reporting tractor is
        then held as for an unreadable one.
        """
        fleet = self.fleet
        block = fleet.obstacles.find_containing_obstacle(ring, who)
        if block is None:
            try:
                block = fleet.obstacles.add(ring, name, who)
            except FleetManagerError as refusal:
                if reporting_tractor is not None:
                    self.add_unreadable(reporting_tractor, str(refusal), now)
                raise
            fleet.update_blocked_legs()
            blocked_count = sum(len(blocked) for blocked in fleet.blocked_legs)
            sentence = f"Obstacle {name!r} blocks {blocked_count} legs."
            fleet.raise_alarm(f"obstacle {block.id}", None, WARNING, sentence, now)
            fleet.log_event(who, "obstacle", obstacle=block.id, name=name, legs=blocked_count)
        if reporting_tractor is not None:
            fleet.states[reporting_tractor].readable_s = now
            self.release_tractors_reporting_readably(now)
        return block

    def add_unreadable(self, number: int, refusal_text: str, now: float) -> None:
        """A tractor reports an obstacle that is unreadable because of `refusal_text`; it stops, see above."""
        state = self.fleet.states[number]
        state.unreadable_s = now
        if Hold.UNREADABLE in state.holds or self._is_at_inspected_place(number):
            return
        state.faced_since_s = now
        self.fleet.log_event(f"tractor {number + 1}", UNREADABLE_CODE, tractor=number + 1, sentence=refusal_text)
        alarm_text = (
            f"Tractor {number + 1} stopped: it sees an obstacle that could not be read. {refusal_text} Look what is "
            "there before you resume it."
        )
        self.fleet.raise_alarm(UNREADABLE_CODE, number, CRITICAL, alarm_text, now)
        self.fleet.hold_tractor(number, Hold.UNREADABLE)

    def _is_at_inspected_place(self, number: int) -> bool:
        """Whether a tractor is still at the place that an operator has looked at."""
        state = self.fleet.states[number]
        if state.cleared_at is None or state.report is None:
            return False
        if math.dist(state.cleared_at, (state.report.x_m, state.report.y_m)) > CLEARED_RADIUS_M:
            state.cleared_at = None
        return state.cleared_at is not None

    def release_tractors_reporting_readably(self, now: float) -> None:
        """Release tractors that report a readable obstacle, and no unreadable one for SETTLED_S."""
        for number, state in enumerate(self.fleet.states):
            is_readable = state.readable_s > state.unreadable_s and now - state.unreadable_s >= SETTLED_S
            if Hold.UNREADABLE in state.holds and is_readable:
                self._end_hold(number)

    def confirm_inspection(self, who: str, number: int, now: float) -> None:
        """An operator has looked at the unreadable obstacle of a tractor, which is held no longer.

        Raises FleetManagerError as check_inspection_possible.
        """
        state = self.fleet.states[number]
        if Hold.UNREADABLE not in state.holds:
            return
        self.check_inspection_possible(number, now)
        state.cleared_at = None if state.report is None else (state.report.x_m, state.report.y_m)
        self.fleet.log_event(who, "looked", tractor=number + 1)
        self._end_hold(number)

    def check_inspection_possible(self, number: int, now: float) -> None:
        """Raise FleetManagerError if an unreadable report is too new for anybody to have looked."""
        state = self.fleet.states[number]
        if Hold.UNREADABLE in state.holds and now - state.faced_since_s < LOOK_DELAY_S:
            raise FleetManagerError(
                f"Tractor {number + 1} has just reported an obstacle that could not be read; look what "
                "is there, then resume it.",
                parameter="tractor",
            )

    def find_tractor_held_by_alarm(self, alarm: int) -> int | None:
        """The tractor that is looked at by acknowledging this alarm; None for all other alarms."""
        for item in self.fleet.alarms.list_alarms():
            hold = LOOKED_AT.get(item.code)
            if item.id == alarm and hold is not None and item.tractor is not None and not item.over:
                return item.tractor if hold in self.fleet.states[item.tractor].holds else None
        return None

    def _end_hold(self, number: int) -> None:
        self.fleet.states[number].holds.discard(Hold.UNREADABLE)
        self.fleet.alarms.end_alarm(UNREADABLE_CODE, number)
        self.fleet.send_stop_or_resume()

    def clear(self, who: str, number: int, now: float) -> None:
        """An obstacle is gone."""
        self.fleet.obstacles.remove_obstacle(number)
        self.fleet.alarms.end_alarm(f"obstacle {number}", None)
        self.fleet.log_event(who, "cleared", obstacle=number)
        self.fleet.update_blocked_legs()

    def acknowledge_alarm(self, who: str, alarm: int, now: float) -> None:
        """Acknowledge an alarm; for an unreadable obstacle that resumes the tractor. For one whose place is in doubt it
        ends the doubt, and the tractor stands until it is resumed.

        Raises FleetManagerError as check_inspection_possible, or if there is no such alarm.
        """
        number = self.find_tractor_held_by_alarm(alarm)
        doubt = self.fleet.alarms.find_alarm_on(DOUBT_CODE, number)
        if number is not None and doubt is not None and doubt.id == alarm:
            if Hold.REMOTE_CONTROL not in self.fleet.states[number].holds:  # which holds it as well
                self.fleet.hold_tractor(number, Hold.PAUSED)
            self.fleet.end_doubt(who, number)
        elif number is not None:
            self.confirm_inspection(who, number, now)
        self.fleet.alarms.acknowledge(alarm, who)
        self.fleet.log_event(who, "acknowledge", alarm=alarm)
