"""A day file from beginning to end: field times simulated, fields given to fleets in the best order, how sure it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.errors import about
from fields.field import Field
from fields.read import read_field
from planner.chance.answer import DRAWS
from planner.day.build import Frame, chances_of, frame_of, job_seed, problem_of, terms_of
from planner.day.cache import Cache
from planner.day.file import YARD, DayFile, machines_of
from planner.day.insertion import Routes
from planner.day.odds import Chain, Stop, chained, rain_draws
from planner.day.places import Spot, on_map, road_km, spots, yard_of
from planner.day.problem import Problem
from planner.day.solve import Day, solved
from planner.day.times import FieldTime, Table, Task, field_times, tasks_of, unknown
from planner.day.words import Why, advice_of, why_left
from planner.farm.file import FarmFile
from planner.pool import SerialExecutor
from planner.tasks import Progress
from planner.transport import end_of_road
from reports.day_results import DayJob, DayResult, FleetDay, MapPlace, NotDone

NOT_KEPT = "Field times could not be kept, so the next run simulates them anew; --cache names another folder."
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ready:
    """A day that is read and checked, before anything is simulated. `km` (n + 1, n + 1) has the yard last."""

    day: DayFile
    farm: FarmFile
    fields: tuple[Field, ...]
    places: tuple[Spot, ...]
    km: Array
    frame: Frame
    tasks: list[list[Task | None]]

    def unknown(self, cache: Cache) -> int:
        """How many field times a cache does not know."""
        return unknown(self.tasks, cache)


@dataclass(frozen=True, eq=False)
class _Found:
    """What the search found, with the draws of every fleet."""

    ready: Ready
    table: Table
    problem: Problem
    best: Day
    chains: tuple[Chain, ...]
    draws: int
    seed: int


def prepare_day(day: DayFile, farm: FarmFile) -> Ready:
    """Read the fields of a day and lay out its roads and hours; raises HeadlandError."""
    with about("field"):
        fields = tuple(
            read_field(said.file, local=said.local, name=said.name, crs=said.crs, swap=said.swap) for said in day.fields
        )
    own = spots(day, fields)
    yard = yard_of(day, farm)
    km = np.zeros((len(own) + 1, len(own) + 1))
    places = own if yard is None else (*own, yard)
    km[: len(places), : len(places)] = road_km(day, places, farm.times.road_factor)
    return Ready(day, farm, fields, places, km, frame_of(day, farm, _sun_at(places)), tasks_of(day, farm, fields))


def _sun_at(places: Sequence[Spot]) -> tuple[float, float] | None:
    """Where the sun is looked for: the yard, else the last field that is somewhere."""
    return next((place.at for place in reversed(places) if place.at is not None), None)


def plan_day(
    ready: Ready,
    *,
    cache: Cache | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    draws: int = DRAWS,
    seed: int = 1,
) -> DayResult:
    """Simulate what the cache does not know, give the fields to the fleets, and draw how sure that is.

    The answer depends neither on the executor nor on the cache. `progress` is called with (done, all) field times.
    """
    table, kept = field_times(ready.tasks, cache or Cache(None), executor or SerialExecutor(), progress)
    problem = problem_of(ready.day, ready.farm, ready.fields, ready.km, table, ready.frame, seed)
    best = solved(problem, seed=seed)
    chains = _chains(ready, table, problem, best.routes, draws, seed)
    return _result(_Found(ready, table, problem, best, chains, draws, seed), kept)


def _chains(
    ready: Ready, table: Table, problem: Problem, routes: Routes, draws: int, seed: int
) -> tuple[Chain, ...]:
    """The draws of every fleet's day."""
    frame, onset = ready.frame, ready.frame.onset
    dry = np.full(draws, math.inf)
    rain = dry if onset is None else rain_draws(onset.draw(draws, seed), frame.start_s, frame.clock)
    return tuple(
        chained(
            _stops(ready, table, problem, fleet, route, seed), chances_of(ready.farm, late=True), frame.start_s, rain,
            seed=seed, fleet=ready.day.fleets[fleet].name,
        )
        for fleet, route in enumerate(routes)
    )  # fmt: skip


