"""Choosing causes: what the simulator drove is chosen and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.residual_models import (
    build_commanded_model,
    build_linear_model,
    build_programme_model,
    eg105,
    get_parameters,
)
from vehicle.identification.cause_selection import selection
from vehicle.identification.cause_selection.candidate_fit import CandidateFit, Projector, fit_candidate
from vehicle.identification.cause_selection.covariates import CovariateScore, list_covariates
from vehicle.identification.cause_selection.evidence import predict_removal_costs
from vehicle.identification.cause_selection.refit import (
    add_candidate,
    refit_with_new_weights,
    refit_without,
    reweigh_residual_model,
)
from vehicle.identification.cause_selection.scan_cache import ScanCache
from vehicle.identification.cause_selection.selection import (
    _compute_candidate_sort_key,
    _is_clearly_better_covariate,
    finish_candidates,
    prune_fit,
    scan_candidates,
    select_causes,
)
from vehicle.identification.fit.residual_fit import make_empty_fit, refine_fit
from vehicle.identification.residuals.noise_weights import estimate_first_noise
from vehicle.identification.residuals.residual_model import ResidualModel, build_residual_model
from vehicle.identification.thresholds import (
    EASING_FACTOR,
    LEAST_GAIN,
    MOST_EASINGS,
    PATCH_HANDICAP,
    WRONG_EVERYWHERE_LOSS,
)


@pytest.fixture(scope="module")
def residual_model() -> ResidualModel:
    return build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})


def gained(name: str, gain: float) -> CandidateFit:
    return CandidateFit(get_parameters(name), np.zeros(1), gain, np.zeros((1, 1)))


def test_a_circle_must_gain_clearly_more_than_a_plain_effect() -> None:
    as_good = PATCH_HANDICAP * (100.0 + LEAST_GAIN)
    plain = gained("steering_offset", 100.0)
    assert (
        _compute_candidate_sort_key(gained("grip_patch", as_good + 1.0))
        < _compute_candidate_sort_key(plain)
        < _compute_candidate_sort_key(gained("grip_patch", as_good - 1.0))
    )


@pytest.mark.parametrize(("per_run", "enters_at"), [(False, 1100.0), (True, 1350.0)])
def test_a_covariate_that_is_free_in_every_run_must_explain_far_more_than_an_effect(
    residual_model: ResidualModel, per_run: bool, enters_at: float
) -> None:
    """An implement that comes and goes looks like an angle that drifts in every run, with dozens of free amounts."""
    covariate = replace(list_covariates(residual_model)[0], per_run=per_run)
    best = gained("implement_side_draft", 1000.0)
    enters = [
        _is_clearly_better_covariate(residual_model, CovariateScore(covariate, gain, 1), best, LEAST_GAIN)
        for gain in (enters_at - 90.0, enters_at)
    ]
    assert enters == [False, True]


@pytest.mark.slow
def test_the_hidden_effect_is_first_and_alone(residual_model: ResidualModel) -> None:
    chosen = select_causes(residual_model, eg105())
    # The truth's speed is a mean over the last rows: a clock within the tolerance, without a name.
    assert chosen.effect_ids - {"clock_offset_speed"} == {"steering_offset"} and chosen.unnamed == ()
    assert float(chosen.fit.parts[0][1][0]) == pytest.approx(1.0, abs=0.02)
    best = scan_candidates(residual_model, make_empty_fit(residual_model), eg105(), {"steering_offset"}).candidates
    assert all(one.parameters.id != "steering_offset" for one in best)
    assert [one.gain for one in best if one.parameters.id != "grip_patch"] == sorted(
        (one.gain for one in best if one.parameters.id != "grip_patch"), reverse=True
    )


def test_candidates_that_were_only_begun_are_tried_to_their_end_when_asked(residual_model: ResidualModel) -> None:
    fit = make_empty_fit(residual_model)
    # The scan before told that the offset is the best, but of a path that was otherwise.
    before = ScanCache(fit, Projector(fit.jacobian), fit.residuals + 1.0, [gained("steering_offset", 100.0)], [])
    known = scan_candidates(residual_model, fit, eg105(), set(), previous=before)
    found = known.candidates
    assert found[0].parameters.id == "steering_offset" and found[0].is_finished
    assert {one.parameters.id for one in found if not one.is_finished}, (
        "others promise something, far less than the offset gains"
    )
    whole = finish_candidates(residual_model, known, found)
    assert all(one.is_finished for one in whole) and whole[0].parameters.id == "steering_offset"
    gains = {one.parameters.id: one.gain for one in found}
    assert all(one.gain >= gains[one.parameters.id] - 1e-9 for one in whole)
    assert any(one.gain > gains[one.parameters.id] + LEAST_GAIN for one in whole)
    for one in whole:  # what was begun is gone on with, to where a trial of its own comes
        alone = fit_candidate(residual_model.compute_changes, fit, one.parameters, known.projector)
        assert one.gain == alone.gain and np.array_equal(one.coordinates, alone.coordinates)
        assert np.array_equal(one.columns, alone.columns)


def test_a_plain_cause_is_not_fitted_away(residual_model: ResidualModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a straight line promises is what a fit without the part comes to, where it is linear."""
    parts = ((get_parameters("steering_offset"), np.array([1.0])), (get_parameters("heading_bias"), np.array([0.0])))
    fit = refine_fit(residual_model, refit_with_new_weights(residual_model, parts, None))
    costs = predict_removal_costs(fit)
    assert costs["steering_offset"] > LEAST_GAIN > costs["heading_bias"] >= 0.0
    come_back = refit_without(residual_model, fit, "steering_offset").loss - fit.loss
    assert costs["steering_offset"] == pytest.approx(come_back, rel=0.2)
    alone = refit_without(residual_model, fit, "heading_bias")
    monkeypatch.setattr(selection, "PLAINLY_NEEDED_FACTOR", 2.0)
    monkeypatch.setattr(selection, "refit_without", None)
    assert prune_fit(residual_model, alone) is alone, "nothing was fitted"


