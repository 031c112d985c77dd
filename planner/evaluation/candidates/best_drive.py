"""Which of several sketched plans is driven best: composed, driven and compared one after another."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from planner.evaluation.candidates.line_programme import ComposedPlan, SketchedPlan, weigh_order_s
from strategies.path_planning.errors import StrategyError

WAITED_SHARE = 1.01  # of the time of a plan whose tractors have nobody to give way to
Driven = TypeVar("Driven")


def _find_no_loss_s(_: Sequence[float]) -> float | None:
    return None


def drive_best(
    sketches: Sequence[SketchedPlan],
    measure_alone_s: Callable[[ComposedPlan], list[float]],
    drive: Callable[[ComposedPlan], tuple[Driven, float]],
    find_loss_s: Callable[[Sequence[float]], float | None] = _find_no_loss_s,
) -> Driven | float:
    """What came of driving the best plan by `weigh_order_s`; of those that cannot be driven the first if none can.

    The least seconds that `find_loss_s` gives instead if that rules out all others by the seconds of their tractors.
    `drive` gives what comes of a plan and its seconds, infinite if it cannot be driven; `measure_alone_s` those of each
    tractor with nobody in its way.

    Another order of headland and swaths is driven only where it would be better than what was driven before, if
    nobody waited; where somebody did, tractors that work apart, or as they did before, are tried too. Raises
    StrategyError if no plan can be composed.
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
        alone_s = max(measure_alone_s(composed)) * composed.left_factor
        if best and weigh_order_s(composed.order, alone_s) >= best_s:
            continue
        driven, driven_s = drive(composed)
        seconds = driven_s * composed.left_factor
        if sketch.sketch_apart is not None and seconds > WAITED_SHARE * alone_s:
            waiting += sketch.sketch_apart(composed.programme.left_m2)
        weighed_s = weigh_order_s(composed.order, seconds)
        if not best or weighed_s < best_s:
            best, best_s = [driven], weighed_s
    if losers and math.isinf(best_s):
        return min(losers)
    if not best:
        raise refusals[0]
    return best[0]


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