def _stops(
    ready: Ready, table: Table, problem: Problem, fleet: int, route: Sequence[int], seed: int
) -> list[Stop]:
    """The fields of a route with the windows they are planned in."""
    stops, starts = [], problem.starts(fleet, route) or []
    for (a, b), start in zip(pairwise((problem.fields, *route)), starts, strict=True):
        found = table[fleet][b]
        graph = None if found is None else found.graph
        assert graph is not None
        opens, closes = next(window for window in problem.windows[b] if window[0] <= start < window[1])
        name, machine = ready.fields[b].name, ready.day.fleets[fleet].name
        terms = terms_of(ready.day, ready.farm, fleet)
        seeded = job_seed(seed, name, machine)
        stops.append(Stop(graph, problem.move_s[fleet][a][b], opens, closes, terms, problem.stake[b], seeded))
    return stops


def _result(found: _Found, kept: bool) -> DayResult:
    ready, problem, best, frame = found.ready, found.problem, found.best, found.ready.frame
    jobs = [
        _job(found, fleet, place)
        for fleet, route in enumerate(best.routes) for place in range(len(route))
    ]  # fmt: skip
    left = _left(found)
    together = [chain.in_time.all(axis=0) for chain in found.chains if len(chain.in_time)]
    sure = float(np.logical_and.reduce(together).mean()) if together else None
    cost = _cost(found)
    not_done, whys = [one for one, _ in left], [why for _, why in left]
    currency = ready.farm.prices.currency
    onset = frame.onset
    times = () if onset is None else tuple(zip(onset.onset_s, onset.shares, strict=True))
    return DayResult(
        start_s=frame.start_s, end_s=frame.end_s, jobs=tuple(jobs), not_done=tuple(not_done),
        fleets=tuple(_fleet(found, fleet) for fleet in range(problem.fleets)), gap_pct=best.gap_pct, cost=cost,
        all_probability=sure, currency=currency, draws=found.draws, seed=found.seed,
        advice=advice_of(jobs, not_done, sure, cost, currency),
        remarks=(*_remarks(found), *([] if kept else [NOT_KEPT])),
        fields=tuple(field.name for field in ready.fields),
        windows=tuple(_shown(frame, windows) for windows in problem.windows),
        breaks=frame.breaks(),
        rain=tuple((frame.start_s + seconds, share) for seconds, share in times),
        certainty_pct=ready.day.certainty_pct, places=_map(ready), closest="" if jobs else _closest(not_done, whys),
    )  # fmt: skip


def _job(found: _Found, fleet: int, place: int) -> DayJob:
    ready, problem, chain = found.ready, found.problem, found.chains[fleet]
    route, frame = found.best.routes[fleet], found.ready.frame
    number, before = route[place], (problem.fields, *route)[place]
    starts = problem.starts(fleet, route) or []
    work, plan = problem.work_s[fleet][number] or 0, found.table[fleet][number]
    assert plan is not None
    probability, interval = chain.probability(place)
    p50, p95 = (frame.end(float(value)) for value in np.quantile(chain.end_s[place], (0.5, 0.95)))
    return DayJob(
        field=ready.fields[number].name, machine=ready.day.fleets[fleet].name, strategy=plan.strategy,
        tractors=plan.tractors, area_ha=ready.fields[number].area_ha,
        leaves_s=frame.begin(_leaves(problem, fleet, route, place)), km=float(ready.km[before, number]),
        start_s=frame.begin(starts[place]), end_s=frame.end(starts[place] + work), time_s=plan.time_s,
        finish_probability=probability, finish_probability_interval=interval, p50_end_s=p50, p95_end_s=p95,
        cost=float(chain.paid[place]), lost_cost=float(chain.lost[place]), worked_pct=plan.worked_pct,
        refills=plan.refills,
    )  # fmt: skip


