"""A lower bound of the cost of a day with too many routes to enumerate, by prices on fields (Lagrange).

Every field gets a price. The worth of a route is the prices of its fields less its cost; a day costs at least all
prices, less the savings of skipping fields, less the worth of the best route of every fleet. The best route is found by
dynamic programming over rounded times in a relaxed set of routes: a route may return to a field that it has forgotten
(ng-routes; Baldacci, Mingozzi and Roberti 2011), and is never later than in reality. So the bound holds for any prices;
subgradient steps (Held and Karp 1971) raise it. The effort is counted in extensions of routes, never by the clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats, Integers
from planner.day.optimization.problem import HASTE_COST_PER_S, DayProblem
from vehicle.jit import compile_function

REMEMBERED_FIELDS = 6  # fields that a route remembers at each field, including itself
GRAIN_S = 120  # times are rounded down to multiples of this
MAX_STEPS, MAX_ITERATIONS = 250_000_000, 300
STALL_ITERATIONS, MIN_STRIDE = 12, 1e-3  # iterations without a better bound until the stride is halved; its minimum
MOMENTUM = 0.3  # weight of the previous direction
NEGLIGIBLE_GAP = 1e-4  # of the cost


@dataclass(frozen=True, eq=False)
class _FleetTables:
    """One kind of fleet and the number of such fleets.

    With n fields and s seconds after the beginning: `start_s` (n, s) start of work by second of arrival (-1: never),
    `job_cost` (n, s) cost by second of start, `work_s` (n,), `travel_s` and `travel_cost` (n + 1, n + 1).
    """

    count: int
    start_s: Integers
    job_cost: Floats
    work_s: Integers
    travel_s: Integers
    travel_cost: Floats


@dataclass(frozen=True, eq=False)
class _RouteMemory:
    """The visits that a route remembers: `slot` (n, n) is the bit of a field in the memory at another field (-1: none),
    `next_mask` (n, n, masks) the memory after going from one field to another.
    """

    slot: Integers
    next_mask: Integers


def compute_lower_bound(problem: DayProblem, known_cost: float, least_costs: Sequence[float]) -> float:
    """A lower bound of the cost of a day, from the cost of a known day and the least cost of every field."""
    if not problem.field_count or not math.isfinite(known_cost) or problem.home_by_s < problem.begin_s:
        return sum(least_costs)
    kinds: dict[object, list[int]] = {}
    for number in range(problem.fleet_count):
        kinds.setdefault(problem.get_fleet_kind(number), []).append(number)
    fleets = [_build_fleet_tables(problem, alike[0], len(alike)) for alike in kinds.values()]
    memory = _build_route_memory(problem)
    skip_cost = np.array(problem.skip_cost)
    home_s = problem.home_by_s - problem.begin_s
    # Every field takes at least one grain.
    grain_s = min([GRAIN_S, *(work_s for row in problem.work_s for work_s in row if work_s)])
    prices, highest, direction = np.array(least_costs), sum(least_costs), np.zeros(problem.field_count)
    best, stride, stalled, steps = prices, 1.0, 0, 0
    for _ in range(MAX_ITERATIONS):
        is_skipped = skip_cost < prices
        value, missing = float(np.minimum(prices, skip_cost).sum()), 1.0 - is_skipped
        for fleet in fleets:
            worth, visits, steps_taken = _find_best_route(
                fleet.travel_s,
                fleet.start_s,
                fleet.job_cost,
                fleet.work_s,
                fleet.travel_cost,
                prices,
                memory.slot,
                memory.next_mask,
                home_s,
                grain_s,
            )
            value += fleet.count * min(worth, 0.0)
            missing = missing - fleet.count * visits * (worth < 0.0)
            steps += int(steps_taken)
        is_better = value > highest
        highest, best, stalled = (value, prices, 0) if is_better else (highest, best, stalled + 1)
        if stalled >= STALL_ITERATIONS:
            prices, stride, stalled, direction = best, 0.5 * stride, 0, np.zeros(problem.field_count)
            continue
        direction = missing + MOMENTUM * direction
        size = float(direction @ direction)
        is_close = known_cost - highest <= NEGLIGIBLE_GAP * known_cost
        if is_close or size == 0.0 or stride < MIN_STRIDE or steps > MAX_STEPS:
            break
        prices = prices + stride * (known_cost - value) / size * direction
    return highest


def _build_fleet_tables(problem: DayProblem, fleet: int, count: int) -> _FleetTables:
    """Starts and costs by second."""
    seconds = np.arange(max(problem.home_by_s - problem.begin_s, 0) + 1)
    start_s = np.full((problem.field_count, len(seconds)), -1, dtype=np.int64)
    job_cost = np.zeros((problem.field_count, len(seconds)))
    work_s = np.array([seconds_or_none or 0 for seconds_or_none in problem.work_s[fleet]], dtype=np.int64)
    for field, work in enumerate(problem.work_s[fleet]):
        if work is None:
            continue
        for opens, closes in reversed(problem.windows[field]):
            begins = np.maximum(seconds, opens - problem.begin_s)
            start_s[field] = np.where(begins + work <= closes - problem.begin_s, begins, start_s[field])
        job_cost[field] = problem.work_cost[fleet][field] + HASTE_COST_PER_S * (seconds + work)
        for onset_s, share in problem.rain.onsets:
            late = (seconds + (problem.begin_s + work - onset_s)) / work
            job_cost[field] += problem.value_at_risk[field] * share * np.clip(late, 0.0, 1.0)
    travel_s = np.array(problem.travel_s[fleet], dtype=np.int64)
    return _FleetTables(count, start_s, job_cost, work_s, travel_s, np.array(problem.travel_cost[fleet]))


def _build_route_memory(problem: DayProblem) -> _RouteMemory:
    """The memory at every field: itself and the fields nearest to it."""
    count = problem.field_count
    memory_size = min(REMEMBERED_FIELDS, count)
    nearest = []
    for field in range(count):
        travel_s = problem.travel_s[0][field]
        nearest.append(sorted(range(count), key=lambda one: (-1 if one == field else travel_s[one], one)))
    slot = np.full((count, count), -1, dtype=np.int64)
    for field, order in enumerate(nearest):
        slot[field, order[:memory_size]] = np.arange(memory_size)
    masks = np.arange(1 << memory_size)
    next_mask = np.zeros((count, count, len(masks)), dtype=np.int64)
    for a in range(count):
        for b in range(count):
            for neighbour in nearest[a][:memory_size]:
                if slot[b, neighbour] >= 0:
                    next_mask[a, b] |= (masks >> slot[a, neighbour] & 1) << slot[b, neighbour]
            next_mask[a, b] |= 1 << slot[b, b]
    return _RouteMemory(slot, next_mask)


@compile_function
def _count_visits(predecessor: Integers, end: int) -> Floats:
    """Visits of every field (count,) by the route to a state `end`; none if it is negative."""
    _, count, masks = predecessor.shape
    visits = np.zeros(count)
    while end >= 0:
        last = end // masks % count
        visits[last] += 1.0
        end = predecessor[end // masks // count, last, end % masks]
    return visits


@compile_function
def _find_best_route(
    travel_s: Integers,
    start_s: Integers,
    job_cost: Floats,
    work_s: Integers,
    travel_cost: Floats,
    prices: Floats,
    memory_slot: Integers,
    next_mask: Integers,
    home_s: int,
    grain_s: int,
) -> tuple[float, Floats, int]:
    """The least cost less prices of any route (0 for none), its visits of every field, and the steps taken.

    Routes are extended in order of their end, rounded down. A route at the same field with the same memory that ends
    later and is not cheaper is dropped.
    """
    count, masks = start_s.shape[0], next_mask.shape[2]
    times = home_s // grain_s + 1
    cost = np.full((times, count, masks), np.inf)
    predecessor = np.full((times, count, masks), -1, dtype=np.int64)
    cheapest = np.full((count, masks), np.inf)
    worth, end, steps = 0.0, -1, 0
    for field in range(count):
        arrives_s = travel_s[count, field]
        if arrives_s > home_s or start_s[field, arrives_s] < 0:
            continue
        begins_s = start_s[field, arrives_s]
        done = (begins_s + work_s[field]) // grain_s
        value = travel_cost[count, field] + job_cost[field, begins_s] - prices[field]
        own_mask = 1 << memory_slot[field, field]
        if done < times and value < cost[done, field, own_mask]:
            cost[done, field, own_mask] = value
    for time in range(times):
        for last in range(count):
            for mask in range(masks):
                value = cost[time, last, mask]
                if value >= cheapest[last, mask]:
                    continue
                cheapest[last, mask] = value
                state = (time * count + last) * masks + mask
                now_s = time * grain_s
                if now_s + travel_s[last, count] <= home_s and value + travel_cost[last, count] < worth:
                    worth, end = value + travel_cost[last, count], state
                for field in range(count):
                    slot = memory_slot[last, field]
                    arrives_s = now_s + travel_s[last, field]
                    if (slot >= 0 and mask >> slot & 1) or arrives_s > home_s:
                        continue
                    begins_s = start_s[field, arrives_s]
                    if begins_s < 0:
                        continue
                    steps += 1
                    done = (begins_s + work_s[field]) // grain_s
                    longer = value + travel_cost[last, field] + job_cost[field, begins_s] - prices[field]
                    new_mask = next_mask[last, field, mask]
                    if done < times and longer < cost[done, field, new_mask]:
                        cost[done, field, new_mask] = longer
                        predecessor[done, field, new_mask] = state
    return worth, _count_visits(predecessor, end), steps
