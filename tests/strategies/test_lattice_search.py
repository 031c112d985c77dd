"""Ways exist wherever the free region leads through: over the lattice too, forwards, and with little reversing."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon, box
from shapely.ops import nearest_points

from strategies.path_planning.connector import Connector, TurnCosts
from strategies.path_planning.lattice_search import LatticeGrid, find_lattice_route, measure_remaining_m
from strategies.path_planning.paths import DrivePath, Pose, join_paths, make_straight_path, measure_longest_reverse_m
from strategies.path_planning.route_ends import MAX_OUTSIDE_M, list_straights_inside
from strategies.path_planning.route_search import EndMoves, RoutePoses
from tests.examples import count_examples

R = 4.0
COSTS = TurnCosts(speed_mps=2.0, reverse_speed_mps=1.0, cusp_s=5.0)
FORWARDS = ("u", "omega")
TWO_LENGTHS_M = 10.2
QUICK = settings(max_examples=count_examples(40))
places = st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-math.pi, math.pi))


def assert_drivable(path: DrivePath | None, a: Pose, b: Pose, free: shapely.Geometry) -> DrivePath:
    assert path is not None
    assert path.start == a and math.dist(path.end[:2], b[:2]) <= 1e-7
    assert abs(math.remainder(path.end[2] - b[2], 2.0 * math.pi)) <= 1e-7
    assert all(abs(segment.curvature) <= (1.0 + 1e-9) / R for segment in path.segments)
    for _, points in path.sample(0.1):
        assert free.buffer(0.0101).covers(LineString(points))
    return path


@st.composite
def star_fields(draw: st.DrawFn) -> Polygon:
    """A field round the origin with 5 to 12 corners 25 to 110 m off, and up to three round obstacles."""
    corners = draw(st.lists(st.floats(25.0, 110.0), min_size=5, max_size=12))
    angles = np.linspace(0.0, 2.0 * math.pi, len(corners), endpoint=False)
    field = Polygon(np.column_stack([corners * np.cos(angles), corners * np.sin(angles)]))
    for x, y, radius in draw(st.lists(st.tuples(*[st.floats(-60.0, 60.0)] * 2, st.floats(2.0, 15.0)), max_size=3)):
        field = field.difference(Point(x, y).buffer(radius, quad_segs=2))
    return field


@st.composite
def headland_bands(draw: st.DrawFn) -> Polygon:
    """The headland of a field with 3 to 8 corners, 2.2 to 4 radii wide."""
    corners = draw(st.lists(st.floats(60.0, 150.0), min_size=3, max_size=8))
    angles = np.linspace(0.0, 2.0 * math.pi, len(corners), endpoint=False)
    field = Polygon(np.column_stack([corners * np.cos(angles), corners * np.sin(angles)]))
    return field.difference(field.buffer(-draw(st.floats(2.2, 4.0)) * R, join_style="mitre"))


def place_pose(room: shapely.Geometry, place: tuple[float, float, float]) -> Pose:
    """The pose at shares of the extent of a room, moved into it."""
    west, south, east, north = room.bounds
    spot = Point(west + place[0] * (east - west), south + place[1] * (north - south))
    inside = nearest_points(room, spot)[0]
    return inside.x, inside.y, place[2]


@given(free=st.one_of(star_fields(), headland_bands()), ends=st.tuples(places, places))
@QUICK
def test_a_way_leads_between_poses_with_room_of_one_region(free: Polygon, ends: tuple[Pose, Pose]) -> None:
    # With 0.6 radii to either side all along, and reversing of two machine lengths.
    room = max(shapely.get_parts(free.buffer(-0.6 * R)).tolist(), key=lambda part: part.area)
    a, b = (place_pose(room, place) for place in ends)
    path = assert_drivable(Connector(free, R, COSTS, max_reverse_m=TWO_LENGTHS_M).connect(a, b), a, b, free)
    assert measure_longest_reverse_m(path) <= TWO_LENGTHS_M + 1e-6


@given(free=st.one_of(star_fields(), headland_bands()), ends=st.tuples(places, places))
@QUICK
def test_with_two_radii_of_room_a_way_leads_forwards(free: Polygon, ends: tuple[Pose, Pose]) -> None:
    core = free.buffer(-2.0 * R)
    assume(not core.is_empty)
    room = max(shapely.get_parts(core).tolist(), key=lambda part: part.area)
    assume(room.area > 1.0)
    a, b = (place_pose(room, place) for place in ends)
    assert assert_drivable(Connector(free, R, COSTS, FORWARDS).connect(a, b), a, b, free).reverse_m == 0.0


def search(free: Polygon, a: Pose, b: Pose, reverse_m: float = 0.0) -> DrivePath | None:
    """The route over the lattice alone."""
    guard = free.buffer(0.007)
    edges = np.concatenate(
        [np.hstack([ring[:-1], ring[1:]]) for ring in (np.array(r.coords) for r in (guard.exterior, *guard.interiors))]
    )
    begin, end = (
        EndMoves([make_straight_path(pose, 0.0)], RoutePoses.from_poses([pose]), np.zeros(1)) for pose in (a, b)
    )
    grid = LatticeGrid.from_region(guard, R)
    return find_lattice_route(begin, end, grid, R, COSTS.speeds, edges, reverse_m)


# A serpentine of lanes 6 m wide, joined at alternate ends by yards that are just wide enough to turn in.
SERPENTINE = box(0, 0, 80, 46).difference(shapely.union_all([box(0, 12, 66, 15), box(14, 29, 80, 32)]))


def test_the_lattice_leads_through_a_serpentine() -> None:
    a, b = (10.0, 6.0, 0.0), (70.0, 39.0, 0.0)
    path = assert_drivable(search(SERPENTINE, a, b), a, b, SERPENTINE)
    assert path.reverse_m == 0.0
    corners = [a[:2], (66.0, 12.0), (66.0, 15.0), (14.0, 29.0), (14.0, 32.0), b[:2]]
    taut_m = sum(math.dist(p, q) for p, q in pairwise(corners))
    assert taut_m <= path.length_m <= taut_m + 2.0 * R


def test_the_lattice_turns_round_in_a_lane_by_reversing() -> None:
    lane = box(0, 0, 80, 6)
    a, b = (30.0, 3.0, 0.0), (50.0, 3.0, math.pi)
    assert search(lane, a, b) is None
    path = assert_drivable(search(lane, a, b, reverse_m=TWO_LENGTHS_M), a, b, lane)
    assert 0.0 < path.reverse_m <= TWO_LENGTHS_M + 1e-6


def test_a_straight_way_is_straight() -> None:
    a, b = (10.0, 6.0, 0.0), (60.0, 6.0, 0.0)
    assert assert_drivable(search(SERPENTINE, a, b), a, b, SERPENTINE).length_m == pytest.approx(50.0, abs=1e-6)


def test_the_lattice_repeats_itself() -> None:
    a, b = (10.0, 6.0, 0.5), (70.0, 39.0, -0.5)
    assert search(SERPENTINE, a, b) == search(SERPENTINE, a, b)


def test_remaining_metres_lead_round_what_is_not_free() -> None:
    is_free = np.ones((5, 5), dtype=bool)
    is_free[2, :4] = False  # a wall with a gap at the top
    remaining = measure_remaining_m(np.array([[4.0, 0.0, 0.0]]), is_free, 0.0, 0.0, 1.0)
    # From (0, 0): up to (1, 3) and through the gap at (2, 4), down to (4, 0).
    straight, diagonal = 2 + 2, 2 + 2
    assert remaining[4, 0] == 0.0 and np.isinf(remaining[2, 0])
    assert remaining[0, 0] == pytest.approx(straight + diagonal * math.sqrt(2.0))


class TestReverseLimit:
    LANE = box(0, 0, 200, 0.4)  # nowhere wide enough to turn round

    def test_a_long_reverse_is_no_usual_way(self) -> None:
        a, b = (150.0, 0.2, 0.0), (50.0, 0.2, 0.0)
        connector = Connector(self.LANE, R, COSTS, max_reverse_m=TWO_LENGTHS_M)
        assert connector.connect(a, b) is None
        path = assert_drivable(connector.connect_in_reverse(a, b), a, b, self.LANE)
        assert path.reverse_m >= 100.0

    def test_forward_round_the_headland_although_it_is_longer(self) -> None:
        ring = box(0, 0, 120, 120).difference(box(12, 12, 108, 108))
        a, b = (100.0, 6.0, 0.0), (50.0, 6.0, 0.0)  # 50 m straight back
        free = Connector(ring, R, COSTS, max_reverse_m=TWO_LENGTHS_M).connect(a, b)
        assert measure_longest_reverse_m(assert_drivable(free, a, b, ring)) <= TWO_LENGTHS_M

    def test_without_reversing_there_is_none_in_reverse_either(self) -> None:
        assert Connector(self.LANE, R, COSTS, FORWARDS).connect_in_reverse((150.0, 0.2, 0.0), (50.0, 0.2, 0.0)) is None

    def test_the_longest_reverse_is_that_without_a_change_of_direction(self) -> None:
        path = join_paths(
            [make_straight_path((0.0, 0.0, 0.0), -3.0), make_straight_path((-3.0, 0.0, 0.0), 10.0)], "route"
        )
        path = join_paths([path, make_straight_path(path.end, -7.0)], "route")
        assert (path.reverse_m, measure_longest_reverse_m(path)) == (10.0, 7.0)


class TestEndsOutside:
    FREE = box(0, 0, 100, 40)

    def test_a_swath_end_a_little_outside_is_joined(self) -> None:
        # At a sharp angle over the southern edge, 0.1 m outside: the tractor must back up to turn.
        a, b = (50.0, -0.1, -0.3), (20.0, 20.0, math.pi)
        path = Connector(self.FREE, R, COSTS, max_reverse_m=TWO_LENGTHS_M).connect(a, b)
        assert path is not None and path.start == a and 0.0 < path.reverse_m <= TWO_LENGTHS_M
        assert self.FREE.buffer(0.11).covers(LineString(np.concatenate([points for _, points in path.sample(0.1)])))

    def test_ahead_and_back(self) -> None:
        ahead, back = (
            list_straights_inside((50.0, -0.1, heading), self.FREE, R, TWO_LENGTHS_M)
            for heading in (math.pi / 2, -math.pi / 2)
        )
        assert [(path.length_m, path.reverse_m) for path in (*ahead, *back)] == [(0.25, 0.0), (0.25, 0.25)]

    def test_from_within_nothing_is_needed_and_far_outside_nothing_helps(self) -> None:
        (path,) = list_straights_inside((50.0, 1.0, 0.0), self.FREE, R, TWO_LENGTHS_M)
        assert path.length_m == 0.0
        assert list_straights_inside((50.0, -1.01 * MAX_OUTSIDE_M, 1.0), self.FREE, R, TWO_LENGTHS_M) == []
