"""What values of single runs have in common: one run that is unlike the others, or a swing over the day."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.logs.schema import Array, Log

FEWEST_FOR_SWING = 7  # runs: four numbers describe a swing, and fewer runs than this follow one by chance
PERIODS = np.geomspace(0.7, 4.0, 40)  # of the time from the first run to the last; longer ones are straight lines


@dataclass(frozen=True)
class RunPattern:
    """How the amounts of runs vary: `kind` by_run (`run` has `amount`, the others `other`), or over_day, a swing of
    `amount` about `other` with a period (s) and a phase (rad) at time 0 of the logs."""

    kind: str
    amount: float
    other: float
    run: int = 0
    period_s: float = 0.0
    phase: float = 0.0


def list_run_starts(logs: Sequence[Log]) -> Array:
    """The time (s) of the first used row of every log."""
    return np.array([float(log.time_s[log.used][0]) if log.used.any() else 0.0 for log in logs])


def find_run_pattern(amounts: Array, sigmas: Array, starts_s: Array) -> RunPattern:
    """The simplest pattern that describes the amounts (r,) of runs that began at `starts_s` (r,).

    A swing needs FEWEST_FOR_SWING runs at different times; it is taken where it describes them better than one odd run,
    by the Bayesian information criterion.
    """
    odd, misfit = _find_odd_run(amounts, sigmas)
    span = float(np.ptp(starts_s))
    if len(amounts) < FEWEST_FOR_SWING or span <= 0.0 or len(np.unique(starts_s)) < FEWEST_FOR_SWING:
        return odd
    fits = [_fit_swing(amounts, sigmas, starts_s, share * span) for share in PERIODS]
    swing, swing_misfit = min(fits, key=lambda one: one[1])
    more_numbers = 2.0 * math.log(len(amounts))
    return swing if swing_misfit + more_numbers < misfit else odd


def _find_odd_run(amounts: Array, sigmas: Array) -> tuple[RunPattern, float]:
    """The run whose own value leaves the least misfit of the others' mean, and that misfit."""
    weights = 1.0 / (sigmas * sigmas)
    found: list[tuple[float, int, float]] = []
    for run in range(len(amounts)):
        others = np.arange(len(amounts)) != run
        mean = float(np.average(amounts[others], weights=weights[others]))
        found.append((float((weights[others] * (amounts[others] - mean) ** 2).sum()), run, mean))
    misfit, run, mean = min(found)
    return RunPattern("by_run", float(amounts[run]), mean, run), misfit


def _fit_swing(amounts: Array, sigmas: Array, starts_s: Array, period_s: float) -> tuple[RunPattern, float]:
    angle = 2.0 * math.pi * starts_s / period_s
    columns = np.stack([np.ones(len(amounts)), np.sin(angle), np.cos(angle)], axis=1) / sigmas[:, None]
    numbers = np.linalg.lstsq(columns, amounts / sigmas, rcond=None)[0]
    misfit = float(((columns @ numbers - amounts / sigmas) ** 2).sum())
    size, phase = math.hypot(numbers[1], numbers[2]), math.atan2(numbers[2], numbers[1])
    return RunPattern("over_day", size, float(numbers[0]), 0, period_s, phase), misfit
