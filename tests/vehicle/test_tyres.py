"""Side-slip and side force of a tyre (Eq. 4.1 to 4.4)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.errors import VehicleError
from vehicle.model.ground import GROUNDS, find_ground_index, list_ground_names
from vehicle.sim.compile import build_ground_records
from vehicle.sim.dynamics import compute_side_resistance
from vehicle.sim.effect_terms import CREEP_MPS

SPEEDS = st.floats(-6.0, 6.0)
SIDEWAYS = st.floats(-3.0, 3.0)
SLOPES = st.floats(0.1, 20.0)
LIMITS = st.floats(0.01, 0.5)


def side_friction(slip: float, slope: float, limit: float, speed: float = 1.0) -> float:
    """Side force per load of a wheel that rolls at a speed and slips by an angle."""
    sliding = speed * math.tan(slip)
    return -compute_side_resistance(speed, sliding, slope, limit) * sliding


@pytest.mark.parametrize(("slope_per_deg", "slip_deg", "expected"), [
    (0.005, 5.0, -0.025),
    (0.005, 2.0, -0.010),
    (0.010, 5.0, -0.050),
    (0.150, 5.0, -0.750),
    (0.150, -1.0, 0.150),
    (0.005, 12.0, -0.025),
    (0.005, -80.0, 0.025),
    (0.200, 0.0, 0.0),
])  # fmt: skip
def test_side_friction_by_hand(slope_per_deg: float, slip_deg: float, expected: float) -> None:
    for speed in (0.1, 1.0, -5.0):
        found = side_friction(math.radians(slip_deg), math.degrees(slope_per_deg), math.radians(5.0), speed)
        assert found == pytest.approx(math.copysign(1.0, speed) * expected, abs=1e-12)


@given(SPEEDS, SIDEWAYS, SLOPES, LIMITS)
def test_side_friction_is_capped_and_against_the_sliding(
    forward: float, sideways: float, slope: float, limit: float
) -> None:
    resistance = compute_side_resistance(forward, sideways, slope, limit)
    assert resistance > 0.0
    assert resistance == compute_side_resistance(forward, -sideways, slope, limit)
    assert resistance == compute_side_resistance(-forward, sideways, slope, limit)
    slip = min(math.atan(abs(sideways) / max(abs(forward), CREEP_MPS)), limit)
    assert resistance * abs(sideways) == pytest.approx(slope * slip, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize(("forward", "sideways", "slip_deg"), [
    (1.0, 1.0, 45.0),
    (-1.0, 1.0, 45.0),
    (2.0, -2.0 * math.tan(math.radians(10)), 10.0),
    (0.0, CREEP_MPS, 45.0),
    (0.01, -CREEP_MPS, 45.0),
])  # fmt: skip
def test_slip_by_hand(forward: float, sideways: float, slip_deg: float) -> None:
    """Below the creep a wheel slips as if it rolled that fast."""
    found = compute_side_resistance(forward, sideways, 1.0, math.pi) * abs(sideways)
    assert math.degrees(found) == pytest.approx(slip_deg, abs=1e-9)


@given(SPEEDS, SLOPES, LIMITS)
def test_resistance_at_no_slip_is_the_derivative_of_the_friction(forward: float, slope: float, limit: float) -> None:
    h = 1e-7
    before, after = (-compute_side_resistance(forward, side, slope, limit) * side for side in (-h, h))
    assert compute_side_resistance(forward, 0.0, slope, limit) == pytest.approx((before - after) / (2 * h), rel=1e-6)


def test_compiled_grounds_have_the_forces_of_the_grounds() -> None:
    rows = build_ground_records()
    assert len(rows) == len(GROUNDS)
    for row, ground in zip(rows, GROUNDS, strict=True):
        for axle in ("front", "rear"):
            slope, limit = getattr(ground, f"{axle}_slope_per_deg"), getattr(ground, f"{axle}_limit_deg")
            for degrees in np.linspace(0.0, 2 * limit, 9):
                found = side_friction(math.radians(degrees), row[f"{axle}_slope"], row[f"{axle}_limit"])
                assert found == pytest.approx(-slope * min(degrees, limit), abs=1e-12)
        assert row["rolling"] == ground.rolling_resistance


def test_grounds_are_found_by_name_and_unknown_ones_refused() -> None:
    assert [find_ground_index(name) for name in list_ground_names()] == list(range(len(GROUNDS)))
    with pytest.raises(VehicleError, match="'ice' is unknown; use one of: asphalt, soil"):
        find_ground_index("ice")
