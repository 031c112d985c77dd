"""A day as an optimisation problem: costs of routes, and insertion of fields into them.

All times are integer working seconds (`planner.day.formulation.DayHours`). A fleet leaves the depot, works its fields
in order, each without interruption within one of its windows, and returns. Costs never fall with later work, so a
fleet starts everything as early as it can.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

HASTE_COST_PER_S = 1e-6  # money per second and field, so that of equally expensive days the earlier one is better
COST_TOLERANCE = 1e-9  # money; smaller differences count as equal
Route = tuple[int, ...]
Routes = tuple[Route, ...]


@dataclass(frozen=True)
class RainOnsets:
    """Onsets of rain as (working second, probability); the rest up to 1 is no rain."""

    onsets: tuple[tuple[int, float], ...] = ()

    def estimate_undone_share(self, start_s: int, work_s: int) -> float:
        """Expected share of a job that is not done when it begins to rain."""
        end = start_s + work_s
        return sum(share * min(max((end - at) / work_s, 0.0), 1.0) for at, share in self.onsets)


NO_RAIN = RainOnsets()


@dataclass(frozen=True)
class DayProblem:
    """Fields 0..n-1, fleets 0..m-1; the depot is place n.

    `work_s[k][f]` is the time of fleet k on field f (None: it cannot), `work_cost[k][f]` its cost, `skip_cost[f]` the
    cost of skipping a field, `value_at_risk[f]` the loss if rain prevents all of it. `windows[f]` are sorted (opens,
    closes). `travel_s[k][a][b]` is the time from place to place with folding, unfolding and refilling,
    `travel_cost[k][a][b]` its cost. Fleets leave at `begin_s` at the earliest and return by `home_by_s`.
    """

    work_s: tuple[tuple[int | None, ...], ...]
    work_cost: tuple[tuple[float, ...], ...]
    skip_cost: tuple[float, ...]
    value_at_risk: tuple[float, ...]
    windows: tuple[tuple[tuple[int, int], ...], ...]
    travel_s: tuple[tuple[tuple[int, ...], ...], ...]
    travel_cost: tuple[tuple[tuple[float, ...], ...], ...]
    begin_s: int
    home_by_s: int
    rain: RainOnsets = NO_RAIN

    @property
    def field_count(self) -> int:
        """Number of fields."""
        return len(self.skip_cost)

    @property
    def fleet_count(self) -> int:
        """Number of fleets."""
        return len(self.work_s)

    def get_fleet_kind(self, fleet: int) -> Hashable:
        """What interchangeable fleets have in common."""
        return self.work_s[fleet], self.work_cost[fleet], self.travel_s[fleet], self.travel_cost[fleet]

    @cached_property
    def _cost_cache(self) -> dict[tuple[int, Route], float | None]:
        """Costs of routes computed so far."""
        return {}

    def schedule_starts(self, fleet: int, route: Sequence[int]) -> list[int] | None:
        """Starts of the fields of a route; None if a field misses its windows or the return is too late."""
        now_s, place, starts, travel_s = self.begin_s, self.field_count, [], self.travel_s[fleet]
        for field in route:
            work_s = self.work_s[fleet][field]
            arrives_s = now_s + travel_s[place][field]
            start_s = None if work_s is None else self.find_earliest_start(field, arrives_s, work_s)
            if start_s is None or work_s is None:
                return None
            starts.append(start_s)
            now_s, place = start_s + work_s, field
        return None if route and now_s + travel_s[place][self.field_count] > self.home_by_s else starts

    def find_earliest_start(self, field: int, arrives_s: int, work_s: int) -> int | None:
        """The earliest start of work; None if it fits no remaining window."""
        for opens, closes in self.windows[field]:
            start = max(arrives_s, opens)
            if start + work_s <= closes:
                return start
        return None

    def compute_route_cost(self, fleet: int, route: Route) -> float | None:
        """Expected cost of a fleet's day with haste; None if the route is not feasible."""
        key = fleet, route
        if key not in self._cost_cache:
            starts, cost = self.schedule_starts(fleet, route), None
            if starts is not None:
                jobs = zip(route, starts, strict=True)
                work_cost = sum(self.compute_job_cost(fleet, field, start) for field, start in jobs)
                cost = work_cost + self.compute_travel_cost(fleet, route)
            self._cost_cache[key] = cost
        return self._cost_cache[key]

    def compute_job_cost(self, fleet: int, field: int, start_s: int) -> float:
        """Cost of work, expected loss by rain, and haste."""
        work = self.work_s[fleet][field] or 1
        lost = self.value_at_risk[field] * self.rain.estimate_undone_share(start_s, work)
        return self.work_cost[fleet][field] + lost + HASTE_COST_PER_S * (start_s + work - self.begin_s)

    def compute_travel_cost(self, fleet: int, route: Route) -> float:
        """Travel cost of a route, with the return."""
        if not route:
            return 0.0
        depot, prices = self.field_count, self.travel_cost[fleet]
        return sum(prices[a][b] for a, b in zip((depot, *route), (*route, depot), strict=True))

    def list_skipped_fields(self, routes: Sequence[Route]) -> list[int]:
        """The fields that are on no route, in order."""
        worked_fields = {field for route in routes for field in route}
        return [field for field in range(self.field_count) if field not in worked_fields]

    def compute_day_cost(self, routes: Sequence[Route]) -> float | None:
        """Expected cost of a day with skipped fields; None if a route is not feasible."""
        total = sum(self.skip_cost[field] for field in self.list_skipped_fields(routes))
        for fleet, route in enumerate(routes):
            cost = self.compute_route_cost(fleet, route)
            if cost is None:
                return None
            total += cost
        return total


