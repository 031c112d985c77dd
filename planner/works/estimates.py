"""Values with intervals from events of several runs.

Events of one run are alike, so runs are drawn anew, not events, as soon as there are enough of them (cluster bootstrap:
Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 8); with fewer, events are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from planner.works.record import Array

DRAWS, SEED = 1_000, 1
ENOUGH_RUNS = 5
CENTRAL = (0.025, 0.975)
Statistic = Callable[[Array], float]


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval, from so many events of the runs with these names."""

    value: float
    low: float
    high: float
    events: int
    runs: tuple[str, ...]


def estimate(events: Mapping[str, Array], statistic: Statistic, least: int) -> Estimate | None:
    """A statistic of the events (n, ...) of all runs; None for fewer than `least` events."""
    used = {name: each for name, each in events.items() if len(each)}
    if sum(map(len, used.values())) < least:
        return None
    parts = list(used.values())
    whole = np.concatenate(parts)
    draw = np.random.default_rng(SEED)
    drawn = []
    for _ in range(DRAWS):
        if len(parts) >= ENOUGH_RUNS:
            picked = np.concatenate([parts[place] for place in draw.integers(0, len(parts), len(parts))])
        else:
            picked = whole[draw.integers(0, len(whole), len(whole))]
        drawn.append(statistic(picked))
    low, high = np.quantile(np.array(drawn), CENTRAL)
    return Estimate(statistic(whole), float(low), float(high), len(whole), tuple(used))


def rate(events: Mapping[str, tuple[int, float]]) -> Estimate | None:
    """Events per hour of runs given as (events, hours): Garwood's exact interval of a Poisson law, for one run.

    Of several the interval is of runs drawn anew where that is wider.
    """
    from scipy.stats import chi2

    used = {name: pair for name, pair in events.items() if pair[1] > 0.0}
    count, hours = sum(pair[0] for pair in used.values()), sum(pair[1] for pair in used.values())
    if not hours:
        return None
    low = float(chi2.ppf(CENTRAL[0], 2 * count)) / 2.0 / hours if count else 0.0
    high = float(chi2.ppf(CENTRAL[1], 2 * count + 2)) / 2.0 / hours
    if len(used) >= ENOUGH_RUNS:
        table = {name: np.array([pair], dtype=np.float64) for name, pair in used.items()}
        by_run = estimate(table, lambda rows: float(rows[:, 0].sum() / rows[:, 1].sum()), 1)
        if by_run is not None:
            low, high = min(low, by_run.low), max(high, by_run.high)
    return Estimate(count / hours, low, high, count, tuple(used))


def share(yes: int, runs: tuple[str, ...]) -> Estimate:
    """The share of runs of which something is true, with Wilson's interval (J. Am. Stat. Assoc. 22:209, 1927)."""
    n, z = len(runs), 1.959964
    middle = (yes + 0.5 * z * z) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(yes * (n - yes) / n + 0.25 * z * z)
    return Estimate(yes / n, max(0.0, middle - half), min(1.0, middle + half), n, runs)


def variation(values: Array) -> float:
    """Coefficient of variation of a sample (n,)."""
    return float(np.std(values, ddof=1) / np.mean(values)) if len(values) > 1 else 0.0


def mean(values: Array) -> float:
    """The mean of a sample (n,)."""
    return float(np.mean(values))


def median(values: Array) -> float:
    """The median of a sample (n,)."""
    return float(np.median(values))
