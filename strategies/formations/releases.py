"""When each tractor of a round leaves the queue so that all are in place soonest (OR-Tools CP-SAT)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from strategies.formations.abreast import Slot
from strategies.formations.passages import TICKS_PER_S, Passage

if TYPE_CHECKING:
    from ortools.sat.python import cp_model

Releases = Mapping[tuple[int, int], tuple[tuple[int, float], ...]]
"""For (round, tractor): it may leave the queue when each named tractor is so many metres past its own release."""


def releases_of(number: int, group: list[Passage], slots: tuple[Slot, ...], hold_s: float) -> Releases:
    """Optimal releases of one round as distances the others must have driven since their own release."""
    when = _solve(group, slots, hold_s)
    by_time = sorted(range(len(group)), key=lambda i: (when[i], slots[i].row, i))
    releases: dict[tuple[int, int], tuple[tuple[int, float], ...]] = {}
    for place, mine in enumerate(by_time):
        gates = []
        for other in by_time[:place]:
            lag = (when[mine] - when[other]) / TICKS_PER_S
            if lag > 0 and group[mine].taken.keys() & group[other].taken.keys():
                metres = group[other].metres
                gates.append((group[other].tractor, float(metres[min(round(lag * TICKS_PER_S), len(metres) - 1)])))
        releases[number, group[mine].tractor] = tuple(gates)
    return releases


def _solve(group: list[Passage], slots: tuple[Slot, ...], hold_s: float) -> list[int]:
    """Release of each tractor in ticks: all in place soonest, then released soonest, no stretch shared."""
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    ticks = [math.ceil(passage.placed_s * TICKS_PER_S) for passage in group]
    horizon = sum(ticks) + round(hold_s * TICKS_PER_S) * len(group) * 2
    release = [model.new_int_var(0, horizon, f"release_{i}") for i in range(len(group))]
    stretches: dict[int, list[cp_model.IntervalVar]] = {}
    for start, passage in zip(release, group, strict=True):
        for stretch, (first, last) in sorted(passage.taken.items()):
            begin = math.floor(first * TICKS_PER_S)
            length = math.ceil((last + hold_s) * TICKS_PER_S) - begin
            interval = model.new_fixed_size_interval_var(start + begin, length, "")
            stretches.setdefault(stretch, []).append(interval)
    place = {slot.tractor: index for index, slot in enumerate(slots)}
    for index, slot in enumerate(slots):
        if slot.neighbour is not None:
            model.add(release[index] >= release[place[slot.neighbour]])
    for stretch in sorted(stretches):
        model.add_no_overlap(stretches[stretch])
    placed = model.new_int_var(0, horizon + max(ticks), "placed")
    for start, length in zip(release, ticks, strict=True):
        model.add(placed >= start + length)
    model.minimize(placed * (horizon * len(group) + 1) + sum(release))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.catch_sigint_signal = False  # it would end the search alone, and nobody else would hear it
    solver.parameters.random_seed = 1
    solver.parameters.max_deterministic_time = 2.0
    status = solver.solve(model)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return _one_after_another(ticks)
    return [solver.value(var) for var in release]


def _one_after_another(ticks: list[int]) -> list[int]:
    """Releases without any overlap, when the solver ran out of its share of time."""
    starts = [0]
    for length in ticks[:-1]:
        starts.append(starts[-1] + length)
    return starts
