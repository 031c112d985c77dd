"""Tractors driven alone: each once, and those of an expected plan together."""

from typing import Any

import numpy as np
import pytest
import shapely

from fields import Field
from planner.evaluation.candidates.fleet_drive import SoloRuns, remove_gates
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.sim.incremental import IncrementalSimulator


@pytest.fixture(scope="module")
def round_site() -> PlanningContext:
    """60 m by 90 m with its headland worked."""
    return prepare_context(WorkOrder(PlanRequest(), Field("drawn", shapely.box(0, 0, 60, 90))))


def build_fleet(tractors: int) -> Plan:
    """Tractors on lines of their own, the first the longest; each but the first waits for the one before it."""

    def build_leg(number: int, start_m: float, end_m: float, **more: Any) -> Leg:
        return Leg(np.array([[start_m, 9.0 * number], [end_m, 9.0 * number]]), 2.0, **more)

    missions = []
    for number in range(tractors):
        gates = (LegGate(number - 1, 0, 5.0),) if number else ()
        missions.append(Mission((build_leg(number, 0, 20, gates=gates), build_leg(number, 20, 60 - 5 * number))))
    return Plan(tuple(missions))


def test_who_is_driven_alone_is_forgotten_only_where_records_are_long(
    round_site: PlanningContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other, third = remove_gates(build_fleet(3)).missions
    alone = SoloRuns(round_site)
    first = alone(one)
    alone(other)
    assert alone(one) is first
    monkeypatch.setattr("planner.evaluation.candidates.fleet_drive.MAX_ROWS", 0)
    alone(third)
    again = alone(one)
    assert again is not first and np.array_equal(again.record, first.record)


def test_of_an_expected_plan_all_others_are_driven_with_the_second_that_is_asked_for(
    round_site: PlanningContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = build_fleet(4)
    free, site = remove_gates(plan).missions, round_site
    rehearsal = IncrementalSimulator(site.tractor, site.implement, stop_clearance_m=0.5, seed=site.request.seed)
    alone, plain, driven, apart = SoloRuns(site, rehearsal), SoloRuns(site), [], rehearsal.simulate_alone

    def noted(plan: Plan, numbers: list[int], most_s: list[float]) -> Any:
        driven.append(numbers)
        return apart(plan, numbers, most_s)

    monkeypatch.setattr(rehearsal, "simulate_alone", noted)
    alone.expect_plan(plan)
    for number in (2, 0, 1, 3):
        run, own = alone(free[number]), plain(free[number])
        assert run.record.tobytes() == own.record.tobytes() and run.outcome == own.outcome
    assert driven == [[2], [0, 1, 3]]
    alone(Mission(free[0].legs[:1]))
    assert len(driven) == 2  # that is no tractor of the plan
