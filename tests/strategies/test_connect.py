"""The connector: costs, the choice between turns, staying inside, and routes."""

import math
import random
import time
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import LineString, MultiPoint, Point, Polygon, box

from strategies.path_planning.connector import Connector, TurnCosts, _list_boundary_edges
from strategies.path_planning.paths import DrivePath, PathSegment, Pose, TurnError, make_straight_path
from strategies.path_planning.primitive_search import find_fitting_forward, find_fitting_in_room, measure_room_m
from strategies.path_planning.route_search import (
    APART,
    UNCHECKED,
    UNKNOWN,
    RouteLayers,
    RoutePoses,
    can_rings_connect,
    compute_link_s,
    find_quickest_chain,
    link_layers,
)
from strategies.path_planning.turn_kinds import TURN_KINDS
from strategies.path_planning.turns import build_fishtail, build_omega_turn, build_switch_back, build_u_turn
from strategies.path_planning.visibility_graph import VisibilityGraph, list_corner_poses, list_ring_poses
from tests.examples import count_examples
from tests.strategies.primitive_paths import find_dubins_paths

R = 4.0
COSTS = TurnCosts(speed_mps=2.0, reverse_speed_mps=1.0, cusp_s=5.0)
UP, DOWN = math.pi / 2, -math.pi / 2
SQUARE = box(0, 0, 100, 100)
ELL = Polygon([(0, 0), (120, 0), (120, 30), (30, 30), (30, 120), (0, 120)])
HOLED = Polygon(box(0, 0, 160, 100).exterior, [box(60, 30, 100, 70).exterior.coords])
# A lane too narrow to turn in, with a yard to the north of its west end.
BLIND = Polygon([(0, 0), (80, 0), (80, 6), (40, 6), (40, 40), (0, 40)])


def line(path: DrivePath, step: float = 0.1) -> LineString:
    return LineString(np.concatenate([points for _, points in path.sample(step)]))


def assert_good(path: DrivePath | None, a: Pose, b: Pose, free: shapely.Polygon) -> None:
    assert path is not None
    assert path.start == a
    assert math.dist(path.end[:2], b[:2]) <= 1e-8
    assert abs(math.remainder(path.end[2] - b[2], 2 * math.pi)) <= 1e-8
    assert all(abs(s.curvature) <= 1 / R * (1 + 1e-9) for s in path.segments)
    assert free.buffer(0.0101).covers(line(path))


def turn_in(headland_m: float, spacing: float, costs: TurnCosts = COSTS, **options) -> DrivePath | None:
    """The turn at y = 50 between upward and downward tracks, with so much room above."""
    free = box(0, 0, 100, 50 + headland_m)
    a, b = (40.0, 50.0, UP), (40.0 + spacing, 50.0, DOWN)
    path = Connector(free, R, costs, **options).connect(a, b)
    if path is not None:
        assert_good(path, a, b, free)
    return path


def test_time_counts_speeds_and_direction_changes() -> None:
    path = DrivePath(
        (0, 0, 0), (PathSegment(6, 0.0, 1), PathSegment(3, 0.1, -1), PathSegment(2, 0.0, 1)), "switch-back"
    )
    assert COSTS.compute_time_s(path) == pytest.approx((6 + 2) / 2 + 3 / 1 + 2 * 5)


def test_a_path_that_ends_in_reverse_is_charged_the_change_after_it() -> None:
    assert COSTS.compute_time_s(make_straight_path((0, 0, 0), 4.0)) == 2.0
    assert COSTS.compute_time_s(make_straight_path((0, 0, 0), -4.0)) == 4.0 + 2 * 5
    assert COSTS.compute_time_s(make_straight_path((0, 0, 0), 0.0)) == 0.0


def test_u_turn_when_tracks_are_far_enough() -> None:
    path = turn_in(20.0, 9.0)
    assert path.kind == "u"
    assert path.length_m == pytest.approx(build_u_turn((40, 50, UP), (49, 50, DOWN), R).length_m, abs=1e-9)


def test_omega_when_a_direction_change_is_dear() -> None:
    path = turn_in(20.0, 3.0)
    assert path.kind == "omega"
    assert path.length_m == pytest.approx(build_omega_turn((40, 50, UP), (43, 50, DOWN), R).length_m, abs=1e-9)


