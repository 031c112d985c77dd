"""One more effect on top of a fit, the coordinates of the others following, and how far above chance it stands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vehicle.measured.fit.fitting import Fit, linear_extra
from vehicle.measured.fit.knobs import Knobs, block_of, settings_of
from vehicle.measured.fit.products import Tall, crossed, squared, without
from vehicle.measured.fit.solver import FIRST_STEP, Point, Rule, aside, descend
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench, Change
from vehicle.measured.thresholds import FAR_LESS, HOPELESS, NULL_DRAWS, NULL_QUANTILE

ITERATIONS = 3  # chosen: a candidate is fitted again once it is in
SETTLED = 0.01  # chosen, of a typical size: a step this small is the last
LEAST_PART = 1e-10  # of the squared size of the largest direction of a fit: smaller ones are rounding
Changes = Callable[[Sequence[Change], Array], Iterator[Array]]


@dataclass(frozen=True, eq=False)
class Tried:
    """A candidate at its best: coordinates, loss taken away beyond the fit, columns with the fit taken out.

    One that is not `ended` was left because it promised far less than others. `begun` (m,) is where its first slope was
    taken; it may be gone on with from `left`, where that is known. One with a promise `foreseen` was not tried at all.
    """

    knobs: Knobs
    at: Array
    gain: float
    columns: Array
    ended: bool = True
    begun: Array | None = None
    left: Point | None = None
    foreseen: float | None = None


class Projector:
    """Takes the columns of a fit out of vectors."""

    def __init__(self, slope: Array) -> None:
        """What makes orthonormal directions of the columns, as far as their products tell."""
        self.slope, self.turn, self._laid = slope, np.zeros((slope.shape[1], 0)), Tall(slope)
        if slope.size:
            square = self._laid.square
            scale = np.maximum(np.sqrt(np.diag(square)), 1e-12)
            size, turn = np.linalg.eigh(square / np.outer(scale, scale))
            known = size > LEAST_PART * size[-1]
            self.turn = turn[:, known] / np.sqrt(size[known]) / scale[:, None]

    def __call__(self, vector: Array) -> Array:
        """The part of a vector (n,) that no column explains."""
        if not self.turn.size:
            return vector
        return self._laid.without(vector, self.turn @ (self.turn.T @ self._laid.crossed(vector)))

    def products(self, columns: Array) -> Array:
        """Products (k, k) with each other of the parts of columns (n, k) that no column of the fit explains."""
        share = self.turn.T @ self._laid.crossed_with(columns)
        return crossed(columns, columns) - share.T @ share


@dataclass(frozen=True, eq=False)
class _OneMore:
    """The problem of one more effect: what no column of the fit explains."""

    changes_of: Changes
    fit: Fit
    knobs: Knobs
    project: Projector

    @property
    def typical(self) -> Array:
        return np.array(self.knobs.typical)

    @property
    def low(self) -> Array:
        return np.array(self.knobs.low)

    @property
    def high(self) -> Array:
        return np.array(self.knobs.high)

    @property
    def linear(self) -> None:
        return None

    @cached_property
    def _bare(self) -> Array:
        fit = self.fit
        return fit.surprise if fit.extra is None else fit.surprise - fit.extra.sum

    def at(self, places: Sequence[Array]) -> Iterator[Point]:
        """The points at places, one after another."""
        block = frozenset({block_of(self.knobs.id)})
        asked = [(settings_of([*self.fit.parts, (self.knobs, at)]), block) for at in places]
        for at, changed in zip(places, self.changes_of(asked, self._bare), strict=True):
            yield Point(at, self.project(linear_extra(changed, self.fit.extra)))

    def left(self, at: Array, start: Point) -> Array:
        return next(self.at([at])).left

    def changes(self, places: Sequence[Array], axes: Sequence[int], start: Point) -> Iterator[Array]:
        return (one.left - start.left for one in self.at(places))


def tried(
    changes_of: Changes, fit: Fit, knobs: Knobs, project: Projector, worth: float = 0.0, left: Array | None = None
) -> Tried:
    """Fit one more effect while the coordinates of the others follow linearly.

    `changes_of` is Bench.changes, `project` takes out the columns of the fit, and `left` (n,) is what it leaves of the
    surprises, where that is known. A candidate that promises far less than the gain that is `worth` something is not
    simulated further.
    """
    problem = _OneMore(changes_of, fit, knobs, project)
    best = without = Point(np.array(knobs.neutral), project(fit.surprise) if left is None else left)
    for other in problem.at([np.array(start) for start in knobs.starts if start != knobs.neutral]):
        best = other if other.loss < best.loss else best
    return _descended(problem, best, without.loss, worth)


def gone_on(changes_of: Changes, fit: Fit, one: Tried, project: Projector, left: Array, worth: float = 0.0) -> Tried:
    """A candidate of the same fit from where it was left, when it was: what tried finds at once with that `worth`."""
    if one.left is None:
        return tried(changes_of, fit, one.knobs, project, worth, left)
    return _descended(_OneMore(changes_of, fit, one.knobs, project), one.left, squared(left), worth)


def _descended(problem: _OneMore, best: Point, loss: float, worth: float) -> Tried:
    """The candidate from its best start on, or from where its first slope was taken, beside a `loss` without it."""

    def settled(before: Point, after: Point) -> bool:
        return bool(np.all(np.abs(after.at - before.at) < SETTLED * problem.typical))

    promises: list[float] = []

    def worthwhile(point: Point) -> bool:
        promises.append(loss - point.loss + _promise(point))
        return not promises[-1] < needed(worth)

    end = descend(problem, best, Rule(ITERATIONS, settled, worthwhile=worthwhile, slopes=int(best.taken is not None)))
    ended = not HOPELESS <= promises[-1] < FAR_LESS * worth
    left = end if not ended and len(promises) == 1 else None
    return Tried(problem.knobs, end.at, loss - end.loss, end.slope, ended, best.at, left)


def needed(worth: float) -> float:
    """What a candidate must promise to be simulated further, beside a gain that is `worth` something."""
    return max(HOPELESS, FAR_LESS * worth)


def sides_of(knobs: Knobs, at: Array) -> list[Array]:
    """Where the first slope at coordinates is taken, one place per axis."""
    return [aside(knobs.typical, knobs.high, at, axis, FIRST_STEP) for axis in range(knobs.count)]


def _promise(point: Point) -> float:
    """Loss that a straight line takes away."""
    return promised(crossed(point.slope, point.slope), crossed(point.slope, point.left))


def promised(square: Array, side: Array) -> float:
    """Loss that columns take away, from their products with each other (m, m) and with what is left (m,)."""
    scale = np.maximum(np.diag(square), 1e-12)
    return float(side @ np.linalg.solve(square + 1e-9 * np.diag(scale), side))


def strengths(bench: Bench, candidates: Sequence[Tried], left: Array) -> tuple[list[float], float]:
    """Strength of every candidate, and the strength that the best of all reaches by chance in 1 of 100 draws.

    Strength is the squared slope of the loss over its scatter between blocks of ten seconds (never less than the noise
    alone gives). Chance is what is left after the best candidate, with the sign of every block drawn at random.
    """
    rng = np.random.default_rng(20)
    count = len(bench.block_runs)
    signs = rng.choice([-1.0, 1.0], size=(NULL_DRAWS, count))
    largest, strength = np.zeros(NULL_DRAWS), []
    for one in candidates:
        square = crossed(one.columns, one.columns)
        if not np.all(np.diag(square) > 1e-9):
            strength.append(0.0)
            continue
        amounts: Array = np.linalg.solve(square, crossed(one.columns, left)).astype(np.float64)
        moved = without(left, one.columns, amounts)
        sides = np.stack([np.bincount(bench.blocks, column * moved, count) for column in one.columns.T], axis=1)
        spread = sides.T @ sides
        scatter = square * max(1.0, float(np.trace(np.linalg.solve(square, spread))) / len(square))
        inverse = np.linalg.inv(scatter)
        strength.append(one.gain * float(np.trace(square @ inverse)) / len(square))
        drawn = signs @ sides
        largest = np.maximum(largest, np.einsum("di,ij,dj->d", drawn, inverse, drawn))
    return strength, float(np.quantile(largest, NULL_QUANTILE))
