"""The filter of the twin: it predicts how an error of an instrument shows in its innovations."""

import math

import numpy as np
import pytest

from vehicle.twin.kalman_filter import (
    BIAS,
    FORWARD,
    LATE,
    MEASUREMENT_SIZE,
    RIGHT,
    SHIFT_COUNT,
    STATE_SIZE,
    PoseFilter,
    build_monitor_parameters,
    update_by_fix,
)
from vehicle.twin.step_motion import TractorNoise

FORWARD_MPS, SPIN = 2.0, 0.1


@pytest.mark.parametrize(
    ("kind", "size", "east", "north", "turned"),
    [(BIAS, 0.02, 0.0, 0.0, 0.02), (FORWARD, 0.1, 0.08, 0.06, 0.0), (RIGHT, 0.1, 0.06, -0.08, 0.0),
     (LATE, 0.5, -0.8, -0.6, -0.05)],
)  # fmt: skip
def test_an_error_of_an_instrument_shows_as_predicted(
    kind: int, size: float, east: float, north: float, turned: float
) -> None:
    """Where a tractor heads 0.8 to the east and 0.6 to the north, by hand; then the means are the innovations, and what
    the filter is wrong by is what the fix pulled it away."""
    pose = np.array([3.0, 4.0, math.atan2(0.6, 0.8)])
    one = PoseFilter(build_monitor_parameters(TractorNoise()), pose)
    shifts, sizes = np.zeros((SHIFT_COUNT, STATE_SIZE)), np.zeros(SHIFT_COUNT)
    whitened, means = np.zeros(MEASUREMENT_SIZE), np.zeros((MEASUREMENT_SIZE, SHIFT_COUNT))
    sizes[kind] = size
    fix, before = np.array([*pose, FORWARD_MPS]), one.estimate.copy()
    fix[:3] += (east, north, turned)
    assert update_by_fix(*one.arrays, fix, 0.0, 0.0, FORWARD_MPS, SPIN, -1.0, shifts, sizes, math.inf, whitened, means)
    assert np.linalg.norm(whitened) > 0.5
    assert means[:, kind] == pytest.approx(whitened, abs=1e-9)
    assert shifts[kind] == pytest.approx(before - one.estimate, abs=1e-9)
    assert not np.delete(means, kind, axis=1).any()
