"""Coverage, trampled ground and excursion of made-up runs, by hand."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fields import Field
from fields.geometry import overlays
from fields.geometry.field_lines import EdgeOverhang
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import Overhang, measure_overhang
from planner.evaluation.ground.coverage import (
    compute_guided_path,
    count_reversals,
    measure_coverage,
)
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.evaluation.ground.wheel_traffic import (
    SHORT_SPAN_ROWS,
    TYRE_WIDTH_M,
    FinishedGroundTraffic,
    measure_crop_traffic_m2,
    measure_finished_ground_traffic,
)
from planner.evaluation.site import TOLERANCE_M
from tests.examples import count_examples
from tests.planner.excursions import measure_excursion_m
from vehicle.missions.plan import ENTER, HEADLAND_PASS, LEAVE, SWATH, TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.sim.compile import compute_contact_boxes

pytestmark = pytest.mark.usefixtures("first_layout")

# The small site is 36 m by 80 m; the implement is 3 m wide.
AREA = 36.0 * 80.0
QUICK = settings(max_examples=count_examples(60))
Poses = list[tuple[float, float, float, bool]]

NORTH = math.pi / 2


def run_of(site: Any, *passes: Poses, kind: str = SWATH) -> SimulationRun:
    """A run in which the bar of tractor k passes its poses (x, y, angle, implement down), one leg per pair of them.

    `kind` is the task of legs with the implement down.
    """
    reach = site.tractor.rear_axle_m + site.implement.hitch_m
    missions, rows = [], []
    for poses in passes:
        xya = np.array([pose[:3] for pose in poses])
        legs = [
            Leg(np.array([a[:2], b[:2]]), 1.0, implement=a[3], task=LegTask(kind if a[3] else TURN))
            for a, b in pairwise(poses)
        ]
        body = xya[:, :2] + reach * np.column_stack([np.cos(xya[:, 2]), np.sin(xya[:, 2])])
        leg = np.minimum(np.arange(len(poses)), len(legs) - 1)
        missions.append(Mission(tuple(legs)))
        zero = np.zeros(len(poses))
        rows.append(np.column_stack([body, xya[:, 2], zero, zero, leg, zero + 1]))
    record = np.stack(rows, axis=1)
    ends = np.full(len(passes), 0.1 * len(record))
    times = np.linspace(0.0, 0.1 * (len(record) - 1), len(record), dtype=np.float64)
    return SimulationRun(Plan(tuple(missions)), DONE, times, record, ends, (), math.inf)


def pass_north(x: float, start: float, end: float, count: int = 30) -> Poses:
    return [(x, float(y), NORTH, True) for y in np.linspace(start, end, count)]


def arc(x: float, y: float, radius: float, start: float, end: float) -> Poses:
    """A left-hand bend of the bar's middle round a point, from one heading to another, a degree at a time."""
    headings = np.linspace(start, end, round(abs(end - start) * 180 / math.pi) + 1)
    return [(x + radius * math.sin(h), y - radius * math.cos(h), float(h), True) for h in headings]


def lap(low: float, east: float, north: float, radius: float, beyond: float) -> Poses:
    """Once round a rectangle from (low, low) with rounded corners, anticlockwise, and some way beyond the start."""
    inner = [(east - radius, low + radius), (east - radius, north - radius), (low + radius, north - radius),
             (low + radius, low + radius)]  # fmt: skip
    corners = [pose for k, place in enumerate(inner) for pose in arc(*place, radius, k * NORTH, (k + 1) * NORTH)]
    start = low + radius
    poses = [(start, low, 0.0, True), *corners, (start + beyond, low, 2 * math.pi, True)]
    return [(*(a + t * (b - a)), True) for a, b in pairwise(np.array(poses)[:, :3]) for t in np.linspace(0, 1, 5)]


def on_field(site: Any, polygon: shapely.Polygon) -> PlanningContext:
    """The site with another field; its tracks stay, and do not count."""
    changed: PlanningContext = replace(site, layout=replace(site.layout, field=Field("drawn", polygon)))
    return changed


