"""Kinds of effect: values to coordinates and back for the whole catalogue, intervals and draws by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.model.effect_kinds import CIRCLE, LIMIT, SIZE, SLOPE, CoordinateBox, EffectSample
from vehicle.model.effects import CATALOGUE, EFFECTS_BY_ID, Effect, check_effect, get_effect, get_neutral_values
from vehicle.model.tractor import load_tractor

STEERING = load_tractor("eg105").steering
NUMBERS = st.floats(-20.0, 20.0)

Z95 = 1.959963984540054  # of a normal distribution 95 % lie within as many standard deviations of the mean


@st.composite
def possible(draw: st.DrawFn) -> tuple[Effect, dict[str, float]]:
    """An effect of the catalogue and values that a tractor can have."""
    entry = draw(st.sampled_from(CATALOGUE))
    return entry, {
        param.name: draw(st.floats(max(param.low, -1e3) + 1e-6, min(param.high, 1e3) - 1e-6)) for param in entry.params
    }


def box(entry: Effect) -> CoordinateBox:
    zero = get_neutral_values(entry.id, STEERING)[entry.size.name]
    return entry.kind.build_box(entry.size, zero, entry.starts)


@given(possible())
def test_values_survive_their_coordinates(drawn: tuple[Effect, dict[str, float]]) -> None:
    entry, values = drawn
    at, place = entry.kind.compute_coordinates(entry.params, values)
    back = entry.kind.compute_values(entry.params, at, place)
    assert list(back) == list(values)
    assert list(back.values()) == pytest.approx(list(values.values()), rel=1e-9, abs=1e-7)


@given(st.sampled_from(CATALOGUE), st.data())
def test_coordinates_survive_their_values(entry: Effect, data: st.DataObject) -> None:
    room = box(entry)
    size = entry.size.high if entry.kind is SLOPE else math.inf
    at = np.array([
        data.draw(st.floats(max(low, -1e3), min(high, 1e3))) for low, high in zip(room.low, room.high, strict=True)
    ])  # fmt: skip
    if np.linalg.norm(at) > size:  # longer than a tractor can have: cut off, in the same direction
        at *= size / np.linalg.norm(at)
    place = (10.0, 5.0, 16.0)[: len(entry.params) - 1] if entry.kind.is_searched else ()
    values = entry.kind.compute_values(entry.params, at, place)
    back, kept = entry.kind.compute_coordinates(entry.params, values)
    assert back == pytest.approx(at, rel=1e-9, abs=1e-9) and kept == place


@pytest.mark.parametrize("entry", CATALOGUE, ids=lambda entry: entry.id)
def test_neutral_values_are_neutral_coordinates_inside_the_box(entry: Effect) -> None:
    room = box(entry)
    at, place = entry.kind.compute_coordinates(entry.params, get_neutral_values(entry.id, STEERING))
    assert at == pytest.approx(room.neutral) and entry.kind.compute_deviation(room.neutral, at) == 0.0
    assert all(low <= one <= high for low, one, high in zip(room.low, at, room.high, strict=True))
    assert len(room.neutral) == len(room.typical) == len(room.low) == len(room.high) == len(room.starts[0])
    assert len(place) == (3 if entry.kind.is_searched else 0)


def test_a_limit_is_its_inverse_and_none_is_zero() -> None:
    params = get_effect("side_slip").params
    assert LIMIT.compute_values(params, np.array([4.0])) == {"limit_g": 0.25}
    assert LIMIT.compute_values(params, np.array([0.0])) == {"limit_g": math.inf}
    assert LIMIT.compute_coordinates(params, {"limit_g": math.inf})[0] == 0.0
    assert LIMIT.build_box(get_effect("side_slip").size, math.inf, (2.0, 8.0)).high == (50.0,)


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
    spread = LIMIT.compute_interval(entry.params, box(entry), np.array([inverse]), np.array([[sigma**2]]), 0.0)
    assert spread["limit_g"] == pytest.approx((low, high))


def test_interval_of_a_size_is_its_spread_and_its_tolerance_inside_the_box() -> None:
    entry = get_effect("steering_offset")
    spread = SIZE.compute_interval(entry.params, box(entry), np.array([1.0]), np.array([[0.25]]), 0.4)
    wide = math.hypot(Z95 * 0.5, 0.4)
    assert spread == {"angle_deg": pytest.approx((1.0 - wide, 1.0 + wide))}
    at_the_end = SIZE.compute_interval(entry.params, box(entry), np.array([7.9]), np.array([[0.25]]), 0.0)
    assert at_the_end["angle_deg"][1] == entry.size.high


def test_no_interval_is_claimed_for_a_place() -> None:
    entry = get_effect("grip_patch")
    assert set(CIRCLE.compute_interval(entry.params, box(entry), np.array([1.2]), np.array([[0.01]]), 0.0)) == {"ratio"}


def test_a_slope_towards_the_east_has_its_spread_along_and_across() -> None:
    entry = get_effect("cross_slope_drift")
    at = np.array([0.05, 0.0])
    assert SLOPE.compute_values(entry.params, at) == pytest.approx({"ratio": 0.05, "bearing_deg": 90.0})
    covariance = np.diag([0.01**2, 0.02**2])
    spread = SLOPE.compute_interval(entry.params, box(entry), at, covariance, 0.0)
    turn = math.degrees(math.atan2(Z95 * 0.02, 0.05))
    assert spread["ratio"] == pytest.approx((0.05 - 0.01 * Z95, 0.05 + 0.01 * Z95))
    assert spread["bearing_deg"] == pytest.approx((90.0 - turn, 90.0 + turn))
    any_way = SLOPE.compute_interval(entry.params, box(entry), at, 100.0 * covariance, 0.0)
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
    if entry.kind.is_searched:
        assert (values["east_m"], values["north_m"], values["radius_m"]) == (10.0, 5.0, 16.0)


def test_lengths_and_curvatures_scale_with_the_wheelbase() -> None:
    antenna = get_effect("antenna_forward").size.scale_to_wheelbase(1.2)
    draft = get_effect("implement_side_draft").size.scale_to_wheelbase(1.2)
    assert (antenna.typical, antenna.finest, antenna.high) == (0.2, 0.04, 5.0)
    assert (draft.typical, draft.high) == (0.012, 0.2)
    assert get_effect("steering_offset").size.scale_to_wheelbase(1.2) == get_effect("steering_offset").size


def test_only_the_place_of_a_circle_is_searched_for() -> None:
    assert [name for name, entry in EFFECTS_BY_ID.items() if entry.kind.is_searched] == ["grip_patch"]
