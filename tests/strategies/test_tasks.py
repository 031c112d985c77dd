"""What legs are for: every leg of every strategy's plan has its task, and hold points lie clear of the headland."""

from itertools import groupby, pairwise
from typing import Any

import pytest
from shapely import box

from strategies.registry import STRATEGIES
from vehicle.missions.plan import DRIVE_IN, ROUTE, SWATH, TURN, Mission, Plan

LEADING = (TURN, ROUTE, DRIVE_IN)


@pytest.fixture(scope="module")
def plans(jobs: Any) -> dict[tuple[str, int], tuple[Any, Plan]]:
    """A job and its plan by strategy and number of tractors; separate ones work around a hole."""
    made = {}
    for name, strategy in STRATEGIES.items():
        hole = None if strategy.side_by_side else box(15, 50, 27, 62)
        for tractors in (1, 3, 5):
            job = jobs.rectangle(14, 110.0, tractors=tractors, hole=hole)
            made[name, tractors] = job, strategy.build(job)
    return made


CASES = [(name, tractors) for name in STRATEGIES for tractors in (1, 3, 5)]


@pytest.mark.parametrize("case", CASES)
class TestTasks:
    def test_every_track_is_worked_once_by_one_tractor(self, plans: Any, case: Any) -> None:
        job, plan = plans[case]
        worked = [
            (task.number, task.piece)
            for mission in plan.missions
            for task, _ in groupby(leg.task for leg in mission.legs)
            if task.is_work
        ]
        assert sorted(worked) == sorted((swath.line, swath.piece) for swath in job.layout.swaths)

    def test_each_track_is_led_to_and_driven_in_on(self, plans: Any, case: Any) -> None:
        for mission in plans[case][1].missions:
            assert all(leg.task.kind in (SWATH, *LEADING) for leg in mission.legs)
            assert mission.legs[0].task.kind == DRIVE_IN
            for a, b in pairwise(mission.legs):
                if b.task.kind == DRIVE_IN:
                    assert a.task.kind in (TURN, ROUTE) and a.task.has_same_goal(b.task)
                elif b.task.kind == SWATH:
                    assert a.task == b.task or (a.task.kind == DRIVE_IN and a.task.has_same_goal(b.task))
                else:
                    assert a.task == b.task or (a.task.kind == SWATH and not a.task.has_same_goal(b.task))

    def test_hold_points_are_the_start_and_the_end_of_every_track(self, plans: Any, case: Any) -> None:
        for mission in plans[case][1].missions:
            assert [index for index, leg in enumerate(mission.legs) if leg.may_wait] == [0, *last_segments(mission)]

    def test_the_implement_is_down_where_there_is_work(self, plans: Any, case: Any) -> None:
        legs = [leg for mission in plans[case][1].missions for leg in mission.legs]
        assert all(leg.implement is leg.task.is_work for leg in legs)


def last_segments(mission: Mission) -> list[int]:
    """Last leg of every run of legs with the implement down, by the implement alone."""
    down = [leg.implement for leg in mission.legs] + [False]
    return [index for index in range(len(mission.legs)) if down[index] and not down[index + 1]]


@pytest.mark.parametrize("name", [name for name, strategy in STRATEGIES.items() if not strategy.side_by_side])
def test_tractors_with_their_own_tracks_wait_at_hold_points_only(plans: Any, name: str) -> None:
    for tractors in (1, 3, 5):
        legs = [leg for mission in plans[name, tractors][1].missions for leg in mission.legs]
        assert all(leg.may_wait for leg in legs if leg.gates)
