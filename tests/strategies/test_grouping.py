"""Formations on any shape: tracks in rounds and left over, each driven once, and the share told of them."""

from itertools import pairwise
from typing import Any

import pytest
from shapely import Polygon, box

from fields import Field, Swath
from strategies.col_by_col import form_col_by_col
from strategies.formations.formation import Formation, describe_formation_share
from strategies.formations.grouping import divide_runs, find_swath_runs, group_swaths
from strategies.formations.slots import compute_missing_length_m
from strategies.program.field_job import FieldJob
from strategies.row_by_row import form_row_by_row
from vehicle.missions.plan import check_plan

L_SHAPE = Polygon([(0, 0), (90, 0), (90, 60), (30, 60), (30, 150), (0, 150)])
COMB = Polygon(
    [
        (0, 0),
        (96, 0),
        (96, 120),
        (72, 120),
        (72, 60),
        (60, 60),
        (60, 120),
        (36, 120),
        (36, 60),
        (24, 60),
        (24, 120),
        (0, 120),
    ]
)
HOLE = box(0, 0, 90, 160).difference(box(36, 60, 54, 90))
CUT = Polygon([(0, 0), (54, 0), (54, 100), (6, 100), (0, 24)])
SHAPES = {"L": L_SHAPE, "comb": COMB, "hole": HOLE, "cut": CUT}


def parts(formation: Formation) -> tuple[list[Swath], list[Swath]]:
    """Tracks of all rounds, and those left over."""
    rounds = [slot.swath_pass.swath for slots in formation.rounds for slot in slots]
    return rounds, [this.swath for this in formation.single_order]


def lines(job: FieldJob) -> list[list[int]]:
    return [[swath.line for swath in run] for run in find_swath_runs(job)]


class TestAnyShape:
    @pytest.mark.parametrize("make", [form_row_by_row, form_col_by_col])
    @pytest.mark.parametrize("tractors", [2, 3])
    @pytest.mark.parametrize("shape", SHAPES)
    def test_every_track_is_driven_once(self, jobs: Any, shape: str, tractors: int, make: Any) -> None:
        job = jobs.on_field(Field(shape, SHAPES[shape]), tractors, 0.0)
        formation = make(job)
        check_plan(formation.plan)
        jobs.assert_all_once(job, formation.plan)
        rounds, alone = parts(formation)
        assert sorted([*rounds, *alone], key=lambda t: (t.line, t.piece)) == list(job.layout.swaths)
        side_by_side = sum(
            slot.swath_pass.swath.length_m for slots in formation.rounds if len(slots) > 1 for slot in slots
        )
        whole = sum(swath.length_m for swath in job.layout.swaths)
        assert formation.plan.notes["formation_pct"] == pytest.approx(100.0 * side_by_side / whole, abs=1e-3)

    @pytest.mark.parametrize("tractors", [2, 3])
    @pytest.mark.parametrize("shape", SHAPES)
    def test_tracks_of_a_round_lie_side_by_side_with_room(self, jobs: Any, shape: str, tractors: int) -> None:
        job = jobs.on_field(Field(shape, SHAPES[shape]), tractors, 0.0)
        for slots in form_row_by_row(job).rounds:
            assert compute_missing_length_m(slots) <= 0.0
            along = sorted((slot.swath_pass.swath for slot in slots), key=lambda swath: swath.line)
            for a, b in pairwise(along):
                assert b.line - a.line == 1
                assert max(a.start_m[1], b.start_m[1]) < min(a.end_m[1], b.end_m[1])

    def test_the_others_stand_in_their_tracks_until_the_last_track_is_begun(self, jobs: Any) -> None:
        formation = form_row_by_row(jobs.on_field(Field("cut", CUT), 3, 0.0))
        (worker,) = formation.plan.notes["apart"]
        assert worker == next(slot.tractor for slot in formation.rounds[-1] if slot.row == 1) + 1
        last = formation.single_order[-1].swath
        for tractor, mission in enumerate(formation.plan.missions):
            if tractor != worker - 1:
                gates = [gate for gate in mission.legs[-1].gates if gate.tractor == worker - 1]
                awaited = [formation.plan.missions[worker - 1].legs[gate.leg].task for gate in gates]
                assert [(task.kind, task.number) for task in awaited] == [("drive-in", last.line)]


