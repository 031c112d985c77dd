"""Segments, sampling and the closed-form primitives between two poses."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.path_planning.errors import StrategyError
from strategies.path_planning.paths import (
    DrivePath,
    PathSegment,
    Pose,
    advance_along_segment,
    merge_segments,
)
from tests.examples import count_examples
from tests.strategies.primitive_paths import find_backing_paths, find_dubins_paths, find_three_arc_paths

R = 4.0
METRES = st.floats(-80.0, 80.0)
POSES = st.tuples(METRES, METRES, st.floats(-math.pi, math.pi))
SEGMENTS = st.builds(PathSegment, st.floats(0.0, 40.0), st.floats(-0.25, 0.25), st.sampled_from((1, -1)))


def assert_same_pose(p: Pose, q: Pose, tolerance: float = 1e-9) -> None:
    assert math.dist(p[:2], q[:2]) <= tolerance
    assert abs(math.remainder(p[2] - q[2], 2 * math.pi)) <= tolerance


def mirrored(pose: Pose) -> Pose:
    return pose[0], -pose[1], -pose[2]


def primitives(a: Pose, b: Pose) -> list[DrivePath]:
    return find_dubins_paths(a, b, R) + find_three_arc_paths(a, b, R) + find_backing_paths(a, b, R)


def test_advance_quarter_circles() -> None:
    quarter = 0.5 * math.pi * R
    assert_same_pose(advance_along_segment((0, 0, 0), PathSegment(quarter, 1 / R, 1)), (R, R, math.pi / 2))
    assert_same_pose(advance_along_segment((0, 0, 0), PathSegment(quarter, -1 / R, 1)), (R, -R, -math.pi / 2))
    assert_same_pose(advance_along_segment((0, 0, 0), PathSegment(quarter, 1 / R, -1)), (-R, R, -math.pi / 2))
    assert_same_pose(advance_along_segment((1, 2, math.pi / 2), PathSegment(5, 0.0, -1)), (1, -3, math.pi / 2))


@given(POSES, SEGMENTS)
def test_driving_a_segment_back_returns(pose: Pose, segment: PathSegment) -> None:
    back = PathSegment(segment.length_m, segment.curvature, -segment.gear)
    assert_same_pose(advance_along_segment(advance_along_segment(pose, segment), back), pose)


@given(POSES, SEGMENTS, st.floats(0.0, 1.0))
def test_a_segment_cut_in_two_ends_in_the_same_pose(pose: Pose, segment: PathSegment, share: float) -> None:
    first = PathSegment(share * segment.length_m, segment.curvature, segment.gear)
    second = PathSegment(segment.length_m - first.length_m, segment.curvature, segment.gear)
    assert_same_pose(
        advance_along_segment(advance_along_segment(pose, first), second), advance_along_segment(pose, segment)
    )


@given(POSES, POSES)
def test_every_word_ends_at_its_goal(a: Pose, b: Pose) -> None:
    for primitive in primitives(a, b):
        assert_same_pose(primitive.end, b)
        assert all(s.length_m > 0.0 and abs(s.curvature) <= 1 / R for s in primitive.segments)


@given(POSES, POSES)
def test_the_first_dubins_word_is_shortest_and_no_shorter_than_a_straight_line(a: Pose, b: Pose) -> None:
    lengths = [primitive.length_m for primitive in find_dubins_paths(a, b, R)]
    assert len(lengths) >= 4
    assert lengths[0] <= min(lengths) + 1e-9
    assert lengths[0] >= math.dist(a[:2], b[:2]) - 1e-9


@given(POSES, POSES, POSES)
def test_going_by_way_of_a_third_pose_is_never_shorter(a: Pose, via: Pose, b: Pose) -> None:
    direct = find_dubins_paths(a, b, R)[0].length_m
    detour = find_dubins_paths(a, via, R)[0].length_m + find_dubins_paths(via, b, R)[0].length_m
    assert direct <= detour + 1e-6


@given(POSES, POSES)
def test_length_is_the_same_driven_from_the_other_end(a: Pose, b: Pose) -> None:
    def flipped(p: Pose) -> Pose:
        return p[0], p[1], p[2] + math.pi

    there, back = find_dubins_paths(a, b, R)[0].length_m, find_dubins_paths(flipped(b), flipped(a), R)[0].length_m
    assert there == pytest.approx(back, abs=1e-5)


@given(POSES, POSES)
def test_mirror_image_in_mirror_image_out(a: Pose, b: Pose) -> None:
    lengths = [w.length_m for w in primitives(a, b)]
    assert [w.length_m for w in primitives(mirrored(a), mirrored(b))] == pytest.approx(lengths, abs=1e-9)


def test_dubins_known_lengths() -> None:
    ahead = find_dubins_paths((0, 0, 0), (30, 0, 0), R)[0]
    assert ahead.segments == (PathSegment(30.0, 0.0, 1),) and ahead.kind == "route"
    left = find_dubins_paths((0, 0, 0), (10, 10, math.pi / 2), R)[0]
    assert left.length_m == pytest.approx(0.5 * math.pi * R + 6 * math.sqrt(2), abs=1e-9) and left.kind == "u"
    bulb = find_dubins_paths((0, 0, 0), (0, 3, math.pi), R)[0]
    assert bulb.length_m == pytest.approx(25.5704595962577, abs=1e-9) and bulb.kind == "omega"


def test_primitives_that_loop_are_called_omega() -> None:
    aligned = find_dubins_paths((0, 0, 0), (0, 9, math.pi), R)
    assert aligned[0].kind == "u"
    assert {w.kind for w in aligned[1:]} == {"omega"}


@given(POSES, POSES)
def test_primitives_with_cusps_turn_one_way_by_a_circle_at_most(a: Pose, b: Pose) -> None:
    for primitive in find_three_arc_paths(a, b, R):
        turned = [s.gear * s.curvature * s.length_m for s in primitive.segments]
        assert len({math.copysign(1, t) for t in turned}) <= 1
        assert abs(math.fsum(turned)) <= 2 * math.pi + 1e-8
    for primitive in find_backing_paths(a, b, R):
        assert primitive.kind == "switch-back"
        assert all(s.gear == (1 if s.curvature else -1) for s in primitive.segments)


def test_three_arc_is_shorter_than_dubins_for_near_tracks() -> None:
    primitive = find_three_arc_paths((0, 0, 0), (0, 3, math.pi), R)[0]
    assert primitive.length_m == pytest.approx(math.pi * R, abs=1e-9)
    assert primitive.reversals == 2 and [s.gear for s in primitive.segments] == [1, -1, 1]


def test_three_arc_does_not_reach_far() -> None:
    assert find_three_arc_paths((0, 0, 0), (100, 0, math.pi), R) == []


@given(POSES, POSES, st.floats(0.1, 1.5))
@settings(max_examples=count_examples(50))
def test_sampled_polylines_have_no_gaps_and_keep_the_curvature(a: Pose, b: Pose, step: float) -> None:
    for primitive in primitives(a, b):
        runs = primitive.sample(step)
        if not primitive.segments:
            continue
        assert len(runs) == primitive.reversals + 1
        assert math.dist(runs[0][1][0], a[:2]) <= 1e-9 and math.dist(runs[-1][1][-1], b[:2]) <= 1e-9
        for (gear, points), (next_gear, following) in itertools.pairwise(runs):
            assert gear == -next_gear
            assert math.dist(points[-1], following[0]) <= 1e-9
        for _, points in runs:
            assert np.hypot(*np.diff(points, axis=0).T).max() <= step * (1 + 1e-9)


def circumcircle_curvature(points: np.ndarray) -> np.ndarray:
    """Four times the triangle's area over the product of its sides, for every three points in a row."""
    p, q, r = points[:-2], points[1:-1], points[2:]
    cross = (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]
    return 2 * np.abs(cross) / (np.hypot(*(q - p).T) * np.hypot(*(r - q).T) * np.hypot(*(r - p).T))


