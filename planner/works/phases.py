"""What a machine did when: working, turning, on a way, standing; and its turns one by one.

A stop is a stand of five seconds and more. Off work, what lies between two stretches of work is a turn where it is no
longer than `LONGEST_TURN_M`, else a way, as is what comes before the first and after the last. Time in which nothing
was logged though the machine moved is a kind of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from planner.works.metres import STANDING_MPS
from planner.works.record import Array, Driven, Mask
from reports.work_results import KINDS, STANDING, TURNING, UNLOGGED, WAY, WORKING

STOP_S = 5.0
LONGEST_TURN_M = 200.0
GAP_S, GAP_STEPS = 5.0, 5.0  # a step this long, and this many times the usual one, is a gap
BLIND_MPS = 0.1  # over a gap: slower means that it stood
U_DEG, U_SLACK_DEG = 180.0, 30.0
BEND_ROWS_M = 5.0  # of work before and after a turn that say which way it led
Kinds = npt.NDArray[np.int8]


@dataclass(frozen=True)
class Turn:
    """One stretch off work between two of work.

    Attributes:
        first, last: rows, from the last of work to the first of work again.
        seconds, standing_s, length_m: how long, how much of it standing, how far.
        bend_deg: between the directions of work before and after, 0 to 180.
        apart_m: between the lines of work before and after; only where those are parallel does it say anything.
    """

    first: int
    last: int
    seconds: float
    standing_s: float
    length_m: float
    bend_deg: float
    apart_m: float

    @property
    def is_u(self) -> bool:
        """Whether it leads back, and without a stop."""
        return abs(self.bend_deg - U_DEG) <= U_SLACK_DEG and self.standing_s < STOP_S


@dataclass(frozen=True, eq=False)
class Phases:
    """Kinds (n - 1,) as places in KINDS of the steps from row to row, stops (s,) in seconds, lifts, and turns."""

    kinds: Kinds
    stops_s: Array
    lifts: int
    turns: tuple[Turn, ...]


def phases(run: Driven) -> Phases:
    """What was done in every step of a run."""
    lasts, steps = np.diff(run.time_s), np.hypot(*np.diff(run.xy, axis=0).T)
    gaps = (lasts > GAP_S) & (lasts > GAP_STEPS * np.median(lasts))
    still = np.where(gaps, steps < BLIND_MPS * lasts, run.speed_mps[:-1] < STANDING_MPS)
    standing, stops_s = _stops(lasts, still)
    kinds = np.full(len(lasts), KINDS.index(WAY), dtype=np.int8)
    works = run.works[:-1] & ~gaps
    turns = tuple(_turns(run, standing)) if run.works_known else ()
    for turn in turns:
        kinds[turn.first : turn.last] = KINDS.index(TURNING)
    kinds[works] = KINDS.index(WORKING)
    kinds[gaps] = KINDS.index(UNLOGGED)
    kinds[standing] = KINDS.index(STANDING)
    return Phases(kinds, stops_s, int((run.works[:-1] & ~run.works[1:]).sum()), turns)


def _stops(lasts: Array, still: Mask) -> tuple[Mask, Array]:
    """Which steps belong to stops, and how long each stop is."""
    ends = np.cumsum(np.concatenate([[0.0], lasts]))
    found = np.zeros(len(lasts), dtype=np.bool_)
    stops = []
    for first, last in stretches(still):
        seconds = float(ends[last] - ends[first])
        if seconds >= STOP_S:
            found[first:last] = True
            stops.append(seconds)
    return found, np.array(stops)


def stretches(flags: Mask) -> Iterator[tuple[int, int]]:
    """First and one past the last of every run of true ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _turns(run: Driven, standing: Mask) -> Iterator[Turn]:
    """Stretches between two of work that are short enough for a turn."""
    lasts, steps = np.diff(run.time_s), np.hypot(*np.diff(run.xy, axis=0).T)
    for (_, end), (begin, _) in pairwise(stretches(run.works)):
        first, last = end - 1, begin
        length = float(steps[first:last].sum())
        if length > LONGEST_TURN_M:
            continue
        stood = float(lasts[first:last][standing[first:last]].sum())
        before, after = _along(run.xy, first, -1), _along(run.xy, last, 1)
        bend = float(np.degrees(np.arccos(np.clip(before @ after, -1.0, 1.0))))
        off = run.xy[last] - run.xy[first]
        apart = abs(float(before[0] * off[1] - before[1] * off[0]))
        yield Turn(first, last, float(run.time_s[last] - run.time_s[first]), stood, length, bend, apart)


def _along(xy: Array, row: int, side: int) -> Array:
    """The direction of driving (2,) at a row, from the few metres before (-1) or after (1) it."""
    other = row
    while 0 <= other + side < len(xy) and np.hypot(*(xy[other] - xy[row])) < BEND_ROWS_M:
        other += side
    way = side * (xy[other] - xy[row])
    return np.asarray(way / max(float(np.hypot(*way)), 1e-9))
