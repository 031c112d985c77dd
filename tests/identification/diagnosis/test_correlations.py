"""Correlations of fitted values: closed forms from the curvature of the cost."""

import numpy as np
import pytest

from tests.identification.diagnosis.problems import build_drive_problem, build_fit, build_hypothesis
from vehicle.identification.diagnosis.grammar import build_scope, list_nuisances
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.search import build_patch
from vehicle.identification.diagnosis.verdicts import compute_value_correlations, compute_values


@pytest.fixture(scope="module")
def problem() -> Problem:
    return build_drive_problem("circles", {})


def test_two_values_are_correlated_by_their_curvature_whatever_their_units(problem: Problem) -> None:
    """The inverse of [[a, c], [c, b]] has the correlation -c / sqrt(a b)."""
    model = [build_hypothesis(problem, name) for name in ("understeer", "steering_offset")]
    found = compute_value_correlations(problem, build_fit(model, [1.0, 0.5], np.array([[4.0, 3.0], [3.0, 9.0]])))
    assert found is not None
    assert found.names == (("understeer", "deg_per_mps2"), ("steering_offset", "angle_deg"))
    np.testing.assert_allclose(found.matrix, [[1.0, -0.5], [-0.5, 1.0]], atol=1e-9)


def test_a_limit_falls_where_its_inverse_rises(problem: Problem) -> None:
    model = [build_hypothesis(problem, name) for name in ("side_slip", "understeer")]
    found = compute_value_correlations(problem, build_fit(model, [10.0, 1.0], np.array([[4.0, 3.0], [3.0, 9.0]])))
    assert found is not None and found.names[0] == ("side_slip", "limit_g")
    assert found.matrix[0, 1] == pytest.approx(0.5)


def test_nuisances_are_free_and_not_listed(problem: Problem) -> None:
    """Both values are alike only in what belongs to the nuisance: they are independent given it, and it is open."""
    nuisance = list_nuisances(problem.data)[0]
    model = [nuisance, *(build_hypothesis(problem, name) for name in ("understeer", "steering_offset"))]
    curvature = np.array([[3.0, 1.0, 1.0], [1.0, 2.0, 0.0], [1.0, 0.0, 2.0]])
    found = compute_value_correlations(problem, build_fit(model, [0.1, 1.0, 0.5], curvature))
    covariance = np.linalg.inv(curvature)[1:, 1:]
    assert found is not None and found.matrix.shape == (2, 2)
    assert found.matrix[0, 1] == pytest.approx(covariance[0, 1] / covariance[0, 0]) and found.matrix[0, 1] > 0.1


def test_laws_are_named_and_a_circle_has_only_a_size(problem: Problem) -> None:
    law = build_scope(build_hypothesis(problem, "steering_offset"), "by_speed")
    patch = build_patch((3.0, 4.0, 8.0))
    found = compute_value_correlations(problem, build_fit([law, patch], [0.5, 0.2], np.diag([2.0, 3.0])))
    assert found is not None
    assert found.names == (("steering_offset:by_speed", "angle_deg"), ("grip_patch", "ratio"))
    values = compute_values(patch, np.array([0.2]), problem.data, problem.rig.tractor)
    assert values == {"ratio": pytest.approx(1.2), "east_m": 3.0, "north_m": 4.0, "radius_m": 8.0}


def test_one_value_alone_has_no_correlation(problem: Problem) -> None:
    nuisances = list_nuisances(problem.data)
    model = [*nuisances, build_hypothesis(problem, "understeer")]
    assert compute_value_correlations(problem, build_fit(model, [0.0] * len(model), np.eye(len(model)))) is None
    assert (
        compute_value_correlations(problem, build_fit(nuisances, [0.0] * len(nuisances), np.eye(len(nuisances))))
        is None
    )