def test_switch_back_when_a_direction_change_is_cheap() -> None:
    path = turn_in(20.0, 3.0, TurnCosts(2.0, 2.0, 1.0))
    assert path.kind == "switch-back"
    assert path.length_m == pytest.approx(build_fishtail((40, 50, UP), (43, 50, DOWN), R).length_m, abs=1e-9)


def test_reversing_on_an_arc_is_charged_although_it_is_shorter() -> None:
    a, b = (40.0, 50.0, UP), (43.0, 50.0, DOWN)
    connector = Connector(SQUARE, R, TurnCosts(2.0, 2.0, 1.0))
    tail, arcs = build_fishtail(a, b, R), build_switch_back(a, b, R)
    assert arcs.length_m < tail.length_m
    assert connector.compute_cost_s(tail) == pytest.approx(connector.costs.compute_time_s(tail))
    assert connector.compute_cost_s(arcs) > connector.compute_cost_s(tail)


def test_the_change_from_omega_to_switch_back_is_where_their_times_meet() -> None:
    omega, back = (make((40, 50, UP), (43, 50, DOWN), R) for make in (build_omega_turn, build_fishtail))
    free_cusp = TurnCosts(2.0, 2.0, 0.0)
    meet = (free_cusp.compute_time_s(omega) - free_cusp.compute_time_s(back)) / 2
    assert meet > 0
    assert turn_in(20.0, 3.0, TurnCosts(2.0, 2.0, meet - 0.01)).kind == "switch-back"
    assert turn_in(20.0, 3.0, TurnCosts(2.0, 2.0, meet + 0.01)).kind == "omega"


def test_headland_between_the_two_depths_forces_the_switch_back() -> None:
    assert turn_in(9.82, 3.0).kind == "omega"
    assert turn_in(9.78, 3.0).kind != "omega" or turn_in(9.78, 3.0).length_m > 25.58
    assert turn_in(5.0, 3.0, TurnCosts(2.0, 2.0, 5.0)).kind == "switch-back"


def test_kinds_left_out_are_not_driven() -> None:
    assert turn_in(20.0, 3.0, kinds=("u", "switch-back")).kind == "switch-back"
    cheap = TurnCosts(2.0, 2.0, 0.0)
    assert turn_in(20.0, 3.0, cheap, kinds=("u", "omega")).reversals == 0


def test_without_reversing_nothing_fits_a_narrow_headland_unless_there_is_a_way_round() -> None:
    path = turn_in(5.0, 3.0, kinds=("u", "omega"))
    assert path is None or path.reversals == 0
    assert Connector(box(0, 0, 60, 6), R, COSTS, kinds=("u", "omega")).connect((20, 3, 0.0), (40, 3, math.pi)) is None


def test_skewed_ends_are_connected_inside() -> None:
    free = Polygon([(0, 0), (100, 0), (100, 90), (0, 60)])
    for spacing in (3.0, 6.0, 9.0):
        a = (40.0, 72 - 11.0, UP)
        b = (40.0 + spacing, 72 - 11.0 + 0.3 * spacing, DOWN)
        assert_good(Connector(free, R, COSTS).connect(a, b), a, b, free)


@pytest.mark.slow
def test_the_quickest_of_the_fitting_primitives_is_taken() -> None:
    connector = Connector(SQUARE, R, COSTS)
    draw = random.Random(4)
    for _ in range(40):
        a, b = ((draw.uniform(20, 80), draw.uniform(20, 80), draw.uniform(-3, 3)) for _ in range(2))
        path = connector.connect(a, b)
        fitting = [COSTS.compute_time_s(w) for w in find_dubins_paths(a, b, R) if connector.fits(w)]
        assert COSTS.compute_time_s(path) <= min(fitting) + 1e-6


@given(
    st.floats(30.0, 200.0),
    st.floats(30.0, 200.0),
    st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4),
    st.lists(st.floats(-math.pi, math.pi), min_size=2, max_size=2),
)
@settings(max_examples=count_examples(60))
def test_any_two_poses_of_a_rectangle_are_connected_inside_it(width, height, shares, headings) -> None:
    free = box(0, 0, width, height)
    a = (shares[0] * width, shares[1] * height, headings[0])
    b = (shares[2] * width, shares[3] * height, headings[1])
    path = Connector(free, R, COSTS).connect(a, b)
    if path is None:
        # Only a pose that drives at a wall, or away from one, with no room to do either may be refused.
        assert min(free.exterior.distance(Point(p[:2])) for p in (a, b)) < R
    elif path.segments:
        assert_good(path, a, b, free)


