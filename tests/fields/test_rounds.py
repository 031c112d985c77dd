"""Rounds of the headland: closed forms on plain shapes, what holds on any, and tracks that leave nothing."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import affinity

from fields import Field, FieldError, lay_swaths, list_sample_names, read_field
from fields.geometry.arithmetic import CURVE_M
from fields.layout.headland_passes import HeadlandPass, compute_inner_region, find_centre_line, lay_headland_passes
from tests.examples import count_examples
from tests.fields.test_layout import rectangle


def draw_pass(lap: HeadlandPass) -> shapely.LineString:
    return shapely.LineString(np.concatenate([side.points for side in lap.sides]))


def swept(lines: list[shapely.LineString], width_m: float) -> shapely.Geometry:
    """What a bar of the width passes over, corners squared."""
    swaths = shapely.buffer(lines, 0.5 * width_m, cap_style="flat", join_style="mitre", mitre_limit=5.0)
    return shapely.union_all(swaths, grid_size=1e-6)


class TestRectangle:
    @pytest.mark.parametrize("number", [1, 2, 3, 4])
    def test_length_of_each_round(self, number: int) -> None:
        """2 (a + b) - 8 (i - 1/2) w for 270 m by 70 m and 3 m: 668, 644, 620, 596 m."""
        rounds = lay_headland_passes(rectangle(270, 70), 3.0, 4)
        assert rounds[number - 1].number == number
        assert rounds[number - 1].length_m == pytest.approx(2 * 340 - 24 * (number - 0.5), abs=1e-3)
        assert rounds[number - 1].length_m == pytest.approx([668, 644, 620, 596][number - 1], abs=1e-3)

    def test_four_sides_that_turn_left_by_a_right_angle(self) -> None:
        (lap,) = lay_headland_passes(rectangle(270, 70), 3.0, 1)
        assert lap.is_closed and [round(side.length_m, 3) for side in lap.sides] in ([267, 67] * 2, [67, 267] * 2)
        for side, after in zip(lap.sides, lap.sides[1:] + lap.sides[:1], strict=True):
            assert side.points[-1] == pytest.approx(after.points[0])
            assert side.start_turn_rad == pytest.approx(math.pi / 2) == side.end_turn_rad

    def test_tracks_inside_four_rounds(self) -> None:
        """246 m by 46 m are left: 16 tracks, 3936 m."""
        layout = lay_swaths(rectangle(270, 70), 3.0, 0.0, headland_passes=4)
        assert (layout.track_count, layout.headland_passes, layout.headland_m) == (16, 4, 12.0)
        assert layout.total_length_m == pytest.approx(3936.0)
        assert layout.inner_region.equals(shapely.box(12, 12, 258, 58))

    @given(a=st.floats(60, 300), b=st.floats(60, 300), width=st.floats(1.5, 6), count=st.integers(1, 4))
    @settings(max_examples=count_examples(40))
    def test_nothing_is_left(self, a: float, b: float, width: float, count: int) -> None:
        """But for a strip of the CURVE_M that gains no line of its own."""
        field = rectangle(a, b)
        layout = lay_swaths(field, width, 0.0, headland_passes=count)
        lines = [draw_pass(lap) for lap in lay_headland_passes(field, width, count)]
        lines = [shapely.LinearRing(line) for line in lines]
        tracks = [shapely.LineString([track.start_m, track.end_m]) for track in layout.swaths]
        worked = shapely.union(swept(lines, width), swept(tracks, width), grid_size=1e-6)
        missed = shapely.difference(field.boundary, worked, grid_size=1e-6).area
        assert missed < 1e-4 * field.area_m2 + CURVE_M * max(a, b)
        assert shapely.difference(worked, field.boundary, grid_size=1e-6).area < 1e-4 * field.area_m2


class TestShapes:
    def test_a_round_about_an_obstacle_turns_the_other_way(self) -> None:
        field = Field("h", shapely.box(0, 0, 200, 100).difference(shapely.box(90, 40, 110, 60)))
        outer, inner = lay_headland_passes(field, 3.0, 1)
        assert [round(lap.length_m, 3) for lap in (outer, inner)] == [588, 92]
        assert shapely.LinearRing(draw_pass(outer)).is_ccw and not shapely.LinearRing(draw_pass(inner)).is_ccw
        assert all(side.start_turn_rad == pytest.approx(-math.pi / 2) for side in inner.sides)

    def test_a_round_without_corners_is_one_side(self) -> None:
        (lap,) = lay_headland_passes(Field("c", shapely.Point(0, 0).buffer(60, quad_segs=32)), 3.0, 1)
        assert len(lap.sides) == 1 and lap.sides[0].start_turn_rad == 0.0
        assert lap.length_m == pytest.approx(2 * math.pi * 58.5, rel=1e-3)

    def test_a_rounded_corner_too_tight_to_drive_is_a_corner(self) -> None:
        outline = shapely.box(3, 3, 97, 57).buffer(3, quad_segs=16)
        (lap,) = lay_headland_passes(Field("o", outline), 3.0, 1)
        assert len(lap.sides) == 4
        assert [side.start_turn_rad for side in lap.sides] == pytest.approx([math.pi / 2] * 4, abs=0.01)

    def test_a_waist_splits_the_rounds(self) -> None:
        """Two rooms of 60 m joined by a lane of 8 m: one first round through it, two of every other."""
        rooms = [shapely.box(0, 0, 60, 60), shapely.box(100, 0, 160, 60), shapely.box(50, 26, 110, 34)]
        rounds = lay_headland_passes(Field("w", shapely.union_all(rooms)), 3.0, 3)
        closed = [sum(lap.is_closed and lap.number == number for lap in rounds) for number in (1, 2, 3)]
        assert closed == [1, 2, 2]

    def test_a_lane_gets_a_line_down_its_middle(self) -> None:
        """Of 8 m the first round works 6; 2 m are left, less than a width."""
        rooms = [shapely.box(0, 0, 60, 60), shapely.box(100, 0, 160, 60), shapely.box(50, 26, 110, 34)]
        rounds = lay_headland_passes(Field("l", shapely.union_all(rooms)), 3.0, 2)
        (middle,) = [lap for lap in rounds if not lap.is_closed]
        assert middle.number == 2 and np.abs(middle.sides[0].points[:, 1] - 30.0).max() < 0.05
        assert 38 < middle.length_m < 52

    @pytest.mark.parametrize(("height", "closed"), [(9.45, False), (10.0, False), (13.5, True)])
    def test_a_strip_hardly_wider_than_the_implement_is_worked_down_its_middle(
        self, height: float, closed: bool
    ) -> None:
        (lap,) = lay_headland_passes(rectangle(200, height), 9.0, 1)
        assert lap.is_closed is closed and lap.length_m > 190.0
        assert closed or np.ptp(lap.sides[0].points[:, 1]) < 0.01

    def test_a_strip_bent_like_a_bow_is_followed(self) -> None:
        arc = shapely.LineString([(100 * math.sin(t), 100 * math.cos(t)) for t in np.linspace(-0.6, 0.6, 40)])
        line = find_centre_line(arc.buffer(1.0, cap_style="flat"), 3.0)
        assert line is not None
        assert shapely.LineString(line).hausdorff_distance(arc) < 2.5
        assert shapely.distance(arc, shapely.points(line)).max() < 0.5

    def test_what_is_narrower_than_the_implement_is_left(self) -> None:
        lane = shapely.union_all([shapely.box(0, 0, 60, 60), shapely.box(50, 29, 150, 31)])
        assert max(draw_pass(lap).bounds[2] for lap in lay_headland_passes(Field("n", lane), 3.0, 3)) < 60

    @pytest.mark.parametrize("name", list_sample_names())
    @pytest.mark.parametrize(("width", "count"), [(3.0, 3), (6.0, 2)])
    def test_samples_are_worked_but_for_specks(self, name: str, width: float, count: int) -> None:
        field = read_field(name)
        rings = [
            shapely.LinearRing(draw_pass(lap)) if lap.is_closed else draw_pass(lap)
            for lap in lay_headland_passes(field, width, count)
        ]
        layout = lay_swaths(field, width, 0.0, headland_passes=count)
        tracks = [shapely.LineString([track.start_m, track.end_m]) for track in layout.swaths]
        worked = shapely.union(swept(rings, width), swept(tracks, width), grid_size=1e-6)
        assert worked.intersection(field.boundary).area > 0.998 * field.area_m2
        assert all(shapely.covers(field.boundary.buffer(-0.5 * width + 0.05), shapely.MultiLineString(tracks).geoms))


def laid(shape: shapely.Polygon) -> tuple[HeadlandPass, ...]:
    return lay_headland_passes(Field("p", shape), 3.0, 3)


@st.composite
def stars(draw: st.DrawFn) -> shapely.Polygon:
    count = draw(st.integers(4, 10))
    radius = [draw(st.integers(40, 150)) for _ in range(count)]
    turn = [2 * math.pi * (i + draw(st.integers(-3, 3)) / 10) / count for i in range(count)]
    shape = shapely.Polygon([(r * math.cos(a), r * math.sin(a)) for r, a in zip(radius, turn, strict=True)])
    assume(shape.is_valid)
    return shape


class TestProperties:
    @given(shape=stars())
    @settings(max_examples=count_examples(60))
    def test_rounds_stay_half_a_width_inside_and_sides_are_one_line(self, shape: shapely.Polygon) -> None:
        for lap in laid(shape):
            depth = (lap.number - 0.5 if lap.is_closed else lap.number - 1.0) * 3.0
            assert shape.buffer(-depth, join_style="mitre", mitre_limit=2.0).buffer(0.05).covers(draw_pass(lap))
            for side, after in zip(lap.sides, lap.sides[1:], strict=False):
                assert side.points[-1] == pytest.approx(after.points[0])
                assert side.end_turn_rad == after.start_turn_rad

    @given(shape=stars(), turn=st.floats(0, 360), dx=st.integers(-5000, 5000))
    @settings(max_examples=count_examples(30))
    def test_rounds_turn_with_the_field(self, shape: shapely.Polygon, turn: float, dx: int) -> None:
        other = affinity.translate(affinity.rotate(shape, turn, origin=(0, 0)), dx, 7)
        lengths = [sum(lap.length_m for lap in laid(one) if lap.is_closed) for one in (shape, other)]
        assert lengths[1] == pytest.approx(lengths[0], rel=2e-3)

    @given(shape=stars())
    @settings(max_examples=count_examples(30))
    def test_inner_region_is_what_lies_deeper(self, shape: shapely.Polygon) -> None:
        field = Field("p", shape)
        inner = compute_inner_region(field, 9.0)
        assert inner.is_empty or inner.distance(shape.exterior) > 9.0 - 1e-6
        assert shapely.difference(shape.buffer(-9.0 * 2.0), inner).area < 1e-6


class TestRefusals:
    @pytest.mark.parametrize(
        ("width", "count", "bend", "words"),
        [
            (0.0, 1, 4.0, "working width"),
            (3.0, -1, 4.0, "headland passes is -1"),
            (3.0, 1, math.nan, "length of a corner"),
        ],
    )
    def test_values(self, width: float, count: int, bend: float, words: str) -> None:
        with pytest.raises(FieldError, match=words):
            lay_headland_passes(rectangle(100, 50), width, count, bend)

    @pytest.mark.parametrize(("width", "passes", "tracks"), [(3.0, 3, 1), (3.0, 4, 0), (12.0, 1, 0), (7.0, 1, 1)])
    def test_inside_the_rounds_may_be_no_room(self, width: float, passes: int, tracks: int) -> None:
        layout = lay_swaths(rectangle(100, 20), width, passes * width, headland_passes=passes)
        assert (layout.track_count, layout.headland_passes) == (tracks, passes)
        assert layout.bearing_deg == pytest.approx(90.0)

    def test_a_headland_left_for_turning_is_advised_less_deep_or_crossed_another_way(self) -> None:
        with pytest.raises(FieldError, match=r"use a headland \(headland_m\) of 10.9 m"):
            lay_swaths(rectangle(30, 30), 3.0, 14.0, bearing_deg=0.0)
        with pytest.raises(FieldError, match=r"use a bearing \(bearing_deg\) of 90 degrees"):
            lay_swaths(rectangle(100, 20), 3.0, 9.0, bearing_deg=0.0)


@pytest.mark.parametrize("count", [2, 3])
def test_a_round_turns_at_both_corners_of_a_narrow_end(count: int) -> None:
    """The third round inside a spur of 18 m is 3 m across at its end; drawn to one corner, it would leave its sides."""
    field = Field("spur", shapely.box(0, 0, 120, 60).union(shapely.box(50, 60, 68, 160)))
    lines = [shapely.LinearRing(draw_pass(lap)) for lap in lay_headland_passes(field, 3.0, count)]
    band = field.boundary.difference(compute_inner_region(field, 3.0 * count))
    assert band.difference(swept(lines, 3.0)).area < 1.0
    (lap,) = [lap for lap in lay_headland_passes(field, 3.0, count) if lap.number == count]
    assert len(lap.sides) == 8
