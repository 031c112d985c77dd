"""The planned order at places that two tractors use: kept by gates and cuts, and borne out by physics."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.farm.random_inputs import UncertaintySettings, build_certain_settings
from planner.risk.assessment import check_graph_in_physics, scale_speeds
from planner.risk.leg_graph import build_leg_graph
from planner.risk.monte_carlo import sample_outcomes
from planner.risk.planned_order import MIN_PART_M, LegCut, cut_legs, enforce_planned_order
from vehicle.missions.plan import DRIVE, SWATH, FollowOrder, Leg, LegGate, LegTask, Mission, Plan, check_plan
from vehicle.missions.run import SimulationRun
from vehicle.sim.world import World

SPEED = 5 / 3.6


def leg(*points: tuple[float, float], work: bool = True, gates: tuple[LegGate, ...] = (), **more: Any) -> Leg:
    task = LegTask(SWATH if work else DRIVE)
    return Leg(np.array(points, float), SPEED, implement=work, task=task, gates=gates, **more)


def crossing(second_start: float) -> Plan:
    """Two paths that cross at (0, 0), each one leg of 40 m before it and 40 m after it."""
    return Plan((Mission((leg((-40, 0), (40, 0)),)), Mission((leg((0, second_start), (0, 40)),))))


def drive(site: Any, plan: Plan) -> SimulationRun:
    return World(plan, site.tractor, site.implement).run(max_time_s=4000.0)


class TestOrder:
    def test_who_came_first_is_waited_for(self, small_site: Any) -> None:
        run = drive(small_site, crossing(-60.0))
        assert not run.contacts
        kept = enforce_planned_order(run, small_site.tractor, small_site.implement)
        first, second = kept.plan.missions
        assert len(first.legs) == 1  # it waits for nobody
        gates = [each for one in second.legs for each in one.gates]
        assert gates and all((gate.tractor, gate.leg) == (0, 0) and gate.after_m > 40.0 for gate in gates)
        waits = next(index for index, one in enumerate(second.legs) if one.gates)
        ahead = sum(one.length_m for one in second.legs[:waits])
        assert 40.0 < ahead < 60.0  # on the way, short of the crossing

    def test_a_late_first_holds_up_the_second_and_they_do_not_touch(self, small_site: Any) -> None:
        run = drive(small_site, crossing(-60.0))
        slow = np.array([1.5, 1.0])
        before = drive(small_site, scale_speeds(run.plan, build_leg_graph(run), slow))
        assert before.contacts
        kept = enforce_planned_order(run, small_site.tractor, small_site.implement)
        graph = build_leg_graph(kept)
        factor = np.where(graph.tractor == 0, 1.5, 1.0)
        after = drive(small_site, scale_speeds(kept.plan, graph, factor))
        assert not after.contacts and after.finish_s[1] > run.finish_s[1] + 5.0
        late = build_leg_graph(after)  # of a drive in which somebody did wait
        assert sample_outcomes(late, build_certain_settings(), samples=1, seed=1).finish_s[0] == pytest.approx(
            after.duration_s, rel=0.01
        )

    def test_paths_apart_need_no_gates(self, small_site: Any) -> None:
        plan = Plan((Mission((leg((0, 0), (40, 0)),)), Mission((leg((0, 20), (40, 20)),))))
        run = drive(small_site, plan)
        kept = enforce_planned_order(run, small_site.tractor, small_site.implement)
        assert [len(one.gates) for mission in kept.plan.missions for one in mission.legs] == [0, 0]

    def test_no_gate_was_closed_in_the_run_itself(self, wide_site: Any) -> None:
        run = run_candidate(wide_site, Candidate("interleaved", 3)).run
        kept = enforce_planned_order(run, wide_site.tractor, wide_site.implement)
        assert sum(len(one.gates) for mission in kept.plan.missions for one in mission.legs) > 20
        check_plan(kept.plan)
        again = drive(wide_site, kept.plan)
        assert again.duration_s == pytest.approx(run.duration_s, rel=0.01)
        graph = sample_outcomes(build_leg_graph(kept), build_certain_settings(), samples=1, seed=1).finish_s[0]
        assert graph == pytest.approx(run.duration_s, rel=0.01)


@pytest.mark.parametrize(("strategy", "tractors"), [("interleaved", 3), ("row-by-row", 3)])
def test_physics_bears_out_the_graph(wide_site: Any, strategy: str, tractors: int) -> None:
    run = run_candidate(wide_site, Candidate(strategy, tractors)).run
    kept = enforce_planned_order(run, wide_site.tractor, wide_site.implement)
    found = check_graph_in_physics(kept, UncertaintySettings(), wide_site.tractor, wide_site.implement, drive_count=4)
    assert (found.contact_count, found.unfinished_count) == (0, 0)
    assert found.mean_relative_error < 0.01
    # The draws are apart by more than that: the graph follows what was drawn.
    assert np.ptp(found.simulated_s) > 0.03 * found.simulated_s.mean()


class TestCuts:
    def run(self, site: Any) -> SimulationRun:
        first = Mission((leg((0, 0), (30, 0)), leg((30, 0), (40, 0))))
        second = Mission((leg((0, 20), (40, 20), gates=(LegGate(0, 0, 25.0), LegGate(0, 0, 5.0), LegGate(0, 1, 3.0))),))
        return drive(site, Plan((first, second)))

    def test_parts_are_legs_in_plan_and_record(self, small_site: Any) -> None:
        run = self.run(small_site)
        row = int(np.searchsorted(run.time_s, 15.0))
        cut = cut_legs(run, {(0, 0): [LegCut(row, 20.0)]})
        assert [one.length_m for one in cut.plan.missions[0].legs] == pytest.approx([20.0, 10.0, 10.0])
        assert (cut.get_leg_numbers(0)[row - 1], cut.get_leg_numbers(0)[row], cut.get_leg_numbers(0).max()) == (0, 1, 2)
        assert (cut.get_leg_numbers(1) == run.get_leg_numbers(1)).all()
        assert cut.plan.missions[1].legs[0].gates == (LegGate(0, 1, 5.0), LegGate(0, 0, 5.0), LegGate(0, 2, 3.0))
        check_plan(cut.plan)

    def test_a_cut_plan_drives_as_before(self, small_site: Any) -> None:
        run = self.run(small_site)
        cut = cut_legs(run, {(0, 0): [LegCut(50, 7.0), LegCut(150, 20.0)]})
        again = drive(small_site, cut.plan)
        assert again.finish_s == pytest.approx(run.finish_s, abs=0.2)
        assert np.abs(again.record[:, :, :2] - run.record[: len(again.record), :, :2]).max() < 0.05

    def test_slivers_and_followers_stay_whole(self, small_site: Any) -> None:
        run = self.run(small_site)
        assert cut_legs(run, {(0, 0): [LegCut(1, 0.5 * MIN_PART_M), LegCut(200, 30.0 - 0.5 * MIN_PART_M)]}) is run
        follower = replace(run.plan.missions[1].legs[0], follow=FollowOrder(0, 0, 10.0))
        plan = Plan((run.plan.missions[0], Mission((follower,))))
        queue = replace(run, plan=plan)
        assert cut_legs(queue, {(0, 0): [LegCut(100, 15.0)], (1, 0): [LegCut(100, 15.0)]}) is queue
