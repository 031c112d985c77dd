"""Candidates that are simulated first, and those that cannot win."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import pytest
import shapely

from fields import Field
from planner import SerialExecutor, plan
from planner.evaluation.candidates.best_drive import (
    estimate_loss_s,
    find_incumbent,
    prunes_candidates,
)
from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate, simulate_candidates
from planner.evaluation.candidates.line_programme import sketch_plans
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.settings import FarmPrices
from planner.request.plan_request import PlanRequest
from planner.risk.assessment import build_decision_criteria
from planner.risk.costs import CostTerms
from reports.common.plan_results import PlanResult, choose_by_count
from strategies.registry import STRATEGIES

pytestmark = pytest.mark.usefixtures("first_layout")


@pytest.fixture(scope="module")
def driven_once(round_site: PlanningContext) -> Callable[[str], Outcome]:
    """Two tractors on that field by a strategy."""
    return cache(lambda strategy: simulate_candidate(round_site, Candidate(strategy, 2)))


def test_nothing_is_pruned_where_a_slower_plan_may_be_the_best(round_site: PlanningContext) -> None:
    assert prunes_candidates(round_site)
    for objective, prunes in (("surest", False), ("fuel", False), ("cheapest", True)):
        request = replace(round_site.request, objective=objective)
        assert prunes_candidates(replace(round_site, criteria=build_decision_criteria(request))) is prunes


def make_incumbent(finish_s: float, tractor_s: float = 0.0) -> PlanResult:
    return PlanResult("split-field", 2, "u", True, time_s=finish_s, tractor_time_s=tractor_s)


def test_the_quickest_feasible_plan_is_the_rival() -> None:
    def result(strategy: str, seconds: float, feasible: bool = True) -> PlanResult:
        return PlanResult(strategy, 2, "u", feasible, time_s=seconds)

    some = [result("b", 90.0), result("a", 80.0), result("c", 70.0, feasible=False)]
    assert find_incumbent(some) == some[1]
    assert find_incumbent(some[2:]) is None


@pytest.mark.slow
@pytest.mark.parametrize("clearance_m", [0.5, 0.25])
def test_who_works_beside_one_another_is_not_driven_where_others_keep_the_clearance(clearance_m: float) -> None:
    """Of their gap of 0.30 m errors of guidance leave 0.10 m: that is what is compared, and what is told."""
    request = PlanRequest(clearance_m=clearance_m)
    site = prepare_context(WorkOrder(request, Field("drawn", shapely.box(0, 0, 60, 90))))
    names = ["row-by-row", "col-by-col", "interleaved", "split-field"]
    found = list(simulate_candidates(site, [Candidate(name, 2) for name in names], prunes=True))
    assert [names[number] for number, _ in found] == ["split-field", *names[:3]], "one keeps the clearance"
    results = [one.result for _, one in found]
    assert results[0].feasible and results[0].keeps_clearance
    for one in results[1:]:
        assert not one.is_simulated
        told = f"within 0.10 m of each other, less than the clearance of {clearance_m:g} m, which split-field keeps"
        assert told in one.reason


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["interleaved", "row-by-row"])
def test_a_candidate_that_cannot_win_is_told_with_its_bound(
    round_site: PlanningContext, driven_once: Callable[[str], Outcome], strategy: str
) -> None:
    driven = driven_once(strategy)
    driven_s = driven.result.time_s
    pruned = simulate_candidate(round_site, Candidate(strategy, 2), make_incumbent(0.5 * driven_s))
    result, bound_s = pruned.result, pruned.result.bound_s
    assert pruned.run is None and not result.feasible
    assert bound_s == pytest.approx(driven_s, rel=0.1)
    assert result.reason == (
        f"skipped: by estimate ({bound_s:.0f} s) it is slower than split-field ({0.5 * driven_s:.0f} s)"
    )
    near = simulate_candidate(round_site, Candidate(strategy, 2), make_incumbent(1.05 * driven_s))
    assert near.result == driven.result


@pytest.mark.parametrize("strategy", ["row-by-row", "row-by-row-optimised", "col-by-col"])
def test_a_formation_is_sketched_as_it_is_driven(
    round_site: PlanningContext, driven_once: Callable[[str], Outcome], strategy: str
) -> None:
    run, planned = driven_once(strategy).run, (round_site, STRATEGIES[strategy], 2)
    sketch = next(one for one in sketch_plans(*planned) if one.order == run.plan.notes.headland)
    # Tractors of a sketch wait for each other in formation, but give way to nobody.
    moving_s = run.finish_s - run.sum_seconds_by_status()["waiting"]
    assert 0.88 * float(moving_s.max()) <= max(sketch.tractor_s) <= 1.12 * run.duration_s
    assert max(sketch.compose().least_s) <= run.duration_s


def test_where_machines_are_paid_by_use_all_together_must_take_longer(round_site: PlanningContext) -> None:
    """Hired by the hour from start to end the quickest of as many tractors is the cheapest."""
    cheapest = replace(round_site.request, objective="cheapest")
    terms = [CostTerms(FarmPrices(per_hour=one)) for one in (None, 40.0)]
    own, hired = (build_decision_criteria(cheapest, cost_terms=one) for one in terms)
    site, seconds = replace(round_site, request=cheapest, criteria=own), [130.0, 90.0]
    assert estimate_loss_s(replace(site, criteria=hired), seconds, make_incumbent(120.0, 221.0)) is not None
    for tractor_s, is_pruned in ((219.0, True), (221.0, False)):
        rival = make_incumbent(120.0, tractor_s)
        assert (estimate_loss_s(site, seconds, rival) is not None) is is_pruned
        assert estimate_loss_s(round_site, seconds, rival) is not None
    assert estimate_loss_s(round_site, seconds, make_incumbent(130.0)) is None
    assert estimate_loss_s(round_site, seconds, None) is None


@pytest.mark.slow
def test_the_best_plan_of_every_count_is_never_lost() -> None:
    shape = shapely.Polygon([(0, 0), (70, 0), (55, 45), (0, 35)])
    scenario = PlanRequest(tractors=(1, 2, 3), strategies=("row-by-row", "split-field"))
    found = [
        plan(scenario, field=Field("drawn", shape), executor=SerialExecutor(), simulate_all=simulate_all).ranking
        for simulate_all in (False, True)
    ]
    some, whole = ({(one.strategy, one.tractors): one for one in each.plans} for each in found)
    best, best_of_all = (ranking.best for ranking in found)
    assert best is not None and best_of_all is not None
    assert replace(best, rank=None) == replace(best_of_all, rank=None)
    told = [key for key, one in some.items() if not one.is_simulated]
    assert told and all(one.is_simulated for one in whole.values())
    for count in scenario.tractors:
        feasible = ([one for one in each.plans if one.feasible and one.tractors == count] for each in found)
        first, second = (choose_by_count(some)[count] for some in feasible)
        assert replace(first, rank=None) == replace(second, rank=None)