class TestCoverage:
    def test_a_straight_pass_works_length_times_width(self, small_site: Any) -> None:
        share = measure_coverage(run_of(small_site, pass_north(10.0, 5.0, 55.0)), small_site)
        assert share.worked_pct == pytest.approx(100 * 50.0 * 3.0 / AREA, rel=1e-9)
        assert share.overlap_pct == pytest.approx(0.0, abs=1e-9)

    @pytest.mark.parametrize("aside", [0.5, 1.0, 2.9, 3.0])
    def test_two_passes_overlap_by_what_they_share(self, small_site: Any, aside: float) -> None:
        run = run_of(small_site, pass_north(10.0, 5.0, 55.0), pass_north(10.0 + aside, 5.0, 55.0))
        share = measure_coverage(run, small_site)
        assert share.worked_pct == pytest.approx(100 * 50.0 * (3.0 + aside) / AREA, rel=1e-6)
        assert share.overlap_pct == pytest.approx(100 * 50.0 * (3.0 - aside) / AREA, rel=1e-6, abs=1e-6)

    def test_a_lifted_implement_works_nothing(self, small_site: Any) -> None:
        lifted = [(*pose[:3], False) for pose in pass_north(10.0, 5.0, 55.0)]
        share = measure_coverage(run_of(small_site, lifted), small_site)
        assert (share.worked_pct, share.overlap_pct) == (0.0, 0.0)

    def test_lifting_leaves_a_gap(self, small_site: Any) -> None:
        poses = [(10.0, float(y), NORTH, not 20 <= y < 30) for y in range(5, 56)]
        share = measure_coverage(run_of(small_site, poses), small_site)
        assert share.worked_pct == pytest.approx(100 * 40.0 * 3.0 / AREA, rel=1e-6)

    def test_a_hole_is_not_worked(self, place: Any) -> None:
        holed = place(shapely.box(0, 0, 60, 80).difference(shapely.box(20, 30, 26, 40)), margin_m=0.0)
        share = measure_coverage(run_of(holed, pass_north(23.0, 20.0, 60.0)), holed)
        assert share.worked_pct == pytest.approx(100 * 30.0 * 3.0 / (60 * 80 - 60), rel=1e-6)


class TestSweptInBends:
    def test_a_bend_sweeps_part_of_a_ring(self, small_site: Any) -> None:
        share = measure_coverage(run_of(small_site, arc(18.0, 40.0, 6.0, 0.3, 2.9)), small_site)
        assert share.worked_m2 == pytest.approx(0.5 * 2.6 * (7.5**2 - 4.5**2), rel=2e-3)
        assert share.overlap_m2 == pytest.approx(0.0, abs=1e-3)

    def test_a_bar_that_turns_on_the_spot_sweeps_a_disc(self, small_site: Any) -> None:
        share = measure_coverage(run_of(small_site, arc(18.0, 40.0, 0.0, 0.0, math.pi)), small_site)
        assert share.worked_m2 == pytest.approx(math.pi * 1.5**2, rel=0.01)

    def test_a_round_is_worked_where_it_meets_itself(self, small_site: Any) -> None:
        # The middle of the bar drives 33 m by 77 m with corners of 4 m, and 5 m beyond the start.
        field = shapely.box(0, 0, 36, 80).difference(shapely.box(3, 3, 33, 77))
        site = on_field(small_site, field)
        share = measure_coverage(run_of(site, lap(1.5, 34.5, 78.5, 4.0, 5.0)), site)
        corner = (1 - math.pi / 4) * (4.0 + 1.5) ** 2
        assert corner == pytest.approx(6.49, abs=0.01)
        assert share.unworked_m2 == pytest.approx(4 * corner, rel=0.01)
        assert share.overlap_m2 == pytest.approx(5.0 * 3.0, rel=0.01)
        assert share.largest_piece.m2 == pytest.approx(corner, rel=0.05)
        assert (
            min(share.largest_piece.x_m, 36 - share.largest_piece.x_m) < 2
            and min(share.largest_piece.y_m, 80 - share.largest_piece.y_m) < 2
        )

    def test_backwards_over_the_same_ground_is_overlap(self, small_site: Any) -> None:
        there = pass_north(10.0, 5.0, 55.0)
        share = measure_coverage(run_of(small_site, [*there, *there[::-1]]), small_site)
        assert share.worked_m2 == pytest.approx(150.0, rel=1e-9)
        assert share.overlap_m2 == pytest.approx(150.0, rel=1e-9)


