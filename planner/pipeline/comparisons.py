"""Fields planned in several ways to compare: ways to work the headland, and bearings on slopes.

Each pair of a field and a way is a task of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import product

from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.slopes import measure_cross_slope, measure_fall_line_share
from planner.errors import HeadlandError, RequestError, mark_parameter
from planner.evaluation.context import PlanningContext
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import collect_answers
from planner.pipeline.many_fields import FieldQuestion, draw_best_plan, plan_here
from planner.pipeline.ranking import locate_cut_off_ground
from planner.pipeline.worker_tasks import Progress
from planner.request.option_checks import FULL_CIRCLE_DEG
from planner.request.plan_request import CONTOUR, HEADLAND_ORDERS_BY_OPERATION, STRAIGHT, PlanRequest
from reports.plan.bearing_report import BearingComparison, BearingRow
from reports.plan.headland_comparison import ComparedPlan, HeadlandChoice, HeadlandComparison
from reports.plan.plan_wording import describe_machines
from strategies.path_planning.turn_kinds import CORNERS

USUAL_BEARINGS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
MAX_BEARINGS = 36


@dataclass(frozen=True)
class HeadlandChoices:
    """Lists of what to compare; empty lists leave the default: all kinds of corners, and what the work allows.

    Every corner is combined with every order and number of passes; the width is that of the request.
    """

    corners: tuple[str, ...] = ()
    orders: tuple[str, ...] = ()
    passes: tuple[int, ...] = ()

    def list_requests(self, request: PlanRequest) -> list[PlanRequest]:
        """The request with every way to work the headland. Raises RequestError for values that cannot be planned."""
        orders = self.orders or HEADLAND_ORDERS_BY_OPERATION[request.operation]
        return [
            replace(request, corners=corners, headland_order=order, headland_passes=passes)
            for corners, order, passes in product(self.corners or CORNERS, orders, self.passes or (None,))
        ]


def list_headland_questions(
    orders: Iterable[WorkOrder], choices: HeadlandChoices, *, with_maps: bool = False, simulate_all: bool = False
) -> list[FieldQuestion]:
    """Every field with every way to work its headland, field by field. Raises RequestError."""
    return [
        FieldQuestion(replace(each, request=request), simulate_all, with_maps)
        for each in orders
        for request in choices.list_requests(each.request)
    ]


def answer_headland_question(
    question: FieldQuestion, describe_refusal: Callable[[HeadlandError], str] = str
) -> ComparedPlan:
    """Plan one field with one way to work its headland, in the current process."""
    request = question.order.request
    choice = HeadlandChoice(request.corners, request.headland_order, request.headland_passes, request.width_m)
    try:
        result = plan_here(question.order, question.simulate_all)
    except HeadlandError as refusal:
        return ComparedPlan(request.field_name, choice, refusal=describe_refusal(refusal))
    ranking = result.ranking
    best = ranking.best
    return ComparedPlan(
        request.field_name,
        choice,
        plan=best,
        refusal=None if best is not None else ranking.refusal,
        field_name=ranking.field_name,
        area_ha=ranking.area_ha,
        headland_m=result.context.layout.headland_m,
        currency=ranking.currency,
        machines=describe_machines(ranking),
        remarks=tuple(result.context.layout.field.remarks),
        meets_request=ranking.is_recommended,
        parts=ranking.parts,
        cut_off=locate_cut_off_ground(result.context.layout.field),
        map=draw_best_plan(result) if question.with_map else None,
    )


def compare_headlands(
    questions: Sequence[FieldQuestion],
    executor: Executor,
    progress: Progress | None = None,
    describe_refusal: Callable[[HeadlandError], str] = str,
) -> HeadlandComparison:
    """Answer all questions on an executor; `progress` is called with (done, total).

    A way that cannot be planned has its reason, as `describe_refusal` words it. Raises WorkerError if processes keep
    ending.
    """
    tasks = [(question, describe_refusal) for question in questions]
    return HeadlandComparison(tuple(collect_answers(executor, answer_headland_question, tasks, progress)))


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


def measure_layout_slopes(context: PlanningContext) -> tuple[float, float]:
    """The largest slope across swaths (m/m), and the share of their metres near the fall line of steeper ground.

    Raises RequestError without heights.
    """
    terrain = context.physics.terrain
    if terrain is None:
        raise RequestError(
            f"Bearings are compared on slopes, and no heights are known; give {mark_parameter('elevation')}.",
            parameter="elevation",
        )
    grid = ElevationGrid(terrain.west_m, terrain.south_m, terrain.spacing_m, terrain.heights_m)
    lines = [swath.points_m for swath in context.layout.swaths]
    return measure_cross_slope(lines, grid), measure_fall_line_share(lines, grid)


def plan_bearing(order: WorkOrder) -> BearingRow | HeadlandError:
    """The best plan of one request of a comparison, or its refusal, in the current process."""
    request = order.request
    try:
        result = plan_here(order)
    except HeadlandError as refusal:
        return refusal
    context, best = result.context, result.ranking.best
    cross_slope, erosion_share = measure_layout_slopes(context)
    reason = next((plan.reason for plan in result.ranking.plans if plan.reason), None)
    return BearingRow(
        request.bearing_deg,
        request.swaths,
        context.layout.bearing_deg,
        100.0 * cross_slope,
        erosion_share,
        best,
        None if best is not None else reason or "no plan is feasible",
        is_chosen=request.bearing_deg is None and request.swaths == STRAIGHT,
    )


def compare_bearings(
    orders: Sequence[WorkOrder],
    executor: Executor,
    progress: Progress | None = None,
    describe_refusal: Callable[[HeadlandError], str] = str,
) -> BearingComparison:
    """Plan every request of a comparison on an executor; `progress` is called with (done, total).

    `describe_refusal` words why a request cannot be planned. Raises RequestError without heights, the refusal that all
    requests share, as it is of the field or its heights, and WorkerError if processes keep ending.
    """
    answers = collect_answers(executor, plan_bearing, [(each,) for each in orders], progress)
    refusals = [answer for answer in answers if isinstance(answer, HeadlandError)]
    if len(refusals) == len(orders) and len({str(refusal) for refusal in refusals}) == 1:
        raise refusals[0]
    rows = tuple(
        BearingRow(each.request.bearing_deg, each.request.swaths, reason=describe_refusal(answer))
        if isinstance(answer, HeadlandError)
        else answer
        for each, answer in zip(orders, answers, strict=True)
    )
    return BearingComparison(orders[0].request.field_name, rows)
