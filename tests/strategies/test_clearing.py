"""Where a tractor stands clear of ways past it, and how a formation is mended where two meet all the same."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.formations.care import BEGUN_M, FARTHER_M, driven
from strategies.formations.clear_rounds import AS_WRITTEN, Changes
from strategies.formations.clearing import ROOM_M, SETTLED_M, STEP_M, Blocked, blocked_on, poses_on
from strategies.formations.formation import Formation
from strategies.job import Pass
from strategies.row_by_row import row_by_row
from strategies.ways.paths import Path, Segment, advance
from vehicle.missions import Plan
from vehicle.run import CONFLICT, DONE, STALL, Conflict


def straight(x: float, y: float, heading: float, length_m: float) -> Any:
    return poses_on(Path((x, y, heading), (Segment(length_m, 0.0, 1),), "route"))


def slow_poses(path: Path) -> list[tuple[float, ...]]:
    """What `poses_on` has to give, pose after pose."""
    rows, since = [(*path.start, 0.0)], math.inf
    on = replace(path.segments[-1], length_m=SETTLED_M, curvature=0.0)
    for pose, segment in zip([*path.poses(), path.end], [*path.segments, on], strict=True):
        count = max(1, math.ceil(segment.length_m / STEP_M))
        for run_m in (segment.length_m * part / count for part in range(1, count + 1)):
            settling = segment.curvature == 0.0 and since + run_m <= SETTLED_M
            if settling or segment is not on:
                rows.append((*advance(pose, replace(segment, length_m=run_m)), float(settling)))
        since = 0.0 if segment.curvature != 0.0 else since + segment.length_m
    return rows


segments = st.builds(Segment, st.floats(0.01, 30.0), st.sampled_from([-0.25, 0.0, 0.1]), st.sampled_from([1, -1]))


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.lists(segments, min_size=1, max_size=5))
def test_poses_on_a_way_are_those_reached_segment_by_segment(start: tuple[float, ...], driven: list[Segment]) -> None:
    path = Path((start[0], start[1], start[2]), tuple(driven), "route")
    found, slow = poses_on(path), np.array(slow_poses(path))
    assert found[:, [0, 1, 3]] == pytest.approx(slow[:, [0, 1, 3]], abs=1e-9)
    assert np.cos(found[:, 2] - slow[:, 2]) == pytest.approx(1.0)


class TestBlocked:
    def test_the_next_clear_place_lies_beyond_stretches_that_overlap(self) -> None:
        blocked = Blocked(np.array([10.0, 14.0, 30.0]), np.array([15.0, 20.0, 31.0]))
        assert (blocked.before(19.0), blocked.after(11.0)) == (10.0, 20.0)
        assert (blocked.before(25.0), blocked.after(25.0)) == (25.0, 25.0)
        assert (blocked.before(10.0), blocked.after(20.0)) == (10.0, 20.0)

    @pytest.mark.parametrize("heading", [0.5 * math.pi, -0.5 * math.pi])
    def test_of_a_way_square_across_a_track(self, jobs: Any, heading: float) -> None:
        # The implement passing at 50 m is 1.4 m wide to either side; 2.4 m are before the guided point that waits and
        # 2.7 m behind it.
        job = jobs.drawn([[(0, 100)]])
        way = straight(50.0, -20.0 * math.sin(heading), heading, 40.0)
        blocked = blocked_on(job, Pass(job.layout.tracks[0], 1), [way])
        assert blocked.before(52.0) == pytest.approx(50.0 - 1.4 - 2.4 - ROOM_M)
        assert blocked.after(48.0) == pytest.approx(50.0 + 1.4 + 2.7 + ROOM_M)

    def test_is_counted_from_where_the_pass_begins(self, jobs: Any) -> None:
        job = jobs.drawn([[(0, 100)]])
        blocked = blocked_on(job, Pass(job.layout.tracks[0], -1), [straight(30.0, -20.0, 0.5 * math.pi, 40.0)])
        assert blocked.before(70.0) == pytest.approx(70.0 - 1.4 - 2.4 - ROOM_M)

    @pytest.mark.parametrize(("aside_m", "free"), [(3.0, True), (2.9, False), (3.4, True)])
    def test_of_a_way_along_the_neighbouring_line(self, jobs: Any, aside_m: float, free: bool) -> None:
        job = jobs.drawn([[(0, 100)]])
        blocked = blocked_on(job, Pass(job.layout.tracks[0], 1), [straight(20.0, aside_m, 0.0, 40.0)])
        assert (blocked.before(50.0) == 50.0) == free

    def test_nothing_is_blocked_where_nobody_passes(self, jobs: Any) -> None:
        job = jobs.drawn([[(0, 100)]])
        assert blocked_on(job, Pass(job.layout.tracks[0], 1), []).after(7.0) == 7.0


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
        formation = row_by_row(job)
        legs = [formation.marks[1, tractor].turned for tractor in range(3)]
        simulate, _ = fake(*((time, 0, 2, legs[0], legs[2]) for time in (60.0, 70.0, 80.0)))
        plan = driven(lambda changes: row_by_row(job, changes=changes), simulate).refined.plan
        new = [gate for gate in plan.missions[0].legs[formation.marks[1, 0].release].gates if gate.tractor == 2]
        marks, other = formation.marks[1, 2], formation.plan.missions[2].legs
        driven_m = [sum(leg.length_m for leg in other[marks.release : gate.leg]) + gate.after_m for gate in new]
        assert driven_m[:2] == pytest.approx(list(BEGUN_M))
        assert new[2].leg == marks.placed and len(new) == 3

    def test_what_did_not_help_is_not_tried_again(self, jobs: Any) -> None:
        job = jobs.rectangle(12, 120.0, tractors=3)
        legs = [row_by_row(job).marks[1, tractor].turned for tractor in range(3)]
        simulate, plans = fake(*[(60.0, 0, 2, legs[0], legs[2])] * 2)
        plan = driven(lambda changes: row_by_row(job, changes=changes), simulate).refined.plan
        assert len(plans) == 3  # the second time the place of the other is waited for at once
        marks = row_by_row(job).marks[1, 2]
        gates = plan.missions[0].legs[row_by_row(job).marks[1, 0].release].gates
        assert [gate.leg == marks.placed for gate in gates if gate.tractor == 2] == [False, True]

    def test_one_that_stands_in_the_way_waits_farther_back(self, jobs: Any) -> None:
        job = jobs.rectangle(12, 120.0, tractors=3)
        before = row_by_row(job)
        simulate, _ = fake((60.0, 1, 2, before.marks[1, 1].turned, before.marks[0, 2].work))
        written: list[Changes] = []

        def write(changes: Changes) -> Formation:
            written.append(changes)
            return row_by_row(job, changes=changes)

        after = driven(write, simulate).formation
        old, new = (formation.rounds[0][2] for formation in (before, after))
        assert new.hold_m == pytest.approx(new.queue_m - 10.0 - FARTHER_M) and new.hold_m < old.hold_m
        assert new.place_m == old.place_m
        assert [change.back_m for change in written] == [{}, {old.this: FARTHER_M}]
        jobs.assert_all_once(job, after.plan)

    def test_without_help_the_plan_is_as_it_was_first_written(self, jobs: Any) -> None:
        job = jobs.rectangle(12, 120.0, tractors=3)
        def stuck(plan: Plan) -> Any:
            return SimpleNamespace(outcome=STALL, conflict=None)

        found = driven(lambda changes: row_by_row(job, changes=changes), stuck)
        assert found.refined.run is None and found.changes == AS_WRITTEN
        assert [len(mission.legs) for mission in found.refined.plan.missions] == [
            len(mission.legs) for mission in row_by_row(job).plan.missions
        ]
