"""Projection on a polyline, lookahead target, steering command (Eq. 2.5)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point

from fields.arrays import Floats
from vehicle.control.guidance import compute_steering_command, find_target_point, project_point, wrap_angle

DEG = math.radians(1.0)
# Headings within 1 rad of each other: no segment is hidden behind another, so nearest means abreast.
SEGMENTS = st.lists(st.tuples(st.floats(3.0, 20.0), st.floats(-0.5, 0.5)), min_size=1, max_size=8)
PLACES = st.floats(0.0, 0.999)
OFFSETS = st.floats(-0.5, 0.5)
SPINS = st.floats(-math.pi, math.pi)


def polyline(segments: list[tuple[float, float]], turn: float) -> tuple[Floats, Floats]:
    lengths = np.array([length for length, _ in segments])
    headings = np.array([heading + turn for _, heading in segments])
    moves = lengths[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    points = np.array([3.0, -2.0]) + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return points, np.concatenate([[0.0], np.cumsum(lengths)])


def command(lateral: float, heading_deg: float, lock_deg: float = 35.0) -> float:
    """Eq. 2.5 with the gains of the thesis, in degrees."""
    return math.degrees(compute_steering_command(lateral, heading_deg * DEG, 30 * DEG, 0.8, 0.7, lock_deg * DEG))


@given(SEGMENTS, SPINS, PLACES, OFFSETS)
def test_projection_agrees_with_shapely(
    segments: list[tuple[float, float]], turn: float, place: float, offset: float
) -> None:
    points, cumulative = polyline(segments, turn)
    segment = int(place * len(segments))
    share = 1.0 + (place * len(segments) - segment) * (segments[segment][0] - 2.0)  # a metre clear of both ends
    heading = segments[segment][1] + turn
    along = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-along[1], along[0]])
    x, y = points[segment] + share * along + offset * left
    found, progress, lateral = project_point(points, cumulative, 0, len(segments) - 1, x, y)
    line = LineString(points)
    assert found == segment
    assert progress == pytest.approx(line.project(Point(x, y)), abs=1e-8)
    assert abs(lateral) == pytest.approx(line.distance(Point(x, y)), abs=1e-8)
    assert lateral == pytest.approx(offset, abs=1e-8), "left of the path, the path lies to the right"


@given(SEGMENTS, SPINS, PLACES)
def test_target_point_lies_at_its_arc_distance(segments: list[tuple[float, float]], turn: float, place: float) -> None:
    points, cumulative = polyline(segments, turn)
    progress = place * cumulative[-1]
    found = find_target_point(points, cumulative, 0, len(segments) - 1, progress)
    assert found == pytest.approx(LineString(points).interpolate(progress).coords[0], abs=1e-8)


def test_beyond_the_last_segment_the_path_goes_straight_on() -> None:
    points, cumulative = np.array([[0.0, 0.0], [0.0, 4.0], [3.0, 8.0], [9.0, 8.0]]), np.array([0.0, 4.0, 9.0, 15.0])
    assert find_target_point(points, cumulative, 0, 1, 14.0) == pytest.approx((6.0, 12.0))
    assert find_target_point(points, cumulative, 0, 2, 17.0) == pytest.approx((11.0, 8.0))
    segment, progress, lateral = project_point(points, cumulative, 0, 1, 6.0, 12.0)
    assert (segment, progress, lateral) == (1, pytest.approx(14.0), pytest.approx(0.0, abs=1e-12))


def test_projection_never_goes_back() -> None:
    points, cumulative = np.array([[0.0, 0.0], [0.0, 4.0], [0.0, 8.0]]), np.array([0.0, 4.0, 8.0])
    assert project_point(points, cumulative, 1, 1, 0.0, 1.0) == (1, pytest.approx(1.0), 0.0)
    assert project_point(points, cumulative, 0, 1, 0.0, 1.0) == (0, pytest.approx(1.0), 0.0)


@pytest.mark.parametrize(("x", "lateral"), [(-1.0, 1.0), (2.0, -2.0), (0.0, 0.0)])
def test_a_path_to_the_right_is_a_positive_error(x: float, lateral: float) -> None:
    northward = np.array([[0.0, 0.0], [0.0, 10.0]])
    _, progress, found = project_point(northward, np.array([0.0, 10.0]), 0, 0, x, 6.0)
    assert (progress, found) == (pytest.approx(6.0), pytest.approx(lateral))


@pytest.mark.parametrize(("lateral", "heading", "expected"), [
    (0.1, 0.0, 3.0),
    (-0.1, 0.0, -3.0),
    (0.0, 5.0, 4.0),
    (0.1, 5.0, 7.0),
    (0.2, -10.0, -2.0),
    (0.7, 0.0, 21.0),
    (5.0, 0.0, 21.0),  # counted as 0.7 m
    (-5.0, 10.0, -13.0),
    (1.0, 30.0, 35.0),  # 21 + 24 is beyond the lock
    (-1.0, -90.0, -35.0),
])  # fmt: skip
def test_steering_command_by_hand(lateral: float, heading: float, expected: float) -> None:
    assert command(lateral, heading) == pytest.approx(expected, abs=1e-9)


@given(st.floats(-20.0, 20.0), st.floats(-180.0, 180.0), st.floats(5.0, 50.0))
def test_the_command_is_odd_and_within_the_lock(lateral: float, heading: float, lock: float) -> None:
    found = command(lateral, heading, lock)
    assert abs(found) <= lock + 1e-9
    assert command(-lateral, -heading, lock) == -found


@given(st.floats(-50.0, 50.0))
def test_wrapping_keeps_the_direction(angle: float) -> None:
    found = wrap_angle(angle)
    assert -math.pi <= found <= math.pi
    assert math.cos(found) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(found) == pytest.approx(math.sin(angle), abs=1e-9)
