"""Boxes and the straight segments of lines, against shapely."""

import math
from itertools import pairwise

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.path_planning.collision_check import (
    MachineBody,
    has_box_within_distance,
    has_contact,
    list_segments,
    measure_segment_to_box,
)
from strategies.path_planning.paths import DrivePath, PathSegment, merge_segments
from tests.examples import count_examples

place = st.floats(-6.0, 6.0).map(lambda metres: round(metres, 6))  # shapes know nothing of numbers near to none
pieces = st.lists(
    st.tuples(st.floats(0.1, 60.0), st.sampled_from([-0.2, -0.05, 0.0, 0.03, 0.2]), st.sampled_from([1, 1, -1])),
    min_size=1,
    max_size=5,
)
BODY, SPARE_M, STEP_M = MachineBody(((-1.0, 3.0, 1.0), (-2.0, -1.0, 2.5)), 0.8), 0.3, 0.5


@given(st.tuples(place, place), st.tuples(place, place), st.floats(-3.0, 0.0), st.floats(0.1, 3.0), st.floats(0.1, 2.0))
def test_a_segment_is_as_far_from_a_box_as_their_shapes_are(
    a: tuple[float, float], b: tuple[float, float], low: float, high: float, half: float
) -> None:
    line = shapely.LineString([a, b]) if a != b else shapely.Point(a)
    expected = shapely.distance(line, shapely.box(low, -half, high, half))
    assert math.isclose(measure_segment_to_box(*a, *b, low, high, half), expected, abs_tol=1e-9)


def test_a_segment_through_a_box_or_along_its_side_meets_it() -> None:
    assert measure_segment_to_box(-5.0, 0.5, 5.0, 0.5, -1.0, 1.0, 1.0) == 0.0
    assert measure_segment_to_box(0.0, -5.0, 0.0, 5.0, -1.0, 1.0, 1.0) == 0.0
    assert measure_segment_to_box(-5.0, 1.0, 5.0, 1.0, -1.0, 1.0, 1.0) == 0.0
    assert measure_segment_to_box(-5.0, 3.0, 5.0, 3.0, -1.0, 1.0, 1.0) == 2.0
    assert measure_segment_to_box(4.0, 5.0, 4.0, 5.0, -1.0, 1.0, 1.0) == 5.0


def test_lines_are_cut_into_segments_that_join_no_two_of_them() -> None:
    lines = shapely.MultiLineString([[(0, 0), (1, 0), (1, 2)], [(5, 5), (6, 5)]])
    assert list_segments(lines).tolist() == [[0, 0, 1, 0], [1, 0, 1, 2], [5, 5, 6, 5]]
    assert list_segments(shapely.LineString()).shape == (0, 4)
    assert len(list_segments(shapely.box(0, 0, 2, 2).exterior)) == 4


@given(place, place, st.floats(-3.2, 3.2))
def test_a_machine_that_stands_is_near_where_its_boxes_are(x: float, y: float, heading: float) -> None:
    boxes = np.array([[-1.0, 3.0, 1.0], [-2.0, -1.0, 1.5]])
    line = shapely.LineString([(-3.0, 4.0), (0.0, 2.0), (5.0, 4.5)])
    turned = [shapely.affinity.rotate(shapely.box(a, -w, b, w), heading, (0, 0), use_radians=True) for a, b, w in boxes]
    away = min(shapely.distance(shapely.affinity.translate(box, x, y), line) for box in turned)
    segments = list_segments(line)
    near = has_box_within_distance(x, y, heading, boxes, segments, np.arange(len(segments)), len(segments), 3.7, 0.3)
    assert near == (away <= 0.3) or abs(away - 0.3) < 1e-9


def poses_of_axle(path: DrivePath) -> np.ndarray:
    """Poses of the rear axle on a way, shape (n, 3): it trails the guided point, and keeps to the way in reverse."""
    x, y, heading = path.start
    poses = [(x - BODY.guide_m * math.cos(heading), y - BODY.guide_m * math.sin(heading), heading)]
    for gear, points in path.sample(STEP_M):
        for before, here in pairwise(points):
            dx, dy = before - here if gear < 0 else here - poses[-1][:2]
            angle = math.atan2(dy, dx)
            x, y = here - BODY.guide_m * np.array([math.cos(angle), math.sin(angle)])
            poses.append((x, y, angle))
    return np.array(poses)


@settings(max_examples=count_examples(200))
@given(pieces, st.integers(0, 2**32 - 1), st.integers(1, 60), st.floats(1.0, 25.0))
def test_a_path_touches_where_any_box_on_it_is_near_any_segment(
    drawn: list, seed: int, count: int, long_m: float
) -> None:
    path = merge_segments((0.0, 0.0, 0.4), [PathSegment(*one) for one in drawn], "turn")
    rng, poses = np.random.default_rng(seed), poses_of_axle(path)
    first = poses[rng.integers(len(poses), size=count), :2] + rng.uniform(-30.0, 30.0, (count, 2))
    lines = shapely.linestrings(np.stack([first, first + rng.uniform(-long_m, long_m, (count, 2))], axis=1))
    away = shapely.distance(BODY.place_boxes(poses)[:, None], lines).min(axis=0)
    for some in (lines, lines[away > SPARE_M]):
        if not len(some) or min(abs(away - SPARE_M)) < 1e-6:
            continue
        ends, boxes, segments = np.array([path.start, path.end]), np.array(BODY.boxes), list_segments(some)
        found = has_contact(ends, path.to_rows(), boxes, segments, BODY.guide_m, BODY.reach_m, SPARE_M, STEP_M)
        assert found == (min(shapely.distance(BODY.place_boxes(poses)[:, None], some).min(axis=0)) <= SPARE_M)
