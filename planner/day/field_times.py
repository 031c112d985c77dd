"""Field times: the quickest simulated plan of every fleet on every field, and their cache on disk.

The cache is keyed by content.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fields.geometry.field import Field
from planner.day.input_file import DayFile, get_fleet_machines, is_suitable
from planner.errors import HeadlandError
from planner.evaluation.field_physics import get_elevation_name
from planner.evaluation.time_share import TimeShare, TimeSpentError
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import FarmFile
from planner.pipeline.executors import SerialExecutor, iter_completed
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.pipeline.fingerprint import hash_content, hash_height_files, hash_sources, hash_strategies
from planner.pipeline.going_on import AllDoneError
from planner.pipeline.planning import plan_order
from planner.pipeline.result_cache import ResultCache
from planner.pipeline.worker_tasks import Progress
from planner.request.plan_request import PlanRequest
from planner.risk.leg_graph import LegConsumption, LegGraph, WaitLink, build_leg_graph, measure_leg_consumption
from planner.risk.planned_order import enforce_planned_order
from vehicle.model.tractor import Implement

DEFAULT_FIELD_MINUTES = 10.0  # several times what the hardest real parcels measured take
GRAPH_ARRAYS = {
    "tractor": np.int64, "group": np.int64, "kind": np.int64, "driven_s": np.float64, "worked_m": np.float64,
    "stand_s": np.float64,
}  # fmt: skip
PLAN_VALUES = ("strategy", "tractors", "time_s", "worked_pct", "missed_m2", "refills", "shortfall", "left_ha")
ANONYMOUS = "field"
ALL_DONE = "all of it is done already"
HEIGHT_PARAMETERS = ("elevation", "elevation_crs")


@dataclass(frozen=True, eq=False)
class FieldTime:
    """The quickest plan of a fleet on a field, within what counts as equally quick the one that works more.

    `graph` is None if there is no plan, for the reason in `reason`.

    If the implement has a load, `refills` is the number of service stops; a plan begins with full tanks, or with empty
    ones if it collects. `shortfall` says that the plan works too little of the field. `is_lasting` is False for a
    refusal of heights, whose sentence names files that may change, and where planning ran out of time: `cut_note` says
    so, and the plan is the best of those found by then. `left_ha` is the area of the field without what is done
    already; None where nothing is.
    """

    strategy: str = ""
    tractors: int = 0
    time_s: float = 0.0
    worked_pct: float | None = None
    missed_m2: float | None = None
    graph: LegGraph | None = None
    refills: int | None = None
    reason: str = ""
    shortfall: str = ""
    is_lasting: bool = True
    cut_note: str = ""
    left_ha: float | None = None


def hash_field_time_order(order: WorkOrder) -> str:
    """A hash of the inputs that determine a field time, without names, and without places where no heights are."""
    assert isinstance(order.field, Field)
    elevation_name = get_elevation_name(order.request, order.field)
    request = replace(order.request, field=ANONYMOUS, tractor=ANONYMOUS, elevation=None)
    nameless = replace(order.field, name=ANONYMOUS, source="", remarks=(), elevation=None)
    if elevation_name is None and not order.done:
        nameless = replace(nameless, crs=None, origin_m=(0.0, 0.0))
    sources = [one for one in order.done if isinstance(one, str)]
    files = hash_height_files(elevation_name), hash_strategies(request.strategies), hash_sources(sources)
    return hash_content(nameless, request, order.tractor, order.implement, order.supply, files)


def find_left_ha(field: Field, field_times: Iterable[FieldTime | None]) -> float:
    """The area of a field that is left to work, by the field times of any fleet; all of it where none knows."""
    known = (one.left_ha for one in field_times if one is not None and one.left_ha is not None)
    return next(known, field.area_ha)


FieldTimeTable = tuple[tuple[FieldTime | None, ...], ...]
"""By fleet and field; None if the fleet's implement is not suitable for the field."""


def build_field_time_orders(day: DayFile, farm: FarmFile, fields: Sequence[Field]) -> list[list[WorkOrder | None]]:
    """The simulations of a day, by fleet and field."""
    rows = []
    for fleet in day.fleets:
        tractor, implement = get_fleet_machines(fleet, farm)
        request = PlanRequest(tractor=tractor.name, tractors=(fleet.count,), strategies=day.strategies)
        plan_inputs = complete_request_by_farm(request, farm, {"tractor", "tractors"}, implement_name=implement.name)
        unpriced = replace(plan_inputs.request, price_per_hour=0.0, price_per_tractor=0.0)
        machine = plan_inputs.resolve_tractor()
        plan_implement = plan_inputs.implement or Implement()
        rows.append(
            [
                WorkOrder(
                    replace(unpriced, field=field.name, elevation_crs=day_field.elevation_crs),
                    field,
                    machine,
                    plan_implement,
                    supply=plan_inputs.supply,
                    done=day_field.done,
                    from_road=True,
                )
                if is_suitable(day_field, implement)
                else None
                for day_field, field in zip(day.fields, fields, strict=True)
            ]
        )
    return rows


