"""Giving way: no contact, the same every time."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.fleet_drive import SoloRuns
from planner.traffic.giving_way import can_gates_open, resolve_conflicts
from planner.traffic.precedence import schedule_plan
from vehicle.missions.plan import DRIVE, SWATH, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.plan_file import format_plan
from vehicle.missions.run import CONFLICT, DONE, STALL, SimulationRun
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.path_conflicts import ClearanceCheck
from vehicle.sim.world import World

SPEED = 5 / 3.6


def simulate(site: Any, plan: Plan) -> SimulationRun:
    return World(plan, site.tractor, site.implement).run(stop_clearance_m=0.05, max_time_s=8000.0)


def resolve(site: Any, plan: Plan) -> tuple[SimulationRun, str | None]:
    alone = SoloRuns(IncrementalSimulator(site.tractor, site.implement, stop_clearance_m=0.05))
    check = ClearanceCheck.for_machine(site.tractor, site.implement, 0.05, 0.05)
    return resolve_conflicts(
        plan, partial(simulate, site), lambda one, slack: schedule_plan(one, check, alone, slack=slack)
    )


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

    def test_waiting_for_each_other_is_refused(self, small_site: Any) -> None:
        first = Mission((leg((0, 0), (10, 0)), leg((10, 0), (20, 0), gates=(LegGate(1, 1, 5.0),))))
        second = Mission((leg((0, 20), (10, 20)), leg((10, 20), (20, 20), gates=(LegGate(0, 1, 5.0),))))
        run, why = resolve(small_site, Plan((first, second)))
        assert run.outcome == STALL
        assert why is not None and "wait for each other" in why

    def test_who_waits_in_a_circle_is_known_without_driving(self, small_site: Any) -> None:
        free = crossing()
        one = free.copy_with_gate(0, 1, LegGate(1, 2, 20.0))
        both = one.copy_with_gate(1, 1, LegGate(0, 2, 20.0))
        for plan, open_ in ((free, True), (one, True), (both, False)):
            assert can_gates_open(plan) is open_
            assert open_ or simulate(small_site, plan).outcome == STALL
        behind = free.copy_with_gate(0, 2, LegGate(1, 1, 1.0)).copy_with_gate(
            1, 2, LegGate(0, 1, 1.0)
        )  # each passes the other's gate
        assert can_gates_open(behind)

    def test_no_order_that_holds_all_up_is_driven(self, small_site: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        """Two on one line, each of which may stand before the middle."""
        paths = [[(-40 * side, 0), (-12 * side, 0), (-9 * side, 0), (40 * side, 0)] for side in (1, -1)]
        plan = Plan(tuple(Mission(tuple(leg(*path[k : k + 2], hold=k == 1) for k in range(3))) for path in paths))
        driven: dict[bool, list[Plan]] = {True: [], False: []}
        for known in driven:
            if not known:
                monkeypatch.setattr("planner.traffic.giving_way.can_gates_open", lambda _: True)

            def drive(tried: Plan, known: bool = known) -> SimulationRun:
                driven[known].append(tried)
                return simulate(small_site, tried)

            assert resolve_conflicts(plan, drive, lambda *_: None)[1] is not None
        assert all(can_gates_open(tried) for tried in driven[True])
        assert not all(can_gates_open(tried) for tried in driven[False])

    def test_giving_way_is_repeatable(self, small_site: Any) -> None:
        plans = [resolve(small_site, crossing())[0].plan for _ in range(2)]
        assert format_plan(plans[0]) == format_plan(plans[1])


def test_a_fleet_on_a_real_parcel_keeps_apart() -> None:
    from planner.evaluation.preparation import prepare_context
    from planner.evaluation.work_order import WorkOrder
    from planner.request.plan_request import PlanRequest

    site = prepare_context(WorkOrder(PlanRequest(field="netherlands", no_headland=True)))
    for name in ("interleaved", "split-field"):
        tried = run_candidate(site, Candidate(name, 4))
        assert tried.reason is None and tried.run.contacts == () and tried.run.min_clearance_m > 0