@pytest.mark.parametrize("free", [ELL, HOLED, BLIND], ids=["ell", "holed", "blind"])
def test_random_poses_with_room_are_connected(free: Polygon) -> None:
    connector, draw = Connector(free, R, COSTS), random.Random(7)
    left, low, right, high = free.bounds
    room, poses = free.buffer(-2.5), []
    while len(poses) < 24:
        spot = (draw.uniform(left, right), draw.uniform(low, high))
        if room.contains(Point(spot)):
            poses.append((*spot, draw.uniform(-math.pi, math.pi)))
    for a, b in zip(poses[::2], poses[1::2], strict=True):
        assert_good(connector.connect(a, b), a, b, free)


def test_route_through_an_ell_is_little_longer_than_the_shortest_way() -> None:
    a, b = (110.0, 15.0, math.pi), (15.0, 110.0, UP)
    path = Connector(ELL, R, COSTS).connect(a, b)
    assert_good(path, a, b, ELL)
    taut = math.dist(a[:2], (30, 30)) + math.dist((30, 30), b[:2])
    assert path.kind == "route" and path.reversals == 0
    assert taut <= path.length_m <= taut + R


def test_route_round_a_hole_is_little_longer_than_the_shortest_way() -> None:
    a, b = (20.0, 48.0, 0.0), (140.0, 48.0, 0.0)
    path = Connector(HOLED, R, COSTS).connect(a, b)
    assert_good(path, a, b, HOLED)
    taut = math.dist(a[:2], (60, 30)) + 40 + math.dist((100, 30), b[:2])
    assert path.kind == "route" and path.reversals == 0
    assert taut <= path.length_m <= taut + R


def test_turning_round_in_a_lane_reverses_when_allowed() -> None:
    free = box(0, 0, 60, 7)
    a, b = (20.0, 3.5, 0.0), (40.0, 3.5, math.pi)
    path = Connector(free, R, COSTS).connect(a, b)
    assert_good(path, a, b, free)
    assert path.reversals > 0


def test_lane_without_reversing_is_left_to_turn_in_the_yard() -> None:
    a, b = (70.0, 3.0, math.pi), (60.0, 3.0, 0.0)
    path = Connector(BLIND, R, COSTS, kinds=("u", "omega")).connect(a, b)
    assert_good(path, a, b, BLIND)
    assert path.reversals == 0
    assert line(path).bounds[0] < 40.0


def test_parts_that_do_not_touch_are_not_connected() -> None:
    free = shapely.union(box(0, 0, 50, 50), box(60, 0, 110, 50))
    connector = Connector(free, R, COSTS)
    assert connector.connect((25, 25, 0.0), (85, 25, 0.0)) is None
    assert connector.connect((25, 25, 0.0), (25, 40, math.pi)) is not None


def test_a_pose_outside_is_not_connected() -> None:
    assert Connector(SQUARE, R, COSTS).connect((50, 50, 0.0), (101, 50, 0.0)) is None


def test_a_pose_on_the_edge_is_connected() -> None:
    a, b = (50.0, 0.0, 0.0), (50.0, 100.0, math.pi)
    assert_good(Connector(SQUARE, R, COSTS).connect(a, b), a, b, SQUARE)


@pytest.mark.parametrize(
    ("free", "a", "b"),
    [
        (SQUARE, (40.0, 88.0, UP), (43.0, 88.0, DOWN)),
        (SQUARE, (40.0, 94.0, UP), (43.0, 95.5, DOWN)),
        (SQUARE, (10.0, 20.0, 0.3), (80.0, 70.0, 2.0)),
        (ELL, (110.0, 15.0, math.pi), (15.0, 110.0, UP)),
        (HOLED, (20.0, 47.0, 0.0), (140.0, 44.0, 0.0)),
    ],
)
def test_mirror_image_in_mirror_image_out(free: Polygon, a: Pose, b: Pose) -> None:
    mirror_free = shapely.transform(free, lambda xy: xy * (-1.0, 1.0))
    mirror_a, mirror_b = ((-p[0], p[1], math.pi - p[2]) for p in (a, b))
    path = Connector(free, R, COSTS).connect(a, b)
    image = Connector(mirror_free, R, COSTS).connect(mirror_a, mirror_b)
    assert [s.gear for s in image.segments] == [s.gear for s in path.segments]
    assert [s.length_m for s in image.segments] == pytest.approx([s.length_m for s in path.segments], abs=1e-6)
    assert [s.curvature for s in image.segments] == pytest.approx([-s.curvature for s in path.segments], abs=1e-9)


