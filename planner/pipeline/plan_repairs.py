"""Candidates evaluated in waves, and those that could not be driven planned again with wider margins at the
obstacles that were touched, with more headland, or without what cannot be reached.

Where nothing helps, the smallest change of the request that works is found by trying.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace
from itertools import islice
from typing import Any

from planner.errors import HeadlandError
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.candidates.incumbents import find_incumbents
from planner.evaluation.context import PlanningContext
from planner.evaluation.headland_depth import describe_shallow_headland
from planner.evaluation.layout_repairs import LayoutRepairs
from planner.pipeline.worker_tasks import Progress, TaskOutcome, iter_outcomes, pack_context
from planner.request.option_texts import MPS_PER_KMH
from planner.request.parameter_names import strip_unit
from planner.request.plan_request import PlanRequest
from reports.common.plan_drives import PlanDrive
from reports.common.plan_results import PlanResult, choose_by_count
from strategies.path_planning.turns import TurnReach
from vehicle.missions.plan import Plan

MAX_REPAIR_ROUNDS, MAX_MORE_PASSES = 8, 3
SPEED_SHARES, WIDTH_SHARES = (0.75, 0.5, 0.35), (0.75, 0.5, 0.35)
MIN_TRIED_KMH, MIN_TRIED_WIDTH_M = 2.0, 0.5
Prepare = Callable[..., PlanningContext]
"""`prepare_context` with all inputs but the request, as `request`, and the repairs, as `layout_repairs`."""
Attempt = tuple[str, PlanRequest, Candidate]
"""A change in words, the request with it, and the candidate to try."""
ANY_FIELD_STRATEGY = "split-field"  # tractors with swaths of their own: no formation has to fit
RESTRICTIONS = (
    "no_headland", "headland_m", "headland_passes", "radius_m", "turn", "corners", "bearing_deg", "entrance",
    "margin_m",
)  # fmt: skip
"""What a request may ask for that leaves less room than its default, by parameter."""


@dataclass(eq=False)
class CandidateEvaluations:
    """Candidates and what came of them: results, pictures, plans, and the packed context each was planned in.

    `driven` holds the outcomes, with their runs, of the plans to take with every number of tractors.
    """

    request: PlanRequest
    candidates: Sequence[Candidate]
    executor: Executor
    progress: Progress | None = None
    with_pictures: bool = False
    results: dict[int, PlanResult] = field(default_factory=dict)
    pictures: dict[int, PlanDrive] = field(default_factory=dict)
    plans: dict[int, Plan] = field(default_factory=dict)
    contexts: dict[int, tuple[PlanningContext, bytes]] = field(default_factory=dict)
    driven: dict[int, TaskOutcome] = field(default_factory=dict)

    def evaluate_wave(self, context: PlanningContext, packed_context: bytes, wave: Sequence[int]) -> list[TaskOutcome]:
        """Evaluate candidates in a context; of one evaluated before, the first result stays unless this one works."""
        incumbents = find_incumbents(self.results)
        task_arguments = [
            (
                packed_context,
                self.candidates[index],
                self.with_pictures,
                incumbents.get(self.candidates[index].tractors),
            )
            for index in wave
        ]
        outcomes: dict[int, TaskOutcome] = {}
        done_before = sum(index not in wave for index in self.results)
        for position, outcome in iter_outcomes(
            self.executor, task_arguments, self.progress, done_before, len(self.candidates)
        ):
            outcomes[position] = outcome
            if wave[position] not in self.results or outcome.result.feasible:
                self._keep_outcome(wave[position], outcome, (context, packed_context))
        return [outcomes[position] for position in sorted(outcomes)]

    def _keep_outcome(self, index: int, outcome: TaskOutcome, context: tuple[PlanningContext, bytes]) -> None:
        self.results[index], self.contexts[index] = outcome.result, context
        if outcome.picture is not None:
            self.pictures[index] = outcome.picture
        if outcome.run is not None:
            self.plans[index] = outcome.run.plan
            count = outcome.result.tractors
            alike = [one for one in self.results.values() if one.feasible and one.tractors == count]
            if choose_by_count(alike).get(count) is outcome.result:
                self.driven[count] = outcome

    def refuse_rest(self, context: PlanningContext, packed_context: bytes) -> None:
        """Refuse the candidates that nothing came of in the time there was."""
        for index in set(range(len(self.candidates))) - set(self.results):
            one = self.candidates[index]
            refusal = PlanResult(one.strategy, one.tractors, self.request.turn, False, "planning ran out of time")
            self._keep_outcome(index, TaskOutcome(refusal), (context, packed_context))

    def get_context(self, key: tuple[str, int]) -> tuple[PlanningContext, bytes]:
        """The context in which a strategy with a number of tractors was planned, and the same packed."""
        keys = [(candidate.strategy, candidate.tractors) for candidate in self.candidates]
        return self.contexts[keys.index(key)]

    def list_refused(self) -> list[int]:
        """Candidates of numbers of tractors without a feasible plan that may be repaired, the fewest tractors first."""
        feasible_counts = {result.tractors for result in self.results.values() if result.feasible}
        refused = [
            index for index, result in self.results.items() if result.tractors not in feasible_counts and result.faults
        ]
        return sorted(refused, key=lambda index: (self.candidates[index].tractors, index))


def repair_refused(evaluations: CandidateEvaluations, prepare: Prepare) -> LayoutRepairs:
    """Plan candidates that touch something, leave the field or find no path again; returns the last repairs.

    Of a number of tractors without a plan the first candidate is tried with one change after another; with the changes
    that help, the others are planned too.
    """
    layout_repairs = LayoutRepairs()
    last_faults = {index: evaluations.results[index].faults for index in evaluations.list_refused()}
    for _ in range(MAX_REPAIR_ROUNDS):
        refused = [index for index in evaluations.list_refused() if last_faults.get(index)]
        if not refused:
            break
        extended = layout_repairs.extend(
            last_faults[refused[0]],
            evaluations.request.margin_m,
            may_deepen=evaluations.request.requested_headland_m is None,
            may_skip=evaluations.request.headland_passes is None
            or _has_room_to_turn(evaluations.contexts[refused[0]][0]),
        )
        if extended == layout_repairs:
            last_faults[refused[0]] = ()
            continue
        try:
            context = prepare(request=evaluations.request, layout_repairs=extended)
        except HeadlandError:
            break
        layout_repairs, packed_context = extended, pack_context(context)
        for wave in (refused[:1], refused[1:]):
            outcomes = evaluations.evaluate_wave(context, packed_context, wave)
            last_faults |= {index: outcome.result.faults for index, outcome in zip(wave, outcomes, strict=True)}
            if wave == refused[:1] and not outcomes[0].result.feasible:
                break
    return layout_repairs


def _has_room_to_turn(context: PlanningContext) -> bool:
    """Whether turns fit in as many headland passes as were asked for: else swaths are not what is in the way."""
    side_m = 0.5 * max(context.implement.width_m, context.tractor.width_m)
    reach = TurnReach(context.driving_rules.tool_m, side_m)
    return not describe_shallow_headland(context.request, context.driving_rules.radius_m, reach)


def find_working_changes(
    evaluations: CandidateEvaluations, prepare: Prepare, layout_repairs: LayoutRepairs
) -> tuple[str, ...]:
    """Changes of a request without a plan that make its first candidate work, in words: what is advised was tried.

    First what the request itself restricts is lifted, one thing at a time; then the machine changes.
    """
    if any(result.feasible for result in evaluations.results.values()):
        return ()
    request, candidate = evaluations.request, min(evaluations.candidates, key=lambda each: each.tractors)

    def can_be_driven(changed: PlanRequest, tried: Candidate) -> bool:
        try:
            context = prepare(request=changed, layout_repairs=layout_repairs)
            ((_, outcome),) = iter_outcomes(evaluations.executor, [(pack_context(context), tried)], None)
        except HeadlandError:
            return False
        return outcome.result.feasible

    def find_first(attempts: Iterator[Attempt]) -> list[str]:
        return list(islice((words for words, changed, tried in attempts if can_be_driven(changed, tried)), 1))

    own = find_first(_iter_own(request, candidate))
    return tuple(
        own or [*find_first(_iter_slower(request, candidate)), *find_first(_iter_narrower(request, candidate))]
    )


def _iter_own(request: PlanRequest, candidate: Candidate) -> Iterator[Attempt]:
    """The request with fewer tractors, with more headland passes than it says, or without a restriction, or all."""
    for tractors in sorted({candidate.tractors - 1, 1} - {0, candidate.tractors}, reverse=True):
        words = f"use {tractors} tractor{'s' if tractors > 1 else ''}"
        yield words, request, replace(candidate, tractors=tractors)
    if candidate.strategy != ANY_FIELD_STRATEGY and ANY_FIELD_STRATEGY not in request.strategies:
        yield f"use the strategy {ANY_FIELD_STRATEGY}", request, replace(candidate, strategy=ANY_FIELD_STRATEGY)
    if request.headland_passes is not None:
        for passes in range(request.headland_passes + 1, request.headland_passes + 1 + MAX_MORE_PASSES):
            yield f"work {passes} headland passes", replace(request, headland_passes=passes), candidate
    defaults: dict[str, Any] = {each.name: each.default for each in fields(PlanRequest)}
    given = [name for name in RESTRICTIONS if getattr(request, name) != defaults[name]]
    for names in [*([name] for name in given), *([given] if len(given) > 1 else [])]:
        options = " and ".join(f"--{strip_unit(name).replace('_', '-')}" for name in names)
        yield f"leave out {options}", replace(request, **{name: defaults[name] for name in names}), candidate


def _iter_slower(request: PlanRequest, candidate: Candidate) -> Iterator[Attempt]:
    """The request at lower working speeds, in whole km/h."""
    for share in SPEED_SHARES:
        speed_kmh = round(share * request.speed_mps / MPS_PER_KMH)
        if speed_kmh >= MIN_TRIED_KMH:
            yield f"drive {speed_kmh} km/h", replace(request, speed_mps=speed_kmh * MPS_PER_KMH), candidate


def _iter_narrower(request: PlanRequest, candidate: Candidate) -> Iterator[Attempt]:
    """The request with narrower implements, in half metres."""
    for share in WIDTH_SHARES:
        width_m = round(2.0 * share * request.width_m) / 2.0
        if MIN_TRIED_WIDTH_M <= width_m < request.width_m:
            yield f"use an implement of {width_m:g} m", replace(request, width_m=width_m), candidate
