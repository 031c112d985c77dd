"""Sections of an implement switch themselves off over worked ground and outside the field: areas by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import Coverage, measure_coverage
from planner.evaluation.ground.swept_area import (
    MIN_UNWORKED_M,
    SweptArea,
    build_swept_polygons,
    compute_swept_area,
    compute_swept_between_rows,
    switch_sections,
)
from planner.evaluation.ground.wheel_traffic import measure_finished_ground_traffic
from planner.request.plan_request import PlanRequest
from tests.examples import count_examples
from tests.planner.test_ground_coverage import NORTH, Poses, arc, on_field, pass_north, run_of
from vehicle.missions.run import SimulationRun

pytestmark = pytest.mark.usefixtures("first_layout")

FIELD = shapely.box(0, 0, 60, 80)
WIDTH_M = 6.0


@pytest.fixture(scope="module")
def site(place: Any) -> PlanningContext:
    """60 m by 80 m; the implement is 6 m wide."""
    made: PlanningContext = place(FIELD, width_m=WIDTH_M)
    return made


def cut(site: PlanningContext, sections: int) -> PlanningContext:
    """The site with that number of sections."""
    return replace(site, request=replace(site.request, sections=sections))


def measure(site: PlanningContext, sections: int, *passes: Poses) -> tuple[SweptArea, Coverage]:
    divided = cut(site, sections)
    run = run_of(divided, *passes)
    return compute_swept_area(run, divided), measure_coverage(run, divided)


def join(*passes: Poses) -> Poses:
    """Passes one after the other, the implement up between them."""
    return [pose for one in passes for pose in [*one[:-1], (*one[-1][:3], False)]]


def lift(*places: tuple[float, float]) -> Poses:
    """Along the places with the implement up, half a metre between poses; the bar always looks north."""
    line = shapely.segmentize(shapely.LineString(places), 0.5)
    return [(x, y, NORTH, False) for x, y in line.coords]


def measure_outside_m2(swept: SweptArea) -> float:
    return float(shapely.area(shapely.difference(swept.ground, FIELD)).sum())


@pytest.mark.parametrize(("sections", "overlap_m"), [(1, 4.0), (2, 1.0), (3, 0.0), (6, 0.0), (4, 1.0), (5, 0.4)])
def test_two_passes_overlap_by_what_sections_leave(site: Any, sections: int, overlap_m: float) -> None:
    """The second pass lies 2 m beside the first, so that 4 of its 6 m are worked: sections on these alone are off."""
    swept, coverage = measure(site, sections, join(pass_north(20.0, 10.0, 60.0), pass_north(22.0, 10.0, 60.0)))
    assert coverage.worked_m2 == pytest.approx(50.0 * 8.0)
    assert coverage.overlap_m2 == pytest.approx(50.0 * overlap_m, abs=1e-6)
    on = WIDTH_M - 4.0 + overlap_m
    assert shapely.area(swept.ground).tolist() == pytest.approx([300.0, 50.0 * on])
    assert swept.share[1] == pytest.approx([1.0 - on / WIDTH_M, 1.0]), "the sections on the right"


def test_a_pass_over_worked_ground_is_off(site: Any) -> None:
    swept, coverage = measure(site, 6, join(pass_north(20.0, 10.0, 60.0), pass_north(20.0, 55.0, 15.0)))
    assert len(swept.ground) == 1 and coverage.overlap_m2 == 0.0


def test_across_a_pass_every_section_is_off_between_its_edges(site: Any) -> None:
    """Square to the first pass, 6 m wide: on before it and behind it, by all sections alike."""
    across = [(float(x), 30.0, 0.0, True) for x in np.linspace(5.0, 50.0, 46)]
    swept, coverage = measure(site, 6, join(pass_north(20.0, 10.0, 60.0), across))
    assert coverage.overlap_m2 == pytest.approx(0.0, abs=1e-6)
    assert [one.bounds for one in swept.ground[1:]] == [
        pytest.approx((5.0, 27.0, 17.0, 33.0)), pytest.approx((23.0, 27.0, 50.0, 33.0))
    ]  # fmt: skip


@pytest.mark.parametrize("sections", [2, 3, 6, 12])
@pytest.mark.parametrize("reach_m", [12.0, -12.0])
def test_a_pass_leaves_the_field_at_an_angle(site: Any, sections: int, reach_m: float) -> None:
    """Each section goes on until its last corner is over the edge: a triangle of it lies outside.

    At an angle a to the edge a section of width s has worked s * s / (2 tan a) outside when it switches off; driving
    in or out is the same.
    """
    angle = math.radians(60.0)
    along = np.linspace(reach_m, -40.0, 300) if reach_m > 0 else np.linspace(-40.0, 12.0, 300)
    heading = NORTH - math.radians(30.0) + (math.pi if reach_m > 0 else 0.0)  # 60 degrees from the north edge
    towards = np.array([math.sin(math.radians(30.0)), math.cos(math.radians(30.0))])
    places = np.array([30.0, 80.0]) + along[:, None] * towards
    swept, coverage = measure(site, sections, [(float(x), float(y), heading, True) for x, y in places])
    width = WIDTH_M / sections
    assert measure_outside_m2(swept) == pytest.approx(sections * width**2 / (2 * math.tan(angle)), rel=1e-3)
    # Inside nothing is lost: the middle of the bar crosses the edge after 40 m.
    assert coverage.worked_m2 == pytest.approx(40.0 * WIDTH_M, rel=1e-4)
    assert coverage.overlap_m2 == pytest.approx(0.0, abs=1e-3)


def test_obstacles_are_no_ground_to_work(site: Any) -> None:
    pond = shapely.box(18.0, 30.0, 20.0, 40.0)
    swept, _ = measure(on_field(site, FIELD.difference(pond)), 6, pass_north(20.0, 10.0, 60.0))
    off = shapely.difference(shapely.box(17.0, 10.0, 23.0, 60.0), shapely.union_all(swept.ground))
    assert off.symmetric_difference(pond).area < 1e-4


def test_one_section_works_wherever_it_is_down(site: Any) -> None:
    """Today's implement: what it passes over again or outside counts whole."""
    swept, coverage = measure(site, 1, join(pass_north(20.0, 60.0, 90.0), pass_north(20.0, 60.0, 90.0)))
    assert shapely.area(swept.ground).tolist() == pytest.approx([180.0, 180.0])
    assert (coverage.worked_m2, coverage.overlap_m2) == (pytest.approx(120.0), pytest.approx(120.0))
    assert measure_outside_m2(swept) == pytest.approx(120.0)