class TestMissed:
    def test_what_a_pass_leaves_on_both_sides(self, small_site: Any) -> None:
        share = measure_coverage(run_of(small_site, pass_north(10.0, -5.0, 85.0)), small_site)
        assert share.unworked_m2 == pytest.approx(AREA - 240.0, rel=1e-9)
        assert [piece.area for piece in share.unworked_pieces] == pytest.approx([24.5 * 80, 8.5 * 80], rel=1e-9)
        assert share.largest_piece.m2 == pytest.approx(24.5 * 80, rel=1e-9)
        assert 11.5 < share.largest_piece.x_m < 36 and 0 < share.largest_piece.y_m < 80

    def test_nothing_worked_is_all_missed_and_never_finished(self, small_site: Any) -> None:
        share = measure_coverage(run_of(small_site, [(10.0, 5.0, NORTH, False), (10.0, 9.0, NORTH, False)]), small_site)
        assert (share.worked_m2, share.unworked_m2) == (0.0, pytest.approx(AREA))
        assert share.extrapolate_to_field(60.0) == math.inf

    def test_finishing_is_at_the_own_rate(self, small_site: Any) -> None:
        share = measure_coverage(run_of(small_site, pass_north(10.0, -5.0, 85.0)), small_site)
        assert share.extrapolate_to_field(60.0) == pytest.approx(60.0 * 12, rel=1e-9), (
            "one of twelve swaths in a minute"
        )

    def test_a_narrow_neck_does_not_make_one_piece_of_two(self, small_site: Any) -> None:
        rooms = shapely.union_all([shapely.box(0, 0, 20, 20), shapely.box(20, 9, 40, 10), shapely.box(40, 0, 50, 20)])
        site = on_field(small_site, rooms)
        share = measure_coverage(run_of(site, [(100.0, 0.0, 0.0, True), (110.0, 0.0, 0.0, True)]), site)
        assert share.unworked_m2 == pytest.approx(620.0) and len(share.unworked_pieces) == 1
        assert share.largest_piece.m2 == pytest.approx(400.0, rel=1e-6)
        assert share.largest_piece.x_m < 20

    def test_ground_too_narrow_to_be_sent_to_is_missed_but_no_piece(self, small_site: Any) -> None:
        field = shapely.box(0, 0, 3.1, 50)
        site = on_field(small_site, field)
        share = measure_coverage(run_of(site, pass_north(1.5, -1.0, 51.0)), site)
        assert share.unworked_m2 == pytest.approx(5.0, rel=1e-6)
        assert share.unworked_pieces == () and share.largest_piece is None


@st.composite
def convex_fields(draw: Any) -> shapely.Polygon:
    """A convex field of 20 to 120 m."""
    angles = draw(st.lists(st.floats(0, 2 * math.pi), min_size=3, max_size=8))
    across, along = draw(st.floats(10, 60)), draw(st.floats(10, 60))
    corners = [(round(across * math.cos(a), 3), round(along * math.sin(a), 3)) for a in angles]
    hull = shapely.convex_hull(shapely.MultiPoint(corners))
    assume(hull.geom_type == "Polygon" and hull.area > 100)
    return hull


@st.composite
def wanderings(draw: Any) -> Poses:
    """A bar that wanders about: bends of any sharpness, forwards and backwards, up and down."""
    x, y, heading = draw(st.floats(-50, 50)), draw(st.floats(-50, 50)), draw(st.floats(-4, 4))
    moves = st.tuples(st.floats(-8, 8), st.floats(-1, 1), st.booleans(), st.integers(1, 12))
    poses = [(x, y, heading, True)]
    for metres, turn, down, count in draw(st.lists(moves, min_size=1, max_size=8)):
        for _ in range(count):
            heading += turn / 4
            x, y = x + metres / 4 * math.cos(heading), y + metres / 4 * math.sin(heading)
            poses.append((x, y, heading, down))
    return poses


@QUICK
@given(field=convex_fields(), way=wanderings(), turned=st.floats(0, 360))
def test_swept_and_missed_are_the_field_whatever_is_driven(
    small_site: Any, field: shapely.Polygon, way: Poses, turned: float
) -> None:
    site = on_field(small_site, shapely.affinity.rotate(field, turned))
    share = measure_coverage(run_of(site, way), site)
    assert share.worked_m2 + share.unworked_m2 == pytest.approx(share.field_m2, rel=1e-6, abs=1e-3)
    assert share.overlap_m2 >= 0 and 0 <= share.worked_pct <= 100 + 1e-6
    assert sum(piece.area for piece in share.unworked_pieces) <= share.unworked_m2 + 1e-3
    if share.largest_piece is not None:
        assert share.largest_piece.m2 <= share.unworked_m2 + 1e-3
        assert site.layout.field.boundary.buffer(1e-3).covers(
            shapely.Point(share.largest_piece.x_m, share.largest_piece.y_m)
        )


