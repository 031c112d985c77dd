"""Quantities with which the value of a parameter may change, as columns of numbers per row of a log.

A law adds to the constant value of a parameter a combination of a few such columns. The clock of a set of logs counts
from its first row, so that runs of one day have an order where their logs have a common time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vehicle.identification.cause_selection.covariates import get_steering
from vehicle.identification.logs.schema import Array, Log
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment

OVER_MINUTES, OVER_DAY, BY_PLACE, BY_RUN = "over_minutes", "over_day", "by_place", "by_run"
BY_IMPLEMENT, BY_SIDE, BY_ANGLE, BY_SPEED = "by_implement", "by_side", "by_angle", "by_speed"
WIDEST_ANGLE_DEG = 27.0  # a law by angle is held beyond: chosen, further out logs have few rows
# Of the time from the first to the last row of all runs: chosen, from a slow change to two swings.
DAY_PERIOD_SHARES = (4.0, 3.0, 2.4, 2.0, 1.7, 1.45, 1.25, 1.1, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
FEWEST_DAY_RUNS, FEWEST_GROUP_RUNS = 4, 2
LEAST_DAY_OF_RUN = 2.0  # of the longest run: chosen, in less time a day is the minutes of a run
SPEED_QUANTILES, LEAST_SPEED_RATIO = (0.1, 0.9), 1.25
"""Chosen: at one speed, with starts and stops, a law by speed is a law by the noise of the speed."""
LEAST_VARIED_SHARE = 0.02  # of the rows on either side of a switch: chosen, with fewer it shows nothing
ComputeRows = Callable[[DriveSegment], Array]


@dataclass(frozen=True, eq=False)
class LawBasis:
    """One possible law: its kind, its columns (k, c) for the rows of a segment, and choices made by searching.

    `detail` are numbers that describe the columns, such as the period of a day (s).
    """

    kind: str
    compute_rows: ComputeRows
    detail: Mapping[str, float] = field(default_factory=dict)
    searched: int = 0
    groups: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class RunClock:
    """Time (s) from the first row of all runs to the first row of each run; `epoch_s` is the `time_s` of the first."""

    starts_s: Array
    epoch_s: float
    has_order: bool

    def compute_time(self, segment: DriveSegment) -> Array:
        """Return the time of the rows of a segment (k,), s."""
        return float(self.starts_s[segment.run]) + segment.start_s + segment.time


def build_run_clock(logs: Sequence[Log], runs: Sequence[int]) -> RunClock:
    """Return the clock of the runs of a dataset, given by their places in the logs.

    Runs have an order where no two of them overlap; logs that all begin at the same time have none.
    """
    times = [log.time_s[log.used] if log.used.any() else log.time_s for log in (logs[run] for run in runs)]
    spans = np.array([(time[0], time[-1]) for time in times])
    first = float(spans[:, 0].min())
    ordered = spans[np.argsort(spans[:, 0])]
    longest = float(np.ptp(spans, axis=1).max())
    has_order = (
        len(runs) >= FEWEST_DAY_RUNS
        and bool(np.all(ordered[1:, 0] >= ordered[:-1, 1]))
        and float(np.ptp(spans)) > LEAST_DAY_OF_RUN * longest
    )
    return RunClock(spans[:, 0] - first, first, has_order)


def _stack(*columns: Array) -> Array:
    return np.stack(columns, axis=1)


def _get_minutes(segment: DriveSegment) -> Array:
    return _stack((segment.start_s + segment.time) / 60.0)


def _get_place(segment: DriveSegment) -> Array:
    return _stack(segment.east, segment.north)


def _get_working(segment: DriveSegment) -> Array:
    return _stack(segment.working)


def get_angle_deg(segment: DriveSegment) -> Array:
    """Return the wheel angle of the rows (k,), deg."""
    angle = get_steering(segment)
    return np.degrees(np.append(angle, angle[-1:]))


def _get_size_of_angle(segment: DriveSegment) -> Array:
    return _stack(np.minimum(np.abs(get_angle_deg(segment)), WIDEST_ANGLE_DEG))


def _get_is_left(segment: DriveSegment) -> Array:
    return _stack((get_angle_deg(segment) < 0.0).astype(np.float64))


def _get_speed(segment: DriveSegment) -> Array:
    return _stack(segment.speed_in_gear)


def list_bases(dataset: DriveDataset, clock: RunClock) -> list[LawBasis]:
    """List the laws that these logs could show, without those by run, which are searched."""
    bases = [
        LawBasis(OVER_MINUTES, _get_minutes),
        LawBasis(BY_ANGLE, _get_size_of_angle),
        LawBasis(BY_PLACE, _get_place),
        LawBasis(BY_SIDE, _get_is_left),
    ]
    slow, fast = np.quantile(np.concatenate([one.speed_in_gear for one in dataset.segments]), SPEED_QUANTILES)
    if fast > LEAST_SPEED_RATIO * slow:
        bases.append(LawBasis(BY_SPEED, _get_speed))
    working = float(np.mean(np.concatenate([segment.working for segment in dataset.segments])))
    if LEAST_VARIED_SHARE < working < 1.0 - LEAST_VARIED_SHARE:
        bases.append(LawBasis(BY_IMPLEMENT, _get_working))
    return bases + (_list_day_bases(dataset, clock) if clock.has_order else [])


def _list_day_bases(dataset: DriveDataset, clock: RunClock) -> list[LawBasis]:
    ends = [float(clock.compute_time(segment)[-1]) for segment in dataset.segments]

    def make_basis(period: float) -> LawBasis:
        def compute_rows(segment: DriveSegment) -> Array:
            phase = 2.0 * np.pi * clock.compute_time(segment) / period
            return _stack(np.sin(phase), np.cos(phase))

        return LawBasis(OVER_DAY, compute_rows, {"period_s": period}, len(DAY_PERIOD_SHARES))

    return [make_basis(share * max(ends)) for share in DAY_PERIOD_SHARES]


def build_group_basis(groups: Sequence[int], choices: int) -> LawBasis:
    """Return the law by run of two groups: the group (0 or 1) of every run, and how many groupings were compared."""

    def compute_rows(segment: DriveSegment) -> Array:
        return np.full((segment.rows, 1), float(groups[segment.run]))

    return LawBasis(BY_RUN, compute_rows, {}, choices, tuple(groups))
