"""Columns of a formation: swaths as one tractor drives them in one go, and runs of neighbouring ones.

Pieces of a swath between which the implement stays down are one column. A run follows the columns from swath to swath
where they overlap most, so that a hole or a notch splits runs but a few short swaths beside them do not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from strategies.lines.work_line import WorkLine
from strategies.path_planning.paths import Pose
from strategies.programmes.move_table import MoveTable, split_apart
from vehicle.missions.plan import SWATH

PARALLEL_RAD = 1e-3
NEIGHBOUR_WIDTHS = 1.5  # working widths within which a parallel column is a neighbour
STRAIGHT_M = 0.5  # a line that leaves the straight between its ends by more is no column
FIRST, OTHER = range(2)  # directions, as of a work line


@dataclass(frozen=True, eq=False)
class Column:
    """A swath, or pieces of it between which the implement stays down.

    Attributes:
        swath: its number.
        nodes: (per piece) nodes of the table, in the first direction.
        ends: poses of the guided point where it begins and ends, in the first direction.
        other_ends: those in the other direction.
    """

    swath: int
    nodes: tuple[int, ...]
    ends: tuple[Pose, Pose]
    other_ends: tuple[Pose, Pose]

    def list_nodes(self, way: int) -> tuple[int, ...]:
        """Its nodes in a direction."""
        return self.nodes if way == FIRST else tuple(node ^ 1 for node in self.nodes[::-1])

    def get_ends(self, way: int) -> tuple[Pose, Pose]:
        """Where it begins and ends in a direction."""
        return self.ends if way == FIRST else self.other_ends

    @property
    def length_m(self) -> float:
        """From its begin straight to its end (m)."""
        return math.dist(self.ends[0][:2], self.ends[1][:2])

    def project_span(self, way: int) -> tuple[float, float]:
        """Where it begins and ends along its own heading in a direction (m)."""
        (x, y, heading), (u, v, _) = self.get_ends(way)
        cosine, sine = math.cos(heading), math.sin(heading)
        return x * cosine + y * sine, u * cosine + v * sine


def list_columns(table: MoveTable) -> list[Column]:
    """The columns of a table by swath, and along each swath in its first direction."""
    pieces: dict[int, list[int]] = {}
    for number, line in enumerate(table.lines):
        if line.task.kind == SWATH and line.both_ways and _is_straight(line):
            pieces.setdefault(line.task.number or 0, []).append(number)
    orders = {swath: _order_pieces(table, pieces[swath]) for swath in sorted(pieces)}
    joints = [joint for order in orders.values() for joint in pairwise(order)]
    table.prove([pair for joint in joints for pair in _list_ways(*joint)])
    return [column for swath, order in orders.items() for column in _join_pieces(table, swath, order)]


def _is_straight(line: WorkLine) -> bool:
    (x, y), (u, v) = line.paths[0][0], line.paths[0][-1]
    east_m, north_m = (line.paths[0] - (x, y)).T
    away_m = (east_m * (y - v) + north_m * (u - x)) / math.hypot(u - x, v - y)
    return bool(np.abs(away_m).max() <= STRAIGHT_M)


def _order_pieces(table: MoveTable, numbers: Sequence[int]) -> list[int]:
    """The pieces of one swath along its first direction."""
    heading = table.lines[numbers[0]].get_begin(FIRST)[2]

    def measure_ahead_m(number: int) -> float:
        x, y = table.lines[number].paths[0][0].tolist()
        return round(float(x * math.cos(heading) + y * math.sin(heading)), 3)

    return sorted(numbers, key=measure_ahead_m)


def _list_ways(before: int, after: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """From one line to the next along their first direction, and back."""
    return (2 * before, 2 * after), (2 * after + 1, 2 * before + 1)


def _join_pieces(table: MoveTable, swath: int, order: Sequence[int]) -> Iterator[Column]:
    """The columns of one swath: a piece goes on in the next where the implement stays down both ways."""

    def stays_down(u: int, v: int) -> bool:
        move = table.get_move(u, v) if table.is_proven(u, v) else None
        return move is not None and move.is_work

    for part in split_apart(order, lambda a, b: all(stays_down(*way) for way in _list_ways(a, b))):
        first, last = table.lines[part[0]], table.lines[part[-1]]
        ends, other_ends = ((a.get_begin(way), b.get_end(way)) for a, b, way in ((first, last, 0), (last, first, 1)))
        yield Column(swath, tuple(2 * number for number in part), ends, other_ends)


def find_runs(columns: Sequence[Column], width_m: float) -> list[list[Column]]:
    """Runs of neighbouring columns, each joined to the one of the next swath that it overlaps most."""
    pairs = sorted(_list_overlaps(columns, width_m), key=lambda pair: (-pair[0], pair[1], pair[2]))
    after, taken = dict[int, int](), set[int]()
    for _, a, b in pairs:
        if a not in after and b not in taken:
            after[a] = b
            taken.add(b)
    runs = []
    for index in range(len(columns)):
        if index not in taken:
            run = [index]
            while run[-1] in after:
                run.append(after[run[-1]])
            runs.append([columns[number] for number in run])
    return runs


def _list_overlaps(columns: Sequence[Column], width_m: float) -> Iterator[tuple[float, int, int]]:
    """Pairs of neighbouring parallel columns: by how many metres they overlap, and their indices."""
    by_swath: dict[int, list[int]] = {}
    for index, column in enumerate(columns):
        by_swath.setdefault(column.swath, []).append(index)
    for a, column in enumerate(columns):
        for b in by_swath.get(column.swath + 1, []):
            overlap_m = _measure_overlap_m(column, columns[b], width_m)
            if overlap_m > 0.0:
                yield round(overlap_m, 3), a, b


def _measure_overlap_m(a: Column, b: Column, width_m: float) -> float:
    """How far two columns lie side by side (m); 0 or less if they do not."""
    (ax, ay, heading), (bx, by, other_heading) = a.ends[0], b.ends[0]
    across_m = abs((by - ay) * math.cos(heading) - (bx - ax) * math.sin(heading))
    is_parallel = abs(math.remainder(other_heading - heading, 2.0 * math.pi)) <= PARALLEL_RAD
    if not is_parallel or across_m > NEIGHBOUR_WIDTHS * width_m:
        return 0.0
    (first, last), (other_first, other_last) = a.project_span(FIRST), b.project_span(FIRST)
    return min(last, other_last) - max(first, other_first)
