"""Split-field and interleaved: who gets which tracks, and the plans made of them."""

from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.errors import StrategyError
from strategies.interleaved import interleaved
from strategies.job import Job
from strategies.registry import STRATEGIES
from strategies.split_field import blocks, split_field
from vehicle.missions import Gate, check_plan

QUICK = settings(deadline=None, max_examples=40, derandomize=True, database=None)


def loads(job: Job) -> list[float]:
    """Work and turns of every line, in metres at working speed, as they are shared out."""
    return [track.length + job.manner.turn_s[1] * job.manner.work_speed_mps for track in job.layout.tracks]


class TestBlocks:
    @QUICK
    @given(st.lists(st.integers(10, 400), min_size=1, max_size=9), st.data())
    def test_contiguous_complete_and_as_even_as_can_be(self, jobs: Any, lengths: list[int], data: Any) -> None:
        count = data.draw(st.integers(1, len(lengths)))
        job = jobs.drawn([[(0.0, float(length))] for length in lengths], tractors=count)
        shares = [[track.line for track in share] for share in blocks(job)]
        assert len(shares) == count and all(shares)
        assert [line for share in shares for line in share] == list(range(len(lengths)))
        weight = loads(job)
        cuts = combinations(range(1, len(lengths)), count - 1)
        best = min(max(sum(weight[a:b]) for a, b in pairwise((0, *cut, len(lengths)))) for cut in cuts)
        assert max(sum(weight[line] for line in share) for share in shares) == pytest.approx(best, rel=1e-9)

    def test_equal_tracks_are_shared_equally(self, jobs: Any) -> None:
        shares = blocks(jobs.rectangle(12, tractors=4))
        assert [len(share) for share in shares] == [3, 3, 3, 3]

    def test_pieces_of_one_line_stay_together(self, jobs: Any) -> None:
        job = jobs.drawn([[(0, 40), (60, 100)]] * 6, tractors=3)
        assert [[(t.line, t.piece) for t in share] for share in blocks(job)] == [
            [(line, piece) for line in (a, a + 1) for piece in (0, 1)] for a in (0, 2, 4)
        ]

    def test_more_tractors_than_lines_are_refused_with_the_number_that_fits(self, jobs: Any) -> None:
        job = jobs.drawn([[(0, 100)]] * 3, tractors=4)
        for make in (blocks, split_field, interleaved):
            with pytest.raises(StrategyError, match=r"4 tractors are more than the 3 tracks.*use 3 or fewer"):
                make(job)


class TestPlans:
    @pytest.mark.parametrize("tractors", [1, 2, 3, 5])
    @pytest.mark.parametrize("name", ["split-field", "interleaved"])
    def test_every_metre_is_worked_once(self, jobs: Any, name: str, tractors: int) -> None:
        job = jobs.rectangle(11, tractors=tractors)
        plan = STRATEGIES[name].build(job)
        check_plan(plan)
        assert plan.tractors == tractors
        assert plan.notes == {"strategy": name, "tractors": tractors}
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
        worked = jobs.worked(job, split_field(job))
        who = [stretches[0][2] for _, stretches in sorted(worked.items(), key=lambda item: item[0].line)]
        assert who == [0] * 4 + [1] * 4 + [2] * 4

    def test_a_fixed_pattern_is_kept(self, jobs: Any) -> None:
        job = jobs.rectangle(8, turn_s=(0.0, 90.0, 80.0, 10.0, 10.0))
        steps = []
        for jump in (1, 3):
            plan = split_field(replace(job, jump=jump))
            worked = [leg for leg in plan.missions[0].legs if leg.implement][::2]
            lines = [int(leg.points[0][0] // jobs.width_m) for leg in worked]
            steps.append([abs(b - a) for a, b in pairwise(lines)])
        assert steps[0] == [1] * 7
        assert steps[1][:5] == [3, 2, 3, 2, 3]

    @pytest.mark.parametrize("tractors", [2, 3, 4])
    def test_interleaved_takes_every_nth_line(self, jobs: Any, tractors: int) -> None:
        job = jobs.rectangle(10, tractors=tractors)
        worked = jobs.worked(job, interleaved(job))
        for track, stretches in worked.items():
            assert stretches[0][2] == track.line % tractors

    def test_interleaved_tractors_start_one_behind_the_other(self, jobs: Any) -> None:
        job = jobs.rectangle(9, tractors=3)
        plan = interleaved(job)
        gates = [mission.legs[0].gates for mission in plan.missions]
        assert gates == [(), (Gate(0, 1, job.manner.stagger_m),), (Gate(1, 1, job.manner.stagger_m),)]

    def test_short_tracks_do_not_ask_for_more_metres_than_they_have(self, jobs: Any) -> None:
        job = jobs.rectangle(6, 10.0, tractors=3)
        check_plan(interleaved(job))  # refuses gates beyond the end of a leg

    def test_split_field_starts_all_at_once(self, jobs: Any) -> None:
        plan = split_field(jobs.rectangle(9, tractors=3))
        assert not any(leg.gates or leg.follow for mission in plan.missions for leg in mission.legs)

    def test_same_job_same_plan(self, jobs: Any) -> None:
        from vehicle.plan_file import plan_to_json

        for name in ("split-field", "interleaved", "row-by-row", "col-by-col"):
            first, second = (plan_to_json(STRATEGIES[name].build(jobs.rectangle(9, tractors=3))) for _ in range(2))
            assert first == second
