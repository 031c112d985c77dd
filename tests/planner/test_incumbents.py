"""Candidates that are simulated first, and those that cannot win."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import pytest
import shapely

from fields import Field
from planner import SerialExecutor, plan
from planner.evaluation.candidates.evaluate import Candidate, CandidateEvaluation, simulate_candidate
from planner.evaluation.candidates.incumbents import (
    MIN_SWATH_WORK_S,
    find_incumbents,
    group_candidates,
    is_worth_pruning,
    order_candidates,
)
from planner.evaluation.candidates.line_programme import sketch_plans
from planner.evaluation.candidates.pruning import Incumbent, prune_composed
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.request.plan_request import PlanRequest
from planner.risk.assessment import build_decision_criteria
from reports.common.plan_results import PlanResult, get_finished_field_s
from strategies.registry import STRATEGIES


@pytest.fixture(scope="module")
def round_site() -> PlanningContext:
    """60 m by 90 m with its headland worked."""
    return prepare_context(PlanRequest(), Field("drawn", shapely.box(0, 0, 60, 90)))


@pytest.fixture(scope="module")
def driven_once(round_site: PlanningContext) -> Callable[[str], CandidateEvaluation]:
    """Two tractors on that field by a strategy."""
    return cache(lambda strategy: simulate_candidate(round_site, Candidate(strategy, 2)))


def test_one_strategy_comes_before_the_others_save_on_small_fields(small_site: PlanningContext) -> None:
    todo = [Candidate("row-by-row", 2), Candidate("interleaved", 2), Candidate("split-field", 2)]
    assert order_candidates(small_site, todo) == [[0, 1, 2]]
    big = prepare_context(PlanRequest(no_headland=True), Field("big", shapely.box(0, 0, 500, 400)))
    assert order_candidates(big, todo) == [[2], [0, 1]]
    assert order_candidates(big, todo[:2]) == [[1], [0]]
    assert order_candidates(big, todo[:1]) == [[0]]


def test_rounds_are_work_like_tracks() -> None:
    todo = [Candidate("row-by-row", 2), Candidate("split-field", 2)]
    for length_m, many in ((165, False), (330, True)):
        site = prepare_context(PlanRequest(), Field("strip", shapely.box(0, 0, 24, length_m)))
        assert site.layout.total_length_m / site.driving_rules.work_speed_mps < MIN_SWATH_WORK_S
        assert is_worth_pruning(site) is many
        assert order_candidates(site, todo) == ([[1], [0]] if many else [[0, 1]])


def test_the_quickest_feasible_plan_of_a_count_is_the_rival() -> None:
    def result(strategy: str, seconds: float, tractors: int = 2, feasible: bool = True) -> PlanResult:
        return PlanResult(strategy, tractors, "u", feasible, time_s=seconds)

    some = [result("b", 90.0), result("a", 80.0), result("c", 70.0, feasible=False), result("d", 50.0, 3)]
    assert find_incumbents(dict(enumerate(some))) == {2: Incumbent("a", 80.0), 3: Incumbent("d", 50.0)}


@pytest.mark.parametrize("strategy", ["interleaved", "row-by-row"])
def test_a_candidate_that_cannot_win_is_told_with_its_bound(
    round_site: PlanningContext, driven_once: Callable[[str], CandidateEvaluation], strategy: str
) -> None:
    driven = driven_once(strategy)
    driven_s = driven.result.time_s
    assert driven_s is not None
    pruned = simulate_candidate(round_site, Candidate(strategy, 2), Incumbent("split-field", 0.5 * driven_s))
    result, bound_s = pruned.result, pruned.result.bound_s
    assert pruned.run is None and not result.feasible and bound_s is not None
    assert 0.8 * driven_s < bound_s <= driven_s
    assert result.reason == (
        f"skipped: even its best case ({bound_s:.0f} s) is slower than split-field ({0.5 * driven_s:.0f} s)"
    )
    near = simulate_candidate(round_site, Candidate(strategy, 2), Incumbent("split-field", 1.01 * driven_s))
    assert near.result == driven.result


@pytest.mark.parametrize("strategy", ["row-by-row", "row-by-row-optimised", "col-by-col"])
def test_no_bound_of_a_formation_exceeds_its_drive(
    round_site: PlanningContext, driven_once: Callable[[str], CandidateEvaluation], strategy: str
) -> None:
    run, planned = driven_once(strategy).run, (round_site, STRATEGIES[strategy], 2)
    assert run is not None
    sketch = next(one for one in sketch_plans(*planned) if one.order == (run.plan.notes["headland"] or ""))
    assert 0.7 * run.duration_s < max(sketch.least_s) <= max(sketch.compose().least_s) <= run.duration_s


def test_formations_of_a_count_are_one_task() -> None:
    todo = [Candidate(name, count) for count in (1, 2, 3) for name in ("row-by-row", "split-field", "col-by-col")]
    assert group_candidates(todo) == [[0], [1], [2], [3, 5], [4], [6, 8], [7]]


def test_where_money_decides_all_tractors_together_must_take_longer(round_site: PlanningContext) -> None:
    cheapest = replace(round_site.request, objective="cheapest")
    site = replace(round_site, request=cheapest, criteria=build_decision_criteria(cheapest))
    seconds = [[130.0, 90.0]]
    for tractor_s, is_pruned in ((219.0, True), (221.0, False)):
        rival = Incumbent("split-field", 120.0, tractor_s)
        assert (prune_composed(site, seconds, rival) is not None) is is_pruned
        assert prune_composed(round_site, seconds, rival) is not None
    assert prune_composed(round_site, seconds, Incumbent("split-field", 130.0)) is None
    assert prune_composed(round_site, seconds, None) is None


@pytest.mark.slow
def test_the_best_plan_of_every_count_is_never_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = shapely.Polygon([(0, 0), (90, 0), (70, 60), (0, 45)])
    scenario = PlanRequest(tractors=(1, 2, 3), strategies=("row-by-row", "split-field"))
    found = []
    for worth_s in (0.0, 1e9):
        for name in ("MIN_SWATH_WORK_S", "MIN_TOTAL_WORK_S"):
            monkeypatch.setattr(f"planner.evaluation.candidates.incumbents.{name}", worth_s)
        found.append(plan(scenario, field=Field("drawn", shape), executor=SerialExecutor()).ranking)
    some, whole = ({(one.strategy, one.tractors): one for one in each.plans} for each in found)
    assert found[0].best == found[1].best
    told = [key for key, one in some.items() if one.bound_s is not None]
    assert told and not any(one.bound_s is not None for one in whole.values())
    for count in scenario.tractors:
        feasible = ([one for one in each.plans if one.feasible and one.tractors == count] for each in found)
        first, second = (min(some, key=get_finished_field_s) for some in feasible)
        assert replace(first, rank=None) == replace(second, rank=None)
    for key in told:
        assert not whole[key].feasible or (some[key].bound_s or 0.0) < (whole[key].time_s or 0.0)
