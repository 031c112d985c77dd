"""How long every fleet takes for every field: the quickest of its simulated plans there, with its legs and gates."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from fields.errors import HeadlandError
from fields.field import Field
from planner.asked import asked
from planner.chance.graph import Graph, Link, graph_of
from planner.chance.planned_order import in_planned_order
from planner.content import digest
from planner.day.cache import Cache
from planner.day.file import DayFile, machines_of, suits
from planner.errors import WorkerError
from planner.farm.file import FarmFile
from planner.planning import plan
from planner.pool import SerialExecutor, completed
from planner.scenario import Scenario
from planner.tasks import LOST, Progress
from strategies.supply import Supply
from vehicle.tractor import Implement, Tractor, as_tractor

ARRAYS = ("tractor", "group", "kind", "driven_s", "worked_m", "stand_s")
NAMES = ("strategy", "tractors", "time_s", "worked_pct", "missed_m2", "refills")
NO_NAME = "field"
Array = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FieldTime:
    """The quickest plan of a fleet on a field; `graph` is None where none can be driven, and `reason` says why.

    Where something is carried, `refills` are the stops of the plan, which begins with tanks full, or empty to fill.
    """

    strategy: str = ""
    tractors: int = 0
    time_s: float = 0.0
    worked_pct: float | None = None
    missed_m2: float | None = None
    graph: Graph | None = None
    refills: int | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Task:
    """One fleet on one field, as `work_out` takes it."""

    field: Field
    scenario: Scenario
    tractor: Tractor
    implement: Implement
    supply: Supply | None = None

    @cached_property
    def key(self) -> str:
        """A name for what decides the answer: content, not names or places on the earth."""
        scenario = replace(self.scenario, field=NO_NAME, tractor=NO_NAME)
        nameless = replace(self.field, name=NO_NAME, crs=None, origin_m=(0.0, 0.0), source="", remarks=())
        return digest(nameless, scenario, self.tractor, self.implement, self.supply, worker=__name__)


Table = tuple[tuple[FieldTime | None, ...], ...]
"""By fleet and field; None where the fleet's implement is not what the field asks for."""


def tasks_of(day: DayFile, farm: FarmFile, fields: Sequence[Field]) -> list[list[Task | None]]:
    """What there is to simulate, by fleet and field."""
    rows = []
    for fleet in day.fleets:
        tractor, implement = machines_of(fleet, farm)
        scenario = Scenario(tractor=tractor.name, tractors=(fleet.count,), strategies=day.strategies)
        found = asked(scenario, farm, {"tractor", "tractors"}, implement=implement.name)
        plain = replace(found.scenario, price_per_hour=0.0, price_per_tractor=0.0)
        machine = as_tractor(found.tractor or found.scenario.tractor)
        rows.append([
            Task(field, replace(plain, field=field.name), machine, found.implement or Implement(), found.supply)
            if suits(said, implement) else None
            for said, field in zip(day.fields, fields, strict=True)
        ])  # fmt: skip
    return rows


def field_times(
    rows: Sequence[Sequence[Task | None]], cache: Cache, executor: Executor, progress: Progress | None = None
) -> tuple[Table, bool]:
    """All field times, and whether what was simulated could be kept.

    What is known is not simulated again, and what two fleets have in common once. `progress` is called with (done,
    all). The answer does not depend on executor and cache.
    """
    keys = [[None if task is None else task.key for task in row] for row in rows]
    work = {key: task for names, row in zip(keys, rows, strict=True)
            for key, task in zip(names, row, strict=True) if key is not None and task is not None}  # fmt: skip
    known = {key: found for key in work if (found := _unpacked(cache.read(key))) is not None}
    todo = [key for key in work if key not in known]
    kept = True
    try:
        for done, (index, found) in enumerate(completed(executor, work_out, [(work[key],) for key in todo]), start=1):
            known[todo[index]] = found
            kept = cache.write(todo[index], packed(found)) and kept
            if progress:
                progress(len(work) - len(todo) + done, len(work))
    except BrokenExecutor:
        raise WorkerError(LOST) from None
    return tuple(tuple(None if key is None else known[key] for key in row) for row in keys), kept


def unknown(rows: Sequence[Sequence[Task | None]], cache: Cache) -> int:
    """How many field times have to be simulated."""
    keys = {task.key for row in rows for task in row if task is not None}
    return sum(_unpacked(cache.read(key)) is None for key in keys)


def work_out(task: Task) -> FieldTime:
    """The quickest plan of a fleet on a field; where it cannot work together, of as many of its tractors as can."""
    reason = ""
    for count in range(task.scenario.tractors[0], 0, -1):
        try:
            planned = plan(
                replace(task.scenario, tractors=(count,)), field=task.field, tractor=task.tractor,
                implement=task.implement, supply=task.supply, executor=SerialExecutor(),
            )  # fmt: skip
        except HeadlandError as refusal:
            return FieldTime(reason=str(refusal))
        best, run = planned.ranking.best, planned.run
        if best is not None and run is not None:
            graph = graph_of(in_planned_order(run, planned.site.tractor, planned.site.implement))
            return FieldTime(
                best.strategy, count, float(best.time_s or 0.0), best.worked_pct, best.missed_m2, graph, best.refills
            )
        reason = reason or next((each.reason for each in planned.ranking.plans if each.reason), "")
    return FieldTime(reason=reason)


def packed(found: FieldTime) -> dict[str, Any]:
    """A field time as JSON has it; floats keep every bit."""
    content = {name: getattr(found, name) for name in NAMES}
    graph = found.graph
    if graph is None:
        return {"reason": found.reason}
    arrays = {name: getattr(graph, name).tolist() for name in ARRAYS}
    links = [asdict(link) for link in graph.links]
    leaving = None if graph.leaving is None else graph.leaving.tolist()
    whole = {"tractors": graph.tractors, "first": list(graph.first), "order": list(graph.order), "leaving": leaving}
    return {**content, "graph": {**whole, **arrays, "links": links}}


def _unpacked(content: dict[str, Any] | None) -> FieldTime | None:
    """The same back; None for what is none."""
    if content is None:
        return None
    try:
        if "graph" not in content:
            return FieldTime(reason=str(content["reason"]))
        own = dict(content["graph"])
        graph = Graph(
            tractors=int(own["tractors"]), first=tuple(own["first"]), order=tuple(own["order"]),
            links=tuple(Link(**link) for link in own["links"]),
            tractor=_whole(own["tractor"]), group=_whole(own["group"]), kind=_whole(own["kind"]),
            driven_s=_floats(own["driven_s"]), worked_m=_floats(own["worked_m"]), stand_s=_floats(own["stand_s"]),
            leaving=None if own["leaving"] is None else np.array(own["leaving"], dtype=np.bool_),
        )  # fmt: skip
        return FieldTime(**{name: value for name, value in content.items() if name != "graph"}, graph=graph)
    except (KeyError, TypeError, ValueError):
        return None


def _whole(values: Any) -> Whole:
    return np.array(values, dtype=np.int64)


def _floats(values: Any) -> Array:
    return np.array(values, dtype=np.float64)
