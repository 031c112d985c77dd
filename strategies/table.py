"""Seconds between the passes of some tracks, as orders of tracks are searched with: ways that would really be driven.

Turns to near lines are worked out before the search; what leads farther, or on in the same direction, is estimated
first and worked out when an order uses it, until an order uses nothing estimated.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.layout import Track
from strategies.job import Job, Pass
from strategies.tours import FAR_S, Tour, tour

Floats = npt.NDArray[np.float64]

NEAR_LINES = 10  # orders that are best turn over fewer lines; more only where a field is in pieces
MOST_ROUNDS = 12
SAME_S = 1e-3  # times are told apart to a millisecond, so that a choice does not hang on rounding


class TurnTable:
    """Seconds from the end of every pass of `tracks` to the beginning of every other, shape (2 n, 2 n).

    Pass 2 i is track i along the bearing of its cell, 2 i + 1 against it. `known` marks what is worked
    out: first the turns over at most `near_lines`.
    """

    def __init__(self, job: Job, tracks: list[Track], near_lines: int = NEAR_LINES) -> None:
        self.job, self.passes = job, [Pass(track, way) for track in tracks for way in (1, -1)]
        count = len(self.passes)
        self.seconds: Floats = np.full((count, count), FAR_S)
        self.known = np.zeros((count, count), dtype=bool)
        for p, a in enumerate(self.passes):
            for q, b in enumerate(self.passes):
                if p // 2 == q // 2:
                    continue
                near = a.track.cell == b.track.cell and abs(a.track.line - b.track.line) <= near_lines
                if near and a.direction != b.direction:
                    self._work_out(p, q, routes=False)
                if not self.known[p, q]:
                    self.seconds[p, q] = _rounded(job.turn_time(a, b))

    def _work_out(self, p: int, q: int, *, routes: bool) -> None:
        """The seconds of the way from pass p to pass q; without `routes` only where a turn leads there."""
        a, b = self.job.exit(self.passes[p]), self.job.entry(self.passes[q])
        path = self.job.way(a, b) if routes else self.job.turn(a, b)
        if path is not None or routes:
            self.seconds[p, q] = FAR_S if path is None else _rounded(self.job.connector.cost(path))
            self.known[p, q] = True

    def work_out(self, order: list[int]) -> bool:
        """Work out whatever an order of passes uses and is only estimated; whether there was any."""
        missing = [(p, q) for p, q in pairwise(order) if not self.known[p, q]]
        for p, q in missing:
            self._work_out(p, q, routes=True)
        return bool(missing)

    def ends(self) -> Floats:
        """Seconds between the entrance and the beginning and the end of every pass (2, 2 n); 0 without an entrance."""
        entrance = self.job.layout.field.entrance
        if entrance is None:
            return np.zeros((2, len(self.passes)))
        speed = self.job.manner.turn_speed_mps
        places = ((self.job.entry(one)[:2], self.job.exit(one)[:2]) for one in self.passes)
        return np.array([[_rounded(math.dist(entrance, end) / speed) for end in pair] for pair in places]).T


    def best(self, members: list[int], starts: list[list[int]], seed: int = 1, *, roughly: bool = False) -> Tour:
        """The best order through some of the tracks, in passes of this table.

        `members` are their places in the table; `starts` orders of these to search from. `roughly` leaves estimates
        as they are and the order where no move helps.
        """
        rows = np.array([2 * track + way for track in members for way in (0, 1)])
        place = {track: index for index, track in enumerate(members)}
        first, last = self.ends()[:, rows]
        inner = [[place[track] for track in start] for start in starts]
        if roughly:
            best = tour(self.seconds[np.ix_(rows, rows)], first, last, inner, seed, kicked=False)
            return Tour(rows[best.passes], best.seconds, best.bound_s)
        for kicked in (False, True):
            best = tour(self.seconds[np.ix_(rows, rows)], first, last, inner, seed, kicked=kicked)
            for _ in range(MOST_ROUNDS):
                if not self.work_out(rows[best.passes].tolist()):
                    break
                inner = [(best.passes // 2).tolist()]
                best = tour(self.seconds[np.ix_(rows, rows)], first, last, inner, seed, kicked=kicked)
            inner = [(best.passes // 2).tolist()]
        return Tour(rows[best.passes], best.seconds, best.bound_s)


def _rounded(seconds: float) -> float:
    return round(seconds / SAME_S) * SAME_S
