"""Lines bent round small obstacles: by hand and in closed form, and clear of everything whatever stands there."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from strategies.path_planning.obstacle_avoidance import MAX_ANGLE_RAD, Bend, BendRules, LineBender, Points
from tests.examples import count_examples

RULES = BendRules(radius_m=6.0, half_width_m=1.5, nose_m=2.4, tail_m=2.7)
ROOM = shapely.box(-50, -40, 150, 40)
LINE = np.array([[0.0, 0.0], [100.0, 0.0]])


def square(x: float, y: float, half: float = 0.5) -> shapely.Polygon:
    return shapely.box(x - half, y - half, x + half, y + half)


def bender(*obstacles: shapely.Polygon, room: shapely.Polygon = ROOM, rules: BendRules = RULES) -> LineBender:
    return LineBender(obstacles, room.difference(shapely.union_all(obstacles)), rules)


def length(points: Points) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def swath(points: Points) -> shapely.Geometry:
    return shapely.LineString(points).buffer(RULES.half_width_m, cap_style="flat")


def extra_m(bend: Bend) -> float:
    """How much longer the bent path is than the line."""
    return 2.0 * (2.0 * bend.radius_m * bend.angle_rad + bend.straight_m - bend.lead_m)


class TestBend:
    def test_two_arcs_by_hand(self) -> None:
        """R = 5 m, d = 2 m: cos a = 1 - 2/10, so that sin a = 0.6 and the line is left within 2 * 5 * 0.6 = 6 m."""
        bend = Bend(20.0, 30.0, 2.0, 5.0)
        assert bend.angle_rad == pytest.approx(math.acos(0.8)) and bend.straight_m == pytest.approx(0.0)
        assert (bend.leave_at_m, bend.rejoin_at_m) == (pytest.approx(14.0), pytest.approx(36.0))
        assert extra_m(bend) == pytest.approx(2 * (10 * math.acos(0.8) - 6.0))

    def test_a_straight_between_the_arcs_where_two_would_be_too_steep(self) -> None:
        """R = 5 m, d = 9 m: two arcs of 45 degrees go 10 (1 - 1/sqrt 2) m aside, a straight at 45 degrees the rest."""
        bend = Bend(40.0, 50.0, -9.0, 5.0)
        half = math.sqrt(0.5)
        rest = 9.0 - 10.0 * (1.0 - half)
        assert bend.angle_rad == MAX_ANGLE_RAD and bend.straight_m == pytest.approx(rest / half)
        assert bend.lead_m == pytest.approx(10.0 * half + rest)

    @given(st.floats(0.05, 20.0), st.floats(2.0, 20.0), st.sampled_from([1.0, -1.0]))
    def test_the_way_is_as_long_and_as_curved_as_it_says(self, aside: float, radius: float, side: float) -> None:
        bend = Bend(60.0, 65.0, side * aside, radius)
        path = bend.sample_points()
        assert length(path) == pytest.approx(bend.rejoin_at_m - bend.leave_at_m + extra_m(bend), rel=2e-3)
        assert path[[0, -1]] == pytest.approx(np.array([[bend.leave_at_m, 0.0], [bend.rejoin_at_m, 0.0]]))
        assert side * path[:, 1].max() == pytest.approx(max(side * aside, 0.0), abs=1e-9) or side < 0
        kept = path[(path[:, 0] > 60.001) & (path[:, 0] < 64.999)]
        assert kept[:, 1] == pytest.approx(side * aside)
        step = np.diff(path, axis=0)
        turn = np.diff(np.arctan2(step[:, 1], step[:, 0]))
        room = 0.5 * (np.hypot(*step[1:].T) + np.hypot(*step[:-1].T))
        assert np.abs(turn / room).max() <= 1.003 / radius, "but for chords in place of arcs"
        assert (step[:, 0] > 0.0).all(), "distances along the line only rise"


class TestOneObstacle:
    def test_nothing_near_leaves_the_line_alone(self) -> None:
        assert bender(square(50, 2.1)).bend_polyline(LINE) == (None, [])
        assert bender(square(-4, 0), square(104, 0)).bend_polyline(LINE) == (None, []), "it is past, or not yet reached"

    @pytest.mark.parametrize(("y", "aside"), [(0.4, -1.6), (-0.4, 1.6), (1.9, -0.1), (-1.9, 0.1)])
    def test_by_hand(self, y: float, aside: float) -> None:
        """A post of 1 m whose centre is y beside the line: half of it and half the width are kept, on the nearer side.

        From 2.4 m before it, when the nose comes, to 2.7 m behind it, when the implement has passed.
        """
        path, blocked = bender(square(50, y)).bend_polyline(LINE)
        assert path is not None and blocked == []
        bend = Bend(50 - 0.5 - 2.4, 50 + 0.5 + 2.7, aside, 6.0)
        assert path.points[np.argmax(np.abs(path.points[:, 1])), 1] == pytest.approx(aside)
        full = path.distance_m[np.abs(path.points[:, 1] - aside) < 1e-9]
        assert (full[0], full[-1]) == (pytest.approx(bend.begin_m), pytest.approx(bend.end_m))
        assert length(path.points) == pytest.approx(100.0 + extra_m(bend), abs=2e-3)

    def test_metres_along_the_track_stay_those_of_the_track(self) -> None:
        path, _ = bender(square(50, 0.4)).bend_polyline(LINE)
        assert path is not None
        cuts = [0.0, 10.0, 44.4, 50.0, 61.3, 100.0]
        parts = [path.cut_between(a, b) for a, b in pairwise(cuts)]
        assert [part[0, 0] for part in parts] == pytest.approx(cuts[:-1])
        assert sum(length(part) for part in parts) == pytest.approx(length(path.points))
        assert len(parts[0]) == 2 and parts[0][:, 1] == pytest.approx(0.0), "straight where nothing is in the way"

    @pytest.mark.parametrize("x", [3.0, 98.0, -1.0, 101.0])
    def test_no_room_at_an_end_is_told(self, x: float) -> None:
        path, blocked = bender(square(x, 0)).bend_polyline(LINE)
        assert path is None and blocked == [(pytest.approx(x - 0.5), pytest.approx(x + 0.5))]

    def test_it_is_passed_on_the_side_that_lies_in_the_field(self) -> None:
        room = shapely.box(0, -3.0, 100, 40)  # less deviation to the right, but half a metre short of room there
        path, _ = bender(square(50, 0.4)).bend_polyline(LINE)
        other, _ = bender(square(50, 0.4), room=room).bend_polyline(LINE)
        assert path is not None and other is not None
        assert path.points[:, 1].min() == pytest.approx(-1.6) and other.points[:, 1].max() == pytest.approx(2.4)

    def test_no_side_has_room(self) -> None:
        path, blocked = bender(square(50, 0.4), room=shapely.box(0, -3, 100, 3)).bend_polyline(LINE)
        assert path is None and len(blocked) == 1


class TestSeveral:
    def test_far_apart_each_has_its_own_bend(self) -> None:
        path, _ = bender(square(30, 0.4), square(70, -0.4)).bend_polyline(LINE)
        assert path is not None
        assert (path.points[:, 1].min(), path.points[:, 1].max()) == (pytest.approx(-1.6), pytest.approx(1.6))

    def test_near_each_other_they_are_passed_on_one_side(self) -> None:
        """0.9 and 1.1 m to either side are taken: the left one asks for 0.9 + 1.5 m, the right one for 0.2 m more."""
        path, _ = bender(square(48, 0.4), square(54, -0.6)).bend_polyline(LINE)
        assert path is not None
        assert path.points[:, 1].max() == pytest.approx(2.4) and path.points[:, 1].min() == pytest.approx(0.0)

    def test_a_bend_takes_in_what_stands_beside_it(self) -> None:
        """Right of the post there is a second one, out of the line's way but in that of the bend."""
        path, _ = bender(square(50, 0.4), square(52, -2.6)).bend_polyline(LINE)
        assert path is not None and path.points[:, 1].max() == pytest.approx(2.4)

    @settings(max_examples=count_examples(60))
    @given(st.lists(st.tuples(st.floats(-5, 105), st.floats(-8, 8), st.floats(0.2, 3.0)), min_size=1, max_size=5))
    def test_nothing_is_touched_but_what_is_told(self, posts: list[tuple[float, float, float]]) -> None:
        taken = shapely.get_parts(shapely.union_all([square(*post) for post in posts]))
        path, blocked = bender(*taken).bend_polyline(LINE)
        points = LINE if path is None else path.points
        driven = swath(points).buffer(-0.02)
        for x, y, half in posts:
            hit = driven.intersects(square(x, y, half))
            told = any(low - 2 * half < x + half and x - half < high + 2 * half for low, high in blocked)
            assert told or not hit

    @settings(max_examples=count_examples(40))
    @given(
        st.lists(st.tuples(st.floats(10, 90), st.floats(-4, 4), st.floats(0.2, 2.0)), min_size=1, max_size=3),
        st.floats(-180, 180),
        st.booleans(),
    )
    def test_turned_and_mirrored_it_is_the_same(
        self, posts: list[tuple[float, float, float]], degrees: float, mirror: bool
    ) -> None:
        taken = list(shapely.get_parts(shapely.union_all([square(*post) for post in posts])))
        sides = [
            abs(abs(shapely.get_coordinates(one)[:, 1].max()) - abs(shapely.get_coordinates(one)[:, 1].min()))
            for one in taken
        ]
        if min(sides) < 1e-3:
            return  # either side is as good
        before, blocked = bender(*taken).bend_polyline(LINE)

        def moved(shape: shapely.Geometry) -> shapely.Geometry:
            shape = affinity.scale(shape, 1, -1, origin=(0, 0)) if mirror else shape
            return affinity.rotate(shape, degrees, origin=(0, 0))

        after, told = bender(*map(moved, taken), room=moved(ROOM)).bend_polyline(
            shapely.get_coordinates(moved(shapely.LineString(LINE)))
        )
        assert len(told) == len(blocked) and (before is None) == (after is None)
        if before is not None and after is not None:
            expected = moved(shapely.LineString(before.points))
            assert expected.hausdorff_distance(shapely.LineString(after.points)) < 0.05


class TestCurvedLine:
    def test_round_a_post_beside_a_wide_circle(self) -> None:
        """On a quarter of a circle of 60 m a post 0.4 m outside the line is passed inside, at 60 - 1.6 m."""
        angle = np.linspace(0.0, math.pi / 2, 90)
        line = 60.0 * np.column_stack([np.cos(angle), np.sin(angle)])
        post = shapely.Point(60.4 * math.sqrt(0.5), 60.4 * math.sqrt(0.5)).buffer(0.5)
        path, blocked = bender(post, room=shapely.box(-5, -5, 90, 90)).bend_polyline(line)
        assert path is not None and blocked == []
        away = np.hypot(*path.points.T)
        assert away.min() == pytest.approx(60.0 - 1.6, abs=0.03)
        assert away.max() < 60.03 and swath(path.points).distance(shapely.Point(0, 0)) > 56.0
        assert not swath(path.points).buffer(-0.03).intersects(post)
