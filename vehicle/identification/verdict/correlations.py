"""How the fitted values depend on each other: correlations from the information of one fit."""

from __future__ import annotations

import numpy as np

from vehicle.identification.fit.residual_fit import EffectFit, FitPart
from vehicle.identification.logs.schema import Array
from vehicle.identification.verdict.diagnosis_types import ParameterCorrelations

RELATIVE_STEP = 1e-4  # of a typical size: small against any curvature of a value over its coordinate
FEWEST_VALUES = 2
LEAST_EIGENVALUE = 1e-12  # of the largest: directions that the logs do not determine at all are left out


def compute_value_correlations(fit: EffectFit) -> ParameterCorrelations | None:
    """Return the correlations of the values of all effects of a fit; None for fewer than two values.

    Linear terms of the fit are free as well, as they were when it was made.
    """
    count = sum(parameters.count for parameters, _ in fit.parts)
    if count < FEWEST_VALUES:
        return None
    covariance = np.linalg.pinv(fit.jacobian.T @ fit.jacobian, rcond=LEAST_EIGENVALUE, hermitian=True)[:count, :count]
    names, slopes = _list_value_slopes(fit.parts, count)
    of_values = slopes @ covariance @ slopes.T
    spread = np.sqrt(np.maximum(np.diag(of_values), 0.0))
    known = spread > 0.0
    if known.sum() < FEWEST_VALUES:
        return None
    matrix = of_values[np.ix_(known, known)] / np.outer(spread[known], spread[known])
    kept = tuple(name for name, is_known in zip(names, known, strict=True) if is_known)
    return ParameterCorrelations(kept, np.clip(matrix, -1.0, 1.0))


def _list_value_slopes(parts: tuple[FitPart, ...], count: int) -> tuple[list[tuple[str, str]], Array]:
    """Return the names of the values, and the change of each (rows) per coordinate of the fit (columns)."""
    names: list[tuple[str, str]] = []
    rows: list[Array] = []
    first = 0
    for parameters, coordinates in parts:
        values = {name: np.zeros(count) for name in parameters.compute_values(coordinates)}
        for axis in range(parameters.count):
            step = np.zeros(parameters.count)
            step[axis] = RELATIVE_STEP * parameters.typical[axis]
            after, before = (parameters.compute_values(coordinates + sign * step) for sign in (1.0, -1.0))
            for name, row in values.items():
                slope = (after[name] - before[name]) / (2.0 * step[axis])
                row[first + axis] = slope if np.isfinite(slope) else 0.0
        names += [(parameters.id, name) for name in values]
        rows += list(values.values())
        first += parameters.count
    return names, np.array(rows)
