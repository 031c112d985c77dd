"""Windows of twenty seconds, by hand."""

import numpy as np

from vehicle.measured.replay.horizons import HORIZONS_S
from vehicle.measured.replay.windows import WINDOW_S, half_of, window_of

TIMES = np.array([0.0, 19.9, 20.0, 39.9, 40.0, 65.0])


def test_windows_count_and_halves_take_turns() -> None:
    assert window_of(TIMES).tolist() == [0, 0, 1, 1, 2, 3]
    assert half_of(TIMES).tolist() == [0, 0, 1, 1, 0, 1]


def test_no_piece_of_a_horizon_lies_in_two_windows() -> None:
    assert all(WINDOW_S % horizon == 0.0 for horizon in HORIZONS_S)
