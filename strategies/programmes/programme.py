"""A programme: which lines each tractor works, in which order and direction, by moves that were driven well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from strategies.programmes.move_table import NO_MOVE_S, MoveTable
from strategies.programmes.order_search import OrderProblem, search_programmes

Floats = npt.NDArray[np.float64]

MISSED_LINE_S, MISSED_LINE_FACTOR = 150.0, 6.0  # to finish a line later: so long, and so often the time it takes now
FIRST_KICKS, LATER_KICKS = 100, 20  # of the search at first, and after moves have changed
OPEN_ROUNDS = 80  # in which moves that were not driven yet may be used; the last one does with those driven well
WORSE_S = 5.0  # a programme whose moves became dearer by more is searched again


@dataclass(frozen=True, eq=False)
class Programme:
    """The nodes of every tractor in order; lines in none of them are left.

    Attributes:
        table: lines and moves.
        tours: (per tractor) nodes in order.
        left: numbers of the lines that are left.
    """

    table: MoveTable
    tours: tuple[tuple[int, ...], ...]
    left: tuple[int, ...]

    def list_pairs(self) -> list[tuple[int, int]]:
        """The moves it uses, as pairs of nodes."""
        return list_pairs(self.table, self.tours)

    def compute_tractor_s(self) -> list[float]:
        """Seconds that every tractor drives: its lines and its moves, without what these are charged."""
        table = self.table
        speed = table.site.rules.work_speed_mps
        return [
            sum(table.lines[node // 2].measure_path_m(node % 2) for node in tour) / speed
            + sum(move.drive_s for pair in list_pairs(table, [tour]) if (move := table.get_move(*pair)) is not None)
            for tour in self.tours
        ]


def list_pairs(table: MoveTable, tours: Sequence[Sequence[int]]) -> list[tuple[int, int]]:
    """Neighbouring nodes of all tours, with the entrance before and after each if there is one."""
    gate = [] if table.site.lane is None else [table.gate]
    return [pair for tour in tours if tour for pair in pairwise([*gate, *tour, *gate])]


def make_programme(
    table: MoveTable,
    tractors: int,
    stages: Sequence[int] | None = None,
    allowed: npt.NDArray[np.bool_] | None = None,
    seed: int = 1,
    served_s: Floats | None = None,
) -> Programme:
    """The best programme whose moves were all driven well.

    `stages` (n,) say which lines come first; `allowed` (tractors, n) which lines a tractor may work, all by default;
    `served_s` (n,) how long a tractor takes to be served for each line, so that all finish together.
    Search, drive what the programme uses, strike what fails, search on.
    """
    stage = np.zeros(len(table.lines), np.int64) if stages is None else np.array(stages, np.int64)
    may = np.ones((tractors, len(table.lines)), bool) if allowed is None else allowed
    extra_s = np.zeros(len(table.lines)) if served_s is None else served_s
    tours: list[list[int]] | None = None
    for number in range(OPEN_ROUNDS + 1):
        only_proven = number >= OPEN_ROUNDS
        problem = _pose_problem(table, stage, may, extra_s, tractors, only_proven=only_proven)
        kicks = FIRST_KICKS if number < 2 else LATER_KICKS
        tours = search_programmes(problem, kicks, seed + number, tours)
        if only_proven or not _improve_knowledge(table, tours):
            break
    assert tours is not None
    tours = [_keep_connected(table, tour) for tour in tours]
    driven = {node // 2 for tour in tours for node in tour}
    left = tuple(k for k in range(len(table.lines)) if k not in driven)
    return Programme(table, tuple(map(tuple, tours)), left)


def _improve_knowledge(table: MoveTable, tours: Sequence[Sequence[int]]) -> bool:
    """Find and drive the moves of some tours; whether any has become clearly dearer for it."""
    is_worse = False
    for u, v in list_pairs(table, tours):
        if table.is_proven(u, v):
            continue
        before_s = table.cost_s[u, v]
        if table.find(u, v, search=True):
            table.prove(u, v)
        is_worse = is_worse or table.cost_s[u, v] > before_s + WORSE_S or not table.is_proven(u, v)
    return is_worse


def _pose_problem(
    table: MoveTable,
    stage: npt.NDArray[np.int64],
    may: npt.NDArray[np.bool_],
    extra_s: Floats,
    tractors: int,
    *,
    only_proven: bool,
) -> OrderProblem:
    speed = table.site.rules.work_speed_mps
    lengths_m = np.array([line.length_m for line in table.lines])
    own_s = np.array([line.own_m2 for line in table.lines]) * table.site.work_s_per_m2
    costs = np.where(table.get_proven_mask(), table.cost_s, NO_MOVE_S) if only_proven else table.cost_s
    has_lane = table.site.lane is not None
    ends_s = [np.repeat(row[None, :-1] * has_lane, tractors, axis=0) for row in (costs[-1], costs[:, -1])]
    return OrderProblem(
        move_s=costs[:-1, :-1],
        work_s=lengths_m / speed + extra_s,
        value_s=MISSED_LINE_FACTOR * own_s + MISSED_LINE_S + extra_s,
        begin_s=ends_s[0],
        end_s=ends_s[1],
        allowed=may,
        stage=stage,
    )


def _keep_connected(table: MoveTable, tour: Sequence[int]) -> list[int]:
    """The longest stretch of a tour all of whose moves were driven well; a search without a way on ends so."""
    parts: list[list[int]] = [[]]
    for node in tour:
        if parts[-1] and not table.is_proven(parts[-1][-1], node):
            parts.append([])
        parts[-1].append(node)
    if table.site.lane is not None:
        gate = table.gate
        parts = [p for p in parts if p and table.is_proven(gate, p[0]) and table.is_proven(p[-1], gate)] or [[]]
    return max(parts, key=lambda part: sum(table.lines[node // 2].length_m for node in part))
