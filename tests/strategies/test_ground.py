"""Ground as signed distances: hand-computed places, and random regions against shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.path_planning.machine_body import MachineBody
from strategies.site.ground import (
    build_ground,
    get_distance,
    has_room_on_path,
    measure_length_inside,
    measure_rooms,
)

CAP_M = 6.0
FIELD = shapely.box(0.0, 0.0, 60.0, 40.0)
OUTLINE = MachineBody(((-3.0, 2.0, 1.5),), 1.0)


@pytest.mark.parametrize(
    ("place", "distance_m"), [((30.0, 20.0), CAP_M), ((2.0, 20.0), 2.0), ((-1.5, 20.0), -1.5), ((200.0, 0.0), -CAP_M)]
)
def test_distances_of_a_rectangle(place: tuple[float, float], distance_m: float) -> None:
    ground = build_ground(FIELD, CAP_M)
    assert get_distance(*place, ground.grid, ground.frame) == pytest.approx(distance_m, abs=1e-6)


def test_a_hole_is_outside() -> None:
    ground = build_ground(FIELD - shapely.box(20.0, 10.0, 30.0, 20.0), CAP_M)
    assert get_distance(25.0, 15.0, ground.grid, ground.frame) == pytest.approx(-5.0)
    assert get_distance(33.0, 15.0, ground.grid, ground.frame) == pytest.approx(3.0)


@settings(max_examples=40, deadline=None)
@given(
    angles=st.lists(st.floats(0.0, 6.28), min_size=3, max_size=9, unique=True),
    radii=st.lists(st.floats(8.0, 30.0), min_size=9, max_size=9),
    places=st.lists(st.tuples(st.floats(-35.0, 35.0), st.floats(-35.0, 35.0)), min_size=1, max_size=20),
)
def test_distances_of_any_region_are_those_of_shapely(
    angles: list[float], radii: list[float], places: list[tuple[float, float]]
) -> None:
    ring = [(r * math.cos(a), r * math.sin(a)) for a, r in zip(sorted(angles), radii, strict=False)]
    region = shapely.make_valid(shapely.Polygon(ring)).buffer(0.5)
    ground = build_ground(region, CAP_M)
    for x, y in places:
        exact = shapely.distance(shapely.Point(x, y), region.boundary)
        exact = min(exact, CAP_M) if shapely.contains_xy(region, x, y) else -min(exact, CAP_M)
        found = get_distance(x, y, ground.grid, ground.frame)
        assert abs(exact) <= 0.36 or (found > 0.0) == (exact > 0.0)
        if exact > -1.5:  # the grid ends a little farther out
            assert found == pytest.approx(exact, abs=0.36)  # half the diagonal of a cell, at a corner


@pytest.mark.parametrize(("half_m", "parts"), [(2.0, [1, 1, 1, 0, 0, 0]), (4.5, [1, 2, 0, 0, 0, 0])])
def test_two_rooms_are_parts_for_what_the_passage_between_them_is_too_narrow_for(
    half_m: float, parts: list[int]
) -> None:
    """The passage is 6 m wide; a metre from an edge there is room for neither machine, and none far outside."""
    rooms = shapely.union_all([FIELD, shapely.box(59.0, 17.0, 76.0, 23.0), shapely.box(75.0, 0.0, 135.0, 40.0)])
    places = np.array([[30.0, 20.0], [105.0, 20.0], [67.5, 20.0], [1.0, 20.0], [-500.0, 20.0], [30.0, 4000.0]])
    assert build_ground(rooms, CAP_M).number_parts(half_m, places).tolist() == parts


def test_a_passage_a_little_wider_than_the_machine_joins() -> None:
    """Places are rounded to the grid, whose cells lie anyhow across the passage."""
    for shift in (0.0, 0.13, 0.31, 0.49):
        narrow = shapely.box(59.0, 15.4 + shift, 76.0, 24.6 + shift)
        rooms = shapely.union_all([FIELD, narrow, shapely.box(75.0, 0.0, 135.0, 40.0)])
        ground = build_ground(rooms, CAP_M)
        assert ground.number_parts(4.5, np.array([[30.0, 20.0], [105.0, 20.0]])).tolist() == [1, 1]


def test_room_of_a_body_beside_an_edge() -> None:
    ground = build_ground(FIELD, CAP_M)
    poses = np.array([[30.0, 5.0, 0.0], [30.0, 5.0, 0.5 * math.pi], [30.0, 1.0, 0.0]])
    rooms = measure_rooms(poses, 0.0, OUTLINE.points, OUTLINE.reach_m, ground.grid, ground.frame, CAP_M)
    assert rooms == pytest.approx([3.5, 2.0, -0.5], abs=1e-6)  # half its width; 3 m behind the axle; half its width


@settings(max_examples=60, deadline=None)
@given(
    angle=st.floats(-3.1, 3.1),
    place=st.tuples(st.floats(0.0, 60.0), st.floats(0.0, 40.0)),
    half_m=st.floats(0.5, 18.0),
    hole=st.tuples(st.floats(5.0, 50.0), st.floats(5.0, 30.0), st.floats(0.2, 6.0)),
)
def test_the_room_of_a_body_is_the_least_of_all_its_points(
    angle: float, place: tuple[float, float], half_m: float, hole: tuple[float, float, float]
) -> None:
    """Points that are skipped, as one beside them has far more room, have no less; far outside it does not matter."""
    x, y, size = hole
    ground = build_ground(FIELD - shapely.box(x, y, x + size, y + 0.3), 12.0)
    body = MachineBody(((-3.0, 2.0, 1.2), (-5.0, -4.0, half_m)), 1.0)
    tables = ground.grid, ground.frame
    room = measure_rooms(np.array([[*place, angle]]), 0.0, body.points, body.reach_m, *tables, 12.0)[0]
    ahead, left, _ = body.points.T
    points = np.column_stack(
        [
            place[0] + ahead * math.cos(angle) - left * math.sin(angle),
            place[1] + ahead * math.sin(angle) + left * math.cos(angle),
        ]
    )
    least = min(get_distance(*point, *tables) for point in points.tolist())
    assert max(room, -1.0) == pytest.approx(max(least, -1.0), abs=1e-9)


def test_a_path_has_room_until_the_nose_is_at_the_edge() -> None:
    ground = build_ground(FIELD, CAP_M)
    start = np.array([30.0, 20.0, 0.0])  # of the guided point, a metre behind the nose
    tables = OUTLINE.points, OUTLINE.reach_m, ground.grid, ground.frame
    reached = [
        has_room_on_path(start, np.array([[length, 0.0, 1.0]]), OUTLINE.guide_m, *tables, 0.1)
        for length in (28.8, 29.0)
    ]
    assert reached == [True, False]


def test_length_inside_counts_what_is_deep_enough() -> None:
    ground = build_ground(FIELD, CAP_M)
    rows = np.array([[20.0, 0.0, 1.0]])  # from 10 m outside to 10 m inside
    inside_m = measure_length_inside(np.array([-10.0, 20.0, 0.0]), rows, ground.grid, ground.frame, 2.0)
    assert inside_m == pytest.approx(8.0, abs=0.5)


def test_empty_ground_is_nowhere() -> None:
    ground = build_ground(shapely.Polygon(), CAP_M)
    assert get_distance(0.1, 0.1, ground.grid, ground.frame) == pytest.approx(-CAP_M)
