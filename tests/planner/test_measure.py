"""Coverage and excursion of made-up runs, by hand."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely

from planner.measure import coverage, excursion, finite_or_none, guided_point, reversals
from vehicle.missions import TRACK, TURN, Leg, Mission, Plan, Task
from vehicle.run import DONE, Run

# The small site is 36 m by 80 m; the implement is 3 m wide.
AREA = 36.0 * 80.0


def run_of(site: Any, *passes: list[tuple[float, float, float, bool]]) -> Run:
    """A run in which the bar of tractor k passes its poses (x, y, angle, implement down), one leg per pair of them."""
    reach = site.tractor.rear_axle_m + site.implement.hitch_m
    missions, rows = [], []
    for poses in passes:
        xya = np.array([pose[:3] for pose in poses])
        legs = [
            Leg(np.array([a[:2], b[:2]]), 1.0, implement=a[3], task=Task(TRACK if a[3] else TURN))
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
    return Run(Plan(tuple(missions)), DONE, times, record, ends, (), math.inf)


NORTH = math.pi / 2


def pass_north(x: float, start: float, end: float) -> list[tuple[float, float, float, bool]]:
    return [(x, float(y), NORTH, True) for y in np.linspace(start, end, 30)]


class TestCoverage:
    def test_a_straight_pass_works_length_times_width(self, small_site: Any) -> None:
        share = coverage(run_of(small_site, pass_north(10.0, 5.0, 55.0)), small_site)
        assert share.worked_pct == pytest.approx(100 * 50.0 * 3.0 / AREA, rel=1e-9)
        assert share.overlap_pct == pytest.approx(0.0, abs=1e-9)

    @pytest.mark.parametrize("angle", [0.0, 0.4, 2.5, -1.2])
    def test_in_any_direction(self, small_site: Any, angle: float) -> None:
        steps = np.linspace(-8.0, 8.0, 20)
        poses = [(18 + d * math.cos(angle), 40 + d * math.sin(angle), angle, True) for d in steps]
        share = coverage(run_of(small_site, poses), small_site)
        assert share.worked_pct == pytest.approx(100 * 16.0 * 3.0 / AREA, rel=1e-6)

    @pytest.mark.parametrize("aside", [0.5, 1.0, 2.9])
    def test_two_passes_overlap_by_what_they_share(self, small_site: Any, aside: float) -> None:
        run = run_of(small_site, pass_north(10.0, 5.0, 55.0), pass_north(10.0 + aside, 5.0, 55.0))
        share = coverage(run, small_site)
        assert share.worked_pct == pytest.approx(100 * 50.0 * (3.0 + aside) / AREA, rel=1e-6)
        assert share.overlap_pct == pytest.approx(100 * 50.0 * (3.0 - aside) / AREA, rel=1e-6)

    def test_passes_edge_to_edge_do_not_overlap(self, small_site: Any) -> None:
        share = coverage(run_of(small_site, pass_north(10.0, 5.0, 55.0), pass_north(13.0, 5.0, 55.0)), small_site)
        assert share.worked_pct == pytest.approx(100 * 50.0 * 6.0 / AREA, rel=1e-6)
        assert share.overlap_pct == pytest.approx(0.0, abs=1e-6)

    def test_what_lies_outside_the_field_does_not_count(self, small_site: Any) -> None:
        share = coverage(run_of(small_site, pass_north(0.5, 70.0, 90.0)), small_site)
        assert share.worked_pct == pytest.approx(100 * 10.0 * 2.0 / AREA, rel=1e-6)

    def test_a_lifted_implement_works_nothing(self, small_site: Any) -> None:
        lifted = [(*pose[:3], False) for pose in pass_north(10.0, 5.0, 55.0)]
        share = coverage(run_of(small_site, lifted), small_site)
        assert (share.worked_pct, share.overlap_pct) == (0.0, 0.0)

    def test_lifting_leaves_a_gap(self, small_site: Any) -> None:
        poses = [(10.0, float(y), NORTH, not 20 <= y < 30) for y in range(5, 56)]
        share = coverage(run_of(small_site, poses), small_site)
        assert share.worked_pct == pytest.approx(100 * 40.0 * 3.0 / AREA, rel=1e-6)

    def test_a_hole_is_not_worked(self, place: Any) -> None:
        holed = place(shapely.box(0, 0, 60, 80).difference(shapely.box(20, 30, 26, 40)), margin_m=0.0)
        share = coverage(run_of(holed, pass_north(23.0, 20.0, 60.0)), holed)
        assert share.worked_pct == pytest.approx(100 * 30.0 * 3.0 / (60 * 80 - 60), rel=1e-6)


class TestExcursion:
    def shifted(self, site: Any, run: Run, forward: float) -> Run:
        """The run moved along so that the antenna, not the bar, passes over the poses."""
        angle = run.record[:, :, 2]
        record = run.record.copy()
        record[:, :, 0] += forward * np.cos(angle)
        record[:, :, 1] += forward * np.sin(angle)
        return replace(run, record=record)

    def antenna_run(self, site: Any, poses: list[tuple[float, float, float, bool]]) -> Run:
        bar_to_antenna = site.implement.hitch_m + site.tractor.antenna_forward_m
        return self.shifted(site, run_of(site, poses), -bar_to_antenna)

    def test_the_antenna_is_where_the_tractor_carries_it(self, small_site: Any) -> None:
        poses = [(10.0, float(y), NORTH, True) for y in range(5, 30)]
        path = guided_point(self.antenna_run(small_site, poses), small_site, 0)
        assert np.allclose(path, [pose[:2] for pose in poses])

    def test_nothing_outside(self, small_site: Any) -> None:
        outside = excursion(self.antenna_run(small_site, pass_north(10.0, 5.0, 75.0)), small_site)
        assert (outside.length_m, outside.depth_m) == (0.0, 0.0)

    def test_out_over_the_end_by_a_known_distance(self, small_site: Any) -> None:
        poses = [(10.0, 0.1 * k + 0.05, NORTH, True) for k in range(700, 830)]
        outside = excursion(self.antenna_run(small_site, poses), small_site)
        assert outside.depth_m == pytest.approx(2.95, abs=1e-6)
        assert outside.length_m == pytest.approx(2.95, abs=0.1)  # within one step of the record

    def test_along_the_side(self, small_site: Any) -> None:
        poses = [(-0.4, float(y), NORTH, True) for y in range(10, 51)]
        outside = excursion(self.antenna_run(small_site, poses), small_site)
        assert outside.length_m == pytest.approx(40.0)
        assert outside.depth_m == pytest.approx(0.4)

    def test_both_tractors_count(self, small_site: Any) -> None:
        one = [(-0.4, float(y), NORTH, True) for y in range(10, 51)]
        other = [(36.7, float(y), NORTH, True) for y in range(10, 51)]
        bar_to_antenna = small_site.implement.hitch_m + small_site.tractor.antenna_forward_m
        run = self.shifted(small_site, run_of(small_site, one, other), -bar_to_antenna)
        outside = excursion(run, small_site)
        assert outside.length_m == pytest.approx(80.0)
        assert outside.depth_m == pytest.approx(0.7)


def test_reversals_are_gear_changes(small_site: Any) -> None:
    def leg(a: float, b: float, gear: int) -> Leg:
        return Leg(np.array([[a, 0.0], [b, 0.0]]), 1.0, gear)

    mission = Mission((leg(0, 5, 1), leg(5, 9, 1), leg(9, 4, -1), leg(4, 8, 1)))
    run = run_of(small_site, pass_north(10.0, 5.0, 55.0))
    assert reversals(replace(run, plan=Plan((mission, mission)))) == 4
    assert reversals(run) == 0


def test_what_is_not_finite_is_none() -> None:
    assert [finite_or_none(v) for v in (math.inf, math.nan, 1.5)] == [None, None, 1.5]
