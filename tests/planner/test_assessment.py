"""Draws and money in the result of a plan, and in the ranking: what is asked, what comes out, the same every time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from fields import Field
from planner.errors import RequestError
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.random_inputs import build_certain_settings
from planner.farm.settings import FarmPrices
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest
from planner.risk.assessment import PhysicsCheck, build_decision_criteria, describe_check, mark_chosen_plan
from planner.risk.costs import CostTerms, build_hire_terms
from planner.risk.monte_carlo import DEFAULT_SAMPLES
from reports.common.plan_results import PlanRanking, PlanResult

EIGHT = 8 * 3600
FIELD = Field("drawn", shapely.box(0, 0, 36, 80), entrance=(0.0, 0.0))


def scenario(**values: Any) -> PlanRequest:
    return PlanRequest(**{"field": "drawn", "no_headland": True, "start_s": EIGHT, "samples": 500, **values})


class TestWhatIsAsked:
    @pytest.mark.parametrize(
        ("values", "samples"),
        [
            ({"samples": None}, None),
            ({"samples": 0, "deadline_s": EIGHT + 60}, None),
            ({"samples": 77}, 77),
            ({"samples": None, "deadline_s": EIGHT + 60}, DEFAULT_SAMPLES),
            ({"samples": None, "rain": "9:00"}, DEFAULT_SAMPLES),
            ({"samples": None, "objective": "surest"}, DEFAULT_SAMPLES),
        ],
    )
    def test_samples_are_drawn_where_there_is_something_to_decide(
        self, values: dict[str, Any], samples: int | None
    ) -> None:
        stakes = build_decision_criteria(scenario(**values))
        assert (stakes and stakes.samples) == samples

    @pytest.mark.parametrize(
        ("values", "words"),
        [
            ({}, ""),
            ({"deadline_s": EIGHT + 9 * 3600}, "before 17:00"),
            ({"rain": "17:00"}, "before 17:00"),
            ({"rain": "16:00=50,17:00=50"}, "before the rain"),
            ({"rain": "0.1/h", "deadline_s": EIGHT + 9 * 3600}, "before 17:00 and before the rain"),
            ({"rain": "7:00"}, "before 07:00 next day"),
        ],
    )
    def test_the_limit_in_words(self, values: dict[str, Any], words: str) -> None:
        stakes = build_decision_criteria(scenario(**values))
        assert stakes.limit_text == words

    @pytest.mark.parametrize(
        ("values", "words"),
        [
            ({"samples": -1}, "samples is -1; use 0 to"),
            ({"samples": 2_000_000}, "samples is 2000000"),
            ({"objective": "cheap"}, "did you mean 'cheapest'"),
        ],
    )
    def test_what_cannot_be_is_refused(self, values: dict[str, Any], words: str) -> None:
        with pytest.raises(RequestError, match=words):
            scenario(**values)

    def test_rain_is_read_before_anything_is_simulated(self) -> None:
        with pytest.raises(RequestError, match="is none of: a time") as refusal:
            prepare_context(WorkOrder(scenario(rain="soon"), FIELD))
        assert refusal.value.parameter == "rain"


class TestFigures:
    def test_a_certain_plan_has_the_time_and_the_price_it_was_simulated_with(self) -> None:
        site = prepare_context(
            WorkOrder(scenario(deadline_s=EIGHT + 3600), FIELD, uncertainty=build_certain_settings())
        )
        found = simulate_candidate(site, Candidate("interleaved", 2)).result
        assert found.finish_probability == 1.0
        for value in (found.p50_s, found.p80_s, found.p95_s):
            assert value == pytest.approx(found.time_s, rel=0.01)
        assert found.expected_cost == found.paid_cost == pytest.approx(found.cost, rel=0.01)
        assert found.expected_cost_error == pytest.approx(0.0, abs=1e-9)

    def test_late_ground_is_charged(self) -> None:
        terms = CostTerms(build_hire_terms(40.0, 0.0).prices.model_copy(update={"late_per_ha": 1000.0}))
        site = prepare_context(
            WorkOrder(scenario(rain="8:02"), FIELD, uncertainty=build_certain_settings(), cost_terms=terms)
        )
        found = simulate_candidate(site, Candidate("interleaved", 1)).result
        assert found.finish_probability == 0.0
        # 2 of some 14 minutes: about seven eighths of 0.288 ha are late
        assert found.expected_cost - found.paid_cost == pytest.approx(0.86 * 288.0, rel=0.08)

    def test_without_stakes_nothing_is_added(self) -> None:
        found = simulate_candidate(
            prepare_context(WorkOrder(scenario(samples=0), FIELD)), Candidate("interleaved", 1)
        ).result
        assert found.finish_probability is None and found.expected_cost is None


def result(tractors: int, minutes: float, probability: float, paid: float, late: float) -> PlanResult:
    return PlanResult(
        "split-field", tractors, "u", True, time_s=60.0 * minutes, cost=paid, meets_deadline=minutes <= 60.0,
        finish_probability=probability, p50_s=60.0 * minutes, p95_s=70.0 * minutes, expected_cost=paid + late,
        expected_cost_error=0.1, paid_cost=paid,
    )  # fmt: skip


class TestRanking:
    stakes = build_decision_criteria(scenario(deadline_s=EIGHT + 3600))
    plans = (result(2, 40.0, 0.97, 120.10, 8.8), result(1, 59.0, 0.61, 96.40, 31.0), result(3, 30.0, 0.99, 138.30, 0))

    def test_the_advised_plan_is_the_best(self) -> None:
        told = mark_chosen_plan(PlanRanking("f", 1.0, 1, self.plans, allowed_s=3600.0), self.stakes)
        assert told.best is self.plans[0]
        assert (told.currency, told.samples, told.missed_by_s) == ("EUR", 500, None)
        assert told.money_sentences == (
            "Cost in EUR, mean of 500 samples: 40.00 for each tractor and hour from its actual start.",
            "The cost includes 80 for each hectare that is not done before 09:00.",
        )

    def test_a_plan_that_is_late_as_simulated_is_not_taken_while_another_is_in_time(self) -> None:
        cheap = replace(self.plans[1], time_s=3700.0, meets_deadline=False, expected_cost=1.0)
        told = mark_chosen_plan(PlanRanking("f", 1.0, 1, (self.plans[0], cheap), allowed_s=3600.0), self.stakes)
        assert told.best is self.plans[0]

    def test_where_none_is_in_time_the_closest_remains(self) -> None:
        late = tuple(
            replace(
                each, meets_deadline=False, time_s=(each.time_s or 0.0) + 4000.0, p50_s=(each.p50_s or 0.0) + 4000.0
            )
            for each in self.plans
        )
        told = mark_chosen_plan(PlanRanking("f", 1.0, 1, late, allowed_s=3600.0), self.stakes)
        assert told.best is late[2] and told.missed_by_s == pytest.approx(2200.0)

    def test_without_a_limit_or_preference_the_knee_is_the_best(self) -> None:
        """Of 59 minutes with one tractor a second saves 19 of 29.5, a third 10: less than it takes to bring it."""
        plans = tuple(replace(each, meets_deadline=None) for each in self.plans)
        ranking = PlanRanking("f", 1.0, 1, plans, prices_assumed=True)
        told = mark_chosen_plan(ranking, build_decision_criteria(scenario()))
        assert told.best is told.plans[0]
        priced = mark_chosen_plan(replace(ranking, prices_assumed=False), build_decision_criteria(scenario()))
        assert priced.best is priced.plans[1]

    def test_ground_that_is_left_counts_where_the_objective_chooses(self) -> None:
        """Half an hour and 60 to finish the rest make the quicker and cheaper plan the worse one."""
        whole = replace(self.plans[0], worked_pct=99.8)
        leaving = replace(result(2, 35.0, 0.97, 110.0, 8.8), strategy="interleaved", worked_pct=60.0,
                          finished_s=3900.0, finished_cost=170.0, works_enough=True)  # fmt: skip
        whole, leaving = replace(whole, fuel_l=30.0), replace(leaving, fuel_l=20.0)  # 20 l * 3,900 s / 2,100 s = 37 l
        for objective in ("fastest", "cheapest", "fuel"):
            ranking = PlanRanking("f", 1.0, 1, (leaving, whole))
            told = mark_chosen_plan(ranking, build_decision_criteria(scenario(objective=objective)))
            assert told.best is whole, objective
        assert mark_chosen_plan(ranking, None) is ranking


class TestWhatNoPlanMeets:
    plans = tuple(replace(each, meets_deadline=None) for each in TestRanking.plans)  # of 40, 59 and 30 minutes

    def told(self, plans: tuple[PlanResult, ...] | None = None, **values: Any) -> PlanRanking:
        return mark_chosen_plan(
            PlanRanking("f", 1.0, 1, plans or self.plans), build_decision_criteria(scenario(**values))
        )

    def test_rain_at_a_time_leaves_out_what_is_late_as_simulated(self) -> None:
        dry = self.told(rain="8:35")
        assert dry.best is self.plans[2] and dry.shortfalls == ()
        wet = self.told(rain="8:20")
        assert wet.shortfalls[0].sentence == "No plan finishes before the rain; the closest is 0:10:00 late."
        assert wet.best is self.plans[2], "the quickest is the closest"

    def test_rain_at_a_time_is_of_the_clock_at_which_field_work_is_done(self) -> None:
        plans = tuple(replace(each, done_s=each.time_s + 900.0) for each in self.plans if each.time_s is not None)
        assert self.told(plans, rain="8:35").shortfalls[0].sentence == (
            "No plan finishes before the rain; the closest is 0:10:00 late."
        )
        assert self.told(plans, rain="8:50").best is plans[2]

    def test_rain_that_may_come_is_not_met_where_hardly_any_draw_is(self) -> None:
        few = tuple(replace(each, finish_probability=0.004) for each in self.plans)
        told = self.told(few, rain="8:20=50,8:40=50")
        assert (
            told.shortfalls[0].sentence == "No plan finishes before the rain: the surest does in <1 % of the samples."
        )
        assert told.best is few[2]
        assert self.told(rain="8:20=50,8:40=50").shortfalls == ()

    def test_a_budget_leaves_out_what_is_dearer(self) -> None:
        assert self.told(deadline_s=EIGHT + 3600).best is self.plans[0]
        assert self.told(deadline_s=EIGHT + 3600, budget=100.0).best is self.plans[1]
        short = self.told(budget=90.0)
        assert short.best is self.plans[1]
        assert (
            short.shortfalls[0].sentence == "No plan is within the budget of 90.00 EUR; the cheapest costs 96.40 EUR."
        )
        dry = self.told(rain="8:50", budget=100.0)
        assert dry.shortfalls[0].sentence == (
            "No plan that finishes in time is within the budget of 100.00 EUR; the cheapest costs 120.10 EUR."
        )
        assert dry.best is self.plans[0]
        neither = self.told(rain="8:50", budget=90.0)
        assert neither.shortfalls[0].sentence == (
            "No plan is within the budget of 90.00 EUR; the cheapest that finishes in time costs 120.10 EUR."
        )

    def test_a_negative_budget_is_refused(self) -> None:
        with pytest.raises(RequestError, match="budget is -1; use 0 to 1,000,000,000"):
            scenario(budget=-1.0)
        with pytest.raises(RequestError, match="samples is 0, and budget is judged by samples"):
            scenario(samples=0, budget=10.0)


@pytest.mark.slow
def test_a_whole_plan_is_the_same_every_time_and_says_how_far_it_can_be_trusted() -> None:
    asked = scenario(deadline_s=EIGHT + 1200, tractors=(1, 2), strategies=("interleaved",), samples=300)
    one, other = (plan(asked, field=FIELD, executor=SerialExecutor()) for _ in range(2))
    assert one.ranking == other.ranking
    best = one.ranking.best
    assert one.run.plan.tractors == best.tractors
    assert list(one.pictures) == [(best.strategy, best.tractors)]
    assert one.ranking.check_sentences[0].startswith("4 of 4 samples simulated in full physics finish 0.")


def test_the_check_says_what_could_not_be_compared() -> None:
    found = PhysicsCheck(np.array([np.nan, 100.0, np.nan]), np.array([90.0, 101.0, 90.0]), 1, 1)
    assert describe_check(found, {"stops": 0.62, "turns": 0.004}) == (
        "1 of 3 samples simulated in full physics finish 1.0 % off their sampled times on average; in 1 tractors "
        "touch; in 1 a tractor does not finish.",
        "Main causes of uncertain time, by share of its variance: stops (62 %).",
    )


def test_own_machines_cost_what_the_farm_says() -> None:
    site = prepare_context(
        WorkOrder(
            scenario(), FIELD, uncertainty=build_certain_settings(), cost_terms=CostTerms(FarmPrices(late_per_ha=0.0))
        )
    )
    own = simulate_candidate(site, Candidate("interleaved", 1)).result
    hours = (own.time_s or 0.0) / 3600.0
    assert 8.0 < own.fuel_l / hours < 15.0, "litres of 77 kW at a quarter of its power"
    # In an hour some 22 for the tractor, 14 for the implement and 6 for a quarter of a person; then litres with oil.
    assert own.paid_cost == pytest.approx(42.0 * hours + own.fuel_l * 1.2 * 1.15, rel=0.05)
    assert own.cost == pytest.approx(own.paid_cost, rel=0.01), "as simulated it is accounted for in the same way"
