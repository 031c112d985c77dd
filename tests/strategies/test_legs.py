"""Tracks and paths as legs: geometry by hand."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box

from fields import Field
from fields.geometry.field import GroundZone
from strategies.path_planning.paths import DrivePath, PathSegment
from strategies.program.field_job import SwathPass
from strategies.program.legs import add_wait_points, build_path_legs, build_straight_leg, build_swath_legs
from tests.examples import count_examples
from vehicle.missions.plan import Leg, LegTask

QUICK = settings(max_examples=count_examples(40))


class TestStraightLeg:
    @QUICK
    @given(angle=st.floats(-math.pi, math.pi), start=st.floats(-20, 20), length=st.floats(0.1, 300), work=st.booleans())
    def test_lies_ahead_of_the_pose(self, jobs: Any, angle: float, start: float, length: float, work: bool) -> None:
        task = LegTask("track" if work else "drive-in", 3)
        leg = build_straight_leg(jobs.rectangle(4), (7.0, -3.0, angle), start, start + length, task)
        offset = leg.points - (7.0, -3.0)
        assert np.allclose(offset @ (math.cos(angle), math.sin(angle)), [start, start + length], atol=1e-9)
        assert np.allclose(offset @ (-math.sin(angle), math.cos(angle)), 0.0, atol=1e-9)
        assert leg.length_m == pytest.approx(length, abs=1e-9)
        assert (leg.task, leg.implement, leg.may_wait) == (task, work, False)

    def test_work_and_driving_in_have_their_own_speeds(self, jobs: Any) -> None:
        job = jobs.rectangle(4, work_speed_mps=2.0, turn_speed_mps=1.1)
        speeds = [build_straight_leg(job, (0, 0, 0), 0, 5, LegTask(kind)).speed_mps for kind in ("track", "drive-in")]
        assert speeds == [2.0, 1.1]

    def test_takes_the_ground_under_its_middle(self, jobs: Any) -> None:
        yard = GroundZone("asphalt", box(0, 0, 30, 30))
        job = jobs.on_field(Field("f", box(0, 0, 60, 100), ground_zones=(yard,)))
        grounds = [build_straight_leg(job, (10.0, y, math.pi / 2), 0, 10, LegTask("track")).ground for y in (5.0, 50.0)]
        assert grounds == ["asphalt", "soil"]


class TestPass:
    @pytest.mark.parametrize("direction", [1, -1])
    def test_drives_in_then_works_the_whole_track(self, jobs: Any, direction: int) -> None:
        job = jobs.rectangle(4, 80.0)
        swath = job.layout.swaths[1]
        drive_in, main, last = build_swath_legs(job, SwathPass(swath, direction))
        assert drive_in.length_m == pytest.approx(jobs.tool_m)
        assert main.length_m + last.length_m == pytest.approx(swath.length_m)
        assert last.length_m == pytest.approx(job.driving_rules.hold_back_m)
        assert (drive_in.implement, main.implement, last.implement) == (False, True, True)
        assert [leg.task for leg in (drive_in, main, last)] == [
            LegTask("drive-in", 1),
            LegTask("track", 1),
            LegTask("track", 1),
        ]
        assert [leg.may_wait for leg in (drive_in, main, last)] == [False, False, True]
        ends = (swath.start_m, swath.end_m)[::direction]
        assert np.allclose(drive_in.points[0], ends[0])
        beyond = np.array(ends[1]) + jobs.tool_m * (np.array(ends[1]) - ends[0]) / swath.length_m
        assert np.allclose(last.points[-1], beyond)

    def test_a_short_track_is_halved(self, jobs: Any) -> None:
        job = jobs.rectangle(4, 10.0)
        _, main, last = build_swath_legs(job, SwathPass(job.layout.swaths[0], 1))
        assert main.length_m == pytest.approx(5.0) and last.length_m == pytest.approx(5.0)


class TestWay:
    def test_one_leg_per_gear_at_the_speed_of_its_gear(self, jobs: Any) -> None:
        job = jobs.rectangle(4, turn_speed_mps=1.2, reverse_speed_mps=0.8)
        path = DrivePath(
            (0, 0, 0), (PathSegment(6, 0.0, 1), PathSegment(4, 0.1, -1), PathSegment(5, 0.0, 1)), "switch-back"
        )
        legs = build_path_legs(job, path, LegTask("turn", 1, 1))
        assert [(leg.gear, leg.speed_mps) for leg in legs] == [(1, 1.2), (-1, 0.8), (1, 1.2)]
        assert [leg.length_m for leg in legs] == pytest.approx([6, 4, 5], abs=1e-3)
        assert all(np.allclose(a.points[-1], b.points[0]) for a, b in pairwise(legs))
        assert {leg.task for leg in legs} == {LegTask("turn", 1, 1)} and not any(leg.implement for leg in legs)


def test_parts_between_stops_are_as_long_as_they_measure() -> None:
    angles = np.linspace(0.0, 5.0, 211)
    whole = Leg(np.column_stack([20.0 * np.cos(angles), 20.0 * np.sin(angles)]), 1.0)
    parts = add_wait_points([whole, Leg(np.array([[0.0, 0.0], [1.0, 2.0]]), 1.0, gear=-1)], 7.0)
    assert len(parts) == round(whole.length_m / 7.0) + 1
    assert [part.length_m for part in parts] == [Leg(part.points, 1.0).length_m for part in parts]


def test_no_place_to_wait_is_put_before_a_step_without_direction() -> None:
    """An arc and a straight may meet in two points a rounding apart, just where the path would be parted."""
    leg = Leg(np.array([[0.0, 0.0], [5.0, 0.0], [5.0 + 1e-8, 0.0], [10.0, 0.0]]), 1.0)
    for every_m in (3.0, 5.0):
        parts = add_wait_points([leg], every_m)
        assert not any(part.fault for part in parts)
        assert sum(part.length_m for part in parts) == pytest.approx(10.0)
