"""Right of way: who waits for whom, where and until when; no deadlock where an order of going home exists.

Courses are drawn by hand: poses at given places, driven at 1 m/s, so that times and metres can be told by counting.
"""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings

from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.traffic.deadlock_search import find_way_home
from planner.traffic.precedence import DeadlockAvoidance, PrecedenceSearch, _add_gates
from planner.traffic.timetable_search import GAP_BEHIND_S, START_LOSS_S
from planner.traffic.trajectories import SoloTrajectory
from tests.examples import count_examples, seldom
from tests.planner.grid import (
    APART_M,
    IMPLEMENT,
    TRACTOR,
    Cells,
    Plain,
    all_hold_points,
    crossings,
    plan_on,
    straight,
    traffic,
    trajectory,
)
from vehicle.missions.plan import LegGate
from vehicle.sim.compile import compute_contact_boxes
from vehicle.sim.path_conflicts import EXTRA_CLEARANCE_M

pytestmark = pytest.mark.usefixtures("first_layout")


class TestCrossingPaths:
    """One drives along x, the other along y; both may stand 30 m before the crossing at (0, 0)."""

    @staticmethod
    def lag_m() -> float:
        """How far one must be ahead of the other when it crosses first, from the outlines of both."""
        box = compute_contact_boxes(TRACTOR, IMPLEMENT)
        assert box["tool_half_width"] > box["half_width"]
        corner = math.sqrt(2.0) * (APART_M + EXTRA_CLEARANCE_M)
        return box["nose"] - box["tool_tail"] + box["half_width"] + box["tool_half_width"] + corner

    def test_the_one_that_comes_later_waits_at_its_hold_point(self) -> None:
        first, second = straight(-40, 0, 0.0, 80, [0, 10, 80]), straight(0, -42, math.pi / 2, 84, [0, 12, 84])
        table = PrecedenceSearch(plan_on([first, second]), crossings([first, second])).find_timetable()
        assert table.begins_s[0][-1] == pytest.approx(10.0 + START_LOSS_S)  # 10 m from the start, for which it stood
        lag = table.begins_s[1][-1] - table.begins_s[0][-1]
        assert lag == pytest.approx(self.lag_m() + GAP_BEHIND_S, abs=1.1)  # poses lie 1 m apart

    def test_the_gate_opens_where_the_first_is_then(self) -> None:
        first, second = straight(-40, 0, 0.0, 80, [0, 10, 80]), straight(0, -42, math.pi / 2, 84, [0, 12, 84])
        table = PrecedenceSearch(plan_on([first, second]), crossings([first, second])).find_timetable()
        waits = {(tractor, leg): gate for tractor, leg, gate in table.gates}
        assert set(waits) == {(1, 1)} and (waits[1, 1].tractor, waits[1, 1].leg) == (0, 1)
        assert waits[1, 1].after_m == pytest.approx(self.lag_m() + GAP_BEHIND_S, abs=1.6)

    def test_who_is_far_ahead_keeps_nobody_waiting(self) -> None:
        first, second = straight(-40, 0, 0.0, 80, [0, 10, 80]), straight(0, -90, math.pi / 2, 130, [0, 60, 130])
        table = PrecedenceSearch(plan_on([first, second]), crossings([first, second])).find_timetable()
        assert table.begins_s[1][-1] == pytest.approx(table.begins_s[1][0] + 60.0 + START_LOSS_S)

    def test_who_stands_in_the_way_for_long_is_waited_for(self) -> None:
        """Though its place is reached only minutes later: what says that it has gone by then is a gate on it alone."""
        crosses, waits = straight(0, -300, math.pi / 2, 330, [0, 330]), straight(-50, 0, 0.0, 100, [0, 50, 100])
        trajectories = [crosses, waits, straight(0, 500, 0.0, 600, [0, 600])]
        plan = plan_on(trajectories, {(0, 0): [LegGate(1, 0, 9.0)], (1, 1): [LegGate(2, 0, 599.0)]})
        table = PrecedenceSearch(plan, crossings(trajectories, {0: {0}, 1: {1}})).find_timetable()
        assert table.begins_s[0][0] > table.begins_s[1][1] > 598.0
        assert (0, 0, 1, 1) in {(tractor, leg, gate.tractor, gate.leg) for tractor, leg, gate in table.gates}

    def test_a_hold_point_from_which_nothing_is_crossed_is_not_used(self) -> None:
        first, second = straight(-40, 0, 0.0, 90, [0, 10, 80, 90]), straight(0, -42, math.pi / 2, 84, [0, 12, 84])
        table = crossings([first, second])
        assert table.trajectories[0].holds == (0, 10, 90)


def through_a_corridor() -> list[SoloTrajectory]:
    """Two that go through a corridor along x from 0 to 90 in opposite directions; each may stand inside it."""
    east = [(float(x), 0.0, 0.0) for x in range(-30, 121)]
    down = [(90.0, 40.0 - y, -math.pi / 2) for y in range(31)]
    west = [(float(x), 0.0, math.pi) for x in range(90, -1, -1)]
    away = [(0.0, -10.0 - y, -math.pi / 2) for y in range(31)]
    return [
        trajectory(east, [0, 60, 150], 1.0),
        trajectory(down + west + away, [0, 75, len(down + west + away) - 1], 1.0),
    ]


