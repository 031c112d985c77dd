"""Series of small arguments against the library, on both sides of where they end."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.series import NEAR, SMALL, arc_share, tangent

AROUND = st.floats(-1.5 * SMALL, 1.5 * SMALL)
TWO_BITS = 2.0**-52


EDGES = [SMALL, math.nextafter(SMALL, 1.0), NEAR, math.nextafter(NEAR, 1.0)]


@given(st.one_of(AROUND, st.floats(-1.5, 1.5), st.sampled_from([*EDGES, 1e-160, 0.0])))
def test_the_tangent_is_that_of_the_library(angle: float) -> None:
    assert tangent(angle) == pytest.approx(math.tan(angle), rel=1.5 * TWO_BITS, abs=0.0)
    assert tangent(-angle) == -tangent(angle)


@given(st.one_of(AROUND, st.floats(0.0, 1e6), st.sampled_from([SMALL, 1e-160])))
def test_the_angle_of_a_slope_is_that_of_the_library(slope: float) -> None:
    slope = abs(slope)
    assert arc_share(slope) * slope == pytest.approx(math.atan(slope), rel=2.0 * TWO_BITS, abs=0.0)


def test_no_slope_has_the_share_of_a_small_one() -> None:
    assert arc_share(0.0) == 1.0