def compute_field_times(
    rows: Sequence[Sequence[WorkOrder | None]],
    cache: ResultCache,
    executor: Executor,
    progress: Progress | None = None,
    field_minutes: float = DEFAULT_FIELD_MINUTES,
    report_work: Callable[[list[str]], None] = lambda names: None,
) -> tuple[FieldTimeTable, bool]:
    """All field times, and whether new ones could be cached.

    Cached times are not simulated again, and equal orders of several fleets only once. `progress` is called with (done,
    all), `report_work` with the names of the fields at work. A fleet's plan of a field takes at most about
    `field_minutes` of computing; but for plans that this cuts short, the result depends on neither executor nor cache.
    """
    keys = [[None if order is None else hash_field_time_order(order) for order in row] for row in rows]
    order_by_key = {
        key: order
        for names, row in zip(keys, rows, strict=True)
        for key, order in zip(names, row, strict=True)
        if key is not None and order is not None
    }
    known_times = {key: _unpack_field_time(content) for key in order_by_key if (content := cache.read(key)) is not None}
    missing_keys = [key for key in order_by_key if key not in known_times]
    is_cached = True
    missing_calls = [(order_by_key[key], field_minutes) for key in missing_keys]

    def report_fields(indices: list[int]) -> None:
        report_work([missing_calls[index][0].request.field_name for index in indices])

    for done, (index, field_time) in enumerate(
        iter_completed(executor, compute_field_time, missing_calls, report_fields), start=1
    ):
        known_times[missing_keys[index]] = field_time
        if field_time.is_lasting:
            is_cached = cache.write(missing_keys[index], pack_field_time(field_time)) and is_cached
        if progress:
            progress(len(order_by_key) - len(missing_keys) + done, len(order_by_key))
    return tuple(tuple(None if key is None else known_times[key] for key in row) for row in keys), is_cached


def count_uncached_field_times(rows: Sequence[Sequence[WorkOrder | None]], cache: ResultCache) -> int:
    """Number of field times that have to be simulated."""
    keys = {hash_field_time_order(order) for row in rows for order in row if order is not None}
    return sum(cache.read(key) is None for key in keys)


def compute_field_time(order: WorkOrder, field_minutes: float = DEFAULT_FIELD_MINUTES) -> FieldTime:
    """The quickest plan of a fleet on a field, with fewer tractors if not all can work together.

    After `field_minutes` of computing it is the best of those found so far.
    """
    share = TimeShare(60.0 * field_minutes)
    try:
        found = _search_field_time(order, share)
    except TimeSpentError:
        found = FieldTime(reason=f"no plan was found in {field_minutes:g} min of computing")
    if not share.is_cut:
        return found
    spent = f"in {field_minutes:g} min of computing"
    note = f"no plan was found {spent}. Give it more (--field-minutes)."
    if found.graph is not None:
        note = f"not everything was tried {spent}; this is the best plan found by then. Give it more (--field-minutes)."
    return replace(found, is_lasting=False, cut_note=note)


def _search_field_time(order: WorkOrder, share: TimeShare) -> FieldTime:
    """The field time within a share of computing; raises TimeSpentError where that ends before there is a plan."""
    reason = ""
    for count in range(order.request.tractors[0], 0, -1):
        try:
            one = replace(order, request=replace(order.request, tractors=(count,)))
            result = plan_order(one, executor=SerialExecutor(), time_share=share)
        except AllDoneError:
            return FieldTime(reason=ALL_DONE, left_ha=0.0)
        except HeadlandError as refusal:
            if refusal.parameter == "done":  # a fault of the day file, and none of the field
                raise
            return FieldTime(reason=str(refusal), is_lasting=refusal.parameter not in HEIGHT_PARAMETERS)
        best, run = result.ranking.best, result.run
        if best is not None and run is not None:
            context, physics = result.context, result.context.physics
            ordered_run = enforce_planned_order(run, context.tractor, context.implement)
            fuel = measure_leg_consumption(ordered_run, context.tractor, physics.fuel_load, physics.terrain)
            graph = build_leg_graph(ordered_run, fuel)
            shortfall = next((one.sentence for one in result.ranking.shortfalls if one.kind == "worked"), "")
            figures = best.strategy, count, float(best.time_s or 0.0), best.worked_pct, best.missed_m2
            left_ha = context.layout.field.area_ha if order.done else None
            return FieldTime(*figures, graph, best.refills, shortfall=shortfall, left_ha=left_ha)
        if share.is_cut:
            raise TimeSpentError
        reason = reason or result.ranking.refusal
    return FieldTime(reason=reason)


def pack_field_time(field_time: FieldTime) -> dict[str, Any]:
    """A field time as a JSON object; floats are exact."""
    graph = field_time.graph
    if graph is None:
        return {"reason": field_time.reason, "left_ha": field_time.left_ha}
    fuel = graph.fuel
    packed_graph = {
        "tractors": graph.tractors,
        "first": list(graph.first_nodes),
        "order": list(graph.order),
        "leaving": None if graph.leaving is None else graph.leaving.tolist(),
        "fuel": None if fuel is None else {"driving": fuel.driving.tolist(), "idle_per_s": fuel.idle_per_s},
        **{name: getattr(graph, name).tolist() for name in GRAPH_ARRAYS},
        "links": [asdict(link) for link in graph.links],
    }
    return {**{name: getattr(field_time, name) for name in PLAN_VALUES}, "graph": packed_graph}


def _unpack_field_time(content: dict[str, Any]) -> FieldTime:
    """The field time that `pack_field_time` made a JSON object of."""
    if "graph" not in content:
        return FieldTime(**content)
    graph_values, fuel = content["graph"], content["graph"]["fuel"]
    arrays: dict[str, Any] = {name: np.array(graph_values[name], dtype=kind) for name, kind in GRAPH_ARRAYS.items()}
    graph = LegGraph(
        tractors=graph_values["tractors"],
        first_nodes=tuple(graph_values["first"]),
        order=tuple(graph_values["order"]),
        links=tuple(WaitLink(**link) for link in graph_values["links"]),
        **arrays,
        leaving=None if graph_values["leaving"] is None else np.array(graph_values["leaving"], dtype=np.bool_),
        fuel=None if fuel is None else LegConsumption(np.array(fuel["driving"], dtype=np.float64), fuel["idle_per_s"]),
    )
    return FieldTime(**(content | {"graph": graph}))