def test_what_the_others_make_superfluous_is_left_out(residual_model: ResidualModel) -> None:
    parts = ((get_parameters("steering_offset"), np.array([1.0])), (get_parameters("heading_bias"), np.array([0.0])))
    fit = refine_fit(residual_model, refit_with_new_weights(residual_model, parts, None))
    assert [one.id for one, _ in prune_fit(residual_model, fit).parts] == ["steering_offset"]
    rest = refit_without(residual_model, fit, "steering_offset")
    assert [one.id for one, _ in rest.parts] == ["heading_bias"] and rest.loss > fit.loss + LEAST_GAIN


def test_a_part_enters_with_the_coordinates_it_was_tried_at(residual_model: ResidualModel) -> None:
    start = make_empty_fit(residual_model)
    larger = add_candidate(
        residual_model, start, CandidateFit(get_parameters("steering_offset"), np.array([1.0]), 0.0, np.zeros((1, 1)))
    )
    assert larger.settings == {"steering_offset": {"angle_deg": 1.0}}
    assert larger.residuals == pytest.approx(residual_model.compute_residuals(larger.settings))


def test_a_model_that_is_wrong_everywhere_is_judged_by_longer_ways() -> None:
    """A tractor that turns 3 % less than its file: positions and headings are trusted less until it can pass."""
    wrong = build_programme_model("circles", {"steering_gain": {"ratio": 0.97}})
    eased = reweigh_residual_model(wrong, make_empty_fit(wrong))
    plain = estimate_first_noise(wrong.dataset)
    easings = np.log(eased.noise.position / plain.position) / np.log(EASING_FACTOR)
    assert easings == pytest.approx(round(easings)) and 1 <= round(easings) <= MOST_EASINGS
    assert eased.noise.heading / plain.heading == pytest.approx(eased.noise.position / plain.position)
    path = eased.compute_path_residuals(eased.simulate_increments({}), {})
    assert float(np.mean(path * path)) < WRONG_EVERYWHERE_LOSS
    # Only what is eased is weighed again, and is as if all had been.
    anew = build_residual_model(wrong.dataset, wrong.rig, {}, eased.noise)
    for one, other in zip(eased.filters, anew.filters, strict=True):
        assert np.array_equal(one.gains, other.gains) and np.array_equal(one.roots, other.roots)
    assert np.array_equal(anew.compute_residuals({}), eased.compute_residuals({}))


def test_a_part_is_not_left_out_because_the_others_had_not_come_to_their_best() -> None:
    """The heading bias is off by 2: without the offset it alone comes to its best, which leaves less than before."""
    residual_model = build_linear_model(steering_offset=1.0, heading_bias=1.0)
    parts = ((get_parameters("steering_offset"), np.array([1.0])), (get_parameters("heading_bias"), np.array([3.0])))
    fit = replace(
        residual_model.fit("steering_offset", "heading_bias"),
        parts=parts,
        residuals=residual_model.compute_residuals({one.id: one.compute_values(at) for one, at in parts}),
    )
    assert set(prune_fit(residual_model, fit).settings) == {"steering_offset", "heading_bias"}


def test_nothing_is_settled_while_a_candidate_was_only_begun(
    residual_model: ResidualModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One is clear that no longer is when others are looked at: all are tried before it is said that none is."""
    looked, known = (
        list[list[CandidateFit]](),
        scan_candidates(residual_model, refit_with_new_weights(residual_model, (), None), eg105(), set()),
    )
    first, clear, *others = known.candidates
    foreseen = [replace(one, is_finished=False, predicted_gain=0.0) for one in others]
    begun = replace(known, candidates=[first, replace(clear, gain=2.0 * LEAST_GAIN), *foreseen])

    def strengths(_: ResidualModel, candidates: list[CandidateFit], left: object) -> tuple[list[float], float]:
        looked.append(candidates)
        return [0.0, *(1e6 for _ in candidates[1:])], 0.0 if len(looked) == 1 else 1e9

    monkeypatch.setattr(selection, "compute_strengths", strengths)
    monkeypatch.setattr(selection, "scan_candidates", lambda *_: begun)
    monkeypatch.setattr(selection, "_find_unnamed_competitor", lambda *_: None)
    chosen = selection._select_forward(
        selection.CauseSelection(residual_model, known.fit, (), 0.0), eg105(), set(), None
    )
    assert not chosen.fit.parts and len(looked) == 3
    assert all(one.is_finished for one in looked[-1]) and not all(one.is_finished for one in looked[0])


@pytest.mark.parametrize("helping", [{"steering_lag"}, {"steering_lag", "steering_deadband"}, {"steering_offset"}])
def test_an_effect_of_the_steering_may_help_beside_another_one_alone(
    helping: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wheels that follow slowly and to the last: without the second the first looks wrong on straights."""
    hidden = {"steering_lag": {"time_s": 0.5}, "steering_deadband": {"angle_deg": 0.8}}
    model = build_commanded_model("small-steps", hidden)
    empty = make_empty_fit(model)
    best = fit_candidate(model.compute_changes, empty, get_parameters("steering_lag"), Projector(empty.jacobian))
    monkeypatch.setattr(
        selection, "is_helping_held_out", lambda model, fit, larger, threshold: set(larger.settings) == helping
    )
    larger = selection._add_helping(model, empty, best, eg105(), LEAST_GAIN)
    assert (set(larger.settings) if larger else None) == (helping if "steering_lag" in helping else None)
