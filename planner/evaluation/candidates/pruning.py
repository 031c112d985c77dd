"""Which plans are not composed or not driven, because they lose to the incumbent even if nobody waits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from planner.evaluation.context import PlanningContext
from reports.common.plan_results import PlanResult


@dataclass(frozen=True)
class Incumbent:
    """The quickest feasible plan with as many tractors: its strategy and seconds to finish the field.

    `tractor_s` is the sum over its tractors, each until it is done.
    """

    strategy: str
    finish_s: float
    tractor_s: float = 0.0


@dataclass(frozen=True)
class PrunedCandidate:
    """A candidate whose plans all take about `bound_s` or more, longer than the incumbent."""

    bound_s: float
    incumbent: Incumbent


def prune_composed(
    context: PlanningContext, plans_tractor_s: Iterable[Sequence[float]], incumbent: Incumbent | None
) -> PrunedCandidate | None:
    """Plans as pruned by the incumbent, given the least seconds of their tractors; None if one might win.

    Of plans of which nothing is known any might.
    """
    if incumbent is None:
        return None
    bounds_s = list[float]()
    for tractor_s in plans_tractor_s:
        if _may_win(context, tractor_s, incumbent):
            return None
        bounds_s.append(max(tractor_s))
    return PrunedCandidate(min(bounds_s), incumbent) if bounds_s else None


def _may_win(context: PlanningContext, tractor_s: Sequence[float], incumbent: Incumbent) -> bool:
    """Whether tractors that take so long may beat the incumbent.

    Where risk or cost decides, less time of all tractors together may be enough.
    """
    uses_criteria = context.criteria is not None and context.criteria.decides_best
    return max(tractor_s) <= incumbent.finish_s or (uses_criteria and math.fsum(tractor_s) < incumbent.tractor_s)


def build_pruned_result(pruned: PrunedCandidate, context: PlanningContext, strategy: str, tractors: int) -> PlanResult:
    """The result of a candidate that is not simulated."""
    incumbent = pruned.incumbent
    reason = (
        f"skipped: by estimate ({pruned.bound_s:.0f} s) it is slower than {incumbent.strategy} "
        f"({incumbent.finish_s:.0f} s)"
    )
    return PlanResult(strategy, tractors, context.request.turn, False, reason, bound_s=round(pruned.bound_s, 3))
