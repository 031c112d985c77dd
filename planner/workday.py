"""The clock of a job: what comes before and after the work on the field, and when people are not there.

All tractors of a fleet go through the same duties at once. Nothing goes on in breaks and between shifts, on the road
neither: machines stay where they are. Whatever else takes time before or after field work is one more `Duty`; what
happens during it (refills, unloading) is part of the field time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fields.field import Field
from planner.errors import ScenarioError
from planner.farm.times import Times, Yard
from planner.scenario import DAY_S
from planner.transport import road_to

ROAD, UNFOLD, FOLD, BREAK, NIGHT = "road", "unfold", "fold", "break", "night"
MOST_DAYS = 1000
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Duty:
    """Something that every tractor does before or after field work, and how long it takes (s)."""

    kind: str
    seconds: float


@dataclass(frozen=True)
class Pause:
    """When nobody works: "break" or "night" (between two shifts), in seconds after the start."""

    kind: str
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Workday:
    """Duties before and after the field, breaks and shift; `start_s` is the clock at which the fleet sets out.

    Clocks are seconds of the day, an end past midnight is above a day. Without a start there is no clock, and thus no
    pause. A shift without a beginning begins at the hour of the start. `road_m` is the road one way. Raises
    ScenarioError where breaks leave nothing of a shift.
    """

    start_s: int | None = None
    before: tuple[Duty, ...] = ()
    after: tuple[Duty, ...] = ()
    breaks_s: tuple[tuple[int, int], ...] = ()
    shift_s: tuple[int | None, int | None] = (None, None)
    road_m: float = 0.0

    def __post_init__(self) -> None:
        if sum(pause.to_s - pause.from_s for pause in self._pauses_in(DAY_S, 2 * DAY_S)) > DAY_S - 1.0:
            raise ScenarioError(
                "The breaks of the farm leave no time to work in its shift; shorten them.", parameter="farm"
            )

    @property
    def before_s(self) -> float:
        """Seconds of all duties before field work."""
        return sum(duty.seconds for duty in self.before)

    @property
    def after_s(self) -> float:
        """Seconds of all duties after it."""
        return sum(duty.seconds for duty in self.after)

    def of(self, kind: str) -> float:
        """Seconds of the duties of one kind, before and after together."""
        return sum(duty.seconds for duty in (*self.before, *self.after) if duty.kind == kind)

    def clock_s(self, work_s: float, *, begins: bool = False) -> float:
        """Seconds after the start at which so many seconds of work are done, or what follows them `begins`."""
        starts, _, paused = self._table
        worked = starts - paused[:-1]
        return work_s + float(paused[np.searchsorted(worked, work_s, "right" if begins else "left")])

    def work_s(self, clock_s: Array) -> Array:
        """Seconds of work that can be done until these times after the start; of any shape, infinite ones stay."""
        starts, ends, paused = self._table
        begun = np.searchsorted(starts, clock_s, "right")
        now = np.minimum(clock_s, np.append(np.inf, starts)[begun]) if len(starts) else clock_s
        over = np.append(-np.inf, ends)[begun] <= clock_s
        return np.asarray(np.where(over, clock_s - paused[begun], now - paused[np.maximum(begun - 1, 0)]))

    def pauses(self, until_s: float) -> tuple[Pause, ...]:
        """Pauses until a time after the start; one that goes on then is cut there."""
        return tuple(self._pauses_in(0.0, until_s))

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Starts and ends of all pauses (n,), and seconds paused before each of them and after the last (n + 1,)."""
        spans = np.array([(one.from_s, one.to_s) for one in self._pauses_in(0.0, MOST_DAYS * DAY_S)]).reshape(-1, 2)
        return spans[:, 0], spans[:, 1], np.concatenate(([0.0], np.cumsum(spans[:, 1] - spans[:, 0])))

    def _pauses_in(self, first_s: float, last_s: float) -> Iterator[Pause]:
        """Pauses within a span of time after the start, no two at once: what began first counts."""
        days = range(int(first_s // DAY_S) - 2, int(last_s // DAY_S) + 2)
        found = sorted((one for day in days for one in self._on(day)), key=lambda one: (one.from_s, -one.to_s))
        until_s = first_s
        for one in found:
            begin, end = max(one.from_s, until_s), min(one.to_s, last_s)
            if begin < end:
                yield Pause(one.kind, begin, end)
                until_s = end

    def _on(self, day: int) -> Iterator[Pause]:
        """The pauses that belong to a day, that of the start being 0."""
        if self.start_s is None:
            return
        off = day * DAY_S - self.start_s
        begin, end = self.shift_s
        begin = self.start_s if begin is None else begin
        if end is not None:
            end += DAY_S if end <= begin else 0
            yield Pause(NIGHT, end + off, begin + DAY_S + off)
        for first, last in self.breaks_s:
            yield Pause(BREAK, first + off, last + off)


def workday(field: Field, start_s: int | None, times: Times, yard: Yard) -> Workday:
    """The clock of a job on a field by the times and the yard of a farm; raises ScenarioError."""
    road = road_to(field, yard, times)
    there = () if road is None else (Duty(ROAD, road.seconds),)
    return Workday(
        start_s, (*there, Duty(UNFOLD, times.unfold_s)), (Duty(FOLD, times.fold_s), *there), times.breaks_s,
        times.shift_s, 0.0 if road is None else road.length_m,
    )  # fmt: skip
