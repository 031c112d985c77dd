"""Fields planned with several ways to work the headland, each pair of field and way a task of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, replace
from itertools import product

from planner.errors import HeadlandError, WorkerError
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import iter_completed
from planner.pipeline.many_fields import draw_best_plan, plan_here
from planner.pipeline.ranking import locate_cut_off_ground
from planner.pipeline.worker_tasks import LOST_WORKER_MESSAGE, Progress
from planner.request.plan_request import HEADLAND_ORDERS_BY_OPERATION, PlanRequest
from reports.plan.headland_comparison import ComparedPlan, HeadlandChoice, HeadlandComparison
from reports.plan.plan_wording import describe_machines
from strategies.path_planning.turn_kinds import CORNERS


@dataclass(frozen=True)
class HeadlandChoices:
    """Lists of what to compare; empty lists leave the default: all kinds of corners, and what the work allows.

    Every corner is combined with every order and number of passes; the width is that of the request.
    """

    corners: tuple[str, ...] = ()
    orders: tuple[str, ...] = ()
    passes: tuple[int, ...] = ()

    def list_requests(self, request: PlanRequest) -> list[tuple[HeadlandChoice, PlanRequest]]:
        """The request with every way to work the headland. Raises RequestError for values that cannot be planned."""
        orders = self.orders or HEADLAND_ORDERS_BY_OPERATION[request.operation]
        ways = [
            HeadlandChoice(*values, request.width_m)
            for values in product(self.corners or CORNERS, orders, self.passes or (None,))
        ]
        return [
            (
                way,
                replace(request, corners=way.corners, headland_order=way.order, headland_passes=way.passes),
            )
            for way in ways
        ]


@dataclass(frozen=True, eq=False)
class HeadlandQuestion:
    """A field with the order of its plans, whose request has the way to work the headland; with a map if asked for."""

    order: WorkOrder
    choice: HeadlandChoice
    with_map: bool = False
    simulate_all: bool = False


def list_headland_questions(
    orders: Iterable[WorkOrder], choices: HeadlandChoices, *, with_maps: bool = False, simulate_all: bool = False
) -> list[HeadlandQuestion]:
    """Every field with every way to work its headland, field by field. Raises RequestError."""
    return [
        HeadlandQuestion(replace(each, request=request), choice, with_maps, simulate_all)
        for each in orders
        for choice, request in choices.list_requests(each.request)
    ]


def answer_headland_question(
    question: HeadlandQuestion, describe_refusal: Callable[[HeadlandError], str] = str
) -> ComparedPlan:
    """Plan one field with one way to work its headland, in the current process."""
    name, choice = question.order.request.field_name, question.choice
    try:
        result = plan_here(question.order, question.simulate_all)
    except HeadlandError as refusal:
        return ComparedPlan(name, choice, refusal=describe_refusal(refusal))
    ranking = result.ranking
    best = ranking.best
    return ComparedPlan(
        name,
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
    questions: Sequence[HeadlandQuestion],
    executor: Executor,
    progress: Progress | None = None,
    describe_refusal: Callable[[HeadlandError], str] = str,
) -> HeadlandComparison:
    """Answer all questions on an executor; `progress` is called with (done, total).

    A way that cannot be planned has its reason, as `describe_refusal` words it. Raises WorkerError if processes keep
    ending.
    """
    answers: dict[int, ComparedPlan] = {}
    tasks = [(question, describe_refusal) for question in questions]
    try:
        for position, answer in iter_completed(executor, answer_headland_question, tasks):
            answers[position] = answer
            if progress:
                progress(len(answers), len(questions))
    except BrokenExecutor:
        raise WorkerError(LOST_WORKER_MESSAGE) from None
    return HeadlandComparison(tuple(answers[position] for position in range(len(questions))))
