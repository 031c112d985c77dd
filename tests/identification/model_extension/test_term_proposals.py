"""What could lower the error further, on an open-loop error that is linear in two effects and curved in none."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest

from tests.identification.residual_models import eg105, get_parameters
from vehicle.identification.fit.open_loop import ModelTerm, OpenLoopModel, estimate_held_out_loss, fit_terms
from vehicle.identification.model_extension.term_proposals import (
    get_term_group_name,
    propose_terms,
    simulate_best_proposal_pair,
    simulate_proposals,
)
from vehicle.identification.model_extension.term_search import (
    OpenLoopFit,
    find_irreplaceable,
    is_beyond_tolerance,
    search_terms,
)
from vehicle.identification.thresholds import WORTH_SHARE

ROWS, RUNS = 240, 4


class LinearLoop:
    """Errors `base + sum(columns[id] * deviation)`; effects without a column change nothing."""

    def __init__(self, hidden: dict[str, float], noise: float = 0.02) -> None:
        rng = np.random.default_rng(4)
        self.columns = {name: rng.standard_normal(ROWS) for name in ("steering_offset", "implement_side_draft")}
        # A draft that undoes most of an offset: each alone explains little of the two together.
        own = self.columns["implement_side_draft"]
        self.columns["implement_side_draft"] = (self.columns["steering_offset"] + 0.4 * own) / 0.006
        base = -sum(self.columns[name] * value for name, value in hidden.items()) + noise * rng.standard_normal(ROWS)
        self.base = base / np.sqrt(float(base @ base))
        self.columns = {name: one / np.sqrt(float(base @ base)) for name, one in self.columns.items()}
        tractor = eg105()
        dataset = SimpleNamespace(effect_places={})
        self.residual_model = SimpleNamespace(
            rig=SimpleNamespace(tractor=tractor), dataset=dataset, row_interval_s=0.1, get_interval_s=lambda _: 0.1
        )
        self.run_numbers = np.arange(ROWS) * RUNS // ROWS
        self.fixed_terms: tuple[ModelTerm, ...] = ()

    def compute_errors(self, terms: Sequence[ModelTerm]) -> np.ndarray:
        out = self.base.copy()
        for term in (*self.fixed_terms, *terms):
            if term.parameters.id in self.columns:
                out = out + self.columns[term.parameters.id] * term.parameters.compute_deviation(
                    term.coordinates
                ) * np.sign(term.coordinates[0])
        return out

    def compute_errors_per_term_list(self, each: Sequence[Sequence[ModelTerm]]) -> Iterator[np.ndarray]:
        return map(self.compute_errors, each)

    def sum_by_run(self, errors: np.ndarray) -> np.ndarray:
        return np.bincount(self.run_numbers, errors * errors, RUNS)

    @cached_property
    def window_numbers(self) -> np.ndarray:
        return np.arange(ROWS) * 2 * RUNS // ROWS

    @property
    def window_runs_and_halves(self) -> tuple[np.ndarray, np.ndarray]:
        return np.arange(2 * RUNS) // 2, np.arange(2 * RUNS) % 2


def nothing() -> None:
    """A step of progress."""


def test_an_effect_and_both_components_of_a_rest_enter_as_one() -> None:
    assert get_term_group_name("push_to_east") == get_term_group_name("push_to_north") == "push"
    assert (
        get_term_group_name("steering_offset") == "steering_offset"
        and get_term_group_name("grip_by_speed") == "grip_by_speed"
    )


def test_a_proposal_promises_what_least_squares_leaves() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    made = propose_terms(loop, fit_terms(loop, ()), eg105(), nothing)
    best = min(made, key=lambda one: one.loss)
    assert best.new_terms[0].parameters.id == "steering_offset" and best.is_starting_at_neutral
    column = loop.columns["steering_offset"]
    assert best.loss == pytest.approx(1.0 - float(column @ loop.base) ** 2 / float(column @ column), rel=1e-4)
    assert best.change == pytest.approx([-float(column @ loop.base) / float(column @ column)], rel=1e-4)
    assert all(
        "grip_patch" != one.new_terms[0].parameters.id != "grip_drift" for one in made
    )  # they would stand in for anything
    assert any(one.new_terms[0].parameters.id == "push_to_east" and len(one.new_terms) == 2 for one in made)


def test_proposals_are_simulated_and_the_best_comes_first() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    model = fit_terms(loop, ())
    made = propose_terms(loop, model, eg105(), nothing)
    (terms, loss), (_, next_loss), *_ = simulate_proposals(loop, model, made)
    assert terms[0].parameters.id == "steering_offset" and loss < 0.01 < next_loss
    assert terms[0].coordinates == pytest.approx([1.0], abs=0.01)


def test_causes_that_mask_each_other_are_seen_as_a_pair() -> None:
    loop = LinearLoop({"steering_offset": 1.0, "implement_side_draft": -0.006})
    model = fit_terms(loop, ())
    made = propose_terms(loop, model, eg105(), nothing)
    ((terms, loss),) = simulate_best_proposal_pair(loop, model, made)
    assert {term.parameters.id for term in terms} == {"steering_offset", "implement_side_draft"} and loss < 0.1
    assert simulate_best_proposal_pair(loop, model, made[:1]) == []


def test_terms_enter_while_they_are_worth_it_and_stay_no_longer() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    made = search(loop, ())
    assert made.model.term_ids == {"steering_offset"}
    assert made.model.loss < 1.0 - WORTH_SHARE
    # Beside what was settled elsewhere only the rest of it enters, and as another effect it does not.
    assert search(loop, (ModelTerm(get_parameters("steering_offset"), np.array([1.0])),)).model.term_ids == frozenset()


def search(loop: LinearLoop, settled: tuple[ModelTerm, ...]) -> OpenLoopFit:
    loop.fixed_terms = settled
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vehicle.identification.model_extension.term_search.OpenLoopErrors", lambda *given: loop)
        return search_terms(loop.residual_model, eg105(), settled, nothing)


def test_a_name_where_nothing_else_comes_near() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    model = fit_terms(loop, (ModelTerm(get_parameters("steering_offset"), np.array([0.0])),))
    assert find_irreplaceable(OpenLoopFit(loop, model), eg105(), 0.0, nothing) == ["steering_offset"]
    # A twin that explains as much takes the name away.
    twin = LinearLoop({"steering_offset": 1.0})
    twin.columns["heading_bias"] = twin.columns["steering_offset"]
    assert find_irreplaceable(OpenLoopFit(twin, fit_terms(twin, model.terms)), eg105(), 0.0, nothing) == []
    # So does noise that leaves as much as there is.
    assert find_irreplaceable(OpenLoopFit(loop, model), eg105(), 1.0, nothing) == []


def test_what_mending_left_out_for_a_look_is_what_a_fit_without_it_leaves() -> None:
    loop = LinearLoop({"steering_offset": 1.0, "implement_side_draft": 0.01})
    made = search(loop, ())
    assert len(made.model.term_ids) > 1 and set(made.smaller_models) == made.model.term_ids
    for name in made.model.term_ids:
        others = tuple(term for term in made.model.terms if term.parameters.id != name)
        alone, fresh = fit_terms(loop, others, 2), replace(made, smaller_models={}).refit_without_term(name)
        assert made.refit_without_term(name) is made.smaller_models[name]
        assert np.array_equal(made.refit_without_term(name).errors, alone.errors) and np.array_equal(
            alone.errors, fresh.errors
        )
        assert np.array_equal(made.refit_without_term(name).jacobian, alone.jacobian)


def test_a_competitor_that_comes_near_before_it_is_fitted_is_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    loop.columns["heading_bias"] = loop.columns["steering_offset"]
    made = search(loop, ())
    monkeypatch.setattr("vehicle.identification.model_extension.term_search.fit_terms", None)
    assert made.model.term_ids and find_irreplaceable(made, eg105(), 0.0, nothing) == []


def test_nothing_is_sought_for_what_others_come_near_without_or_what_does_not_hold(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    made, asked = search(loop, ()), []
    monkeypatch.setattr(
        "vehicle.identification.model_extension.term_search.propose_terms", lambda *given: asked.append(given) or []
    )
    assert find_irreplaceable(made, eg105(), 0.0, nothing) == ["steering_offset"] and len(asked) == 1
    assert find_irreplaceable(made, eg105(), 0.0, nothing, lambda _: False) == []
    # Without the effect the others leave half as much again: clearly more, yet any competitor would be near.
    model = replace(made.model, errors=np.sqrt(0.2 / made.model.loss) * made.model.errors)
    half = replace(model, errors=np.sqrt(1.5) * model.errors)
    assert (
        find_irreplaceable(replace(made, model=model, smaller_models={"steering_offset": half}), eg105(), 0.0, nothing)
        == []
    )
    assert len(asked) == 1


def test_the_tolerance_of_the_file_and_times_of_it() -> None:
    loop = LinearLoop({})
    small = ModelTerm(get_parameters("steering_offset"), np.array([0.2]))  # its tolerance is 0.12
    assert is_beyond_tolerance(loop, small) and not is_beyond_tolerance(loop, small, 2.0)


def test_the_held_out_loss_of_one_coordinate_by_hand() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    model: OpenLoopModel = fit_terms(loop, (ModelTerm(get_parameters("steering_offset"), np.array([0.0])),))
    column, total = loop.columns["steering_offset"], 0.0
    for run in range(RUNS):
        mine, others = loop.run_numbers == run, loop.run_numbers != run
        at = -float(column[others] @ loop.base[others]) / float(column[others] @ column[others])
        total += float(np.sum((loop.base[mine] + column[mine] * at) ** 2))
    assert estimate_held_out_loss(loop, model) == pytest.approx(total, rel=1e-3)
