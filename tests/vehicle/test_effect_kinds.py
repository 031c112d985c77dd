"""Kinds of effect: values to coordinates and back for the whole catalogue, intervals and draws by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.model.effect_kinds import CIRCLE, LIMIT, SIZE, SLOPE, CoordinateBox, EffectSample
from vehicle.model.effects import CATALOGUE, Effect, check_effect, get_effect, get_neutral_values
from vehicle.model.tractor import load_tractor

STEERING = load_tractor("eg105").steering

Z95 = 1.959963984540054  # of a normal distribution 95 % lie within as many standard deviations of the mean


def box(entry: Effect) -> CoordinateBox:
    zero = get_neutral_values(entry.id, STEERING)[entry.size.name]
    return entry.kind.build_box(entry.size, zero)


@pytest.mark.parametrize("entry", CATALOGUE, ids=lambda entry: entry.id)
def test_neutral_coordinates_are_neutral_values_inside_the_box(entry: Effect) -> None:
    room = box(entry)
    place = (0.0, 0.0, 0.0)[: len(entry.params) - 1] if entry.kind is CIRCLE else ()
    values = entry.kind.compute_values(entry.params, np.array(room.neutral), place)
    assert values[entry.size.name] == get_neutral_values(entry.id, STEERING)[entry.size.name]
    assert all(low <= one <= high for low, one, high in zip(room.low, room.neutral, room.high, strict=True))
    assert len(room.neutral) == len(room.typical) == len(room.low) == len(room.high)


def test_a_limit_is_its_inverse_and_none_is_zero() -> None:
    params = get_effect("side_slip").params
    assert LIMIT.compute_values(params, np.array([4.0])) == {"limit_g": 0.25}
    assert LIMIT.compute_values(params, np.array([0.0])) == {"limit_g": math.inf}
    assert LIMIT.build_box(get_effect("side_slip").size, math.inf).high == (50.0,)


@pytest.mark.parametrize(
    "inverse, sigma, low, high",
    [
        (4.0, 0.1, 1 / 4.96, 1 / 3.04),
        (4.0, 1.0, 1 / (4.0 + Z95), 1 / (4.0 - Z95)),
        (1.0, 1.0, 1 / (1.0 + Z95), math.inf),
    ],
)
def test_interval_of_a_limit_is_that_of_its_inverse_turned_over(
    inverse: float, sigma: float, low: float, high: float
) -> None:
    """Never narrower than 24 % of the inverse either side, and open where the inverse may be 0."""
    entry = get_effect("side_slip")
    spread = LIMIT.compute_interval(entry.params, box(entry), np.array([inverse]), np.array([[sigma**2]]))
    assert spread["limit_g"] == pytest.approx((low, high))


def test_interval_of_a_size_is_its_spread_inside_the_box() -> None:
    entry = get_effect("steering_offset")
    spread = SIZE.compute_interval(entry.params, box(entry), np.array([1.0]), np.array([[0.25]]))
    wide = Z95 * 0.5
    assert spread == {"angle_deg": pytest.approx((1.0 - wide, 1.0 + wide))}
    at_the_end = SIZE.compute_interval(entry.params, box(entry), np.array([7.9]), np.array([[0.25]]))
    assert at_the_end["angle_deg"][1] == entry.size.high


def test_no_interval_is_claimed_for_a_place() -> None:
    entry = get_effect("grip_patch")
    assert set(CIRCLE.compute_interval(entry.params, box(entry), np.array([1.2]), np.array([[0.01]]))) == {"ratio"}


def test_a_slope_towards_the_east_has_its_spread_along_and_across() -> None:
    entry = get_effect("cross_slope_drift")
    at = np.array([0.05, 0.0])
    assert SLOPE.compute_values(entry.params, at) == pytest.approx({"ratio": 0.05, "bearing_deg": 90.0})
    covariance = np.diag([0.01**2, 0.02**2])
    spread = SLOPE.compute_interval(entry.params, box(entry), at, covariance)
    turn = math.degrees(math.atan2(Z95 * 0.02, 0.05))
    assert spread["ratio"] == pytest.approx((0.05 - 0.01 * Z95, 0.05 + 0.01 * Z95))
    assert spread["bearing_deg"] == pytest.approx((90.0 - turn, 90.0 + turn))
    any_way = SLOPE.compute_interval(entry.params, box(entry), at, 100.0 * covariance)
    assert any_way["bearing_deg"] == (-90.0, 270.0) and any_way["ratio"][0] == 0.0


def test_the_finer_size_is_smaller_and_the_finer_limit_larger() -> None:
    assert (
        SIZE.is_no_larger_fault(0.5, 1.0)
        and SIZE.is_no_larger_fault(1.0005, 1.0)
        and not SIZE.is_no_larger_fault(1.1, 1.0)
    )
    assert LIMIT.is_no_larger_fault(0.12, 0.1) and not LIMIT.is_no_larger_fault(0.09, 0.1)
    assert SIZE.compute_smallest_detectable(np.array([3.0]), 0.25, 2.0, 0.1) == 0.5
    assert SIZE.compute_smallest_detectable(np.array([3.0]), 0.25, 2.0, 0.6) == 0.6
    assert LIMIT.compute_smallest_detectable(np.array([8.0]), 0.25, 4.0, 0.0) == 0.125
    assert [kind.size_word for kind in (SIZE, LIMIT, SLOPE, CIRCLE)] == ["", "limit ", "", ""]


@given(st.sampled_from(CATALOGUE), st.integers(0, 10**6), st.floats(0.9, 1.4))
def test_what_is_drawn_is_possible_and_as_far_from_neutral_as_asked(entry: Effect, seed: int, share: float) -> None:
    zero = get_neutral_values(entry.id, STEERING)
    draw = EffectSample(share, entry.is_worse_when_less, (10.0, 5.0, 16.0))
    values = entry.kind.sample_values(entry.params, zero, draw, np.random.default_rng(seed))
    check_effect(entry.id, values)
    if entry.kind is LIMIT:
        assert values["limit_g"] == round(0.1 / share, 3)
        return
    away = values[entry.size.name] - zero[entry.size.name]
    assert abs(away) == pytest.approx(share * entry.size.typical, abs=1e-4)
    assert away < 0.0 if entry.is_worse_when_less else True
    if entry.kind is CIRCLE:
        assert (values["east_m"], values["north_m"], values["radius_m"]) == (10.0, 5.0, 16.0)


def test_lengths_and_curvatures_scale_with_the_wheelbase() -> None:
    antenna = get_effect("antenna_forward").size.scale_to_wheelbase(1.2)
    draft = get_effect("implement_side_draft").size.scale_to_wheelbase(1.2)
    assert (antenna.typical, antenna.finest, antenna.high) == (0.2, 0.04, 5.0)
    assert (draft.typical, draft.high) == (0.012, 0.2)
    assert get_effect("steering_offset").size.scale_to_wheelbase(1.2) == get_effect("steering_offset").size
