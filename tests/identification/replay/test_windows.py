"""Windows of twenty seconds, by hand."""

import numpy as np

from vehicle.identification.replay.drive_segments import HORIZONS_S, WINDOW_S, compute_half_numbers

TIMES = np.array([0.0, 19.9, 20.0, 39.9, 40.0, 65.0])


def test_halves_take_turns() -> None:
    assert compute_half_numbers(TIMES).tolist() == [0, 0, 1, 1, 0, 1]


def test_no_piece_of_a_horizon_lies_in_two_windows() -> None:
    assert all(WINDOW_S % horizon == 0.0 for horizon in HORIZONS_S)
