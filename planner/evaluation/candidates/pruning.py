"""Which plans are not composed or not driven, because they are likely to lose to the incumbent even if nobody waits.

The incumbent is the plan that others with as many tractors have to beat.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from planner.evaluation.context import PlanningContext
from planner.request.plan_request import LEAST_FUEL, SUREST
from reports.common.plan_results import PlanResult


def prunes_candidates(context: PlanningContext) -> bool:
    """Whether only what may be the quickest plan of its number of tractors is driven.

    Not where the surest plan or that of least fuel is requested: a slower plan may be that.
    """
    return context.criteria is None or context.criteria.objective not in (SUREST, LEAST_FUEL)


def find_incumbent(results: Iterable[PlanResult]) -> PlanResult | None:
    """The quickest feasible plan of one number of tractors that works enough of the ground; None without any."""
    feasible = [one for one in results if one.feasible and one.works_enough]
    return min(
        feasible,
        key=lambda one: (not one.keeps_clearance, round(one.finished_field_s, 3), one.strategy),
        default=None,
    )


def estimate_loss_s(context: PlanningContext, tractor_s: Sequence[float], incumbent: PlanResult | None) -> float | None:
    """About the least seconds of a plan that is likely to lose, given those of its tractors; None if it might win.

    It is taken to leave as much ground. Where the use of machines counts, less time of all together may be enough.
    """
    if incumbent is None or max(tractor_s) * incumbent.left_factor <= incumbent.finished_field_s:
        return None
    counts_use = context.criteria is not None and context.criteria.counts_use
    if counts_use and math.fsum(tractor_s) < (incumbent.tractor_time_s or 0.0):
        return None
    return max(tractor_s)


def describe_loss(bound_s: float, incumbent: PlanResult) -> str:
    """Why a candidate is not simulated whose plans all take about so many seconds or more."""
    best = f"{incumbent.strategy} ({incumbent.finished_field_s:.0f} s)"
    return f"skipped: by estimate ({bound_s:.0f} s) it is slower than {best}"


def describe_nearness(nearness_m: float, clearance_m: float, incumbent: PlanResult) -> str:
    """Why a candidate is not simulated whose tractors would work neighbouring tracks beside each other."""
    return (
        f"with errors of guidance, machines on neighbouring tracks may come within {nearness_m:.2f} m of each other, "
        f"less than the clearance of {clearance_m:g} m, which {incumbent.strategy} keeps"
    )
