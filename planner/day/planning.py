"""Planning of a day: simulated field times, the best assignment of fields to fleets, its probability, advice."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

import reports.day.page  # noqa: F401  # how a day is shown
from fields.arrays import Floats
from fields.documents.reader import read_field
from fields.geometry.chosen_places import add_obstacles, leave_out_obstacles, set_entrance
from fields.geometry.field import Field
from fields.text_files import quote_path
from fields.units import MINUTE_S
from planner.day.field_times import (
    ALL_DONE,
    DEFAULT_FIELD_MINUTES,
    FieldTimeTable,
    build_field_time_orders,
    compute_field_times,
    count_uncached_field_times,
    find_left_ha,
)
from planner.day.formulation import (
    DayHours,
    FleetDaySamples,
    PlannedRouteField,
    build_day_hours,
    build_fleet_prices,
    build_problem,
    convert_rain_onsets,
    derive_job_seed,
    get_field_uncertainty,
    sample_fleet_day,
)
from planner.day.input_file import DayField, DayFile, get_fleet_machines, load_day, name_day_key
from planner.day.optimization.problem import DayProblem, Routes, find_insertions
from planner.day.optimization.solver import DaySolution, solve_day
from planner.day.places import DayPlace, build_map_places, compute_road_km, locate_fields, locate_yard
from planner.errors import RequestError, attach_parameter, rename_parameters
from planner.evaluation.pull_check import compute_pull_figures
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import FarmFile
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.going_on import check_source_exists
from planner.pipeline.result_cache import ResultCache
from planner.pipeline.worker_tasks import Progress
from planner.request.option_texts import parse_number_pair
from planner.risk.monte_carlo import DEFAULT_SAMPLES
from reports.day.results import DayJob, DayResult, FleetDay, UnworkedField, list_day_sentences
from reports.plan.shortfall_wording import question_pull

CACHE_FAILED = "Field times could not be cached, so the next run simulates them again; try another folder (--cache)."


@dataclass(frozen=True)
class NotDoneReason:
    """Why a field is not done: the sentence, and how far it is from being done (kind, then seconds or money)."""

    reason: str
    nearness: tuple[int, float]


def explain_not_done(
    problem: DayProblem, routes: Routes, field: int, refusals: Sequence[str], names: Sequence[str]
) -> NotDoneReason:
    """Why a field is not done. `refusals` are of the fleets without a plan for it, `names` of all fleets."""
    able_fleets = [fleet for fleet in range(problem.fleet_count) if problem.work_s[fleet][field] is not None]
    if not able_fleets:
        refusal = next(filter(None, refusals), "every plan was refused").rstrip(".")
        if refusal == ALL_DONE:
            return NotDoneReason(ALL_DONE, (4, 0.0))
        return NotDoneReason(f"no fleet can work it: {refusal}", (3, 0.0))
    if not problem.windows[field]:
        return NotDoneReason("its windows are outside the working hours or the daylight", (2, 0.0))
    options = find_insertions(problem, routes, field)
    if options:
        added_cost = options[0].added_cost
        return NotDoneReason(f"doing it costs {added_cost:.2f} more than skipping it", (0, added_cost))
    late_s, fleet = min((_compute_lateness_s(problem, fleet, field), fleet) for fleet in able_fleets)
    if late_s > 0:
        hours, minutes = divmod(max(1, round(late_s / MINUTE_S)), 60)
        late = f"{hours} h {minutes} min" if hours else f"{minutes} min"
        sentence = f"even if {names[fleet]} goes there first, it is {late} too late"
        return NotDoneReason(sentence, (1, float(late_s)))
    return NotDoneReason("no fleet has time for it besides the other fields", (0, 0.0))


def _compute_lateness_s(problem: DayProblem, fleet: int, field: int) -> int:
    """Seconds by which a fleet that works this field only misses the best window or the end of the day, at least 0."""
    work_s, depot = problem.work_s[fleet][field] or 0, problem.field_count
    arrives_s = problem.begin_s + problem.travel_s[fleet][depot][field]

    def find_lateness_s(window: tuple[int, int]) -> int:
        end_s = max(arrives_s, window[0]) + work_s
        return max(end_s - window[1], end_s + problem.travel_s[fleet][field][depot] - problem.home_by_s, 0)

    return min(find_lateness_s(window) for window in problem.windows[field])


@dataclass(frozen=True, eq=False, repr=False)
class PreparedDay:
    """A day after reading and checking, before simulation. `road_km` (n + 1, n + 1) has the yard last."""

    day: DayFile
    farm: FarmFile
    fields: tuple[Field, ...]
    places: tuple[DayPlace, ...]
    road_km: Floats
    frame: DayHours
    orders: list[list[WorkOrder | None]]

    def count_uncached_field_times(self, cache: ResultCache) -> int:
        """Number of field times that are not in the cache."""
        return count_uncached_field_times(self.orders, cache)


@dataclass(frozen=True, eq=False)
class _SolvedDay:
    """The solution of a day, with the samples of every fleet."""

    prepared: PreparedDay
    table: FieldTimeTable
    problem: DayProblem
    solution: DaySolution
    fleet_samples: tuple[FleetDaySamples, ...]
    samples: int
    seed: int


def prepare_day(day: DayFile, farm: FarmFile) -> PreparedDay:
    """Read the fields of a day and compute its roads and hours; raises HeadlandError, with the keys of a day file."""
    with rename_parameters(name_day_key):
        return _prepare_day(day, farm)


def _prepare_day(day: DayFile, farm: FarmFile) -> PreparedDay:
    with attach_parameter("field"):
        fields = tuple(_read_day_field(day_field) for day_field in day.fields)
    field_places = locate_fields(day, fields)
    yard = locate_yard(day, farm)
    road_km = np.zeros((len(field_places) + 1, len(field_places) + 1))
    places = field_places if yard is None else (*field_places, yard)
    road_km[: len(places), : len(places)] = compute_road_km(day, places, farm.times.road_factor)
    # The sun rises and sets as at the yard, else as at the last field with a known place.
    sun_place = next((place.lon_lat for place in reversed(places) if place.lon_lat is not None), None)
    frame, orders = build_day_hours(day, farm, sun_place), build_field_time_orders(day, farm, fields)
    return PreparedDay(day, farm, fields, places, road_km, frame, orders)


def _read_day_field(day_field: DayField) -> Field:
    """The field with the entrance, obstacles and heights of the day file."""
    field = read_field(
        day_field.file, local=day_field.local, name=day_field.name, crs=day_field.crs, swap_axes=day_field.swap_axes
    )
    if day_field.entrance is not None:
        field = set_entrance(field, parse_number_pair(day_field.entrance, "entrance"))
    if day_field.elevation is not None:
        if not Path(day_field.elevation).exists():
            raise RequestError(
                f"Field '{field.name}' of the day names the heights {quote_path(day_field.elevation)}, and there is no "
                "such file; check its name and its folder.",
                parameter="elevation",
            )
        field = replace(field, elevation=day_field.elevation)
    for source in day_field.done:
        check_source_exists(source)
    return add_obstacles(leave_out_obstacles(field, day_field.ignored), day_field.obstacles)


def plan_day(
    day: PreparedDay | str | Path,
    *,
    cache: ResultCache | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    report_work: Callable[[list[str]], None] = lambda names: None,
    samples: int = DEFAULT_SAMPLES,
    seed: int = 1,
    field_minutes: float = DEFAULT_FIELD_MINUTES,
) -> DayResult:
    """Simulate missing field times, assign fields to fleets, and estimate probabilities by Monte Carlo.

    Example:

        day = headland.plan_day("day.toml")  # a file as headland day new writes it
        day                                 # in a notebook: advice, work over time, the jobs
        day.to_pandas()                     # a row per job: start_s, end_s, p95_end_s, cost
        day.save("day.html")                # the page; also .json, .csv and .png

    `day` is a day file or a prepared day. Returns a DayResult: `jobs`, `unworked_fields`, `fleets`, `cost`, `advice`.
    A fleet's plan of a field takes at most about `field_minutes` of computing on one core; where that is too little,
    the plan is the best of those found by then, and `questions` says so. That alone depends on the speed of the
    machine; apart from it, the result depends neither on the executor nor on the cache. `progress` is called with
    (done, all) field times, `report_work` with the names of the fields at work.
    """
    prepared = day if isinstance(day, PreparedDay) else prepare_day(*load_day(day))
    cache, executor = cache or ResultCache(None), executor or SerialExecutor()
    table, is_cached = compute_field_times(prepared.orders, cache, executor, progress, field_minutes, report_work)
    problem = build_problem(prepared.day, prepared.farm, prepared.fields, prepared.road_km, table, prepared.frame, seed)
    solution = solve_day(problem, seed=seed)
    fleet_samples = _sample_fleet_days(prepared, table, problem, solution.routes, samples, seed)
    solved = _SolvedDay(prepared, table, problem, solution, fleet_samples, samples, seed)
    return _build_result(solved, is_cached)


def _sample_fleet_days(
    prepared: PreparedDay, table: FieldTimeTable, problem: DayProblem, routes: Routes, samples: int, seed: int
) -> tuple[FleetDaySamples, ...]:
    """Samples of the day of every fleet."""
    frame, onset = prepared.frame, prepared.frame.onset
    dry = np.full(samples, math.inf)
    rain = dry if onset is None else convert_rain_onsets(onset.draw_onsets(samples, seed), frame.start_s, frame.clock)
    uncertainty = get_field_uncertainty(prepared.farm, with_late_start=True)
    return tuple(
        sample_fleet_day(
            _build_route_stops(prepared, table, problem, fleet, route, seed),
            uncertainty,
            frame.start_s,
            rain,
            seed=seed,
            fleet=prepared.day.fleets[fleet].name,
        )
        for fleet, route in enumerate(routes)
    )


def _build_route_stops(
    prepared: PreparedDay, table: FieldTimeTable, problem: DayProblem, fleet: int, route: Sequence[int], seed: int
) -> list[PlannedRouteField]:
    """The fields of a route with the windows in which they are planned."""
    stops, starts = [], problem.schedule_starts(fleet, route) or []
    for (start_place, end_place), start_s in zip(pairwise((problem.field_count, *route)), starts, strict=True):
        field_time = table[fleet][end_place]
        graph = None if field_time is None else field_time.graph
        assert graph is not None
        opens, closes = next(window for window in problem.windows[end_place] if window[0] <= start_s < window[1])
        name, machine = prepared.fields[end_place].name, prepared.day.fleets[fleet].name
        terms = build_fleet_prices(prepared.day, prepared.farm, fleet)
        move_s, value_at_risk = problem.travel_s[fleet][start_place][end_place], problem.value_at_risk[end_place]
        job_seed = derive_job_seed(seed, name, machine)
        stops.append(PlannedRouteField(graph, move_s, opens, closes, terms, value_at_risk, job_seed))
    return stops


def _build_result(solved: _SolvedDay, is_cached: bool) -> DayResult:
    prepared, problem, solution, frame = solved.prepared, solved.problem, solved.solution, solved.prepared.frame
    jobs = [
        _build_job(solved, fleet, position)
        for fleet, route in enumerate(solution.routes)
        for position in range(len(route))
    ]
    skipped = _list_not_done(solved)
    in_time_by_fleet = [chain.in_time.all(axis=0) for chain in solved.fleet_samples if len(chain.in_time)]
    all_probability = float(np.logical_and.reduce(in_time_by_fleet).mean()) if in_time_by_fleet else None
    onset, closest_field = frame.onset, ""
    if not jobs:  # the skipped field that is nearest to being done
        entry, _ = min(skipped, key=lambda pair: pair[1].nearness)
        closest_field = f"{entry.field}: {entry.reason}"
    times = () if onset is None else tuple(zip(onset.onsets_s, onset.probabilities, strict=True))
    p50_done_s, p95_done_s = _find_done_times(solved)
    result = DayResult(
        start_s=frame.start_s,
        end_s=frame.end_s,
        jobs=tuple(jobs),
        unworked_fields=tuple(entry for entry, _ in skipped),
        fleets=tuple(_build_fleet_day(solved, fleet) for fleet in range(problem.fleet_count)),
        gap_pct=solution.gap_pct,
        cost=_estimate_cost(solved),
        finish_probability=all_probability,
        currency=prepared.farm.prices.currency,
        samples=solved.samples,
        seed=solved.seed,
        advice="",
        questions=(*_question_cut_plans(solved), *_question_pulls(solved, infeasible=False)),
        shortfalls=(*_question_pulls(solved, infeasible=True), *_list_worked_shortfalls(solved)),
        remarks=(*_list_remarks(solved), *([] if is_cached else [CACHE_FAILED])),
        fields=tuple(field.name for field in prepared.fields),
        windows=tuple(
            tuple((frame.get_begin_clock_s(opens), frame.get_end_clock_s(closes)) for opens, closes in windows)
            for windows in problem.windows
        ),
        breaks=frame.list_breaks(),
        rain=tuple((frame.start_s + seconds, share) for seconds, share in times),
        certainty_pct=prepared.day.certainty_pct,
        places=build_map_places(prepared.places, prepared.fields),
        closest_field=closest_field,
        p50_done_s=p50_done_s,
        p95_done_s=p95_done_s,
    )
    return replace(result, advice=" ".join(list_day_sentences(result)))


def _find_done_times(solved: _SolvedDay) -> tuple[float, float] | tuple[None, None]:
    """The times of the day by which all jobs are done in half and in 95 % of the samples; None without jobs."""
    last_s = [chain.done_s.max(axis=0) for chain in solved.fleet_samples if len(chain.done_s)]
    if not last_s:
        return None, None
    p50_s, p95_s = np.quantile(np.maximum.reduce(last_s), (0.5, 0.95))
    frame = solved.prepared.frame
    return frame.get_end_clock_s(float(p50_s)), frame.get_end_clock_s(float(p95_s))


def _build_job(solved: _SolvedDay, fleet: int, position: int) -> DayJob:
    prepared, problem, fleet_samples = solved.prepared, solved.problem, solved.fleet_samples[fleet]
    route, frame = solved.solution.routes[fleet], solved.prepared.frame
    number, previous_place = route[position], (problem.field_count, *route)[position]
    starts = problem.schedule_starts(fleet, route) or []
    work, plan = problem.work_s[fleet][number] or 0, solved.table[fleet][number]
    assert plan is not None
    probability, interval = fleet_samples.estimate_in_time_probability(position)
    p50, p95 = (
        frame.get_end_clock_s(float(value)) for value in np.quantile(fleet_samples.done_s[position], (0.5, 0.95))
    )
    p50_start_s = float(np.median(fleet_samples.start_s[position]))
    p50_leaves_s = (
        p50_start_s - problem.travel_s[fleet][problem.field_count][number]
        if position == 0
        else float(np.median(fleet_samples.end_s[position - 1]))
    )
    return DayJob(
        field=prepared.fields[number].name,
        machine=prepared.day.fleets[fleet].name,
        strategy=plan.strategy,
        tractors=plan.tractors,
        area_ha=find_left_ha(prepared.fields[number], (row[number] for row in solved.table)),
        leaves_s=frame.get_begin_clock_s(_compute_departure_s(problem, fleet, route, position)),
        km=float(prepared.road_km[previous_place, number]),
        start_s=frame.get_begin_clock_s(starts[position]),
        end_s=frame.get_end_clock_s(starts[position] + work),
        time_s=plan.time_s,
        finish_probability=probability,
        finish_probability_interval=interval,
        p50_end_s=p50,
        p95_end_s=p95,
        cost=float(fleet_samples.work_cost[position]),
        lost_cost=float(fleet_samples.lost_cost[position]),
        worked_pct=plan.worked_pct,
        refills=plan.refills,
        p50_start_s=frame.get_begin_clock_s(p50_start_s),
        p50_leaves_s=frame.get_begin_clock_s(p50_leaves_s),
    )


def _compute_departure_s(problem: DayProblem, fleet: int, route: Sequence[int], position: int) -> int:
    """The departure to a field: from the yard without waiting on arrival, else after the field before."""
    starts = problem.schedule_starts(fleet, route) or []
    if position == 0:
        return starts[0] - problem.travel_s[fleet][problem.field_count][route[0]]
    return starts[position - 1] + (problem.work_s[fleet][route[position - 1]] or 0)


def _build_fleet_day(solved: _SolvedDay, fleet: int) -> FleetDay:
    prepared, problem, route = solved.prepared, solved.problem, solved.solution.routes[fleet]
    day_fleet, frame = prepared.day.fleets[fleet], prepared.frame
    tractor, implement = get_fleet_machines(day_fleet, prepared.farm)
    description = f"{day_fleet.count} x {tractor.name}, {implement.name}"
    if not route:
        return FleetDay(day_fleet.name, description, None, None, 0.0)
    starts = problem.schedule_starts(fleet, route) or []
    last_end_s = starts[-1] + (problem.work_s[fleet][route[-1]] or 0)
    home = frame.get_end_clock_s(last_end_s + problem.travel_s[fleet][route[-1]][problem.field_count])
    km = sum(float(prepared.road_km[a, b]) for a, b in pairwise((problem.field_count, *route, problem.field_count)))
    leaves = frame.get_begin_clock_s(_compute_departure_s(problem, fleet, route, 0))
    last_p50_s = float(np.median(solved.fleet_samples[fleet].end_s[-1]))
    p50_home_s = frame.get_end_clock_s(last_p50_s + problem.travel_s[fleet][route[-1]][problem.field_count])
    return FleetDay(
        day_fleet.name, description, leaves, home, km, problem.compute_travel_cost(fleet, route), p50_home_s
    )


def _list_not_done(solved: _SolvedDay) -> list[tuple[UnworkedField, NotDoneReason]]:
    """Skipped fields, each with its reason."""
    prepared, problem, routes = solved.prepared, solved.problem, solved.solution.routes
    names = [fleet.name for fleet in prepared.day.fleets]
    skipped = []
    for number in problem.list_skipped_fields(routes):
        field, plans = prepared.fields[number], [row[number] for row in solved.table]
        refusals = [plan.reason for plan in plans if plan is not None]
        reason = explain_not_done(problem, routes, number, refusals, names)
        left_ha = find_left_ha(field, plans)
        skipped.append((UnworkedField(field.name, left_ha, problem.skip_cost[number], reason.reason), reason))
    return skipped


def _estimate_cost(solved: _SolvedDay) -> float:
    """The expected cost of the day by its samples: work, travel, losses by rain, skipped fields."""
    problem, routes = solved.problem, solved.solution.routes
    travel_cost = sum(problem.compute_travel_cost(fleet, route) for fleet, route in enumerate(routes))
    sampled_cost = sum(float(chain.work_cost.sum() + chain.lost_cost.sum()) for chain in solved.fleet_samples)
    skip_cost = sum(problem.skip_cost[field] for field in problem.list_skipped_fields(routes))
    return travel_cost + sampled_cost + skip_cost


def _list_remarks(solved: _SolvedDay) -> list[str]:
    """Remarks on fields where only a part of a fleet can work, and on an unknown yard."""
    remarks = []
    for fleet, route in enumerate(solved.solution.routes):
        for number in route:
            plan, name = solved.table[fleet][number], solved.prepared.fields[number].name
            fleet_size = solved.prepared.day.fleets[fleet].count
            if plan is not None and plan.tractors < fleet_size:
                remarks.append(f"On {name}, only {plan.tractors} of {fleet_size} tractors can work together.")
    if len(solved.prepared.places) == len(solved.prepared.fields):
        remarks.append("The place of the yard is unknown, so every fleet starts at its first field.")
    return remarks


def _question_cut_plans(solved: _SolvedDay) -> list[str]:
    """Which fields a fleet was not planned on to the end, for lack of computing time."""
    return [
        f"{field.name}, {fleet.name}: {plan.cut_note}"
        for fleet, row in zip(solved.prepared.day.fleets, solved.table, strict=True)
        for field, plan in zip(solved.prepared.fields, row, strict=True)
        if plan is not None and plan.cut_note
    ]


def _list_worked_shortfalls(solved: _SolvedDay) -> list[str]:
    """The fields of which too little is worked, with the reason."""
    return [
        f"{solved.prepared.fields[number].name}: {plan.shortfall}"
        for fleet, route in enumerate(solved.solution.routes)
        for number in route
        if (plan := solved.table[fleet][number]) is not None and plan.shortfall
    ]


def _question_pulls(solved: _SolvedDay, *, infeasible: bool) -> list[str]:
    """What is said of fleets that work somewhere and whose tractors cannot pull their implement, or seem too weak."""
    questions: list[str] = []
    for fleet, route, orders in zip(
        solved.prepared.day.fleets, solved.solution.routes, solved.prepared.orders, strict=True
    ):
        order = next((orders[number] for number in route if orders[number] is not None), None)
        if order is not None:
            farm_tractor = get_fleet_machines(fleet, solved.prepared.farm)[0]
            machine = order.resolve_tractor()
            pull = compute_pull_figures(order.request, machine, farm_tractor)
            question = question_pull(pull, suggests_options=False)
            is_shown = pull is not None and bool(question) and pull.is_infeasible == infeasible
            questions += [f"{fleet.name}: {question}"] if is_shown else []
    return questions
