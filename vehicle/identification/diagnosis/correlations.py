"""How the fitted values depend on each other: correlations from the curvature of the cost of a fit."""

from __future__ import annotations

import numpy as np

from vehicle.identification.diagnosis.grammar import CONSTANT, Hypothesis, collect_widths
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.results import ParameterCorrelations
from vehicle.identification.diagnosis.values import compute_values
from vehicle.identification.logs.schema import Array

RELATIVE_STEP = 1e-4  # of a width: small against any curvature of a value over its coordinate
FEWEST_VALUES = 2


def compute_value_correlations(problem: Problem, fit: Fit) -> ParameterCorrelations | None:
    """The correlations of the values of all hypotheses of a fit but nuisances, which are free; None for fewer than two.

    A hypothesis with a law is named by effect and law, as ``steering_offset:by_speed``.
    """
    widths = collect_widths(fit.model)
    covariance = np.linalg.pinv(fit.curvature, hermitian=True) * np.outer(widths, widths)
    names: list[tuple[str, str]] = []
    rows = [np.empty((0, len(widths)))]
    for hypothesis in fit.model:
        if not hypothesis.is_nuisance:
            own, slopes = _list_value_slopes(problem, hypothesis, fit.get_amounts(hypothesis))
            block = np.zeros((len(own), len(widths)))
            block[:, fit.locate(hypothesis)] = slopes
            label = hypothesis.id if hypothesis.law in (CONSTANT, "by_place") else f"{hypothesis.id}:{hypothesis.law}"
            names += [(label, name) for name in own]
            rows.append(block)
    slopes = np.concatenate(rows)
    of_values = slopes @ covariance @ slopes.T
    spread = np.sqrt(np.maximum(np.diag(of_values), 0.0))
    known = spread > 0.0
    if known.sum() < FEWEST_VALUES:
        return None
    matrix = of_values[np.ix_(known, known)] / np.outer(spread[known], spread[known])
    kept = tuple(name for name, is_known in zip(names, known, strict=True) if is_known)
    return ParameterCorrelations(kept, np.clip(matrix, -1.0, 1.0))


def _list_value_slopes(problem: Problem, hypothesis: Hypothesis, amounts: Array) -> tuple[list[str], Array]:
    """The names of the values of a hypothesis, and the change of each (rows) per amount (columns)."""
    columns = []
    names: list[str] = []
    for place, coordinate in enumerate(hypothesis.coordinates):
        step = np.zeros(hypothesis.size)
        step[place] = RELATIVE_STEP * coordinate.width
        after, before = (
            compute_values(hypothesis, amounts + sign * step, problem.data, problem.rig.tractor) for sign in (1.0, -1.0)
        )
        names = list(after)
        changes = np.array([after[name] - before[name] for name in names]) / (2.0 * step[place])
        columns.append(np.where(np.isfinite(changes), changes, 0.0))
    return names, np.stack(columns, axis=1)