@dataclass(frozen=True)
class DayProof:
    """What a proof found: better routes (None: none or no better), and a lower bound of the cost."""

    routes: Routes | None
    lower_bound: float


def make_empty_routes(problem: DayProblem) -> Routes:
    """A day on which no fleet works."""
    return ((),) * problem.fleet_count


@dataclass(frozen=True)
class RouteInsertion:
    """A position for a field, and the added cost of the day (below 0: cheaper)."""

    added_cost: float
    fleet: int
    position: int


def find_insertions(problem: DayProblem, routes: Sequence[Route], field: int) -> list[RouteInsertion]:
    """The best position for a field in every feasible fleet, cheapest first."""
    insertions = []
    for fleet, route in enumerate(routes):
        cost_before = problem.compute_route_cost(fleet, route)
        if cost_before is None or problem.work_s[fleet][field] is None:
            continue
        options = []
        for position in range(len(route) + 1):
            cost = problem.compute_route_cost(fleet, (*route[:position], field, *route[position:]))
            if cost is not None:
                options.append((cost - cost_before - problem.skip_cost[field], position))
        if options:
            added_cost, position = min(options)
            insertions.append(RouteInsertion(added_cost, fleet, position))
    return sorted(insertions, key=lambda place: (place.added_cost, place.fleet))


def insert_field(routes: Sequence[Route], field: int, insertion: RouteInsertion) -> Routes:
    """The routes with a field inserted."""
    return tuple(
        (*route[: insertion.position], field, *route[insertion.position :]) if fleet == insertion.fleet else route
        for fleet, route in enumerate(routes)
    )


def repair_routes(
    problem: DayProblem, routes: Sequence[Route], fields: Iterable[int], use_regret: bool = True
) -> Routes:
    """The routes with all those fields inserted that make the day cheaper.

    With `use_regret`, the field is inserted first that would lose most with its second best fleet, otherwise the one
    that gains most.
    """
    pending, result = set(fields), tuple(routes)
    while pending:
        options = {field: find_insertions(problem, result, field) for field in sorted(pending)}
        profitable = {field: own for field, own in options.items() if own and own[0].added_cost < -COST_TOLERANCE}
        if not profitable:
            break
        field = min(
            profitable,
            key=lambda one: (
                -_compute_insertion_urgency(problem, profitable[one], one, use_regret),
                profitable[one][0].added_cost,
                one,
            ),
        )
        result = insert_field(result, field, profitable[field][0])
        pending.discard(field)
    return result


def _compute_insertion_urgency(
    problem: DayProblem, insertions: list[RouteInsertion], field: int, use_regret: bool
) -> float:
    """The possible loss if this field is not inserted next."""
    if not use_regret:
        return -insertions[0].added_cost
    second = min(insertions[1].added_cost, 0.0) if len(insertions) > 1 else 0.0
    return second - insertions[0].added_cost
