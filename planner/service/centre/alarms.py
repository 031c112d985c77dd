"""What an operator has to know at once: raised once, gone when it is over and has been seen."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from planner.service.centre.errors import CentreError

WARNING, CRITICAL = "warning", "critical"
MEASURED = re.compile(r"\d+\.\d+")


@dataclass(frozen=True)
class Alarm:
    """One alarm; `code` says of what kind it is, and by a number at its end of which other tractor or obstacle.

    `over` says that its cause is gone.
    """

    id: int
    code: str
    level: str
    tractor: int | None
    sentence: str
    since_s: float
    acknowledged: str | None = None
    over: bool = False


class Alarms:
    """Alarms that are on, or over and not yet acknowledged; `version` rises with every change."""

    def __init__(self) -> None:
        self._items: dict[int, Alarm] = {}
        self._on: dict[tuple[str, int | None], int] = {}
        self._last = 0
        self.version = 0

    def items(self) -> list[Alarm]:
        """All, the oldest first."""
        return list(self._items.values())

    def on(self, code: str, tractor: int | None) -> bool:
        """Whether such an alarm is on."""
        return (code, tractor) in self._on

    def raised(self, code: str, tractor: int | None, level: str, sentence: str, now: float) -> Alarm | None:
        """A new alarm, or one that is on and says more now, which has to be seen anew; None where nothing is new.

        While it is on its level never falls. Figures with a decimal point are measured ones, which go on changing: they
        are shown, but do not make it another alarm.
        """
        if (code, tractor) in self._on:
            return self._changed(self._items[self._on[code, tractor]], level, sentence)
        unseen = next((a for a in self._items.values() if a.over and (a.code, a.tractor) == (code, tractor)), None)
        if unseen is None:
            self._last += 1
            alarm = Alarm(self._last, code, level, tractor, sentence, now)
        else:  # it comes and goes: one to be seen is enough
            level = CRITICAL if unseen.level == CRITICAL else level
            alarm = replace(unseen, sentence=sentence, level=level, over=False)
        self._items[alarm.id], self._on[code, tractor] = alarm, alarm.id
        self.version += 1
        return alarm

    def _changed(self, before: Alarm, level: str, sentence: str) -> Alarm | None:
        rises = level == CRITICAL and before.level != CRITICAL
        if not rises and sentence == before.sentence:
            return None
        anew = rises or MEASURED.sub("", sentence) != MEASURED.sub("", before.sentence)
        alarm = replace(
            before, level=CRITICAL if rises else before.level, sentence=sentence,
            acknowledged=None if anew else before.acknowledged,
        )  # fmt: skip
        self._items[before.id] = alarm
        self.version += 1
        return alarm if anew else None

    def reworded(self, code: str, tractor: int | None, sentence: str) -> None:
        """One that is on says something else now that nobody has to see anew."""
        number = self._on.get((code, tractor))
        if number is not None and self._items[number].sentence != sentence:
            self._items[number] = replace(self._items[number], sentence=sentence)
            self.version += 1

    def ended(self, code: str, tractor: int | None) -> None:
        """Its cause is gone; it stays to be seen until somebody has acknowledged it."""
        number = self._on.pop((code, tractor), None)
        if number is None:
            return
        alarm = replace(self._items[number], over=True)
        self._items[number] = alarm
        self.version += 1
        if alarm.acknowledged is not None:
            del self._items[number]

    def acknowledge(self, number: int, who: str) -> Alarm:
        """Somebody has seen it. Raises CentreError where there is none of this number."""
        if number not in self._items:
            raise CentreError(f"There is no alarm {number}; it is over and was acknowledged.", parameter="alarm")
        alarm = replace(self._items[number], acknowledged=who)
        self._items[number] = alarm
        self.version += 1
        if alarm.over:
            del self._items[number]
        return alarm

    def put_back(self, alarms: Iterable[Alarm]) -> None:
        """These, and no others, are there: what was kept of them before a restart."""
        self._items = {alarm.id: alarm for alarm in alarms}
        self._on = {(alarm.code, alarm.tractor): alarm.id for alarm in self._items.values() if not alarm.over}
        self._last = max([self._last, *self._items])
        self.version += 1

    def told(self) -> list[dict[str, Any]]:
        """As pages are told: the number that ends a code, of a tractor or an obstacle, is told as `other`."""
        return [
            {"id": a.id, **_code_told(a.code), "level": a.level, "sentence": a.sentence,
             "tractor": None if a.tractor is None else a.tractor + 1,
             "since": a.since_s, "acknowledged": a.acknowledged, "over": a.over}
            for a in self._items.values()
        ]  # fmt: skip


def _code_told(code: str) -> dict[str, Any]:
    """A code as its kind and the number, from 1, that ends it; None where none does."""
    kind, _, number = code.rpartition(" ")
    return {"code": kind, "other": int(number)} if number.isdigit() else {"code": code, "other": None}
