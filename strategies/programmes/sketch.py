"""What the best programme is likely to take, by moves in closed form: nothing is driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from strategies.programmes.driven_search import search_estimated_tours
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Floats, compute_tour_s, list_clashes, list_pairs, pose_problem
from strategies.programmes.waiting_places import StandingCheck


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
    stands_in_way: StandingCheck | None = None,
) -> Sketch:
    """The best tours by moves that were estimated, lines in stages; the rest as in `make_programme`."""
    moves, count = table.moves, len(table.lines)
    stage = np.array(stages, np.int64)
    may = np.ones((tractors, count), bool) if allowed is None else allowed
    extra_s = np.zeros(count) if served_s is None else served_s
    clashes = list_clashes(table, stands_in_way, tractors)
    orders = [[n for n in own if n == own[0] or may[k, n // 2]] for k, own in enumerate(moves.orders)]
    tours, cost_s = search_estimated_tours(
        table,
        lambda costs: pose_problem(moves, costs, stage, may, extra_s, clashes),
        lambda tours: list_pairs(moves, tours),
        orders + [[] for _ in range(tractors - len(orders))] if any(len(order) > 1 for order in orders) else None,
    )
    return Sketch(tours, [compute_tour_s(table, tour) for tour in tours], cost_s)
