"""The result of a simulation: outcome, 10 Hz record and times, and its segments: work, ways, waits and stops.

The legs of one swath, headland side, turn or route are one step, drive-in included; a wait splits a step in two.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers, find_true_spans
from vehicle.missions.plan import DRIVE_IN, ENTER, HEADLAND_PASS, LEAVE, ROUTE, SWATH, TURN, Leg, LegTask, Plan
from vehicle.records import (
    FINISHED,
    REC_LEG,
    REC_POSE,
    REC_SPEED,
    REC_STATUS,
    REVERSING,
    STANDING,
    TURNING,
    WAITING,
    WORKING,
)

DONE, CONFLICT, STALL, TIMEOUT = "done", "conflict", "stall", "timeout"
MIN_WAIT_S = 3.0  # a shorter stop belongs to the segment it interrupts


@dataclass(frozen=True)
class Conflict:
    """Two tractors that came too close: when, which, and for each the leg and the metres driven on it."""

    time_s: float
    first: int
    second: int
    first_leg: int
    second_leg: int
    first_m: float = 0.0
    second_m: float = 0.0


@dataclass(frozen=True)
class Stall:
    """A tractor that got stuck or ran away, where, and what it lacked: "drive force", "grip", "power" or "brakes".

    `leg` counts from the first of its mission, `grade` is the rise per metre in its direction of travel. `needed_n` is
    the thrust that would have kept it going there (for brakes: the force that would have held it), `available_n` what
    there was.
    """

    time_s: float
    tractor: int
    leg: int
    x_m: float
    y_m: float
    grade: float
    lacking: str
    needed_n: float
    available_n: float


@dataclass(frozen=True)
class RollOverMargin:
    """How far a tractor stayed from rolling over sideways (rad; negative: it would have), and where it came closest.

    `leg` counts from the first of its mission.
    """

    margin_rad: float
    x_m: float
    y_m: float
    leg: int


@dataclass(frozen=True, eq=False)
class SimulationRun:
    """A simulated plan.

    `time_s` (t,), `record` (t, tractors, 7) at 10 Hz with the columns vehicle.records.RECORD_COLUMNS, `finish_s`
    (tractors,; nan if not finished), `contacts` (time, first, second) at first touch, `min_clearance_m` between any
    two outlines (inf for one tractor). `stall` names the tractor of a run that ended because it could not go on;
    `roll_over` has a margin per tractor, and none where the height of the centre of mass is not known.
    """

    plan: Plan
    outcome: str
    time_s: Floats
    record: Floats
    finish_s: Floats
    contacts: tuple[tuple[float, int, int], ...]
    min_clearance_m: float
    conflict: Conflict | None = None
    stall: Stall | None = None
    roll_over: tuple[RollOverMargin, ...] = ()

    @property
    def duration_s(self) -> float:
        """When the last tractor was done."""
        return float(np.max(self.finish_s))

    @property
    def work_finish_s(self) -> float:
        """When the last tractor finished its work: done, or on its way out of the field."""
        if not any(mission.leaves for mission in self.plan.missions):
            return self.duration_s
        ends = []
        for tractor, mission in enumerate(self.plan.missions):
            end_s = self.finish_s[tractor]
            leave_leg = next((n for n, leg in enumerate(mission.legs) if leg.task.kind == LEAVE), None)
            if leave_leg is not None:
                leave_row = int(np.searchsorted(self.get_leg_numbers(tractor), leave_leg))
                end_s = self.time_s[min(leave_row, len(self.time_s) - 1)]
            ends.append(float(end_s))
        return max(ends)

    @property
    def step_s(self) -> float:
        """Seconds between two rows of the record; 0 where there is only one."""
        return float(self.time_s[1] - self.time_s[0]) if len(self.time_s) > 1 else 0.0

    def get_poses(self, tractor: int) -> Floats:
        """x, y (m) and angle (rad) of the centre of mass of a tractor, shape (t, 3)."""
        return self.record[:, tractor, REC_POSE]

    def get_leg_numbers(self, tractor: int) -> Integers:
        """Number of the leg a tractor is on, shape (t,)."""
        return self.record[:, tractor, REC_LEG].astype(np.int64)

    def find_task_rows(self, tractor: int, kinds: Collection[str]) -> Flags:
        """In which rows (t,) a tractor is on a leg whose task is of one of some kinds."""
        return self._find_leg_rows(tractor, lambda leg: leg.task.kind in kinds)

    def _find_leg_rows(self, tractor: int, is_such: Callable[[Leg], bool]) -> Flags:
        """In which rows (t,) a tractor is on such a leg."""
        flags = np.array([is_such(leg) for leg in self.plan.missions[tractor].legs])
        rows: Flags = flags[self.get_leg_numbers(tractor)]
        return rows

    def get_statuses(self, tractor: int) -> Integers:
        """Status of a tractor, as the constants of vehicle.records, shape (t,)."""
        return self.record[:, tractor, REC_STATUS].astype(np.int64)

    def sum_seconds(self, status: int) -> Floats:
        """Time per tractor in a status of vehicle.records (tractors,)."""
        return np.asarray((self.record[:, :, REC_STATUS] == status).sum(axis=0) * self.step_s)

    def sum_slow_work_m(self, speed_mps: float) -> float:
        """Metres of all tractors worked more slowly than at a speed."""
        speeds = np.abs(self.record[:, :, REC_SPEED])
        is_slow = (self.record[:, :, REC_STATUS] == WORKING) & (speeds < speed_mps)
        return float(speeds[is_slow].sum() * self.step_s)

    @property
    def standing_s(self) -> Floats:
        """Seconds per tractor of standing to refill or unload."""
        return self.sum_seconds(STANDING) - self.folding_s

    @property
    def folding_s(self) -> Floats:
        """Seconds per tractor of standing to fold and to unfold."""
        return np.array([self.find_folding_rows(k).sum() * self.step_s for k in range(self.plan.tractors)])

    def find_folded_rows(self, tractor: int) -> Flags:
        """In which rows (t,) the implement of a tractor is folded."""
        return self._find_leg_rows(tractor, lambda leg: leg.folded)

    def find_folding_rows(self, tractor: int) -> Flags:
        """In which rows (t,) a tractor stands to fold or to unfold its implement."""
        numbers, folds = self.get_leg_numbers(tractor), np.zeros(len(self.time_s), bool)
        stands = self.get_statuses(tractor) == STANDING
        for number, leg in enumerate(self.plan.missions[tractor].legs):
            if leg.fold_s:
                rows = np.flatnonzero(stands & (numbers == number))
                folds[rows[round(leg.stand_s / self.step_s) if self.step_s else 0 :]] = True
        return folds

    def sum_waits_s(self, tractor: int) -> Floats:
        """Seconds that a tractor waited before each of its legs (legs,)."""
        rows = self.get_leg_numbers(tractor)[self.get_statuses(tractor) == WAITING]
        return self.step_s * np.bincount(rows, minlength=len(self.plan.missions[tractor].legs)).astype(np.float64)

    def sum_seconds_by_status(self) -> dict[str, Floats]:
        """Seconds (tractors,) of working, turning with what folding takes, waiting and reversing."""
        statuses = {"working": WORKING, "turning": TURNING, "waiting": WAITING, "reversing": REVERSING}
        seconds = {name: self.sum_seconds(status) for name, status in statuses.items()}
        return seconds | {"turning": seconds["turning"] + self.folding_s}


@dataclass(frozen=True)
class RecordSegment:
    """Rows `first_row` to before `end_row` of the record: driving, waiting, or standing at a service stop."""

    group: int
    is_waiting: bool
    is_standing: bool
    first_row: int
    end_row: int


def number_leg_steps(legs: Sequence[Leg]) -> Integers:
    """Number of the step each leg belongs to, (n,)."""
    group, groups = 0, [0]
    for before, after in pairwise(legs):
        is_same_kind = classify_task(before.task) == classify_task(after.task)
        group += not is_same_kind or not (before.task.has_same_goal(after.task) or after.task.kind in (ENTER, LEAVE))
        groups.append(group)
    return np.array(groups, dtype=np.int64)


def classify_task(task: LegTask) -> str:
    """The class that all legs of a step share; crossing the headland line is part of the swath."""
    if task.is_work or task.kind == DRIVE_IN:
        return HEADLAND_PASS if task.kind == HEADLAND_PASS else SWATH
    return ROUTE if task.kind in (TURN, ROUTE) else task.kind


def iter_segments(run: SimulationRun, tractor: int) -> Iterator[RecordSegment]:
    """Driving and standing segments in order of time; short stops belong to what they interrupt."""
    groups = number_leg_steps(run.plan.missions[tractor].legs)
    status, group = run.get_statuses(tractor), groups[run.get_leg_numbers(tractor)]
    end = int(np.argmax(status == FINISHED)) if (status == FINISHED).any() else len(status)
    min_rows = math.ceil(MIN_WAIT_S / run.step_s - 1e-9) if run.step_s else 1
    is_waiting = _clear_short_sequences(status[:end] == WAITING, min_rows)
    is_standing = status[:end] == STANDING
    keys = 3 * group[:end] + np.where(is_standing, 2, is_waiting)
    cuts = [0, *(np.flatnonzero(np.diff(keys)) + 1).tolist(), end]
    for first, last in pairwise(cuts):
        if last > first:
            yield RecordSegment(int(group[first]), bool(is_waiting[first]), bool(is_standing[first]), first, last)


def _clear_short_sequences(flags: Flags, min_rows: int) -> Flags:
    """The flags without runs of fewer than `min_rows`."""
    long_flags = np.zeros(len(flags), dtype=bool)
    for first, last in find_true_spans(flags).tolist():
        long_flags[first:last] = last - first >= min_rows
    return long_flags


def measure_reversing_m(run: SimulationRun, tractor: int, segment: RecordSegment) -> float:
    """The metres of a segment that are driven in reverse."""
    last = min(segment.end_row, len(run.time_s) - 1)
    path = run.get_poses(tractor)[segment.first_row : last + 1, :2]
    numbers = run.record[segment.first_row : last, tractor, REC_LEG].astype(np.int64)
    first, beyond = (int(numbers[0]), int(numbers[-1]) + 1) if len(numbers) else (0, 0)
    gears = np.array([leg.gear for leg in run.plan.missions[tractor].legs[first:beyond]], np.int64)
    return float(np.hypot(*np.diff(path, axis=0).T)[gears[numbers - first] < 0].sum())


def find_longest_reversing(run: SimulationRun) -> tuple[float, int, bool]:
    """The most that a segment of a run is driven in reverse (m), the number of its tractor from 1, and whether it is in
    a corner of the headland: between two sides of its passes."""
    lengths = (
        (measure_reversing_m(run, tractor, segment), tractor, segment.first_row)
        for tractor in range(run.plan.tractors)
        for segment in iter_segments(run, tractor)
        if not segment.is_waiting
    )
    reverse_m, tractor, row = max(lengths, key=lambda entry: entry[0], default=(0.0, 0, 0))
    legs, leg = run.plan.missions[tractor].legs, int(run.get_leg_numbers(tractor)[row])
    before = next((one.task.kind for one in reversed(legs[:leg]) if one.task.is_work), None)
    after = next((one.task.kind for one in legs[leg:] if one.task.is_work), None)
    return reverse_m, tractor + 1, before == after == HEADLAND_PASS