def test_the_first_of_two_tractors_works_the_ground(site: Any) -> None:
    """The second passes the same ground from row 20 on; it is off there, whichever tractor it is."""
    first = pass_north(20.0, 10.0, 60.0, count=60)
    later = [(40.0, float(y), NORTH, False) for y in np.linspace(0, 19, 20)] + pass_north(20.0, 10.0, 60.0, count=40)
    for passes, worker in (((first, later), 0), ((later, first), 1)):
        swept, coverage = measure(site, 3, *passes)
        assert set(swept.tractor.tolist()) == {worker} and coverage.overlap_m2 == 0.0


@pytest.mark.slow
def test_a_bend_is_worked_once_and_whole(site: Any) -> None:
    """Round about a place 2 m beside the middle of the bar: its inner end, 1 m beyond, does the same disc twice."""
    circle = arc(30.0, 40.0, 2.0, 0.0, 2 * math.pi)
    whole, divided = (measure(site, sections, circle)[1] for sections in (1, 24))
    assert (whole.worked_m2, whole.overlap_m2) == (
        pytest.approx(25.0 * math.pi, rel=0.005),
        pytest.approx(math.pi, rel=0.03),
    )
    assert divided.worked_m2 == pytest.approx(whole.worked_m2, rel=0.002) and divided.overlap_m2 < 0.3


