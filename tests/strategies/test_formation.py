"""The triangle formation: who drives where, who waits for whom, and what is refused."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.col_by_col import form_col_by_col
from strategies.formations.formation import Formation
from strategies.path_planning.errors import StrategyError, build_too_many_error
from strategies.program.field_job import FieldJob
from strategies.row_by_row import form_row_by_row
from strategies.row_by_row_optimised import form_timed_rows
from vehicle.missions.plan import check_plan

QUICK = settings(max_examples=8)
KINDS = [form_row_by_row, form_col_by_col]


def place_from_line(job: FieldJob, formation: Formation, number: int, tractor: int) -> float:
    """Where a tractor stands in formation, metres north of the southern boundary."""
    leg = formation.marks[number, tractor].place_leg
    return float(formation.plan.missions[tractor].legs[leg].points[-1][1])


class TestTriangle:
    @pytest.mark.parametrize(
        ("tractors", "rows"),
        [
            (1, [1]),
            (2, [1, 2]),
            (3, [2, 1, 2]),
            (4, [2, 1, 2, 3]),
            (5, [3, 2, 1, 2, 3]),
            (7, [4, 3, 2, 1, 2, 3, 4]),
        ],
    )
    def test_rows_lead_from_the_middle(self, jobs: Any, tractors: int, rows: list[int]) -> None:
        formation = form_row_by_row(jobs.rectangle(2 * tractors, 120.0, tractors=tractors))
        for slots in formation.rounds:
            assert [slot.row for slot in slots] == rows
            assert [slot.tractor for slot in slots] == list(range(tractors))

    @pytest.mark.parametrize("tractors", [2, 3, 5, 8])
    def test_everyone_but_the_leader_follows_the_neighbour_one_row_ahead(self, jobs: Any, tractors: int) -> None:
        formation = form_row_by_row(jobs.rectangle(2 * tractors, 150.0, tractors=tractors))
        for slots in formation.rounds:
            by_tractor = {slot.tractor: slot for slot in slots}
            assert [slot.neighbour for slot in slots if slot.row == 1] == [None]
            for slot in (slot for slot in slots if slot.row > 1):
                assert slot.neighbour is not None
                front = by_tractor[slot.neighbour]
                assert front.row == slot.row - 1
                assert abs(front.swath_pass.swath.line - slot.swath_pass.swath.line) == 1

    @pytest.mark.parametrize("tractors", [2, 3, 5, 6])
    def test_places_are_ten_metres_apart_and_the_last_row_starts_at_the_line(self, jobs: Any, tractors: int) -> None:
        job = jobs.rectangle(2 * tractors, 150.0, tractors=tractors)
        formation = form_row_by_row(job)
        for number, slots in enumerate(formation.rounds):
            last = max(slot.row for slot in slots)
            for slot in slots:
                assert slot.place_m == pytest.approx(jobs.tool_m + 10.0 * (last - slot.row))
            ahead = 1 if job.compute_heading(slots[0].swath_pass) > 0 else -1
            rows = {slot.row: place_from_line(job, formation, number, slot.tractor) for slot in slots}
            for row in range(2, last + 1):
                assert ahead * (rows[row - 1] - rows[row]) == pytest.approx(10.0)

    def test_followers_keep_the_gap_to_their_neighbour_while_it_works(self, jobs: Any) -> None:
        formation = form_row_by_row(jobs.rectangle(10, 120.0, tractors=5))
        for number, slots in enumerate(formation.rounds):
            for slot in slots:
                follow = (
                    formation.plan.missions[slot.tractor].legs[formation.marks[number, slot.tractor].work_leg].follow
                )
                if slot.neighbour is None:
                    assert follow is None
                else:
                    work = formation.marks[number, slot.neighbour].work_leg
                    assert follow is not None
                    assert (follow.tractor, follow.leg, follow.gap_m) == (slot.neighbour, work, 10.0)

    def test_slanted_ends_keep_rows_at_least_the_gap_apart(self, jobs: Any) -> None:
        from shapely import Polygon

        from fields import Field

        job = jobs.on_field(Field("slant", Polygon([(0, 0), (45, 25), (45, 160), (0, 160)])), 5, 0.0)
        formation = form_row_by_row(job)
        for number, slots in enumerate(formation.rounds):
            ahead = 1 if job.compute_heading(slots[0].swath_pass) > 0 else -1
            place = {slot.tractor: ahead * place_from_line(job, formation, number, slot.tractor) for slot in slots}
            for slot in slots:
                if slot.neighbour is not None:
                    assert place[slot.neighbour] - place[slot.tractor] >= 10.0 - 1e-6


class TestPlan:
    @pytest.mark.parametrize("make", KINDS)
    @QUICK
    @given(lines=st.integers(5, 14), tractors=st.integers(1, 5))
    def test_every_metre_once_and_executable(self, jobs: Any, make: Any, lines: int, tractors: int) -> None:
        job = jobs.rectangle(lines, 100.0, tractors=tractors)
        formation = make(job)
        check_plan(formation.plan)
        jobs.assert_all_once(job, formation.plan)
        worked = [slot.swath_pass.swath for slots in formation.rounds for slot in slots]
        assert sorted(worked, key=lambda t: t.line) == list(job.layout.swaths)

    def test_timed_releases_make_the_same_passes(self, jobs: Any) -> None:
        job = jobs.rectangle(10, 100.0, tractors=5)
        timed = form_timed_rows(job, {(1, 0): ((2, 14.0), (1, 4.0))})
        check_plan(timed.plan)
        jobs.assert_all_once(job, timed.plan)
        release = timed.plan.missions[0].legs[timed.marks[1, 0].release_leg]
        assert {gate.tractor for gate in release.gates} == {1, 2}
        assert timed.plan.notes["strategy"] == "row-by-row-optimised"

    def test_a_release_counts_metres_from_the_release_of_the_other(self, jobs: Any) -> None:
        job = jobs.rectangle(10, 100.0, tractors=5)
        timed = form_timed_rows(job, {(1, 1): ((2, 37.0),)})
        (gate,) = timed.plan.missions[1].legs[timed.marks[1, 1].release_leg].gates
        first = timed.marks[1, 2].release_leg
        legs = timed.plan.missions[2].legs
        assert sum(leg.length_m for leg in legs[first : gate.leg]) + gate.after_m == pytest.approx(37.0)

    def test_directions_alternate_from_round_to_round(self, jobs: Any) -> None:
        formation = form_row_by_row(jobs.rectangle(9, 100.0, tractors=3))
        directions = [{slot.swath_pass.direction for slot in slots} for slots in formation.rounds]
        assert all(len(each) == 1 for each in directions)
        assert all(a != b for a, b in pairwise(directions))

    @pytest.mark.parametrize("entrance", [(0, 0), (30, 0), (0, 138), (30, 138)])
    def test_the_first_round_starts_at_the_entrance(self, jobs: Any, entrance: tuple[float, float]) -> None:
        job = jobs.rectangle(10, 120.0, tractors=2, entrance=entrance)
        x, y, _ = job.get_entry_pose(form_row_by_row(job).rounds[0][0].swath_pass)
        assert abs(x - entrance[0]) < 3.0 and abs(y - entrance[1]) < 12.0


class TestQueue:
    def test_row_by_row_leaves_the_queue_when_the_row_before_is_in_place(self, jobs: Any) -> None:
        formation = form_row_by_row(jobs.rectangle(10, 120.0, tractors=5))
        legs = [mission.legs for mission in formation.plan.missions]
        for slot in formation.rounds[1]:
            gates = legs[slot.tractor][formation.marks[1, slot.tractor].release_leg].gates
            ahead = [other for other in formation.rounds[1] if other.row == slot.row - 1]
            for other in ahead:
                placed = formation.marks[1, other.tractor].place_leg
                mine = [gate for gate in gates if (gate.tractor, gate.leg) == (other.tractor, placed)]
                assert len(mine) == 1
                assert legs[other.tractor][placed].length_m - mine[0].after_m == pytest.approx(0.2)

    def test_nobody_works_before_all_are_in_place(self, jobs: Any) -> None:
        for make in KINDS:
            formation = make(jobs.rectangle(10, 120.0, tractors=5))
            for number, slots in enumerate(formation.rounds):
                for slot in slots:
                    start = formation.plan.missions[slot.tractor].legs[formation.marks[number, slot.tractor].work_leg]
                    waited_for = {(gate.tractor, gate.leg) for gate in start.gates}
                    others = {(s.tractor, formation.marks[number, s.tractor].place_leg) for s in slots if s != slot}
                    assert others <= waited_for

    def test_columns_turn_strictly_one_after_another(self, jobs: Any) -> None:
        formation = form_col_by_col(jobs.rectangle(15, 120.0, tractors=5))
        for number, slots in enumerate(formation.rounds[1:], start=1):
            chain = {}
            for slot in slots:
                release = formation.plan.missions[slot.tractor].legs[formation.marks[number, slot.tractor].release_leg]
                turned = [g.tractor for g in release.gates if g.leg == formation.marks[number, g.tractor].turn_leg]
                chain[slot.tractor] = turned[0] if turned else None
            order = [next(s.tractor for s in slots if s.row == 1)]
            while len(order) < len(slots):
                order += [tractor for tractor, before in chain.items() if before == order[-1]]
            # The round moves on to lines beyond its last tractor, which is 4 of 0 ... 4: that side goes first.
            assert order == [2, 3, 4, 1, 0]

    def test_a_formation_of_one_waits_for_nobody(self, jobs: Any) -> None:
        plan = form_row_by_row(jobs.rectangle(4, tractors=1)).plan
        assert not any(leg.gates or leg.follow for leg in plan.missions[0].legs)


class TestLastRound:
    @pytest.mark.parametrize(("lines", "left"), [(11, 1), (12, 2), (13, 3), (14, 4)])
    def test_the_remaining_tracks_go_to_the_middle(self, jobs: Any, lines: int, left: int) -> None:
        formation = form_row_by_row(jobs.rectangle(lines, 120.0, tractors=5))
        last = formation.rounds[-1]
        assert len(last) == left
        tractors = [slot.tractor for slot in last]
        first = (5 - left) // 2
        assert tractors == list(range(first, first + left))
        assert sum(slot.row == 1 for slot in last) == 1
        working = {
            tractor
            for tractor, mission in enumerate(formation.plan.missions)
            if (len(formation.rounds) - 1, tractor) in formation.marks and mission.legs
        }
        assert working == set(tractors)

    def test_tractors_without_a_track_clear_the_way(self, jobs: Any) -> None:
        formation = form_row_by_row(jobs.rectangle(11, 120.0, tractors=5))
        before = len(formation.rounds) - 2
        busy = formation.rounds[-1][0].tractor
        for tractor in set(range(5)) - {busy}:
            last_leg = formation.plan.missions[tractor].legs[-1]
            assert any(gate.tractor == busy for gate in last_leg.gates)
            assert (before + 1, tractor) not in formation.marks


class TestRefusals:
    @pytest.mark.parametrize("make", KINDS)
    def test_more_tractors_than_tracks(self, jobs: Any, make: Any) -> None:
        with pytest.raises(StrategyError, match=r"5 tractors are more than the 4 tracks.*use 4 or fewer"):
            make(jobs.rectangle(4, tractors=5))

    def test_more_tractors_than_one_track(self) -> None:
        assert "2 tractors are more than the 1 track of the field; use 1 tractor, or" in str(build_too_many_error(2, 1))

    @pytest.mark.parametrize("make", KINDS)
    def test_tracks_too_short_for_the_rows(self, jobs: Any, make: Any) -> None:
        # Four gaps of 10 m between the first place and the last, 8 m to wait before the headland, and 0.1 m to drive.
        primitives = (
            r"20\.0 m long, too short for a formation of 5 rows 10 m apart.* needs 48\.1 m .*, 28\.1 m more than here"
        )
        with pytest.raises(StrategyError, match=primitives):
            make(jobs.rectangle(18, 20.0, tractors=9))

    @pytest.mark.parametrize(("length", "tractors", "fits"), [(20.0, 9, 3), (30.0, 9, 5), (47.0, 9, 7), (30.0, 6, 5)])
    def test_the_advice_is_the_largest_formation_that_fits(
        self, jobs: Any, length: float, tractors: int, fits: int
    ) -> None:
        with pytest.raises(StrategyError, match=rf"; use {fits} tractors, or split-field or interleaved\."):
            form_row_by_row(jobs.rectangle(18, length, tractors=tractors))
        form_row_by_row(jobs.rectangle(18, length, tractors=fits))

    @pytest.mark.parametrize(("tractors", "advice"), [(2, "use split"), (3, "use 2 tractors, or split")])
    def test_nowhere_enough_tracks_side_by_side(self, jobs: Any, tractors: int, advice: str) -> None:
        # A gap of two lines parts the field; on either side lies a track fewer than there are tractors.
        job = jobs.drawn([[(0, 60)]] * (tractors - 1) + [[]] * 2 + [[(0, 60)]] * (tractors - 1), tractors)
        with pytest.raises(StrategyError, match=rf"needs {tractors} tracks of at least 18\.1 m .*; {advice}"):
            form_row_by_row(job)