@given(POSES, POSES)
@settings(max_examples=count_examples(50))
def test_curvature_measured_on_samples_is_at_most_one_over_the_radius(a: Pose, b: Pose) -> None:
    for primitive in primitives(a, b):
        for pose, segment in zip(primitive.list_segment_starts(), primitive.segments, strict=True):
            if segment.length_m > 1.0:
                points = np.concatenate([p for _, p in DrivePath(pose, (segment,), "route").sample(0.5)])
                assert circumcircle_curvature(points).max() <= 1 / R * (1 + 1e-6)


def test_sampled_length_approaches_the_driven_length() -> None:
    primitive = find_dubins_paths((0, 0, 0), (0, 3, math.pi), R)[0]
    ((_, points),) = primitive.sample(0.01)
    assert np.hypot(*np.diff(points, axis=0).T).sum() == pytest.approx(primitive.length_m, abs=1e-4)


def test_joining_merges_equal_neighbours_and_drops_empty_segments() -> None:
    lengths = [(4.0, 0.0, 1), (3.0, 0.0, 1), (0.0, 0.25, 1), (2.0, 0.0, -1)]
    path = merge_segments((0, 0, 0), [PathSegment(*each) for each in lengths], "route")
    assert path.segments == (PathSegment(7.0, 0.0, 1), PathSegment(2.0, 0.0, -1))
    assert path.length_m == 9.0 and path.reverse_m == 2.0 and path.reversals == 1
    assert path.end == (5.0, 0.0, 0.0)


def test_a_path_without_segments_stays_where_it_is() -> None:
    path = merge_segments((1, 2, 0.5), [PathSegment(0.0, 0.0, 1)], "route")
    assert path.segments == () and path.end == (1, 2, 0.5) and path.sample() == []


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan])
def test_step_that_is_not_one_is_refused(step: float) -> None:
    with pytest.raises(StrategyError, match="Sampling step"):
        merge_segments((0, 0, 0), [PathSegment(1.0, 0.0, 1)], "route").sample(step)
