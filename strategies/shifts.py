"""The rounds of the headland in the order they are driven, shared out among tractors.

A stretch is a side of a round or a part of one. All stretches, one after another, are cut into runs of equal time, so
that tractors follow one another at a distance; where several would begin side by side, a round is begun elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.rounds import Round, Side
from strategies.corners import corner_ways
from strategies.job import Job

Point = tuple[float, float]

NEIGHBOURS = 1.05  # widths between rounds of which one must be driven before the other
SHORTEST_M = 15.0  # no side is cut so that less is left of it
EVEN = 0.05  # of a share: so much may be too much or too little for the sake of whole rounds


@dataclass(frozen=True, eq=False)
class Stretch:
    """A side of a round, from one distance along it (m) to another; None where it reaches into the corner there."""

    lap: Round
    side: int
    first_m: float | None = None
    last_m: float | None = None

    @property
    def line(self) -> npt.NDArray[np.float64]:
        """Centre line of the whole side (n, 2); twice round where it has no corner."""
        points = self.lap.sides[self.side].points
        return np.concatenate([points, points[1:]]) if self.smooth else points

    @property
    def smooth(self) -> bool:
        """Whether the round has no corner at all."""
        return self.lap.closed and len(self.lap.sides) == 1 and self.lap.sides[0].before_rad == 0.0

    @property
    def length_m(self) -> float:
        """Length that is worked, corners apart (m)."""
        first, last = self.first_m or 0.0, self.last_m
        return (self.lap.sides[self.side].length_m if last is None else last) - first


def shared(job: Job, *, outside_in: bool, begin: Point | None = None) -> list[list[Stretch]]:
    """The stretches of every tractor in order; a tractor may have none.

    `begin` is where the first of them starts, or near it.
    """
    left = list(job.rounds)
    order = _Before(left, job.layout.width_m, outside_in)
    total = sum(_seconds(job, lap.length_m, len(lap.sides)) for lap in left)
    deal = _Deal(job, total / job.tractors, [[] for _ in range(job.tractors)])
    here = begin
    while left:
        ready = [lap for lap in left if order.free(lap, left)]
        lap, first = _nearest(ready, here) if here or not deal.starts else _farthest(ready, deal.starts)
        left = [other for other in left if other.number != lap.number or other.ring != lap.ring]
        here = deal.take(lap, first)
    return deal.shares


class _Before:
    """Which rounds must be driven before which."""

    def __init__(self, laps: list[Round], width_m: float, outside_in: bool) -> None:
        lines, step = [lap.line for lap in laps], -1 if outside_in else 1
        self._needs = {
            (lap.number, lap.ring): {
                (other.number, other.ring)
                for other, path in zip(laps, lines, strict=True)
                if other.number == lap.number + step and shapely.dwithin(line, path, NEIGHBOURS * width_m)
            }
            for lap, line in zip(laps, lines, strict=True)
        }

    def free(self, lap: Round, left: list[Round]) -> bool:
        """Whether nothing that is left must come before a round."""
        return not any((other.number, other.ring) in self._needs[lap.number, lap.ring] for other in left)


@dataclass
class _Deal:
    """Shares while they are dealt: seconds for each, the shares, how much of the current one is used, and starts."""

    job: Job
    each_s: float
    shares: list[list[Stretch]]
    number: int = 0
    used_s: float = 0.0

    @property
    def starts(self) -> list[Point]:
        """Where the shares dealt so far begin."""
        return [_point(share[0].line[0]) for share in self.shares if share]

    def take(self, lap: Round, first: int) -> Point | None:
        """Deal all sides of a round, beginning with one; where the tractor is then, None for one that only starts."""
        count = len(lap.sides)
        for side in [(first + step) % count for step in range(count)]:
            self._take_side(Stretch(lap, side))
        if self.number < len(self.shares) - 1 and self.each_s - self.used_s < EVEN * self.each_s:
            self._next()
            return None
        return _point(lap.sides[(first - 1) % count].points[-1])

    def _take_side(self, whole: Stretch) -> None:
        """Deal a side, cut where a share is full."""
        begun, length = 0.0, whole.length_m
        while True:
            rest = _seconds(self.job, length - begun, 1)
            spare = self.each_s - self.used_s
            if self.number == len(self.shares) - 1 or rest <= spare * (1.0 + EVEN):
                break
            upto = begun + spare * self.job.manner.work_speed_mps
            if length - upto < SHORTEST_M:
                break
            if upto - begun >= SHORTEST_M:
                self._add(replace(whole, first_m=begun or None, last_m=upto), 0)
                begun = upto
            self._next()
        self._add(replace(whole, first_m=begun or None), 1)

    def _add(self, piece: Stretch, corners: int) -> None:
        self.shares[self.number].append(piece)
        self.used_s += _seconds(self.job, piece.length_m, corners)

    def _next(self) -> None:
        self.number += 1
        self.used_s = 0.0


def _seconds(job: Job, length_m: float, corners: int) -> float:
    return length_m / job.manner.work_speed_mps + corners * _corner_s(job)


def _corner_s(job: Job) -> float:
    """Seconds of a right-angled corner, for sharing."""
    tool, half = job.manner.tool_m, 0.5 * job.layout.width_m
    a, b = (tool - half, 0.0, 0.0), (0.0, tool - half, 0.5 * math.pi)
    ways = corner_ways(a, b, job.manner.radius_m) if job.square else []
    return min((job.connector.costs.time_s(way) for way in ways), default=0.0)


def _nearest(ready: list[Round], here: Point | None) -> tuple[Round, int]:
    """The round that begins nearest to a place, and its first side; without a place the longest side of all."""
    options = [(lap, side) for lap in _either_way(ready) for side in range(len(lap.sides))]
    if here is None:
        return max(options, key=lambda option: round(option[0].sides[option[1]].length_m, 3))
    return min(options, key=lambda option: round(math.dist(option[0].sides[option[1]].points[0], here), 3))


def _farthest(ready: list[Round], starts: list[Point]) -> tuple[Round, int]:
    """The round of the least number ready, and the side of it that begins farthest from where others begin."""
    longest = max(ready, key=lambda lap: round(lap.length_m, 3))

    def away(side: int) -> float:
        return round(min(math.dist(longest.sides[side].points[0], start) for start in starts), 3)

    return longest, max(range(len(longest.sides)), key=away)


def _either_way(laps: list[Round]) -> list[Round]:
    """The rounds, and open ones driven the other way as well."""
    return laps + [_reversed(lap) for lap in laps if not lap.closed]


def _reversed(lap: Round) -> Round:
    return replace(lap, sides=tuple(Side(side.points[::-1]) for side in lap.sides[::-1]))


def _point(xy: npt.NDArray[np.float64]) -> Point:
    return float(xy[0]), float(xy[1])
