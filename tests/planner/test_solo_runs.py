"""Tractors driven alone: each once, and those of a plan together."""

from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.fleet_drive import SoloRuns, remove_gates
from planner.evaluation.context import PlanningContext
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.world import World


def build_fleet(tractors: int) -> Plan:
    """Tractors on lines of their own, the first the longest; each but the first waits for the one before it."""

    def build_leg(number: int, start_m: float, end_m: float, **more: Any) -> Leg:
        return Leg(np.array([[start_m, 9.0 * number], [end_m, 9.0 * number]]), 2.0, **more)

    missions = []
    for number in range(tractors):
        gates = (LegGate(number - 1, 0, 5.0),) if number else ()
        missions.append(Mission((build_leg(number, 0, 20, gates=gates), build_leg(number, 20, 60 - 5 * number))))
    return Plan(tuple(missions))


def build_solo_runs(site: PlanningContext) -> SoloRuns:
    rehearsal = IncrementalSimulator(site.tractor, site.implement, stop_clearance_m=0.5, seed=site.request.seed)
    return SoloRuns(rehearsal)


def test_who_is_driven_alone_is_forgotten_only_where_records_are_long(
    round_site: PlanningContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, alone = build_fleet(3), build_solo_runs(round_site)
    (first,) = alone(plan, [0])
    _, again = alone(plan, [1, 0])
    assert again is first
    monkeypatch.setattr("planner.evaluation.candidates.fleet_drive.MAX_ROWS", 0)
    _, again = alone(plan, [2, 0])
    assert again is not first and np.array_equal(again.record, first.record)


@pytest.mark.parametrize("most_rows", [0, 10_000])
def test_those_not_driven_yet_are_driven_together_as_each_would_drive(
    round_site: PlanningContext, monkeypatch: pytest.MonkeyPatch, most_rows: int
) -> None:
    monkeypatch.setattr("planner.evaluation.candidates.fleet_drive.MAX_PLAN_ROWS", most_rows)
    plan, alone, driven = build_fleet(4), build_solo_runs(round_site), []
    together = alone.rehearsal.simulate_alone

    def noted(plan: Plan, numbers: list[int], most_s: list[float]) -> Any:
        driven.append(numbers)
        return together(plan, numbers, most_s)

    monkeypatch.setattr(alone.rehearsal, "simulate_alone", noted)
    runs = [*alone(plan, [2]), *alone(plan, range(4))]
    assert driven == ([[2], [0, 1, 3]] if most_rows else [])
    for run, number in zip(runs, (2, 0, 1, 2, 3), strict=True):
        own = World(Plan((remove_gates(plan).missions[number],)), round_site.tractor, round_site.implement).run()
        assert run.record.tobytes() == own.record.tobytes() and run.outcome == own.outcome
