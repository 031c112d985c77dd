"""What is foreseen of a trial is what the trial gains, where lines are straight; and nothing is refused by it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.residual_models import (
    LinearResidualModel,
    build_linear_model,
    build_programme_model,
    eg105,
    get_parameters,
)
from vehicle.identification.cause_selection.candidate_fit import (
    CandidateFit,
    Projector,
    compute_needed_gain,
    fit_candidate,
)
from vehicle.identification.cause_selection.refit import refit_with_new_weights
from vehicle.identification.cause_selection.scan_cache import (
    GainPredictor,
    MotionsByEffect,
    TrialMotions,
    drop_old_motions,
)
from vehicle.identification.cause_selection.selection import finish_candidates, scan_candidates
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit
from vehicle.identification.residuals.innovations import PoseIncrements
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import OLDEST_SCANS, PREDICTED_SHARE

Settings = Mapping[str, Mapping[str, float]]


@dataclass(eq=False)
class LinearPath(LinearResidualModel):
    """Its columns are motions of the path, weighed row by row."""

    weights: np.ndarray = field(default_factory=lambda: np.ones(120))

    @property
    def dataset(self) -> Any:
        segments = [SimpleNamespace(wheel=np.zeros(1))]
        return SimpleNamespace(names=("run",), rows=len(self.base) // 5, effect_places={}, segments=segments)

    @property
    def path_rows(self) -> slice:
        return slice(0, 3 * self.dataset.rows)

    def simulate_increments(self, settings: Settings) -> list[PoseIncrements]:
        moved = LinearResidualModel.compute_residuals(self, settings)[self.path_rows] - self.base[self.path_rows]
        return [PoseIncrements(np.zeros_like(moved), np.zeros_like(moved), moved)]

    def compute_path_residuals(self, moves: list[PoseIncrements], settings: Settings) -> np.ndarray:
        out: np.ndarray = self.weights[self.path_rows] * (self.base[self.path_rows] + moves[0].turned)
        return out

    def compute_residuals(self, settings: Settings) -> np.ndarray:
        return self.weights * super().compute_residuals(settings)


@pytest.fixture
def residual_model() -> Any:
    made = build_linear_model(steering_offset=1.0, heading_bias=-2.0, grip_drift=0.5)
    in_path = np.arange(120) < 72
    return LinearPath(made.base, {name: one * in_path for name, one in made.columns.items()})


def foresight(residual_model: Any, fit: EffectFit) -> GainPredictor:
    project = Projector(fit.jacobian)
    return GainPredictor(residual_model, fit, project, project(fit.residuals))


def trials(residual_model: Any, ahead: GainPredictor, *names: str) -> dict[str, CandidateFit]:
    return {
        name: fit_candidate(residual_model.compute_changes, ahead.fit, get_parameters(name), ahead.projector)
        for name in names
    }


def moved(ahead: GainPredictor, some: dict[str, CandidateFit]) -> dict[str, TrialMotions]:
    return {name: motions for one in some.values() for name, motions in ahead.collect_motions(one).items()}


def test_what_is_foreseen_beside_another_fit_with_other_weights_is_what_a_trial_gains_there(
    residual_model: Any,
) -> None:
    first = foresight(residual_model, residual_model.fit())
    seen = moved(first, trials(residual_model, first, "heading_bias", "grip_drift"))
    weights = np.random.default_rng(3).uniform(0.3, 3.0, 120)
    other: Any = LinearPath(residual_model.base, residual_model.columns, weights=weights)
    ahead = foresight(
        other,
        refine_fit(other, EffectFit(other.fit("steering_offset").parts, other.compute_residuals({}), np.zeros(0))),
    )
    promises = ahead.predict_gains(seen, seen)
    fresh = trials(other, ahead, *seen)
    for name, promise in promises.items():
        assert promise.best_gain == pytest.approx(fresh[name].gain, rel=1e-4) and fresh[name].gain > 10.0
        asked = len(other.requests)
        worth = promise.best_gain / PREDICTED_SHARE / compute_needed_gain(1e6) * 1e6
        assert ahead.build_hopeless_candidate(promise, 0.99 * worth) is None
        begun = ahead.build_hopeless_candidate(promise, 1.01 * worth)
        assert begun is not None and not begun.is_finished and len(other.requests) == asked, "without a simulation"
        assert begun.columns == pytest.approx(fresh[name].columns, abs=1e-4 * np.abs(fresh[name].columns).max())


def test_motions_are_forgotten_after_some_scans_and_those_of_a_fresh_trial_are_new(residual_model: Any) -> None:
    ahead = foresight(residual_model, residual_model.fit())
    seen: MotionsByEffect = moved(ahead, trials(residual_model, ahead, "heading_bias", "grip_drift"))
    for _ in range(OLDEST_SCANS - 1):
        seen = drop_old_motions(seen) | moved(ahead, trials(residual_model, ahead, "grip_drift"))
        assert set(seen) == {"heading_bias", "grip_drift"}
    assert set(drop_old_motions(seen)) == {"grip_drift"}


@pytest.fixture(scope="module")
def circles() -> ResidualModel:
    residual_model = build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})
    return replace(residual_model, dataset=replace(residual_model.dataset, segments=tuple(
        replace(one, wheel=None) for one in residual_model.dataset.segments
    )))  # fmt: skip


def test_what_is_foreseen_as_hopeless_is_tried_before_it_is_said_that_nothing_is_left(circles: ResidualModel) -> None:
    beside = (get_parameters("heading_bias"), np.array([0.0]))
    before = scan_candidates(circles, refit_with_new_weights(circles, (beside,), None), eg105(), set())
    fit = refit_with_new_weights(circles, (beside, (get_parameters("steering_offset"), np.array([0.99]))), None)
    after = scan_candidates(circles, fit, eg105(), set(), previous=before)
    untried = [one for one in after.candidates if one.predicted_gain is not None]
    assert untried and not any(one.is_finished for one in untried)
    whole = {one.parameters.id: one for one in finish_candidates(circles, after, after.candidates)}
    for one in untried:
        alone = fit_candidate(circles.compute_changes, fit, one.parameters, after.projector)
        assert alone.gain < compute_needed_gain(0.0), "rightly"
        assert whole[one.parameters.id].is_finished and whole[one.parameters.id].gain == alone.gain


def test_beside_a_clear_one_only_what_may_go_before_it_is_tried(circles: ResidualModel) -> None:
    fit = refit_with_new_weights(circles, ((get_parameters("antenna_right"), np.array([0.0])),), None)
    after = scan_candidates(circles, fit, eg105(), set(), previous=scan_candidates(circles, fit, eg105(), set()))
    begun = [one for one in after.candidates if not one.is_finished]
    clear = after.candidates[0]
    same = finish_candidates(circles, after, after.candidates, clear)
    assert begun and all(one in same for one in begun if one.predicted_gain is not None)
    whole = finish_candidates(circles, after, same)
    assert all(one.is_finished for one in whole) and whole[0] is clear
