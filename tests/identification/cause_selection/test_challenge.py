"""Challenges: a cause that stands in for another gives way, one that does not stays."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.residual_models import (
    LinearResidualModel,
    build_draft_model,
    build_programme_model,
    eg105,
    get_parameters,
)
from vehicle.identification.cause_selection.candidate_fit import EffectTraces
from vehicle.identification.cause_selection.challenge import (
    _can_be_replaced,
    _fit_replacing_effects,
    add_typical_starts,
    challenge_causes,
    find_adjacent_blocks,
    is_shown_within_runs,
)
from vehicle.identification.cause_selection.refit import add_part, refit_with_new_weights, refit_without
from vehicle.identification.cause_selection.selection import _compute_random_gain, select_causes
from vehicle.identification.fit.effect_parameters import build_parameters
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import CHANCE_SIGMAS, LEAST_GAIN
from vehicle.model.effects import PATH, POSITION, SPEED, STEERING, get_effect


@pytest.fixture(scope="module")
def residual_model() -> ResidualModel:
    return build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})


@pytest.mark.parametrize("wheel", [True, False])
@pytest.mark.parametrize("speed", [True, False])
def test_sensors_cut_the_chain(wheel: bool, speed: bool) -> None:
    """What a sensor cuts off cannot stand in for what lies behind it; path and antenna are never cut apart."""
    seen: Any = SimpleNamespace(has_measured_wheel_angle=wheel, has_measured_speed=speed)
    joined = {PATH, POSITION} | (set() if wheel else {STEERING}) | (set() if speed else {SPEED})
    assert find_adjacent_blocks(seen, PATH) == find_adjacent_blocks(seen, POSITION) == joined
    assert find_adjacent_blocks(seen, STEERING) == ({STEERING} if wheel else joined)
    assert find_adjacent_blocks(seen, SPEED) == ({SPEED} if speed else joined)


def test_competitors_start_on_both_sides_as_far_as_a_tractor_can_have_it() -> None:
    assert add_typical_starts(get_parameters("steering_offset")).starts == ((0.0,), (1.0,), (-1.0,))
    assert add_typical_starts(get_parameters("wheel_slip")).starts == ((0.1,), (0.08,), (-0.08,))
    assert add_typical_starts(get_parameters("speed_lag")).starts[-1] == (0.0,)  # below nothing there is none
    assert add_typical_starts(get_parameters("cross_slope_drift")) == get_parameters("cross_slope_drift")


def test_a_stand_in_gives_way_to_what_explains_more(residual_model: ResidualModel) -> None:
    """On one circle to each side, less grip to the left and more to the right looks somewhat like an offset."""
    wrong = refit_with_new_weights(residual_model, ((get_parameters("steering_asymmetry"), np.array([0.9])),), None)
    outcome = challenge_causes(residual_model, wrong, (), eg105())
    assert outcome.better_fit is not None and set(outcome.better_fit.settings) == {"steering_offset"}
    assert outcome.better_fit.settings["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=0.02)


def test_the_true_cause_stands(residual_model: ResidualModel) -> None:
    true = refit_with_new_weights(residual_model, ((get_parameters("steering_offset"), np.array([1.0])),), None)
    outcome = challenge_causes(residual_model, true, (), eg105())
    assert outcome.better_fit is None and outcome.lookalikes == {"steering_offset": {}}
    assert select_causes(residual_model, eg105()).lookalikes["steering_offset"] == {}


@pytest.mark.parametrize(
    ("hidden", "spared"),
    [("steering_offset", False), ("grip_drift", False), ("heading_bias", True), ("antenna_right", True)],
)
def test_what_is_not_fitted_again_has_no_competitor_there(hidden: str, spared: bool) -> None:
    """A cause in its own place, and one in that of another: straight lines tell of both before a fit is made again."""
    usual = np.array(get_parameters(hidden).neutral) + np.array(get_parameters(hidden).typical)
    residual_model = build_programme_model("circles", {hidden: get_parameters(hidden).compute_values(usual)})
    for name, at in ((hidden, usual), ("steering_asymmetry", np.array([0.9]))):
        fit = refit_with_new_weights(residual_model, ((get_parameters(name), at),), None)
        worth_of = partial(worth_beside, fit)
        may = _can_be_replaced(
            residual_model,
            fit,
            name,
            worth_of,
            EffectTraces(residual_model.compute_changes, fit, residual_model.compute_residuals(fit.settings)),
        )
        assert not fit.smaller_fits, "nothing was fitted"
        assert may == (name != hidden or not spared)
        rest = refit_without(residual_model, fit, name)
        best = _fit_replacing_effects(residual_model, rest, fit.settings, get_effect(name).block, 0.0)[0]
        assert may or best.gain < worth_of(rest.loss)


def worth_beside(fit: EffectFit, loss: float) -> float:
    return loss - fit.loss - LEAST_GAIN


@pytest.mark.parametrize(("part_of_each", "shows"), [(True, True), (False, False)])
def test_a_place_shows_where_runs_come_to_it_and_leave_it(part_of_each: bool, shows: bool) -> None:
    """Half of every run bends less, or all of one run: the first is a place, the second is another tractor."""
    turned = np.random.default_rng(5).standard_normal(120)
    rows = np.arange(120)
    patch = np.where(rows % 30 < 15 if part_of_each else rows < 30, turned, 0.0)
    residual_model: Any = LinearResidualModel(-0.3 * patch, {"grip_patch": patch, "steering_gain": turned})
    residual_model.rig = SimpleNamespace(tractor=eg105())
    place = build_parameters(eg105(), "grip_patch", {"grip_patch": (0.0, 0.0, 5.0)})
    fit = EffectFit(((place, np.array([0.7])),), np.zeros(120), patch[:, np.newaxis])
    assert is_shown_within_runs(residual_model, fit, "grip_patch") is shows
    assert is_shown_within_runs(residual_model, residual_model.fit("steering_gain", at=0.9), "steering_gain")


def test_chance_grows_with_what_is_free() -> None:
    assert _compute_random_gain(0) == 0.0 and _compute_random_gain(2) == pytest.approx(2.0 + 2.0 * CHANCE_SIGMAS)


@pytest.mark.parametrize("name", ["implement_side_draft", "steering_offset"])
@pytest.mark.parametrize("rear", [0.1, 0.5, 1.0, 20.0])
@pytest.mark.parametrize(("programme", "is_alike"), [("there-and-back", True), ("implement-lifted", False)])
def test_a_crab_tells_no_side_draft_from_an_offset(programme: str, is_alike: bool, rear: float, name: str) -> None:
    """However far the rear axle slides out: only lifting the implement tells them apart."""
    model, parameters = build_draft_model(programme, rear), get_parameters(name)
    bare = refit_with_new_weights(model, (), None)
    fit = refine_fit(model, add_part(model, bare, (parameters, np.array(parameters.typical))))
    outcome = challenge_causes(model, fit, (), eg105())
    assert outcome.better_fit is None
    other = ({"implement_side_draft", "steering_offset"} - {name}).pop()
    assert (other in outcome.lookalikes.get(name, {})) is is_alike
