"""Fields planned in several ways to compare: ways to work the headland, and bearings on slopes.

Each pair of a field and a way is a task of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import product

from planner.errors import HeadlandError, RequestError, mark_parameter
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import collect_answers
from planner.pipeline.many_fields import FieldQuestion, answer_question
from planner.pipeline.worker_tasks import Progress
from planner.request.option_checks import FULL_CIRCLE_DEG
from planner.request.plan_request import CONTOUR, HEADLAND_ORDERS_BY_OPERATION, STRAIGHT, PlanRequest
from reports.common.rendering import pick_values
from reports.plan.comparison import WAY_KEYS, ComparedWay, WayComparison
from strategies.path_planning.turn_kinds import CORNERS

USUAL_BEARINGS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
MAX_BEARINGS = 36


def list_headland_requests(
    request: PlanRequest, corners: Sequence[str] = (), orders: Sequence[str] = (), passes: Sequence[int] = ()
) -> list[PlanRequest]:
    """The request with every way to work the headland: every corner with every order and number of passes.

    Empty lists leave the default: all kinds of corners, what the work allows, and as many passes as turns need. Raises
    RequestError for values that cannot be planned.
    """
    allowed = orders or HEADLAND_ORDERS_BY_OPERATION[request.operation]
    return [
        replace(request, corners=corner, headland_order=order, headland_passes=count)
        for corner, order, count in product(corners or CORNERS, allowed, passes or (None,))
    ]


def list_headland_questions(
    orders: Iterable[WorkOrder], *, with_maps: bool = False, simulate_all: bool = False
) -> list[FieldQuestion]:
    """Every order with its way to work the headland as label."""
    return [
        FieldQuestion(each, ComparedWay(**pick_values(each.request, WAY_KEYS)), simulate_all, with_maps, True)
        for each in orders
    ]


def compare_ways(
    questions: Sequence[FieldQuestion],
    executor: Executor,
    progress: Progress | None = None,
    describe_refusal: Callable[[HeadlandError], str] = str,
) -> WayComparison:
    """Plan every question on an executor; `progress` is called with (done, total).

    What cannot be planned has its reason, as `describe_refusal` words it. Raises WorkerError if processes keep ending.
    """
    tasks = [(question, describe_refusal) for question in questions]
    return WayComparison(tuple(collect_answers(executor, answer_question, tasks, progress)))


def list_bearing_requests(request: PlanRequest, bearings_deg: Sequence[float]) -> list[PlanRequest]:
    """The request with each bearing, with the bearing that planning chooses, and along contours, in this order.

    Raises RequestError for too many bearings, or one out of range.
    """
    if len(bearings_deg) > MAX_BEARINGS:
        raise RequestError(f"{len(bearings_deg)} bearings are more than one table holds; give {MAX_BEARINGS} at most.")
    for bearing in bearings_deg:
        if not abs(bearing) <= FULL_CIRCLE_DEG:
            raise RequestError(
                f"A bearing of {bearing:g} degrees is none; give {-FULL_CIRCLE_DEG:g} to {FULL_CIRCLE_DEG:g}."
            )
    return [
        *(replace(request, bearing_deg=bearing, swaths=STRAIGHT) for bearing in bearings_deg),
        replace(request, bearing_deg=None, swaths=STRAIGHT),
        replace(request, bearing_deg=None, swaths=CONTOUR),
    ]


def compare_bearings(
    orders: Sequence[WorkOrder],
    executor: Executor,
    progress: Progress | None = None,
    describe_refusal: Callable[[HeadlandError], str] = str,
) -> WayComparison:
    """Plan every request of `list_bearing_requests`; see `compare_ways`.

    Raises RequestError without heights, and the refusal that all requests share, as it is of the field or its heights.
    """
    labels = [ComparedWay(**pick_values(each.request, ("bearing_deg", "swaths"))) for each in orders]
    questions = [FieldQuestion(each, label, with_layout=True) for each, label in zip(orders, labels, strict=True)]
    comparison = compare_ways(questions, executor, progress, describe_refusal)
    refusals = {row.refusal for row in comparison.rows}
    if None not in refusals and len(refusals) == 1:
        raise RequestError(str(refusals.pop()))
    if all(row.layout is None or row.layout.cross_slope_pct is None for row in comparison.rows):
        raise RequestError(
            f"Bearings are compared on slopes, and no heights are known; give {mark_parameter('elevation')}.",
            parameter="elevation",
        )
    return comparison