@QUICK
@given(field=convex_fields(), offset=st.floats(-60, 60), heading=st.floats(0, 2 * math.pi))
def test_a_straight_pass_sweeps_its_strip_of_any_field(
    small_site: Any, field: shapely.Polygon, offset: float, heading: float
) -> None:
    site = on_field(small_site, field)
    ahead, aside = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    ends = np.array([-100.0, 100.0])[:, None] * ahead + offset * aside
    strip = shapely.LineString(ends).buffer(1.5, cap_style="flat").intersection(field)
    poses = [(*(ends[0] + t * (ends[1] - ends[0])), heading, True) for t in np.linspace(0, 1, 40)]
    assert measure_coverage(run_of(site, poses), site).worked_m2 == pytest.approx(strip.area, rel=1e-6, abs=1e-3)


class TestTrampled:
    """One tractor works a swath of 3 m northwards; another crosses it eastwards with its implement up, or down."""

    SWATH = pass_north(10.0, 5.0, 55.0)
    ONCE = 2 * TYRE_WIDTH_M * 3.0  # left and right wheels, front and rear in one line, across 3 m

    def crossing(self, y: float, down: bool = False, count: int = 30) -> Poses:
        return [(float(x), y, 0.0, down) for x in np.linspace(-4.0, 20.0, count)]

    def waiting(self, pose: tuple[float, float, float, bool]) -> Poses:
        return [(*pose[:3], False)] * 30

    def run(self, site: Any, crossing: Poses, *, before: bool = False, kind: str = SWATH) -> SimulationRun:
        parts = [(self.SWATH, self.waiting(crossing[0])), (self.waiting(self.SWATH[-1]), crossing)]
        if before:
            parts = [(self.waiting(self.SWATH[0]), crossing), (self.SWATH, self.waiting(crossing[-1]))]
        return run_of(site, *([*parts[0][k], *parts[1][k]] for k in (0, 1)), kind=kind)

    def trampled(self, site: Any, run: SimulationRun) -> float:
        return measure_finished_ground_traffic(run, site, compute_swept_area(run, site)).off_headland_m2

    def test_wheels_over_a_finished_swath(self, small_site: Any) -> None:
        run = self.run(small_site, self.crossing(30.0))
        assert self.trampled(small_site, run) == pytest.approx(self.ONCE, rel=1e-6)

    def test_with_the_implement_down_it_is_worked_again(self, small_site: Any) -> None:
        assert self.trampled(small_site, self.run(small_site, self.crossing(30.0, down=True))) == 0.0

    def test_what_is_pressed_counts_even_if_it_is_worked_again(self, small_site: Any) -> None:
        across = self.crossing(30.0)
        again = [*self.SWATH, *self.waiting(self.SWATH[-1]), *self.SWATH]
        crosses = [*[across[0]] * len(self.SWATH), *across, *[across[-1]] * len(self.SWATH)]
        run = run_of(small_site, again, crosses)
        traffic = measure_finished_ground_traffic(run, small_site, compute_swept_area(run, small_site))
        assert traffic.off_headland_m2 == pytest.approx(self.ONCE, rel=1e-6)
        assert traffic.area_m2 == pytest.approx(0.0, abs=1e-6)

    def test_the_headland_is_there_to_turn_on(self, small_site: Any) -> None:
        assert self.trampled(small_site, self.run(small_site, self.crossing(30.0), kind=HEADLAND_PASS)) == 0.0

    def test_a_crop_is_driven_over_before_it_is_cut(self, small_site: Any) -> None:
        first, after = (self.run(small_site, self.crossing(30.0), before=before) for before in (True, False))
        assert self.crop_driven_over_m2(small_site, first) == pytest.approx(self.ONCE, rel=1e-6)
        assert self.crop_driven_over_m2(small_site, after) == 0.0

    @pytest.mark.parametrize(("y", "stands"), [(8.0, False), (18.0, False), (40.0, True)])
    def test_a_crop_stands_where_nothing_has_worked_yet(self, small_site: Any, y: float, stands: bool) -> None:
        run = run_of(small_site, pass_north(10.0, 5.0, 55.0, 300), self.crossing(y, count=300))
        assert self.crop_driven_over_m2(small_site, run) == pytest.approx(self.ONCE if stands else 0.0, rel=1e-6)

    def test_wheels_on_the_strip_worked_next_spoil_nothing(self, small_site: Any) -> None:
        run = run_of(small_site, [(10.0, float(y), 0.5 * math.pi, False) for y in range(8)] + self.SWATH)
        assert self.crop_driven_over_m2(small_site, run) == 0.0

    def crop_driven_over_m2(self, site: Any, run: SimulationRun) -> float:
        return measure_crop_traffic_m2(run, site, compute_swept_area(run, site))

    def test_outside_the_field_is_nobodys_ground(self, small_site: Any) -> None:
        site = on_field(small_site, shapely.box(0, 0, 10, 80))
        assert self.trampled(site, self.run(site, self.crossing(30.0))) == pytest.approx(self.ONCE / 2, rel=1e-6)

    @pytest.mark.parametrize(("y", "spoilt"), [(8.0, True), (18.0, True), (40.0, False)])
    def test_while_it_is_being_worked_only_what_is_done_counts(self, small_site: Any, y: float, spoilt: bool) -> None:
        # Both set out together: the bar is at y = 22 after 10 s, when the first crossing wheels are at its swath.
        run = run_of(small_site, pass_north(10.0, 5.0, 55.0, 300), self.crossing(y, count=300))
        assert self.trampled(small_site, run) == pytest.approx(self.ONCE if spoilt else 0.0, rel=1e-6)

    @given(
        y=st.floats(12.0, 50.0), wide=st.floats(0.0, 8.0), waves=st.integers(1, 4), count=st.integers(150, 500),
        down=st.booleans(),
    )  # fmt: skip
    @QUICK
    def test_it_is_the_same_however_long_the_spans_are(
        self, small_site: Any, y: float, wide: float, waves: int, count: int, down: bool
    ) -> None:
        # To and fro across a swath that is being worked, or was, on a way that bends; partly with the implement down.
        turns = np.linspace(0.0, 2.0 * math.pi * waves, count)
        way = np.column_stack([10.0 - 9.0 * np.cos(turns), y + wide * np.sin(0.7 * turns)])
        heading = np.unwrap(np.arctan2(*np.gradient(way, axis=0).T[::-1]))
        driven = [(*row, down and k % 90 > 60) for k, row in enumerate(np.column_stack([way, heading]).tolist())]
        run = run_of(small_site, pass_north(10.0, 5.0, 55.0, count), driven)
        swept = compute_swept_area(run, small_site)
        found = measure_finished_ground_traffic(run, small_site, swept).off_headland_m2
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr("planner.evaluation.ground.wheel_traffic.LONG_SPAN_ROWS", SHORT_SPAN_ROWS)
            assert found == pytest.approx(
                measure_finished_ground_traffic(run, small_site, swept).off_headland_m2, rel=0.02, abs=0.05
            )


