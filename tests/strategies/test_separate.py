"""Split-field and interleaved: who gets which tracks, and the plans made of them."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import settings

from strategies.interleaved import plan_interleaved
from strategies.path_planning.errors import StrategyError
from strategies.program.field_job import FieldJob
from strategies.registry import STRATEGIES
from strategies.split_field import plan_split_field
from tests.examples import count_examples
from vehicle.missions.plan import LegGate, Plan, check_plan

QUICK = settings(max_examples=count_examples(40))


class TestBlocks:
    def test_equal_tracks_are_shared_equally(self, jobs: Any) -> None:
        job = jobs.rectangle(12, tractors=4)
        shares = [len(segments) for segments in tracks_by_tractor(jobs, job, plan_split_field(job)).values()]
        assert sorted(shares) == [3, 3, 3, 3]

    def test_blocks_are_contiguous(self, jobs: Any) -> None:
        job = jobs.rectangle(13, tractors=3)
        for lines in tracks_by_tractor(jobs, job, plan_split_field(job)).values():
            assert sorted(lines) == list(range(min(lines), max(lines) + 1))

    def test_more_tractors_than_lines_are_refused_with_the_number_that_fits(self, jobs: Any) -> None:
        job = jobs.drawn([[(0, 100)]] * 3, tractors=4)
        for make in (plan_split_field, plan_interleaved):
            with pytest.raises(StrategyError, match=r"4 tractors are more than the 3 tracks.*use 3 or fewer"):
                make(job)


def tracks_by_tractor(jobs: Any, job: FieldJob, plan: Plan) -> dict[int, set[int]]:
    """Lines that each tractor works."""
    lines: dict[int, set[int]] = {}
    for swath, segments in jobs.worked(job, plan).items():
        for _, _, tractor in segments:
            lines.setdefault(tractor, set()).add(swath.line)
    return lines


class TestPlans:
    @pytest.mark.parametrize("tractors", [1, 2, 3, 5])
    @pytest.mark.parametrize("name", ["split-field", "interleaved"])
    def test_every_metre_is_worked_once(self, jobs: Any, name: str, tractors: int) -> None:
        job = jobs.rectangle(11, tractors=tractors)
        plan = STRATEGIES[name].build(job)
        check_plan(plan)
        assert plan.tractors == tractors
        assert (plan.notes["strategy"], plan.notes["tractors"]) == (name, tractors)
        jobs.assert_all_once(job, plan)

    @pytest.mark.parametrize("name", ["split-field", "interleaved"])
    def test_a_hole_is_worked_around(self, jobs: Any, name: str) -> None:
        from shapely import box

        job = jobs.rectangle(14, 100.0, tractors=2, hole=box(15, 50, 27, 62))
        plan = STRATEGIES[name].build(job)
        check_plan(plan)
        jobs.assert_all_once(job, plan)

    def test_a_block_is_worked_by_one_tractor(self, jobs: Any) -> None:
        job = jobs.rectangle(12, tractors=3)
        worked = jobs.worked(job, plan_split_field(job))
        who = [segments[0][2] for _, segments in sorted(worked.items(), key=lambda item: item[0].line)]
        assert who == [0] * 4 + [1] * 4 + [2] * 4

    @pytest.mark.parametrize("name", ["split-field", "interleaved"])
    def test_turned_tractors_drive_from_the_end_to_the_beginning(self, jobs: Any, name: str) -> None:
        job = jobs.rectangle(9, tractors=2)
        plain, turned = (STRATEGIES[name].build(each) for each in (job, replace(job, reversed_tractors=(1,))))
        check_plan(turned)
        jobs.assert_all_once(job, turned)
        lines = [[leg.task.number for leg in mission.legs if leg.implement] for mission in plain.missions]
        other = [[leg.task.number for leg in mission.legs if leg.implement] for mission in turned.missions]
        assert other == [lines[0], lines[1][::-1]]

    def test_a_fixed_pattern_is_kept(self, jobs: Any) -> None:
        job = jobs.rectangle(8, turn_s=(0.0, 90.0, 80.0, 10.0, 10.0))
        steps = []
        for jump in (1, 3):
            plan = plan_split_field(replace(job, jump=jump))
            worked = [leg for leg in plan.missions[0].legs if leg.implement][::2]
            lines = [int(leg.points[0][0] // jobs.width_m) for leg in worked]
            steps.append([abs(b - a) for a, b in pairwise(lines)])
        assert steps[0] == [1] * 7
        assert steps[1][:5] == [3, 2, 3, 2, 3]

    @pytest.mark.parametrize("tractors", [2, 3, 4])
    def test_interleaved_takes_every_nth_line(self, jobs: Any, tractors: int) -> None:
        job = jobs.rectangle(10, tractors=tractors)
        worked = jobs.worked(job, plan_interleaved(job))
        for swath, segments in worked.items():
            assert segments[0][2] == swath.line % tractors

    def test_interleaved_tractors_start_one_behind_the_other(self, jobs: Any) -> None:
        job = jobs.rectangle(9, tractors=3)
        plan = plan_interleaved(job)
        gates = [mission.legs[0].gates for mission in plan.missions]
        assert gates == [
            (),
            (LegGate(0, 1, job.driving_rules.stagger_m),),
            (LegGate(1, 1, job.driving_rules.stagger_m),),
        ]

    def test_short_tracks_do_not_ask_for_more_metres_than_they_have(self, jobs: Any) -> None:
        job = jobs.rectangle(6, 10.0, tractors=3)
        check_plan(plan_interleaved(job))  # refuses gates beyond the end of a leg

    def test_split_field_starts_all_at_once(self, jobs: Any) -> None:
        plan = plan_split_field(jobs.rectangle(9, tractors=3))
        assert not any(leg.gates or leg.follow for mission in plan.missions for leg in mission.legs)

    def test_same_job_same_plan(self, jobs: Any) -> None:
        from vehicle.missions.plan_file import format_plan

        for name in ("split-field", "interleaved", "row-by-row", "col-by-col"):
            first, second = (format_plan(STRATEGIES[name].build(jobs.rectangle(9, tractors=3))) for _ in range(2))
            assert first == second
