"""A field put where it costs least; fields put back one after another, those first that would regret waiting."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from planner.day.problem import EVEN, Problem, Route

Routes = tuple[Route, ...]


@dataclass(frozen=True)
class Place:
    """Where a field goes, and by how much the day gets dearer there (less than 0: cheaper)."""

    added: float
    fleet: int
    position: int


def places(problem: Problem, routes: Sequence[Route], field: int) -> list[Place]:
    """The best place on every fleet that can take the field, cheapest first."""
    found = []
    for fleet, route in enumerate(routes):
        before = problem.route_cost(fleet, route)
        if before is None or problem.work_s[fleet][field] is None:
            continue
        options = []
        for position in range(len(route) + 1):
            cost = problem.route_cost(fleet, (*route[:position], field, *route[position:]))
            if cost is not None:
                options.append((cost - before - problem.put_off[field], position))
        if options:
            added, position = min(options)
            found.append(Place(added, fleet, position))
    return sorted(found, key=lambda place: (place.added, place.fleet))


def put(routes: Sequence[Route], field: int, place: Place) -> Routes:
    """The routes with a field in its place."""
    return tuple(
        (*route[: place.position], field, *route[place.position :]) if fleet == place.fleet else route
        for fleet, route in enumerate(routes)
    )


def repaired(problem: Problem, routes: Sequence[Route], fields: Iterable[int], regret: bool = True) -> Routes:
    """The routes with as many of the fields as make the day cheaper.

    With `regret` the field goes first that loses most if its second best fleet has to take it, else the one that
    gains most.
    """
    left, done = set(fields), tuple(routes)
    while left:
        options = {field: places(problem, done, field) for field in sorted(left)}
        worth = {field: own for field, own in options.items() if own and own[0].added < -EVEN}
        if not worth:
            break
        field = min(worth, key=lambda one: (-_urgency(problem, worth[one], one, regret), worth[one][0].added, one))
        done = put(done, field, worth[field][0])
        left.discard(field)
    return done


def _urgency(problem: Problem, own: list[Place], field: int, regret: bool) -> float:
    """What is lost at most by not taking this field now."""
    if not regret:
        return -own[0].added
    second = min(own[1].added, 0.0) if len(own) > 1 else 0.0
    return second - own[0].added