class TestOverFinished:
    """The same crossing: metres of it, and ground under wheels, on ground worked for the last time."""

    SWATH, ONCE = TestTrampled.SWATH, TestTrampled.ONCE
    crossing, waiting, run = TestTrampled.crossing, TestTrampled.waiting, TestTrampled.run

    def over_finished(self, site: Any, run: SimulationRun) -> FinishedGroundTraffic:
        return measure_finished_ground_traffic(run, site, compute_swept_area(run, site))

    @pytest.mark.parametrize("kind", [SWATH, HEADLAND_PASS])
    def test_a_headland_pass_counts_as_a_swath_does(self, small_site: Any, kind: str) -> None:
        found = self.over_finished(small_site, self.run(small_site, self.crossing(30.0), kind=kind))
        assert (found.area_m2, found.length_m) == (pytest.approx(self.ONCE, rel=1e-6), pytest.approx(3.0, rel=1e-6))

    def test_metres_count_every_time_and_ground_once(self, small_site: Any) -> None:
        twice = self.crossing(30.0)[::2] + self.crossing(30.0)[::-2]
        found = self.over_finished(small_site, self.run(small_site, twice))
        assert (found.area_m2, found.length_m) == (pytest.approx(self.ONCE, rel=1e-6), pytest.approx(6.0, rel=1e-6))

    def test_before_it_is_worked_it_is_not_finished(self, small_site: Any) -> None:
        found = self.over_finished(small_site, self.run(small_site, self.crossing(30.0), before=True))
        assert found == FinishedGroundTraffic(0.0, 0.0, 0.0)

    def test_what_is_worked_again_later_was_not_finished(self, small_site: Any) -> None:
        # The second tractor crosses the swath with its implement up, then works back over its own wheel marks.
        across = self.crossing(30.0, count=15)
        again = across + [(*pose[:3], True) for pose in across[::-1]]
        found = self.over_finished(small_site, self.run(small_site, again))
        assert found.area_m2 == pytest.approx(0.0, abs=1e-6) and found.length_m == pytest.approx(0.0, abs=1e-6)


