"""Giving way: no contact, the same every time."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.fleet_drive import SoloRuns, resolve_conflicts
from planner.traffic.precedence import schedule_plan
from vehicle.missions.plan import DRIVE, ENTER, LEAVE, SWATH, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.plan_file import format_plan
from vehicle.missions.run import CONFLICT, DONE, STALL, SimulationRun
from vehicle.sim.compile import build_model_record
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.path_conflicts import ClearanceCheck
from vehicle.sim.world import World

pytestmark = pytest.mark.usefixtures("first_layout")

SPEED = 5 / 3.6


def simulate(site: Any, plan: Plan) -> SimulationRun:
    return World(plan, site.tractor, site.implement).run(stop_clearance_m=0.05, max_time_s=8000.0)


def resolve(site: Any, plan: Plan) -> tuple[SimulationRun, str | None]:
    alone = SoloRuns(IncrementalSimulator(site.tractor, site.implement, stop_clearance_m=0.05))
    check = ClearanceCheck.for_machine(site.tractor, site.implement, 0.05, 0.05)
    return resolve_conflicts(plan, partial(simulate, site), lambda one: schedule_plan(one, check, alone))


def test_one_tractor_has_nobody_to_keep_beside(wide_site: Any, evaluate_once: Any) -> None:
    times = {evaluate_once(wide_site, n, 1).time_s for n in ("row-by-row", "row-by-row-optimised", "col-by-col")}
    assert len(times) == 1


def leg(*points: tuple[float, float], work: bool = True, hold: bool = False, gates: tuple[LegGate, ...] = ()) -> Leg:
    task = LegTask(SWATH if work else DRIVE)
    return Leg(np.array(points, float), SPEED, implement=work, task=task, may_wait=hold, gates=gates)


def crossing(second_start: float = -40.0) -> Plan:
    """Two tractors whose paths cross at right angles at (0, 0), the second from `second_start` on the y axis."""
    along_x = Mission((leg((-40, 0), (-12, 0)), leg((-12, 0), (-9, 0), hold=True), leg((-9, 0), (40, 0), work=False)))
    along_y = Mission(
        (leg((0, second_start), (0, -12)), leg((0, -12), (0, -9), hold=True), leg((0, -9), (0, 40), work=False))
    )
    return Plan((along_x, along_y))


class TestGivingWay:
    def test_without_orders_the_crossing_is_a_conflict(self, small_site: Any) -> None:
        assert simulate(small_site, crossing()).outcome == CONFLICT

    def test_one_waits_for_the_other_and_neither_touches(self, small_site: Any) -> None:
        run, why = resolve(small_site, crossing())
        assert (run.outcome, why) == (DONE, None)
        assert run.contacts == () and run.min_clearance_m > 0.05
        added = [len(leg.gates) for mission in run.plan.missions for leg in mission.legs]
        assert sum(added) >= 1

    def test_whoever_comes_later_gives_way(self, small_site: Any) -> None:
        run, why = resolve(small_site, crossing(-43.0))
        assert why is None
        waits = [sum(len(leg.gates) for leg in mission.legs) for mission in run.plan.missions]
        assert waits[0] == 0 and waits[1] >= 1
        assert run.finish_s[1] > run.finish_s[0]

    def test_a_plan_without_conflict_is_left_alone(self, small_site: Any) -> None:
        plan = Plan((Mission((leg((0, 0), (40, 0)),)), Mission((leg((0, 12), (40, 12)),))))
        run, why = resolve(small_site, plan)
        assert why is None and format_plan(run.plan) == format_plan(plan)

    def test_head_on_is_refused_naming_both_and_the_time(self, small_site: Any) -> None:
        plan = Plan((Mission((leg((-40, 0), (40, 0)),)), Mission((leg((40, 0), (-40, 0)),))))
        run, why = resolve(small_site, plan)
        assert run.outcome != DONE
        assert why is not None and ("tractors 1 and 2" in why or "wait for each other" in why)

    def test_of_two_that_wait_for_each_other_one_goes_on(self, small_site: Any) -> None:
        first = Mission((leg((0, 0), (10, 0)), leg((10, 0), (20, 0), gates=(LegGate(1, 1, 5.0),))))
        second = Mission((leg((0, 20), (10, 20)), leg((10, 20), (20, 20), gates=(LegGate(0, 1, 5.0),))))
        plan = Plan((first, second))
        assert simulate(small_site, plan).outcome == STALL
        run, why = resolve(small_site, plan)
        assert why is None and run.outcome == DONE
        assert run.plan.notes.loosened == 1
        assert run.finish_s[1] > run.finish_s[0]

    def test_who_goes_on_when_another_has_left_waits_until_it_is_gone(self, small_site: Any) -> None:
        """Two use one lane: who leaves it is in it to the last, and who enters stands in it from the first."""
        leave, enter = (LegTask(kind) for kind in (LEAVE, ENTER))
        ways = [
            (leg((0, 0), (20, 0)), leg((20, 0), (30, 0), work=False)),
            (leg((30, 0), (20, 0), work=False), leg((20, 0), (0, 0))),
        ]
        first = Mission((ways[0][0], replace(ways[0][1], task=leave, may_wait=True)))
        second = Mission((replace(ways[1][0], task=enter), ways[1][1]))
        run, why = resolve(small_site, Plan((first, second)))
        assert (run.outcome, why) == (DONE, None)


def stand_behind(site: Any, ahead_m: float, turned: bool = False) -> Plan:
    """Two in a line, `ahead_m` of clear ground between them, that drive 40 m on and the first 20 m more; or the first
    one turned round, so that they face each other."""
    model = build_model_record(site.tractor, site.implement)
    back_m = site.tractor.antenna_forward_m - site.tractor.rear_axle_m
    nose_m, tail_m = float(model["nose"]) - back_m, back_m - float(min(model["tail"], model["tool_tail"]))
    begin_m = nose_m + ahead_m + (nose_m if turned else tail_m)
    end_m = begin_m + (-60.0 if turned else 60.0)
    return Plan((Mission((leg((begin_m, 0), (end_m, 0)),)), Mission((leg((0, 0), (40, 0)),))))


class TestStandingNear:
    CLEARANCE_M = 0.5

    def resolve(self, site: Any, plan: Plan) -> tuple[SimulationRun, str | None]:
        simulator = IncrementalSimulator(site.tractor, site.implement, stop_clearance_m=self.CLEARANCE_M)
        check = ClearanceCheck.for_machine(site.tractor, site.implement, self.CLEARANCE_M, self.CLEARANCE_M)
        alone = SoloRuns(simulator)
        return resolve_conflicts(
            plan, lambda one: simulator.simulate(one, 8000.0), lambda one: schedule_plan(one, check, alone)
        )

    def test_who_stands_behind_another_waits_until_that_has_gone(self, small_site: Any) -> None:
        run, why = self.resolve(small_site, stand_behind(small_site, 0.4))
        assert (run.outcome, why) == (DONE, None)
        assert [len(mission.legs[0].gates) for mission in run.plan.missions] == [0, 1]
        assert run.min_clearance_m == pytest.approx(0.4, abs=0.01)

    def test_nobody_follows_as_near_as_it_stood(self, small_site: Any) -> None:
        simulator = IncrementalSimulator(small_site.tractor, small_site.implement, stop_clearance_m=self.CLEARANCE_M)
        run = simulator.simulate(stand_behind(small_site, 0.4), 8000.0)
        assert run.outcome == CONFLICT and run.conflict is not None
        reach_m = float(build_model_record(small_site.tractor, small_site.implement)["reach"])
        assert run.conflict.first_m == pytest.approx(reach_m, abs=0.2)

    def test_two_that_face_each_other_are_refused(self, small_site: Any) -> None:
        run, why = self.resolve(small_site, stand_behind(small_site, 0.4, turned=True))
        assert run.outcome != DONE and why is not None and why.startswith("tractors 1 and 2 meet after ")

    def test_two_that_touch_are_to_be_driven_apart_first(self, small_site: Any) -> None:
        run, why = self.resolve(small_site, stand_behind(small_site, 0.02))
        assert run.outcome == CONFLICT
        assert why == "tractors 1 and 2 touch where they begin, or nearly do: drive one of them away first"


@pytest.mark.slow
def test_a_fleet_on_a_real_parcel_keeps_apart() -> None:
    from planner.evaluation.preparation import prepare_context
    from planner.evaluation.work_order import WorkOrder
    from planner.request.plan_request import PlanRequest

    site = prepare_context(WorkOrder(PlanRequest(field="netherlands", no_headland=True)))
    for name in ("interleaved", "split-field"):
        tried = run_candidate(site, Candidate(name, 4))
        assert tried.reason is None and tried.run.contacts == () and tried.run.min_clearance_m > 0