def test_same_input_same_output_whatever_was_asked_before() -> None:
    a, b = (20.0, 48.0, 0.0), (140.0, 48.0, 0.0)
    fresh, used = Connector(HOLED, R, COSTS), Connector(HOLED, R, COSTS)
    used.connect((10, 10, 0.0), (150, 90, 0.0))
    used.connect(b, a)
    assert fresh.connect(a, b) == used.connect(a, b)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: TurnCosts(0.0, 1.0, 1.0), "speed_mps 0.0 must be above zero"),
        (lambda: TurnCosts(1.0, math.inf, 1.0), "reverse_speed_mps inf must be above zero and finite"),
        (lambda: TurnCosts(1.0, 1.0, -1.0), "cusp_s -1.0 must be zero or more"),
        (lambda: Connector(Polygon(), R, COSTS), "No room is left"),
        (lambda: Connector(SQUARE, 0.0, COSTS), "Turning radius 0.0 m"),
        (lambda: Connector(SQUARE, R, COSTS, kinds=("u", "loop")), 'Turn kind "loop" is unknown'),
    ],
)
def test_values_that_make_no_sense_are_refused(make, says: str) -> None:
    with pytest.raises(TurnError, match=says):
        make()


def test_ways_round_a_hole_are_the_two_taut_strings() -> None:
    corners = VisibilityGraph(HOLED, HOLED.buffer(0.007))
    paths = corners.find_shortest_lines((20.0, 45.0, 0.0), (140.0, 45.0, 0.0))
    lengths = [sum(math.dist(p, q) for p, q in pairwise(way)) for way in paths]
    below, above = (2 * math.hypot(40 - 0.25, abs(45 - y)) + 40.5 for y in (29.75, 70.25))
    assert lengths[0] == pytest.approx(below, abs=1e-9)
    assert any(length == pytest.approx(above, abs=1e-9) for length in lengths)
    assert lengths == sorted(lengths)


def test_a_straight_way_is_one_way() -> None:
    assert VisibilityGraph(SQUARE, SQUARE).find_shortest_lines((10, 10, 0.0), (90, 50, 0.0)) == [[(10, 10), (90, 50)]]


def test_sight_follows_a_bend_too_gentle_for_a_corner() -> None:
    # An arc-shaped lane of radius 300 m, 8 m wide: its outline turns by one degree per vertex.
    turn = np.radians(np.arange(0, 91))
    ring = np.column_stack((np.cos(turn), np.sin(turn)))
    lane = Polygon(np.concatenate((304 * ring, 296 * ring[::-1])))
    a, b = (300.0, 1.0, UP), (1.0, 300.0, math.pi)
    path = Connector(lane, R, COSTS).connect(a, b)
    assert_good(path, a, b, lane)
    assert 296 * math.pi / 2 - 5 < path.length_m < 300 * math.pi / 2 + 5


def test_corner_poses_pass_outside_the_bend() -> None:
    poses = list_corner_poses((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), R)
    assert poses[0] == pytest.approx((10.0, 0.0, math.pi / 4))
    for x, y, heading in poses:
        assert (x - 10.0) >= -1e-9 and y <= 1e-9  # to the right of a left bend
        assert -1e-9 <= heading <= math.pi / 2 + 1e-9


def test_ring_poses_lie_inside_and_come_in_both_headings() -> None:
    poses = list_ring_poses(HOLED, R)
    assert all(HOLED.covers(Point(pose[:2])) for pose in poses)
    headings: dict[tuple[float, float], list[float]] = {}
    for x, y, heading in poses:
        headings.setdefault((x, y), []).append(heading)
    for forth, back in headings.values():
        assert abs(math.remainder(forth - back, 2 * math.pi)) == pytest.approx(math.pi)


@pytest.mark.matrix
@given(st.lists(st.floats(-14.0, 14.0), min_size=4, max_size=4), st.lists(st.floats(-3.1, 3.1), min_size=2, max_size=2))
def test_room_tells_only_primitives_that_do_not_fit(places: list[float], headings: list[float]) -> None:
    """As many primitives fit, and the same, whether the room of their arcs is known or not."""
    edges = _list_boundary_edges(
        Polygon([(-15, -15), (15, -15), (15, 15), (4, 15), (4, 2), (-4, 2), (-4, 15), (-15, 15)])
    )
    a, b = np.array([*places[:2], headings[0]]), np.array([*places[2:], headings[1]])
    ahead, behind, plain, told = np.empty(2), np.empty(2), np.zeros((5, 3)), np.zeros((5, 3))
    measure_room_m(a, 1.0, R, edges, ahead)
    measure_room_m(b, -1.0, R, edges, behind)
    kind = find_fitting_forward(a, b, R, edges, 3, plain)
    for barrier in (np.full((1, 4), np.inf), edges[3:4].copy()):
        assert find_fitting_in_room(a, b, ahead, behind, barrier, R, edges, 3, told) == kind
        assert plain.tobytes() == told.tobytes()