@pytest.fixture(scope="module")
def gated_site(place: Any) -> PlanningContext:
    """90 m by 80 m with an entrance in the middle of its west side."""
    site: PlanningContext = place(shapely.box(0, 0, 90, 80), (0.0, 40.0), no_headland=False)
    return site


class TestOutside:
    """Tractor and implement beyond the outline; by default they may reach out by 0.5 m."""

    def test_nothing_in_the_middle(self, small_site: Any) -> None:
        assert measure_overhang(run_of(small_site, pass_north(18.0, 20.0, 60.0)), small_site) == Overhang(0.0, 0.0)

    @pytest.mark.parametrize("lowered", [True, False])
    @pytest.mark.parametrize(("x", "farthest_m", "along_m"), [
        (1.4, 0.0, 0.0), (0.95, 0.4, 0.0), (0.75, 0.6, 40.0), (35.6, 0.95, 40.0), (-9.0, 10.35, 40.0),
    ])  # fmt: skip
    def test_along_the_side_by_half_the_frame(
        self, small_site: Any, x: float, farthest_m: float, along_m: float, lowered: bool
    ) -> None:
        # The frame is a tenth narrower than the swath of 3 m: it reaches 1.35 m to either side.
        poses = [(*pose[:3], lowered) for pose in pass_north(x, 20.0, 60.0)]
        found = measure_overhang(run_of(small_site, poses), small_site)
        assert (found.farthest_m, found.beyond_m) == (pytest.approx(farthest_m), pytest.approx(along_m))

    def test_over_the_end_with_the_nose(self, small_site: Any) -> None:
        nose = compute_contact_boxes(small_site.tractor, small_site.implement)["nose"]
        bar_to_nose = nose + small_site.tractor.rear_axle_m + small_site.implement.hitch_m
        run = run_of(small_site, [(18.0, 60.0 + 0.02 * k, NORTH, True) for k in range(801)])
        found = measure_overhang(run, small_site)
        assert found.farthest_m == pytest.approx(76.0 + bar_to_nose - 80.0)
        assert found.beyond_m == pytest.approx(found.farthest_m - 0.5 - TOLERANCE_M, abs=0.05)

    def test_the_farthest_of_all_tractors_and_the_driving_of_each(self, small_site: Any) -> None:
        run = run_of(small_site, pass_north(0.0, 20.0, 60.0), pass_north(36.0, 10.0, 60.0))
        found = measure_overhang(run, small_site)
        assert (found.farthest_m, found.beyond_m) == (pytest.approx(1.35), pytest.approx(90.0))

    @pytest.mark.parametrize(("kind", "is_outside"), [(ENTER, False), (LEAVE, False), (TURN, True), (SWATH, True)])
    def test_the_gate_is_ground_on_the_way_in_and_out_only(
        self, gated_site: PlanningContext, kind: str, is_outside: bool
    ) -> None:
        run = run_of(gated_site, pass_north(0.0, 41.0, 42.0), kind=kind)
        found = measure_overhang(run, gated_site)
        told = (1.35, 1.0) if is_outside else (0.0, 0.0)
        assert (found.farthest_m, found.beyond_m) == pytest.approx(told)

    def test_open_edges_allow_what_fences_and_edges_of_their_own_do_not(self, small_site: Any) -> None:
        """The west edge is open, at the east one 0.2 m are allowed: 0.3 m less than over edges in general."""
        east = EdgeOverhang(shapely.LineString([(36, 0), (36, 80)]), 0.2)
        field = Field("drawn", shapely.box(0, 0, 36, 80), edge_overhangs=(east,))
        run = run_of(small_site, pass_north(-9.0, 20.0, 60.0), pass_north(35.0, 20.0, 60.0))
        told = [
            measure_overhang(run, replace(small_site, layout=replace(small_site.layout, field=one)))
            for one in (field, field.open_edges())
        ]
        assert [one.farthest_m for one in told] == [pytest.approx(10.35)] * 2
        assert [one.beyond_m for one in told] == [pytest.approx(80.0), pytest.approx(40.0)]


