"""The workday of a job: road, handling, breaks and shifts before, during and after field work.

All tractors of a fleet have the same duties at the same time. In breaks and between shifts everything stops, also on
the road. Other work before or after field work would be one more `Duty`; service stops are part of the field time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fields.arrays import Floats
from fields.geometry.field import Field
from fields.units import DAY_S, MPS_PER_KMH
from planner.errors import RequestError
from planner.farm.settings import FarmTimes, Yard

MAX_ROAD_KM = 200.0  # straight line; longer roads indicate wrong degrees
ROAD, UNFOLD, FOLD, BREAK, NIGHT = "road", "unfold", "fold", "break", "night"
MAX_DAYS = 1000


def estimate_road_m(field: Field, yard: Yard, times: FarmTimes) -> float | None:
    """Metres of the road to the entrance of a field, or to its middle without one: the straight line times a factor.

    None if the farm has no yard or the field is not georeferenced. Raises RequestError for a yard farther than
    MAX_ROAD_KM away.
    """
    if yard.lon is None or yard.lat is None or field.crs is None:
        return None
    from pyproj import Geod

    ((lon, lat),) = field.to_wgs84([locate_road_end(field)]).tolist()
    line_m = float(Geod(ellps="WGS84").inv(yard.lon, yard.lat, lon, lat)[2])
    if line_m > 1000.0 * MAX_ROAD_KM:
        raise RequestError(
            f"The yard of the farm is {line_m / 1000.0:.0f} km from field {field.name!r} in a straight line; at most "
            f"{MAX_ROAD_KM:g} km are allowed, so correct its [yard] or leave it out.",
            parameter="farm",
        )
    return line_m * times.road_factor


def locate_road_end(field: Field) -> tuple[float, float]:
    """The end of the road to a field, in its metres: the entrance, or the middle without one."""
    middle = field.boundary.centroid
    return field.entrance or (middle.x, middle.y)


@dataclass(frozen=True)
class Duty:
    """Work of every tractor before or after field work, and its duration (s)."""

    kind: str
    seconds: float


@dataclass(frozen=True)
class WorkPause:
    """A pause of all work: "break" or "night" (between two shifts), in seconds after the start."""

    kind: str
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Workday:
    """Duties before and after field work, breaks and shift; `start_s` is the time of day when the fleet departs.

    Times of day are in seconds; an end past midnight is above a day. Without a start there are no pauses. A shift
    without a beginning begins at the start. `road_m` is the road one way. Raises RequestError if breaks take the whole
    shift.
    """

    start_s: int | None = None
    duties_before: tuple[Duty, ...] = ()
    duties_after: tuple[Duty, ...] = ()
    breaks_s: tuple[tuple[int, int], ...] = ()
    shift_s: tuple[int | None, int | None] = (None, None)
    road_m: float = 0.0

    def __post_init__(self) -> None:
        if sum(pause.to_s - pause.from_s for pause in self._iter_pauses(DAY_S, 2 * DAY_S)) > DAY_S - 1.0:
            raise RequestError("The breaks of the farm take its whole shift; shorten them.", parameter="farm")

    @property
    def before_field_s(self) -> float:
        """Seconds of all duties before field work."""
        return sum(duty.seconds for duty in self.duties_before)

    @property
    def after_field_s(self) -> float:
        """Seconds of all duties after field work."""
        return sum(duty.seconds for duty in self.duties_after)

    def sum_duties_s(self, kind: str) -> float:
        """Seconds of the duties of one kind, before and after together."""
        return sum(duty.seconds for duty in (*self.duties_before, *self.duties_after) if duty.kind == kind)

    @property
    def road_ways(self) -> int:
        """How often the road is driven: out and home, or only home by a fleet that stands on the field."""
        return sum(duty.kind == ROAD for duty in (*self.duties_before, *self.duties_after))

    def begin_on_field(self) -> Workday:
        """The same for a fleet that stands on the field already."""
        return replace(self, duties_before=())

    def compute_clock_s(self, work_s: float, *, begins: bool = False) -> float:
        """Seconds after the start when `work_s` seconds of work are done; with `begins`, when the next work begins."""
        starts, _, paused = self._pause_table
        worked = starts - paused[:-1]
        return work_s + float(paused[np.searchsorted(worked, work_s, "right" if begins else "left")])

    def compute_work_s(self, clock_s: Floats) -> Floats:
        """Seconds of work possible until these times after the start, in an array of any shape; infinity is kept."""
        starts, ends, paused = self._pause_table
        pause_count = np.searchsorted(starts, clock_s, "right")
        working_until = np.minimum(clock_s, np.append(np.inf, starts)[pause_count]) if len(starts) else clock_s
        in_work = np.append(-np.inf, ends)[pause_count] <= clock_s
        return np.asarray(
            np.where(in_work, clock_s - paused[pause_count], working_until - paused[np.maximum(pause_count - 1, 0)])
        )

    def list_pauses(self, until_s: float) -> tuple[WorkPause, ...]:
        """Pauses until a time after the start, the last one cut at this time."""
        return tuple(self._iter_pauses(0.0, until_s))

    @cached_property
    def _pause_table(self) -> tuple[Floats, Floats, Floats]:
        """Starts and ends of all pauses (n,), and seconds paused before each of them and after the last (n + 1,)."""
        spans = np.array([(one.from_s, one.to_s) for one in self._iter_pauses(0.0, MAX_DAYS * DAY_S)]).reshape(-1, 2)
        return spans[:, 0], spans[:, 1], np.concatenate(([0.0], np.cumsum(spans[:, 1] - spans[:, 0])))

    def _iter_pauses(self, first_s: float, last_s: float) -> Iterator[WorkPause]:
        """Pauses within a span of time after the start; of overlapping pauses the first one counts."""
        if self.start_s is None:
            return
        pauses = list[WorkPause]()
        for day in range(int(first_s // DAY_S) - 2, int(last_s // DAY_S) + 2):  # that of the start is 0
            off = day * DAY_S - self.start_s
            shift_begin, shift_end = self.shift_s
            shift_begin = self.start_s if shift_begin is None else shift_begin
            if shift_end is not None:
                shift_end += DAY_S if shift_end <= shift_begin else 0
                pauses.append(WorkPause(NIGHT, shift_end + off, shift_begin + DAY_S + off))
            pauses += [WorkPause(BREAK, first + off, last + off) for first, last in self.breaks_s]
        until_s = first_s
        for pause in sorted(pauses, key=lambda pause: (pause.from_s, -pause.to_s)):
            begin, end = max(pause.from_s, until_s), min(pause.to_s, last_s)
            if begin < end:
                yield WorkPause(pause.kind, begin, end)
                until_s = end


def build_workday(field: Field, start_s: int | None, times: FarmTimes, yard: Yard, gate_fold_s: float = 0.0) -> Workday:
    """The workday of a job on a field by the times and the yard of a farm; raises RequestError.

    `gate_fold_s` of unfolding and of folding belong to the drive, as they are done inside the entrance.
    """
    road_m = estimate_road_m(field, yard, times)
    road_duties = () if road_m is None else (Duty(ROAD, road_m / (times.road_speed_kmh * MPS_PER_KMH)),)
    return Workday(
        start_s,
        (*road_duties, Duty(UNFOLD, max(0.0, times.unfold_s - gate_fold_s))),
        (Duty(FOLD, max(0.0, times.fold_s - gate_fold_s)), *road_duties),
        times.break_spans_s,
        times.shift_span_s,
        road_m or 0.0,
    )
