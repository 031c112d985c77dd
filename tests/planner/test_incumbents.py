"""Least times of plans, and candidates that cannot win."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields import Field
from planner import SerialExecutor, plan
from planner.evaluation.candidates.evaluate import Candidate, CandidateEvaluation, run_candidate, simulate_candidate
from planner.evaluation.candidates.incumbents import (
    MIN_SWATH_WORK_S,
    find_incumbents,
    is_worth_bounding,
    order_candidates,
    prune_candidate,
)
from planner.evaluation.candidates.pruning import (
    SURE_FACTOR,
    Incumbent,
    PruningLimits,
    prune_plans,
    simulate_promising_plans,
)
from planner.evaluation.candidates.solo_runs import SoloRuns
from planner.evaluation.candidates.time_bounds import (
    SpeedLimits,
    build_speed_limits,
    compute_done_s,
    compute_earliest_finish_s,
    compute_finish_from_solo_s,
)
from planner.evaluation.context import PlanningContext, prepare_context
from planner.request.plan_request import PlanRequest
from planner.risk.assessment import build_decision_criteria
from reports.common.plan_results import PlanResult, get_finished_field_s
from strategies.program.strategy_record import RefinedPlan
from tests.examples import count_examples
from vehicle.missions.plan import HEADLAND_PASS, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.run import DONE
from vehicle.sim.world import simulate


@pytest.fixture(scope="module")
def round_site() -> PlanningContext:
    """60 m by 90 m with its headland worked."""
    return prepare_context(PlanRequest(), Field("drawn", shapely.box(0, 0, 60, 90)))


@pytest.fixture(scope="module")
def driven_once(round_site: PlanningContext) -> Callable[[str], CandidateEvaluation]:
    """Two tractors on that field by a strategy."""
    return cache(lambda strategy: simulate_candidate(round_site, Candidate(strategy, 2)))


def leg(y: float, start: float, end: float, speed: float = 2.0, **more: object) -> Leg:
    return Leg(np.array([[start, y], [end, y]]), speed, **more)  # type: ignore[arg-type]


def test_least_time_by_hand() -> None:
    first = Mission((leg(0, 0, 20), leg(0, 20, 60, 4.0)))  # 10 s and 10 s
    second = Mission((leg(9, 0, 10), leg(9, 10, 30, gates=(LegGate(0, 1, 20.0),))))  # 5 s, then from 15 s on 10 s
    assert compute_earliest_finish_s(Plan((first,))) == pytest.approx(20.0)
    assert compute_earliest_finish_s(Plan((first, second))) == pytest.approx(25.0)


def test_tractors_that_wait_for_each_other_are_counted_until_then() -> None:
    waits = [Mission((leg(9.0 * me, 0, 10), leg(9.0 * me, 10, 30, gates=(LegGate(1 - me, 1, 5.0),)))) for me in (0, 1)]
    assert compute_earliest_finish_s(Plan(tuple(waits))) == pytest.approx(5.0)


HALF = SpeedLimits(acceleration_mps2=0.5, shift_s=3.0)


def test_speed_is_gained_and_lost_by_hand() -> None:
    assert compute_earliest_finish_s(Plan((Mission((leg(0, 0, 100),)),)), HALF) == pytest.approx(
        54.0
    )  # 50 s, and 2 s at either end
    assert compute_earliest_finish_s(Plan((Mission((leg(0, 0, 2),)),)), HALF) == pytest.approx(
        4.0
    )  # to 1 m/s in 2 s, and back
    slow = Mission((leg(0, 0, 100), leg(0, 100, 150, 1.0)))  # 2 s lost at the start, 0.5 s to slow down, 1 s at the end
    assert compute_earliest_finish_s(Plan((slow,)), HALF) == pytest.approx(50.0 + 2.0 + 0.5 + 50.0 + 1.0)
    back = Mission((leg(0, 0, 100), leg(0, 100, 0, gear=-1)))
    assert compute_earliest_finish_s(Plan((back,)), HALF) == pytest.approx(54.0 + 3.0 + 54.0)


def test_a_gate_opens_no_later_than_its_metres_are_driven_at_best() -> None:
    first = Mission((leg(0, 0, 100),))
    waits = Mission((leg(9, 0, 100, gates=(LegGate(0, 0, 1.0),)),))  # 1 m from standing takes 2 s
    assert compute_earliest_finish_s(Plan((first, waits)), HALF) == pytest.approx(2.0 + 54.0)


def test_a_bend_is_shorter_by_what_the_wheels_save() -> None:
    corner = Leg(np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]]), 2.0)
    saved = SpeedLimits(bend_saving_m=0.4)
    assert compute_earliest_finish_s(Plan((Mission((corner,)),)), saved) == pytest.approx((100.0 - 0.2 * np.pi) / 2.0)


@pytest.mark.parametrize("strategy", ["split-field", "interleaved", "row-by-row"])
def test_no_tractor_is_done_sooner_than_at_least(
    round_site: PlanningContext, driven_once: Callable[[str], CandidateEvaluation], strategy: str
) -> None:
    run = driven_once(strategy).run
    assert run is not None
    least = compute_done_s(
        run.plan, build_speed_limits(round_site.tractor, round_site.implement, round_site.driving_rules.radius_m)
    )
    assert (np.array(least) < run.finish_s).all() and max(least) > 0.94 * run.duration_s
    assert max(least) > compute_earliest_finish_s(run.plan)


@settings(max_examples=count_examples(25))
@given(
    metres=st.lists(st.floats(0.5, 60.0), min_size=1, max_size=6),
    speeds=st.lists(st.floats(0.5, 3.0), min_size=6, max_size=6),
    gears=st.lists(st.sampled_from((1, -1)), min_size=6, max_size=6),
)
def test_nobody_drives_a_line_sooner_than_at_least(
    small_site: PlanningContext, metres: list[float], speeds: list[float], gears: list[int]
) -> None:
    x, legs = 0.0, []
    for length, speed, gear in zip(metres, speeds, gears, strict=False):
        legs.append(leg(0, x, x + gear * length, speed, gear=gear))
        x += gear * length
    plan, tractor, implement = Plan((Mission(tuple(legs)),)), small_site.tractor, small_site.implement
    run = simulate(plan, tractor, implement)
    assert (
        run.outcome == DONE
        and compute_earliest_finish_s(plan, build_speed_limits(tractor, implement, 5.0)) <= run.duration_s
    )


class Driven:
    """A plan driven in the least time and some more."""

    def __init__(self, choice: RefinedPlan, more_s: float, reason: str | None = None) -> None:
        self.reason = reason
        self.run = type(
            "Run", (), {"plan": choice.plan, "duration_s": compute_earliest_finish_s(choice.plan) + more_s}
        )()


def rounds_of(metres: float) -> RefinedPlan:
    return RefinedPlan(Plan((Mission((leg(0, 0, metres, task=LegTask(HEADLAND_PASS, 1)),)),)))


def test_only_choices_that_might_be_quicker_are_driven() -> None:
    quick, near, slow = rounds_of(2000.0), rounds_of(2060.0), rounds_of(2400.0)  # 1000, 1030 and 1200 s
    driven = simulate_promising_plans([slow, near, quick], lambda choice: Driven(choice, 40.0))
    assert [one.run.plan for one in driven] == [quick.plan, near.plan]
    driven = simulate_promising_plans([slow, near, quick], lambda choice: Driven(choice, 20.0))  # in 1020 s
    assert [one.run.plan for one in driven] == [quick.plan]
    refused = simulate_promising_plans([slow, quick], lambda c: Driven(c, 20.0, "a reason" if c is quick else None))
    assert [one.reason for one in refused] == ["a reason", None]


def test_who_drives_alone_is_not_later_than_among_others(
    round_site: PlanningContext, driven_once: Callable[[str], CandidateEvaluation]
) -> None:
    for strategy in ("split-field", "row-by-row"):
        run = driven_once(strategy).run
        assert run is not None
        pace = build_speed_limits(round_site.tractor, round_site.implement, round_site.driving_rules.radius_m)
        seconds = compute_finish_from_solo_s(run.plan, SoloRuns(round_site))
        assert compute_earliest_finish_s(run.plan, pace) < seconds < run.duration_s
        limits = PruningLimits(pace, SoloRuns(round_site))
        assert limits.is_pruned(run.plan, seconds - 1.0) and not limits.is_pruned(run.plan, seconds + 1.0)
        rival = Incumbent("another", seconds - 1.0)
        told = prune_plans(round_site, [run.plan], rival, SoloRuns(round_site))
        assert told is not None and told.incumbent is rival and rival.finish_s < told.bound_s <= seconds
        assert prune_plans(round_site, [run.plan], rival) is None
        assert prune_plans(round_site, [run.plan], Incumbent("another", seconds + 1.0), SoloRuns(round_site)) is None


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
        assert is_worth_bounding(site) is many
        assert order_candidates(site, todo) == ([[1], [0]] if many else [[0, 1]])


def test_the_quickest_feasible_plan_of_a_count_is_the_rival() -> None:
    def result(strategy: str, seconds: float, tractors: int = 2, feasible: bool = True) -> PlanResult:
        return PlanResult(strategy, tractors, "u", feasible, time_s=seconds)

    some = [result("b", 90.0), result("a", 80.0), result("c", 70.0, feasible=False), result("d", 50.0, 3)]
    assert find_incumbents(dict(enumerate(some))) == {2: Incumbent("a", 80.0), 3: Incumbent("d", 50.0)}


@pytest.mark.parametrize("strategy", ["row-by-row", "row-by-row-optimised"])
def test_a_candidate_that_cannot_win_is_told_with_its_bound(
    round_site: PlanningContext, driven_once: Callable[[str], CandidateEvaluation], strategy: str
) -> None:
    driven = driven_once(strategy).result.time_s
    assert driven is not None
    told = prune_candidate(round_site, Candidate(strategy, 2), Incumbent("split-field", 0.5 * driven))
    assert told is not None and told.bound_s is not None and not told.feasible
    assert 0.8 / SURE_FACTOR * driven < told.bound_s < driven
    assert told.reason == (
        f"skipped: even its best case ({told.bound_s:.0f} s) is slower than split-field ({0.5 * driven:.0f} s)"
    )
    assert prune_candidate(round_site, Candidate(strategy, 2), Incumbent("split-field", driven)) is None
    assert prune_candidate(round_site, Candidate(strategy, 2), None) is None


def test_what_is_refined_is_compared_once_more(
    round_site: PlanningContext, driven_once: Callable[[str], CandidateEvaluation]
) -> None:
    candidate = Candidate("row-by-row", 2)
    driven = driven_once("row-by-row")
    told = simulate_candidate(round_site, candidate, Incumbent("split-field", 0.8 * (driven.result.time_s or 0.0)))
    assert told.run is None and told.result.bound_s is not None
    assert told.result.bound_s < (driven.result.time_s or 0.0)
    near = simulate_candidate(round_site, candidate, Incumbent("split-field", 0.999 * (driven.result.time_s or 0.0)))
    assert near.result == driven.result


def test_a_passage_that_cannot_win_is_not_driven(round_site: PlanningContext, meeting: list[Plan]) -> None:
    """Where tractors meet on both quick passages to the rounds, one alone on these would be slower than the rival."""
    pace = build_speed_limits(round_site.tractor, round_site.implement, round_site.driving_rules.radius_m)
    run_candidate(round_site, Candidate("split-field", 2, jump=1))
    slow = compute_earliest_finish_s(meeting.pop(), pace)  # the passage with one alone is the last resort
    quick = [compute_earliest_finish_s(each, pace) for each in meeting]
    assert max(quick) < slow - 1.0
    meeting.clear()
    told = simulate_candidate(round_site, Candidate("split-field", 2, jump=1), Incumbent("another", slow - 0.5)).result
    assert not told.feasible and told.bound_s == pytest.approx(slow) and "even its best case" in (told.reason or "")
    assert 0 < len(meeting) <= len(quick) and slow > max(compute_earliest_finish_s(each, pace) for each in meeting)


def test_where_money_decides_all_tractors_together_must_take_longer(round_site: PlanningContext) -> None:
    asked = replace(round_site.request, objective="cheapest")
    site = replace(round_site, request=asked, criteria=build_decision_criteria(asked))
    for tractor_s, told in ((1.0, True), (1e6, False)):
        assert (
            prune_candidate(site, Candidate("row-by-row", 2), Incumbent("split-field", 100.0, tractor_s)) is not None
        ) is told


@pytest.mark.slow
def test_the_best_plan_of_every_count_is_never_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = shapely.Polygon([(0, 0), (90, 0), (70, 60), (0, 45)])
    scenario = PlanRequest(tractors=(1, 2), strategies=("col-by-col", "split-field"))
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
