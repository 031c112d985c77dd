"""The route of estimates: what a plan job would answer, at once and not driven."""

from __future__ import annotations

from typing import Any

from fastapi import Request
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from planner.service.access.permissions import PlanAccess
from planner.service.gateway.responses import ApiModel, ApiRouter
from planner.service.jobs.file_reading import build_client_queue_key
from planner.service.jobs.input_files import collect_inputs
from planner.service.jobs.job_requests import PLAN_JOB_MODEL
from planner.service.jobs.plan_estimates import PlanEstimator

estimate_router = ApiRouter(prefix="/estimates", tags=["plans"])
EstimateRequest: Any = PLAN_JOB_MODEL


class EstimatedPlan(ApiModel):
    """The plan of one number of tractors, estimated; where it is not possible, `reason` says why.

    `done_s` is the end of field work, seconds after the start by the clock, and `end` the same as hh:mm where there is
    a start; `finished_s` has the time for ground that is left as well.
    """

    tractors: int
    feasible: bool
    reason: str | None = None
    time_s: float | None = None
    finished_s: float | None = None
    done_s: float | None = None
    end: str | None = None
    cost: float | None = None
    worked_pct: float | None = None
    in_time: bool | None = None


class EstimateInfo(ApiModel):
    """Plans by their number of tractors, the one to take, and the layout: bearing in degrees, headland passes.

    Where `is_layout_borrowed`, the layout is that of another width, and a plan may choose a better one.
    """

    recommended: int | None = Field(description="Number of tractors of the plan to take; null where none is possible.")
    plans: list[EstimatedPlan]
    currency: str | None
    width: float
    bearing: float
    headland_passes: int
    is_layout_borrowed: bool


@estimate_router.post("", operation_id="estimate_plan")
async def estimate_plan(request: Request, caller: PlanAccess, body: EstimateRequest) -> EstimateInfo:
    """Estimate plans without driving them; nothing is stored. It takes what a plan job takes."""
    estimator: PlanEstimator = request.app.state.estimator
    values, inputs = await run_in_threadpool(collect_inputs, request.app.state.store, body)
    return EstimateInfo(**await estimator.estimate(build_client_queue_key(request, caller), values, inputs))
