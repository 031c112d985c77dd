"""Two levels of an effect of the ground: told by hand-made losses."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model, get_parameters
from vehicle.identification.fit.open_loop import ModelTerm, OpenLoopModel
from vehicle.identification.model_extension.term_proposals import (
    assign_clear_level_runs,
    fit_two_effect_levels,
    select_level,
    select_main_terms,
    sum_driving_time,
)

STARTS = [np.array([0.0]), np.array([4.0]), np.array([12.0])]


def slide(at: float, runs: frozenset[int] | None = None) -> ModelTerm:
    return ModelTerm(get_parameters("side_slip"), np.array([at]), runs)


def test_runs_that_suit_two_starts_are_two_grounds() -> None:
    losses = np.array([[9.0, 9.0, 9.0, 9.0], [1.0, 1.0, 5.0, 5.0], [5.0, 5.0, 1.0, 1.0]])
    dry, wet = fit_two_effect_levels(get_parameters("side_slip"), STARTS, losses)
    assert (dry.coordinates.tolist(), dry.runs) == ([4.0], {0, 1}) and (wet.coordinates.tolist(), wet.runs) == (
        [12.0],
        {2, 3},
    )


@pytest.mark.parametrize(
    "losses",
    [
        [[1.0, 1.0, 5.0, 5.0], [1.05, 1.05, 1.0, 1.0]],  # the second alone leaves 4.1, both 4.0: no tenth less
        [[1.0, 1.0, 1.0, 9.0], [2.0, 2.0, 2.0, 1.0]],  # one odd run is no ground
    ],
)
def test_one_level_is_kept_without_a_clear_gain_or_enough_runs(losses: list[list[float]]) -> None:
    assert fit_two_effect_levels(get_parameters("side_slip"), STARTS[:2], np.array(losses)) == ()


def test_levels_of_terms() -> None:
    offset = ModelTerm(get_parameters("steering_offset"), np.array([1.0]))
    terms = (slide(4.0, frozenset({0, 1})), offset, slide(12.0, frozenset({2})))
    assert [(one.parameters.id, one.coordinates.tolist(), one.runs) for one in select_level(terms, 1)] == [
        ("side_slip", [12.0], None), ("steering_offset", [1.0], None)
    ]  # fmt: skip
    assert [one.coordinates.tolist() for one in select_level(terms, 0)] == [[4.0], [1.0]]


def test_the_level_of_the_longer_driving_is_the_main_one() -> None:
    terms = (slide(4.0, frozenset({0, 1})), slide(12.0, frozenset({2})))
    assert [one.coordinates.tolist() for one in select_main_terms(terms, np.array([10.0, 10.0, 50.0]))] == [[12.0]]
    assert [one.coordinates.tolist() for one in select_main_terms(terms, np.array([30.0, 30.0, 50.0]))] == [[4.0]]


def test_driving_time_is_that_of_the_segments() -> None:
    assert sum_driving_time(build_programme_model("there-and-back", {}).dataset) == pytest.approx([19.9, 19.9])


def test_a_run_is_clearly_of_a_level_when_the_other_one_is_five_percent_worse() -> None:
    terms = (slide(4.0, frozenset({0, 1})), slide(12.0, frozenset({2, 3})))
    by_level = {4.0: np.array([1.0, 1.0, 2.0, 1.04]), 12.0: np.array([2.0, 1.04, 1.0, 1.0])}
    loop = SimpleNamespace(
        compute_errors=lambda chosen: by_level[float(chosen[0].coordinates[0])], sum_by_run=lambda errors: errors
    )
    model = OpenLoopModel(terms, np.zeros(0), np.zeros((0, 0)))
    assert [(float(term.coordinates[0]), runs) for term, runs in assign_clear_level_runs(loop, model)] == [
        (4.0, (0,)),
        (12.0, (2,)),
    ]
