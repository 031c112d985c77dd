"""Outcomes of candidates on disk: a question that was answered before is not computed again, only what is shown of it.

Figures and plans are kept. A plan is driven again where its run is asked for, or where what it costs is another.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any

from pydantic import TypeAdapter

from planner.evaluation.candidates.evaluate import Candidate, Outcome, appraise, drive_plan
from planner.evaluation.context import PlanningContext
from planner.evaluation.time_share import TimeSpentError
from planner.pipeline.fingerprint import hash_content
from planner.pipeline.result_cache import ResultCache
from planner.pipeline.worker_tasks import group_candidates
from planner.request.parameter_names import APPRAISED
from reports.common.plan_results import PlanResult, choose_by_count
from strategies.names import STRATEGY_NAMES
from vehicle.missions.plan_file import format_plan, parse_plan

Outcomes = dict[int, Outcome]
"""Outcomes of candidates by their numbers."""
HOW_COMPUTED = "time_share", "move_cache"  # of a context
APPRAISES = "cost_terms", "workday", "criteria"  # of a context, beside parameters of its request
GROUPED = "tractors", "strategies"  # parameters that say which candidates there are


def collect_outcomes(outcomes: Iterable[tuple[int, Outcome]]) -> Outcomes:
    """The outcomes of all candidates that there is time for.

    Only plans to take with some number of tractors keep their runs, which are large.
    """
    found = Outcomes()
    with suppress(TimeSpentError):
        for number, outcome in outcomes:
            found[number] = outcome
            if outcome.run is None:
                continue
            count = outcome.result.tractors
            alike = {n: one for n, one in found.items() if one.result.feasible and one.result.tractors == count}
            taken = choose_by_count([one.result for one in alike.values()]).get(count)
            found |= {n: replace(found[n], run=None) for n in (*alike, number) if found[n].result is not taken}
    return found


def recall_outcomes(
    cache: ResultCache,
    context: PlanningContext,
    candidates: Sequence[Candidate],
    prunes: bool,
    compute: Callable[[Sequence[int]], Outcomes],
) -> Outcomes:
    """The outcomes of candidates, those of each number of tractors as they were found for the same context before,
    without runs; where none were, as computed of the candidates of these numbers.

    Where only prices, times or samples are others, the plans are driven again and appraised. What strategies of other
    packages make may depend on more than is known: it is always computed.
    """
    if cache.folder is None or not {one.strategy for one in candidates} <= {*STRATEGY_NAMES}:
        return compute(range(len(candidates)))
    drives, answer = _hash_context(context)
    outcomes, missing = Outcomes(), list[_GroupFiles]()
    for group in group_candidates(candidates):
        some = [candidates[number] for number in group], prunes
        files = _GroupFiles(cache, group, hash_content("drives", drives, some), hash_content("answer", answer, some))
        known = files.recall(context, candidates)
        if known is None:
            missing.append(files)
        else:
            outcomes |= known
    if missing:
        outcomes |= compute(sorted(number for files in missing for number in files.numbers))
    for files in missing:
        files.store(outcomes)
    cache.remove_oldest()
    return outcomes


@dataclass(frozen=True)
class _GroupFiles:
    """What is stored of the candidates of one number of tractors: their drives, and what these are worth."""

    cache: ResultCache
    numbers: Sequence[int]
    drives_name: str
    answer_name: str

    def recall(self, context: PlanningContext, candidates: Sequence[Candidate]) -> Outcomes | None:
        """The outcomes by what is stored; None where the drives are not."""
        stored, answer = self.cache.read(self.drives_name), self.cache.read(self.answer_name)
        if stored is None:
            return None
        plans = [text and parse_plan(text) for text in stored["plans"]]
        drives = list(zip(self.numbers, unpack_results(stored["drives"]), plans, strict=True))
        if answer is not None:
            results = unpack_results(answer["results"])
            known = zip(results, drives, strict=True)
            return {number: Outcome(result, figures, plan) for result, (number, figures, plan) in known}
        found = collect_outcomes(
            (
                number,
                appraise(context, figures, drive_plan(context, candidates[number], plan))
                if plan
                else Outcome(figures, figures),
            )
            for number, figures, plan in drives
        )
        self._store_answer(found)
        return found

    def store(self, outcomes: Outcomes) -> None:
        """Store what came of the candidates."""
        found = [outcomes[number] for number in self.numbers]
        texts = [one.plan and format_plan(one.plan, indent=None) for one in found]
        self.cache.write(self.drives_name, {"drives": pack_results([one.driven for one in found]), "plans": texts})
        self._store_answer(outcomes)

    def _store_answer(self, outcomes: Outcomes) -> None:
        results = pack_results([outcomes[number].result for number in self.numbers])
        self.cache.write(self.answer_name, {"results": results})


def _hash_context(context: PlanningContext) -> tuple[str, str]:
    """Hashes of all that the drives of any candidates of a context depend on, and what these are worth."""
    request, criteria, left_out = context.request, context.criteria, (*HOW_COMPUTED, "request")
    rest = {one.name: getattr(context, one.name) for one in fields(context) if one.name not in left_out}
    terms = {name: rest.pop(name) for name in APPRAISES}
    parameters = {one.name: getattr(request, one.name) for one in fields(request) if one.name not in GROUPED}
    parameters["most_tractors"] = max(request.tractors) if request.give else None
    counts_use = criteria is not None and criteria.counts_use  # says which drives are tried
    wanted = {name: value for name, value in parameters.items() if name not in APPRAISED}
    drives = hash_content(rest, wanted, counts_use)
    return drives, hash_content(drives, terms, parameters)


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
