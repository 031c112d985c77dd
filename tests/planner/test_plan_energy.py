"""Fuel of plans: by the load of the simulated drive, the same in money and samples; the plan of least fuel."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely

from fields import Field
from planner.errors import RequestError
from planner.evaluation.candidates.evaluate import Candidate, CandidateRun, run_candidate
from planner.evaluation.candidates.figures import appraise_drive, measure_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.machines import FarmTractor
from planner.farm.random_inputs import build_certain_settings
from planner.farm.settings import FarmPrices
from planner.request.plan_request import LEAST_FUEL, PlanRequest
from planner.risk.assessment import choose_best
from planner.risk.costs import CostTerms, compute_paid_per_sample
from planner.risk.leg_graph import build_leg_graph, measure_leg_consumption
from planner.risk.monte_carlo import sample_outcomes
from reports.common.plan_results import PlanResult
from vehicle.energy.fuel import CO2_KG_PER_L
from vehicle.model.tractor import load_tractor

FIELD = Field("drawn", shapely.box(0, 0, 36, 80))
NOTHING = FarmPrices(tractor_price=0.0, implement_price=0.0, supervision_share=0.0, fuel_per_l=2.0, oil_share=0.1)


@cache
def drive(tractors: int = 1) -> tuple[PlanningContext, CandidateRun]:
    """A small field driven by row."""
    context = prepare_context(WorkOrder(PlanRequest(field="drawn", no_headland=True), FIELD))
    return context, run_candidate(context, Candidate("row-by-row", tractors))


def measure(**changes: Any) -> Any:
    """The figures of the drive with other members of its context."""
    context, run = drive()
    changed = replace(context, **changes)
    return appraise_drive(changed, measure_candidate(changed, "row-by-row", 1, run), run.run)


def test_litres_are_those_of_power_over_time() -> None:
    """By hand from D497: the engine gives rolling, draft and starts at 86 %, and takes 0.22 X + 0.096 l per kWh."""
    context, driven = drive()
    plan = measure()
    work_m = 12 * 80.0 - 24 * context.layout.headland_m
    draft_n = 0.85 * (46.0 + 2.8 * 5.0) * 10.0 * 3.0 / 0.15
    rolling_n = 0.06 * context.tractor.mass_kg * 9.80665
    path_m = float(np.hypot(*np.diff(driven.run.get_poses(0)[:, :2], axis=0).T).sum())
    work_kwh = (draft_n * work_m + rolling_n * path_m) / 0.86 / 3.6e6
    hours = driven.run.duration_s / 3600.0
    expected_l = 0.22 * 0.9 * work_kwh + 0.096 * 0.9 * 77.0 * hours
    assert plan.fuel_l == pytest.approx(expected_l, rel=0.05), "starts, and what bends add"
    assert plan.fuel_l_by_tractor == (pytest.approx(plan.fuel_l),)
    assert plan.fuel_l_per_ha == pytest.approx(plan.fuel_l / FIELD.area_ha)
    assert plan.co2_kg == pytest.approx(CO2_KG_PER_L * plan.fuel_l) and plan.energy_kwh is None


def test_the_cost_of_a_farm_has_these_litres() -> None:
    with_fuel = measure(cost_terms=CostTerms(NOTHING))
    free = measure(cost_terms=CostTerms(NOTHING.model_copy(update={"fuel_per_l": 0.0})))
    assert with_fuel.cost - free.cost == pytest.approx(2.0 * 1.1 * with_fuel.fuel_l)


def test_without_variation_samples_cost_what_the_simulation_does() -> None:
    context, driven = drive()
    run, physics = driven.run, context.physics
    fuel = measure_leg_consumption(run, context.tractor, physics.fuel_load, physics.terrain)
    outcomes = sample_outcomes(build_leg_graph(run, fuel), build_certain_settings(), samples=3, seed=1)
    assert outcomes.energy == pytest.approx([measure().fuel_l] * 3, rel=0.01)
    paid = compute_paid_per_sample(outcomes, CostTerms(NOTHING))
    assert paid == pytest.approx([measure(cost_terms=CostTerms(NOTHING)).cost] * 3, rel=0.01)


def test_slower_samples_take_more_fuel_in_proportion() -> None:
    context, driven = drive()
    fuel = measure_leg_consumption(driven.run, context.tractor, context.physics.fuel_load, None)
    graph = build_leg_graph(driven.run, fuel)
    outcomes = sample_outcomes(graph, build_certain_settings().model_copy(update={"job_cv": 0.3}), samples=50, seed=1)
    driven_s = outcomes.work_s + outcomes.turn_s
    assert np.std(driven_s) > 0.1 * np.mean(driven_s)
    per_second = outcomes.energy / driven_s
    assert per_second == pytest.approx(np.full(50, per_second[0]), rel=0.02)


def test_what_is_not_known_is_not_said() -> None:
    context, _ = drive()
    unknown = replace(context.physics, takes_shaft_power=True)
    plan = measure(physics=unknown)
    assert (plan.fuel_l, plan.co2_kg, plan.fuel_l_by_tractor) == (None, None, None)
    flat = measure(physics=unknown, cost_terms=CostTerms(FarmPrices(), FarmTractor(name="t", power_kw=100.0)))
    assert flat.fuel_l > 0.0 and flat.fuel_l_by_tractor is None


@pytest.mark.parametrize(
    ("values", "tractor", "cause"),
    [
        ({"operation": "mow"}, "eg105", "mow takes power from the shaft"),
        ({}, load_tractor("eg105").model_copy(update={"engine": None}), "the tractor file says no engine"),
    ],
)
def test_the_objective_fuel_needs_known_fuel(values: dict[str, Any], tractor: Any, cause: str) -> None:
    with pytest.raises(RequestError, match=cause) as refusal:
        prepare_context(WorkOrder(PlanRequest(field="drawn", objective=LEAST_FUEL, **values), FIELD, tractor))
    assert refusal.value.parameter == "objective"


def test_least_fuel_is_chosen() -> None:
    def build(tractors: int, energy: float | None, hours: float) -> PlanResult:
        return PlanResult("row-by-row", tractors, "u", True, time_s=3600.0 * hours, fuel_l=energy)

    plans = [build(1, 40.0, 4.0), build(2, 36.0, 2.1), build(3, 36.3, 1.5), build(4, None, 1.0)]
    assert choose_best(plans, LEAST_FUEL).tractors == 2, "1 % more counts as equal, and fewer tractors win"
