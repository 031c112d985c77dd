"""The rounds of the headland in the order they are driven, shared out among tractors.

Rounds that lie inside one another are a nest. Nests are dealt in equal time: a tractor gets a whole nest, which it
drives round by round, or a sector of it, which it drives to and fro, so that all tractors stay as far apart as their
sectors are long, and at the border of two sectors one turns while the other is away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.rounds import Round, Side
from strategies.headland.corners import corner_ways
from strategies.job import Job

Point = tuple[float, float]

NEIGHBOURS = 1.05  # widths between rounds that lie inside one another
ALIKE = 0.7  # a round so much shorter than the one before begins a nest of its own: sectors would not fit it
SHORTEST_M = 15.0  # no side is cut so that less is left of it
LEAST_S = 40.0  # no nest is cut so that less is left of it
LEFT_M = 5.0  # of a round that sectors leave out: rounding, and pieces too short to drive
EVEN = 0.05  # of a share: so much it may have too much for the sake of whole nests


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
    def start(self) -> Point:
        """Where it begins on the centre line."""
        return self._place(self.first_m or 0.0)

    @property
    def end(self) -> Point:
        """Where it ends on the centre line."""
        return self._place((self.first_m or 0.0) + self.length_m)

    def _place(self, at: float) -> Point:
        return _point(np.asarray(shapely.LineString(self.line).interpolate(at).coords[0]))

    @property
    def smooth(self) -> bool:
        """Whether the round has no corner at all."""
        return self.lap.closed and len(self.lap.sides) == 1 and self.lap.sides[0].before_rad == 0.0

    @property
    def length_m(self) -> float:
        """Length that is worked, corners apart (m)."""
        first, last = self.first_m or 0.0, self.last_m
        return (self.lap.sides[self.side].length_m if last is None else last) - first


@dataclass(frozen=True)
class _Sector:
    """A tractor's part of a nest, from one share of its length to another; (0, 1) is the whole."""

    laps: list[Round]
    first: float
    last: float


def shared(
    job: Job, *, outside_in: bool, begin: Point | None = None, origin: float = 0.0
) -> list[list[Stretch]]:
    """The stretches of every tractor in order; a tractor may have none.

    `begin` is where each starts that drives a whole nest, or near it. Borders of sectors are counted from `origin`, a
    share of the length of the outer round from the middle of its longest side on. Where borders that run square through
    a nest do not meet one of its rounds well, a nest of its own begins with that.
    """
    nests = _nests(job, outside_in)
    while True:
        shares = _shares(job, nests, begin, origin)
        apart = _set_apart(nests, shares)
        if len(apart) == len(nests):
            return shares
        nests = apart


def _set_apart(nests: list[list[Round]], shares: list[list[Stretch]]) -> list[list[Round]]:
    """The nests, with a new one before every round that the shares do not cover whole."""
    driven: dict[tuple[int, int], float] = {}
    for stretch in (stretch for share in shares for stretch in share):
        key = stretch.lap.number, stretch.lap.ring
        driven[key] = driven.get(key, 0.0) + stretch.length_m
    apart: list[list[Round]] = []
    for nest in nests:
        for index, lap in enumerate(nest):
            if not index or driven.get((lap.number, lap.ring), 0.0) < lap.length_m - LEFT_M:
                apart.append([])
            apart[-1].append(lap)
    return apart


def _shares(job: Job, nests: list[list[Round]], begin: Point | None, origin: float) -> list[list[Stretch]]:
    shares, corner_m = [], _corner_s(job) * job.manner.work_speed_mps
    for sectors in _dealt(job, nests):
        here, share = begin, list[Stretch]()
        for sector in sectors:
            whole = sector.last - sector.first > 1.0 - 1e-9
            share += _round_by_round(sector.laps, here) if whole else _to_and_fro(sector, origin, corner_m)
            here = share[-1].end if share else here
        shares.append(share)
    return shares


def _nests(job: Job, outside_in: bool) -> list[list[Round]]:
    """Rounds that lie inside one another, in the order they are driven."""
    left = sorted(job.rounds, key=lambda lap: (lap.number, -round(lap.length_m, 3), lap.ring))
    nests: list[list[Round]] = []
    while left:
        nest = [left.pop(0)]
        while nest[-1].closed:
            inner = next((lap for lap in left if _inside(lap, nest[-1], job.layout.width_m)), None)
            if inner is None:
                break
            left.remove(inner)
            nest.append(inner)
        nests.append(nest)
    return nests if outside_in else [nest[::-1] for nest in nests[::-1]]


def _inside(lap: Round, outer: Round, width_m: float) -> bool:
    """Whether a round is the next one inside another and much like it."""
    if not lap.closed or lap.number != outer.number + 1 or lap.length_m < ALIKE * outer.length_m:
        return False
    return bool(shapely.dwithin(lap.line, outer.line, NEIGHBOURS * width_m))


def _dealt(job: Job, nests: list[list[Round]]) -> list[list[_Sector]]:
    """The sectors of every tractor, of equal time."""
    times = [sum(_seconds(job, lap.length_m, len(lap.sides)) for lap in nest) for nest in nests]
    each, used, number = sum(times) / job.tractors, 0.0, 0
    shares: list[list[_Sector]] = [[] for _ in range(job.tractors)]
    for nest, seconds in zip(nests, times, strict=True):
        first = 0.0
        while first < 1.0:
            spare, rest = each - used, (1.0 - first) * seconds
            whole = number == job.tractors - 1 or rest <= spare + EVEN * each or not nest[0].closed
            last = 1.0 if whole or rest - spare < LEAST_S else first + spare / seconds
            if last < 1.0 and spare < LEAST_S:
                last = first
            if last > first:
                shares[number].append(_Sector(nest, first, last))
            used += (last - first) * seconds
            first = last
            if number < job.tractors - 1 and each - used < LEAST_S:
                number, used = number + 1, 0.0
    return shares


