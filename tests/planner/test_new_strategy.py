"""A strategy that nobody knew before: a record in the registry is all that planning needs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.pipeline.ranking import list_candidates, rank_plans
from planner.request.plan_request import PlanRequest
from strategies.path_planning.errors import StrategyError
from strategies.registry import STRATEGIES
from strategies.rules.dealing import DealtLine, LineDeal
from strategies.rules.driving_rules import DrivingRules
from strategies.rules.supply import HEADLAND, Supply
from strategies.strategy_record import Strategy
from tests.planner.conftest import site_on

pytestmark = pytest.mark.usefixtures("first_layout")


def deal_to_one(lines: Sequence[DealtLine], rules: DrivingRules, tractors: int) -> LineDeal:
    """One tractor may work all lines; the others are not needed."""
    if tractors > 1:
        raise StrategyError("Alone is for one tractor.")
    return LineDeal(np.ones((1, len(lines)), bool))


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Strategy:
    toy = Strategy("alone", "one tractor works all", deal_to_one)
    monkeypatch.setitem(STRATEGIES, toy.name, toy)
    return toy


def test_a_registered_strategy_is_planned_with(small_site: PlanningContext, toy: Strategy) -> None:
    request = replace(small_site.request, strategies=(toy.name, "split-field"), tractors=(1, 2))
    todo = list_candidates(request)
    assert Candidate(toy.name, 1) in todo and Candidate(toy.name, 2) in todo
    plans = rank_plans(small_site, [simulate_candidate(small_site, candidate).result for candidate in todo]).plans
    alone, refused = (next(p for p in plans if (p.strategy, p.tractors) == (toy.name, count)) for count in (1, 2))
    assert alone.feasible and alone.rank is not None and alone.collisions == 0
    assert (refused.feasible, refused.reason) == (False, "Alone is for one tractor.")
    length = sum(swath.length_m for swath in small_site.layout.swaths)
    assert alone.time_s > length / small_site.driving_rules.work_speed_mps


def test_one_that_differs_alone_is_tried_beside_that_of_all_others(monkeypatch: pytest.MonkeyPatch) -> None:
    request = PlanRequest(strategies=("split-field", "interleaved", "col-by-col"), tractors=(1,))
    differing = replace(STRATEGIES["interleaved"], differs_alone=True)
    monkeypatch.setitem(STRATEGIES, differing.name, differing)
    assert list_candidates(request) == [Candidate("col-by-col", 1), Candidate("interleaved", 1)]


def test_an_unregistered_name_stays_unknown() -> None:
    with pytest.raises(Exception, match="'alone' is unknown"):
        PlanRequest(field="iwamizawa", strategies=("alone",))


@pytest.mark.slow
def test_it_works_the_headland_too_and_is_served(toy: Strategy) -> None:
    whole = site_on(shapely.box(0, 0, 60, 90), (0.0, 0.0), no_headland=False)
    result = simulate_candidate(whole, Candidate(toy.name, 1)).result
    assert result.feasible and result.headland_s is not None, result.reason
    supply = Supply(60.0, 0.02, 60.0, served_at=HEADLAND)
    served = simulate_candidate(replace(whole, supply=supply), Candidate(toy.name, 1)).result
    assert served.feasible and served.refills == 1, served.reason
