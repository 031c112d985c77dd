"""Regressions of a quantity over all runs, and what one run has of its own beside what the others say."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.identification.faults.steering_evidence import STEP_S
from vehicle.identification.logs.schema import Array, Mask, Rows

_THIN_S = 0.5  # between rows: nearer ones say about the same
_MOST_MEMORY = 0.9  # from row to row
_HALF_SHARE = 0.5  # chosen: each half of a run must show this much of what the run shows
FEWEST_ROWS = 12  # of a run
_PASSES, _OUTLIER_SIGMAS = 4, 9.0


@dataclass(frozen=True, eq=False)
class RunRegression:
    """A quantity of all runs: values (k,), the run of each row (k,), and columns that describe them.

    `nuisance` (k, n) has the standard deviations `prior_sd` (n,) of its coefficients; `own` (k, d) are the columns of a
    run's own difference.
    """

    values: Array
    runs: Array
    nuisance: Array
    prior_sd: Array
    own: Array


def thin_rows(chosen: Mask, apart_s: float = _THIN_S) -> Rows:
    """Return the chosen rows of a grid, of each `apart_s` the first."""
    rows = np.flatnonzero(chosen)
    return rows[np.unique(rows // round(apart_s / STEP_S), return_index=True)[1]] if len(rows) else rows


def estimate_noise(regression: RunRegression) -> tuple[float, Array]:
    """Return the standard deviation of a row inside its run, as independent rows would have it, and weights (k,).

    Each run is laid on what all runs show by its own difference first, so that an unlike run is no noise. Rows far from
    that have the weight 0.
    """
    weights, sigma = np.ones(len(regression.values)), 1.0
    for _ in range(_PASSES):
        theta, _ = _solve(regression, weights > 0.0, sigma)
        residuals = regression.values - regression.nuisance @ theta
        for run in np.unique(regression.runs):
            rows = regression.runs == run
            if np.count_nonzero(rows) >= FEWEST_ROWS:
                own = np.column_stack([regression.own[rows], np.ones(np.count_nonzero(rows))])
                residuals[rows] -= own @ np.linalg.lstsq(own, residuals[rows], rcond=None)[0]
        sigma = max(1.4826 * float(np.median(np.abs(residuals))), 1e-6)
        weights = (np.abs(residuals) < _OUTLIER_SIGMAS * sigma).astype(np.float64)
    inside = np.diff(regression.runs) == 0
    clipped = np.clip(residuals, -3.0 * sigma, 3.0 * sigma)
    memory = float(np.mean(clipped[1:][inside] * clipped[:-1][inside])) / max(float(np.mean(clipped**2)), 1e-12)
    memory = min(max(memory, 0.0), _MOST_MEMORY)
    return sigma * math.sqrt((1.0 + memory) / (1.0 - memory)), weights


def _solve(regression: RunRegression, rows: Mask, sigma: float) -> tuple[Array, Array]:
    """Return coefficients (n,) of the nuisance columns and their covariance (n, n), from some rows."""
    columns = regression.nuisance[rows] / sigma
    precision = columns.T @ columns + np.diag(regression.prior_sd**-2.0)
    covariance: Array = np.linalg.inv(precision).astype(np.float64)
    # Values of about 1 degree per degree: the first coefficient is expected there, all others at 0.
    theta: Array = covariance @ (columns.T @ (regression.values[rows] / sigma))
    return theta, covariance


def estimate_own(
    regression: RunRegression, own_rows: Mask, column: int, sigma: float, weights: Array, part: Mask | None = None
) -> tuple[float, float] | None:
    """Return one difference of a run, alone, from what other runs say of its conditions, and its standard error."""
    others = ~own_rows & (weights > 0.0)
    rows = own_rows if part is None else own_rows & part
    if np.count_nonzero(rows) < FEWEST_ROWS or np.count_nonzero(others) < FEWEST_ROWS:
        return None
    theta, covariance = _solve(regression, others, sigma)
    columns, own = regression.nuisance[rows], regression.own[rows][:, column]
    residuals = regression.values[rows] - columns @ theta
    spread = columns @ covariance @ columns.T + sigma**2 * np.eye(len(residuals))
    weighted = np.linalg.solve(spread, own)
    information = float(own @ weighted) + 1e-12
    return float(weighted @ residuals) / information, 1.0 / math.sqrt(information)


def is_shown_in_halves(
    regression: RunRegression, run: int, column: int, own: float, sigma: float, weights: Array
) -> bool:
    """Whether the first and the second half of a run show the difference too, as far as they show anything."""
    own_rows = regression.runs == run
    order = np.cumsum(own_rows)
    middle = order[-1] / 2.0
    for part in (order <= middle, order > middle):
        estimate = estimate_own(regression, own_rows, column, sigma, weights, part)
        if estimate is None:
            continue
        half, error = estimate
        if abs(own) > 3.0 * error and half * np.sign(own) < _HALF_SHARE * abs(own):
            return False
    return True
