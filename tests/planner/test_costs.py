"""Costs by hand from the equations of farm accounting, and the money of a plan in every draw."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.settings import FarmPrices
from planner.risk.costs import (
    CostTerms,
    build_hire_terms,
    compute_driven_cost,
    compute_hourly_rates,
    compute_paid_per_sample,
    compute_remaining_value,
    compute_repair_cost,
    estimate_flat_use,
    list_cost_figures,
    measure_driven_times,
)
from planner.risk.monte_carlo import SampledOutcomes

NOTHING = FarmPrices(
    tractor_price=0.0, implement_price=0.0, fuel_per_l=0.0, supervision_share=0.0, late_per_ha=0.0, seed_per_ha=0.0
)


def sample(tractor_h: Any, work_h: Any = 0.0, turn_h: Any = 0.0, done: Any = 1.0, late_h: Any = 0.0) -> SampledOutcomes:
    """Draws of a fleet from hours, (tractors, draws)."""
    seconds = 3600.0 * np.array(tractor_h, float)
    draws = seconds.shape[1]
    given = (work_h, turn_h, done, late_h)
    whole, turns, share, late = (np.broadcast_to(np.array(each, float), (draws,)) for each in given)
    return SampledOutcomes(seconds.max(axis=0), seconds, 3600.0 * whole, 3600.0 * turns, share, 3600.0 * late)


def but(prices: FarmPrices, **changes: float) -> FarmPrices:
    """The same prices with a few changed."""
    return prices.model_copy(update=changes)


class TestMachine:
    def test_value_left_and_repair_are_those_of_the_equations(self) -> None:
        # 100,000 x 0.68 x 0.92^10 = 29,538; 100,000 x 0.007 x (6000 / 1000)^2 = 25,200
        assert compute_remaining_value(100_000, 0.68, 0.92, 10) == pytest.approx(29_538, abs=1)
        assert compute_repair_cost(100_000, 0.007, 2.0, 6000) == pytest.approx(25_200)

    def test_hourly_rates_of_a_tractor_alone(self) -> None:
        found = compute_hourly_rates(FarmPrices(implement_price=0.0))
        assert found.depreciation == pytest.approx((100_000 - 29_538) / 6000, abs=0.01)
        assert found.interest == pytest.approx(0.04 * (100_000 + 29_538) / 2 / 600, abs=0.01)
        assert found.insurance == pytest.approx(0.015 * (100_000 + 29_538) / 2 / 600, abs=0.01)
        assert found.repair == pytest.approx(25_200 / 6000)

    def test_the_implement_comes_on_top_with_its_own_hours(self) -> None:
        both, tractor = compute_hourly_rates(FarmPrices()), compute_hourly_rates(FarmPrices(implement_price=0.0))
        left = 15_000 * 0.60 * 0.885**10
        assert both.depreciation - tractor.depreciation == pytest.approx((15_000 - left) / 2000)
        assert both.repair - tractor.repair == pytest.approx(15_000 * 0.27 * 2.0**1.4 / 2000)

    def test_fuel_by_what_is_done_with_oil(self) -> None:
        found = compute_hourly_rates(FarmPrices())
        full = 0.3 * 77.0 * 1.2 * 1.15
        assert found.fuel_at_work == pytest.approx(0.74 * full)
        assert found.fuel_in_turns == pytest.approx(0.35 * full)

    @pytest.mark.parametrize("name", ["tractor_price", "fuel_per_l", "interest_pct", "repair_factor", "work_load"])
    def test_what_is_dearer_costs_more(self, name: str) -> None:
        one = sample([[2.0]], 1.5, 0.5)
        dear = but(FarmPrices(), **{name: 1.3 * getattr(FarmPrices(), name)})
        assert (
            compute_paid_per_sample(one, CostTerms(dear))[0] > compute_paid_per_sample(one, CostTerms(FarmPrices()))[0]
        )

    def test_what_machines_say_of_themselves_comes_first(self) -> None:
        tractor = FarmTractor(name="a", price=50_000.0, years=5.0, hours_per_year=300.0, power_kw=40.0)
        implement = FarmImplement(name="b", price=0.0)
        found = compute_hourly_rates(FarmPrices(), tractor, implement)
        assert found.depreciation == pytest.approx((50_000 - 50_000 * 0.68 * 0.92**5) / 1500)
        assert found.fuel_at_work == pytest.approx(0.74 * 0.3 * 40.0 * 1.2 * 1.15)


class TestPlan:
    def test_hired_tractors_cost_their_hours_until_the_last_is_done(self) -> None:
        paid = compute_paid_per_sample(sample([[2.0, 3.0], [1.0, 4.0]]), build_hire_terms(40.0, 10.0))
        assert paid.tolist() == pytest.approx([2 * 2.0 * 40 + 20, 2 * 4.0 * 40 + 20])

    def test_nobody_is_paid_before_the_work_begins(self) -> None:
        early, late = sample([[2.0]], 1.0, 0.5), sample([[3.0]], 1.0, 0.5, late_h=1.0)
        for terms in (CostTerms(FarmPrices()), build_hire_terms(40.0, 10.0)):
            assert compute_paid_per_sample(late, terms) == pytest.approx(compute_paid_per_sample(early, terms))

    def test_work_turns_and_waiting_take_fuel_of_their_own(self) -> None:
        prices = but(NOTHING, fuel_per_l=1.0, oil_share=0.0)
        full = 0.3 * 77.0
        paid = compute_paid_per_sample(sample([[4.0]], work_h=2.0, turn_h=1.0), CostTerms(prices))
        assert paid[0] == pytest.approx(full * (2.0 * 0.74 + 1.0 * 0.35 + 1.0 * 0.1))

    def test_people_look_after_the_whole_fleet_and_each_is_brought(self) -> None:
        prices = but(
            NOTHING, supervision_share=0.25, supervision_per_hour=20.0, transport_per_tractor=7.0, transport_per_km=0.5
        )
        paid = compute_paid_per_sample(sample([[2.0], [1.0]]), CostTerms(prices, road_km=4.0))
        assert paid[0] == pytest.approx(2 * 2.0 * 0.25 * 20.0 + 2 * (7.0 + 0.5 * 4.0))

    def test_late_ground_is_what_is_not_done_times_its_value(self) -> None:
        prices = but(NOTHING, late_per_ha=80.0, seed_per_ha=20.0)
        found = list_cost_figures(
            sample([[1.0, 1.0, 1.0, 1.0]], done=[1.0, 1.0, 0.5, 0.9]), CostTerms(prices), area_ha=10.0
        )
        assert (found["paid_cost"], found["expected_cost"]) == (0.0, pytest.approx(0.15 * 10.0 * 100.0))
        assert found["expected_cost_error"] == pytest.approx(np.std([0, 0, 500, 100], ddof=1) / 2)

    def test_no_draw_varies_no_error(self) -> None:
        found = list_cost_figures(sample([[2.0, 2.0]]), build_hire_terms(40.0, 0.0), area_ha=1.0)
        assert (found["paid_cost"], found["expected_cost_error"]) == (80.0, 0.0)


class TestFuel:
    """Two tractors: an hour of work, half an hour of turns, a quarter of an hour of waiting."""

    def run(self) -> Any:
        seconds = {"working": [2000.0, 1600.0], "turning": [900.0, 600.0], "reversing": [200.0, 100.0]}
        arrays = {name: np.array(values) for name, values in seconds.items()}
        plan = SimpleNamespace(resting=())
        return SimpleNamespace(sum_seconds_by_status=lambda: arrays, finish_s=np.array([3500.0, 2800.0]), plan=plan)

    def test_litres_are_power_by_load(self) -> None:
        prices = but(FarmPrices(), work_load=0.6, turn_load=0.3, fuel_l_per_kwh=0.25)
        litres = estimate_flat_use(
            measure_driven_times(self.run()), CostTerms(prices, FarmTractor(name="t", power_kw=100.0))
        )
        assert litres == pytest.approx((1.0 * 0.6 + 0.5 * 0.3 + 0.25 * 0.1) * 100.0 * 0.25)

    def test_cost_of_fuel_is_that_of_the_litres(self) -> None:
        terms = CostTerms(but(NOTHING, fuel_per_l=2.0, oil_share=0.0))
        times = measure_driven_times(self.run())
        assert compute_driven_cost(times, terms) == pytest.approx(2.0 * estimate_flat_use(times, terms))
