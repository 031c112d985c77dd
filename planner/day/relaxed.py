"""What no day costs less than, for more fields than their routes can be counted: prices on fields (Lagrange).

Every field gets a price. A route is then worth the prices of its fields less what it costs, and a day costs at least
all prices, less what leaving fields saves, less what the best route of every fleet is worth. The best route is found by
dynamic programming over rounded times among more routes than there are: it may come back to a field after it has been
far enough from it to forget it (ng-routes; Baldacci, Mingozzi and Roberti 2011), and what it does is done no later than
it would be. So the bound holds for any prices; subgradient steps (Held and Karp 1971) raise it. Effort is counted in
steps from field to field, never by the clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.day.problem import HASTE, Problem
from vehicle.jit import compiled

NEAR = 6  # fields that a route remembers at each field, itself among them
GRAIN_S = 120  # times are rounded down to so many seconds
MOST_STEPS, MOST_ROUNDS = 250_000_000, 300
PATIENCE, LEAST_STRIDE = 12, 1e-3  # rounds without a better bound before strides are halved, and when they end
MEMORY = 0.3  # of the direction before in the next one
ALREADY = 1e-4  # of the cost: a gap that is as good as none
Array = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Fleet:
    """One kind of fleet and how many there are of it.

    Of fields n and seconds s after the beginning: `start_s` (n, s) when work begins that is arrived for then (-1:
    never), `job` (n, s) what it costs when begun then; `work_s` (n,), `move_s` and `way` (n + 1, n + 1) time and price
    of ways.
    """

    count: int
    start_s: Whole
    job: Array
    work_s: Whole
    move_s: Whole
    way: Array


@dataclass(frozen=True, eq=False)
class _Memory:
    """Which visits a route remembers: `place` (n, n) of a field in the memory at another (-1: none there), `after`
    (n, n, masks) what is remembered when going from one to the other."""

    place: Whole
    after: Whole


def bound(problem: Problem, known: float, least: Sequence[float]) -> float:
    """What no day costs less than. `known` is the cost of a day, `least` what each field costs at least."""
    if not problem.fields or not math.isfinite(known) or problem.home_by_s < problem.begin_s:
        return sum(least)
    fleets, memory = _fleets(problem), _memory(problem)
    put_off = np.array(problem.put_off)
    home_s = problem.home_by_s - problem.begin_s
    grain_s = min([GRAIN_S, *(one for row in problem.work_s for one in row if one)])  # every field takes one or more
    prices, highest, direction = np.array(least), sum(least), np.zeros(problem.fields)
    best, stride, waited, steps = prices, 1.0, 0, 0
    for _ in range(MOST_ROUNDS):
        left = put_off < prices
        value, missing = float(np.minimum(prices, put_off).sum()), 1.0 - left
        for fleet in fleets:
            worth, visits, taken = _best_route(
                fleet.move_s, fleet.start_s, fleet.job, fleet.work_s, fleet.way, prices, memory.place, memory.after,
                home_s, grain_s,
            )  # fmt: skip
            value += fleet.count * min(worth, 0.0)
            missing = missing - fleet.count * visits * (worth < 0.0)
            steps += int(taken)
        better = value > highest
        highest, best, waited = (value, prices, 0) if better else (highest, best, waited + 1)
        if waited >= PATIENCE:
            prices, stride, waited, direction = best, 0.5 * stride, 0, np.zeros(problem.fields)
            continue
        direction = missing + MEMORY * direction
        size = float(direction @ direction)
        if known - highest <= ALREADY * known or size == 0.0 or stride < LEAST_STRIDE or steps > MOST_STEPS:
            break
        prices = prices + stride * (known - value) / size * direction
    return highest


def _fleets(problem: Problem) -> list[_Fleet]:
    """The kinds of fleets with tables of their starts and costs."""
    kinds: dict[object, list[int]] = {}
    for fleet in range(problem.fleets):
        kinds.setdefault(problem.kind(fleet), []).append(fleet)
    return [_tables(problem, alike[0], len(alike)) for alike in kinds.values()]


def _tables(problem: Problem, fleet: int, count: int) -> _Fleet:
    """Starts and costs by second."""
    seconds = np.arange(max(problem.home_by_s - problem.begin_s, 0) + 1)
    start = np.full((problem.fields, len(seconds)), -1, dtype=np.int64)
    job = np.zeros((problem.fields, len(seconds)))
    work_s = np.array([one or 0 for one in problem.work_s[fleet]], dtype=np.int64)
    for field, work in enumerate(problem.work_s[fleet]):
        if work is None:
            continue
        for opens, closes in reversed(problem.windows[field]):
            begins = np.maximum(seconds, opens - problem.begin_s)
            start[field] = np.where(begins + work <= closes - problem.begin_s, begins, start[field])
        job[field] = problem.paid[fleet][field] + HASTE * (seconds + work)
        for at, share in problem.rain.onsets:
            late = (seconds + (problem.begin_s + work - at)) / work
            job[field] += problem.stake[field] * share * np.clip(late, 0.0, 1.0)
    move_s = np.array(problem.move_s[fleet], dtype=np.int64)
    return _Fleet(count, start, job, work_s, move_s, np.array(problem.move_cost[fleet]))


def _memory(problem: Problem) -> _Memory:
    """Every field remembers those that are nearest to it, and itself."""
    count = problem.fields
    kept = min(NEAR, count)
    near = [_nearest(problem, field) for field in range(count)]
    place = np.full((count, count), -1, dtype=np.int64)
    for field, order in enumerate(near):
        place[field, order[:kept]] = np.arange(kept)
    masks = np.arange(1 << kept)
    after = np.zeros((count, count, len(masks)), dtype=np.int64)
    for a in range(count):
        for b in range(count):
            for other in near[a][:kept]:
                if place[b, other] >= 0:
                    after[a, b] |= (masks >> place[a, other] & 1) << place[b, other]
            after[a, b] |= 1 << place[b, b]
    return _Memory(place, after)


def _nearest(problem: Problem, field: int) -> list[int]:
    """All fields, itself first, then by the time of the way."""
    away = problem.move_s[0][field]
    return sorted(range(problem.fields), key=lambda other: (-1 if other == field else away[other], other))


@compiled
def _best_route(
    move: Whole, start_s: Whole, job: Array, work_s: Whole, way: Array, prices: Array, place: Whole, after: Whole,
    home_s: int, grain_s: int,
) -> tuple[float, Array, int]:  # fmt: skip
    """The least of cost less prices of any route, 0 for none, how often it visits each field, and the steps taken.

    Routes grow by the time they are done, rounded down. One that is as far, remembers the same and is done later at
    no less is dropped.
    """
    count, masks = start_s.shape[0], after.shape[2]
    times = home_s // grain_s + 1
    cost = np.full((times, count, masks), np.inf)
    before = np.full((times, count, masks), -1, dtype=np.int64)
    cheapest = np.full((count, masks), np.inf)
    worth, end, steps = 0.0, -1, 0
    for field in range(count):
        arrives = move[count, field]
        if arrives > home_s or start_s[field, arrives] < 0:
            continue
        begins = start_s[field, arrives]
        done = (begins + work_s[field]) // grain_s
        value = way[count, field] + job[field, begins] - prices[field]
        own = 1 << place[field, field]
        if done < times and value < cost[done, field, own]:
            cost[done, field, own] = value
    for time in range(times):
        for last in range(count):
            for mask in range(masks):
                value = cost[time, last, mask]
                if value >= cheapest[last, mask]:
                    continue
                cheapest[last, mask] = value
                state = (time * count + last) * masks + mask
                now = time * grain_s
                if now + move[last, count] <= home_s and value + way[last, count] < worth:
                    worth, end = value + way[last, count], state
                for field in range(count):
                    known = place[last, field]
                    arrives = now + move[last, field]
                    if (known >= 0 and mask >> known & 1) or arrives > home_s:
                        continue
                    begins = start_s[field, arrives]
                    if begins < 0:
                        continue
                    steps += 1
                    done = (begins + work_s[field]) // grain_s
                    longer = value + way[last, field] + job[field, begins] - prices[field]
                    kept = after[last, field, mask]
                    if done < times and longer < cost[done, field, kept]:
                        cost[done, field, kept] = longer
                        before[done, field, kept] = state
    visits = np.zeros(count)
    while end >= 0:
        last = end // masks % count
        visits[last] += 1.0
        end = before[end // masks // count, last, end % masks]
    return worth, visits, steps
