"""Outcomes of candidates on disk: a question that was answered before is not computed again, only what is shown of it.

Figures and plans are kept. A plan is driven again where its run is asked for, or where what it costs is another.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

from pydantic import TypeAdapter

from planner.evaluation.candidates.evaluate import Candidate, Outcome, appraise, drive_plan
from planner.evaluation.context import PlanningContext
from planner.evaluation.time_share import TimeSpentError
from planner.pipeline.fingerprint import hash_content, hash_strategies
from planner.pipeline.result_cache import ResultCache
from planner.request.parameter_names import APPRAISED
from reports.common.plan_results import PlanResult, choose_by_count
from vehicle.missions.plan import Plan
from vehicle.missions.plan_file import format_plan, parse_plan

Outcomes = tuple[dict[int, Outcome], dict[int, Plan]]
"""Outcomes of candidates and the plans that were driven well, by the numbers of the candidates."""
HOW_COMPUTED = "time_share", "move_cache"  # of a context
APPRAISES = "cost_terms", "workday", "criteria"  # of a context, beside parameters of its request


def collect_outcomes(outcomes: Iterable[tuple[int, Outcome]]) -> Outcomes:
    """The outcomes of all candidates that there is time for, and the plans that were driven well, by their number.

    Only plans to take with some number of tractors keep their runs, which are large.
    """
    found, plans = dict[int, Outcome](), dict[int, Plan]()
    with suppress(TimeSpentError):
        for number, outcome in outcomes:
            found[number] = outcome
            if outcome.run is None:
                continue
            plans[number], count = outcome.run.plan, outcome.result.tractors
            alike = {n: one for n, one in found.items() if one.result.feasible and one.result.tractors == count}
            taken = choose_by_count([one.result for one in alike.values()])[count]
            found |= {n: replace(one, run=None) for n, one in alike.items() if one.result is not taken}
    return found, plans


def recall_outcomes(
    cache: ResultCache,
    context: PlanningContext,
    candidates: Sequence[Candidate],
    prunes: bool,
    compute: Callable[[], Outcomes],
    *,
    with_pictures: bool,
) -> Outcomes:
    """The outcomes of candidates as they were found for the same context before, without runs; else as computed.

    Where only prices, times or samples are others, the plans are driven again and appraised. Of plans that were driven,
    but not well, neither plan nor run is kept: where they are to be appraised, or drawn, all is computed anew.
    """
    if cache.folder is None:
        return compute()
    drives_name, answer_name = _name_files(context, candidates, prunes)
    drives, answer = cache.read(drives_name), cache.read(answer_name)
    driven = [] if drives is None else unpack_results(drives["driven"])
    is_whole = drives is not None and all(one.feasible or not one.time_s for one in driven)
    if drives is not None and answer is not None and (is_whole or not with_pictures):
        results = unpack_results(answer["results"])
        return dict(enumerate(map(Outcome, results, driven))), _parse_plans(drives["plans"])
    if drives is not None and is_whole:
        outcomes, plans = collect_outcomes(_iter_appraised(context, candidates, driven, _parse_plans(drives["plans"])))
    else:
        outcomes, plans = compute()
        packed = pack_results([outcomes[number].driven for number in range(len(candidates))])
        texts = {str(number): format_plan(one, indent=None) for number, one in plans.items()}
        cache.write(drives_name, {"driven": packed, "plans": texts})
    results = [outcomes[number].result for number in range(len(candidates))]
    cache.write(answer_name, {"results": pack_results(results)})
    cache.remove_oldest()
    return outcomes, plans


def _iter_appraised(
    context: PlanningContext, candidates: Sequence[Candidate], driven: Sequence[PlanResult], plans: Mapping[int, Plan]
) -> Iterator[tuple[int, Outcome]]:
    """The outcomes of candidates by figures and plans of their drives, which are driven again."""
    for number, (candidate, figures) in enumerate(zip(candidates, driven, strict=True)):
        if number in plans:
            yield number, appraise(context, figures, drive_plan(context, candidate, plans[number]))
        else:
            yield number, Outcome(figures, figures)


def _parse_plans(texts: Mapping[str, str]) -> dict[int, Plan]:
    return {int(number): parse_plan(text) for number, text in texts.items()}


def pack_results(results: Sequence[PlanResult]) -> list[dict[str, Any]]:
    """The figures of plans as values of JSON, without those that a plan has by default."""
    packed: list[dict[str, Any]] = _get_adapter().dump_python(list(results), mode="json", exclude_defaults=True)
    return packed


def unpack_results(packed: Sequence[Mapping[str, Any]]) -> list[PlanResult]:
    """The figures of plans that were packed."""
    return _get_adapter().validate_python(packed)


@functools.cache
def _get_adapter() -> TypeAdapter[list[PlanResult]]:
    return TypeAdapter(list[PlanResult])


def _name_files(context: PlanningContext, candidates: Sequence[Candidate], prunes: bool) -> tuple[str, str]:
    """The names of the files of the drives and of the answer: hashes of all that each depends on."""
    request, criteria = context.request, context.criteria
    rest = {
        one.name: getattr(context, one.name) for one in fields(context) if one.name not in (*HOW_COMPUTED, "request")
    }
    asked = {one.name: getattr(request, one.name) for one in fields(request)}
    how = list(candidates), prunes, hash_strategies(request.strategies)
    counts_use = criteria is not None and criteria.counts_use  # says which drives are tried
    drives = {name: value for name, value in rest.items() if name not in APPRAISES}
    wanted = {name: value for name, value in asked.items() if name not in APPRAISED}
    return hash_content("drives", drives, wanted, how, counts_use), hash_content("answer", rest, asked, how)
