"""Series of small arguments against the library, on both sides of where they end."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.fast_math import (
    NEAR_RAD,
    SMALL_RAD,
    compute_arctangent_ratio,
    compute_cosine_sine,
    compute_saturation_factor,
    compute_tangent,
    round_number,
)

AROUND = st.floats(-1.5 * SMALL_RAD, 1.5 * SMALL_RAD)
TWO_BITS = 2.0**-52

EDGES = [SMALL_RAD, math.nextafter(SMALL_RAD, 1.0), NEAR_RAD, math.nextafter(NEAR_RAD, 1.0)]
RIGHT_ANGLES = st.integers(-900_000, 900_000).map(lambda count: count * math.pi / 4.0)


@given(st.one_of(AROUND, st.floats(-1.5, 1.5), st.sampled_from([*EDGES, 1e-160, 0.0])))
def test_the_tangent_is_that_of_the_library(angle: float) -> None:
    assert compute_tangent(angle) == pytest.approx(math.tan(angle), rel=1.5 * TWO_BITS, abs=0.0)
    assert compute_tangent(-angle) == -compute_tangent(angle)


@given(st.one_of(AROUND, st.floats(0.0, 1e6), st.sampled_from([SMALL_RAD, 1e-160])))
def test_the_angle_of_a_slope_is_that_of_the_library(slope: float) -> None:
    slope = abs(slope)
    assert compute_arctangent_ratio(slope) * slope == pytest.approx(math.atan(slope), rel=2.0 * TWO_BITS, abs=0.0)


def test_no_slope_has_the_share_of_a_small_one() -> None:
    assert compute_arctangent_ratio(0.0) == 1.0


@given(st.one_of(st.floats(-10.0, 10.0), st.floats(-1.5e6, 1.5e6), RIGHT_ANGLES))
def test_cosine_and_sine_are_those_of_the_library(angle: float) -> None:
    """Near right angles too, where one of them is all but 0."""
    cosine, sine = compute_cosine_sine(angle)
    assert cosine == pytest.approx(math.cos(angle), rel=2.0 * TWO_BITS, abs=1e-18)
    assert sine == pytest.approx(math.sin(angle), rel=2.0 * TWO_BITS, abs=1e-18)


def test_nan_has_no_sine() -> None:
    assert all(math.isnan(value) for value in compute_cosine_sine(math.nan))
    assert compute_cosine_sine(0.0) == (1.0, 0.0)


@given(st.one_of(st.floats(0.0, 3.0), st.floats(0.0, 1e9), st.sampled_from([1.0, math.nextafter(1.0, 2.0)])))
def test_the_knee_is_a_fifth_root(size: float) -> None:
    known = (1.0 + size**5.0) ** -0.2 if size < 1.0 else (1.0 + size**-5.0) ** -0.2 / size
    assert compute_saturation_factor(size) == pytest.approx(known, rel=3.0 * TWO_BITS, abs=0.0)


def test_numbers_are_rounded_to_even() -> None:
    numbers = [0.0, 0.5, 1.5, 2.4999, -3.7, -0.5, 1e9 + 0.4]
    assert [round_number(one) for one in numbers] == np.round(numbers).tolist()
