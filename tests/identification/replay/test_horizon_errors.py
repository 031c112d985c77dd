"""Errors over horizons: pieces, sums and totals by hand."""

import math

import numpy as np
import pytest

from tests.identification.analytic_drives import circle, course, rig
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import HORIZONS_S, WINDOW_S, compute_half_numbers
from vehicle.identification.replay.horizon_errors import (
    compute_horizon_errors,
    compute_piece_errors,
    compute_relative_error,
    find_piece_bounds,
    join_pieces,
    list_covering_bounds,
    measure_dataset,
    measure_pieces,
    sum_by_run,
)
from vehicle.identification.replay.simulation import replay_segment, simulate_instruments, simulate_logged_values

TIME = np.arange(100) / 10.0


def list_pieces(time: Array, horizon: float) -> list[tuple[int, int]]:
    return list(zip(*(bounds.tolist() for bounds in find_piece_bounds(time, horizon)), strict=True))


def test_pieces_follow_each_other_and_are_whole() -> None:
    assert list_pieces(TIME, 5.0) == [(0, 50)], "9.9 s hold one whole piece of five"
    assert list_pieces(np.arange(101) / 10.0, 5.0) == [(0, 50), (50, 100)]
    assert list_pieces(TIME, 20.0) == [] and len(list_pieces(TIME, 1.0)) == 9
    assert list_pieces(np.arange(20.0), 1.0) == [], "a row a second is too few for a rigid fit"


def test_the_end_of_a_drive_is_judged_by_every_horizon() -> None:
    """Of 55.9 s, 20 s from the start leave out 15.9 s: one more piece ends with the drive."""
    time = np.arange(560) / 10.0
    (starts, ends), (last, end) = list_covering_bounds(time, 20.0)
    assert (list(starts), list(ends)) == ([0, 200], [200, 400])
    assert (list(last), list(end)) == ([359], [560])
    assert [len(list_covering_bounds(time[:rows], 20.0)) for rows in (150, 201, 406, 420)] == [1, 1, 1, 2]


def test_an_error_at_the_end_of_a_drive_counts_over_every_horizon() -> None:
    (one,) = course(circle(0.0, 55.9)).segments
    antenna = np.stack([one.east, one.north], axis=1)
    antenna[500:] += np.linspace(0.0, 1.0, one.rows - 500)[:, None] ** 2
    errors = compute_horizon_errors(measure_pieces(one, antenna, one.heading))
    assert errors[20.0].cross_cm + errors[20.0].along_cm > errors[5.0].cross_cm + errors[5.0].along_cm > 1.0


def test_a_drive_that_is_simulated_as_it_was_has_no_error() -> None:
    runs = course(circle(0.05, 30.0), circle(0.0, 30.0))
    for segment in runs.segments:
        antenna, heading, _, _ = simulate_instruments(rig(), segment, {})
        pieces = measure_pieces(segment, np.stack([segment.east, segment.north], axis=1), segment.heading)
        assert all(np.abs(rows[:, 2:5]).max() < 1e-15 for rows in pieces.values())
        assert antenna.shape == (segment.rows, 2) and heading.shape == (segment.rows,)


def test_a_speed_that_is_a_tenth_too_high_is_an_error_along() -> None:
    """Over a piece of T s the way is off by 10 %: evenly spread over 0.15 T m, so by 0.15 T / sqrt(12) rms."""
    (one,) = course(circle(0.0, 20.1)).segments
    there = np.stack([one.east, one.north], axis=1)
    errors = compute_horizon_errors(measure_pieces(one, 1.1 * there, one.heading))
    for horizon in (1.0, 5.0, 10.0):
        rows = 10.0 * horizon
        spread = 15.0 * horizon * math.sqrt((1.0 - 1.0 / rows**2) / 12.0)
        assert errors[horizon].along_cm == pytest.approx(spread, rel=1e-6)
        assert errors[horizon].cross_cm < 1e-9 and errors[horizon].heading_deg < 1e-9


def test_a_heading_that_was_not_measured_has_no_error() -> None:
    (one,) = course(circle(0.02, 20.1).drop(columns="heading_deg")).segments
    antenna, heading = simulate_logged_values(rig(), one, replay_segment(rig(), one, {}, True, True), {})[:2]
    assert np.isnan(compute_piece_errors(one, antenna, heading, find_piece_bounds(one.time, 5.0))[:, 2]).all()
    assert math.isnan(compute_horizon_errors(measure_pieces(one, antenna, heading))[5.0].heading_deg)


def test_runs_are_summed_apart() -> None:
    still, bent = circle(0.0, 40.1), circle(0.02, 40.1)
    both = measure_dataset(course(still, bent), rig(), {"steering_offset": {"angle_deg": 4.0}})
    for run, frame in enumerate((still, bent)):
        alone = measure_dataset(course(frame), rig(), {"steering_offset": {"angle_deg": 4.0}})
        for horizon in HORIZONS_S:
            assert sum_by_run(both, 2, horizon)[run] == pytest.approx(sum_by_run(alone, 1, horizon)[0], rel=1e-6)
        assert compute_horizon_errors(both, run)[5.0].cross_cm == pytest.approx(
            compute_horizon_errors(alone)[5.0].cross_cm
        )


def test_errors_count_in_units_of_the_floor() -> None:
    """Twice the floor's squares across, thrice along, once in heading: 2 on average, 1.5 without along."""
    floor = {5.0: np.array([[0.0, 2.5, 10.0, 20.0, 40.0, 100.0]])}
    one = {5.0: np.array([[0.0, 2.5, 4.0, 12.0, 8.0, 20.0]])}
    assert compute_relative_error(one, floor, 1, True, 5.0) == pytest.approx(2.0)
    assert compute_relative_error(one, floor, 1, False, 5.0) == pytest.approx(1.5)
    assert compute_horizon_errors(floor)[5.0].cross_cm == pytest.approx(100.0 * math.sqrt(0.1))
    whole = join_pieces([{horizon: floor[5.0][: horizon == 5.0] for horizon in HORIZONS_S}])
    assert list(compute_horizon_errors(whole)) == [5.0], "no piece of one second was driven"


TIMES = np.array([0.0, 19.9, 20.0, 39.9, 40.0, 65.0])


def test_halves_take_turns() -> None:
    assert compute_half_numbers(TIMES).tolist() == [0, 0, 1, 1, 0, 1]


def test_no_piece_of_a_horizon_lies_in_two_windows() -> None:
    assert all(WINDOW_S % horizon == 0.0 for horizon in HORIZONS_S)
