"""The open-loop error as one vector: its units, its windows, and fits that lower it."""

from collections.abc import Mapping

import numpy as np
import pytest

from tests.identification.residual_models import build_commanded_model, eg105, get_parameters
from vehicle.identification.fit.effect_parameters import build_discrepancy_parameters
from vehicle.identification.fit.open_loop import (
    ERROR_KINDS,
    ModelTerm,
    OpenLoopErrors,
    build_normal_equations,
    collect_run_settings,
    compute_new_terms_jacobian,
    compute_steps_to_neutral,
    estimate_held_out_loss,
    fit_terms,
    shift_term_coordinates,
)
from vehicle.identification.fit.solver import FIRST_STEP


@pytest.fixture(scope="module")
def loop() -> OpenLoopErrors:
    return OpenLoopErrors(build_commanded_model("circles", {"steering_offset": {"angle_deg": 1.0}}))


def offset(at: float, runs: frozenset[int] | None = None) -> ModelTerm:
    return ModelTerm(get_parameters("steering_offset"), np.array([at]), runs)


def test_without_terms_the_loss_is_one_and_every_kind_and_horizon_has_its_share(loop: OpenLoopErrors) -> None:
    errors = loop.compute_errors(())
    assert float(errors @ errors) == pytest.approx(1.0)
    first = loop.residual_model.dataset.segments[0].rows
    by_kind = [0.0] * (2 * ERROR_KINDS)
    done = 0
    for segment in loop.residual_model.dataset.segments:
        mine = errors[done : done + 2 * ERROR_KINDS * segment.rows].reshape(2, segment.rows, ERROR_KINDS)
        for horizon in range(2):
            for kind in range(ERROR_KINDS):
                by_kind[horizon * ERROR_KINDS + kind] += float(np.sum(mine[horizon, :, kind] ** 2))
        done += 2 * ERROR_KINDS * segment.rows
    assert by_kind == pytest.approx([1.0 / 6.0] * 6) and first == 200
    assert loop.sum_by_run(errors).sum() == pytest.approx(1.0) and loop.run_count == 2


def test_errors_of_many_terms_are_those_of_each(loop: OpenLoopErrors) -> None:
    """Bit for bit, in their order, also where a run has settings of its own."""
    each = [
        (),
        (offset(1.0),),
        (offset(0.5, frozenset({1})),),
        (ModelTerm(get_parameters("wheel_slip"), np.array([0.1])),),
    ]
    alone = [OpenLoopErrors(loop.residual_model).compute_errors(terms) for terms in each]
    assert all(map(np.array_equal, loop.compute_errors_per_term_list(each), alone))
    assert len(list(loop.compute_errors_per_term_list(each))) == 4 and not np.array_equal(alone[0], alone[2])


def test_windows_of_twenty_seconds_take_turns(loop: OpenLoopErrors) -> None:
    runs, halves = loop.window_runs_and_halves
    assert runs.tolist() == [0, 1] and halves.tolist() == [0, 0]
    assert np.unique(loop.window_numbers[loop.run_numbers == 1]).tolist() == [1]


def test_the_hidden_effect_is_fitted_to_its_value(loop: OpenLoopErrors) -> None:
    model = fit_terms(loop, (offset(0.0),))
    assert model.terms[0].value["angle_deg"] == pytest.approx(1.0, abs=1e-3) and model.loss < 1e-5
    assert model.term_ids == {"steering_offset"}
    assert estimate_held_out_loss(loop, model) == pytest.approx(model.loss, abs=1e-5)
    whole = build_normal_equations(loop, model)
    assert whole.squares.sum(axis=0) == pytest.approx(model.jacobian.T @ model.jacobian)
    assert whole.sides.sum(axis=0) == pytest.approx(model.jacobian.T @ model.errors)
    nothing = fit_terms(loop, ())
    assert nothing.loss == pytest.approx(1.0) and nothing.jacobian.shape == (len(loop.run_numbers), 0)


def test_the_slope_of_new_terms_is_that_of_a_first_step(loop: OpenLoopErrors) -> None:
    draft = ModelTerm(get_parameters("implement_side_draft"), np.zeros(1))
    errors = loop.compute_errors((offset(0.0), draft))
    columns = compute_new_terms_jacobian(loop, (offset(0.0), draft), errors, 1)
    size = FIRST_STEP * 0.006
    aside = loop.compute_errors((offset(0.0), ModelTerm(draft.parameters, np.array([size]))))
    assert columns == pytest.approx(((aside - errors) / size)[:, None])


def test_settings_of_a_run_are_those_of_its_terms_with_one_rest() -> None:
    by_speed, by_square = build_discrepancy_parameters()[0][0], build_discrepancy_parameters()[1][0]
    terms = (offset(1.0, frozenset({0})), offset(-2.0, frozenset({1})), ModelTerm(by_speed, np.array([0.5])),
             ModelTerm(by_square, np.array([0.25])))  # fmt: skip
    rest: Mapping[str, float] = {"angle_by_speed": 0.5, "angle_by_square": 0.25}
    assert collect_run_settings(terms, 0) == {"steering_offset": {"angle_deg": 1.0}, "discrepancy_model": rest}
    assert collect_run_settings(terms, 1) == {"steering_offset": {"angle_deg": -2.0}, "discrepancy_model": rest}


def test_terms_move_inside_what_a_tractor_can_have_and_back_to_neutral() -> None:
    lag = ModelTerm(get_parameters("steering_lag"), np.array([0.3]))
    both = (offset(1.0), lag)
    assert [term.coordinates.tolist() for term in shift_term_coordinates(both, np.array([9.0, -9.0]))] == [
        [8.0],
        [0.02],
    ]
    assert compute_steps_to_neutral(both) == pytest.approx(
        [-1.0, eg105().steering.lag_s - 0.3]
    ) and compute_steps_to_neutral(()).shape == (0,)
