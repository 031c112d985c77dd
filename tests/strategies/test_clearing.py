"""Where a tractor stands clear of ways past it, and how a formation is repaired where two meet all the same."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.formations.formation import EXTRA_STEP_M, TURN_BEGUN_M, Formation, repair_formation
from strategies.formations.grouping import NO_CHANGES, FormationChanges
from strategies.formations.slots import (
    POSE_STEP_M,
    SETTLED_M,
    WAIT_CLEARANCE_M,
    BlockedSpans,
    find_blocked_spans,
    sample_poses,
)
from strategies.path_planning.paths import DrivePath, PathSegment, advance_along_segment
from strategies.program.field_job import SwathPass
from strategies.row_by_row import form_row_by_row
from vehicle.missions.plan import Plan
from vehicle.missions.run import CONFLICT, DONE, STALL, Conflict


def straight(x: float, y: float, heading: float, length_m: float) -> Any:
    return sample_poses(DrivePath((x, y, heading), (PathSegment(length_m, 0.0, 1),), "route"))


def slow_poses(path: DrivePath) -> list[tuple[float, ...]]:
    """What `poses_on` has to give, pose after pose."""
    rows, since = [(*path.start, 0.0)], math.inf
    on = replace(path.segments[-1], length_m=SETTLED_M, curvature=0.0)
    for pose, segment in zip([*path.list_segment_starts(), path.end], [*path.segments, on], strict=True):
        count = max(1, math.ceil(segment.length_m / POSE_STEP_M))
        for run_m in (segment.length_m * part / count for part in range(1, count + 1)):
            settling = segment.curvature == 0.0 and since + run_m <= SETTLED_M
            if settling or segment is not on:
                rows.append((*advance_along_segment(pose, replace(segment, length_m=run_m)), float(settling)))
        since = 0.0 if segment.curvature != 0.0 else since + segment.length_m
    return rows


segments = st.builds(PathSegment, st.floats(0.01, 30.0), st.sampled_from([-0.25, 0.0, 0.1]), st.sampled_from([1, -1]))


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.lists(segments, min_size=1, max_size=5))
def test_poses_on_a_way_are_those_reached_segment_by_segment(
    start: tuple[float, ...], driven: list[PathSegment]
) -> None:
    path = DrivePath((start[0], start[1], start[2]), tuple(driven), "route")
    found, slow = sample_poses(path), np.array(slow_poses(path))
    assert found[:, [0, 1, 3]] == pytest.approx(slow[:, [0, 1, 3]], abs=1e-9)
    assert np.cos(found[:, 2] - slow[:, 2]) == pytest.approx(1.0)


class TestBlocked:
    def test_the_next_clear_place_lies_beyond_segments_that_overlap(self) -> None:
        blocked = BlockedSpans(np.array([10.0, 14.0, 30.0]), np.array([15.0, 20.0, 31.0]))
        assert (blocked.find_clear_place_before(19.0), blocked.find_clear_place_after(11.0)) == (10.0, 20.0)
        assert (blocked.find_clear_place_before(25.0), blocked.find_clear_place_after(25.0)) == (25.0, 25.0)
        assert (blocked.find_clear_place_before(10.0), blocked.find_clear_place_after(20.0)) == (10.0, 20.0)

    @pytest.mark.parametrize("heading", [0.5 * math.pi, -0.5 * math.pi])
    def test_of_a_way_square_across_a_track(self, jobs: Any, heading: float) -> None:
        # The implement passing at 50 m is 1.4 m wide to either side; 2.4 m are before the guided point that waits and
        # 2.7 m behind it.
        job = jobs.drawn([[(0, 100)]])
        way = straight(50.0, -20.0 * math.sin(heading), heading, 40.0)
        blocked = find_blocked_spans(job, SwathPass(job.layout.swaths[0], 1), [way])
        assert blocked.find_clear_place_before(52.0) == pytest.approx(50.0 - 1.4 - 2.4 - WAIT_CLEARANCE_M)
        assert blocked.find_clear_place_after(48.0) == pytest.approx(50.0 + 1.4 + 2.7 + WAIT_CLEARANCE_M)

    def test_is_counted_from_where_the_pass_begins(self, jobs: Any) -> None:
        job = jobs.drawn([[(0, 100)]])
        blocked = find_blocked_spans(
            job, SwathPass(job.layout.swaths[0], -1), [straight(30.0, -20.0, 0.5 * math.pi, 40.0)]
        )
        assert blocked.find_clear_place_before(70.0) == pytest.approx(70.0 - 1.4 - 2.4 - WAIT_CLEARANCE_M)

    @pytest.mark.parametrize(("aside_m", "free"), [(3.0, True), (2.9, False), (3.4, True)])
    def test_of_a_way_along_the_neighbouring_line(self, jobs: Any, aside_m: float, free: bool) -> None:
        job = jobs.drawn([[(0, 100)]])
        blocked = find_blocked_spans(job, SwathPass(job.layout.swaths[0], 1), [straight(20.0, aside_m, 0.0, 40.0)])
        assert (blocked.find_clear_place_before(50.0) == 50.0) == free

    def test_nothing_is_blocked_where_nobody_passes(self, jobs: Any) -> None:
        job = jobs.drawn([[(0, 100)]])
        assert find_blocked_spans(job, SwathPass(job.layout.swaths[0], 1), []).find_clear_place_after(7.0) == 7.0


def fake(*clashes: tuple[float, int, int, int, int]) -> Any:
    """A simulation that finds these conflicts one after another and then drives to the end; its plans in `plans`."""
    left, plans = list(clashes), list[Plan]()

    def simulate(plan: Plan) -> Any:
        plans.append(plan)
        clash = Conflict(*left.pop(0)) if left else None
        return SimpleNamespace(outcome=CONFLICT if clash else DONE, conflict=clash)

    return simulate, plans


class TestCare:
    def test_the_one_on_the_side_moved_away_from_waits_longer_and_longer(self, jobs: Any) -> None:
        job = jobs.rectangle(12, 120.0, tractors=3)
        formation = form_row_by_row(job)
        legs = [formation.marks[1, tractor].turn_leg for tractor in range(3)]
        simulate, _ = fake(*((time, 0, 2, legs[0], legs[2]) for time in (60.0, 70.0, 80.0)))
        plan = repair_formation(lambda changes: form_row_by_row(job, changes=changes), simulate).refined.plan
        new = [gate for gate in plan.missions[0].legs[formation.marks[1, 0].release_leg].gates if gate.tractor == 2]
        marks, other = formation.marks[1, 2], formation.plan.missions[2].legs
        driven_m = [sum(leg.length_m for leg in other[marks.release_leg : gate.leg]) + gate.after_m for gate in new]
        assert driven_m[:2] == pytest.approx(list(TURN_BEGUN_M))
        assert new[2].leg == marks.place_leg and len(new) == 3

    def test_what_did_not_help_is_not_tried_again(self, jobs: Any) -> None:
        job = jobs.rectangle(12, 120.0, tractors=3)
        legs = [form_row_by_row(job).marks[1, tractor].turn_leg for tractor in range(3)]
        simulate, plans = fake(*[(60.0, 0, 2, legs[0], legs[2])] * 2)
        plan = repair_formation(lambda changes: form_row_by_row(job, changes=changes), simulate).refined.plan
        assert len(plans) == 3  # the second time the place of the other is waited for at once
        marks = form_row_by_row(job).marks[1, 2]
        gates = plan.missions[0].legs[form_row_by_row(job).marks[1, 0].release_leg].gates
        assert [gate.leg == marks.place_leg for gate in gates if gate.tractor == 2] == [False, True]

    def test_one_that_stands_in_the_way_waits_farther_back(self, jobs: Any) -> None:
        job = jobs.rectangle(12, 120.0, tractors=3)
        before = form_row_by_row(job)
        simulate, _ = fake((60.0, 1, 2, before.marks[1, 1].turn_leg, before.marks[0, 2].work_leg))
        written: list[FormationChanges] = []

        def write(changes: FormationChanges) -> Formation:
            written.append(changes)
            return form_row_by_row(job, changes=changes)

        after = repair_formation(write, simulate).formation
        old, new = (formation.rounds[0][2] for formation in (before, after))
        assert new.hold_m == pytest.approx(new.queue_m - 10.0 - EXTRA_STEP_M) and new.hold_m < old.hold_m
        assert new.place_m == old.place_m
        assert [change.back_m for change in written] == [{}, {old.swath_pass: EXTRA_STEP_M}]
        jobs.assert_all_once(job, after.plan)

    def test_without_help_the_plan_is_as_it_was_first_written(self, jobs: Any) -> None:
        job = jobs.rectangle(12, 120.0, tractors=3)

        def stuck(plan: Plan) -> Any:
            return SimpleNamespace(outcome=STALL, conflict=None)

        found = repair_formation(lambda changes: form_row_by_row(job, changes=changes), stuck)
        assert found.refined.run is None and found.changes == NO_CHANGES
        assert [len(mission.legs) for mission in found.refined.plan.missions] == [
            len(mission.legs) for mission in form_row_by_row(job).plan.missions
        ]
