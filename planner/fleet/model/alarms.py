"""Alarms for operators: raised once, removed when they are over and acknowledged."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from planner.fleet.model.rules import FleetManagerError

WARNING, CRITICAL = "warning", "critical"
DECIMAL_NUMBER = re.compile(r"\d+\.\d+")


@dataclass(frozen=True)
class FleetAlarm:
    """One alarm; `code` is its kind, with the number of the other tractor or obstacle at its end, if any.

    `over` means that its cause is gone.
    """

    id: int
    code: str
    level: str
    tractor: int | None
    sentence: str
    since_s: float
    acknowledged: str | None = None
    over: bool = False


class AlarmRegister:
    """Alarms that are on, or over and not yet acknowledged; `version` increases with every change."""

    def __init__(self) -> None:
        self._items: dict[int, FleetAlarm] = {}
        self._on: dict[tuple[str, int | None], int] = {}
        self._last = 0
        self.version = 0

    def list_alarms(self) -> list[FleetAlarm]:
        """All alarms, the oldest first."""
        return list(self._items.values())

    def is_alarm_on(self, code: str, tractor: int | None) -> bool:
        """Whether such an alarm is on."""
        return (code, tractor) in self._on

    def find_alarm_on(self, code: str, tractor: int | None) -> FleetAlarm | None:
        """The alarm of this code if it is on."""
        number = self._on.get((code, tractor))
        return None if number is None else self._items[number]

    def raise_alarm(self, code: str, tractor: int | None, level: str, sentence: str, now: float) -> FleetAlarm | None:
        """Raise an alarm, or update one that is on; returns it if an operator must see it again, else None.

        While an alarm is on its level never falls. Numbers with a decimal point are measured and keep changing: the
        sentence is updated, but it does not count as a new alarm.
        """
        alarm, is_new = self.find_alarm_on(code, tractor), True
        if alarm is not None:
            is_rising = level == CRITICAL and alarm.level != CRITICAL
            if not is_rising and sentence == alarm.sentence:
                return None
            is_new = is_rising or DECIMAL_NUMBER.sub("", sentence) != DECIMAL_NUMBER.sub("", alarm.sentence)
            alarm = replace(alarm, acknowledged=None if is_new else alarm.acknowledged)
        else:  # one that comes and goes is one alarm
            alarm = next((a for a in self._items.values() if a.over and (a.code, a.tractor) == (code, tractor)), None)
            if alarm is None:
                self._last += 1
                alarm = FleetAlarm(self._last, code, level, tractor, sentence, now)
        level = CRITICAL if CRITICAL in (level, alarm.level) else level
        self._store(replace(alarm, sentence=sentence, level=level, over=False))
        self._on[code, tractor] = alarm.id
        return self._items[alarm.id] if is_new else None

    def _store(self, alarm: FleetAlarm) -> None:
        """Keep an alarm as it is now, unless it is over and acknowledged."""
        self._items[alarm.id] = alarm
        self.version += 1
        if alarm.over and alarm.acknowledged is not None:
            del self._items[alarm.id]

    def reword(self, code: str, tractor: int | None, sentence: str) -> None:
        """Change the sentence of an alarm that is on; nobody has to acknowledge it again."""
        alarm = self.find_alarm_on(code, tractor)
        if alarm is not None and alarm.sentence != sentence:
            self._store(replace(alarm, sentence=sentence))

    def end_alarm(self, code: str, tractor: int | None) -> None:
        """The cause is gone; the alarm stays until somebody has acknowledged it."""
        number = self._on.pop((code, tractor), None)
        if number is not None:
            self._store(replace(self._items[number], over=True))

    def acknowledge(self, number: int, who: str) -> FleetAlarm:
        """Acknowledge an alarm. Raises FleetManagerError if there is no alarm of this number."""
        if number not in self._items:
            raise FleetManagerError(
                f"There is no alarm {number}; it is over and was already acknowledged.", parameter="alarm"
            )
        alarm = replace(self._items[number], acknowledged=who)
        self._store(alarm)
        return alarm

    def restore(self, alarms: Iterable[FleetAlarm]) -> None:
        """Replace all alarms by those saved before a restart."""
        self._items = {alarm.id: alarm for alarm in alarms}
        self._on = {(alarm.code, alarm.tractor): alarm.id for alarm in self._items.values() if not alarm.over}
        self._last = max([self._last, *self._items])
        self.version += 1

    def describe_alarms(self) -> list[dict[str, Any]]:
        """Alarms as items of a frame; the number (from 1) at the end of a code becomes `related_number`, and a fleet id
        after a slash is dropped."""
        items = []
        for a in self._items.values():
            kind, _, number = a.code.rpartition(" ")
            has_number = number.isdigit()
            items.append(
                {
                    "id": a.id,
                    "code": kind.partition("/")[0] if has_number else a.code,
                    "related_number": int(number) if has_number else None,
                    "level": a.level,
                    "sentence": a.sentence,
                    "tractor": None if a.tractor is None else a.tractor + 1,
                    "since": a.since_s,
                    "acknowledged": a.acknowledged,
                    "over": a.over,
                }
            )
        return items