@pytest.mark.slow
@given(st.lists(st.floats(-40.0, 40.0), min_size=4, max_size=4), st.lists(st.floats(-3.1, 3.1), min_size=2, max_size=2))
def test_a_link_that_fits_is_never_told_to_point_away(places: list[float], headings: list[float]) -> None:
    """A link has the seconds of its word, or none where no word fits, on a field with a narrow neck."""
    neck = [(-45, -45), (-3, -45), (-3, -8), (3, -8), (3, -45), (45, -45), (45, 45), (3, 45), (3, 0), (-3, 0), (-3, 45)]
    field = Polygon([*neck, (-45, 45)])
    assume(field.buffer(-0.01).contains(MultiPoint([places[:2], places[2:]])))
    edges, primitive = _list_boundary_edges(field), np.zeros((5, 3))
    poses = np.array([[*places[:2], headings[0]], [*places[2:], headings[1]]])
    kind, speeds = find_fitting_forward(poses[0], poses[1], R, edges, 3, primitive), TurnCosts(2.0, 2.0, 0.0).speeds
    rooms, barrier = np.full((2, 4), UNKNOWN), np.full((1, 4), np.inf)
    seconds = compute_link_s(poses, 0, 1, rooms, barrier, R, speeds, edges, np.zeros((5, 3)))
    assert seconds == pytest.approx(primitive[:, 0].sum() / 2.0 if kind >= 0 else math.inf, abs=1e-9)


def rings(poses: list[Pose], joined: list[tuple[int, int]]) -> bool:
    """Whether rings lead from the first pose to the last, on an open field, where those between are so joined."""
    count, no_edges, speeds = len(poses) - 2, np.empty((0, 4)), TurnCosts(2.0, 2.0, 0.0).speeds
    after = [[j for i, j in joined if i == k] for k in range(count)]
    kept = (
        np.cumsum([0, *(len(each) for each in after)]),
        np.array([j for each in after for j in each], np.int64),
        np.full(len(joined), UNKNOWN),
    )
    start, goal = (np.full(count, UNCHECKED, np.int8) for _ in range(2))
    goal[: count - 1] = APART  # only the last of the rings is joined to the goal
    rooms = np.full((len(poses), 4), UNKNOWN)
    return bool(
        can_rings_connect(
            np.array(poses),
            rooms,
            1,
            len(poses) - 1,
            kept,
            start,
            goal,
            6.0,
            2.0,
            2.0,
            speeds,
            no_edges,
        )
    )


def test_rings_lead_where_their_links_do() -> None:
    row = [(5.0 * k, 0.0, 0.0) for k in range(6)]  # a start, four poses 5 m apart of which it is near the first, a goal
    assert rings(row, [(0, 1), (1, 2), (2, 3)])
    assert rings(row, [(0, 2), (2, 3)])
    assert not rings(row, [(0, 1), (2, 3)])
    assert not rings(row, [(1, 2), (2, 3), (3, 1)])


