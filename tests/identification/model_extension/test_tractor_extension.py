"""What is added to a tractor: intervals, settings for data held out, and the file."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.identification.residual_models import build_commanded_model, build_programme_model, eg105, get_parameters
from vehicle.identification.cause_selection.evidence import estimate_robust_covariance
from vehicle.identification.cause_selection.tolerances import (
    estimate_form_covariance,
    estimate_run_variances,
    estimate_tolerance_covariance,
)
from vehicle.identification.fit.effect_parameters import build_discrepancy_parameters
from vehicle.identification.fit.open_loop import ModelTerm, OpenLoopErrors, fit_terms
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit
from vehicle.identification.model_extension.term_search import OpenLoopFit
from vehicle.identification.model_extension.tractor_extension import (
    EquivalentEffect,
    ModelExtension,
    build_extended_tractor,
    build_fit_extension,
    build_open_loop_extension,
    compute_shared_error,
    compute_value_interval,
)
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.tractor import EffectSetting, load_tractor
from vehicle.model.tractor_writer import format_tractor_toml


@pytest.fixture(scope="module")
def residual_model() -> ResidualModel:
    return build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})


def offset(at: float, runs: frozenset[int] | None = None) -> ModelTerm:
    return ModelTerm(get_parameters("steering_offset"), np.array([at]), runs)


def test_held_out_settings_with_some_of_the_effects() -> None:
    both = {"steering_offset": {"angle_deg": 1.0}, "wheel_slip": {"ratio": 0.1}}
    whole = ModelExtension((offset(1.0),), {}, {0: (both, {}), 1: (both, both)})
    assert whole.select_held_out_settings(["wheel_slip"]) == {
        0: ({"wheel_slip": {"ratio": 0.1}}, {}), 1: ({"wheel_slip": {"ratio": 0.1}}, {"wheel_slip": {"ratio": 0.1}})
    }  # fmt: skip
    assert whole.drop_held_out_effect("wheel_slip")[0] == ({"steering_offset": {"angle_deg": 1.0}}, {})
    assert whole.term_ids == {"steering_offset"}


def test_intervals_come_from_scatter_tolerances_and_form(residual_model: ResidualModel) -> None:
    names = ("steering_offset", "heading_bias")
    residuals = residual_model.compute_residuals({})
    fit = refine_fit(residual_model, EffectFit(tuple((get_parameters(name), np.zeros(1)) for name in names), residuals,
                             np.zeros((len(residuals), 0))))  # fmt: skip
    added = build_fit_extension(residual_model, fit, ["steering_offset"])
    value = float(fit.parts[0][1][0])
    scatter = float(estimate_robust_covariance(residual_model, fit, widen_for_few=True)[0, 0])
    parts = (
        max(scatter, float(estimate_run_variances(residual_model, fit)[0])),
        float(estimate_tolerance_covariance(residual_model, fit)[0, 0]),
        float(estimate_form_covariance(fit)[0, 0]),
    )
    sigma = math.sqrt(sum(parts))
    assert parts[1] > 0.0 and sigma > math.sqrt(scatter)  # a stated scale or place may be off
    wide = math.hypot(1.96 * sigma, 0.12)
    assert added.tolerant_intervals["steering_offset"] == {"angle_deg": pytest.approx((value - wide, value + wide))}
    told = math.hypot(1.96 * sigma, 0.2 * 0.12)
    assert added.intervals["steering_offset"] == {"angle_deg": pytest.approx((value - told, value + told))}
    assert told < wide
    assert added.term_ids == {"steering_offset"} and set(added.intervals) == set(names)
    # The circle to the right is simulated with what the one to the left tells, and the other way.
    (right, _), (left, _) = added.held_out_settings[0], added.held_out_settings[1]
    assert right["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=0.05)
    assert set(left) == {"steering_offset"}


def test_an_amount_of_the_rest_has_no_tolerance() -> None:
    term = ModelTerm(build_discrepancy_parameters()[0][0], np.array([0.5]))
    assert compute_value_interval(term, np.array([[0.01]]), 0.0) == {
        "angle_by_speed": pytest.approx((0.5 - 0.196, 0.5 + 0.196))
    }


def test_a_time_of_the_steering_is_no_surer_than_the_beat_of_commands_and_half_a_row(
    residual_model: ResidualModel,
) -> None:
    """0.02 s of a controller and an even spread over the 0.1 s of a row, both as standard deviations."""
    late = ModelTerm(get_parameters("steering_dead_time"), np.array([0.2]))
    assert compute_shared_error(residual_model, late) == pytest.approx(1.96 * math.hypot(0.02, 0.1 / math.sqrt(12.0)))
    latency = ModelTerm(get_parameters("gnss_latency"), np.array([0.2]))
    assert compute_shared_error(residual_model, latency) == pytest.approx(
        1.96 * 0.05 / math.sqrt(3.0)
    )  # three that the path cannot part
    assert compute_shared_error(residual_model, latency, open_loop=True) == pytest.approx(1.96 * 0.05)


def test_values_of_other_makes_are_off_by_a_share_of_the_tolerance(residual_model: ResidualModel) -> None:
    """A fifth of 0.12 degrees; all of it for a play, which noise of the sensor pushes, and for a dead band."""
    assert compute_shared_error(residual_model, offset(1.0)) == pytest.approx(0.024)
    assert compute_shared_error(
        residual_model, ModelTerm(get_parameters("steering_backlash"), np.array([1.0]))
    ) == pytest.approx(0.25)
    assert compute_shared_error(
        residual_model, ModelTerm(get_parameters("steering_deadband"), np.array([1.0]))
    ) == pytest.approx(0.25)


def test_what_lowers_the_open_loop_error_is_told_with_its_interval() -> None:
    loop = OpenLoopErrors(build_commanded_model("circles", {"steering_offset": {"angle_deg": 1.0}}))
    model = fit_terms(loop, (offset(0.0),))
    added = build_open_loop_extension(OpenLoopFit(loop, model))
    low, high = added.intervals["steering_offset"]["angle_deg"]
    assert low < 1.0 < high and high - low == pytest.approx(2 * 0.12, abs=0.01)  # no noise: the tolerance alone
    assert added.held_out_settings[0][0]["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=1e-3)


def test_two_extensions_are_one_with_what_each_tells_of_its_own_effects() -> None:
    half, other = {"steering_offset": {"angle_deg": 1.0}}, {"wheel_slip": {"ratio": 0.1}}
    told = {"steering_offset": {"angle_deg": (0.8, 1.2)}, "heading_bias": {"angle_deg": (0.0, 1.0)}}
    first = ModelExtension((offset(1.0),), told, {0: (half, {})}, {})
    slip = ModelTerm(get_parameters("wheel_slip"), np.array([0.1]))
    both = first.merge(ModelExtension((slip,), {"wheel_slip": {"ratio": (0.05, 0.15)}}, {0: (other, other)}))
    assert both.term_ids == {"steering_offset", "wheel_slip"} == set(both.intervals)
    assert both.held_out_settings == {0: ({**half, **other}, other)}


def test_the_file_gets_values_intervals_and_their_logs(residual_model: ResidualModel, tmp_path: Path) -> None:
    lag, slide = (
        ModelTerm(get_parameters("steering_lag"), np.array([0.2])),
        ModelTerm(get_parameters("side_slip"), np.array([0.0])),
    )
    push = ModelTerm(build_discrepancy_parameters()[-1][0], np.array([0.0123456789]))
    intervals = {
        "steering_offset": {"angle_deg": (0.8, 1.2)}, "steering_lag": {"time_s": (0.1, 0.3)},
        "side_slip": {"limit_g": (0.1, math.inf)}, "push_to_east": {"push_to_east": (0.0, 0.02)},
    }  # fmt: skip
    terms = (offset(1.23456789, frozenset({1})), lag, slide, push)
    before = eg105().model_copy(update={"effects": {
        "wheel_slip": EffectSetting(value={"ratio": 0.05}), "antenna_right": EffectSetting(value={"distance_m": 0.1}),
    }})  # fmt: skip
    alike = {"steering_lag": EquivalentEffect({"time_s": (0.05, 0.3)}, ("steering_dead_time",))}
    after = build_extended_tractor(
        residual_model.dataset,
        before,
        "soil",
        ModelExtension(terms, intervals, {}),
        ["steering_offset"],
        alike,
        ["wheel_slip"],
    )
    assert set(after.effects) == {"wheel_slip", "steering_offset", "steering_lag"}  # a limit never reached is none
    named, same = after.effects["steering_offset"], after.effects["steering_lag"]
    assert named.value == {"angle_deg": 1.23457} and named.named and named.logs == ("pass 2",)
    assert named.interval == {"angle_deg": (0.8, 1.2)} and named.ground == "soil"
    assert not same.named and same.equivalent_to == ("steering_dead_time",) and same.interval == {"time_s": (0.05, 0.3)}
    assert after.effects["wheel_slip"] is before.effects["wheel_slip"]
    assert after.discrepancy_model is not None and after.discrepancy_model.amounts == {"push_to_east": 0.0123457}
    assert after.discrepancy_model.angle_deg == pytest.approx((-15.0, 15.0), abs=0.2)
    assert after.discrepancy_model.logs == ("pass 1", "pass 2") and after.discrepancy_model.interval == {
        "push_to_east": (0.0, 0.02)
    }
    path = tmp_path / "mine.toml"
    path.write_text(format_tractor_toml(after), encoding="utf-8")
    assert load_tractor(path) == after
