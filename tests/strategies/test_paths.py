"""Segments, sampling and the closed-form words between two poses."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.ways.paths import (
    Path,
    Pose,
    Segment,
    TurnError,
    advance,
    back_straight,
    dubins_paths,
    join,
    make_path,
    straight,
    three_arc,
)

R = 4.0
METRES = st.floats(-80.0, 80.0)
POSES = st.tuples(METRES, METRES, st.floats(-math.pi, math.pi))
SEGMENTS = st.builds(Segment, st.floats(0.0, 40.0), st.floats(-0.25, 0.25), st.sampled_from((1, -1)))


def assert_same_pose(p: Pose, q: Pose, tolerance: float = 1e-9) -> None:
    assert math.dist(p[:2], q[:2]) <= tolerance
    assert abs(math.remainder(p[2] - q[2], 2 * math.pi)) <= tolerance


def mirrored(pose: Pose) -> Pose:
    return pose[0], -pose[1], -pose[2]


def words(a: Pose, b: Pose) -> list[Path]:
    return dubins_paths(a, b, R) + three_arc(a, b, R) + back_straight(a, b, R)


def test_advance_quarter_circles() -> None:
    quarter = 0.5 * math.pi * R
    assert_same_pose(advance((0, 0, 0), Segment(quarter, 1 / R, 1)), (R, R, math.pi / 2))
    assert_same_pose(advance((0, 0, 0), Segment(quarter, -1 / R, 1)), (R, -R, -math.pi / 2))
    assert_same_pose(advance((0, 0, 0), Segment(quarter, 1 / R, -1)), (-R, R, -math.pi / 2))
    assert_same_pose(advance((1, 2, math.pi / 2), Segment(5, 0.0, -1)), (1, -3, math.pi / 2))


@given(POSES, SEGMENTS)
def test_driving_a_segment_back_returns(pose: Pose, segment: Segment) -> None:
    back = Segment(segment.length_m, segment.curvature, -segment.gear)
    assert_same_pose(advance(advance(pose, segment), back), pose)


@given(POSES, SEGMENTS, st.floats(0.0, 1.0))
def test_a_segment_cut_in_two_ends_in_the_same_pose(pose: Pose, segment: Segment, share: float) -> None:
    first = Segment(share * segment.length_m, segment.curvature, segment.gear)
    second = Segment(segment.length_m - first.length_m, segment.curvature, segment.gear)
    assert_same_pose(advance(advance(pose, first), second), advance(pose, segment))


@given(POSES, POSES)
def test_every_word_ends_at_its_goal(a: Pose, b: Pose) -> None:
    for word in words(a, b):
        assert_same_pose(word.end, b)
        assert all(s.length_m > 0.0 and abs(s.curvature) <= 1 / R for s in word.segments)


@given(POSES, POSES)
def test_the_first_dubins_word_is_shortest_and_no_shorter_than_a_straight_line(a: Pose, b: Pose) -> None:
    lengths = [word.length_m for word in dubins_paths(a, b, R)]
    assert len(lengths) >= 4
    assert lengths[0] <= min(lengths) + 1e-9
    assert lengths[0] >= math.dist(a[:2], b[:2]) - 1e-9


@given(POSES, POSES, POSES)
def test_going_by_way_of_a_third_pose_is_never_shorter(a: Pose, via: Pose, b: Pose) -> None:
    direct = dubins_paths(a, b, R)[0].length_m
    detour = dubins_paths(a, via, R)[0].length_m + dubins_paths(via, b, R)[0].length_m
    assert direct <= detour + 1e-6


@given(POSES, POSES)
def test_length_is_the_same_driven_from_the_other_end(a: Pose, b: Pose) -> None:
    def flipped(p: Pose) -> Pose:
        return p[0], p[1], p[2] + math.pi

    there, back = dubins_paths(a, b, R)[0].length_m, dubins_paths(flipped(b), flipped(a), R)[0].length_m
    assert there == pytest.approx(back, abs=1e-5)


@given(POSES, POSES)
def test_mirror_image_in_mirror_image_out(a: Pose, b: Pose) -> None:
    lengths = [w.length_m for w in words(a, b)]
    assert [w.length_m for w in words(mirrored(a), mirrored(b))] == pytest.approx(lengths, abs=1e-9)


def test_dubins_known_lengths() -> None:
    ahead = dubins_paths((0, 0, 0), (30, 0, 0), R)[0]
    assert ahead.segments == (Segment(30.0, 0.0, 1),) and ahead.kind == "route"
    left = dubins_paths((0, 0, 0), (10, 10, math.pi / 2), R)[0]
    assert left.length_m == pytest.approx(0.5 * math.pi * R + 6 * math.sqrt(2), abs=1e-9) and left.kind == "u"
    bulb = dubins_paths((0, 0, 0), (0, 3, math.pi), R)[0]
    assert bulb.length_m == pytest.approx(25.5704595962577, abs=1e-9) and bulb.kind == "omega"


def test_words_that_loop_are_called_omega() -> None:
    aligned = dubins_paths((0, 0, 0), (0, 9, math.pi), R)
    assert aligned[0].kind == "u"
    assert {w.kind for w in aligned[1:]} == {"omega"}


@given(POSES, POSES)
def test_words_with_cusps_turn_one_way_by_a_circle_at_most(a: Pose, b: Pose) -> None:
    for word in three_arc(a, b, R):
        turned = [s.gear * s.curvature * s.length_m for s in word.segments]
        assert len({math.copysign(1, t) for t in turned}) <= 1
        assert abs(math.fsum(turned)) <= 2 * math.pi + 1e-8
    for word in back_straight(a, b, R):
        assert word.kind == "switch-back"
        assert all(s.gear == (1 if s.curvature else -1) for s in word.segments)


def test_three_arc_is_shorter_than_dubins_for_near_tracks() -> None:
    word = three_arc((0, 0, 0), (0, 3, math.pi), R)[0]
    assert word.length_m == pytest.approx(math.pi * R, abs=1e-9)
    assert word.reversals == 2 and [s.gear for s in word.segments] == [1, -1, 1]


def test_three_arc_does_not_reach_far() -> None:
    assert three_arc((0, 0, 0), (100, 0, math.pi), R) == []


@given(POSES, POSES, st.floats(0.1, 1.5))
@settings(max_examples=50)
def test_sampled_polylines_have_no_gaps_and_keep_the_curvature(a: Pose, b: Pose, step: float) -> None:
    for word in words(a, b):
        runs = word.sample(step)
        if not word.segments:
            continue
        assert len(runs) == word.reversals + 1
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
@settings(max_examples=50)
def test_curvature_measured_on_samples_is_at_most_one_over_the_radius(a: Pose, b: Pose) -> None:
    for word in words(a, b):
        for pose, segment in zip(word.poses(), word.segments, strict=True):
            if segment.length_m > 1.0:
                points = np.concatenate([p for _, p in Path(pose, (segment,), "route").sample(0.5)])
                assert circumcircle_curvature(points).max() <= 1 / R * (1 + 1e-6)


def test_sampled_length_approaches_the_driven_length() -> None:
    word = dubins_paths((0, 0, 0), (0, 3, math.pi), R)[0]
    ((_, points),) = word.sample(0.01)
    assert np.hypot(*np.diff(points, axis=0).T).sum() == pytest.approx(word.length_m, abs=1e-4)


def test_outline_stays_within_its_sagitta() -> None:
    circle = Path((0, 0, 0), (Segment(2 * math.pi * R, 1 / R, 1),), "route")
    points = circle.outline(0.003)
    middles = 0.5 * (points[1:] + points[:-1])
    depth = R - np.hypot(middles[:, 0], middles[:, 1] - R)
    assert 0.0 < depth.max() <= 0.003


def test_joining_merges_equal_neighbours_and_drops_empty_segments() -> None:
    first = straight((0, 0, 0), 4.0)
    second = make_path((4, 0, 0), [Segment(3.0, 0.0, 1), Segment(0.0, 0.25, 1), Segment(2.0, 0.0, -1)], "route")
    path = join((first, second), "route")
    assert path.segments == (Segment(7.0, 0.0, 1), Segment(2.0, 0.0, -1))
    assert path.length_m == 9.0 and path.reverse_m == 2.0 and path.reversals == 1
    assert path.end == (5.0, 0.0, 0.0)


def test_a_path_without_segments_stays_where_it_is() -> None:
    path = straight((1, 2, 0.5), 0.0)
    assert path.segments == () and path.end == (1, 2, 0.5) and path.sample() == []
    assert path.outline().tolist() == [[1, 2]]


@pytest.mark.parametrize("radius", [0.0, -4.0, math.nan, math.inf])
@pytest.mark.parametrize("words_of", [dubins_paths, three_arc, back_straight])
def test_radius_that_is_not_one_is_refused(words_of, radius: float) -> None:
    with pytest.raises(TurnError, match="must be above zero and finite; give the tractor"):
        words_of((0, 0, 0), (1, 1, 1), radius)


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan])
def test_step_that_is_not_one_is_refused(step: float) -> None:
    with pytest.raises(TurnError, match="Sampling step"):
        straight((0, 0, 0), 1.0).sample(step)
