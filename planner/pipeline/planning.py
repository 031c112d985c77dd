"""`plan`: every candidate of a request simulated on any executor and ranked, with the run of the best plan."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fields.geometry.field import Field
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.candidates.incumbents import find_incumbents, order_candidates
from planner.evaluation.context import PlanningContext, prepare_context
from planner.farm.settings import FarmTimes, Yard
from planner.pipeline.executors import create_executor
from planner.pipeline.outputs.pictures import build_run_picture
from planner.pipeline.ranking import check_margin, list_candidates, rank_plans
from planner.pipeline.worker_tasks import Progress, TaskOutcome, evaluate_task, iter_outcomes, pack_context
from planner.request.plan_request import PlanRequest
from planner.request.random_inputs import UncertaintySettings
from planner.risk.assessment import check_best_plan, describe_check
from planner.risk.costs import CostTerms
from reports.common.plan_results import PlanDrive, PlanRanking, PlanResult, build_merit_sort_key
from strategies.program.supply import Supply
from vehicle.missions.plan import Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor


@dataclass(frozen=True, eq=False)
class PlanningResult:
    """The answer to a request.

    `run` is the run of `ranking.best`, None if no plan is feasible. `pictures`, by (strategy, tractors), are of the
    best plan, or with `with_pictures` of every plan that was driven to its end. `plans` are the legs and gates of every
    feasible plan that was simulated, by the same key.
    """

    context: PlanningContext
    ranking: PlanRanking
    run: SimulationRun | None
    pictures: Mapping[tuple[str, int], PlanDrive]
    plans: Mapping[tuple[str, int], Plan] = field(default_factory=dict)


def plan(
    request: PlanRequest,
    *,
    field: Field | str | Path | None = None,
    tractor: Tractor | str | Path | None = None,
    implement: Implement | None = None,
    uncertainty: UncertaintySettings | None = None,
    cost_terms: CostTerms | None = None,
    supply: Supply | None = None,
    times: FarmTimes | None = None,
    yard: Yard | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    with_pictures: bool = False,
    simulate_all: bool = False,
) -> PlanningResult:
    """Simulate and rank every candidate of a request.

    `field` and `tractor` (objects, names or files) replace those of the request; `implement` gives hitch and length,
    its width is that of the request. `uncertainty`, `cost_terms`, `times` and `yard` come from a farm, `supply` is what
    its implement carries. `executor` simulates the candidates, by default in fresh processes on all cores; the result
    does not depend on it. `progress` is called with (done, total). Raises HeadlandError for a request that cannot be
    planned. A candidate that cannot be driven is ranked last with its reason; one that cannot win is pruned with its
    lower bound, except on small fields and with `simulate_all`.
    """
    candidates = list_candidates(request)
    if executor is None:
        with create_executor(len(candidates)) as executor:
            return plan(
                request,
                field=field,
                tractor=tractor,
                implement=implement,
                uncertainty=uncertainty,
                cost_terms=cost_terms,
                supply=supply,
                times=times,
                yard=yard,
                executor=executor,
                progress=progress,
                with_pictures=with_pictures,
                simulate_all=simulate_all,
            )
    context = prepare_context(request, field, tractor, implement, uncertainty, cost_terms, supply, times, yard)
    check_margin(context, feasible=True)  # a margin that takes most of the field is refused even if plans are feasible
    packed_context = pack_context(context)
    results: dict[int, PlanResult] = {}
    pictures: dict[int, PlanDrive] = {}
    plans: dict[int, Plan] = {}
    best: TaskOutcome | None = None
    for wave in [list(range(len(candidates)))] if simulate_all else order_candidates(context, candidates):
        incumbents = find_incumbents(results)
        task_arguments = [
            (packed_context, candidates[index], with_pictures, incumbents.get(candidates[index].tractors))
            for index in wave
        ]
        for position, outcome in iter_outcomes(executor, task_arguments, progress, len(results), len(candidates)):
            results[wave[position]] = outcome.result
            if outcome.picture is not None:
                pictures[wave[position]] = outcome.picture
            if outcome.run is not None:
                plans[wave[position]] = outcome.run.plan
                best = _choose_better(best, outcome, request.time_limit_s)
    ranking = add_machine_names(rank_plans(context, [results[index] for index in range(len(candidates))]), cost_terms)
    keys = [(candidate.strategy, candidate.tractors) for candidate in candidates]
    pictures_by_plan = {keys[index]: pictures[index] for index in sorted(pictures)}
    plans_by_key = {keys[index]: plans[index] for index in sorted(plans)}
    best = _find_best_outcome(ranking, candidates, packed_context, best)
    if best is None or best.run is None:
        return PlanningResult(context, ranking, None, pictures_by_plan, plans_by_key)
    if not with_pictures:
        best_key = best.result.strategy, best.result.tractors
        pictures_by_plan = {best_key: build_run_picture(context, best.run, best.result)}
    if context.criteria is not None:
        check_and_shares = check_best_plan(best.run, context.tractor, context.implement, context.criteria)
        ranking = replace(ranking, check_sentences=describe_check(*check_and_shares))
    return PlanningResult(context, ranking, best.run, pictures_by_plan, plans_by_key)


def add_machine_names(ranking: PlanRanking, cost_terms: CostTerms | None) -> PlanRanking:
    """The ranking with the names of the farm's tractor and implement, where a farm has them."""
    names: dict[str, Any] = {"implement": None}
    if cost_terms is not None and cost_terms.implement is not None:
        names["implement"] = cost_terms.implement.name
    if cost_terms is not None and cost_terms.tractor is not None:
        names["tractor"] = cost_terms.tractor.name
    if cost_terms is not None and cost_terms.learned_notes:
        names["learned"] = list(cost_terms.learned_notes)
        learned_notes = tuple(f"From the farm's own logs: {note}." for note in cost_terms.learned_notes)
        ranking = replace(ranking, assumptions=(*ranking.assumptions, *learned_notes))
    return replace(ranking, scenario={**ranking.scenario, **names})


def _choose_better(best: TaskOutcome | None, outcome: TaskOutcome, time_limit_s: float | None) -> TaskOutcome:
    """The outcome of more merit; the earlier one if they are equal."""
    if best is None:
        return outcome
    keys = [build_merit_sort_key(each.result, time_limit_s) for each in (outcome, best)]
    return outcome if keys[0] < keys[1] else best


def _find_best_outcome(
    ranking: PlanRanking, candidates: list[Candidate], packed_context: bytes, best: TaskOutcome | None
) -> TaskOutcome | None:
    """The outcome of the best plan; simulated again if only the final comparison has made it the best."""
    plan = ranking.best
    if plan is None or best is None or (best.result.strategy, best.result.tractors) == (plan.strategy, plan.tractors):
        return best
    best_candidate = next(
        each for each in candidates if (each.strategy, each.tractors) == (plan.strategy, plan.tractors)
    )
    return evaluate_task(packed_context, best_candidate)
