"""Correlations of fitted values: closed forms for two and three values."""

from __future__ import annotations

import numpy as np
import pytest

from vehicle.identification.fit.effect_parameters import build_parameters
from vehicle.identification.fit.residual_fit import EffectFit, FitPart, LinearTerms
from vehicle.identification.logs.schema import Array
from vehicle.identification.verdict.correlations import compute_value_correlations
from vehicle.model.tractor import load_tractor


def part(name: str, *coordinates: float) -> FitPart:
    return build_parameters(load_tractor("eg105"), name), np.array(coordinates)


def fit(jacobian: Array, *parts: FitPart, linear: LinearTerms | None = None) -> EffectFit:
    return EffectFit(parts, np.zeros(len(jacobian)), jacobian, linear)


def test_two_values_are_correlated_by_the_angle_of_their_columns() -> None:
    rng = np.random.default_rng(5)
    jacobian = rng.normal(size=(60, 2))
    cosine = jacobian[:, 0] @ jacobian[:, 1] / np.prod(np.linalg.norm(jacobian, axis=0))
    found = compute_value_correlations(fit(jacobian, part("understeer", 1.0), part("steering_offset", 0.5)))
    assert found is not None
    assert found.names == (("understeer", "deg_per_mps2"), ("steering_offset", "angle_deg"))
    np.testing.assert_allclose(found.matrix, [[1.0, -cosine], [-cosine, 1.0]], atol=1e-9)


def test_a_limit_falls_where_its_coordinate_rises() -> None:
    jacobian = np.random.default_rng(6).normal(size=(60, 2))
    slide = part("side_slip", 10.0)  # the coordinate is one over the limit
    above, below = (
        compute_value_correlations(fit(jacobian, one, part("understeer", 1.0)))
        for one in (part("steering_gain", 1.1), slide)
    )
    assert above is not None and below is not None
    assert below.names[0] == ("side_slip", "limit_g")
    assert below.matrix[0, 1] == pytest.approx(-above.matrix[0, 1])


def test_linear_terms_are_free_and_not_listed() -> None:
    rng = np.random.default_rng(7)
    shared = rng.normal(size=80)
    jacobian = np.column_stack([shared + 0.1 * rng.normal(size=80), shared + 0.1 * rng.normal(size=80), shared])
    parts = part("understeer", 1.0), part("steering_offset", 0.5)
    alone = compute_value_correlations(fit(jacobian[:, :2], *parts))
    beside = compute_value_correlations(fit(jacobian, *parts))
    assert alone is not None and beside is not None and beside.matrix.shape == (2, 2)
    assert alone.matrix[0, 1] < -0.9 and abs(beside.matrix[0, 1]) < 0.5, "what both share belongs to the term"


def test_one_value_alone_has_no_correlation() -> None:
    assert compute_value_correlations(fit(np.ones((9, 1)), part("understeer", 1.0))) is None
    assert compute_value_correlations(fit(np.zeros((9, 0)))) is None
