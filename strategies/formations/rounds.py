"""Rounds of a formation: neighbouring columns, one per tractor, and where each tractor stands in them.

Rows lead from the middle, a gap apart (thesis, section 6.3). At the end of a round they queue inside their columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from strategies.formations.columns import FIRST, OTHER, Column
from strategies.rules.driving_rules import DrivingRules

SHORTEST_M = 0.1  # of a stretch that is driven in formation
APPROACH_M = 1.0  # before its place in the queue a tractor is followed no longer: who follows stops when it stops
FindPlace = Callable[[float], float]
"""The nearest place on a column to one given, metres from its begin, that is in nobody's way."""


@dataclass(frozen=True, eq=False)
class ColumnRound:
    """Neighbouring columns of a run, in its order; tractor k works the k-th.

    Attributes:
        run: number of the run.
        columns: one per tractor.
    """

    run: int
    columns: tuple[Column, ...]

    @property
    def length_m(self) -> float:
        """Of all columns together (m)."""
        return math.fsum(column.length_m for column in self.columns)

    @cached_property
    def longest_m(self) -> float:
        """From the first begin of a column to the last end of one (m)."""
        spans = [column.project_span(FIRST) for column in self.columns]
        return max(last for _, last in spans) - min(first for first, _ in spans)

    def list_first_nodes(self, way: int) -> list[int]:
        """With which node each tractor begins in a direction."""
        return [column.list_nodes(way)[0] for column in self.columns]

    def list_last_nodes(self, way: int) -> list[int]:
        """With which node each tractor ends in a direction."""
        return [column.list_nodes(way)[-1] for column in self.columns]


def get_row(tractor: int, tractors: int) -> int:
    """The row of a tractor: 1 leads, in the middle."""
    return abs(tractor - (tractors - 1) // 2) + 1


def get_neighbour(tractor: int, tractors: int) -> int | None:
    """The tractor one row ahead that a tractor follows; None for the leader."""
    leader = (tractors - 1) // 2
    return None if tractor == leader else tractor + (1 if tractor < leader else -1)


@dataclass(frozen=True)
class RoundPlace:
    """Where a tractor stands in a round, in metres from the begin of its column.

    Attributes:
        place_m: its place in formation.
        hold_m: where it first waits in the queue.
        up_m: where it waits after moving up.
    """

    place_m: float
    hold_m: float
    up_m: tuple[float, ...] = ()

    @property
    def missing_m(self) -> float:
        """What the column lacks between the place in formation and that in the queue; 0 or less with room."""
        return self.place_m + APPROACH_M + SHORTEST_M - self.hold_m


def take_place(place_m: float) -> float:
    """Where nobody passes, any place will do."""
    return place_m


@dataclass(frozen=True, eq=False)
class ColumnTraffic:
    """How others pass a column while its tractor stands there.

    Attributes:
        find_place: finds its place in formation, clear of others that come to the round.
        find_wait: finds its place in the queue, clear of others that leave it.
        join_m, leave_m: what the moves to its column and from it cut from its ends.
    """

    find_place: FindPlace = take_place
    find_wait: FindPlace = take_place
    join_m: float = 0.0
    leave_m: float = 0.0


def place_tractors(
    one: ColumnRound, way: int, rules: DrivingRules, traffic: Sequence[ColumnTraffic] | None = None
) -> list[RoundPlace]:
    """The places of a round, clear of passing tractors.

    They are set from the last row forwards, each a gap ahead of the row behind it. In the queue the first waits
    clear of the headland, the others a gap behind one another.
    """
    count = len(one.columns)
    traffic = traffic or [ColumnTraffic()] * count
    rows = [get_row(tractor, count) for tractor in range(count)]
    spans = [column.project_span(way) for column in one.columns]
    begins_m = [first for first, _ in spans]
    ends_m = [end - each.leave_m for (_, end), each in zip(spans, traffic, strict=True)]
    places_m = _place_in_rows(begins_m, rows, traffic, rules.gap_m)
    fronts_m = [min(ends_m[j] for j in range(count) if rows[j] < row or j == k) for k, row in enumerate(rows)]
    places = []
    for k, row in enumerate(rows):
        queue_m, clear = fronts_m[k] - begins_m[k] - rules.hold_back_m, traffic[k].find_wait
        waits_m = [clear(queue_m - ahead * rules.gap_m) for ahead in range(row - 1, -1, -1)]
        ups_m = (up for before, up in pairwise(waits_m) if up > before + SHORTEST_M)
        places.append(RoundPlace(places_m[k] - begins_m[k], waits_m[0], tuple(ups_m)))
    return places


def _place_in_rows(
    begins_m: Sequence[float], rows: Sequence[int], traffic: Sequence[ColumnTraffic], gap_m: float
) -> list[float]:
    """Where each stands in formation along the heading, the last row first (m)."""
    places_m = [begin + each.join_m for begin, each in zip(begins_m, traffic, strict=True)]
    for row in range(max(rows), 0, -1):
        behind_m = [places_m[k] + gap_m for k in range(len(rows)) if rows[k] == row + 1]
        for k in (k for k in range(len(rows)) if rows[k] == row):
            place_m = max([places_m[k], *behind_m])
            places_m[k] = begins_m[k] + traffic[k].find_place(place_m - begins_m[k])
    return places_m


def has_room(one: ColumnRound, rules: DrivingRules) -> bool:
    """Whether a round has room for its formation and its queue, either way."""
    return all(place.missing_m <= 0.0 for way in (FIRST, OTHER) for place in place_tractors(one, way, rules))


def compute_needed_length_m(rules: DrivingRules, rows: int) -> float:
    """Length of the shortest column with room for so many rows, where columns end side by side (m)."""
    return APPROACH_M + SHORTEST_M + (rows - 1) * rules.gap_m + rules.hold_back_m


def divide_runs(runs: Sequence[Sequence[Column]], tractors: int, rules: DrivingRules) -> list[ColumnRound]:
    """The rounds that work most metres of the runs side by side; columns in none of them are left over."""
    return [one for number, run in enumerate(runs) for one in _divide_run(number, run, tractors, rules)]


def _divide_run(number: int, run: Sequence[Column], tractors: int, rules: DrivingRules) -> list[ColumnRound]:
    best: list[tuple[float, ColumnRound | None]] = [(0.0, None)] * (len(run) + tractors)
    for first in range(len(run) - tractors, -1, -1):
        one = ColumnRound(number, tuple(run[first : first + tractors]))
        worked_m = round(one.length_m + best[first + tractors][0], 3) if has_room(one, rules) else -math.inf
        best[first] = max(((best[first + 1][0], None), (worked_m, one)), key=lambda option: option[0])
    rounds, first = [], 0
    while first < len(run):
        chosen = best[first][1]
        rounds += [] if chosen is None else [chosen]
        first += 1 if chosen is None else tractors
    return rounds
