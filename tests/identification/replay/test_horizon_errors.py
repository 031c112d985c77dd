"""Errors over horizons: pieces, sums and totals by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.arrays import Floats
from tests.identification.analytic_drives import circle, course, rig
from vehicle.identification.replay.drive_segments import HORIZONS_S, WINDOW_S, compute_half_numbers
from vehicle.identification.replay.horizon_errors import (
    HEADING_TRUST_RAD,
    POSITION_TRUST_M,
    compute_horizon_errors,
    compute_piece_errors,
    compute_relative_error,
    find_piece_bounds,
    fit_rigid_motion,
    join_pieces,
    list_covering_bounds,
    measure_dataset,
    measure_pieces,
    sum_by_run,
    write_anchored_errors,
)
from vehicle.identification.replay.simulation import replay_segment, simulate_instruments, simulate_logged_values

TIME = np.arange(100) / 10.0
TIMES = np.array([0.0, 19.9, 20.0, 39.9, 40.0, 65.0])
TWO = np.array([-1.0, 1.0])
ZERO = np.zeros(2)


def list_pieces(time: Floats, horizon: float) -> list[tuple[int, int]]:
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


def test_halves_take_turns() -> None:
    assert compute_half_numbers(TIMES).tolist() == [0, 0, 1, 1, 0, 1]


def test_no_piece_of_a_horizon_lies_in_two_windows() -> None:
    assert all(WINDOW_S % horizon == 0.0 for horizon in HORIZONS_S)


# --- Rigid fits in closed form ---


@given(st.floats(-3.0, 3.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_a_rigid_motion_is_found_again(turn: float, east: float, north: float) -> None:
    x, y, angle = np.array([0.0, 3.0, 5.0, 4.0]), np.array([0.0, 1.0, -1.0, 6.0]), np.array([0.1, 0.2, -0.3, 0.4])
    c, s = math.cos(turn), math.sin(turn)
    turned, pe, pn, qe, qn = fit_rigid_motion(
        0, 4, c * x - s * y + east, s * x + c * y + north, angle + turn, x, y, angle
    )
    assert math.remainder(turned - turn, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert (qe, qn) == pytest.approx((3.0, 1.5))
    assert (pe, pn) == pytest.approx((c * 3.0 - s * 1.5 + east, s * 3.0 + c * 1.5 + north))


def test_positions_decide_against_headings_by_their_trust() -> None:
    """Two points 2 m apart say 0, headings say 0.3 rad: weights are the lever arms squared, 2 of 1 m each, and 2 rows
    of a centimetre over two degrees."""
    trust = (POSITION_TRUST_M / HEADING_TRUST_RAD) ** 2
    turn = fit_rigid_motion(0, 2, TWO, ZERO, ZERO + 0.3, TWO, ZERO, ZERO)[0]
    assert math.tan(turn) == pytest.approx(2.0 * trust * math.sin(0.3) / (2.0 + 2.0 * trust * math.cos(0.3)))
    standing = fit_rigid_motion(0, 2, ZERO, ZERO, ZERO + 0.3, ZERO, ZERO, ZERO)[0]
    assert standing == pytest.approx(0.3), "where nothing moves, only headings say anything"


def errors(east: Floats, north: Floats, heading: Floats, x: Floats, y: Floats, angle: Floats) -> Floats:
    out = np.full((len(east), 3), 9.0)
    write_anchored_errors(np.array([0]), np.array([2]), east, north, heading, x, y, angle, out)
    return out


def test_errors_by_hand() -> None:
    """Driven east over two points. 10 % too short a simulation: 0.1 m short at each end, along the way."""
    assert errors(TWO, ZERO, ZERO, 0.9 * TWO, ZERO, ZERO) == pytest.approx(
        np.array([[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]), abs=1e-12
    )
    north = errors(ZERO, TWO, ZERO + 0.5 * math.pi, ZERO, 0.9 * TWO, ZERO + 0.5 * math.pi)
    assert north == pytest.approx(np.array([[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]), abs=1e-12)


def test_cross_is_to_the_right_and_heading_what_the_turn_leaves() -> None:
    """Three points on an eastward way, the middle one measured 0.3 m south of it: 0.2 m to the right of the best fit.

    Nothing turns the fit: the points are even about the middle, and so are the headings.
    """
    three, zero, out = np.array([-1.0, 0.0, 1.0]), np.zeros(3), np.zeros((3, 3))
    heading, north = np.array([0.2, 0.0, -0.2]), np.array([0.0, -0.3, 0.0])
    write_anchored_errors(np.array([0]), np.array([3]), three, north, heading, three, zero, zero, out)
    assert out[:, 0] == pytest.approx([-0.1 * math.cos(0.2), 0.2, -0.1 * math.cos(0.2)])
    assert out[:, 1] == pytest.approx([0.1 * math.sin(0.2), 0.0, -0.1 * math.sin(0.2)])
    assert out[:, 2] == pytest.approx(heading)


def test_rows_outside_every_piece_are_left_alone() -> None:
    three, zero, out = np.arange(3.0), np.zeros(3), np.full((3, 3), 9.0)
    write_anchored_errors(np.array([0]), np.array([2]), three, zero, zero, three, zero, zero, out)
    assert (out[2] == 9.0).all() and np.abs(out[:2]).max() < 1e-12


def test_errors_of_pieces_row_by_row() -> None:
    """Against the formulas written out, turned by more than half a turn as well; rows between pieces are left alone."""
    rng, rows = np.random.default_rng(4), 40
    east, north, heading = rng.normal(size=(3, rows)).cumsum(axis=1)
    x, y, angle = rng.normal(size=(3, rows)).cumsum(axis=1) + 3.0
    starts, ends, out = np.array([0, 12, 25]), np.array([12, 24, 40]), np.full((rows, 3), 9.0)
    write_anchored_errors(starts, ends, east, north, heading, x, y, angle, out)
    for first, end in zip(starts, ends, strict=True):
        turn, pe, pn, qe, qn = fit_rigid_motion(first, end, east, north, heading, x, y, angle)
        c, s = math.cos(turn), math.sin(turn)
        for k in range(first, end):
            off_east = east[k] - pe - (x[k] - qe) * c + (y[k] - qn) * s
            off_north = north[k] - pn - (x[k] - qe) * s - (y[k] - qn) * c
            there, across = math.cos(heading[k]), math.sin(heading[k])
            wrapped = math.remainder(heading[k] - angle[k] - turn, 2.0 * math.pi)
            known = off_east * across - off_north * there, off_east * there + off_north * across, wrapped
            assert out[k] == pytest.approx(known, abs=1e-12)
    assert (out[24] == 9.0).all()
