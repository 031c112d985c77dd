"""Days as numbers, made by hand and at random, and the best of them by trying all."""

from collections.abc import Iterator, Sequence
from itertools import permutations, product

import numpy as np

from planner.day.optimization.problem import NO_RAIN, DayProblem, RainOnsets, Routes

DAY = 86_400


def by_hand(
    work_s: Sequence[Sequence[int | None]], move_s: Sequence[Sequence[int]], *, put_off: Sequence[float],
    paid: Sequence[Sequence[float]] | None = None, windows: Sequence[Sequence[tuple[int, int]]] | None = None,
    per_move_s: float = 0.0, stake: Sequence[float] | None = None, rain: RainOnsets = NO_RAIN, home_by_s: int = DAY,
) -> DayProblem:  # fmt: skip
    """A day that begins at 0; ways cost so much per second, work nothing unless said."""
    fields = len(put_off)
    return DayProblem(
        work_s=tuple(map(tuple, work_s)),
        work_cost=tuple(map(tuple, paid)) if paid else ((0.0,) * fields,) * len(work_s),
        skip_cost=tuple(put_off),
        value_at_risk=tuple(stake or (0.0,) * fields),
        windows=tuple(map(tuple, windows)) if windows else (((0, DAY),),) * fields,
        travel_s=(tuple(map(tuple, move_s)),) * len(work_s),
        travel_cost=(tuple(tuple(per_move_s * seconds for seconds in row) for row in move_s),) * len(work_s),
        begin_s=0,
        home_by_s=home_by_s,
        rain=rain,
    )


def at_random(seed: int, fields: int, fleets: int) -> DayProblem:
    """A day with windows, rain, fields that some fleets cannot take and some that are not worth their way."""
    random = np.random.default_rng(seed)
    at = random.uniform(0.0, 10_000.0, (fields + 1, 2))
    move = np.rint(np.linalg.norm(at[:, None] - at[None], axis=2) / 5.0).astype(int) + 120
    np.fill_diagonal(move, 0)
    work = random.integers(1500, 9000, (fleets, fields))
    cannot = random.random((fleets, fields)) < 0.15
    windows = []
    for _ in range(fields):
        opens = int(random.integers(0, 15_000))
        first = (opens, opens + int(random.integers(5_000, 25_000)))
        later = (first[1] + 2_000, first[1] + 14_000)
        windows.append((first, later) if random.random() < 0.4 else (first,))
    onsets = tuple((int(at_s), 0.3) for at_s in sorted(random.integers(8_000, 30_000, 3)))
    return by_hand(
        [[None if none else int(seconds) for seconds, none in zip(*row, strict=True)]
         for row in zip(work.tolist(), cannot.tolist(), strict=True)],
        move.tolist(),
        put_off=random.uniform(60.0, 500.0, fields).tolist(),
        paid=(work * random.uniform(0.01, 0.03, (fleets, 1))).tolist(),
        windows=windows,
        per_move_s=0.02,
        stake=random.uniform(0.0, 300.0, fields).tolist(),
        rain=RainOnsets(onsets),
        home_by_s=40_000,
    )  # fmt: skip


def every_day(problem: DayProblem) -> Iterator[Routes]:
    """Every way to leave fields or give them to fleets, in every order."""
    for homes in product(range(-1, problem.fleet_count), repeat=problem.field_count):
        shares = [[field for field, home in enumerate(homes) if home == fleet] for fleet in range(problem.fleet_count)]
        yield from product(*(permutations(share) for share in shares))


def least_cost(problem: DayProblem) -> float:
    """What the best of all days costs."""
    costs = (problem.compute_day_cost(routes) for routes in every_day(problem))
    return min(cost for cost in costs if cost is not None)
