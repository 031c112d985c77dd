"""A run's own difference: the value that was put in, its standard error by hand, and halves that must agree."""

import numpy as np
import pytest

from vehicle.identification.faults.run_regression import (
    FEWEST_ROWS,
    RunRegression,
    estimate_noise,
    estimate_own,
    is_shown_in_halves,
    thin_rows,
)
from vehicle.identification.faults.steering_evidence import STEP_S

RUNS, ROWS, SIGMA = 4, 200, 0.05


def build_regression(own: float, last_half_only: bool = False) -> RunRegression:
    """Values 0.3 x + noise, and `own` more on run 2."""
    random = np.random.default_rng(7)
    runs = np.repeat(np.arange(RUNS), ROWS)
    x = random.normal(size=runs.size)
    is_own = (runs == 2) & ((np.arange(runs.size) % ROWS >= ROWS // 2) | (not last_half_only))
    values = 0.3 * x + own * is_own + random.normal(0.0, SIGMA, runs.size)
    return RunRegression(values, runs, x[:, None], np.array([10.0]), np.ones((runs.size, 1)))


def test_the_noise_is_that_of_the_rows_and_a_run_unlike_the_others_is_none() -> None:
    for own in (0.0, 0.3):
        sigma, weights = estimate_noise(build_regression(own))
        assert sigma == pytest.approx(SIGMA, rel=0.15) and np.count_nonzero(weights == 0.0) == 0


def test_what_a_run_has_of_its_own_comes_back_with_the_error_of_a_mean() -> None:
    regression = build_regression(0.2)
    estimate = estimate_own(regression, regression.runs == 2, 0, SIGMA, np.ones(regression.runs.size))
    assert estimate is not None
    assert estimate[1] == pytest.approx(SIGMA / np.sqrt(ROWS), rel=0.02)
    assert abs(estimate[0] - 0.2) < 3.0 * estimate[1]


def test_too_few_rows_say_nothing() -> None:
    regression = build_regression(0.2)
    part = np.arange(regression.runs.size) < 2 * ROWS + FEWEST_ROWS - 1
    assert estimate_own(regression, regression.runs == 2, 0, SIGMA, np.ones(part.size), part) is None


def test_a_difference_of_one_half_is_not_shown_in_both() -> None:
    for last_half_only, shown in ((False, True), (True, False)):
        regression = build_regression(0.2, last_half_only)
        weights = np.ones(regression.runs.size)
        own = estimate_own(regression, regression.runs == 2, 0, SIGMA, weights)
        assert own is not None
        assert is_shown_in_halves(regression, 2, 0, own[0], SIGMA, weights) is shown


def test_of_each_span_the_first_chosen_row_stays() -> None:
    apart = round(1.0 / STEP_S)
    chosen = np.zeros(3 * apart, dtype=bool)
    chosen[[1, 2, apart + 3, 3 * apart - 1]] = True
    assert thin_rows(chosen, 1.0).tolist() == [1, apart + 3, 3 * apart - 1]
    assert thin_rows(np.zeros(5, dtype=bool)).size == 0
