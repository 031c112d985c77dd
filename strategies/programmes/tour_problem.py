"""What a search for tours is about: who may work which lines and when, and what moves cost beside their time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Flags, Floats, Integers
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import OrderProblem
from strategies.programmes.order_tours import ANY_WAY_S
from strategies.programmes.waiting_places import find_clashes
from strategies.site.site import LEFT_FACTOR
from vehicle.missions.plan import SWATH
from vehicle.sim.path_conflicts import ClearanceCheck


@dataclass(frozen=True, eq=False)
class TourProblem:
    """The tours of a fleet over the n lines of a table.

    Attributes:
        table: lines, and moves between them as far as the search knows them.
        allowed: (tractors, n) which lines a tractor may work.
        stages: (n,) which lines come first.
        charged_s: (2 n + 1, 2 n + 1) what moves between nodes cost more than they take.
        served_s: (n,) how long a tractor takes to be served for each line, so that all finish together; None: no time.
        check: with it no two tractors of a field without an entrance begin or end where they never get on.
    """

    table: MoveTable
    allowed: Flags
    stages: Sequence[int]
    charged_s: Floats
    served_s: Floats | None = None
    check: ClearanceCheck | None = None

    @property
    def tractors(self) -> int:
        """How many tours there are."""
        return len(self.allowed)

    @property
    def clashes(self) -> Flags | None:
        """The nodes (2, 2 n, 2 n) of which no two tractors may begin (0) or end (1) with both, as far as the search
        knows; None for a single one, and with an entrance to wait outside."""
        table, check = self.table, self.check
        if check is None or table.site.lane is not None or self.tractors == 1:
            return None
        if check not in table.clashes:
            table.clashes[check] = find_clashes(table.moves, check).copy()
        return table.clashes[check]

    def pose(self, costs: Floats) -> OrderProblem:
        """The search for the tours with costs (2 n + 1, 2 n + 1) of moves, without charges."""
        moves, lines, site = self.table.moves, self.table.lines, self.table.site
        may, stage = self._place_starts()
        own_s = np.array([line.own_m2 for line in lines]) * site.work_s_per_m2
        extra_s = np.zeros(len(lines)) if self.served_s is None else self.served_s
        is_barred = np.array([not line.both_ways and way == 1 for line in lines for way in (0, 1)], bool)
        costs = costs + self.charged_s
        ends_s = [
            np.repeat(np.where(is_barred, np.inf, row)[None], len(may), axis=0)
            for row in ((costs[-1, :-1], costs[:-1, -1]) if site.lane is not None else moves.edge_ways_s)
        ]
        starts = list(moves.starts)
        ends_s[0][:, starts], ends_s[0][: len(starts)] = np.inf, np.inf
        ends_s[0][range(len(starts)), starts] = 0.0
        is_track = np.array([line.task.kind == SWATH for line in lines], bool)
        is_start = np.isin(np.arange(len(lines)), np.array(starts) // 2)
        return OrderProblem(
            move_s=costs[:-1, :-1],
            work_s=np.array([line.length_m for line in lines]) / site.rules.work_speed_mps + extra_s,
            # No track is left for the order of furrows, nor what a tractor begins with for its way home.
            value_s=LEFT_FACTOR * own_s + extra_s + 2.0 * site.furrow_s * is_track + ANY_WAY_S * is_start,
            begin_s=ends_s[0],
            end_s=ends_s[1],
            allowed=may,
            stage=stage,
            clashes=self.clashes,
            turns_runs=site.furrow_s > 0.0,
        )

    def _place_starts(self) -> tuple[Flags, Integers]:
        """What tractors may work and when, with every start for its own tractor and in the first stage."""
        lines = [node // 2 for node in self.table.starts]
        may, stage = self.allowed.copy(), np.array(self.stages, np.int64)
        may[:, lines], stage[lines] = False, stage.min(initial=0)
        may[range(len(lines)), lines] = True
        return may, stage
