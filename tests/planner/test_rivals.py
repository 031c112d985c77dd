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
from planner.candidates.alone import Alone
from planner.candidates.beaten import SURE, Rival, beaten
from planner.candidates.bounds import Pace, alone_s, done_s, least_s, pace_of
from planner.candidates.choosing import Limits, promising
from planner.candidates.evaluate import Candidate, Evaluation, run_candidate, simulated
from planner.candidates.rivals import WORTH_S, hopeless, rivals, waves, worth_bounds
from planner.outlook import stakes_of
from planner.scenario import Scenario
from planner.site import Site, prepare
from reports.results import PlanResult, finish_s
from strategies.record import Refined
from vehicle.missions import ROUND, Gate, Leg, Mission, Plan, Task
from vehicle.run import DONE
from vehicle.world import simulate


@pytest.fixture(scope="module")
def round_site() -> Site:
    """60 m by 90 m with its headland worked."""
    return prepare(Scenario(), Field("drawn", shapely.box(0, 0, 60, 90)))


@pytest.fixture(scope="module")
def driven_once(round_site: Site) -> Callable[[str], Evaluation]:
    """Two tractors on that field by a strategy."""
    return cache(lambda strategy: simulated(round_site, Candidate(strategy, 2)))


def leg(y: float, start: float, end: float, speed: float = 2.0, **more: object) -> Leg:
    return Leg(np.array([[start, y], [end, y]]), speed, **more)  # type: ignore[arg-type]


def test_least_time_by_hand() -> None:
    first = Mission((leg(0, 0, 20), leg(0, 20, 60, 4.0)))  # 10 s and 10 s
    second = Mission((leg(9, 0, 10), leg(9, 10, 30, gates=(Gate(0, 1, 20.0),))))  # 5 s, then from 15 s on 10 s
    assert least_s(Plan((first,))) == pytest.approx(20.0)
    assert least_s(Plan((first, second))) == pytest.approx(25.0)


def test_tractors_that_wait_for_each_other_are_counted_until_then() -> None:
    waits = [Mission((leg(9.0 * me, 0, 10), leg(9.0 * me, 10, 30, gates=(Gate(1 - me, 1, 5.0),)))) for me in (0, 1)]
    assert least_s(Plan(tuple(waits))) == pytest.approx(5.0)


HALF = Pace(mps2=0.5, shift_s=3.0)


def test_speed_is_gained_and_lost_by_hand() -> None:
    assert least_s(Plan((Mission((leg(0, 0, 100),)),)), HALF) == pytest.approx(54.0)  # 50 s, and 2 s at either end
    assert least_s(Plan((Mission((leg(0, 0, 2),)),)), HALF) == pytest.approx(4.0)  # to 1 m/s in 2 s, and back
    slow = Mission((leg(0, 0, 100), leg(0, 100, 150, 1.0)))  # 2 s lost at the start, 0.5 s to slow down, 1 s at the end
    assert least_s(Plan((slow,)), HALF) == pytest.approx(50.0 + 2.0 + 0.5 + 50.0 + 1.0)
    back = Mission((leg(0, 0, 100), leg(0, 100, 0, gear=-1)))
    assert least_s(Plan((back,)), HALF) == pytest.approx(54.0 + 3.0 + 54.0)


def test_a_gate_opens_no_later_than_its_metres_are_driven_at_best() -> None:
    first = Mission((leg(0, 0, 100),))
    waits = Mission((leg(9, 0, 100, gates=(Gate(0, 0, 1.0),)),))  # 1 m from standing takes 2 s
    assert least_s(Plan((first, waits)), HALF) == pytest.approx(2.0 + 54.0)


def test_a_bend_is_shorter_by_what_the_wheels_save() -> None:
    corner = Leg(np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]]), 2.0)
    saved = Pace(bend_m=0.4)
    assert least_s(Plan((Mission((corner,)),)), saved) == pytest.approx((100.0 - 0.2 * np.pi) / 2.0)


@pytest.mark.parametrize("strategy", ["split-field", "interleaved", "row-by-row"])
def test_no_tractor_is_done_sooner_than_at_least(
    round_site: Site, driven_once: Callable[[str], Evaluation], strategy: str
) -> None:
    run = driven_once(strategy).run
    assert run is not None
    least = done_s(run.plan, pace_of(round_site.tractor, round_site.implement, round_site.manner.radius_m))
    assert (np.array(least) < run.finish_s).all() and max(least) > 0.94 * run.duration_s
    assert max(least) > least_s(run.plan)


