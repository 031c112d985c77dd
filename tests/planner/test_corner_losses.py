"""Corners of a round in closed form: nothing is missed, and the turn begins and ends where it should."""

import math

import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planner.evaluation.ground.unworked_area import compute_missed_m2
from strategies.path_planning.paths import DrivePath, PathSegment, merge_segments, shift_pose_ahead
from tests.examples import count_examples


def build_corner_arc(turn_rad: float, radius_m: float) -> DrivePath:
    """The arc alone that cuts a corner at the origin reached along the x axis."""
    start = shift_pose_ahead((0.0, 0.0, 0.0), -radius_m * math.tan(0.5 * turn_rad))
    return merge_segments(start, [PathSegment(radius_m * turn_rad, 1.0 / radius_m, 1)], "route")


def test_right_angle_by_hand() -> None:
    assert compute_missed_m2(math.pi / 2, 3.0, 4.0) == pytest.approx((1 - math.pi / 4) * 5.5**2)
    assert compute_missed_m2(math.pi / 2, 3.0, 4.0) == pytest.approx(6.49, abs=0.01)


@given(degrees=st.floats(46, 130), width=st.floats(2, 6), radius=st.floats(3, 8))
@settings(max_examples=count_examples(40))
def test_round_corners_miss_what_is_said(degrees: float, width: float, radius: float) -> None:
    turn = math.radians(degrees)
    assume(radius > 0.5 * width)
    arc = shapely.LineString(build_corner_arc(turn, radius).sample(0.02)[0][1])
    (x0, _), (x1, y1) = arc.coords[0], arc.coords[-1]
    half = 0.5 * width
    begin, corner = (x0, -half), (half * math.tan(0.5 * turn), -half)
    end = (x1 + half * math.sin(turn), y1 - half * math.cos(turn))
    missed = shapely.Polygon([begin, corner, end]).difference(arc.buffer(half, cap_style="flat").convex_hull)
    assert missed.area == pytest.approx(compute_missed_m2(turn, width, radius), rel=0.1)


@given(width=st.floats(2, 6), radius=st.floats(3.5, 8))
@settings(max_examples=count_examples(40))
def test_a_round_pass_outside_takes_part_of_the_tip(width: float, radius: float) -> None:
    """Both arcs turn by a right angle with the same radius; the centre of the outer one is the origin."""
    assume(radius <= 2.9 * width)  # else the outer bar leaves the very corner
    inner_end, outer_end = radius - 0.5 * width, radius + 0.5 * width
    band = (
        shapely.Point(0, 0)
        .buffer(outer_end, quad_segs=256)
        .difference(shapely.Point(0, 0).buffer(inner_end, quad_segs=256))
    )
    tip = shapely.box(-width, -width, inner_end, inner_end).difference(
        shapely.Point(-width, -width).buffer(outer_end, quad_segs=256)
    )
    assert tip.area == pytest.approx(compute_missed_m2(math.pi / 2, width, radius), rel=1e-3)
    missed = tip.difference(band.intersection(shapely.box(0, 0, outer_end, outer_end)))
    assert missed.area == pytest.approx(compute_missed_m2(math.pi / 2, width, radius, inside_round=True), rel=1e-3)
