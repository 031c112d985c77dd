"""Effects and their laws: which of them stays in the model, and what the constant of one says beside a law."""

import numpy as np
import pytest

from tests.identification.diagnosis.problems import (
    build_drive_problem,
    build_empty_fit,
    build_fit,
    build_hypothesis,
    build_problem,
)
from vehicle.identification.diagnosis.grammar import build_scope, list_nuisances
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.search import PredictiveComparison, build_patch, takes_over
from vehicle.identification.diagnosis.verdicts import (
    centre_laws,
    compute_value_correlations,
    compute_values,
    find_smallest_visible,
)

# --- Correlations of fitted values: closed forms from the curvature of the cost ---


@pytest.fixture(scope="module")
def problem() -> Problem:
    return build_drive_problem("circles", {})


def test_a_constant_has_what_a_law_adds_on_average(problem: Problem) -> None:
    """Slip that changes with speed: no file holds the law, so the constant is the slip at the mean speed."""
    slip = build_hypothesis(problem, "wheel_slip")
    law = build_scope(slip, "by_speed")
    fit = build_fit((slip, law), [0.3, -0.1], np.eye(2))
    mean = float(np.mean(problem.bases.get("by_speed")))
    assert centre_laws(problem, fit) @ fit.amounts == pytest.approx([0.3 - 0.1 * mean, -0.1])


def test_values_of_runs_are_about_their_mean_and_a_law_of_the_file_stays(problem: Problem) -> None:
    offset = build_hypothesis(problem, "steering_offset")
    runs = build_scope(offset, "by_run", ["by_run:0", "by_run:1"])
    fit = build_fit((offset, runs), [1.0, 0.2, 0.6], np.eye(3))
    assert centre_laws(problem, fit) @ fit.amounts == pytest.approx([1.4, -0.2, 0.2])
    held = build_fit((offset, build_scope(offset, "by_speed")), [1.0, 0.5], np.eye(2))
    assert centre_laws(problem, held) @ held.amounts == pytest.approx([1.0, 0.5])


@pytest.mark.parametrize(("nats", "z", "takes"), [(-9.0, -1.5, False), (-9.0, -2.5, True), (-1.0, -2.5, False)])
def test_a_law_takes_the_place_of_its_constant_only_where_it_predicts_clearly_more(
    problem: Problem, nats: float, z: float, takes: bool
) -> None:
    slip = build_hypothesis(problem, "wheel_slip")
    law = build_scope(slip, "by_speed")
    assert takes_over(PredictiveComparison(law, nats, z), law, slip) is takes
    # The other way round the constant comes back unless the law has kept its lead.
    assert takes_over(PredictiveComparison(slip, -nats, -z), slip, law) is not takes


def test_another_effect_takes_the_place_by_what_is_more_probable(problem: Problem) -> None:
    slip, gain = build_hypothesis(problem, "wheel_slip"), build_hypothesis(problem, "steering_gain")
    assert takes_over(PredictiveComparison(gain, -3.0, -0.5), gain, slip) and not takes_over(
        PredictiveComparison(gain, -1.0, -5.0), gain, slip
    )


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
    values = compute_values(problem, patch, np.array([0.2]))
    assert values == {"ratio": pytest.approx(1.2), "east_m": 3.0, "north_m": 4.0, "radius_m": 8.0}


def test_one_value_alone_has_no_correlation(problem: Problem) -> None:
    nuisances = list_nuisances(problem.data)
    model = [*nuisances, build_hypothesis(problem, "understeer")]
    assert compute_value_correlations(problem, build_fit(model, [0.0] * len(model), np.eye(len(model)))) is None
    assert (
        compute_value_correlations(problem, build_fit(nuisances, [0.0] * len(nuisances), np.eye(len(nuisances))))
        is None
    )


def test_a_place_would_have_shown_only_if_the_tractor_turned_wherever_it_drove() -> None:
    bends, lines = build_drive_problem("shuffled-bends", {}), build_problem()
    assert find_smallest_visible(bends, build_empty_fit(bends))["grip_patch"] == pytest.approx(0.11, abs=0.03)
    assert "grip_patch" not in find_smallest_visible(lines, build_empty_fit(lines))