@settings(max_examples=25, deadline=None)
@given(
    metres=st.lists(st.floats(0.5, 60.0), min_size=1, max_size=6),
    speeds=st.lists(st.floats(0.5, 3.0), min_size=6, max_size=6),
    gears=st.lists(st.sampled_from((1, -1)), min_size=6, max_size=6),
)
def test_nobody_drives_a_line_sooner_than_at_least(
    small_site: Site, metres: list[float], speeds: list[float], gears: list[int]
) -> None:
    x, legs = 0.0, []
    for length, speed, gear in zip(metres, speeds, gears, strict=False):
        legs.append(leg(0, x, x + gear * length, speed, gear=gear))
        x += gear * length
    plan, tractor, implement = Plan((Mission(tuple(legs)),)), small_site.tractor, small_site.implement
    run = simulate(plan, tractor, implement)
    assert run.outcome == DONE and least_s(plan, pace_of(tractor, implement, 5.0)) <= run.duration_s


class Driven:
    """A plan driven in the least time and some more."""

    def __init__(self, choice: Refined, more_s: float, reason: str | None = None) -> None:
        self.reason = reason
        self.run = type("Run", (), {"plan": choice.plan, "duration_s": least_s(choice.plan) + more_s})()


def rounds_of(metres: float) -> Refined:
    return Refined(Plan((Mission((leg(0, 0, metres, task=Task(ROUND, 1)),)),)))


def test_only_choices_that_might_be_quicker_are_driven() -> None:
    quick, near, slow = rounds_of(2000.0), rounds_of(2060.0), rounds_of(2400.0)  # 1000, 1030 and 1200 s
    driven = promising([slow, near, quick], lambda choice: Driven(choice, 40.0))
    assert [one.run.plan for one in driven] == [quick.plan, near.plan]
    driven = promising([slow, near, quick], lambda choice: Driven(choice, 20.0))  # in 1020 s
    assert [one.run.plan for one in driven] == [quick.plan]
    refused = promising([slow, quick], lambda c: Driven(c, 20.0, "a reason" if c is quick else None))
    assert [one.reason for one in refused] == ["a reason", None]


def test_who_drives_alone_is_not_later_than_among_others(
    round_site: Site, driven_once: Callable[[str], Evaluation]
) -> None:
    for strategy in ("split-field", "row-by-row"):
        run = driven_once(strategy).run
        assert run is not None
        pace = pace_of(round_site.tractor, round_site.implement, round_site.manner.radius_m)
        seconds = alone_s(run.plan, Alone(round_site))
        assert least_s(run.plan, pace) < seconds < run.duration_s
        limits = Limits(pace, Alone(round_site))
        assert limits.beaten(run.plan, seconds - 1.0) and not limits.beaten(run.plan, seconds + 1.0)
        rival = Rival("another", seconds - 1.0)
        told = beaten(round_site, [run.plan], rival, Alone(round_site))
        assert told is not None and told.rival is rival and rival.seconds < told.seconds <= seconds
        assert beaten(round_site, [run.plan], rival) is None
        assert beaten(round_site, [run.plan], Rival("another", seconds + 1.0), Alone(round_site)) is None


def test_one_strategy_comes_before_the_others_save_on_small_fields(small_site: Site) -> None:
    todo = [Candidate("row-by-row", 2), Candidate("interleaved", 2), Candidate("split-field", 2)]
    assert waves(small_site, todo) == [[0, 1, 2]]
    big = prepare(Scenario(tracks_only=True), Field("big", shapely.box(0, 0, 500, 400)))
    assert waves(big, todo) == [[2], [0, 1]]
    assert waves(big, todo[:2]) == [[1], [0]]
    assert waves(big, todo[:1]) == [[0]]


def test_rounds_are_work_like_tracks() -> None:
    todo = [Candidate("row-by-row", 2), Candidate("split-field", 2)]
    for length_m, many in ((165, False), (330, True)):
        site = prepare(Scenario(), Field("strip", shapely.box(0, 0, 24, length_m)))
        assert site.layout.total_m / site.manner.work_speed_mps < WORTH_S
        assert worth_bounds(site) is many
        assert waves(site, todo) == ([[1], [0]] if many else [[0, 1]])


