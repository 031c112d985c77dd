"""Where in the field the grip could differ: circles of cells compared at once, the best ones then polished."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from vehicle.jit import compiled
from vehicle.measured.causes.dependence import Products, Response, explained
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Stretch
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import FEWEST_TURNED_RAD, MOST_OF_TURNING

CELLS = 30  # per longer side of the field: chosen, fine enough for a wet corner, and 900 products a side
POLISHED = 2  # circles: chosen, the best and one more, for every one costs some hundred simulations of the filter
RADII = (1.5, 2.2, 3.2, 4.5, 6.5, 9.0)  # in cells: chosen, from the least that is no stripe to most of the field
# s: a longer stretch is taken in pieces, so that memory and time go with the cells of a piece. A turn shows in the
# surprises of some seconds; what came before a piece is followed for long enough to be forgotten in it.
PIECE_S, BEFORE_S = 240.0, 60.0
Circle = tuple[float, float, float]
Numbers = npt.NDArray[np.int64]


def best_patch(bench: Bench, fit: Fit) -> Circle | None:
    """Centre (in the logs' own frame) and radius of the circle whose grip explains most of what the fit leaves.

    None when the tractor turns nowhere, or nowhere in particular.
    """
    response = Response(bench, fit)
    cells = _Cells(response)
    best: tuple[float, Circle] = (0.0, (0.0, 0.0, 0.0))
    for _, circle in cells.best_circles():
        best = max(best, _polished(response, circle, cells.size))
    if best[0] <= 0.0:
        return None
    origin = bench.course.origin
    return best[1][0] + origin[0], best[1][1] + origin[1], best[1][2]


@dataclass(frozen=True)
class _Piece:
    """Rows `begin` to `end` of a stretch, told from its turns from row `lead` on."""

    index: int
    lead: int
    begin: int
    end: int

    @property
    def turns(self) -> slice:
        """The turns that reach into the rows."""
        return slice(self.lead, self.end - 1)

    def products(self, response: Response, turns: Array) -> Products:
        """Products of the columns that turns (c, n) of the piece make in its rows."""
        return response.products(self.index, self._made(response, turns), self.begin)

    def products_of_each(self, response: Response, turns: Array) -> Products:
        """The same of every column alone: squares (c,), products with what is left (c,) and with the fit (c, m)."""
        return response.products_of_each(self.index, self._made(response, turns), self.begin)

    def _made(self, response: Response, turns: Array) -> Array:
        made = response.turned(self.index, turns, self.lead)
        return made[(self.begin - self.lead) * (len(made) // (turns.shape[1] + 1)) :]


def _pieces(stretches: tuple[Stretch, ...]) -> Iterator[_Piece]:
    """All rows of all stretches, a long one in pieces of one length."""
    for index, stretch in enumerate(stretches):
        count = max(round(float(stretch.time[-1]) / PIECE_S), 1)
        cuts = np.searchsorted(stretch.time, np.arange(1, count) * (stretch.time[-1] / count))
        begins, ends = [0, *cuts.tolist()], [*cuts.tolist(), stretch.rows]
        for begin, end in zip(begins, ends, strict=True):
            if end - begin > 1:
                lead = int(np.searchsorted(stretch.time, stretch.time[begin] - BEFORE_S))
                yield _Piece(index, lead, begin, end)


class _Cells:
    """Grip of every cell of the field as a column of its own: products summed over the stretches."""

    def __init__(self, response: Response) -> None:
        stretches = response.bench.course.stretches
        east = np.concatenate([s.east[:-1] for s in stretches])
        north = np.concatenate([s.north[:-1] for s in stretches])
        self.size = float(max(np.ptp(east), np.ptp(north), 1e-6)) / CELLS
        columns, rows = np.floor((east - east.min()) / self.size), np.floor((north - north.min()) / self.size)
        _, first, number = np.unique(columns * 10000 + rows, return_index=True, return_inverse=True)
        self.east = east.min() + (columns[first] + 0.5) * self.size
        self.north = north.min() + (rows[first] + 0.5) * self.size
        count, width = len(first), response.fit.slope.shape[1]
        self.square, self.side, self.cross = np.zeros((count, count)), np.zeros(count), np.zeros((count, width))
        starts = np.cumsum([0, *(stretch.rows - 1 for stretch in stretches)])
        for piece in _pieces(stretches):
            mine = number[starts[piece.index] :][piece.turns]
            turned = response.moves[piece.index].turned[piece.turns]
            here = np.unique(mine)
            square, side, cross = piece.products(response, turned * (mine == here[:, None]))
            self.square[np.ix_(here, here)] += square
            self.side[here] += side
            self.cross[here] += cross
        turned = np.concatenate([move.turned for move in response.moves])
        self.turned = np.bincount(number, np.abs(turned), count)
        share = self.cross @ response.inverse
        self.square -= share @ self.cross.T
        self.side -= share @ response.side

    def best_circles(self) -> list[tuple[float, Circle]]:
        """The best circle of each of several sizes, the better ones first."""
        circles = []
        whole = float(self.turned.sum())
        away = np.hypot(self.east - self.east[:, None], self.north - self.north[:, None])
        for radius in self.size * np.array(RADII):
            square, side, turned = np.zeros((3, len(away)))
            _inside(away, radius, self.square, self.side, self.turned, square, side, turned)
            gains = explained(square.reshape(-1, 1, 1), side[:, None])
            gains[(turned <= FEWEST_TURNED_RAD) | (turned >= MOST_OF_TURNING * whole)] = 0.0
            best: tuple[float, Circle] = (0.0, (0.0, 0.0, 0.0))
            for place in np.flatnonzero(gains == gains.max()):
                best = max(best, (float(gains[place]), self._circle(int(place), float(radius))))
            circles.append(best if best[0] > 0.0 else (0.0, (0.0, 0.0, 0.0)))
        return sorted(circles, reverse=True)[:POLISHED]

    def _circle(self, place: int, radius: float) -> Circle:
        return float(self.east[place]), float(self.north[place]), radius


@compiled
def _inside(away, radius, squares, sides, turns, square, side, turned) -> None:  # type: ignore[no-untyped-def]
    """Per cell, sums over those that are less `away` (c, c) than a radius: of all products, of sides and of turns."""
    near = np.empty(len(away), np.int64)
    for i in range(len(away)):
        count = 0
        for j in range(len(away)):
            if away[i, j] < radius:
                near[count] = j
                count += 1
        for one in range(count):
            j = near[one]
            side[i] += sides[j]
            turned[i] += turns[j]
            for two in range(count):
                square[i] += squares[j, near[two]]


def _gains(response: Response, circles: Sequence[Circle]) -> list[float]:
    """Loss taken away by grip inside each of some circles."""
    e, n, r = (np.array(column)[:, None] for column in zip(*circles, strict=True))
    width, stretches = response.fit.slope.shape[1], response.bench.course.stretches
    square, side, cross = np.zeros(len(circles)), np.zeros(len(circles)), np.zeros((len(circles), width))
    insides = [(s.east[:-1] - e) ** 2 + (s.north[:-1] - n) ** 2 < r * r for s in stretches]
    for piece in _pieces(stretches):
        inside = insides[piece.index][:, piece.turns]
        here = np.flatnonzero(inside.any(axis=1))
        if len(here):
            turned = response.moves[piece.index].turned[piece.turns]
            parts = piece.products_of_each(response, turned * inside[here])
            square[here] += parts[0]
            side[here] += parts[1]
            cross[here] += parts[2]
    each = zip(square.reshape(-1, 1, 1), side[:, None], cross[:, None], strict=True)
    return [response.beyond(*parts) for parts in each]


def _polished(response: Response, circle: Circle, cell: float) -> tuple[float, Circle]:
    """Pattern search over centre and radius together: one edge may stay where it is while the other moves."""
    if circle[2] <= 0.0:
        return 0.0, circle
    known = dict(zip([circle], _gains(response, [circle]), strict=True))
    best, step = known[circle], cell
    while step > 0.15 * cell:
        others = [
            (circle[0] + de, circle[1] + dn, max(circle[2] + dr, 0.5 * cell))
            for de, dn, dr in product((-step, 0.0, step), repeat=3)
        ]
        new = [other for other in dict.fromkeys(others) if other not in known]
        known.update(zip(new, _gains(response, new) if new else (), strict=True))
        gain, other = max((known[other], other) for other in others)
        if gain > best:
            best, circle = gain, other
        else:
            step *= 0.5
    return best, circle