def test_what_is_learnt_of_spots_together_is_known_to_each_part() -> None:
    parts = [
        RoutePoses.from_poses([(0.0, 0.0, 0.0)]),
        RoutePoses.from_poses([]),
        RoutePoses.from_poses([(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]),
    ]
    spots = RoutePoses.from_parts(parts)
    assert spots.poses.tolist() == [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert (spots.rooms == UNKNOWN).all() and spots.rooms.shape == (3, 4)
    spots.rooms[2, 1] = 7.0
    spots.update_parts(parts)
    assert parts[2].rooms.tolist() == [[UNKNOWN] * 4, [UNKNOWN, 7.0, UNKNOWN, UNKNOWN]] and len(parts[1].rooms) == 0
    assert RouteLayers.from_layers([[(0.0, 0.0, 0.0)], [], [(1.0, 1.0, 1.0)]]).sizes == [1, 0, 1]


def test_a_route_that_fails_leaves_the_next_as_it_would_be_alone() -> None:
    """What is remembered of one search for a route changes no other."""
    comb = Polygon([(0, 0), (80, 0), (80, 60), (74, 60), (74, 12), (6, 12), (6, 60), (0, 60)])
    forwards = tuple(kind for kind in TURN_KINDS if kind != "switch-back")
    far, blind = (77.0, 50.0, UP), (3.0, 50.0, UP)  # forwards there is room to turn below, not in the arms
    ends = [((3.0, 50.0, DOWN), far), (blind, far), ((3.0, 50.0, DOWN), (3.0, 20.0, UP)), (blind, (77.0, 50.0, DOWN))]
    together = Connector(comb, R, COSTS, forwards)
    found = [together.connect(a, b) for a, b in ends * 2]
    alone = [Connector(comb, R, COSTS, forwards).connect(a, b) for a, b in ends]
    assert found == alone * 2
    assert [path is not None for path in alone] == [True, False, True, False]


def test_room_of_arcs_before_a_wall() -> None:
    wall = np.array([[3.0, -50.0, 3.0, 50.0]])
    room = np.empty(2)
    measure_room_m(np.array([0.0, 0.0, 0.0]), 1.0, 6.0, wall, room)
    assert room == pytest.approx([6.0 * math.pi / 6.0] * 2)  # 6 sin(angle) = 3
    measure_room_m(np.array([0.0, 0.0, math.pi]), -1.0, 6.0, wall, room)
    assert room == pytest.approx([6.0 * math.pi / 6.0] * 2)
    measure_room_m(np.array([-20.0, 0.0, 0.0]), 1.0, 6.0, wall, room)
    assert np.isinf(room).all()


def chain(poses: list[Pose], blocked: set[tuple[int, int]], limit_s: float = math.inf) -> list[int]:
    """The quickest chain over straight links at 2 m/s between all poses, from the first to the last."""
    count = len(poses)
    steps = [
        math.inf if (i, j) in blocked else math.dist(poses[i][:2], poses[j][:2]) / 2.0
        for i in range(count)
        for j in range(count)
    ]
    graph = np.arange(0, count * count + 1, count), np.tile(np.arange(count), count), np.array(steps)
    none = np.zeros(count + 1, np.int64), np.empty(0, np.int64), np.empty(0)
    speeds, no_edges, nothing = TurnCosts(2.0, 2.0, 0.0).speeds, np.empty((0, 4)), np.zeros(1)
    rooms = np.full((count, 4), UNKNOWN)
    found = find_quickest_chain(np.array(poses), rooms, nothing, nothing, graph, none, R, speeds, no_edges, limit_s)
    return [int(place) for place in found]


def test_quickest_chain_on_a_graph_worked_by_hand() -> None:
    poses = [(0.0, 0.0, 0.0), (5.0, 3.0, 0.0), (5.0, -6.0, 0.0), (10.0, 0.0, 0.0)]
    assert chain(poses, set()) == [0, 3]
    assert chain(poses, {(0, 3)}) == [0, 1, 3]
    assert chain(poses, {(0, 3), (1, 3)}) == [0, 2, 3]
    assert chain(poses, {(0, 3), (1, 3), (2, 3)}) == []


def test_quickest_chain_stops_at_its_limit() -> None:
    poses = [(0.0, 0.0, 0.0), (5.0, 3.0, 0.0), (10.0, 0.0, 0.0)]
    needed = 2 * math.hypot(5, 3) / 2.0
    assert chain(poses, {(0, 2)}, needed + 1e-6) == [0, 1, 2]
    assert chain(poses, {(0, 2)}, needed - 1e-6) == []


def test_every_pose_of_a_layer_leads_to_every_pose_of_the_next() -> None:
    indptr, after = link_layers(np.array([2, 3, 1]))
    follow = [after[indptr[i] : indptr[i + 1]].tolist() for i in range(6)]
    assert follow == [[2, 3, 4], [2, 3, 4], [5], [5], [5], []]


def test_a_turn_with_room_is_found_quickly() -> None:
    connector = Connector(SQUARE, R, COSTS)
    pairs = [((20.0 + i, 60.0, UP), (23.0 + i, 60.0, DOWN)) for i in range(50)]
    connector.connect(*pairs[0])
    begin = time.process_time()
    for a, b in pairs:
        connector.connect(a, b)
    assert (time.process_time() - begin) / len(pairs) < 0.02  # usually 0.1 ms; this is only against a blow-up