def _leaves(problem: Problem, fleet: int, route: Sequence[int], place: int) -> int:
    """When the way to a field begins: from the yard so that nobody waits, else when the field before is done."""
    starts = problem.starts(fleet, route) or []
    if place == 0:
        return starts[0] - problem.move_s[fleet][problem.fields][route[0]]
    return starts[place - 1] + (problem.work_s[fleet][route[place - 1]] or 0)


def _fleet(found: _Found, fleet: int) -> FleetDay:
    ready, problem, route = found.ready, found.problem, found.best.routes[fleet]
    said, frame = ready.day.fleets[fleet], ready.frame
    tractor, implement = machines_of(said, ready.farm)
    words = f"{said.count} x {tractor.name}, {implement.name}"
    if not route:
        return FleetDay(said.name, words, None, None, 0.0)
    starts = problem.starts(fleet, route) or []
    last = starts[-1] + (problem.work_s[fleet][route[-1]] or 0)
    home = frame.end(last + problem.move_s[fleet][route[-1]][problem.fields])
    km = sum(float(ready.km[a, b]) for a, b in pairwise((problem.fields, *route, problem.fields)))
    leaves = frame.begin(_leaves(problem, fleet, route, 0))
    return FleetDay(said.name, words, leaves, home, km, problem.ways_cost(fleet, route))


def _left(found: _Found) -> list[tuple[NotDone, Why]]:
    """Fields that are left, each with its reason."""
    ready, problem, routes = found.ready, found.problem, found.best.routes
    done = {field for route in routes for field in route}
    names = [fleet.name for fleet in ready.day.fleets]
    left = []
    for number, field in enumerate(ready.fields):
        if number not in done:
            why = why_left(problem, routes, number, _refusals(found.table, number), names)
            left.append((NotDone(field.name, field.area_ha, problem.put_off[number], why.reason), why))
    return left


def _refusals(table: Table, field: int) -> list[str]:
    found: list[FieldTime] = [one for row in table if (one := row[field]) is not None]
    return [one.reason for one in found]


def _closest(left: Sequence[NotDone], whys: Sequence[Why]) -> str:
    """The field that is nearest to being done, with its reason."""
    place = min(range(len(left)), key=lambda number: (whys[number].near, number))
    return f"{left[place].field}: {left[place].reason}"


def _cost(found: _Found) -> float:
    """The expected cost of the day by its draws: work, ways, what the rain takes, what is left."""
    problem, routes = found.problem, found.best.routes
    done = {field for route in routes for field in route}
    ways = sum(problem.ways_cost(fleet, route) for fleet, route in enumerate(routes))
    drawn = sum(float(chain.paid.sum() + chain.lost.sum()) for chain in found.chains)
    return ways + drawn + sum(cost for field, cost in enumerate(problem.put_off) if field not in done)


def _remarks(found: _Found) -> list[str]:
    """What a reader should know: fleets that came with fewer tractors, ground left open, what the fields' files say."""
    said = []
    for fleet, route in enumerate(found.best.routes):
        for number in route:
            plan, name = found.table[fleet][number], found.ready.fields[number].name
            wanted = found.ready.day.fleets[fleet].count
            if plan is not None and plan.tractors < wanted:
                said.append(f"On {name} only {plan.tractors} of {wanted} tractors of the fleet can work together.")
    if len(found.ready.places) == len(found.ready.fields):
        said.append("Nobody says where the yard is, so the day begins at the first field of every fleet.")
    return said


def _shown(frame: Frame, windows: Sequence[tuple[int, int]]) -> tuple[tuple[float, float], ...]:
    return tuple((frame.begin(opens), frame.end(closes)) for opens, closes in windows)


def _map(ready: Ready) -> tuple[MapPlace, ...]:
    """Places that somebody placed; fields with their outline round it."""
    found = []
    for number, (place, at) in enumerate(zip(ready.places, on_map(ready.places), strict=True)):
        if at is None:
            continue
        outline = None
        if place.name != YARD:
            ground = ready.fields[number].boundary
            middle = np.asarray(end_of_road(ready.fields[number]))
            outline = np.asarray(ground.exterior.coords)[:, :2] - middle + np.asarray(at)
        found.append(MapPlace(place.name, at[0], at[1], outline))
    return tuple(found)
