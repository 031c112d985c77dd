"""A sweep in Python: from a request and the values of some of its parameters to a table of plans."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import reports.sweep.report  # noqa: F401  # how a sweep is shown
from planner.evaluation.work_order import FieldChoice, WorkOrder
from planner.pipeline.worker_tasks import Progress
from planner.request.plan_request import PlanRequest
from planner.risk.costs import CostTerms
from planner.sweeps.axes import read_axes
from planner.sweeps.sweep import Sweep
from strategies.rules.supply import Supply
from vehicle.model.tractor import Implement

if TYPE_CHECKING:
    from pandas import DataFrame


def sweep(
    request: PlanRequest,
    *,
    field: FieldChoice = None,
    implement: Implement | None = None,
    cost_terms: CostTerms | None = None,
    supply: Supply | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    **values: Any,
) -> DataFrame:
    """Estimate a plan for every combination of some options, and return a table with a row for each.

    `values` are by the name of the option or of its parameter, in the unit that it says: `width=[3, 4.5],
    speed_kmh=range(6, 13), tractors="1-8", headland_order=["first", "last"]`; texts are read as `headland sweep` reads
    them. The other arguments are those of `plan`. The columns are the options, then seconds, cost, share worked, fuel,
    what it `lacks` of what was asked for, whether nothing beats the plan (`on_front`) and which one to take, or comes
    nearest (`is_best`); `frame.attrs["sweep"]` is the result that reports draw. Each number of tractors is driven once
    on each layout, at a speed in the middle of those swept, and its other rows follow from that by sums: a row changes
    a little with what else is swept. `plan` with the values of a row drives it. Raises HeadlandError.
    """
    if not isinstance(request, PlanRequest):
        raise TypeError(f"sweep() takes a PlanRequest, such as PlanRequest(field='denmark'), not {request!r:.60}.")
    if values.get("tractors") is None:
        values["tractors"] = list(request.tractors)
    axes = read_axes(values)

    def build_order(_: str, parameters: Mapping[str, Any]) -> WorkOrder:
        return WorkOrder(replace(request, **parameters), field, None, implement, None, cost_terms, supply)

    found = Sweep(axes, (request.field,), build_order)
    found.run(executor, progress=progress)
    result = found.build_result()
    frame = result.to_pandas()
    frame.attrs["sweep"] = result
    return frame
