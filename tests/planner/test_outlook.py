"""Draws and money in the result of a plan, and in the ranking: what is asked, what comes out, the same every time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from fields import Field
from planner.candidates.evaluate import Candidate, simulated
from planner.chance.answer import DRAWS
from planner.chance.physics import Check
from planner.chance.settings import certain
from planner.errors import ScenarioError
from planner.farm.prices import Prices
from planner.outlook import advised, check_words, stakes_of
from planner.planning import plan
from planner.pool import SerialExecutor
from planner.price.cost import Terms, hired
from planner.scenario import Scenario
from planner.site import prepare
from reports.results import PlanResult, Ranking

EIGHT = 8 * 3600
FIELD = Field("drawn", shapely.box(0, 0, 36, 80), entrance=(0.0, 0.0))


def scenario(**values: Any) -> Scenario:
    return Scenario(**{"field": "drawn", "tracks_only": True, "start_s": EIGHT, "draws": 500, **values})


class TestWhatIsAsked:
    @pytest.mark.parametrize(
        ("values", "draws"),
        [
            ({"draws": None}, None),
            ({"draws": 0, "before_s": EIGHT + 60}, None),
            ({"draws": 77}, 77),
            ({"draws": None, "before_s": EIGHT + 60}, DRAWS),
            ({"draws": None, "rain": "9:00"}, DRAWS),
            ({"draws": None, "prefer": "surest"}, DRAWS),
        ],
    )
    def test_draws_are_made_where_there_is_something_to_decide(self, values: dict[str, Any], draws: int | None) -> None:
        stakes = stakes_of(scenario(**values))
        assert (stakes and stakes.question.draws) == draws

    @pytest.mark.parametrize(
        ("values", "words"),
        [
            ({}, ""),
            ({"before_s": EIGHT + 9 * 3600}, "before 17:00"),
            ({"rain": "17:00"}, "before 17:00"),
            ({"rain": "16:00=50,17:00=50"}, "before the rain"),
            ({"rain": "0.1/h", "before_s": EIGHT + 9 * 3600}, "before 17:00 and before the rain"),
            ({"rain": "7:00"}, "before 07:00 next day"),
        ],
    )
    def test_the_limit_in_words(self, values: dict[str, Any], words: str) -> None:
        stakes = stakes_of(scenario(**values))
        assert stakes is not None and stakes.limit == words

    @pytest.mark.parametrize(
        ("values", "words"),
        [
            ({"draws": -1}, "draws is -1; use 0 to"),
            ({"draws": 2_000_000}, "draws is 2000000"),
            ({"prefer": "cheap"}, "did you mean 'cheapest'"),
        ],
    )
    def test_what_cannot_be_is_refused(self, values: dict[str, Any], words: str) -> None:
        with pytest.raises(ScenarioError, match=words):
            scenario(**values)

    def test_rain_is_read_before_anything_is_simulated(self) -> None:
        with pytest.raises(ScenarioError, match="is none of: a time") as refusal:
            prepare(scenario(rain="soon"), FIELD)
        assert refusal.value.parameter == "rain"


class TestFigures:
    def test_a_certain_plan_has_the_time_and_the_price_it_was_simulated_with(self) -> None:
        site = prepare(scenario(before_s=EIGHT + 3600), FIELD, chances=certain())
        found = simulated(site, Candidate("interleaved", 2)).result
        assert found.finish_probability == 1.0
        for value in (found.p50_s, found.p80_s, found.p95_s):
            assert value == pytest.approx(found.time_s, rel=0.01)
        assert found.expected_cost == found.paid_cost == pytest.approx(found.cost, rel=0.01)
        assert found.expected_cost_error == 0.0

    def test_late_ground_is_charged(self) -> None:
        terms = Terms(hired(40.0, 0.0).prices.model_copy(update={"late_per_ha": 1000.0}))
        site = prepare(scenario(rain="8:02"), FIELD, chances=certain(), terms=terms)
        found = simulated(site, Candidate("interleaved", 1)).result
        assert found.finish_probability == 0.0 and found.expected_cost is not None
        # 2 of some 14 minutes: about seven eighths of 0.288 ha are late
        assert found.expected_cost - found.paid_cost == pytest.approx(0.86 * 288.0, rel=0.08)

    def test_without_stakes_nothing_is_added(self) -> None:
        found = simulated(prepare(scenario(draws=0), FIELD), Candidate("interleaved", 1)).result
        assert found.finish_probability is None and found.expected_cost is None


def result(tractors: int, minutes: float, probability: float, paid: float, late: float) -> PlanResult:
    return PlanResult(
        "split-field", tractors, "u", True, time_s=60.0 * minutes, cost=paid, meets_deadline=minutes <= 60.0,
        finish_probability=probability, p50_s=60.0 * minutes, p95_s=70.0 * minutes, expected_cost=paid + late,
        expected_cost_error=0.1, paid_cost=paid,
    )  # fmt: skip


class TestRanking:
    stakes = stakes_of(scenario(before_s=EIGHT + 3600))
    plans = (result(2, 40.0, 0.97, 120.10, 8.8), result(1, 59.0, 0.61, 96.40, 31.0), result(3, 30.0, 0.99, 138.30, 0))

    def test_the_advised_plan_is_the_best(self) -> None:
        told = advised(Ranking("f", 1.0, 1, self.plans, allowed_s=3600.0), self.stakes)
        assert told.best is self.plans[0]
        assert told.advice == (
            "2 tractors: 97 % before 09:00, 128.90 expected (120.10 paid). One saves 1.50, as good as equal, but "
            "finishes in time only 61 % of the time; a third adds 9.40 and 2 %."
        )
        assert (told.currency, told.draws, told.missed_by_s) == ("EUR", 500, None)
        assert told.money == (
            "Money is in EUR, in the mean of 500 draws: paid is 40.00 for each tractor and hour; expected adds 80.00 "
            "for each hectare not done before 09:00.",
        )

    def test_a_plan_that_is_late_as_simulated_is_not_taken_while_another_is_in_time(self) -> None:
        cheap = replace(self.plans[1], time_s=3700.0, meets_deadline=False, expected_cost=1.0)
        told = advised(Ranking("f", 1.0, 1, (self.plans[0], cheap), allowed_s=3600.0), self.stakes)
        assert told.best is self.plans[0]

    def test_where_none_is_in_time_the_closest_remains(self) -> None:
        late = tuple(replace(each, meets_deadline=False, time_s=(each.time_s or 0.0) + 4000.0) for each in self.plans)
        told = advised(Ranking("f", 1.0, 1, late, allowed_s=3600.0), self.stakes)
        assert told.best is late[2] and told.missed_by_s == pytest.approx(2200.0)
        assert told.advice is not None and told.advice.startswith("3 tractors")

    def test_without_a_limit_or_preference_the_quickest_stays_the_best(self) -> None:
        ranking = Ranking("f", 1.0, 1, tuple(replace(each, meets_deadline=None) for each in self.plans))
        told = advised(ranking, stakes_of(scenario()))
        assert told.best is told.plans[2] and told.advice is not None and told.advice.startswith("3 tractors")
        assert advised(ranking, None) is ranking


class TestWhatNoPlanMeets:
    plans = tuple(replace(each, meets_deadline=None) for each in TestRanking.plans)  # of 40, 59 and 30 minutes

    def told(self, plans: tuple[PlanResult, ...] | None = None, **values: Any) -> Ranking:
        return advised(Ranking("f", 1.0, 1, plans or self.plans), stakes_of(scenario(**values)))

    def test_rain_at_a_time_leaves_out_what_is_late_as_simulated(self) -> None:
        dry = self.told(rain="8:35")
        assert dry.best is self.plans[2] and dry.unmet is None
        wet = self.told(rain="8:20")
        assert wet.unmet == "No plan is done before the rain; the closest misses it by 0:10:00."
        assert wet.best is self.plans[2], "the quickest is the closest"

    def test_rain_at_a_time_is_of_the_clock_at_which_field_work_is_done(self) -> None:
        plans = tuple(replace(each, done_s=each.time_s + 900.0) for each in self.plans if each.time_s is not None)
        assert self.told(plans, rain="8:35").unmet == (
            "No plan is done before the rain; the closest misses it by 0:10:00."
        )
        assert self.told(plans, rain="8:50").best is plans[2]

    def test_rain_that_may_come_is_not_met_where_hardly_any_draw_is(self) -> None:
        few = tuple(replace(each, finish_probability=0.004) for each in self.plans)
        told = self.told(few, rain="8:20=50,8:40=50")
        assert told.unmet == "No plan is done before the rain: the surest one is in under 1 % of the draws."
        assert told.best is few[2]
        assert self.told(rain="8:20=50,8:40=50").unmet is None

    def test_a_budget_leaves_out_what_is_dearer(self) -> None:
        assert self.told(before_s=EIGHT + 3600).best is self.plans[0]
        assert self.told(before_s=EIGHT + 3600, budget=100.0).best is self.plans[1]
        short = self.told(budget=90.0)
        assert short.best is self.plans[1]
        assert short.unmet == "No plan can be paid with 90.00 EUR; the closest comes to 96.40 EUR."
        dry = self.told(rain="8:50", budget=100.0)
        assert dry.unmet == (
            "No plan that is done in time can be paid with 100.00 EUR; the closest comes to 120.10 EUR."
        )
        assert dry.best is self.plans[0] and dry.advice is not None and "One saves 23.70 but" in dry.advice
        neither = self.told(rain="8:50", budget=90.0)
        assert neither.unmet == (
            "No plan can be paid with 90.00 EUR; the closest that is done in time comes to 120.10 EUR."
        )

    def test_a_negative_budget_is_refused(self) -> None:
        with pytest.raises(ScenarioError, match="budget is -1; a price must be 0 or more"):
            scenario(budget=-1.0)
        with pytest.raises(ScenarioError, match="draws is 0, and budget is judged by draws"):
            scenario(draws=0, budget=10.0)


def test_a_whole_plan_is_the_same_every_time_and_says_how_far_it_can_be_trusted() -> None:
    asked = scenario(before_s=EIGHT + 1200, tractors=(1, 2), strategies=("interleaved",), draws=300)
    one, other = (plan(asked, field=FIELD, executor=SerialExecutor()) for _ in range(2))
    assert one.ranking == other.ranking
    best = one.ranking.best
    assert best is not None and one.run is not None and one.run.plan.tractors == best.tractors
    assert list(one.drives) == [(best.strategy, best.tractors)]
    assert one.ranking.advice and one.ranking.checked[0].startswith("8 of 8 draws driven in full physics end 0.")


def test_the_check_says_what_could_not_be_compared() -> None:
    found = Check(np.array([np.nan, 100.0, np.nan]), np.array([90.0, 101.0, 90.0]), 1, 1)
    assert check_words(found, {"stops": 0.62, "turns": 0.004}) == (
        "1 of 3 draws driven in full physics end 1.0 % from their drawn times on average; in 1 tractors meet; in 1 "
        "somebody does not get on.",
        "What makes the time uncertain, by its share of the variance: stops (62 %).",
    )


def test_own_machines_cost_what_the_farm_says() -> None:
    site = prepare(scenario(), FIELD, chances=certain(), terms=Terms(Prices(late_per_ha=0.0)))
    own = simulated(site, Candidate("interleaved", 1)).result
    assert own.paid_cost is not None and own.cost is not None
    # In an hour some 22 for the tractor, 14 for the implement, 20 for fuel and 6 for a quarter of a person.
    assert own.paid_cost / (own.time_s or 1.0) * 3600.0 == pytest.approx(62.0, abs=5.0)
    assert own.cost == pytest.approx(own.paid_cost, rel=0.01), "as simulated it is accounted for in the same way"