def test_wheels_on_what_some_sections_left(site: Any) -> None:
    """The second of two passes is worked by its right third; wheels cross the ground of both as 8 m, not 6 and 6."""
    divided = cut(site, 3)
    round_about = lift((20.0, 60.5), (20.0, 75.0), (35.0, 75.0), (35.0, 2.0), (22.0, 2.0))
    across = lift((22.0, 60.5), (22.0, 75.0), (5.0, 75.0), (5.0, 30.0), (50.0, 30.0))
    passes = pass_north(20.0, 20.0, 60.0) + round_about + pass_north(22.0, 5.0, 60.0) + across
    run: SimulationRun = run_of(divided, passes)
    traffic = measure_finished_ground_traffic(run, divided, compute_swept_area(run, divided))
    assert traffic.length_m == pytest.approx(8.0, abs=1e-3)


def test_what_sections_swept_between_their_rows_is_their_ground(site: Any) -> None:
    divided = cut(site, 3)
    run = run_of(divided, join(pass_north(20.0, 10.0, 60.0), pass_north(22.0, 10.0, 60.0)))
    swept = compute_swept_area(run, divided)
    rows = list(zip(swept.tractor.tolist(), swept.first.tolist(), swept.last.tolist(), strict=True))
    again = compute_swept_between_rows(run, divided, rows, swept.share)
    assert shapely.area(shapely.symmetric_difference(again, swept.ground)).max() < 1e-6


@settings(max_examples=count_examples(30), deadline=None)
@given(sections=st.integers(2, 8), beside_m=st.floats(0.3, 7.0), turn_deg=st.floats(-60.0, 60.0))
def test_sections_lose_nothing_and_overlap_less(sections: int, beside_m: float, turn_deg: float) -> None:
    """Of two straight passes at any angle the same ground is worked, less slivers, and never more of it twice."""
    heading = math.radians(turn_deg)
    along, across = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    bars = []
    for middle, ahead, left in ((np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0])),
                                (np.array([0.0, beside_m]), along, across)):  # fmt: skip
        path = middle + np.linspace(-20.0, 20.0, 41)[:, None] * ahead
        bars.append(np.stack([path + 3.0 * left, path - 3.0 * left]))
    ground = build_swept_polygons(bars)
    region = shapely.box(-15, -15, 15, 15)
    parts = list(switch_sections(bars, ground, region, sections))
    wanted = shapely.union_all(ground).intersection(region)
    done = shapely.union_all([part.ground for part in parts])
    assert wanted.difference(done).area <= 2 * MIN_UNWORKED_M * 40.0 + 1e-6
    assert all(0.0 <= part.begin < part.end <= 40.0 for part in parts)
    assert sum(part.ground.area for part in parts) <= shapely.area(ground).sum() + 1e-6
    # What is on is over unworked ground of the region somewhere along its bar: no part is wholly outside.
    assert all(part.ground.intersection(region).area > 0.0 for part in parts)


def test_more_sections_overlap_less_on_a_plan(place: Any) -> None:
    """A slanted field planned and driven: doubling sections never adds to the overlap, and works the same ground."""
    from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate

    slanted = place(shapely.Polygon([(0, 0), (120, 30), (100, 110), (10, 80)]), width_m=6.0, no_headland=False)
    run = simulate_candidate(slanted, Candidate("split-field", 1)).run
    assert run is not None
    told = [measure_coverage(run, cut(slanted, sections)) for sections in (1, 2, 4, 8)]
    overlaps = [one.overlap_pct for one in told]
    assert overlaps == sorted(overlaps, reverse=True) and overlaps[-1] < 0.6 * overlaps[0]
    assert all(one.worked_pct == pytest.approx(told[0].worked_pct, abs=0.1) for one in told)


def test_a_request_has_one_section_by_default() -> None:
    assert PlanRequest().sections == 1 and PlanRequest.from_options({"sections": 13}).sections == 13
