"""What need not be tried again: candidates of channels that a fit leaves as they were."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model, eg105, get_parameters
from vehicle.identification.cause_selection.candidate_fit import Projector
from vehicle.identification.cause_selection.refit import refit_with_new_weights
from vehicle.identification.cause_selection.scan_cache import ScanCache, list_channel_slices
from vehicle.identification.cause_selection.selection import scan_candidates
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.effects import PATH, POSITION, SPEED, STEERING, get_effect

APART = frozenset({PATH, POSITION})


@pytest.fixture(scope="module")
def residual_model() -> ResidualModel:
    return build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})


@pytest.fixture(scope="module")
def before(residual_model: ResidualModel) -> ScanCache:
    return scan_candidates(residual_model, refit_with_new_weights(residual_model, (), None), eg105(), set())


def left(fit: EffectFit) -> np.ndarray:
    return Projector(fit.jacobian)(fit.residuals)


def test_after_a_cause_of_the_wheel_only_the_wheel_is_scanned_again(
    residual_model: ResidualModel, before: ScanCache
) -> None:
    fit = refit_with_new_weights(residual_model, ((get_parameters("steering_lag"), np.array([0.3])),), None)
    assert before.find_unchanged_blocks(residual_model, fit, left(fit)) >= APART
    assert STEERING not in before.find_unchanged_blocks(residual_model, fit, left(fit)), (
        "a part of its own, and other residuals"
    )
    after = scan_candidates(residual_model, fit, eg105(), set(), previous=before)
    old, new = ({one.parameters.id: one for one in found.candidates} for found in (before, after))
    assert set(new) == set(old) - {"steering_lag"}
    kept = {name for name in new if new[name] is old[name]}
    assert kept >= {name for name, one in old.items() if one.is_finished and get_effect(name).block in APART}
    assert not any(get_effect(name).block == STEERING for name in kept)
    fresh = scan_candidates(residual_model, fit, eg105(), set())
    gains = {one.parameters.id: one.gain for one in fresh.candidates if one.is_finished}
    assert {name: new[name].gain for name in kept & set(gains)} == pytest.approx(
        {name: gains[name] for name in kept & set(gains)}, abs=0.1
    )


def test_after_a_cause_of_the_path_it_is_scanned_again(residual_model: ResidualModel, before: ScanCache) -> None:
    fit = refit_with_new_weights(residual_model, ((get_parameters("steering_offset"), np.array([1.0])),), None)
    block = get_effect("steering_offset").block
    assert block not in before.find_unchanged_blocks(residual_model, fit, left(fit)) and not before.is_same_path(
        residual_model, fit
    )
    after = scan_candidates(residual_model, fit, eg105(), set(), previous=before)
    assert after.scores is not before.scores
    old = {one.parameters.id: one for one in before.candidates}
    assert not any(
        one is old[one.parameters.id] for one in after.candidates if get_effect(one.parameters.id).block == block
    )


def test_the_same_fit_is_not_scanned_again_but_for_what_was_only_begun(
    residual_model: ResidualModel, before: ScanCache
) -> None:
    again = scan_candidates(residual_model, before.fit, eg105(), {"heading_bias"}, previous=before)
    old = {one.parameters.id: one for one in before.candidates if one.is_finished}
    assert again.scores is before.scores and any(not one.is_finished for one in before.candidates)
    assert all(one is old[one.parameters.id] for one in again.candidates if one.parameters.id in old)
    assert {one.parameters.id for one in again.candidates} == {one.parameters.id for one in before.candidates} - {
        "heading_bias"
    }


def test_without_a_wheel_angle_the_steering_shows_in_the_path(residual_model: ResidualModel) -> None:
    bare = replace(
        residual_model.dataset, segments=tuple(replace(one, wheel=None) for one in residual_model.dataset.segments)
    )
    blocks = [of for of, _ in list_channel_slices(replace(residual_model, dataset=bare))]
    assert blocks == [(PATH, POSITION, STEERING), (), (SPEED,)]
    assert [of for of, _ in list_channel_slices(residual_model)] == [(PATH, POSITION), (STEERING,), (SPEED,)]
