"""What the best programme is likely to take, by moves in closed form: nothing is driven."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from strategies.programmes.move_estimates import NO_MOVE_S
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import compute_cost_s, search_programmes
from strategies.programmes.programme import Floats, list_pairs, pose_problem

ROUNDS = 3  # of searching and asking what the moves of the tours cost


@dataclass(frozen=True, eq=False)
class Sketch:
    """Tours by estimated moves.

    Attributes:
        tours: (per tractor) nodes in order.
        tractor_s: seconds of every tractor, as driven without stops.
        cost_s: what the search makes small: seconds with charges for what drivers avoid and for lines that are left.
    """

    tours: list[list[int]]
    tractor_s: list[float]
    cost_s: float


def sketch_programme(
    table: MoveTable,
    tractors: int,
    stages: Sequence[int],
    allowed: npt.NDArray[np.bool_] | None = None,
    served_s: Floats | None = None,
) -> Sketch:
    """The best tours by moves that were estimated, lines in stages; `allowed` and `served_s` as in `make_programme`."""
    moves, count = table.moves, len(table.lines)
    stage = np.array(stages, np.int64)
    may = np.ones((tractors, count), bool) if allowed is None else allowed
    extra_s = np.zeros(count) if served_s is None else served_s
    tours: list[list[int]] | None = None
    for number in range(ROUNDS):
        problem = pose_problem(moves, table.estimate_costs(), stage, may, extra_s)
        tours = search_programmes(problem, 0, 1 + number, tours)
        if not table.estimate(list_pairs(moves, tours)):
            break
    problem = pose_problem(moves, np.where(table.is_estimated, table.cost_s, NO_MOVE_S), stage, may, extra_s)
    tours = search_programmes(problem, problem.kicks, 1, tours)
    return Sketch(tours, [_time_tour(table, tour) for tour in tours], compute_cost_s(problem, tours))


def _time_tour(table: MoveTable, tour: Sequence[int]) -> float:
    """Seconds of a tour as driven, without stops."""
    pairs = list_pairs(table, [tour])
    work_m = math.fsum(table.lines[node // 2].measure_path_m(node % 2) for node in tour)
    moves_s = table.moves.estimates.estimate_s(pairs, is_charged=False).sum() if pairs else 0.0
    return float(work_m / table.site.rules.work_speed_mps + moves_s)
