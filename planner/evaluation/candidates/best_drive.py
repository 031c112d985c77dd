"""Which of several sketched plans is driven best: composed, driven and compared one after another.

Those are not composed, or not driven, that are likely to lose to the incumbent even if nobody waits: the plan that
others with as many tractors have to beat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from planner.evaluation.candidates.line_programme import ComposedPlan, SketchedPlan, does_wait, weigh_order_s
from planner.evaluation.context import PlanningContext
from planner.request.plan_request import LEAST_FUEL, SUREST
from reports.common.plan_results import PlanResult
from strategies.path_planning.errors import StrategyError

MOST_DRIVES = 4  # of a plan that is composed anew with what its tractors waited charged
Driven = TypeVar("Driven")


def drive_best(
    sketches: Sequence[SketchedPlan],
    measure_alone_s: Callable[[ComposedPlan], list[float]],
    drive: Callable[[ComposedPlan], tuple[Driven, float]],
    find_loss_s: Callable[[Sequence[float]], float | None] = lambda _: None,
    compose_anew: Callable[[ComposedPlan, Driven], ComposedPlan | None] = lambda *_: None,
) -> Driven | float:
    """What came of driving the best plan by `weigh_order_s`; of those that cannot be driven the first if none can.

    The least seconds that `find_loss_s` gives instead if that rules out all others by the seconds of their tractors.
    `drive` gives what comes of a plan and its seconds, infinite if it cannot be driven; `measure_alone_s` those of each
    tractor with nobody in its way.

    Another order of headland and swaths is driven only where it would be better than what was driven before, if
    nobody waited. Where somebody did, `compose_anew` composes the plan with that charged; if it does not help, or
    cannot, what is left is shared otherwise. Raises StrategyError if no plan can be composed.
    """
    best, best_s = list[Driven](), math.inf
    losers, refusals, waiting = list[float](), list[StrategyError](), list(sketches)
    for sketch in waiting:
        if weigh_order_s(sketch.order, max(sketch.tractor_s)) >= best_s:
            continue
        try:
            composed = _compose_unless_lost(sketch, measure_alone_s, find_loss_s)
        except StrategyError as refusal:
            refusals.append(refusal)
            continue
        if isinstance(composed, float):
            losers.append(composed)
            continue
        drives, waits = _drive_waiting_less(composed, measure_alone_s, drive, compose_anew, best_s)
        for driven, weighed_s in drives:
            if not best or weighed_s < best_s:
                best, best_s = [driven], weighed_s
        if waits and sketch.sketch_others is not None:
            waiting += sketch.sketch_others()
    if losers and math.isinf(best_s):
        return min(losers)
    if not best:
        raise refusals[0]
    return best[0]


def _drive_waiting_less(
    composed: ComposedPlan,
    measure_alone_s: Callable[[ComposedPlan], list[float]],
    drive: Callable[[ComposedPlan], tuple[Driven, float]],
    compose_anew: Callable[[ComposedPlan, Driven], ComposedPlan | None],
    most_s: float,
) -> tuple[list[tuple[Driven, float]], bool]:
    """Drives of a plan, composed anew as long as its tractors wait, each with its weighed seconds; whether they wait in
    the last.

    What could not be done in less than `most_s` is not driven.
    """
    drives = list[tuple[Driven, float]]()
    for number in range(MOST_DRIVES):
        anew = compose_anew(composed, drives[-1][0]) if number else composed
        if anew is None:
            break
        composed, alone_s = anew, max(measure_alone_s(anew)) * anew.left_factor
        if weigh_order_s(composed.order, alone_s) >= most_s:
            return drives, False
        driven, driven_s = drive(composed)
        drives.append((driven, weigh_order_s(composed.order, driven_s * composed.left_factor)))
        most_s = min(most_s, drives[-1][1])
        if not does_wait(driven_s * composed.left_factor, alone_s):
            return drives, False
    return drives, True


def _compose_unless_lost(
    sketch: SketchedPlan,
    measure_alone_s: Callable[[ComposedPlan], list[float]],
    find_loss_s: Callable[[Sequence[float]], float | None],
) -> ComposedPlan | float:
    """The composed plan, or the seconds by which it is likely to lose: as sketched, composed, or driven alone."""
    loss_s = find_loss_s(sketch.tractor_s)
    if loss_s is not None:
        return loss_s
    composed = sketch.compose()
    loss_s = find_loss_s(composed.least_s)
    if loss_s is None:
        loss_s = find_loss_s(measure_alone_s(composed))
    return composed if loss_s is None else loss_s


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
