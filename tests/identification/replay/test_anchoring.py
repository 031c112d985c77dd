"""Rigid fits in closed form."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.identification.replay.horizon_errors import (
    HEADING_TRUST_RAD,
    POSITION_TRUST_M,
    fit_rigid_motion,
    write_anchored_errors,
)

Array = npt.NDArray[np.float64]
TWO = np.array([-1.0, 1.0])
ZERO = np.zeros(2)


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


def errors(east: Array, north: Array, heading: Array, x: Array, y: Array, angle: Array) -> Array:
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
