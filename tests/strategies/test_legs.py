"""Places to wait on legs: lengths by hand."""

import numpy as np
import pytest

from strategies.rules.legs import add_wait_points
from vehicle.missions.plan import Leg


def test_parts_between_stops_are_as_long_as_they_measure() -> None:
    angles = np.linspace(0.0, 5.0, 211)
    whole = Leg(np.column_stack([20.0 * np.cos(angles), 20.0 * np.sin(angles)]), 1.0)
    parts = add_wait_points([whole, Leg(np.array([[0.0, 0.0], [1.0, 2.0]]), 1.0, gear=-1)], 7.0)
    assert len(parts) == round(whole.length_m / 7.0) + 1
    assert [part.length_m for part in parts] == [Leg(part.points, 1.0).length_m for part in parts]


def test_no_place_to_wait_is_put_before_a_step_without_direction() -> None:
    """An arc and a straight may meet in two points a rounding apart, just where the path would be parted."""
    leg = Leg(np.array([[0.0, 0.0], [5.0, 0.0], [5.0 + 1e-8, 0.0], [10.0, 0.0]]), 1.0)
    for every_m in (3.0, 5.0):
        parts = add_wait_points([leg], every_m)
        assert not any(part.fault for part in parts)
        assert sum(part.length_m for part in parts) == pytest.approx(10.0)
