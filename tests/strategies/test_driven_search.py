"""Tours by driven moves: which moves are asked for where those of tours fail."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from fields.arrays import Flags, Floats
from strategies.programmes.driven_search import search_driven_tours
from strategies.programmes.order_search import OrderProblem
from strategies.programmes.order_tours import NO_MOVE_S

LINES, TRACTORS = 6, 2


class FailingTable:
    """Moves between lines of which none is ever driven well; it notes which are asked for."""

    gate = 2 * LINES

    def __init__(self) -> None:
        self.cost_s = np.full((2 * LINES + 1, 2 * LINES + 1), 20.0)
        self.asked = set[tuple[int, int]]()

    def estimate_costs(self) -> Floats:
        """Those that were asked for are none."""
        return self.cost_s

    def prove(self, pairs: Sequence[tuple[int, int]], are_chosen: bool = True) -> bool:
        """Note the moves, and that there are none."""
        for pair in pairs:
            self.asked.add(pair)
            self.cost_s[pair] = NO_MOVE_S
        return not pairs

    def is_proven(self, u: int, v: int) -> bool:
        """None is."""
        return False

    def get_proven_mask(self) -> Flags:
        """None is."""
        return np.zeros(self.cost_s.shape, bool)


def test_moves_tried_for_one_that_failed_join_lines_of_one_tractor() -> None:
    allowed = np.repeat(np.eye(TRACTORS, dtype=bool), LINES // TRACTORS, axis=1)
    table, values_s = FailingTable(), np.full(LINES, 500.0)

    def pose_problem(costs: Floats) -> OrderProblem:
        return OrderProblem.from_moves(costs[:-1, :-1], np.full(LINES, 60.0), values_s, tractors=2, allowed=allowed)

    def list_moves(tours: Sequence[Sequence[int]]) -> list[tuple[int, int]]:
        return [pair for tour in tours for pair in pairwise(tour)]

    search_driven_tours(table, pose_problem, list_moves, lambda _: True)  # type: ignore[arg-type]
    assert len(table.asked) > 2 * LINES
    for u, v in table.asked:
        assert (allowed[:, u // 2] & allowed[:, v // 2]).any(), (u, v)
