"""Runs of two tractors, or of one that was changed between two runs: two groups that differ far more than their runs.

What each run has of its own is estimated for all runs at once. Two groups are told only where the gap between them is
wider, against the scatter inside them, than runs of one normal distribution nearly ever leave; a value that moves
steadily from run to run leaves no gap.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from vehicle.identification.faults.run_regression import FEWEST_ROWS, RunRegression, estimate_noise
from vehicle.identification.logs.schema import Array, Log
from vehicle.identification.thresholds import (
    GROUP_CHANCE,
    GROUP_FEWEST_RUNS,
    GROUP_LEAST_SCATTER_SHARE,
    UNLIKE_SIGMAS,
)

_ANY_DIFFERENCE = 3.0  # standard deviation of what a run may have of its own: more than any cause gives it
_NULL_DRAWS, _NULL_SEED = 20_000, 12
_NULL_SPREADS = (0.5, 1.0, 2.0)  # standard deviations, of the difference that matters


@dataclass(frozen=True)
class RunSplit:
    """Two groups of runs (indices), by how much `second` exceeds `first`, and how clearly.

    `clarity` is the gap between the groups over the gap that chance leaves.
    """

    first: tuple[int, ...]
    second: tuple[int, ...]
    amount: float
    clarity: float


@dataclass(frozen=True, eq=False)
class OwnValues:
    """What runs have of their own: indices of the runs (n,), values (n,) and their covariance (n, n)."""

    runs: tuple[int, ...]
    values: Array
    covariance: Array

    def measure_difference(self, first: Collection[int], second: Collection[int], least: float) -> tuple[float, float]:
        """Return by how much the second runs exceed the first, and the standard error of that.

        The error has the scatter inside both, and what conditions in which they differ may explain: a condition that
        differs inside them as well, where they agree, explains nothing. It is infinite where one of them has no value.
        """
        in_second = np.array([run in second for run in self.runs])
        in_first = np.array([run in first for run in self.runs])
        if not in_first.any() or not in_second.any():
            return 0.0, math.inf
        chosen = np.flatnonzero(in_first | in_second)
        scatter = _measure_scatter(self.values[in_first], self.values[in_second], least)
        covariance = self.covariance[np.ix_(chosen, chosen)] + scatter**2 * np.eye(len(chosen))
        columns = np.column_stack([np.ones(len(chosen)), in_second[chosen]])
        weighted = np.linalg.solve(covariance, columns)
        inverse = np.linalg.inv(columns.T @ weighted)
        amount = float((inverse @ (weighted.T @ self.values[chosen]))[1])
        return amount, math.sqrt(float(inverse[1, 1]))


def estimate_own_values(regression: RunRegression, column: int, least: float) -> OwnValues:
    """Estimate what each run has of its own in one column, all together.

    Runs that do not show it to half of `least` are left out, as where only a condition of their own may explain it.
    """
    sigma, weights = estimate_noise(regression)
    runs = [
        int(run)
        for run in np.unique(regression.runs)
        if np.count_nonzero((regression.runs == run) & (weights > 0.0)) >= FEWEST_ROWS
    ]
    if not runs:
        return OwnValues((), np.zeros(0), np.zeros((0, 0)))
    own = np.stack([np.where(regression.runs == run, regression.own[:, column], 0.0) for run in runs], axis=1)
    rows = (weights > 0.0) & np.isin(regression.runs, runs)
    columns = np.hstack([regression.nuisance, own])[rows] / sigma
    prior_sd = np.concatenate([regression.prior_sd, np.full(len(runs), _ANY_DIFFERENCE)])
    covariance: Array = np.linalg.inv(columns.T @ columns + np.diag(prior_sd**-2.0)).astype(np.float64)
    values = (covariance @ (columns.T @ (regression.values[rows] / sigma)))[-len(runs) :]
    covariance = covariance[-len(runs) :, -len(runs) :]
    # Conditions make the values of runs uncertain together; what its own rows show of a run is enough to place it.
    errors = sigma / np.sqrt(np.sum(own[rows] ** 2, axis=0) + 1e-12)
    known = np.flatnonzero(errors < 0.5 * least)
    return OwnValues(tuple(runs[place] for place in known), values[known], covariance[np.ix_(known, known)])


def find_split(own: OwnValues, least: float) -> RunSplit | None:
    """Return the two groups of runs that differ by more than `least` with the widest gap; None without such groups."""
    count = len(own.runs)
    if count < 2 * GROUP_FEWEST_RUNS:
        return None
    order = np.argsort(own.values)
    ordered = own.values[order]
    gaps = _measure_gaps(ordered[None], least)[0]
    place = int(np.argmax(gaps)) + GROUP_FEWEST_RUNS
    first, second = (tuple(sorted(own.runs[row] for row in part)) for part in (order[:place], order[place:]))
    amount, error = own.measure_difference(first, second, least)
    if amount < max(least, UNLIKE_SIGMAS * error):
        return None
    clarity = float(np.max(gaps)) / _draw_chance_gap(count)
    return RunSplit(first, second, amount, clarity) if clarity > 1.0 else None


def _measure_scatter(first: Array, second: Array, least: float) -> float:
    """Return the standard deviation inside two groups, at least a share of what matters."""
    squares = sum(float(np.sum((group - np.mean(group)) ** 2)) for group in (first, second))
    inside = math.sqrt(squares / max(len(first) + len(second) - 2, 1))
    return max(inside, GROUP_LEAST_SCATTER_SHARE * least)


def _measure_gaps(ordered: Array, least: float) -> Array:
    """Return the gaps (draws, splits) of ordered values (draws, n) over the scatter inside both groups."""
    count = ordered.shape[1]
    gaps = []
    for place in range(GROUP_FEWEST_RUNS, count - GROUP_FEWEST_RUNS + 1):
        groups = ordered[:, :place], ordered[:, place:]
        squares = sum(np.sum((group - np.mean(group, axis=1, keepdims=True)) ** 2, axis=1) for group in groups)
        scatter = np.maximum(np.sqrt(squares / (count - 2)), GROUP_LEAST_SCATTER_SHARE * least)
        gaps.append((ordered[:, place] - ordered[:, place - 1]) / scatter)
    return np.stack(gaps, axis=1)


@lru_cache(maxsize=32)
def _draw_chance_gap(count: int) -> float:
    """Return the gap over the scatter that so many values of one normal distribution exceed with GROUP_CHANCE, however
    wide that is."""
    draws = np.sort(np.random.default_rng(_NULL_SEED).standard_normal((_NULL_DRAWS, count)), axis=1)
    widest = [np.max(_measure_gaps(spread * draws, 1.0), axis=1) for spread in _NULL_SPREADS]
    return max(float(np.quantile(gaps, 1.0 - GROUP_CHANCE)) for gaps in widest)


def rank_runs(logs: Sequence[Log]) -> list[int]:
    """Return the place of each run in time; logs whose clocks start anew count in the order in which they are given."""
    spans = sorted((float(log.time_s[0]), float(log.time_s[-1])) for log in logs)
    if any(later[0] < earlier[1] for earlier, later in pairwise(spans)):
        return list(range(len(logs)))
    starts = [span[0] for span in spans]
    return [starts.index(float(log.time_s[0])) for log in logs]


def is_later(ranks: Sequence[int], earlier: Collection[int], later: Collection[int]) -> bool:
    """Whether all runs of one group were driven after all of another."""
    return max(ranks[run] for run in earlier) < min(ranks[run] for run in later)
