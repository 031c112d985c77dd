"""A strategy that nobody knew before: a record in the registry is all that planning needs."""

from dataclasses import replace
from typing import Any

import pytest

from planner.evaluation.candidates.evaluate import Candidate, compute_candidate_figures, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.pipeline.ranking import list_candidates, rank_plans
from planner.request.plan_request import PlanRequest
from strategies.path_planning.errors import StrategyError
from strategies.program.field_job import FieldJob, SwathPass
from strategies.program.legs import build_mission
from strategies.program.strategy_record import RefinedPlan, Simulate, Strategy
from strategies.registry import STRATEGIES
from vehicle.missions.plan import Plan
from vehicle.missions.run import DONE


def there_and_back(job: FieldJob) -> Plan:
    """One tractor takes all tracks in order, to and fro; the others are not needed."""
    if job.tractors > 1:
        raise StrategyError("There and back is for one tractor.")
    order = [SwathPass(swath, 1 if index % 2 == 0 else -1) for index, swath in enumerate(job.layout.swaths)]
    return Plan((build_mission(job, order),), {"strategy": "there-and-back"})


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Strategy:
    toy = Strategy("there-and-back", "one tractor, to and fro", there_and_back)
    monkeypatch.setitem(STRATEGIES, toy.name, toy)
    return toy


def test_a_registered_strategy_is_planned_with(small_site: PlanningContext, toy: Strategy) -> None:
    request = replace(small_site.request, strategies=(toy.name, "split-field"), tractors=(1, 2))
    todo = list_candidates(request)
    assert Candidate(toy.name, 1) in todo and Candidate(toy.name, 2) in todo
    plans = rank_plans(small_site, [compute_candidate_figures(small_site, candidate) for candidate in todo]).plans
    alone, refused = (next(p for p in plans if (p.strategy, p.tractors) == (toy.name, count)) for count in (1, 2))
    assert alone.feasible and alone.rank is not None and alone.collisions == 0
    assert (refused.feasible, refused.reason) == (False, "There and back is for one tractor.")
    length = sum(swath.length_m for swath in small_site.layout.swaths)
    assert alone.time_s is not None and alone.time_s > length / small_site.driving_rules.work_speed_mps


def test_an_unregistered_name_stays_unknown() -> None:
    with pytest.raises(Exception, match="'there-and-back' is unknown"):
        PlanRequest(field="iwamizawa", strategies=("there-and-back",))


def test_a_refinement_is_handed_a_simulation_and_its_run_is_not_driven_again(
    small_site: PlanningContext, toy: Strategy, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = []

    def refine(job: FieldJob, simulate: Simulate, tractor: Any, implement: Any) -> RefinedPlan:
        assert (tractor, implement) == (small_site.tractor, small_site.implement)
        plan = there_and_back(job)
        driven.append(simulate(plan))
        return RefinedPlan(plan, driven[0], "driven once to be sure")

    monkeypatch.setitem(STRATEGIES, toy.name, replace(toy, refine=refine))
    evaluation = simulate_candidate(small_site, Candidate(toy.name, 1))
    assert evaluation.run is driven[0] and driven[0].outcome == DONE
    assert (evaluation.result.remark or "").split("; ")[0] == "driven once to be sure"
    assert evaluation.result.time_s == driven[0].duration_s


def test_a_jump_is_refused_by_a_strategy_with_its_own_order(small_site: PlanningContext, toy: Strategy) -> None:
    result = compute_candidate_figures(small_site, Candidate(toy.name, 1, jump=2))
    assert result.reason == "Strategy 'there-and-back' has its own order of tracks; leave out the jump."
    assert compute_candidate_figures(small_site, Candidate("split-field", 1, jump=1)).feasible
