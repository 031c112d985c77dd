"""Least times of plans, and formations that cannot win."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from fields import Field
from planner import SerialExecutor, plan
from planner.candidates.bounds import least_s
from planner.candidates.choosing import promising
from planner.candidates.evaluate import Candidate, simulated
from planner.candidates.rivals import Rival, hopeless, rivals, waves
from planner.scenario import Scenario
from planner.site import Site, prepare
from reports.results import PlanResult
from strategies.record import Refined
from vehicle.missions import ROUND, Gate, Leg, Mission, Plan, Task


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


@pytest.mark.parametrize("strategy", ["split-field", "row-by-row"])
def test_no_run_is_quicker_than_the_least_time_of_its_plan(small_site: Site, strategy: str) -> None:
    run = simulated(small_site, Candidate(strategy, 2)).run
    assert run is not None
    assert least_s(run.plan) < run.duration_s < 1.3 * least_s(run.plan)


class Driven:
    """A plan driven in the least time and some more."""

    def __init__(self, choice: Refined, more_s: float, reason: str | None = None) -> None:
        self.reason = reason
        self.run = type("Run", (), {"plan": choice.plan, "duration_s": least_s(choice.plan) + more_s})()


def rounds_of(metres: float) -> Refined:
    return Refined(Plan((Mission((leg(0, 0, metres, task=Task(ROUND, 1)),)),)))


def test_only_choices_that_might_be_quicker_are_driven() -> None:
    quick, near, slow = rounds_of(2000.0), rounds_of(2060.0), rounds_of(2400.0)  # 1000, 1030 and 1200 s
    driven = promising([slow, near, quick], lambda choice: Driven(choice, 20.0))
    assert [one.run.plan for one in driven] == [quick.plan, near.plan]
    refused = promising([slow, quick], lambda c: Driven(c, 20.0, "a reason" if c is quick else None))
    assert [one.reason for one in refused] == ["a reason", None]


def test_formations_come_after_the_others_on_a_big_field_only(small_site: Site) -> None:
    todo = [Candidate("row-by-row", 2), Candidate("split-field", 2), Candidate("row-by-row", 1)]
    assert waves(small_site, todo) == [[0, 1, 2]]
    big = prepare(Scenario(tracks_only=True), Field("big", shapely.box(0, 0, 500, 400)))
    assert waves(big, todo) == [[1, 2], [0]]


def test_the_quickest_feasible_plan_of_a_count_is_the_rival() -> None:
    def result(strategy: str, seconds: float, tractors: int = 2, feasible: bool = True) -> PlanResult:
        return PlanResult(strategy, tractors, "u", feasible, time_s=seconds)

    some = [result("b", 90.0), result("a", 80.0), result("c", 70.0, feasible=False), result("d", 50.0, 3)]
    assert rivals(dict(enumerate(some))) == {2: Rival("a", 80.0), 3: Rival("d", 50.0)}


def test_a_formation_that_cannot_win_is_told_with_its_bound(small_site: Site) -> None:
    driven = simulated(small_site, Candidate("row-by-row", 2)).result.time_s
    assert driven is not None
    beaten = hopeless(small_site, Candidate("row-by-row", 2), Rival("split-field", 0.5 * driven))
    assert beaten is not None and beaten.bound_s is not None and not beaten.feasible
    assert 0.5 * driven < beaten.bound_s < driven
    assert beaten.reason == f"cannot win: at least {beaten.bound_s:.0f} s, split-field takes {0.5 * driven:.0f} s"
    assert hopeless(small_site, Candidate("row-by-row", 2), Rival("split-field", driven)) is None
    assert hopeless(small_site, Candidate("interleaved", 2), Rival("split-field", 1.0)) is None


def test_a_plan_of_a_big_field_lists_who_cannot_win(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.candidates.rivals.BIG_S", 0.0)
    scenario = Scenario(tractors=(2,), strategies=("row-by-row", "split-field"), tracks_only=True)
    calls: list[tuple[int, int]] = []
    field = Field("drawn", shapely.box(0, 0, 36, 80))
    planned = plan(scenario, field=field, executor=SerialExecutor(), progress=lambda *done: calls.append(done))
    best = planned.ranking.best
    assert best is not None and best.strategy == "split-field" and calls == [(1, 2), (2, 2)]
    other = replace(planned.ranking.plans[1])
    assert other.strategy == "row-by-row"
    assert (other.bound_s is not None and other.bound_s > (best.finished_s or 0.0)) or other.feasible
