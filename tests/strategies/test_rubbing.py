"""Boxes and the straight stretches of lines, against shapely."""

import math

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from strategies.ways.rubbing import boxes_near, stretch_to_box, stretches_of

place = st.floats(-6.0, 6.0)


@given(st.tuples(place, place), st.tuples(place, place), st.floats(-3.0, 0.0), st.floats(0.1, 3.0), st.floats(0.1, 2.0))
def test_a_stretch_is_as_far_from_a_box_as_their_shapes_are(
    a: tuple[float, float], b: tuple[float, float], low: float, high: float, half: float
) -> None:
    line = shapely.LineString([a, b]) if a != b else shapely.Point(a)
    expected = shapely.distance(line, shapely.box(low, -half, high, half))
    assert math.isclose(stretch_to_box(*a, *b, low, high, half), expected, abs_tol=1e-9)


def test_a_stretch_through_a_box_or_along_its_side_meets_it() -> None:
    assert stretch_to_box(-5.0, 0.5, 5.0, 0.5, -1.0, 1.0, 1.0) == 0.0
    assert stretch_to_box(0.0, -5.0, 0.0, 5.0, -1.0, 1.0, 1.0) == 0.0
    assert stretch_to_box(-5.0, 1.0, 5.0, 1.0, -1.0, 1.0, 1.0) == 0.0
    assert stretch_to_box(-5.0, 3.0, 5.0, 3.0, -1.0, 1.0, 1.0) == 2.0
    assert stretch_to_box(4.0, 5.0, 4.0, 5.0, -1.0, 1.0, 1.0) == 5.0


def test_lines_are_cut_into_stretches_that_join_no_two_of_them() -> None:
    lines = shapely.MultiLineString([[(0, 0), (1, 0), (1, 2)], [(5, 5), (6, 5)]])
    assert stretches_of(lines).tolist() == [[0, 0, 1, 0], [1, 0, 1, 2], [5, 5, 6, 5]]
    assert stretches_of(shapely.LineString()).shape == (0, 4)
    assert len(stretches_of(shapely.box(0, 0, 2, 2).exterior)) == 4


@given(place, place, st.floats(-3.2, 3.2))
def test_a_machine_that_stands_is_near_where_its_boxes_are(x: float, y: float, heading: float) -> None:
    boxes = np.array([[-1.0, 3.0, 1.0], [-2.0, -1.0, 1.5]])
    line = shapely.LineString([(-3.0, 4.0), (0.0, 2.0), (5.0, 4.5)])
    turned = [shapely.affinity.rotate(shapely.box(a, -w, b, w), heading, (0, 0), use_radians=True) for a, b, w in boxes]
    away = min(shapely.distance(shapely.affinity.translate(box, x, y), line) for box in turned)
    stretches = stretches_of(line)
    near = boxes_near(x, y, heading, boxes, stretches, np.arange(len(stretches)), len(stretches), 3.7, 0.3)
    assert near == (away <= 0.3) or abs(away - 0.3) < 1e-9
