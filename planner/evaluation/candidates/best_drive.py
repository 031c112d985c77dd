"""Which of several sketched plans is driven best: composed, driven and compared one after another."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from planner.evaluation.candidates.line_programme import ComposedPlan, SketchedPlan, does_wait, weigh_order_s
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
