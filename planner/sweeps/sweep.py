"""A sweep: a plan is estimated for every combination of some options, on any executor.

Combinations that share a layout are a task, which lays the ground out once; answers are cached by task. `Sweep` is what
commands and the service run, `sweep` what programs call.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from itertools import groupby
from typing import TYPE_CHECKING, Any

import reports.sweep.report  # noqa: F401  # how a sweep is shown
from planner.errors import HeadlandError, RequestError, mark_parameter
from planner.evaluation.preparation import check_machine_and_soil, prepare_context, read_planned_field
from planner.evaluation.site import recall
from planner.evaluation.work_order import FieldChoice, WorkOrder
from planner.pipeline.executors import collect_answers, create_executor, iter_completed
from planner.pipeline.many_fields import hash_order
from planner.pipeline.outcome_cache import pack_results, unpack_results
from planner.pipeline.result_cache import NO_CACHE, ResultCache
from planner.pipeline.worker_tasks import Progress, pack_context, unpack_context
from planner.request.option_texts import format_clock
from planner.request.parameter_names import UNLAID, WISHES
from planner.request.plan_request import PlanRequest
from planner.risk.costs import CostTerms, are_prices_given, choose_terms
from planner.sweeps.axes import CLOCKS, Axis, list_points, read_axes
from planner.sweeps.estimates import STRATEGY, SUMMED, GroundEstimates
from reports.common.plan_results import PlanResult
from reports.sweep.results import SweepResult, SweptOption, SweptPlan
from strategies.rules.supply import Supply
from vehicle.model.tractor import Implement

if TYPE_CHECKING:
    from pandas import DataFrame

MOST_GROUNDS_AT_ONCE = 32  # laid out before they are estimated: enough for all processes, few enough to hold
_ADDED = (
    "time_s", "tractor_time_s", "cost", "missed_m2", "finished_s", "finished_cost", "turning_s",
    "fuel_l", "energy_kwh", "co2_kg",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class EstimateTask:
    """The orders of one number of tractors on one ground.

    Attributes:
        numbers: of the combinations.
        orders: their orders, in the same sequence.
        reference: the order whose layout they share, at a middling speed; the same for all numbers of tractors.
    """

    numbers: tuple[int, ...]
    orders: tuple[WorkOrder, ...]
    reference: WorkOrder

    def hash(self) -> str:
        """What the answer depends on."""
        requests = ";".join(repr(order) for order in self.orders)
        return sha256(f"{hash_order(self.reference)}{requests}".encode()).hexdigest()


def build_tasks(axes: Sequence[Axis], build_order: Callable[[Mapping[str, Any]], WorkOrder]) -> list[EstimateTask]:
    """A task for every number of tractors on every ground, the largest first: it takes longest.

    `build_order` makes the order of the parameters of a combination. Raises HeadlandError.
    """
    by_ground: dict[tuple[int, ...], dict[int, WorkOrder]] = {}
    places = [place for place, axis in enumerate(axes) if axis.parameter not in SUMMED]
    for number, values in enumerate(list_points(axes)):
        parameters = {axis.parameter: axis.values[place] for axis, place in zip(axes, values, strict=True)}
        of_ground = by_ground.setdefault(tuple(values[place] for place in places), {})
        of_ground[number] = build_order(parameters)
    tasks = []
    for orders in by_ground.values():
        middle = sorted(orders.values(), key=lambda order: order.request.speed_mps)[len(orders) // 2]
        for count in sorted({order.request.tractors for order in orders.values()}, reverse=True):
            numbers = tuple(number for number, order in orders.items() if order.request.tractors == count)
            tasks.append(EstimateTask(numbers, tuple(orders[number] for number in numbers), middle))
    return tasks


def lay_out_ground(reference: WorkOrder) -> bytes | HeadlandError:
    """The packed context of an order, or why the ground cannot be laid out."""
    try:
        return pack_context(prepare_context(reference))
    except HeadlandError as refusal:
        return refusal


def estimate_task(orders: Sequence[WorkOrder], ground: bytes) -> list[PlanResult]:
    """The plans of orders on one ground."""
    context = unpack_context(ground)
    estimates = recall(context, GroundEstimates, lambda: GroundEstimates(context))
    return [estimates.estimate(one) for one in orders]


def iter_plans(
    tasks: Sequence[EstimateTask],
    executor: Executor,
    cache: ResultCache,
    describe_refusal: Callable[[HeadlandError], str] = str,
) -> Iterator[tuple[int, int, PlanResult]]:
    """Yield the plans of all tasks, each with the number of its task and of its combination.

    Those known come at once, others as they are estimated: each ground is laid out once, then its tasks follow. Where
    no ground can be laid out the reason of the first is raised, a HeadlandError.
    """
    keys = [task.hash() for task in tasks]
    missing, refusals = list[int](), list[HeadlandError]()
    for place, (task, key) in enumerate(zip(tasks, keys, strict=True)):
        known = cache.read(key)
        if known is None:
            missing.append(place)
        else:
            plans = unpack_results(known["plans"])
            yield from ((place, number, plan) for number, plan in zip(task.numbers, plans, strict=True))
    grounds = [list(group) for _, group in groupby(missing, key=lambda place: id(tasks[place].reference))]
    for first in range(0, len(grounds), MOST_GROUNDS_AT_ONCE):
        some, laid_out = grounds[first : first + MOST_GROUNDS_AT_ONCE], list[tuple[int, bytes]]()
        references = [(tasks[places[0]].reference,) for places in some]
        for places, ground in zip(some, collect_answers(executor, lay_out_ground, references), strict=True):
            if isinstance(ground, bytes):
                laid_out += [(place, ground) for place in places]
                continue
            refusals.append(ground)
            reason = describe_refusal(ground)
            for place in places:
                for number, one in zip(tasks[place].numbers, tasks[place].orders, strict=True):
                    count, turn = one.request.tractors[0], one.request.turn
                    yield place, number, PlanResult(STRATEGY.name, count, turn, False, reason, is_simulated=False)
        arguments = [(tasks[place].orders, ground) for place, ground in laid_out]
        for number, plans in iter_completed(executor, estimate_task, arguments, from_both_ends=True):
            place, _ = laid_out[number]
            cache.write(keys[place], {"plans": pack_results(plans)})
            numbers = tasks[place].numbers
            yield from ((place, combination, plan) for combination, plan in zip(numbers, plans, strict=True))
    if refusals and len(missing) == len(tasks) and len(refusals) == len(grounds):
        raise refusals[0]


@dataclass(eq=False)
class Sweep:
    """A sweep over one field or several, and the plans that are known of it so far; raises HeadlandError.

    Attributes:
        axes: what is varied.
        fields: the fields, as requests name them.
        build_order: makes the order of a field and the parameters of a combination.
        command: what plans one combination, without the varied options and the field.
        link: the form of a service with what is not varied; "" without a service.
    """

    axes: tuple[Axis, ...]
    fields: tuple[str, ...]
    build_order: Callable[[str, Mapping[str, Any]], WorkOrder]
    command: tuple[str, ...] = ()
    link: str = ""

    def __post_init__(self) -> None:
        self._points = list(list_points(self.axes))
        self._tasks = [build_tasks(self.axes, partial(self.build_order, name)) for name in self.fields]
        self._found: list[dict[int, PlanResult]] = [{} for _ in self.fields]
        references = [task.reference for of_field in self._tasks for task in of_field]
        for one in {(each.request.tractor, each.request.soil): each for each in references}.values():
            check_machine_and_soil(one)
        varied = [axis.option.name for axis in self.axes if axis.parameter not in UNLAID and len(axis.values) > 1]
        if self._tasks[0][0].reference.request.line_wishes and (varied or len(self.fields) > 1):
            several = varied[0].replace("_", " ") if varied else "field"
            raise RequestError(
                f"Every {several} of a sweep numbers its tracks anew, and single tracks are wanted; give one, "
                f"or none of {', '.join(map(mark_parameter, WISHES))}."
            )

    @property
    def total(self) -> int:
        """The number of combinations, with several fields on each."""
        return len(self._points) * len(self.fields)

    @property
    def done(self) -> int:
        """How many of them are known so far."""
        return sum(map(len, self._found))

    def build_point_order(self, numbers: Sequence[int]) -> WorkOrder:
        """The order of a combination on the first field, to be driven in full."""
        return self.build_order(self.fields[0], self._get_parameters(numbers))

    def run(
        self,
        executor: Executor | None = None,
        cache: ResultCache = NO_CACHE,
        progress: Progress | None = None,
        describe_refusal: Callable[[HeadlandError], str] = str,
        processes: int | None = None,
    ) -> None:
        """Estimate what is not known yet; after each task `progress` is called with (done, total). Raises
        HeadlandError.

        What is found before an exception, such as Ctrl-C, stays: `build_result` shows it.
        """
        with ExitStack() as opened:
            every = [task for of_field in self._tasks for task in of_field]
            executor = executor or opened.enter_context(create_executor(len(every), processes))
            owners = [place for place, of_field in enumerate(self._tasks) for _ in of_field]
            for place, number, plan in iter_plans(every, executor, cache, describe_refusal):
                found = self._found[owners[place]]
                found[number] = plan
                if progress is not None and number == every[place].numbers[-1]:
                    progress(self.done, self.total)

    def build_result(self) -> SweepResult:
        """The plans known so far; of several fields those that are known of all. Raises HeadlandError for a field."""
        orders = [self.build_order(name, self._get_parameters(self._points[0])) for name in self.fields]
        read = [read_planned_field(order) for order in orders]
        first, request = orders[0], orders[0].request
        terms = choose_terms(request, first.cost_terms)
        numbers = [number for number in range(len(self._points)) if all(number in found for found in self._found)]
        areas_ha = [field.area_ha for field in read]
        clocks = [
            {name: at for name, at in self._get_parameters(self._points[number]).items() if name in CLOCKS}
            for number in numbers
        ]
        limits_s = [replace(request, **clock).time_limit_s for clock in clocks]
        plans = [
            join_fields([found[number] for found in self._found], areas_ha, limit_s)
            for number, limit_s in zip(numbers, limits_s, strict=True)
        ]
        names = [field.name for field in read]
        by_field = {
            name if names.count(name) == 1 else f"{name} ({place})": tuple(
                SweptPlan(self._points[number], found[number]) for number in numbers
            )
            for place, (name, found) in enumerate(zip(names, self._found, strict=True), start=1)
        }
        is_start_swept = any(axis.parameter == "start_s" for axis in self.axes)
        return SweepResult(
            field_name=" + ".join(field.name for field in read) if len(read) < 4 else f"{len(read)} fields",
            area_ha=math.fsum(areas_ha),
            options=tuple(build_option(one) for one in self.axes),
            plans=tuple(SweptPlan(self._points[number], plan) for number, plan in zip(numbers, plans, strict=True)),
            total=len(self._points),
            currency=terms.prices.currency,
            start=None if request.start_s is None or is_start_swept else format_clock(request.start_s),
            allowed_s=limits_s[0] if len(set(limits_s)) == 1 else None,
            is_priced=are_prices_given(request, first.cost_terms),
            by_field=by_field if len(read) > 1 else {},
            command=(*self.command, *self.fields),
            link=self.link,
        )

    def _get_parameters(self, numbers: Sequence[int]) -> dict[str, Any]:
        return {axis.parameter: axis.values[number] for axis, number in zip(self.axes, numbers, strict=True)}


def build_option(axis: Axis) -> SweptOption:
    """An axis as reports know it."""
    option, limits = axis.option, axis.option.limits
    label = option.name.replace("_", " ") if limits is None or not limits.label else limits.label
    is_converted = limits is not None and limits.scale != 1.0
    column = option.name if is_converted or option.parameter.endswith("_s") else option.parameter
    return SweptOption(column, option.name, axis.written, label, "" if limits is None else limits.unit)


def join_fields(plans: Sequence[PlanResult], areas_ha: Sequence[float], limit_s: float | None = None) -> PlanResult:
    """The plans of several fields worked one after another by the same fleet; refused where one is.

    Work in all of them together takes at most `limit_s` or is late. Roads between fields and breaks are not in it.
    """
    if len(plans) == 1:
        return plans[0]
    refused = next((plan for plan in plans if not plan.feasible), None)
    if refused is not None:
        return refused
    amounts = {name: [getattr(plan, name) for plan in plans] for name in _ADDED}
    sums: dict[str, Any] = {name: None if None in some else math.fsum(some) for name, some in amounts.items()}
    clock: dict[str, Any] = dict.fromkeys(("ready_s", "home_s", "finished_done_s", "transport_s"))
    worked_ha = math.fsum(area_ha * (plan.worked_pct or 0.0) for plan, area_ha in zip(plans, areas_ha, strict=True))
    return replace(
        plans[0],
        **sums,
        **clock,
        done_s=sums["time_s"],
        worked_pct=worked_ha / math.fsum(areas_ha),
        works_enough=all(plan.works_enough for plan in plans),
        meets_deadline=None if limit_s is None else sums["time_s"] <= limit_s,
        uncertainty_pct=max(plan.uncertainty_pct for plan in plans if plan.uncertainty_pct is not None),
        fuel_l_by_tractor=None,
        energy_kwh_by_tractor=None,
        fuel_l_per_ha=None,
        energy_kwh_per_ha=None,
    )


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