class TestExcursion:
    def shifted(self, site: Any, run: SimulationRun, forward: float) -> SimulationRun:
        """The run moved along so that the antenna, not the bar, passes over the poses."""
        angle = run.record[:, :, 2]
        record = run.record.copy()
        record[:, :, 0] += forward * np.cos(angle)
        record[:, :, 1] += forward * np.sin(angle)
        return replace(run, record=record)

    def antenna_run(self, site: Any, poses: list[tuple[float, float, float, bool]]) -> SimulationRun:
        bar_to_antenna = site.implement.hitch_m + site.tractor.antenna_forward_m
        return self.shifted(site, run_of(site, poses), -bar_to_antenna)

    def test_the_antenna_is_where_the_tractor_carries_it(self, small_site: Any) -> None:
        poses = [(10.0, float(y), NORTH, True) for y in range(5, 30)]
        path = compute_guided_path(self.antenna_run(small_site, poses), small_site, 0)
        assert np.allclose(path, [pose[:2] for pose in poses])

    def test_nothing_outside(self, small_site: Any) -> None:
        assert measure_excursion_m(self.antenna_run(small_site, pass_north(10.0, 5.0, 75.0)), small_site) == 0.0

    def test_out_over_the_end_by_a_known_distance(self, small_site: Any) -> None:
        poses = [(10.0, 0.1 * k + 0.05, NORTH, True) for k in range(700, 830)]
        assert measure_excursion_m(self.antenna_run(small_site, poses), small_site) == pytest.approx(2.95, abs=1e-6)

    def test_both_tractors_count(self, small_site: Any) -> None:
        one = [(-0.4, float(y), NORTH, True) for y in range(10, 51)]
        other = [(36.7, float(y), NORTH, True) for y in range(10, 51)]
        bar_to_antenna = small_site.implement.hitch_m + small_site.tractor.antenna_forward_m
        run = self.shifted(small_site, run_of(small_site, one, other), -bar_to_antenna)
        assert measure_excursion_m(run, small_site) == pytest.approx(0.7)


def test_reversals_are_gear_changes(small_site: Any) -> None:
    def leg(a: float, b: float, gear: int) -> Leg:
        return Leg(np.array([[a, 0.0], [b, 0.0]]), 1.0, gear)

    mission = Mission((leg(0, 5, 1), leg(5, 9, 1), leg(9, 4, -1), leg(4, 8, 1)))
    run = run_of(small_site, pass_north(10.0, 5.0, 55.0))
    assert count_reversals(replace(run, plan=Plan((mission, mission)))) == 4
    assert count_reversals(run) == 0


def test_ground_that_cannot_be_cut_as_it_is_is_cut_on_a_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Edges that cross by a rounding make GEOS give up; measuring must not."""

    def fails(cut: Any) -> Any:
        def cutting(*shapes: Any, grid_size: float | None = None) -> Any:
            if grid_size is None:
                raise shapely.errors.GEOSException("TopologyException: side location conflict")
            return cut(*shapes, grid_size=grid_size)

        return cutting

    for name in ("intersection", "difference", "union_all"):
        monkeypatch.setattr(shapely, name, fails(getattr(shapely, name)))
    one, other = shapely.box(0, 0, 4, 3), shapely.box(1, 1, 9, 9)
    assert overlays.clip_area(one, other).area == pytest.approx(6.0)
    assert overlays.subtract_area(one, other).area == pytest.approx(6.0)
    assert overlays.unite_areas(np.array([one, other])).area == pytest.approx(12.0 + 64.0 - 6.0)
