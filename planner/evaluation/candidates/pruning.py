"""Which plans are not composed or not driven, because they are likely to lose to the incumbent even if nobody waits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from planner.evaluation.context import PlanningContext
from reports.common.plan_results import PlanResult


@dataclass(frozen=True)
class Incumbent:
    """The quickest feasible plan with as many tractors: its strategy and seconds to finish the field.

    `tractor_s` is the sum over its tractors, each until it is done; `left_factor` by how much both are more than
    driven, for the ground that it leaves.
    """

    strategy: str
    finish_s: float
    tractor_s: float = 0.0
    left_factor: float = 1.0


@dataclass(frozen=True)
class PrunedCandidate:
    """A candidate whose plans all take about `bound_s` or more, longer than the incumbent."""

    bound_s: float
    incumbent: Incumbent


def prune_plan(
    context: PlanningContext, tractor_s: Sequence[float], incumbent: Incumbent | None
) -> PrunedCandidate | None:
    """A plan as pruned by the incumbent, given about the least seconds of its tractors; None if it might win.

    It is taken to leave as much ground. Where risk or cost decides, less time of all tractors together may be enough.
    """
    if incumbent is None or max(tractor_s) * incumbent.left_factor <= incumbent.finish_s:
        return None
    uses_criteria = context.criteria is not None and context.criteria.decides_best
    if uses_criteria and math.fsum(tractor_s) * incumbent.left_factor < incumbent.tractor_s:
        return None
    return PrunedCandidate(max(tractor_s), incumbent)


def build_pruned_result(pruned: PrunedCandidate, context: PlanningContext, strategy: str, tractors: int) -> PlanResult:
    """The result of a candidate that is not simulated."""
    incumbent = pruned.incumbent
    reason = (
        f"skipped: by estimate ({pruned.bound_s:.0f} s) it is slower than {incumbent.strategy} "
        f"({incumbent.finish_s:.0f} s)"
    )
    return PlanResult(strategy, tractors, context.request.turn, False, reason, bound_s=round(pruned.bound_s, 3))
