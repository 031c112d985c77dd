"""What a job tells: poses of passes, estimated turn times, ways."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Polygon, box

from strategies.path_planning.connector import Connector
from strategies.program.field_job import FieldJob, SwathPass
from tests.examples import count_examples

QUICK = settings(max_examples=count_examples(40))
WHOLE = [(0.0, 100.0)]


class TestPoses:
    def test_entry_and_exit_by_hand(self, jobs: Any, same_pose: Any) -> None:
        job = jobs.drawn([WHOLE] * 3)
        swath = job.layout.swaths[2]
        assert same_pose(job.get_entry_pose(SwathPass(swath, 1)), (0.0, 6.0, 0.0))
        assert same_pose(job.get_exit_pose(SwathPass(swath, 1)), (102.3, 6.0, 0.0))
        assert same_pose(job.get_entry_pose(SwathPass(swath, -1)), (100.0, 6.0, math.pi))
        assert same_pose(job.get_exit_pose(SwathPass(swath, -1)), (-2.3, 6.0, math.pi))

    @QUICK
    @given(bearing=st.floats(-1.57, 1.57), direction=st.sampled_from([1, -1]))
    def test_the_exit_lies_a_tool_length_past_the_far_end(self, jobs: Any, bearing: float, direction: int) -> None:
        job = jobs.drawn([WHOLE] * 2, bearing_rad=bearing)
        this = SwathPass(job.layout.swaths[1], direction)
        (ax, ay, heading), (bx, by, _) = job.get_entry_pose(this), job.get_exit_pose(this)
        ahead = (bx - ax) * math.cos(heading) + (by - ay) * math.sin(heading)
        aside = (by - ay) * math.cos(heading) - (bx - ax) * math.sin(heading)
        assert ahead == pytest.approx(100.0 + jobs.tool_m, abs=1e-6)
        assert aside == pytest.approx(0.0, abs=1e-6)
        assert -math.pi <= heading <= math.pi


class TestWay:
    def test_is_found_once_and_remembered(self, jobs: Any) -> None:
        job = jobs.rectangle(8)
        a, b = (
            job.get_exit_pose(SwathPass(job.layout.swaths[0], 1)),
            job.get_entry_pose(SwathPass(job.layout.swaths[4], -1)),
        )
        first = job.find_path(a, b)
        assert first is not None and job.find_path(a, b) is first
        assert list(job.path_cache) == [(a, b)]

    def test_keeps_to_the_headland_although_across_is_as_quick(self, jobs: Any) -> None:
        job = jobs.rectangle(8, 60.0)
        top = box(1.5, 60.0 + 9.0, 22.5, 76.5)  # beyond the ends of the tracks only
        beside = Connector(top, 4.3, job.connector.costs)
        job = replace(job, headland_connector=beside, path_cache={})
        up = 1 if job.layout.swaths[0].end_m[1] > 40 else -1
        path = job.find_path(
            job.get_exit_pose(SwathPass(job.layout.swaths[0], up)),
            job.get_entry_pose(SwathPass(job.layout.swaths[4], -up)),
        )
        assert path is not None
        assert all(y >= 69.0 - 0.02 for _, points in path.sample(0.25) for _, y in points)

    def test_goes_across_when_the_headland_offers_nothing(self, jobs: Any) -> None:
        job = jobs.rectangle(8, 60.0)
        far = Connector(box(500, 500, 560, 560), 4.3, job.connector.costs)
        both = replace(job, headland_connector=far, path_cache={})
        a, b = (
            job.get_exit_pose(SwathPass(job.layout.swaths[0], 1)),
            job.get_entry_pose(SwathPass(job.layout.swaths[4], -1)),
        )
        assert both.find_path(a, b) == job.find_path(a, b) is not None

    def test_is_none_where_nothing_fits(self, jobs: Any) -> None:
        job = replace(jobs.rectangle(3), connector=Connector(box(0, 0, 2, 2), 4.3, jobs.rectangle(3).connector.costs))
        assert job.find_path((1.0, 1.0, 0.0), (50.0, 1.0, 0.0)) is None


class TestReverse:
    """A job in the driver's rules: 5.1 m of machine, so at most 10.2 m in reverse where another path leads on."""

    def find_path(self, jobs: Any, free: Any, a: Any, b: Any, headland: Any = None) -> tuple[FieldJob, Any]:
        job = jobs.rectangle(3)
        connector, beside = (
            None if region is None else Connector(region, 4.3, job.connector.costs, max_reverse_m=10.2)
            for region in (free, headland)
        )
        job = replace(job, connector=connector, headland_connector=beside, avoids_swaths=True, path_cache={})
        return job, job.find_path(a, b)

    def test_the_limit_is_two_machine_lengths(self, jobs: Any) -> None:
        rules = jobs.rectangle(3).driving_rules
        assert (rules.length_m, rules.max_reverse_m) == (pytest.approx(5.1), pytest.approx(10.2))

    def test_far_only_where_nothing_else_leads(self, jobs: Any) -> None:
        job, path = self.find_path(jobs, box(0, 0, 200, 0.4), (150.0, 0.2, 0.0), (50.0, 0.2, 0.0))
        assert path is not None and path.reverse_m >= 100.0 and job.has_long_reverse(path)

    def test_round_the_headland_rather_than_far_back(self, jobs: Any) -> None:
        field = box(0, 0, 120, 120)
        band = field.difference(box(12, 12, 108, 108))
        job, path = self.find_path(jobs, field, (100.0, 6.0, 0.0), (50.0, 6.0, 0.0), band)
        assert path is not None and not job.has_long_reverse(path)
        assert all(band.buffer(0.02).covers(LineString(points)) for _, points in path.sample(0.25))

    def test_across_the_field_rather_than_far_back_along_the_headland(self, jobs: Any) -> None:
        lane = box(0, 0, 200, 0.4)
        job, path = self.find_path(jobs, box(0, 0, 200, 60), (150.0, 0.2, 0.0), (50.0, 0.2, 0.0), lane)
        assert path is not None and not job.has_long_reverse(path)


BEND = Polygon([(0, 0), (90, 0), (90, 40), (45, 44), (40, 90), (0, 90)], [box(18, 15, 26, 24).exterior.coords])
places = st.tuples(st.floats(0.0, 90.0), st.floats(0.0, 90.0), st.floats(-3.14, 3.14))
