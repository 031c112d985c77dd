"""The open-loop error as one vector: its units, its windows, and fits that lower it."""

from collections.abc import Mapping

import numpy as np
import pytest

from tests.measured.benches import commanded, eg105, knobs
from vehicle.measured.fit.knobs import rest_knobs
from vehicle.measured.fit.openloop import (
    KINDS,
    OpenLoop,
    Term,
    fitted,
    held_out_loss,
    moved,
    pieces_of,
    settings_in,
    slope_of_new,
    to_neutral,
)
from vehicle.measured.fit.solver import FIRST_STEP


@pytest.fixture(scope="module")
def loop() -> OpenLoop:
    return OpenLoop(commanded("circles", {"steering_offset": {"angle_deg": 1.0}}))


def offset(at: float, runs: frozenset[int] | None = None) -> Term:
    return Term(knobs("steering_offset"), np.array([at]), runs)


def test_without_terms_the_loss_is_one_and_every_kind_and_horizon_has_its_share(loop: OpenLoop) -> None:
    errors = loop.errors(())
    assert float(errors @ errors) == pytest.approx(1.0)
    first = loop.bench.course.stretches[0].rows
    by_kind = [0.0] * (2 * KINDS)
    done = 0
    for stretch in loop.bench.course.stretches:
        mine = errors[done : done + 2 * KINDS * stretch.rows].reshape(2, stretch.rows, KINDS)
        for horizon in range(2):
            for kind in range(KINDS):
                by_kind[horizon * KINDS + kind] += float(np.sum(mine[horizon, :, kind] ** 2))
        done += 2 * KINDS * stretch.rows
    assert by_kind == pytest.approx([1.0 / 6.0] * 6) and first == 200
    assert loop.by_run(errors).sum() == pytest.approx(1.0) and loop.run_count == 2


def test_errors_of_many_terms_are_those_of_each(loop: OpenLoop) -> None:
    """Bit for bit, in their order, also where a run has settings of its own."""
    each = [(), (offset(1.0),), (offset(0.5, frozenset({1})),), (Term(knobs("wheel_slip"), np.array([0.1])),)]
    alone = [OpenLoop(loop.bench).errors(terms) for terms in each]
    assert all(map(np.array_equal, loop.errors_of_each(each), alone))
    assert len(list(loop.errors_of_each(each))) == 4 and not np.array_equal(alone[0], alone[2])


def test_windows_of_twenty_seconds_take_turns(loop: OpenLoop) -> None:
    runs, halves = loop.places
    assert runs.tolist() == [0, 1] and halves.tolist() == [0, 0]
    assert np.unique(loop.windows[loop.runs == 1]).tolist() == [1]


def test_the_hidden_effect_is_fitted_to_its_value(loop: OpenLoop) -> None:
    model = fitted(loop, (offset(0.0),))
    assert model.terms[0].value["angle_deg"] == pytest.approx(1.0, abs=1e-3) and model.loss < 1e-5
    assert model.ids == {"steering_offset"}
    assert held_out_loss(loop, model) == pytest.approx(model.loss, abs=1e-5)
    whole = pieces_of(loop, model)
    assert whole.squares.sum(axis=0) == pytest.approx(model.slope.T @ model.slope)
    assert whole.sides.sum(axis=0) == pytest.approx(model.slope.T @ model.errors)
    nothing = fitted(loop, ())
    assert nothing.loss == pytest.approx(1.0) and nothing.slope.shape == (len(loop.runs), 0)


def test_the_slope_of_new_terms_is_that_of_a_first_step(loop: OpenLoop) -> None:
    draft = Term(knobs("implement_side_draft"), np.zeros(1))
    errors = loop.errors((offset(0.0), draft))
    columns = slope_of_new(loop, (offset(0.0), draft), errors, 1)
    size = FIRST_STEP * 0.006
    aside = loop.errors((offset(0.0), Term(draft.knobs, np.array([size]))))
    assert columns == pytest.approx(((aside - errors) / size)[:, None])


def test_settings_of_a_run_are_those_of_its_terms_with_one_rest() -> None:
    by_speed, by_square = rest_knobs()[0][0], rest_knobs()[1][0]
    terms = (offset(1.0, frozenset({0})), offset(-2.0, frozenset({1})), Term(by_speed, np.array([0.5])),
             Term(by_square, np.array([0.25])))  # fmt: skip
    rest: Mapping[str, float] = {"angle_by_speed": 0.5, "angle_by_square": 0.25}
    assert settings_in(terms, 0) == {"steering_offset": {"angle_deg": 1.0}, "rest": rest}
    assert settings_in(terms, 1) == {"steering_offset": {"angle_deg": -2.0}, "rest": rest}


def test_terms_move_inside_what_a_tractor_can_have_and_back_to_neutral() -> None:
    lag = Term(knobs("steering_lag"), np.array([0.3]))
    both = (offset(1.0), lag)
    assert [term.at.tolist() for term in moved(both, np.array([9.0, -9.0]))] == [[8.0], [0.02]]
    assert to_neutral(both) == pytest.approx([-1.0, eg105().steering.lag_s - 0.3]) and to_neutral(()).shape == (0,)
