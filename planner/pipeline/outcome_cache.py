"""Outcomes of candidates on disk: a question that was answered before is not computed again, only what is shown of it.

Figures and plans are kept. A plan is driven again where its run is asked for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from pydantic import TypeAdapter

from planner.evaluation.candidates.evaluate import Candidate, Outcome
from planner.evaluation.context import PlanningContext
from planner.pipeline.fingerprint import hash_content, hash_strategies
from planner.pipeline.result_cache import ResultCache
from reports.common.plan_results import PlanResult
from vehicle.missions.plan import Plan
from vehicle.missions.plan_file import format_plan, parse_plan

Outcomes = tuple[dict[int, Outcome], dict[int, Plan]]
"""Outcomes of candidates and the plans that were driven well, by the numbers of the candidates."""
HOW_COMPUTED = "time_share", "move_cache"  # of a context


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

    Pictures of plans that were driven, but not well, are drawn from runs that are not kept: with them these are
    computed anew.
    """
    if cache.folder is None:
        return compute()
    name = _hash_question(context, candidates, prunes)
    known = cache.read(name)
    if known is not None:
        results = unpack_results(known["results"])
        if not (with_pictures and any(one.time_s and not one.feasible for one in results)):
            plans = {int(number): parse_plan(text) for number, text in known["plans"].items()}
            return dict(enumerate(map(Outcome, results))), plans
    outcomes, plans = compute()
    results = [outcomes[number].result for number in range(len(candidates))]
    texts = {str(number): format_plan(one, indent=None) for number, one in plans.items()}
    cache.write(name, {"results": pack_results(results), "plans": texts})
    cache.remove_oldest()
    return outcomes, plans


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


def _hash_question(context: PlanningContext, candidates: Sequence[Candidate], prunes: bool) -> str:
    """A hash of all that outcomes depend on."""
    question = {one.name: getattr(context, one.name) for one in fields(context) if one.name not in HOW_COMPUTED}
    return hash_content(question, list(candidates), prunes, hash_strategies(context.request.strategies))
