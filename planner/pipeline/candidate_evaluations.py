"""Candidates evaluated on an executor, and what came of them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

from planner.evaluation.candidates.evaluate import Candidate
from planner.pipeline.worker_tasks import Progress, TaskOutcome, iter_outcomes
from planner.request.plan_request import PlanRequest
from reports.common.plan_drives import PlanDrive
from reports.common.plan_results import PlanResult, choose_by_count
from vehicle.missions.plan import Plan


@dataclass(eq=False)
class CandidateEvaluations:
    """Candidates of a packed context and what came of them: results, pictures and plans by number of the candidate.

    `driven` holds the outcomes, with their runs, of the plans to take with every number of tractors.
    """

    request: PlanRequest
    packed_context: bytes
    candidates: Sequence[Candidate]
    executor: Executor
    progress: Progress | None = None
    with_pictures: bool = False
    results: dict[int, PlanResult] = field(default_factory=dict)
    pictures: dict[int, PlanDrive] = field(default_factory=dict)
    plans: dict[int, Plan] = field(default_factory=dict)
    driven: dict[int, TaskOutcome] = field(default_factory=dict)

    def evaluate(self, prunes: bool) -> None:
        """Evaluate all candidates, with `prunes` only those that may be the quickest of their number of tractors."""
        outcomes = iter_outcomes(
            self.executor,
            self.packed_context,
            self.candidates,
            self.progress,
            prunes=prunes,
            with_pictures=self.with_pictures,
        )
        for index, outcome in outcomes:
            self._keep_outcome(index, outcome)

    def _keep_outcome(self, index: int, outcome: TaskOutcome) -> None:
        self.results[index] = outcome.result
        if outcome.picture is not None:
            self.pictures[index] = outcome.picture
        if outcome.run is not None:
            self.plans[index] = outcome.run.plan
            count = outcome.result.tractors
            alike = [one for one in self.results.values() if one.feasible and one.tractors == count]
            if choose_by_count(alike).get(count) is outcome.result:
                self.driven[count] = outcome

    def refuse_rest(self) -> None:
        """Refuse the candidates that nothing came of in the time there was."""
        for index, one in enumerate(self.candidates):
            if index not in self.results:
                reason = "planning ran out of time"
                self.results[index] = PlanResult(one.strategy, one.tractors, self.request.turn, False, reason)