class TestCorridor:
    def test_both_inside_is_a_deadlock_and_one_inside_is_none(self) -> None:
        trajectories = through_a_corridor()
        home = DeadlockAvoidance(plan_on(trajectories), crossings(trajectories))
        for state, safe in (((0, 0), True), ((1, 0), True), ((0, 1), True), ((1, 1), False)):
            at = np.array(state)
            assert find_way_home(home.net, at, np.empty_like(at), home.way) is safe
        assert home.drop_deadlocked_gates() and not home.dropped_gates

    def test_the_second_enters_when_the_first_is_out(self) -> None:
        trajectories = through_a_corridor()
        table = PrecedenceSearch(plan_on(trajectories), crossings(trajectories)).find_timetable()
        later = max(range(2), key=lambda one: table.begins_s[one][0])
        first = 1 - later
        out_s = (
            table.begins_s[first][-1] + trajectories[first].get_duration_s(trajectories[first].segment_count - 1) - 60.0
        )
        assert table.begins_s[later][0] > out_s - 45.0 and table.begins_s[first][0] == 0.0

    def test_head_on_without_a_place_to_pass_has_no_order(self) -> None:
        trajectories = [straight(0, 0, 0.0, 60, [0, 30, 60]), straight(60, 0, math.pi, 60, [0, 30, 60])]
        assert PrecedenceSearch(plan_on(trajectories), crossings(trajectories)).find_timetable() is None

    def test_a_gate_that_makes_the_deadlock_is_left_out(self) -> None:
        """The first, told to wait inside the corridor until the other is home, goes on without."""
        trajectories = through_a_corridor()
        gate = LegGate(1, 1, trajectories[1].get_duration_s(1) - 1.0)
        heeded = PrecedenceSearch(plan_on(trajectories, {(0, 0): [gate]}), crossings(trajectories, {0: {0}}))
        assert heeded.find_timetable() is not None and heeded.deadlock_avoidance.dropped_gates == []
        inside = [straight(-30, 0, 0.0, 60, [0, 30, 60]), straight(0, -40, math.pi / 2, 80, [0, 20, 80])]
        knot = PrecedenceSearch(
            plan_on(inside, {(0, 1): [LegGate(1, 1, 59.0)], (1, 1): [LegGate(0, 0, 29.0)]}),
            crossings(inside, {0: {1}, 1: {1}}),
        )
        assert knot.find_timetable() is not None
        assert knot.deadlock_avoidance.dropped_gates == [(0, 1, LegGate(1, 1, 59.0))]


@settings(max_examples=count_examples(150))
@given(traffic())
def test_all_get_home_where_there_is_any_way_and_never_two_are_in_one_place(drawn: Cells) -> None:
    trajectories = drawn.trajectories()
    table = PrecedenceSearch(plan_on(trajectories), all_hold_points(trajectories)).find_timetable()
    assert (table is not None) == Plain(drawn, {}).gets_home((0,) * len(drawn.cells))
    if table is None:
        return
    assert [len(begins) for begins in table.begins_s] == [each.segment_count for each in trajectories]
    for one in range(len(trajectories)):
        for other in range(one):
            for low, high, cell in drawn.taken(one, table):
                for low2, high2, cell2 in drawn.taken(other, table):
                    assert cell != cell2 or min(high, high2) <= max(low, low2)


@settings(max_examples=count_examples(100))
@given(traffic())
def test_gates_wait_only_for_what_comes_before_in_time(drawn: Cells) -> None:
    """So that no two tractors ever wait for each other."""
    trajectories = drawn.trajectories()
    plan, table = (
        plan_on(trajectories),
        PrecedenceSearch(plan_on(trajectories), all_hold_points(trajectories)).find_timetable(),
    )
    if table is None:
        return
    for tractor, leg, gate in table.gates:
        passed = table.begins_s[gate.tractor][gate.leg] + gate.after_m
        assert passed <= table.begins_s[tractor][leg] + 10.0  # poses lie 10 s apart
        assert table.begins_s[gate.tractor][gate.leg] < table.begins_s[tractor][leg]
    gated = _add_gates(plan, table.gates)
    assert sum(len(leg.gates) for mission in gated.missions for leg in mission.legs) <= len(table.gates)


@pytest.fixture(scope="module")
def slanted(place: Any) -> Any:
    """A quadrangle of 1.2 ha with slanted headlands, its headland worked."""
    return place(shapely.Polygon([(0, 0), (95, 12), (88, 140), (10, 118)]), no_headland=False)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", [*seldom("row-by-row", "col-by-col"), "interleaved"])
def test_three_tractors_work_a_slanted_field_and_its_headland(slanted: Any, strategy: str) -> None:
    evaluation = simulate_candidate(slanted, Candidate(strategy, 3))
    assert evaluation.result.feasible, evaluation.result.reason
    assert evaluation.run.contacts == ()
    assert evaluation.run.min_clearance_m >= 0.05
    assert (evaluation.result.worked_pct or 0.0) > 97.0


@pytest.mark.slow
def test_an_annexe_behind_a_neck_is_left_out_and_told(place: Any) -> None:
    """Its tracks are few and no tractor fits through a neck of 1 m, even with half a metre over either edge."""
    field = shapely.union_all([shapely.box(0, 0, 50, 80), shapely.box(50, 50, 56, 51), shapely.box(56, 36, 84, 66)])
    site = place(field, no_headland=False, bearing_deg=0.0)
    result = simulate_candidate(site, Candidate("row-by-row", 1)).result
    assert result.feasible, result.reason
    assert result.remark is not None and "lines of work are left" in result.remark
    assert (result.missed_m2 or 0.0) >= 0.9 * 28 * 30
    two = simulate_candidate(site, Candidate("split-field", 2)).result
    assert two.feasible and (two.missed_m2 or 0.0) < 0.9 * 28 * 30, "one of two may begin in it, without an entrance"
