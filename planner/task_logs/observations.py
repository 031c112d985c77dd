"""Events of runs that a farm can learn from (speeds of passes, turns, stops, order of the headland), with intervals.

Events of one run are correlated, so whole runs are resampled, not events, as soon as there are enough runs (cluster
bootstrap: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 8); with fewer runs, events are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from fields.arrays import Floats
from planner.task_logs.runs.phases import MOVING_MPS, RunPhases, classify_phases
from planner.task_logs.runs.run_records import ProjectedRun
from reports.task_logs.run_results import ACTIVITY_KINDS, STANDING
from vehicle.identification.logs.series import find_spans
from vehicle.model.effect_kinds import INTERVAL_COVERAGE

BOOTSTRAP_SAMPLES = 1_000
INTERVAL_QUANTILES = (0.5 - 0.5 * INTERVAL_COVERAGE, 0.5 + 0.5 * INTERVAL_COVERAGE)
Statistic = Callable[[Floats], float | np.floating[Any]]
MIN_PASS_S = 20.0
"""Shorter segments of work are not passes."""
MIN_EVENTS, MAX_SWATHS_OVER = 5, 10
INNER_WIDTHS, MIN_SHARE = 3.0, 0.05
"""Widths from the outline up to which work is headland, widths from which it is inside, smallest share of either."""


@dataclass(frozen=True)
class IntervalEstimate:
    """A value with its 95 % interval, the number of events, and the names of their runs."""

    value: float
    low: float
    high: float
    events: int
    runs: tuple[str, ...]


def estimate_statistic(events: Mapping[str, Floats], statistic: Statistic, min_events: int) -> IntervalEstimate | None:
    """A statistic of the events (n, ...) of all runs; None for fewer than `min_events`."""
    used_events = {name: run_events for name, run_events in events.items() if len(run_events)}
    if sum(map(len, used_events.values())) < min_events:
        return None
    parts = list(used_events.values())
    all_events = np.concatenate(parts)
    random = np.random.default_rng(1)
    samples = []
    for _ in range(BOOTSTRAP_SAMPLES):
        if len(parts) >= MIN_EVENTS:
            resample = np.concatenate([parts[index] for index in random.integers(0, len(parts), len(parts))])
        else:
            resample = all_events[random.integers(0, len(all_events), len(all_events))]
        samples.append(statistic(resample))
    low, high = np.quantile(np.array(samples), INTERVAL_QUANTILES)
    return IntervalEstimate(float(statistic(all_events)), float(low), float(high), len(all_events), tuple(used_events))


def estimate_hourly_rate(events: Mapping[str, tuple[int, float]]) -> IntervalEstimate | None:
    """Events per hour, from (events, hours) of every run, with Garwood's exact interval of a Poisson rate.

    With several runs, the bootstrap interval is used if it is wider.
    """
    from scipy.stats import chi2

    used_events = {name: pair for name, pair in events.items() if pair[1] > 0.0}
    count, hours = sum(pair[0] for pair in used_events.values()), sum(pair[1] for pair in used_events.values())
    if not hours:
        return None
    low = float(chi2.ppf(INTERVAL_QUANTILES[0], 2 * count)) / 2.0 / hours if count else 0.0
    high = float(chi2.ppf(INTERVAL_QUANTILES[1], 2 * count + 2)) / 2.0 / hours
    if len(used_events) >= MIN_EVENTS:
        table = {name: np.array([pair], dtype=np.float64) for name, pair in used_events.items()}
        by_run = estimate_statistic(table, lambda rows: float(rows[:, 0].sum() / rows[:, 1].sum()), 1)
        if by_run is not None:
            low, high = min(low, by_run.low), max(high, by_run.high)
    return IntervalEstimate(count / hours, low, high, count, tuple(used_events))


def estimate_share(hits: int, runs: tuple[str, ...]) -> IntervalEstimate:
    """The share `hits` of the runs, with Wilson's interval (J. Am. Stat. Assoc. 22:209, 1927)."""
    from scipy.stats import binomtest

    interval = binomtest(hits, len(runs)).proportion_ci(INTERVAL_COVERAGE, method="wilson")
    return IntervalEstimate(hits / len(runs), float(interval.low), float(interval.high), len(runs), runs)


def compute_variation_coefficient(values: Floats) -> float:
    """Coefficient of variation of a sample (n,)."""
    return float(np.std(values, ddof=1) / np.mean(values)) if len(values) > 1 else 0.0


def estimate_cv(events: Mapping[str, Floats]) -> IntervalEstimate | None:
    """The coefficient of variation of the events of all runs; None for too few."""
    return estimate_statistic(events, compute_variation_coefficient, 2 * MIN_EVENTS)


