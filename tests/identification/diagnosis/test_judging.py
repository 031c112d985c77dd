"""Effects and their laws: which of them stays in the model, and what the constant of one says beside a law."""

import numpy as np
import pytest

from tests.identification.diagnosis.problems import build_drive_problem, build_fit, build_hypothesis
from vehicle.identification.diagnosis.grammar import build_scope
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.search import PredictiveComparison, takes_over
from vehicle.identification.diagnosis.verdicts import centre_laws


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
