"""A scenario from beginning to end: every candidate on whatever executor there is, ranked, with the best plan's run."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fields.field import Field
from planner.candidates.evaluate import Candidate
from planner.candidates.rivals import rivals, waves
from planner.chance.settings import Chances
from planner.drive import picture
from planner.farm.times import Times, Yard
from planner.outlook import bearing_out, check_words
from planner.pool import local_pool
from planner.price.cost import Terms
from planner.rank import candidates, check_margin, rank
from planner.scenario import Scenario
from planner.site import Site, prepare
from planner.tasks import Outcome, Progress, outcomes, pack, work_out
from reports.results import Drive, PlanResult, Ranking, merit
from strategies.supply import Supply
from vehicle.missions import Plan
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor


@dataclass(frozen=True, eq=False)
class Planned:
    """The answer to a scenario.

    `run` is that of `ranking.best`, None when no plan is feasible; `drives` are pictures by (strategy, tractors): of
    the best plan, or of every plan that was driven to its end where they were asked for. `plans` are the legs and gates
    of every feasible plan that was simulated, by the same.
    """

    site: Site
    ranking: Ranking
    run: Run | None
    drives: Mapping[tuple[str, int], Drive]
    plans: Mapping[tuple[str, int], Plan] = field(default_factory=dict)


def plan(
    scenario: Scenario,
    *,
    field: Field | str | Path | None = None,
    tractor: Tractor | str | Path | None = None,
    implement: Implement | None = None,
    chances: Chances | None = None,
    terms: Terms | None = None,
    supply: Supply | None = None,
    times: Times | None = None,
    yard: Yard | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    pictures: bool = False,
    every: bool = False,
) -> Planned:
    """Simulate and rank every candidate of a scenario.

    `field` and `tractor` (objects, names or files) take the place of those the scenario names; `implement` says where
    it sits and how long it is, its width is that of the scenario. `chances`, `terms` (prices), `times` and `yard` are
    those of a farm, `supply` what its implement carries. `executor` simulates the candidates; by default fresh
    processes on all cores. The answer does not depend on it. `progress` is called with (done, all). Raises a
    HeadlandError for a scenario that cannot be planned at all; a single candidate that cannot is in the ranking with
    its reason, and one that cannot win with its bound, save on small fields; with `every` that one is simulated too.
    """
    todo = candidates(scenario)
    if executor is None:
        with local_pool(len(todo)) as executor:
            return plan(
                scenario, field=field, tractor=tractor, implement=implement, chances=chances, terms=terms,
                supply=supply, times=times, yard=yard, executor=executor, progress=progress,
                pictures=pictures, every=every,
            )  # fmt: skip
    site = prepare(scenario, field, tractor, implement, chances, terms, supply, times, yard)
    check_margin(site, feasible=True)  # what takes most of the field is refused whatever is feasible
    packed = pack(site)
    results: dict[int, PlanResult] = {}
    drives: dict[int, Drive] = {}
    plans: dict[int, Plan] = {}
    best: Outcome | None = None
    allowed = scenario.allowed_s
    for wave in [list(range(len(todo)))] if every else waves(site, todo):
        known = rivals(results)
        work = [(packed, todo[index], pictures, known.get(todo[index].tractors)) for index in wave]
        for place, one in outcomes(executor, work, progress, len(results), len(todo)):
            results[wave[place]] = one.result
            if one.drive is not None:
                drives[wave[place]] = one.drive
            if one.run is not None:
                plans[wave[place]] = one.run.plan
            if one.run is not None and (best is None or merit(one.result, allowed) < merit(best.result, allowed)):
                best = one
    ranking = with_machines(rank(site, [results[index] for index in range(len(todo))]), terms)
    shown = {(todo[index].strategy, todo[index].tractors): drives[index] for index in sorted(drives)}
    legs = {(todo[index].strategy, todo[index].tractors): plans[index] for index in sorted(plans)}
    best = _chosen(ranking, todo, packed, best)
    if best is None or best.run is None:
        return Planned(site, ranking, None, shown, legs)
    if not pictures:
        shown = {(best.result.strategy, best.result.tractors): picture(site, best.run, best.result)}
    if site.stakes is not None:
        drives_of = bearing_out(best.run, site.tractor, site.implement, site.stakes)
        ranking = replace(ranking, checked=check_words(*drives_of))
    return Planned(site, ranking, best.run, shown, legs)


def with_machines(ranking: Ranking, terms: Terms | None) -> Ranking:
    """The ranking with the names of the farm's tractor and implement, where a farm has them."""
    names: dict[str, Any] = {"implement": None}
    if terms is not None and terms.implement is not None:
        names["implement"] = terms.implement.name
    if terms is not None and terms.tractor is not None:
        names["tractor"] = terms.tractor.name
    if terms is not None and terms.learned:
        names["learned"] = list(terms.learned)
        taken = tuple(f"From the farm's own logs: {words}." for words in terms.learned)
        ranking = replace(ranking, assumptions=(*ranking.assumptions, *taken))
    return replace(ranking, scenario={**ranking.scenario, **names})


def _chosen(ranking: Ranking, todo: list[Candidate], packed: bytes, best: Outcome | None) -> Outcome | None:
    """The outcome of the best plan; that is driven again where only the comparison of all has made it the best."""
    plan = ranking.best
    if plan is None or best is None or (best.result.strategy, best.result.tractors) == (plan.strategy, plan.tractors):
        return best
    again = next(one for one in todo if (one.strategy, one.tractors) == (plan.strategy, plan.tractors))
    return work_out(packed, again)
