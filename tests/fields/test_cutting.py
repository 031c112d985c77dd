"""Regions cut into cells: costs by hand, shapes whose best cut is plain, what holds on any."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from fields import Field, FieldError, Layout, lay_swaths
from fields.layout.cells import CELL_COST_M, EffortRates, divide_region, estimate_costs_m
from fields.layout.options import estimate_layout_cost_m, list_layout_alternatives, replace_bearings
from fields.layout.parallel_lines import TURN_COST_M
from tests.fields.test_layout import rectangle

EAST, NORTH = 0.0, math.pi / 2
BOTH = np.array([EAST, NORTH])
L = shapely.Polygon([(0, 0), (240, 0), (240, 60), (60, 60), (60, 240), (0, 240)])
U = shapely.box(0, 0, 240, 180).difference(shapely.box(60, 60, 180, 200))
COMB = shapely.union_all([shapely.box(0, 0, 300, 60), *(shapely.box(x, 59, x + 60, 240) for x in (0, 120, 240))])
DONUT = shapely.box(0, 0, 240, 240).difference(shapely.box(60, 60, 180, 180))
STAR = shapely.Polygon(
    [(r * math.cos(a), r * math.sin(a)) for r, a in zip([150, 60] * 5, np.arange(10) * math.pi / 5, strict=True)]
)
SHAPES = {"L": L, "U": U, "comb": COMB, "donut": DONUT, "star": STAR}


class TestCosts:
    def test_rectangle(self) -> None:
        """20 lines of 240 m, or 80 of 60 m; a turn for each."""
        assert estimate_costs_m(shapely.box(0, 0, 240, 60), BOTH, 3.0) == pytest.approx(
            [4800 + 20 * TURN_COST_M, 4800 + 80 * TURN_COST_M]
        )

    def test_lines_are_whole(self) -> None:
        """61 m take 21 lines of 3 m."""
        assert estimate_costs_m(shapely.box(0, 0, 240, 61), BOTH[:1], 3.0) == pytest.approx([21 * (240 + TURN_COST_M)])

    def test_slanted_ends_are_driven_out(self) -> None:
        """A parallelogram that leans by 60 m over 60 m: each of 20 swaths is 3 m longer than its centre line."""
        leaning = shapely.Polygon([(0, 0), (240, 0), (300, 60), (60, 60)])
        assert estimate_costs_m(leaning, BOTH[:1], 3.0) == pytest.approx([20 * (240 + 3.0 + TURN_COST_M)])

    def test_rates_are_those_given(self) -> None:
        """The leaning parallelogram again: turns of 80 m, and 3 m off between neighbours cost 6 m more in each turn."""
        leaning = shapely.Polygon([(0, 0), (240, 0), (300, 60), (60, 60)])
        rates = EffortRates((100.0, 80.0), offset=2.0)
        assert estimate_costs_m(leaning, BOTH[:1], 3.0, rates) == pytest.approx([20 * (240 + 3.0 + 6.0 + 80.0)])

    @given(turn=st.floats(0, 360), name=st.sampled_from(sorted(SHAPES)))
    def test_turns_with_the_region(self, turn: float, name: str) -> None:
        other = affinity.rotate(SHAPES[name], turn, origin=(7, -3))
        bearings = np.array([0.0, 0.5, 2.0])
        before, after = (
            estimate_costs_m(SHAPES[name], bearings, 3.01),
            estimate_costs_m(other, bearings + math.radians(turn), 3.01),
        )
        assert after == pytest.approx(before, rel=1e-9)


class TestDivided:
    def test_l_has_an_arm_of_its_own(self) -> None:
        """One bearing: 8400 m and 80 turns. Two: as many metres and 40 turns, and one way between cells."""
        assert estimate_costs_m(L, BOTH, 3.0) == pytest.approx([8400 + 80 * TURN_COST_M] * 2)
        parts = divide_region(L, BOTH, 3.0)
        assert sorted(round(part.region.area) for part in parts) == [10800, 14400]
        assert {part.bearing_rad for part in parts} == {EAST, NORTH}
        assert sum(part.cost_m for part in parts) == pytest.approx(8400 + 40 * TURN_COST_M)
        assert 40 * TURN_COST_M > CELL_COST_M

    def test_comb_has_teeth(self) -> None:
        parts = divide_region(COMB, BOTH, 3.0)
        assert sorted((round(part.region.area, -2), part.bearing_rad) for part in parts) == [
            (10800, NORTH), (10800, NORTH), (10800, NORTH), (18000, EAST),
        ]  # fmt: skip

    @pytest.mark.parametrize("shape", [shapely.box(0, 0, 100, 60), shapely.Point(0, 0).buffer(80)])
    def test_convex_is_not_cut(self, shape: shapely.Polygon) -> None:
        assert len(divide_region(shape, np.linspace(-1.5, 1.5, 9), 3.0)) == 1

    def test_a_neck_is_cut_across(self) -> None:
        """Two rectangles at an angle, joined by a lane of 20 m: each keeps its own direction."""
        second = affinity.translate(affinity.rotate(shapely.box(-100, -40, 100, 40), 50), 100, 190)
        joined = shapely.union_all([shapely.box(0, 0, 200, 80), second, shapely.box(90, 70, 110, 150)])
        bearings = np.array([EAST, NORTH, math.radians(50)])
        first, other = divide_region(joined, bearings, 3.0)[:2]
        assert {first.bearing_rad, other.bearing_rad} == {EAST, math.radians(50)}
        assert min(first.region.area, other.region.area) > 200 * 80 - 1

    def test_nothing_is_not_divided(self) -> None:
        assert divide_region(shapely.Polygon(), BOTH, 3.0) == []

    @pytest.mark.parametrize("name", SHAPES)
    @given(turn=st.sampled_from([0.0, 17.0, 133.0]), width=st.sampled_from([2.0, 3.0, 6.0]))
    @settings(max_examples=5)
    def test_parts_are_the_region(self, name: str, turn: float, width: float) -> None:
        shape = affinity.rotate(SHAPES[name], turn, origin=(0, 0))
        parts = [part.region for part in divide_region(shape, np.linspace(-1.4, 1.5, 12), width)]
        assert math.fsum(part.area for part in parts) == pytest.approx(shape.area, rel=1e-6)
        assert shapely.union_all(parts, grid_size=1e-6).symmetric_difference(shape).area < 1e-3


def swaths(layout: Layout, number: int) -> shapely.Geometry:
    lines = [shapely.LineString([t.start_m, t.end_m]) for t in layout.swaths if t.cell_number == number]
    return shapely.union_all(shapely.buffer(lines, 0.5 * layout.width_m, cap_style="flat"), grid_size=1e-6)


def in_cells(shape: shapely.Polygon, rounds: int = 3) -> Layout | None:
    plain = lay_swaths(Field("f", shape), 3.0, 0.0, headland_passes=rounds)
    return next((option for option in list_layout_alternatives(plain) if len(option.cells) > 1), None)


class TestLayouts:
    def test_two_bearings_beat_one_on_an_l(self) -> None:
        """Inside three rounds arms are 42 m wide: 14 lines in each, 28 turns instead of 14 + 60."""
        options = list_layout_alternatives(lay_swaths(Field("l", L), 3.0, 0.0, headland_passes=3))
        best, plain = options[0], next(option for option in options if len(option.cells) == 1)
        assert (len(best.swaths), len(plain.swaths)) == (28, 74)
        assert estimate_layout_cost_m(best) == pytest.approx(
            estimate_layout_cost_m(plain) - (74 - 28) * TURN_COST_M + CELL_COST_M, abs=1.0
        )

    def test_a_turn_costs_what_leads_to_the_nearest_end(self) -> None:
        """20 lines of 102 m inside three passes; over one line 90 m, over two 30: every swath has one two lines on."""
        layout = lay_swaths(Field("r", shapely.box(0, 0, 120, 78)), 3.0, 0.0, 90.0, headland_passes=3)
        assert estimate_layout_cost_m(layout, EffortRates((90.0, 30.0))) == pytest.approx(20 * (102 + 30))
        assert estimate_layout_cost_m(layout, EffortRates((90.0,))) == pytest.approx(20 * (102 + 90))

    @pytest.mark.parametrize("name", SHAPES)
    def test_cells_cover_the_region_and_tracks_run_in_theirs(self, name: str) -> None:
        layout = in_cells(SHAPES[name])
        assert layout is not None
        assert math.fsum(cell.area_m2 for cell in layout.cells) == pytest.approx(layout.inner_region.area, rel=1e-6)
        assert [cell.number for cell in layout.cells] == list(range(1, len(layout.cells) + 1))
        for cell in layout.cells:
            left = shapely.difference(cell.region, swaths(layout, cell.number), grid_size=1e-6)
            assert left.buffer(-0.1).area < 0.25 * 3.0**2
            for track in (track for track in layout.swaths if track.cell_number == cell.number):
                ahead = np.subtract(track.end_m, track.start_m) / track.length_m
                assert ahead == pytest.approx((math.cos(cell.bearing_rad), math.sin(cell.bearing_rad)), abs=1e-9)
                line = shapely.LineString([track.start_m, track.end_m])
                assert track.length_m < 5.0 + 1e-6 or cell.region.buffer(0.5 * 3.0 + 1e-3).covers(line)

    @pytest.mark.parametrize("name", SHAPES)
    def test_a_line_number_is_used_in_one_cell(self, name: str) -> None:
        layout = in_cells(SHAPES[name])
        assert layout is not None
        assert len({(track.line, track.piece) for track in layout.swaths}) == len(layout.swaths)
        cells = {track.line: track.cell_number for track in layout.swaths}
        assert [cells[line] for line in sorted(cells)] == sorted(cells.values())
        assert all(cells[track.line] == track.cell_number for track in layout.swaths)

    def test_a_bearing_is_given_to_a_cell(self) -> None:
        layout = in_cells(L)
        assert layout is not None
        other = replace_bearings(layout, {2: 30.0})
        assert [round(cell.bearing_deg, 6) for cell in other.cells] == [round(layout.cells[0].bearing_deg, 6), 30.0]
        assert [cell.region for cell in other.cells] == [cell.region for cell in layout.cells]
        assert [t for t in other.swaths if t.cell_number == 1] == [t for t in layout.swaths if t.cell_number == 1]
        assert min(track.line for track in other.swaths if track.cell_number == 2) == 14

    @pytest.mark.parametrize("rounds", [0, 3])
    def test_the_bearing_of_the_only_cell_is_that_of_the_field(self, rounds: int) -> None:
        field = Field("r", shapely.box(0, 0, 120, 80))
        given = replace_bearings(lay_swaths(field, 3.0, 9.0, headland_passes=rounds), {1: 20.0})
        assert given.swaths == lay_swaths(field, 3.0, 9.0, 20.0, headland_passes=rounds).swaths

    @pytest.mark.parametrize("number", [0, 3])
    def test_a_cell_that_does_not_exist(self, number: int) -> None:
        layout = in_cells(L)
        assert layout is not None
        with pytest.raises(FieldError, match=f"Cell {number} .* has 2 cells; use 1 to 2"):
            replace_bearings(layout, {number: 45.0})

    @pytest.mark.slow
    @given(turn=st.floats(0, 360), mirrored=st.booleans())
    @settings(max_examples=10)
    def test_effort_stays_when_the_field_is_moved(self, turn: float, mirrored: bool) -> None:
        shape = shapely.Polygon([(0, 0), (200, 10), (190, 75), (70, 70), (64, 210), (5, 205)])
        other = affinity.rotate(affinity.scale(shape, -1 if mirrored else 1, 1), turn)
        before, after = (
            [
                estimate_layout_cost_m(option)
                for option in list_layout_alternatives(lay_swaths(Field("f", one), 3.0, 0.0, headland_passes=2))
            ]
            for one in (shape, other)
        )
        assert after[0] == pytest.approx(before[0], rel=2e-3)


@pytest.mark.parametrize("rounds", [0, 3])
def test_one_bearing_is_one_cell(rounds: int) -> None:
    layout = lay_swaths(rectangle(200, 80), 3.0, 9.0, 90.0, headland_passes=rounds)
    (cell,) = layout.cells
    assert (cell.number, cell.bearing_rad, cell.bearing_deg) == (1, layout.bearing_rad, 90.0)
    assert cell.region is layout.inner_region and cell.area_m2 == layout.inner_region.area
    assert {track.cell_number for track in layout.swaths} == {1}


@pytest.mark.parametrize(("apart_m", "spacing"), [(0.0, 2.0), (2.85, 2.85), (9.0, 3.0)])
def test_lines_inside_rounds_are_as_far_apart_as_asked_and_cover_all(apart_m: float, spacing: float) -> None:
    """7 m inside three rounds take three lines of 3 m; what they overlap may lie between them or outside."""
    layout = lay_swaths(rectangle(200, 25), 3.0, 9.0, 90.0, headland_passes=3, min_spacing_m=apart_m)
    across = [track.start_m[1] for track in layout.swaths]
    assert sorted(across) == pytest.approx([12.5 - spacing, 12.5, 12.5 + spacing])
    lines = [shapely.LineString([track.start_m, track.end_m]) for track in layout.swaths]
    swaths = shapely.union_all(shapely.buffer(lines, 1.5, cap_style="flat"))
    assert layout.inner_region.difference(swaths).area == pytest.approx(0.0, abs=1e-6)
