"""Which tractor works which lines, in which order and direction: one search for all strategies and counts of tractors.

Work lines are numbered; node 2 i is line i driven forward, 2 i + 1 backward. The cost of a programme, in seconds, is

    (1 - sum_share) * the longest tour + sum_share * the sum of all tours + the value of the lines left,

for one tractor its tour and the lines left. A tour is the way from the entrance, moves, work and the way home; a
tractor without lines takes no time. Where no move leads UNREACHED_S is charged, far more than all lines are worth:
such a line is left. Every descent in stage adds `stage_s`, every pair of tours that begin or end as no two may RULE_S,
every tour that takes more than a load RULE_S for each load more.

Lines are moved by what order_moves considers, and in runs left or turned (order_runs), until nothing helps: first as if
each were worth any way, as together they may be, then by what they are worth. Perturbations follow: two runs of lines
change places, or some lines are left to be inserted anew, and what follows from it is kept if it costs no more
(iterated local search, Lourenco, Martin and Stutzle 2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers
from fields.errors import HeadlandError
from fields.geometry.arithmetic import ROUNDING
from strategies.programmes.order_moves import improve_tours, set_move
from strategies.programmes.order_runs import drop_runs, turn_runs
from strategies.programmes.order_tours import (
    ANY_WAY_S,
    BEGIN,
    FIRST,
    MIN_GAIN_S,
    NEIGHBOURS,
    NO_MOVE_S,
    NO_ROW,
    ONWARD,
    RULE_S,
    SECOND,
    SIDE_A,
    SIDE_B,
    SUM_SHARE,
    THIRD,
    UNREACHED_S,
    OrderTables,
    can_make_move,
    clear_pieces,
    create_tours,
    make_move,
    push_line,
    set_piece,
    sum_rows,
    update_row,
)
from vehicle.copying import copy_row
from vehicle.jit import compile_for_views, compile_function
from vehicle.model.gnss import draw_uniform

MAX_RUN_LINES = 10  # in each of the runs that change places, and in a run that is left
KICKS = 150  # of a thorough search, and one for every line: four times as many find 1 % more
TOUR_KICKS = 20  # of so many one leaves a whole tour
DRAWS = 5  # random numbers of a perturbation


@dataclass(frozen=True, eq=False)
class OrderProblem:
    """What is to be put in order: n lines, k tractors.

    `move_s` (2 n, 2 n) are the seconds from the end of node u to the begin of node v, infinite (or 1e6 and more) where
    no move leads; `work_s` (n,) those of working a line, `value_s` (n,) what leaving it costs. `begin_s` and `end_s`
    (k, 2 n) are the seconds of a tractor from its entrance to the begin of a node and from its end home; zeros where it
    may begin and end anywhere. `allowed` (k, n): which lines a tractor may work. `stage` (n,) puts lines of a lower
    stage before those of a higher one in a tour, at `stage_s` seconds for every descent, which the default forbids.
    `clashes` (2, 2 n, 2 n) are the nodes of which no two tours may begin (0) or end (1) with both; None: any may.
    `need` (n,) is the share of a load that a line takes, and what a tour takes beyond one load is charged RULE_S for a
    load; None: no line takes any. `sum_share` is what a second of the sum of all tours costs, beside the longest. With
    `turns_runs` runs are turned in order alone or line by line as well, as where only neighbours may follow.

    Raises HeadlandError where shapes or values do not fit.
    """

    move_s: Floats
    work_s: Floats
    value_s: Floats
    begin_s: Floats
    end_s: Floats
    allowed: Flags
    stage: Integers
    stage_s: float = RULE_S
    clashes: Flags | None = None
    need: Floats | None = None
    sum_share: float = SUM_SHARE
    turns_runs: bool = False

    def __post_init__(self) -> None:
        n, k = len(self.work_s), len(self.begin_s)
        shapes = {"move_s": (2 * n, 2 * n), "value_s": (n,), "begin_s": (k, 2 * n), "end_s": (k, 2 * n)}
        if self.clashes is not None:
            shapes["clashes"] = (2, 2 * n, 2 * n)
        if self.need is not None:
            shapes["need"] = (n,)
        for name, shape in {**shapes, "allowed": (k, n), "stage": (n,)}.items():
            found = getattr(self, name).shape
            if found != shape:
                raise HeadlandError(f"{name} has the shape {found}; for {n} lines and {k} tractors give {shape}.")
        if k < 1:
            raise HeadlandError("There is no tractor; give begin_s and end_s a row for each.")
        for name in ("move_s", "work_s", "value_s", "begin_s", "end_s"):
            values = getattr(self, name)
            if np.isnan(values).any() or (values < 0.0).any():
                raise HeadlandError(f"{name} holds {np.nanmin(values)} or no number; give seconds of 0 and more.")
        if not self.spare_s > 0.0:
            limit_s = self.sum_share * UNREACHED_S
            raise HeadlandError(f"Work and value of all lines add up to {limit_s:.0e} s or more; give less.")

    @classmethod
    def from_moves(
        cls, move_s: Floats, work_s: Floats, value_s: Floats, begin_s: Floats | None = None,
        end_s: Floats | None = None, *, tractors: int = 1, allowed: Flags | None = None, stage: Integers | None = None,
        stage_s: float = RULE_S, clashes: Flags | None = None,
    ) -> OrderProblem:  # fmt: skip
        """A problem where what is not given is free: ways in and home take no time, every line may be worked by any
        tractor at any time."""
        n = len(work_s)
        return cls(
            move_s=np.asarray(move_s, float),
            work_s=np.asarray(work_s, float),
            value_s=np.asarray(value_s, float),
            begin_s=np.zeros((tractors, 2 * n)) if begin_s is None else np.asarray(begin_s, float),
            end_s=np.zeros((tractors, 2 * n)) if end_s is None else np.asarray(end_s, float),
            allowed=np.ones((tractors, n), bool) if allowed is None else np.asarray(allowed, bool),
            stage=np.zeros(n, np.int64) if stage is None else np.asarray(stage, np.int64),
            stage_s=stage_s,
            clashes=clashes,
        )

    @property
    def spare_s(self) -> float:
        """By how much work and value of all lines are less than what is charged where no move leads."""
        return float(self.sum_share * UNREACHED_S - self.work_s.sum() - self.value_s.sum())

    @property
    def kicks(self) -> int:
        """Perturbations of a thorough search."""
        return KICKS + len(self.work_s)

    def tabulate_moves(self) -> tuple[Floats, Floats, Floats]:
        """Seconds of moves, ways in and ways home as they are charged: UNREACHED_S where there is none, and stages."""
        charged = [np.where(given < NO_MOVE_S, given, UNREACHED_S) for given in (self.move_s, self.begin_s, self.end_s)]
        stage = np.repeat(self.stage, 2)
        if len(stage) and stage.min() < stage.max():
            charged[0] += self.stage_s * (stage[:, None] > stage[None, :])
        return charged[0], charged[1], charged[2]


def compute_cost_s(problem: OrderProblem, tours: Sequence[Sequence[int]]) -> float:
    """The cost of tours, node by node: what the search makes small."""

    def charge_s(seconds: float) -> float:
        return float(seconds) if seconds < NO_MOVE_S else UNREACHED_S

    finish_s = []
    for tractor, tour in enumerate(tours):
        seconds = sum(float(problem.work_s[node // 2]) for node in tour)
        if tour:
            seconds += charge_s(problem.begin_s[tractor, tour[0]]) + charge_s(problem.end_s[tractor, tour[-1]])
        for before, after in pairwise(tour):
            seconds += charge_s(problem.move_s[before, after])
            if problem.stage[before // 2] > problem.stage[after // 2]:
                seconds += problem.stage_s
        finish_s.append(seconds)
    worked = {node // 2 for tour in tours for node in tour}
    left_s = sum(float(value) for line, value in enumerate(problem.value_s) if line not in worked)
    rules_s = RULE_S * count_clashes(problem, tours) + _charge_excesses(problem, tours)
    return (1.0 - problem.sum_share) * max(finish_s) + problem.sum_share * sum(finish_s) + left_s + rules_s


def _charge_excesses(problem: OrderProblem, tours: Sequence[Sequence[int]]) -> float:
    """What tours that take more than a load are charged (s)."""
    if problem.need is None:
        return 0.0
    needs = [sum(float(problem.need[node // 2]) for node in tour) for tour in tours]
    return RULE_S * sum(max(0.0, need - 1.0 - ROUNDING) for need in needs)


def count_clashes(problem: OrderProblem, tours: Sequence[Sequence[int]]) -> int:
    """How many pairs of tours begin, and how many end, as no two may."""
    if problem.clashes is None:
        return 0
    pairs = list(combinations([tour for tour in tours if tour], 2))
    return sum(int(problem.clashes[side, a[-side], b[-side]]) for a, b in pairs for side in (0, 1))


def search_programmes(
    problem: OrderProblem, kicks: int, seed: int, start: list[list[int]] | None = None
) -> list[list[int]]:
    """The nodes of each tractor's tour, at low cost; lines that are in none are left. The same for the same input.

    Improves `start` if it is given, which costs no less than what is returned. Raises HeadlandError if a line is twice
    in it, or with a tractor that may not work it.
    """
    n, k = len(problem.work_s), len(problem.begin_s)
    if n == 0:
        return [[] for _ in range(k)]
    if start is None:
        eager = replace(problem, value_s=problem.value_s + min(0.5 * problem.spare_s / n, ANY_WAY_S))
        start = search_programmes(eager, 0, seed, [[] for _ in range(k)])
    _check_start(problem, start)
    given = np.full((k, n), -1, dtype=np.int64)
    for tractor, tour in enumerate(start):
        given[tractor, : len(tour)] = tour
    found, _ = search_tours(_build_tables(problem), create_tours(k, n), given, kicks, seed, problem.turns_runs)
    return [[int(node) for node in tour if node >= 0] for tour in found]


def _build_tables(problem: OrderProblem) -> OrderTables:
    """A problem with the nearest neighbours of every node, for compiled functions."""
    move_s, begin_s, end_s = (np.ascontiguousarray(table) for table in problem.tabulate_moves())
    count = min(NEIGHBOURS, len(move_s) - 2)
    after, before = (np.ascontiguousarray(nodes[:, :count]) for nodes in _find_neighbours(move_s, count))
    work_s, value_s = (np.ascontiguousarray(values, np.float64) for values in (problem.work_s, problem.value_s))
    allowed = np.ascontiguousarray(problem.allowed, np.bool_)
    clashes = np.zeros((2, 0, 0), bool) if problem.clashes is None else np.ascontiguousarray(problem.clashes)
    need = np.zeros(0) if problem.need is None else np.ascontiguousarray(problem.need, np.float64)
    return OrderTables(
        move_s, begin_s, end_s, work_s, value_s, allowed, after, before, clashes, need, problem.sum_share
    )


def _check_start(problem: OrderProblem, start: list[list[int]]) -> None:
    """Refuse tours that cannot be a programme of the problem."""
    n, k = len(problem.work_s), len(problem.begin_s)
    if len(start) != k:
        raise HeadlandError(f"The start has {len(start)} tours; give one for each of {k} tractors.")
    nodes = [node for tour in start for node in tour]
    if any(not 0 <= node < 2 * n for node in nodes) or len({node // 2 for node in nodes}) < len(nodes):
        raise HeadlandError(
            f"The start has a line twice or one that does not exist; give nodes of {n} lines, each once."
        )
    for tractor, tour in enumerate(start):
        for node in tour:
            if not problem.allowed[tractor, node // 2]:
                raise HeadlandError(f"In the start tractor {tractor + 1} works line {node // 2}, which it may not.")


@compile_function
def _find_neighbours(move_s, count):  # type: ignore[no-untyped-def]
    """Nodes of other lines that most cheaply follow each node (2 n, count + 1), and those that precede it.

    The nearest come first; the last column is used up in sorting.
    """
    n = len(move_s)
    lists, seconds = np.zeros((2, n, count + 1), np.int64), np.full((2, n, count + 1), np.inf)
    for u in range(n):
        for v in range(n):
            if u // 2 == v // 2:
                continue
            for side in range(2):
                row, nearest = (seconds[0, u], lists[0, u]) if side == 0 else (seconds[1, v], lists[1, v])
                at = count
                while at > 0 and row[at - 1] > move_s[u, v]:
                    row[at], nearest[at] = row[at - 1], nearest[at - 1]
                    at -= 1
                row[at], nearest[at] = move_s[u, v], v if side == 0 else u
    return lists[0], lists[1]


@compile_for_views
def _improve_runs(tours, tables, turns_runs) -> float:  # type: ignore[no-untyped-def]
    """Moves and runs that are dropped or turned, until none helps; returns the cost of the tours then."""
    cost = improve_tours(tours, tables)
    while True:
        drop_runs(tours, tables)
        if turns_runs:
            turn_runs(tours, tables)
        new_cost = improve_tours(tours, tables)
        if new_cost > cost - MIN_GAIN_S:
            return new_cost
        cost = new_cost


@compile_for_views
def _swap_runs(tours, a, i, j, b, p, q) -> None:  # type: ignore[no-untyped-def]
    """Let the places i..j of row a and p..q of row b change places."""
    clear_pieces(tours, a, b)
    set_piece(tours, SIDE_A, FIRST, a, BEGIN, i - 1, ONWARD)
    set_piece(tours, SIDE_A, SECOND, b, p, q, ONWARD)
    set_piece(tours, SIDE_A, THIRD, a, j + 1, tours.lengths[a] - 1, ONWARD)
    set_piece(tours, SIDE_B, FIRST, b, BEGIN, p - 1, ONWARD)
    set_piece(tours, SIDE_B, SECOND, a, i, j, ONWARD)
    set_piece(tours, SIDE_B, THIRD, b, q + 1, tours.lengths[b] - 1, ONWARD)


@compile_for_views
def _leave_run(tours, tables, a, i, j) -> None:  # type: ignore[no-untyped-def]
    """Leave the places i..j of row a, to be inserted anew after lines near them that were left before."""
    left = len(tours.seconds) - 1
    for number in range(tables.after.shape[1]):
        near = tables.after[tours.nodes[a, j], number] // 2
        if tours.row_of[near] == left:
            push_line(tours, near)
    for place in range(i, j + 1):
        push_line(tours, tours.nodes[a, place] // 2)
    set_move(tours, a, i, j, ONWARD, left, tours.lengths[left])
    make_move(tours, tables)


@compile_for_views
def _leave_tour(tours, tables, a) -> None:  # type: ignore[no-untyped-def]
    """Leave all of row a, to be inserted anew after what was left before."""
    left = len(tours.seconds) - 1
    for row in (left, a):
        for place in range(tours.lengths[row]):
            push_line(tours, tours.nodes[row, place] // 2)
    set_move(tours, a, BEGIN, tours.lengths[a] - 1, ONWARD, left, tours.lengths[left])
    make_move(tours, tables)


@compile_for_views
def _perturb_tours(tours, tables, seed, kick) -> None:  # type: ignore[no-untyped-def]
    """In turn: two runs next to one another change places, two of different tractors do, and both of these are left.

    Now and then, while lines are left, all of a tour: what no tractor gets to from where it works, one may begin with.
    """
    left, n = len(tours.seconds) - 1, len(tours.row_of)
    line = int(draw_uniform(seed, DRAWS * kick) * n)
    while tours.row_of[line] == left:
        line = (line + 1) % n
    a, i = tours.row_of[line], tours.place_of[line]
    if kick % TOUR_KICKS == 0 and left > 1 and tours.lengths[left] > 0:
        _leave_tour(tours, tables, a)
        return
    end_a = tours.lengths[a] - 1
    j = i + int(draw_uniform(seed, DRAWS * kick + 1) * min(MAX_RUN_LINES, end_a - i + 1))
    near = tables.after[tours.nodes[a, i], int(draw_uniform(seed, DRAWS * kick + 2) * tables.after.shape[1])] // 2
    b, p = tours.row_of[near], tours.place_of[near]
    are_two = b != a and b != left
    if are_two:
        q = p + int(draw_uniform(seed, DRAWS * kick + 3) * min(MAX_RUN_LINES, tours.lengths[b] - p))
        if kick % 3 == 1:
            _swap_runs(tours, a, i, j, b, p, q)
            if can_make_move(tours, tables):
                make_move(tours, tables)
                return
    if kick % 3 == 2 or j == end_a:
        if are_two and draw_uniform(seed, DRAWS * kick + 4) < 0.5:
            _leave_run(tours, tables, b, p, q)
        _leave_run(tours, tables, a, i, j)
        if are_two and draw_uniform(seed, DRAWS * kick + 4) >= 0.5:
            _leave_run(tours, tables, b, p, q)
    else:
        q = j + 1 + int(draw_uniform(seed, DRAWS * kick + 3) * min(MAX_RUN_LINES, end_a - j))
        set_move(tours, a, j + 1, q, ONWARD, a, i)
        make_move(tours, tables)


@compile_for_views
def _keep_or_restore(tours, tables, nodes, lengths, is_better) -> None:  # type: ignore[no-untyped-def]
    """Copy the rows that have changed to the tours that are kept, or back from there."""
    for row in range(len(lengths)):
        if not tours.touched[row]:
            continue
        if is_better:
            lengths[row] = tours.lengths[row]
            copy_row(tours.nodes[row, : lengths[row]], nodes[row])
        else:
            tours.lengths[row] = lengths[row]
            copy_row(nodes[row, : lengths[row]], tours.nodes[row])
            update_row(tours, tables, row)
        tours.touched[row] = False
    sum_rows(tours, tables)


@compile_function
def _load_start(tours, tables, given) -> None:  # type: ignore[no-untyped-def]
    """Take over tours (k, n), each ended by -1."""
    left, n = len(tours.lengths) - 1, len(tours.row_of)
    is_worked = np.zeros(n, np.bool_)
    for row in range(left):
        while tours.lengths[row] < n and given[row, tours.lengths[row]] >= 0:
            node = given[row, tours.lengths[row]]
            tours.nodes[row, tours.lengths[row]] = node
            is_worked[node // 2] = True
            tours.lengths[row] += 1
        update_row(tours, tables, row)
    tours.lengths[left] = 0
    for line in range(n):
        if not is_worked[line]:
            tours.nodes[left, tours.lengths[left]] = 2 * line
            tours.lengths[left] += 1
    update_row(tours, tables, left)
    sum_rows(tours, tables)


@compile_function
def search_tours(tables, tours, given, kicks, seed, turns_runs):  # type: ignore[no-untyped-def]
    """Tours (k, n), each ended by -1, from those given, and the cost that the search reckons with."""
    k, n = given.shape
    _load_start(tours, tables, given)
    for line in range(n):
        push_line(tours, line)
    best_cost = _improve_runs(tours, tables, turns_runs)
    nodes, lengths = tours.nodes.copy(), tours.lengths.copy()
    for row in range(k + 1):
        tours.touched[row] = False
    for kick in range(kicks):
        if lengths[k] == n or n < 2:
            break
        _perturb_tours(tours, tables, seed, kick)
        cost = improve_tours(tours, tables)
        _keep_or_restore(tours, tables, nodes, lengths, cost <= best_cost)
        best_cost = min(best_cost, cost)
    cost = _improve_runs(tours, tables, turns_runs)
    found = np.full((k, n), NO_ROW)
    for row in range(k):
        copy_row(tours.nodes[row, : tours.lengths[row]], found[row])
    return found, cost
