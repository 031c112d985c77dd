"""How the fitted values depend on each other, and what their intervals contain: both from one fit."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from vehicle.identification.cause_selection.evidence import estimate_robust_covariance
from vehicle.identification.cause_selection.tolerances import estimate_run_variances
from vehicle.identification.diagnosis.results import ParameterCorrelations
from vehicle.identification.fit.residual_fit import EffectFit, FitPart
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.residual_model import RESIDUAL_BLOCK_S, ResidualModel

LEAST_FACTOR = 1.05  # chosen: smaller differences change no printed digit
CONTENTS = (
    "The intervals hold the scatter of the logs, the tolerances of the tractor file, and the ways in which tyres and "
    "lags of other makes differ from it."
)
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


def describe_intervals(residual_model: ResidualModel, fit: EffectFit, names: Collection[str]) -> str:
    """Return what the intervals of some effects contain; empty where none of them is in the fit.

    Soil that is alike for minutes, or a controller that steers back, makes the blocks of a run alike: the scatter of
    runs then exceeds what blocks tell.
    """
    shown = [name for name in names if name in fit.settings]
    if not shown:
        return ""
    if len(residual_model.dataset.names) == 1:
        return f"{CONTENTS} With one run alone, errors that last, as of soil or of a controller, are not seen in full."
    by_block = np.diag(estimate_robust_covariance(residual_model, fit, widen_for_few=True))
    by_run = estimate_run_variances(residual_model, fit)
    factor = max(
        float(np.sqrt(np.max(by_run[place] / np.maximum(by_block[place], 1e-300))))
        for place in map(fit.find_columns, shown)
    )
    blocks = f"blocks of {RESIDUAL_BLOCK_S:g} s"
    if factor < LEAST_FACTOR:
        return (
            f"{CONTENTS} The runs scatter no more than their {blocks}: errors that last, as of soil or of a controller "
            "that steers back, add nothing."
        )
    return (
        f"{CONTENTS} Errors last longer than {blocks}, as of soil or of a controller that steers back: the runs "
        f"scatter up to {factor:.1f} times as much as their blocks tell, and that scatter counts."
    )
