"""A day as numbers, and what an order of fields costs a fleet.

All times are whole working seconds (planner.day.build.Frame). A fleet leaves the depot, works its fields one after
another, each in one go within one of its windows, and returns. Costs never fall when something is done later, so that a
fleet that follows an order begins everything as early as it can.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

HASTE = 1e-6  # money per second and field: of days that cost the same the one that is done sooner is better
EVEN = 1e-9  # money; what differs by less costs the same
Route = tuple[int, ...]


@dataclass(frozen=True)
class Rain:
    """Rain begins at one of `onsets`, (working second, share); what is missing to 1 is no rain."""

    onsets: tuple[tuple[int, float], ...] = ()

    def undone(self, start_s: int, work_s: int) -> float:
        """Share of a piece of work that is not done when it begins to rain, in the mean."""
        end = start_s + work_s
        return sum(share * min(max((end - at) / work_s, 0.0), 1.0) for at, share in self.onsets)


DRY = Rain()


@dataclass(frozen=True)
class Problem:
    """Fields 0..n-1, fleets 0..m-1; the depot is place n.

    `work_s[k][f]` is what fleet k takes for field f (None: it cannot), `paid[k][f]` what that costs, `put_off[f]` what
    it costs to leave a field, `stake[f]` what is lost of it when rain comes before all of it. `windows[f]` are (opens,
    closes), sorted. `move_s[k][a][b]` is from place to place with all that is done on the way, `move_cost[k][a][b]` its
    price: folding and unfolding, and tanks made good after a field and before the next.
    Fleets leave at `begin_s` at the earliest and are back by `home_by_s`.
    """

    work_s: tuple[tuple[int | None, ...], ...]
    paid: tuple[tuple[float, ...], ...]
    put_off: tuple[float, ...]
    stake: tuple[float, ...]
    windows: tuple[tuple[tuple[int, int], ...], ...]
    move_s: tuple[tuple[tuple[int, ...], ...], ...]
    move_cost: tuple[tuple[tuple[float, ...], ...], ...]
    begin_s: int
    home_by_s: int
    rain: Rain = DRY

    @property
    def fields(self) -> int:
        """Number of fields."""
        return len(self.put_off)

    @property
    def fleets(self) -> int:
        """Number of fleets."""
        return len(self.work_s)

    def kind(self, fleet: int) -> Hashable:
        """What fleets have in common that may take each other's place."""
        return self.work_s[fleet], self.paid[fleet], self.move_s[fleet], self.move_cost[fleet]

    @cached_property
    def _known(self) -> dict[tuple[int, Route], float | None]:
        """Costs that were worked out already."""
        return {}

    def starts(self, fleet: int, route: Sequence[int]) -> list[int] | None:
        """When each field of a route begins, None where one has no window left or the way home is too late."""
        now, at, starts, move_s = self.begin_s, self.fields, [], self.move_s[fleet]
        for field in route:
            work = self.work_s[fleet][field]
            arrives = now + move_s[at][field]
            start = None if work is None else self.earliest(field, arrives, work)
            if start is None or work is None:
                return None
            starts.append(start)
            now, at = start + work, field
        return None if route and now + move_s[at][self.fields] > self.home_by_s else starts

    def earliest(self, field: int, arrives_s: int, work_s: int) -> int | None:
        """When work can begin, None where no window is left that holds it."""
        for opens, closes in self.windows[field]:
            start = max(arrives_s, opens)
            if start + work_s <= closes:
                return start
        return None

    def route_cost(self, fleet: int, route: Route) -> float | None:
        """What a fleet's day costs in the mean, its haste included; None where it cannot be driven."""
        key = fleet, route
        if key not in self._known:
            starts = self.starts(fleet, route)
            self._known[key] = None if starts is None else self._cost(fleet, route, starts)
        return self._known[key]

    def job_cost(self, fleet: int, field: int, start_s: int) -> float:
        """Work and what the rain takes of it, with haste."""
        work = self.work_s[fleet][field] or 1
        lost = self.stake[field] * self.rain.undone(start_s, work)
        return self.paid[fleet][field] + lost + HASTE * (start_s + work - self.begin_s)

    def _cost(self, fleet: int, route: Route, starts: list[int]) -> float:
        jobs = sum(self.job_cost(fleet, field, start) for field, start in zip(route, starts, strict=True))
        return jobs + self.ways_cost(fleet, route)

    def ways_cost(self, fleet: int, route: Route) -> float:
        """What the ways of a route cost, that home included."""
        if not route:
            return 0.0
        depot, prices = self.fields, self.move_cost[fleet]
        return sum(prices[a][b] for a, b in zip((depot, *route), (*route, depot), strict=True))

    def cost(self, routes: Sequence[Route]) -> float | None:
        """What a whole day costs, fields that are left included; None where a route cannot be driven."""
        done = {field for route in routes for field in route}
        total = sum(self.put_off[field] for field in range(self.fields) if field not in done)
        for fleet, route in enumerate(routes):
            cost = self.route_cost(fleet, route)
            if cost is None:
                return None
            total += cost
        return total


def empty(problem: Problem) -> tuple[Route, ...]:
    """A day on which nobody goes anywhere."""
    return ((),) * problem.fleets