def _round_by_round(laps: list[Round], here: Point | None) -> Iterator[Stretch]:
    """All sides of a nest, each round from where it is nearest; without a place from its longest side."""
    for lap in laps:
        ways = [lap] if lap.closed else [lap, backwards(lap)]
        options = [(way, side) for way in ways for side in range(len(way.sides) if way.closed else 1)]
        way, first = max(options, key=_length) if here is None else min(options, key=_from(here))
        yield from (Stretch(way, (first + step) % len(way.sides)) for step in range(len(way.sides)))
        here = _point(way.sides[first - 1].points[-1])


def _length(option: tuple[Round, int]) -> float:
    return round(option[0].sides[option[1]].length_m, 3)


def _from(here: Point) -> Callable[[tuple[Round, int]], float]:
    return lambda option: round(math.dist(option[0].sides[option[1]].points[0], here), 3)


def _to_and_fro(sector: _Sector, origin: float, corner_m: float) -> Iterator[Stretch]:
    """The sector of every round of a nest, in alternating directions; borders run square through the nest."""
    outer = sector.laps[0]
    ends = [_border(outer, share + origin, corner_m) for share in (sector.first, sector.last)]
    expected = (sector.last - sector.first) * outer.length_m
    for index, lap in enumerate(sector.laps):
        line, length = shapely.LinearRing(lap.line), lap.length_m
        first, last = (_clear(lap, float(line.project(shapely.Point(end)))) for end in ends)
        run = (last - first) % length
        if run > SHORTEST_M and run < 1.5 * expected + SHORTEST_M:
            pieces = list(_pieces(lap, first, run))
            yield from pieces if index % 2 == 0 else [_turned(piece) for piece in pieces[::-1]]
            expected = run
        ends = [_point(np.asarray(line.interpolate(at).coords[0])) for at in (first, last)]


def _border(lap: Round, share: float, corner_m: float) -> Point:
    """Where the border between sectors lies on the first round of a nest, from the middle of its longest side on.

    `share` is one of the time for the round, in which a corner takes as long as driving `corner_m`.
    """
    lengths = [side.length_m for side in lap.sides]
    longest = max(range(len(lengths)), key=lambda side: round(lengths[side], 3))
    spans = [length + corner_m for length in lengths]
    left = (sum(spans[:longest]) + 0.5 * lengths[longest] + share * sum(spans)) % sum(spans)
    at = 0.0
    for length, span in zip(lengths, spans, strict=True):
        at += min(left, length)
        left -= span
        if left < 0.0:
            break
    return _point(np.asarray(shapely.LineString(lap.line).interpolate(_clear(lap, at)).coords[0]))


def _clear(lap: Round, at: float) -> float:
    """A place along a round moved away from the corners, or into one on a short side (m)."""
    start = 0.0
    for side in lap.sides:
        length = side.length_m
        if at <= start + length + 1e-6:
            if length < 2.0 * SHORTEST_M:
                return start if at - start < 0.5 * length else start + length
            return min(max(at, start + SHORTEST_M), start + length - SHORTEST_M)
        start += length
    return at


def _pieces(lap: Round, first: float, run: float) -> Iterator[Stretch]:
    """The sides of a round, or parts of them, from a place along it on for a length (m)."""
    count = len(lap.sides)
    starts = np.cumsum([0.0, *(side.length_m for side in lap.sides)]).tolist()
    for turn, side in ((turn, side) for turn in (0, 1) for side in range(count)):
        low, high = starts[side] + turn * starts[-1], starts[side + 1] + turn * starts[-1]
        begin, end = max(low, first), min(high, first + run)
        if end - begin > 1.0:
            yield Stretch(
                lap,
                side,
                None if begin - low < 1e-3 else begin - low,
                None if high - end < 1e-3 else end - low,
            )


def _turned(piece: Stretch) -> Stretch:
    """The same stretch driven the other way."""
    length = piece.lap.sides[piece.side].length_m
    first = None if piece.last_m is None else length - piece.last_m
    last = None if piece.first_m is None else length - piece.first_m
    return Stretch(backwards(piece.lap), len(piece.lap.sides) - 1 - piece.side, first, last)


def backwards(lap: Round) -> Round:
    """A round driven the other way."""
    return replace(lap, sides=tuple(Side(s.points[::-1], -s.after_rad, -s.before_rad) for s in lap.sides[::-1]))


def _seconds(job: Job, length_m: float, corners: int) -> float:
    return length_m / job.manner.work_speed_mps + corners * _corner_s(job)


def _corner_s(job: Job) -> float:
    """Seconds of a right-angled corner, for sharing."""
    tool, half = job.manner.tool_m, 0.5 * job.layout.width_m
    a, b = (tool - half, 0.0, 0.0), (0.0, tool - half, 0.5 * math.pi)
    ways = corner_ways(a, b, job.manner.radius_m) if job.square else []
    return min((job.connector.costs.time_s(way) for way in ways), default=0.0)


def _point(xy: npt.NDArray[np.float64]) -> Point:
    return float(xy[0]), float(xy[1])