def test_the_quickest_feasible_plan_of_a_count_is_the_rival() -> None:
    def result(strategy: str, seconds: float, tractors: int = 2, feasible: bool = True) -> PlanResult:
        return PlanResult(strategy, tractors, "u", feasible, time_s=seconds)

    some = [result("b", 90.0), result("a", 80.0), result("c", 70.0, feasible=False), result("d", 50.0, 3)]
    assert rivals(dict(enumerate(some))) == {2: Rival("a", 80.0), 3: Rival("d", 50.0)}


@pytest.mark.parametrize("strategy", ["row-by-row", "row-by-row-optimised", "interleaved"])
def test_a_candidate_that_cannot_win_is_told_with_its_bound(
    round_site: Site, driven_once: Callable[[str], Evaluation], strategy: str
) -> None:
    driven = driven_once(strategy).result.time_s
    assert driven is not None
    told = hopeless(round_site, Candidate(strategy, 2), Rival("split-field", 0.5 * driven))
    assert told is not None and told.bound_s is not None and not told.feasible
    assert 0.8 / SURE * driven < told.bound_s < driven
    assert told.reason == f"cannot win: at least {told.bound_s:.0f} s, split-field takes {0.5 * driven:.0f} s"
    assert hopeless(round_site, Candidate(strategy, 2), Rival("split-field", driven)) is None
    assert hopeless(round_site, Candidate(strategy, 2), None) is None


def test_what_is_refined_is_compared_once_more(round_site: Site, driven_once: Callable[[str], Evaluation]) -> None:
    candidate = Candidate("row-by-row", 2)
    driven = driven_once("row-by-row")
    told = simulated(round_site, candidate, Rival("split-field", 0.8 * (driven.result.time_s or 0.0)))
    assert told.run is None and told.result.bound_s is not None
    assert told.result.bound_s < (driven.result.time_s or 0.0)
    near = simulated(round_site, candidate, Rival("split-field", 0.999 * (driven.result.time_s or 0.0)))
    assert near.result == driven.result


def test_a_passage_that_cannot_win_is_not_driven(round_site: Site, meeting: list[Plan]) -> None:
    """Where tractors meet on both quick passages to the rounds, one alone on these would be slower than the rival."""
    pace = pace_of(round_site.tractor, round_site.implement, round_site.manner.radius_m)
    run_candidate(round_site, Candidate("interleaved", 2))
    slow = least_s(meeting.pop(), pace)  # the passage with one alone is the last resort
    quick = [least_s(each, pace) for each in meeting]
    assert max(quick) < slow - 1.0
    meeting.clear()
    told = simulated(round_site, Candidate("interleaved", 2), Rival("split-field", slow - 0.5)).result
    assert not told.feasible and told.bound_s == pytest.approx(slow) and "cannot win" in (told.reason or "")
    assert 0 < len(meeting) <= len(quick) and slow > max(least_s(each, pace) for each in meeting)


def test_where_money_decides_all_tractors_together_must_take_longer(round_site: Site) -> None:
    asked = replace(round_site.scenario, prefer="cheapest")
    site = replace(round_site, scenario=asked, stakes=stakes_of(asked))
    for tractor_s, told in ((1.0, True), (1e6, False)):
        assert (hopeless(site, Candidate("row-by-row", 2), Rival("split-field", 100.0, tractor_s)) is not None) is told


def test_the_best_plan_of_every_count_is_never_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = shapely.Polygon([(0, 0), (90, 0), (70, 60), (0, 45)])
    scenario = Scenario(tractors=(1, 2), strategies=("col-by-col", "split-field"))
    found = []
    for worth_s in (0.0, 1e9):
        for name in ("WORTH_S", "WORTH_WHOLE_S"):
            monkeypatch.setattr(f"planner.candidates.rivals.{name}", worth_s)
        found.append(plan(scenario, field=Field("drawn", shape), executor=SerialExecutor()).ranking)
    some, whole = ({(one.strategy, one.tractors): one for one in each.plans} for each in found)
    assert found[0].best == found[1].best
    told = [key for key, one in some.items() if one.bound_s is not None]
    assert told and not any(one.bound_s is not None for one in whole.values())
    for count in scenario.tractors:
        feasible = ([one for one in each.plans if one.feasible and one.tractors == count] for each in found)
        first, second = (min(some, key=finish_s) for some in feasible)
        assert replace(first, rank=None) == replace(second, rank=None)
    for key in told:
        assert not whole[key].feasible or (some[key].bound_s or 0.0) < (whole[key].time_s or 0.0)