class TestRuns:
    def test_a_run_follows_the_longer_side_of_a_notch(self, jobs: Any) -> None:
        # Tracks of 100 m, then two pieces each: of 40 m and, beyond a gap, of 50 m, which overlaps more.
        job = jobs.drawn([[(0, 100)]] * 3 + [[(0, 40), (50, 100)]] * 3, 2)
        assert lines(job) == [[0, 1, 2, 3, 4, 5], [3, 4, 5]]
        assert [swath.piece for swath in find_swath_runs(job)[0]] == [0, 0, 0, 1, 1, 1]

    def test_tracks_shorter_than_two_rows_need_part_no_run(self, jobs: Any) -> None:
        # Two rows: 10 m between their places, 8 m before the headland and 0.1 m to drive.
        job = jobs.drawn([[(0, 100)], [(0, 18.05), (20, 100)], [(0, 100)], [(0, 18.15)], [(0, 100)]], 2)
        assert lines(job) == [[0, 1, 2, 3, 4]]
        assert [swath.piece for swath in find_swath_runs(job)[0]] == [0, 1, 0, 0, 0]

    def test_a_line_without_a_track_parts_runs(self, jobs: Any) -> None:
        assert lines(jobs.drawn([[(0, 50)], [(0, 50)], [], [(0, 50)]], 2)) == [[0, 1], [3]]


class TestShare:
    def test_is_that_of_the_tracks_side_by_side(self, jobs: Any) -> None:
        # Five tracks of 100 m and one of 10 m, too short for two: two rounds of two, one track alone and the short one.
        job = jobs.drawn([[(0, 100)]] * 5 + [[(0, 10)]], 2)
        found = group_swaths(job, divide_runs(job))
        assert [len(slots) for slots in found.rounds] == [2, 2, 1]
        assert [swath.length_m for swath in found.single_swaths] == [10.0]

    def test_of_a_corner_cut_off(self, jobs: Any) -> None:
        # The cut takes all but 6 m of the first track; the others, an even number, are driven two by two.
        job = jobs.on_field(Field("cut", CUT), 2, 0.0)
        shortest, *others = sorted(swath.length_m for swath in job.layout.swaths)
        assert shortest < 18.1 < others[0] and len(others) % 2 == 1
        plan = form_row_by_row(job).plan
        pct = plan.notes["formation_pct"]
        alone = [swath.length_m for swath in parts(form_row_by_row(job))[1]]
        single = [slots[0].swath_pass.swath.length_m for slots in form_row_by_row(job).rounds if len(slots) == 1]
        assert pct == pytest.approx(100.0 * (1.0 - (sum(alone) + sum(single)) / (shortest + sum(others))), abs=1e-3)
        assert shortest == pytest.approx(min(alone))

    def test_a_rectangle_is_driven_in_formation_throughout(self, jobs: Any) -> None:
        plan = form_row_by_row(jobs.rectangle(12, 100.0, tractors=3)).plan
        assert plan.notes["formation_pct"] == 100.0 and describe_formation_share(plan) is None

    def test_one_tractor_forms_nothing(self, jobs: Any) -> None:
        assert "formation_pct" not in form_row_by_row(jobs.rectangle(5, 100.0, tractors=1)).plan.notes

    def test_a_track_left_over_is_told(self, jobs: Any) -> None:
        plan = form_row_by_row(jobs.rectangle(11, 100.0, tractors=5)).plan
        assert plan.notes["formation_pct"] == pytest.approx(1000.0 / 11.0, abs=1e-3)
        assert describe_formation_share(plan) == "91 % of the tracks are worked in formation, the rest by tractor 3"
