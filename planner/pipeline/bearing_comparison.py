"""One field planned in several bearings, for what each means on its slopes: time, fuel, cross slope and erosion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import replace

from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.slopes import measure_cross_slope, measure_fall_line_share
from planner.errors import HeadlandError, RequestError, WorkerError, mark_parameter
from planner.evaluation.context import PlanningContext
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import iter_completed
from planner.pipeline.many_fields import plan_here
from planner.pipeline.worker_tasks import LOST_WORKER_MESSAGE, Progress
from planner.request.option_checks import FULL_CIRCLE_DEG
from planner.request.plan_request import CONTOUR, STRAIGHT, PlanRequest
from reports.plan.bearing_report import BearingComparison, BearingRow

USUAL_BEARINGS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
MAX_BEARINGS = 36


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
    answers: dict[int, BearingRow | HeadlandError] = {}
    try:
        for position, answer in iter_completed(executor, plan_bearing, [(each,) for each in orders]):
            answers[position] = answer
            if progress:
                progress(len(answers), len(orders))
    except BrokenExecutor:
        raise WorkerError(LOST_WORKER_MESSAGE) from None
    refusals = [answer for answer in answers.values() if isinstance(answer, HeadlandError)]
    if len(refusals) == len(orders) and len({str(refusal) for refusal in refusals}) == 1:
        raise refusals[0]
    rows = tuple(
        BearingRow(each.request.bearing_deg, each.request.swaths, reason=describe_refusal(answer))
        if isinstance(answer := answers[position], HeadlandError)
        else answer
        for position, each in enumerate(orders)
    )
    return BearingComparison(orders[0].request.field_name, rows)
