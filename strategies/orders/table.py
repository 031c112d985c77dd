"""Seconds between the passes of some tracks, as orders of tracks are searched with: ways that would really be driven.

Turns to near lines are worked out before the search, once for all jobs of a site; what leads farther, or on in the same
direction, is estimated first and worked out when an order uses it, until an order uses nothing estimated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.layout import Track
from strategies.job import Job, Pass
from strategies.orders.tours import FAR_S, MOST_PROVEN, Tour, tour
from strategies.ways.paths import Pose
from strategies.ways.search import shortest_m

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NEAR_LINES = 10  # orders that are best turn over fewer lines; more only where a field is in pieces
MOST_ROUNDS = 13
EFFORTS = ((False, False), (True, False), (True, True))
"""Kicked and proven: what an order may still use of estimates is worked out before more is made of it."""
SAME_S = 1e-3  # times are told apart to a millisecond, so that a choice does not hang on rounding


class TurnTable:
    """Seconds from the end of every pass of `tracks` to the beginning of every other, shape (2 n, 2 n).

    Pass 2 i is track i along the bearing of its cell, 2 i + 1 against it. `known` marks what is worked
    out: first the turns over at most `near_lines`.
    """

    def __init__(self, job: Job, tracks: list[Track], near_lines: int = NEAR_LINES) -> None:
        self.job, self.passes = job, [Pass(track, way) for track in tracks for way in (1, -1)]
        key = near_lines, tuple(tracks)
        if key not in job.tables:
            self.seconds, self.known = _estimates(job, self.passes), np.zeros((len(self.passes),) * 2, dtype=bool)
            self._turns(np.array(list(_near_turns(self.passes, near_lines)), dtype=np.int64).reshape(-1, 2))
            job.tables[key] = self.seconds, self.known
        self.seconds, self.known = (each.copy() for each in job.tables[key])
        self._ends_known: set[tuple[int, int]] = set()

    def _turns(self, pairs: Ints) -> None:
        """The seconds of the turns between pairs (k, 2) of passes, where one leads from the first to the second."""
        exits, entries = (np.array([end(one) for one in self.passes]) for end in (self.job.exit, self.job.entry))
        seconds = self.job.turn_costs(exits, entries, pairs)
        found = np.isfinite(seconds)
        p, q = pairs[found].T
        self.seconds[p, q] = np.rint(seconds[found] / SAME_S) * SAME_S
        self.known[p, q] = True

    def _work_out(self, p: int, q: int) -> None:
        """The seconds of the way from pass p to pass q."""
        path = self.job.way(self.job.exit(self.passes[p]), self.job.entry(self.passes[q]))
        self.seconds[p, q] = FAR_S if path is None else _rounded(self.job.connector.cost(path))
        self.known[p, q] = True

    def work_out(self, order: list[int]) -> bool:
        """Work out whatever an order of passes uses and is only estimated; whether there was any."""
        missing = [(p, q) for p, q in pairwise(order) if not self.known[p, q]]
        for p, q in missing:
            self._work_out(p, q)
        return bool(missing)

    def ends(self) -> Floats:
        """Seconds between the entrance and the beginning and the end of every pass (2, 2 n); 0 without an entrance.

        Where tractors drive in by a gate they are those of the shortest ways with the turning radius, and of the ways
        that would really be driven once these are worked out.
        """
        entrance = self.job.layout.field.entrance
        if self.job.gate is not None:
            return self._gate_ends
        if entrance is None:
            return np.zeros((2, len(self.passes)))
        speed = self.job.manner.turn_speed_mps
        places = ((self.job.entry(one)[:2], self.job.exit(one)[:2]) for one in self.passes)
        return np.array([[_rounded(math.dist(entrance, end) / speed) for end in pair] for pair in places]).T

    @cached_property
    def _gate_ends(self) -> Floats:
        """Estimated seconds from the gate to every pass, and back to it from every pass (2, 2 n)."""
        radius, speed = self.job.manner.radius_m, self.job.manner.turn_speed_mps
        ways = (self._to_gate(one) for one in self.passes)
        metres = [[shortest_m(np.array(a), np.array(b), radius) + lead for a, b, lead in pair] for pair in ways]
        return np.rint(np.array(metres).T / speed / SAME_S) * SAME_S

    def _to_gate(self, one: Pass) -> tuple[tuple[Pose, Pose, float], tuple[Pose, Pose, float]]:
        """The poses between which the way in to a pass leads, those of the way out, and the metres straight through."""
        gate = self.job.gate
        assert gate is not None
        return (gate.inside, self.job.entry(one), gate.lead_m), (self.job.exit(one), gate.out().start, gate.lead_m)

    def work_out_ends(self, order: list[int]) -> bool:
        """Work out the ways in and out that an order of passes uses; whether one was only estimated."""
        if self.job.gate is None:
            return False
        missing = {(0, order[0]), (1, order[-1])} - self._ends_known
        for end, p in sorted(missing):
            a, b, lead_m = self._to_gate(self.passes[p])[end]
            path = self.job.way(a, b)
            if path is not None:
                seconds = self.job.connector.cost(path) + lead_m / self.job.manner.turn_speed_mps
                self._gate_ends[end, p] = _rounded(seconds)
        self._ends_known |= missing
        return bool(missing)

    def best(
        self, members: list[int], starts: list[list[int]], seed: int = 1, *, roughly: bool = False, proven: bool = True
    ) -> Tour:
        """The best order through some of the tracks, in passes of this table.

        `members` are their places in the table; `starts` orders of these to search from. `roughly` leaves estimates
        as they are and the order where no move helps; without `proven` the best of few is not worked out. The
        bound is that of the search (`tours.sharpened`).
        """
        rows = np.array([2 * track + way for track in members for way in (0, 1)])
        place = {track: index for index, track in enumerate(members)}
        first, last = self.ends()[:, rows]
        inner = [[place[track] for track in start] for start in starts]
        if roughly:
            best = tour(self.seconds[np.ix_(rows, rows)], first, last, inner, seed, kicked=False)
            return Tour(rows[best.passes], best.seconds, best.bound_s)
        for kicked, proof in EFFORTS[: 3 if proven and len(members) <= MOST_PROVEN else 2]:
            for _ in range(MOST_ROUNDS):
                given = self.seconds[np.ix_(rows, rows)], first, last
                best = tour(*given, inner, seed, kicked=kicked, proven=proof, bounded=False)
                inner = [(best.passes // 2).tolist()]
                order = rows[best.passes].tolist()
                more = self.work_out(order)
                if not more and (kicked or not self.work_out_ends(order)):
                    break  # the ways in and out are worked out while orders are cheap to search
                first, last = self.ends()[:, rows]
        return replace(best, passes=rows[best.passes])


def _near_turns(passes: list[Pass], near_lines: int) -> Iterator[tuple[int, int]]:
    """Pairs of passes that a turn may join: there and back on near lines of a cell."""
    cells, lines, ways = (
        np.array([part(one) for one in passes])
        for part in (lambda one: one.track.cell, lambda one: one.track.line, lambda one: one.direction)
    )
    for p in range(len(passes)):
        near = (np.abs(lines - lines[p]) <= near_lines) & (ways != ways[p]) & (cells == cells[p])
        yield from ((p, q) for q in np.flatnonzero(near).tolist() if p // 2 != q // 2)


def _estimates(job: Job, passes: list[Pass]) -> Floats:
    """`Job.turn_time` between all passes, those of a cell at once, to the millisecond; FAR_S within a track."""
    manner, table = job.manner, np.array(job.manner.turn_s)
    exits, entries = (np.array([end(one) for one in passes]) for end in (job.exit, job.entry))
    off = entries[None, :, :2] - exits[:, None, :2]
    cosine, sine = np.cos(exits[:, 2, None]), np.sin(exits[:, 2, None])
    along = np.abs(off[..., 0] * cosine + off[..., 1] * sine)
    across = np.abs(off[..., 1] * cosine - off[..., 0] * sine)
    lines = np.maximum(1, np.rint(across / job.layout.width_m).astype(np.int64))
    extra = np.maximum(0, lines - len(table) + 1) * job.layout.width_m
    turns = table[np.minimum(lines, len(table) - 1)] + (extra + along) / manner.turn_speed_mps
    onward = (along + across + 2.0 * math.pi * manner.radius_m) / manner.turn_speed_mps
    ways, tracks = np.array([one.direction for one in passes]), np.arange(len(passes)) // 2
    seconds = np.where(ways[:, None] == ways[None, :], onward, turns)
    cells = np.array([one.track.cell for one in passes])
    for p, q in zip(*np.nonzero(cells[:, None] != cells[None, :]), strict=True):
        seconds[p, q] = job.turn_time(passes[p], passes[q])
    return np.where(tracks[:, None] == tracks[None, :], FAR_S, np.rint(seconds / SAME_S) * SAME_S)


def _rounded(seconds: float) -> float:
    return round(seconds / SAME_S) * SAME_S
