"""Where in the field the grip could differ: circles of cells compared at once, the best ones then polished."""

from __future__ import annotations

from functools import cache, partial
from itertools import product

import numpy as np

from vehicle.measured.causes.dependence import Response, explained
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import FEWEST_TURNED_RAD, MOST_OF_TURNING

CELLS = 30  # per longer side of the field: chosen, fine enough for a wet corner, and 900 products a side
POLISHED = 2  # circles: chosen, the best and one more, for every one costs some hundred simulations of the filter
RADII = (1.5, 2.2, 3.2, 4.5, 6.5, 9.0)  # in cells: chosen, from the least that is no stripe to most of the field
Circle = tuple[float, float, float]


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
        self.turned = np.zeros(count)
        done = 0
        for index, (stretch, move) in enumerate(zip(stretches, response.moves, strict=True)):
            mine = number[done : done + stretch.rows - 1]
            done += stretch.rows - 1
            here = np.unique(mine)
            made = response.turned(index, np.stack([move.turned * (mine == cell) for cell in here]))
            square, side, cross = response.products(index, made)
            self.square[np.ix_(here, here)] += square
            self.side[here] += side
            self.cross[here] += cross
            self.turned += np.bincount(mine, np.abs(move.turned), count)
        share = self.cross @ response.inverse
        self.square -= share @ self.cross.T
        self.side -= share @ response.side

    def best_circles(self) -> list[tuple[float, Circle]]:
        """The best circle of each of several sizes, the better ones first."""
        circles = []
        whole = float(self.turned.sum())
        for radius in self.size * np.array(RADII):
            best: tuple[float, Circle] = (0.0, (0.0, 0.0, 0.0))
            for e, n in zip(self.east, self.north, strict=True):
                inside = np.hypot(self.east - e, self.north - n) < radius
                turned = float(self.turned[inside].sum())
                if FEWEST_TURNED_RAD < turned < MOST_OF_TURNING * whole:
                    weights = inside.astype(np.float64)
                    square = (weights @ self.square @ weights).reshape(1, 1)
                    gain = float(explained(square, np.array([weights @ self.side])))
                    best = max(best, (gain, (float(e), float(n), float(radius))))
            circles.append(best)
        return sorted(circles, reverse=True)[:POLISHED]


def _gain(response: Response, circle: Circle) -> float:
    """Loss taken away by grip inside a circle."""
    e, n, r = circle
    width = response.fit.slope.shape[1]
    square, side, cross = np.zeros((1, 1)), np.zeros(1), np.zeros((1, width))
    for index, (stretch, move) in enumerate(zip(response.bench.course.stretches, response.moves, strict=True)):
        inside = (stretch.east[:-1] - e) ** 2 + (stretch.north[:-1] - n) ** 2 < r * r
        if inside.any():
            parts = response.products(index, response.turned(index, (move.turned * inside)[None]))
            square, side, cross = square + parts[0], side + parts[1], cross + parts[2]
    return response.beyond(square, side, cross)


def _polished(response: Response, circle: Circle, cell: float) -> tuple[float, Circle]:
    """Pattern search over centre and radius together: one edge may stay where it is while the other moves."""
    if circle[2] <= 0.0:
        return 0.0, circle
    gain_of = cache(partial(_gain, response))
    best, step = gain_of(circle), cell
    while step > 0.15 * cell:
        tried = []
        for de, dn, dr in product((-step, 0.0, step), repeat=3):
            other = (circle[0] + de, circle[1] + dn, max(circle[2] + dr, 0.5 * cell))
            tried.append((gain_of(other), other))
        gain, other = max(tried)
        if gain > best:
            best, circle = gain, other
        else:
            step *= 0.5
    return best, circle
