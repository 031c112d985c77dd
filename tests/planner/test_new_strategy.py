"""A strategy that nobody knew before: a record in the registry is all that planning needs."""

from dataclasses import replace
from typing import Any

import pytest

from planner.candidates.evaluate import Candidate, evaluate, simulated
from planner.rank import candidates, rank
from planner.scenario import Scenario
from planner.site import Site
from strategies.errors import StrategyError
from strategies.job import Job, Pass
from strategies.legs import mission_of
from strategies.record import Refined, Simulate, Strategy
from strategies.registry import STRATEGIES
from vehicle.missions import Plan
from vehicle.run import DONE


def there_and_back(job: Job) -> Plan:
    """One tractor takes all tracks in order, to and fro; the others are not needed."""
    if job.tractors > 1:
        raise StrategyError("There and back is for one tractor.")
    order = [Pass(track, 1 if index % 2 == 0 else -1) for index, track in enumerate(job.layout.tracks)]
    return Plan((mission_of(job, order),), {"strategy": "there-and-back"})


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Strategy:
    toy = Strategy("there-and-back", "one tractor, to and fro", there_and_back)
    monkeypatch.setitem(STRATEGIES, toy.name, toy)
    return toy


def test_a_registered_strategy_is_planned_with(small_site: Site, toy: Strategy) -> None:
    scenario = replace(small_site.scenario, strategies=(toy.name, "split-field"), tractors=(1, 2))
    todo = candidates(scenario)
    assert Candidate(toy.name, 1) in todo and Candidate(toy.name, 2) in todo
    plans = rank(small_site, [evaluate(small_site, candidate) for candidate in todo]).plans
    alone, refused = (next(p for p in plans if (p.strategy, p.tractors) == (toy.name, count)) for count in (1, 2))
    assert alone.feasible and alone.rank is not None and alone.collisions == 0
    assert (refused.feasible, refused.reason) == (False, "There and back is for one tractor.")
    length = sum(track.length for track in small_site.layout.tracks)
    assert alone.time_s is not None and alone.time_s > length / small_site.manner.work_speed_mps


def test_an_unregistered_name_stays_unknown() -> None:
    with pytest.raises(Exception, match="'there-and-back' is unknown"):
        Scenario(field="iwamizawa", strategies=("there-and-back",))


def test_a_refinement_is_handed_a_simulation_and_its_run_is_not_driven_again(
    small_site: Site, toy: Strategy, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = []

    def refine(job: Job, simulate: Simulate, tractor: Any, implement: Any) -> Refined:
        assert (tractor, implement) == (small_site.tractor, small_site.implement)
        plan = there_and_back(job)
        driven.append(simulate(plan))
        return Refined(plan, driven[0], "driven once to be sure")

    monkeypatch.setitem(STRATEGIES, toy.name, replace(toy, refine=refine))
    evaluation = simulated(small_site, Candidate(toy.name, 1))
    assert evaluation.run is driven[0] and driven[0].outcome == DONE
    assert evaluation.result.remark == "driven once to be sure"
    assert evaluation.result.time_s == driven[0].duration_s


def test_a_jump_is_refused_by_a_strategy_with_its_own_order(small_site: Site, toy: Strategy) -> None:
    result = evaluate(small_site, Candidate(toy.name, 1, jump=2))
    assert result.reason == "Strategy 'there-and-back' has its own order of tracks; leave out the jump."
    assert evaluate(small_site, Candidate("split-field", 1, jump=1)).feasible
