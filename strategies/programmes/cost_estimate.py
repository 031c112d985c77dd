"""What the best programme of one tractor is likely to cost, by moves in closed form: nothing is driven."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median

import numpy as np
import numpy.typing as npt

from strategies.moves.closed_forms import LEADS_IN_M, LEADS_OUT_M
from strategies.moves.move import MOVE_MARGIN_M
from strategies.moves.move_costs import compute_move_costs
from strategies.programmes.move_table import DETOUR_FACTOR, DETOUR_S, NO_MOVE_S
from strategies.programmes.order_search import compute_cost_s, search_programmes
from strategies.programmes.programme import list_pairs, pose_problem
from strategies.programmes.site_moves import CUTS_M, DEAR_S, MOST_CUT_SHARE, SiteMoves
from strategies.programmes.stages import list_stages
from strategies.programmes.work_moves import list_work_moves
from strategies.site.site import MISSED_FACTOR

Floats = npt.NDArray[np.float64]

NEAR_NODES = 12  # nodes whose moves from a node are asked for at first
ROUNDS = 3  # of searching and asking what the moves of the tour cost
KICKS = 10  # of the last search


def estimate_cost_s(moves: SiteMoves, orders: Sequence[str]) -> float:
    """Seconds in which one tractor works all lines of a site, with the time to finish those that it leaves.

    Headland and swaths come in the cheapest of some orders, "" for any. Charges for what drivers avoid are included.
    """
    costs = MoveCosts(moves)
    return min(costs.search_cost_s(list_stages(moves.lines, order)) for order in orders)


class MoveCosts:
    """Costs of the moves between the lines of a site, asked for near lines at first, for others where tours use them.

    Attributes:
        cost_s: (n + 1, n + 1) seconds from the end of a node to the begin of another; guesses where not asked for.
        is_known: (n + 1, n + 1) which were asked for.
    """

    def __init__(self, moves: SiteMoves) -> None:
        """Ask for the moves to near lines."""
        self.moves = moves
        self._ends, self._begins = np.array(moves.ends), np.array(moves.begins)
        lengths_m = [line.measure_path_m(way) for line in moves.lines for way in (0, 1)]
        self._most_cuts_m = np.append(MOST_CUT_SHARE * np.array(lengths_m) - 1.0, 0.0)
        self._guesses_s = self._guess()
        self.cost_s, self.is_known = self._guesses_s.copy(), np.zeros(self._guesses_s.shape, bool)
        near = np.argsort(self.cost_s[:-1, :-1], axis=1, kind="stable")[:, :NEAR_NODES]
        self._ask((u, v) for u, row in enumerate(near.tolist()) for v in row)

    def search_cost_s(self, stages: Sequence[int]) -> float:
        """The cost of the best tour that is found, its lines in stages, by moves that were asked for."""
        moves, count = self.moves, len(self.moves.lines)
        stage, may, none_s = np.array(stages, np.int64), np.ones((1, count), bool), np.zeros(count)
        tours: list[list[int]] | None = None
        for number in range(ROUNDS):
            problem = pose_problem(moves, self._estimate(), stage, may, none_s)
            tours = search_programmes(problem, 0, 1 + number, tours)
            if not self._ask(list_pairs(moves, tours)):
                break
        problem = pose_problem(moves, np.where(self.is_known, self.cost_s, NO_MOVE_S), stage, may, none_s)
        return compute_cost_s(problem, search_programmes(problem, KICKS, 1, tours))

    def _guess(self) -> Floats:
        """Seconds of the straight ways with the changes of heading, NO_MOVE_S between the ends of one line."""
        rules, lines = self.moves.site.rules, self.moves.lines
        gaps_m = np.hypot(*(self._ends[:, None, :2] - self._begins[None, :, :2]).transpose(2, 0, 1))
        turns = np.abs((self._begins[None, :, 2] - self._ends[:, None, 2] + np.pi) % (2.0 * np.pi) - np.pi)
        costs: Floats = (gaps_m + turns * rules.radius_m) / rules.turn_speed_mps
        numbers = np.append(np.repeat(np.arange(len(lines)), 2), -1)
        costs[numbers[:, None] == numbers[None, :]] = NO_MOVE_S
        one_way = [2 * number + 1 for number, line in enumerate(lines) if not line.both_ways]
        costs[one_way], costs[:, one_way] = NO_MOVE_S, NO_MOVE_S
        return costs

    def _estimate(self) -> Floats:
        """Costs, where not asked for with what others usually take beyond their guesses."""
        found = self.is_known & (self.cost_s < NO_MOVE_S)
        more_s = float(median((self.cost_s - self._guesses_s)[found])) if found.any() else 0.0
        is_guess = ~self.is_known & (self.cost_s < NO_MOVE_S)
        return np.where(is_guess, np.maximum(self.cost_s + more_s, 0.0), self.cost_s)

    def _ask(self, pairs: Iterable[tuple[int, int]]) -> bool:
        """Find what the moves between pairs of nodes cost; whether any was not known."""
        new = [pair for pair in pairs if not self.is_known[pair] and self._guesses_s[pair] < NO_MOVE_S]
        if not new:
            return False
        rows = np.array(new, np.int64)
        places = tuple(rows.T)
        found_s = np.minimum(self._compute_costs_s(rows), [self._find_work_cost_s(*pair) for pair in new])
        detours_s = DETOUR_FACTOR * self._guesses_s[places] + DETOUR_S
        self.cost_s[places] = np.maximum(np.where(np.isfinite(found_s), found_s, detours_s), 0.0)
        self.is_known[places] = True
        return True

    def _compute_costs_s(self, pairs: npt.NDArray[np.int64]) -> Floats:
        """Seconds (k,) of moves with the implement up; infinite where only a search may find one."""
        radii, site = self.moves.finder.radii, self.moves.site
        body, ground, kept = site.body, site.ground, site.kept
        driving = radii, LEADS_OUT_M[:1], LEADS_IN_M[:1], site.speeds, site.allowed_kinds
        shape = body.guide_m, body.points, body.reach_m, ground.grid, ground.frame, MOVE_MARGIN_M
        cut_s_per_m = (MISSED_FACTOR - 1.0) / site.rules.work_speed_mps
        found_s: Floats = compute_move_costs(
            self._ends[pairs[:, 0]],
            self._begins[pairs[:, 1]],
            self._guesses_s[tuple(pairs.T)] + DEAR_S,
            self._most_cuts_m[pairs],
            np.array(CUTS_M),
            cut_s_per_m,
            driving,
            shape,
            (kept.grid, kept.frame, site.wheels_s_per_m),
        )
        return found_s

    def _find_work_cost_s(self, u: int, v: int) -> float:
        """Seconds of the best move with the implement down; infinite without one."""
        moves = self.moves
        if moves.gate in (u, v):
            return np.inf
        p, q = moves.lines[u // 2], moves.lines[v // 2]
        found = list_work_moves(moves.site, moves.finder, p, u % 2, q, v % 2)
        return min((one.cost_s for one in found), default=np.inf)
