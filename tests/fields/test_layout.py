"""Tracks: closed forms on plain shapes, and properties on random ones."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from shapely import affinity

from fields import Field, FieldError, Layout, lay_swaths, list_sample_names, read_field
from fields.layout.bearings import FAN_DEG, list_candidate_bearings, list_trial_bearings
from fields.layout.parallel_lines import find_line_chords, space_lines
from tests.examples import count_examples

RELAXED = settings(max_examples=count_examples(60), suppress_health_check=[HealthCheck.filter_too_much])


def rectangle(length: float, width: float) -> Field:
    return Field("r", shapely.box(0, 0, length, width))


def swaths(layout: Layout) -> shapely.Geometry:
    """Everything the implement passes over."""
    lines = [shapely.LineString([track.start_m, track.end_m]) for track in layout.swaths]
    return shapely.union_all(shapely.buffer(lines, layout.width_m / 2, cap_style="flat"), grid_size=1e-6)


class TestRectangle:
    def test_the_field_of_the_thesis(self) -> None:
        layout = lay_swaths(read_field("iwamizawa"), 3.0, 10.0)
        assert layout.bearing_deg == 90.0
        assert layout.track_count == len(layout.swaths) == 24
        assert [track.line for track in layout.swaths] == list(range(24))
        assert all(track.length_m == pytest.approx(250.0, abs=1e-9) for track in layout.swaths)
        y = [track.start_m[1] for track in layout.swaths]
        assert y == pytest.approx([1.5 + 67.0 / 23.0 * i for i in range(24)], abs=1e-6)
        assert {(round(t.start_m[0], 9), round(t.end_m[0], 9)) for t in layout.swaths} == {(10.0, 260.0)}
        assert layout.inner_region.hausdorff_distance(shapely.box(10, 1.5, 260, 68.5)) < 1e-5

    @pytest.mark.parametrize(
        ("width", "expected"), [(69.0, 23), (69.04, 23), (69.999, 24), (70.0, 24), (71.9, 24), (72.1, 25)]
    )
    def test_number_of_lines(self, width: float, expected: int) -> None:
        assert lay_swaths(rectangle(270, width), 3.0, 10.0).track_count == expected

    @given(length=st.floats(120, 400), width=st.floats(20, 100), implement=st.floats(1, 12), headland=st.floats(0, 30))
    @settings(max_examples=count_examples(60))
    def test_closed_form(self, length: float, width: float, implement: float, headland: float) -> None:
        layout = lay_swaths(rectangle(length, width), implement, headland, 90.0)
        count = max(math.ceil((width - implement - 0.05) / implement), 0) + 1
        end = max(headland, implement / 2)
        assert len(layout.swaths) == layout.track_count == count
        assert layout.total_length_m == pytest.approx(count * (length - 2 * end), rel=1e-9)

    @pytest.mark.parametrize(
        ("bearing", "expected"), [(0, 0), (180, 0), (360, 0), (-90, 90), (270, 90), (450, 90), (30, 30)]
    )
    def test_bearing_is_kept_in_half_a_turn(self, bearing: float, expected: float) -> None:
        layout = lay_swaths(rectangle(270, 70), 3.0, 10.0, bearing)
        assert layout.bearing_deg == pytest.approx(expected, abs=1e-9)

    def test_best_bearing_is_along_the_long_side(self) -> None:
        for turn in (0, 17, 90, 163):
            field = Field("r", affinity.rotate(shapely.box(0, 0, 270, 70), -turn))
            assert (lay_swaths(field, 3, 10).bearing_deg - 90 - turn + 1) % 180 == pytest.approx(1, abs=1e-6)


class TestShapes:
    def test_obstacle_cuts_lines_in_two(self) -> None:
        """A 20 m square hole: every line within half a width of it keeps the headland on both sides."""
        field = Field("h", shapely.box(0, 0, 200, 60).difference(shapely.box(90, 20, 110, 40)))
        layout = lay_swaths(field, 3.0, 10.0, 90.0)
        cut = [track for track in layout.swaths if 18.5 < track.start_m[1] < 41.5]
        assert {track.piece for track in cut} == {0, 1}
        assert {round(track.length_m, 6) for track in cut} == {70.0}
        assert {round(track.length_m, 6) for track in layout.swaths if track not in cut} == {180.0}
        assert len(layout.swaths) == layout.track_count + len(cut) // 2
        assert layout.swaths == tuple(sorted(layout.swaths, key=lambda t: (t.line, t.piece)))

    def test_slanted_end_keeps_the_stated_offset(self) -> None:
        """Edge at 45 degrees: w/2 + (h - w/2) sin 45, measured square to the edge."""
        field = Field("t", shapely.Polygon([(0, 0), (200, 0), (140, 60), (0, 60)]))
        layout = lay_swaths(field, 3.0, 10.0, 90.0)
        slant = shapely.LineString([(300, -100), (40, 160)])
        offsets = [slant.distance(shapely.Point(track.end_m)) for track in layout.swaths]
        assert offsets == pytest.approx([1.5 + 8.5 * math.sqrt(0.5)] * len(offsets), abs=1e-5)

    def test_line_flush_with_an_inner_edge_runs_along_it(self) -> None:
        """An L whose step lies on the grid: the line there has room for the whole implement."""
        field = Field("l", shapely.Polygon([(0, 0), (200, 0), (200, 30), (100, 30), (100, 60), (0, 60)]))
        lengths = [round(track.length_m, 6) for track in lay_swaths(field, 3.0, 10.0, 90.0).swaths]
        assert lengths == [180.0] * 10 + [80.0] * 10

    def test_small_bulge_does_not_cost_the_outer_line(self) -> None:
        """A side that bows out by 30 cm: the outer line stands off a little and keeps its length."""
        field = Field("b", shapely.Polygon([(0, 0), (150, -0.3), (300, 0), (300, 60), (0, 60)]))
        layout = lay_swaths(field, 3.0, 10.0, 90.0)
        assert len(layout.swaths) >= 20
        assert min(track.length_m for track in layout.swaths) > 250.0

    @pytest.mark.parametrize("name", list_sample_names())
    def test_samples_are_covered_without_leaving_the_field(self, name: str) -> None:
        field = read_field(name)
        layout = lay_swaths(field, 3.0, 9.0)
        worked = swaths(layout)
        assert worked.difference(field.boundary).area < 1e-3
        assert worked.area > 0.75 * field.area_m2
        room = layout.inner_region.buffer(1e-3)
        assert all(room.covers(shapely.LineString([track.start_m, track.end_m])) for track in layout.swaths)


@st.composite
def outlines(draw: st.DrawFn) -> shapely.Polygon:
    """A star-shaped field of 4 to 12 corners, 40 to 200 m across, sometimes with a hole."""
    count = draw(st.integers(4, 12))
    radius = [draw(st.integers(40, 200)) for _ in range(count)]
    angle = [2 * math.pi * (i + draw(st.integers(-3, 3)) / 10) / count for i in range(count)]
    shape = shapely.Polygon([(r * math.cos(a), r * math.sin(a)) for r, a in zip(radius, angle, strict=True)])
    if draw(st.booleans()):
        shape = shape.difference(shapely.box(-8, -5, 6, 7))
    assume(isinstance(shape, shapely.Polygon) and shape.is_valid)
    return shape


@st.composite
def steps(draw: st.DrawFn) -> shapely.Polygon:
    """A field of right angles on a metre grid: lines often fall exactly on its edges."""
    towers, x = [], 0
    for _ in range(draw(st.integers(1, 5))):
        wide, high, low = draw(st.integers(6, 60)), draw(st.integers(24, 120)), draw(st.integers(-40, 0))
        towers.append(shapely.box(x, low, x + wide, high))
        x += wide
    return shapely.union_all(towers)


def laid(shape: shapely.Polygon, bearing: float | None = None) -> Layout | None:
    try:
        return lay_swaths(Field("p", shape), 3.0, 9.0, bearing)
    except FieldError:
        return None


class TestProperties:
    @given(
        shape=outlines() | steps(),
        turn=st.floats(0, 360),
        mirror=st.booleans(),
        dx=st.integers(-5000, 5000),
        dy=st.integers(-5000, 5000),
    )
    @RELAXED
    def test_the_layout_moves_with_the_field(
        self, shape: shapely.Polygon, turn: float, mirror: bool, dx: int, dy: int
    ) -> None:
        other = affinity.scale(shape, xfact=-1.0, origin=(0, 0)) if mirror else shape
        other = affinity.translate(affinity.rotate(other, turn, origin=(0, 0)), dx, dy)
        before, after = laid(shape), laid(other)
        assert (before is None) == (after is None)
        if before is not None and after is not None:
            assert (after.track_count, len(after.swaths)) == (before.track_count, len(before.swaths))
            assert after.total_length_m == pytest.approx(before.total_length_m, rel=1e-6)

    @given(shape=outlines(), bearing=st.floats(0, 180))
    @RELAXED
    def test_what_every_layout_keeps_to(self, shape: shapely.Polygon, bearing: float) -> None:
        layout = laid(shape, bearing)
        assume(layout is not None)
        assert layout is not None
        assert swaths(layout).difference(shape).area < 1e-3
        along = np.array([math.cos(layout.bearing_rad), math.sin(layout.bearing_rad)])
        across = np.array([-along[1], along[0]])
        ends = np.array([[track.start_m, track.end_m] for track in layout.swaths])
        step = ends[:, 1] - ends[:, 0]
        assert step @ along == pytest.approx(np.hypot(*step.T)) and (step @ along >= 5.0 - 1e-6).all()
        line = np.array([track.line for track in layout.swaths])
        lateral = ends[:, 0] @ across
        gap, lines = np.abs(np.diff(lateral)), np.diff(line)
        other = lines > 0
        spacing = gap[other] / lines[other]
        assert not len(spacing) or (np.ptp(spacing) < 1e-6 and spacing[0] <= 3.0 + 0.05)

    @given(shape=outlines(), bearing=st.floats(0, 180))
    @RELAXED
    def test_room_beyond_both_ends(self, shape: shapely.Polygon, bearing: float) -> None:
        """Along the track at least the headland less half a width is free, for the whole implement."""
        layout = laid(shape, bearing)
        assume(layout is not None)
        assert layout is not None
        reach = 7.5 * np.array([math.cos(layout.bearing_rad), math.sin(layout.bearing_rad)])
        for track in layout.swaths:
            longer = shapely.LineString([track.start_m - reach, track.end_m + reach]).buffer(1.5 - 1e-4)
            assert shape.covers(longer)

    @given(shape=outlines() | steps(), bearing=st.floats(0, 180) | st.sampled_from([0.0, 90.0]))
    @RELAXED
    def test_tracks_reach_just_to_the_end_of_the_inner_region(self, shape: shapely.Polygon, bearing: float) -> None:
        layout = laid(shape, bearing)
        assume(layout is not None)
        assert layout is not None
        roomy, tight = layout.inner_region.buffer(1e-4), layout.inner_region.buffer(-1e-3)
        nudge = 0.01 * np.array([math.cos(layout.bearing_rad), math.sin(layout.bearing_rad)])
        for track in layout.swaths:
            assert roomy.covers(shapely.LineString([track.start_m, track.end_m]))
            assert not tight.intersects(shapely.MultiPoint([track.start_m - nudge, track.end_m + nudge]))

    @pytest.mark.slow
    @given(shape=outlines())
    @settings(RELAXED, max_examples=count_examples(25))
    def test_best_bearing_beats_every_other_candidate(self, shape: shapely.Polygon) -> None:
        """Effort worked out afresh, with the covered area from the union of the swaths."""
        best = laid(shape)
        assume(best is not None)
        assert best is not None
        angles = list_candidate_bearings(shape)
        assert min(abs((best.bearing_rad - angle + 1) % math.pi - 1) for angle in angles) < 1e-9
        others = [laid(shape, 90.0 - math.degrees(angle)) for angle in angles]
        assert effort(best) <= (1 + 1e-3) * min(effort(other) for other in others if other is not None)


def effort(layout: Layout) -> float:
    """Driving on the tracks, 15 m a turn, and twice the length that the uncovered area would take."""
    uncovered = layout.field.area_m2 - swaths(layout).area
    return layout.total_length_m + 15.0 * len(layout.swaths) + 2.0 * uncovered / layout.width_m


@pytest.mark.parametrize(
    ("length", "implement", "headland", "bearing", "words"),
    [
        *((100.0, implement, 5.0, None, "The working width") for implement in (0.0, -3.0, math.nan, math.inf)),
        *((100.0, 3.0, headland, None, "The headland") for headland in (-1.0, math.nan, math.inf)),
        (100.0, 3.0, 5.0, math.nan, "give degrees"),
        (100.0, 0.003, 5.0, None, "more than 20000 tracks"),
        (100.0, 50.1, 5.0, None, "nowhere wider than the working width"),
        *((50.0, 3.0, 23.0, bearing, "No track") for bearing in (None, 0.0, 90.0)),
    ],
)
def test_refusals(length: float, implement: float, headland: float, bearing: float | None, words: str) -> None:
    with pytest.raises(FieldError, match=words):
        lay_swaths(rectangle(length, 50), implement, headland, bearing)


class TestParts:
    def test_positions_by_hand(self) -> None:
        assert space_lines(0.0, 7.0, 3.0).tolist() == pytest.approx([0.0, 7.0 / 3.0, 14.0 / 3.0, 7.0])
        assert space_lines(0.0, 6.0, 3.0).tolist() == [0.0, 3.0, 6.0]
        assert space_lines(2.0, 2.0, 3.0).tolist() == [2.0]

    def test_chords_by_hand(self) -> None:
        """A triangle (0,0) (10,0) (5,10): at height q the chord runs from q/2 to 10 - q/2."""
        corners = np.array([(0.0, 0.0), (10.0, 0.0), (5.0, 10.0)])
        edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        line, start, end = find_line_chords(edges, np.array([2.0, 6.0, 11.0]))
        assert line.tolist() == [0, 1]
        assert start == pytest.approx([1.0, 3.0]) and end == pytest.approx([9.0, 7.0])

    def test_chords_are_those_of_every_line_with_every_edge(self) -> None:
        """Corners on lines, level edges and lines in either order: the half-open rule, asked of each pair."""
        draw = np.random.default_rng(2)
        for places in (np.arange(-6.0, 7.0), np.arange(6.0, -7.0, -1.0), np.array([0.0])):
            corners = draw.integers(-6, 7, (15, 2)).astype(float)
            edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            crossed = [
                (line, a[0] + (q - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
                for line, q in enumerate(places.tolist())
                for a, b in edges.tolist()
                if (a[1] <= q) != (b[1] <= q)
            ]
            line, start, end = find_line_chords(edges, places)
            assert [(n, s) for n, *ends in zip(line.tolist(), start, end, strict=True) for s in ends] == sorted(crossed)

    def test_candidates_of_a_right_triangle(self) -> None:
        """Legs 30 and 40: three edges; the two least rectangles lie along them as well."""
        found = sorted(
            math.degrees(angle) for angle in list_candidate_bearings(shapely.Polygon([(0, 0), (40, 0), (0, 30)]))
        )
        assert found == pytest.approx([0.0, 90.0, 180.0 - math.degrees(math.atan2(30, 40))])

    @pytest.mark.parametrize(("turn_deg", "hand"), [(0.0, -1), (23.7, 1), (141.0, -1)])
    def test_trial_bearings_turn_and_mirror_with_the_field(self, turn_deg: float, hand: int) -> None:
        shape = shapely.Polygon([(0, 0), (200, 10), (190, 75), (70, 70), (64, 210), (5, 205)])
        moved = affinity.rotate(affinity.scale(shape, hand, 1.0, origin=(0, 0)), turn_deg, origin=(0, 0))
        before, after = (np.array(list_trial_bearings(one)) for one in (shape, moved))
        expected = hand * before + math.radians(turn_deg)
        apart = np.abs((after[:, None] - expected[None, :] + 1.0) % math.pi - 1.0)
        assert len(after) == len(before) and apart.min(axis=0).max() < 1e-6 and apart.min(axis=1).max() < 1e-6

    def test_no_direction_is_far_from_a_trial_bearing(self) -> None:
        angles = np.array(list_trial_bearings(shapely.Polygon([(0, 0), (40, 0), (0, 30)])))
        every = np.radians(np.arange(0.0, 180.0, 0.1))
        apart = np.abs((every[:, None] - angles[None, :] + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
        assert np.degrees(apart.min(axis=1).max()) <= 0.75 * FAN_DEG

    def test_candidates_of_a_curve_are_limited(self) -> None:
        circle = shapely.Point(0, 0).buffer(400, quad_segs=200)
        assert len(list_candidate_bearings(circle)) <= 72