class RunObservations:
    """Events of runs by kind; `width_m` converts the offset of a turn to a number of swaths."""

    def __init__(self, runs: Sequence[ProjectedRun], width_m: float) -> None:
        """Classify the phases of the runs with a known work state."""
        self.width_m = width_m
        self.runs = [run for run in runs if run.has_work_state]
        self.phases_by_run: dict[str, RunPhases] = {run.name: classify_phases(run) for run in self.runs}
        self.pass_speeds = {run.name: _find_pass_speeds(run) for run in self.runs}
        self.stops_s = {name: run_phases.stops_s for name, run_phases in self.phases_by_run.items()}

    def estimate_pass_cv(self) -> IntervalEstimate | None:
        """Coefficient of variation of the mean speed of passes, relative to their run."""
        ratios = {name: mps / mps.mean() for name, mps in self.pass_speeds.items() if len(mps) >= MIN_EVENTS}
        return estimate_statistic(ratios, compute_variation_coefficient, MIN_EVENTS)

    def list_u_turn_seconds(self, swaths: int) -> Mapping[str, Floats]:
        """Seconds of U-turns without a stop over so many swaths, by run."""
        return {
            name: np.array([
                turn.seconds
                for turn in run_phases.turns
                if turn.is_u_turn and swaths - 0.5 < turn.offset_m / self.width_m <= swaths + 0.5
            ])
            for name, run_phases in self.phases_by_run.items()
        }  # fmt: skip

    def estimate_frequent_turn_s(self) -> tuple[int, IntervalEstimate] | None:
        """The most frequent turn: over how many swaths, and its median in seconds."""
        turns = {swaths: self.list_u_turn_seconds(swaths) for swaths in (1, 2, 3, 4)}
        swaths = max(turns, key=lambda each: sum(map(len, turns[each].values())))
        estimate = estimate_statistic(turns[swaths], np.median, MIN_EVENTS)
        return None if estimate is None else (swaths, estimate)

    def estimate_long_turn_cv(self) -> IntervalEstimate | None:
        """Coefficient of variation of the time of longer turns, relative to the mean over as many swaths."""
        ratios: dict[str, list[float]] = {run.name: [] for run in self.runs}
        for swaths in range(2, MAX_SWATHS_OVER + 1):
            turns_by_run = self.list_u_turn_seconds(swaths)
            all_turns = np.concatenate(list(turns_by_run.values()))
            if len(all_turns) >= MIN_EVENTS:
                for name, seconds in turns_by_run.items():
                    ratios[name] += (seconds / all_turns.mean()).tolist()
        events = {name: np.array(values) for name, values in ratios.items()}
        return estimate_cv(events)

    def estimate_stops_per_hour(self) -> IntervalEstimate | None:
        """Stops per hour of driving."""
        events = {}
        for run in self.runs:
            is_moving = self.phases_by_run[run.name].kinds != ACTIVITY_KINDS.index(STANDING)
            hours = float(np.diff(run.time_s)[is_moving].sum()) / 3600.0
            events[run.name] = len(self.stops_s[run.name]), hours
        return estimate_hourly_rate(events)

    def estimate_headland_first_share(self) -> IntervalEstimate | None:
        """The share of runs that worked the edge of the field before its inside; None if no run shows it."""
        first_by_run = {
            run.name: first for run in self.runs if (first := _is_edge_first(run, self.width_m)) is not None
        }
        return estimate_share(sum(first_by_run.values()), tuple(first_by_run)) if first_by_run else None


def _find_pass_speeds(run: ProjectedRun) -> Floats:
    """Mean speeds (n,) of the segments of work."""
    pass_speeds = []
    for first, last in find_spans(run.is_working):
        speed = run.speed_mps[first : last + 1]
        speed = speed[speed > MOVING_MPS]
        if run.time_s[last] - run.time_s[first] >= MIN_PASS_S and len(speed):
            pass_speeds.append(float(speed.mean()))
    return np.array(pass_speeds)


def _is_edge_first(run: ProjectedRun, width_m: float) -> bool | None:
    """Whether the edge was worked before the inside, by mean times; None if one of them is hardly worked."""
    if run.outline is None:
        return None
    distance_m = shapely.distance(run.outline.boundary, shapely.points(run.xy))
    edge = run.is_working & (distance_m < width_m)
    inner = run.is_working & (distance_m > INNER_WIDTHS * width_m)
    if min(int(edge.sum()), int(inner.sum())) < MIN_SHARE * max(int(run.is_working.sum()), 1):
        return None
    return bool(run.time_s[edge].mean() < run.time_s[inner].mean())
