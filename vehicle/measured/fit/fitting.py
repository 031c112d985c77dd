"""Fitting effects to a bench, and what the blocks of the data say about the fit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from vehicle.measured.fit.knobs import Knobs, block_of, settings_of
from vehicle.measured.fit.products import Tall, add_products, squared
from vehicle.measured.fit.solver import LATER_STEP, Point, Rule, descend, slope_of, with_near_slope
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import MOST_USUAL

Part = tuple[Knobs, Array]
ITERATIONS = 4  # chosen: with starts near the best, as effects enter one by one, the third step is small already
SETTLED = 0.02  # chosen, of a typical size: a step this small is the last, far below what any interval tells
LEAST_STEP = 1e-6  # of the loss, which is of the order of the rows: less is rounding


@dataclass(frozen=True, eq=False)
class Extra:
    """Further terms of the path that are linear: one column of surprises each, and how much of it is in use.

    The first columns, as many as `unknowns`, are those of causes.unknowns and in every fit.
    """

    columns: Array
    amounts: Array
    unknowns: int = 0

    @property
    def terms(self) -> slice:
        """The columns that explain something."""
        return slice(self.unknowns, self.columns.shape[1])

    @cached_property
    def sum(self) -> Array:
        """What is in use of all columns together (n,)."""
        return self.laid.without(np.zeros(len(self.columns)), -self.amounts)

    @cached_property
    def laid(self) -> Tall:
        """The columns, looked at once for all amounts."""
        return Tall(self.columns)

    def with_amounts(self, amounts: Array) -> Extra:
        """The same terms, so much in use."""
        other = replace(self, amounts=amounts)
        other.__dict__["laid"] = self.laid
        return other


@dataclass(frozen=True, eq=False)
class Fit:
    """Effects at their best values.

    `surprise` (n,) is what is left, `slope` (n, m) its change per coordinate, in the order of the parts and then of the
    linear extra columns. That of a fit that is still to be refined means nothing.
    """

    parts: tuple[Part, ...]
    surprise: Array
    slope: Array
    extra: Extra | None = None
    # Fits on a bench without one of the parts, or without unnamed terms (""): several questions need the same ones.
    smaller: dict[tuple[Bench, str], Fit] = field(init=False, default_factory=dict)

    @property
    def loss(self) -> float:
        """Sum of squares."""
        return squared(self.surprise)

    @property
    def settings(self) -> dict[str, dict[str, float]]:
        """The effects as settings of a tractor."""
        return settings_of(list(self.parts))

    def columns(self, name: str) -> slice:
        """Columns of `slope` that belong to an effect."""
        first = 0
        for knobs, _ in self.parts:
            if knobs.id == name:
                return slice(first, first + knobs.count)
            first += knobs.count
        raise KeyError(name)


def empty_fit(bench: Bench) -> Fit:
    """The fit without any effect."""
    surprise = bench.surprise({})
    return Fit((), surprise, np.zeros((len(surprise), 0)))


def linear_extra(surprise: Array, extra: Extra | None) -> Array:
    """Surprises with the linear terms taken off."""
    return surprise if extra is None else surprise + extra.sum


@dataclass(frozen=True, eq=False)
class _Parts:
    """The problem of all parts and linear extra terms of a fit together: coordinates of the parts, then amounts."""

    bench: Bench
    fit: Fit

    @cached_property
    def typical(self) -> Array:
        return flat([knobs.typical for knobs, _ in self.fit.parts])

    @cached_property
    def low(self) -> Array:
        return np.append(flat([knobs.low for knobs, _ in self.fit.parts]), -self._most)

    @cached_property
    def high(self) -> Array:
        return np.append(flat([knobs.high for knobs, _ in self.fit.parts]), self._most)

    @property
    def _most(self) -> Array:
        """Largest amounts of the linear terms: what differs from tractor to tractor differs by so much."""
        if self.fit.extra is None:
            return np.zeros(0)
        most = np.full(len(self.fit.extra.amounts), np.inf)
        most[: self.fit.extra.unknowns] = MOST_USUAL
        return most

    @property
    def linear(self) -> Tall | None:
        return None if self.fit.extra is None else self.fit.extra.laid

    @cached_property
    def owners(self) -> list[str]:
        """Effect that each coordinate belongs to."""
        return [knobs.id for knobs, _ in self.fit.parts for _ in range(knobs.count)]

    @property
    def start(self) -> Point:
        amounts = np.zeros(0) if self.fit.extra is None else self.fit.extra.amounts
        return Point(np.append(flat([at for _, at in self.fit.parts]), amounts), self.fit.surprise)

    def fit_at(self, point: Point) -> Fit:
        """The fit with its coordinates, what is left and slope those of a point."""
        return Fit(self._parts(point.at), point.left, self.whole(point.slope), self._extra(point.at))

    def whole(self, slope: Array) -> Array:
        """The slope (n, m) of the coordinates of the parts with the columns of the linear terms behind."""
        if self.linear is None:
            return slope
        beside = self.linear.columns
        whole = np.empty((slope.shape[1] + beside.shape[1], len(slope)))
        whole[: slope.shape[1]], whole[slope.shape[1] :] = slope.T, beside.T
        return whole.T

    def left(self, at: Array, start: Point) -> Array:
        blocks = frozenset(block_of(name) for name in self.owners)
        changed = self.bench.change(settings_of(list(self._parts(at))), self._bare(start), blocks)
        return linear_extra(changed, self._extra(at))

    def changes(self, places: Sequence[Array], axes: Sequence[int], start: Point) -> Iterator[Array]:
        bare = self._bare(start)
        settings = [settings_of(list(self._parts(at))) for at in places]
        blocks = [frozenset({block_of(self.owners[axis])}) for axis in axes]
        changed = self.bench.changes(list(zip(settings, blocks, strict=True)), bare)
        return (one - bare for one in changed)

    def _bare(self, point: Point) -> Array:
        """What is left without the linear terms."""
        extra = self._extra(point.at)
        return point.left if extra is None else point.left - extra.sum

    def _parts(self, at: Array) -> tuple[Part, ...]:
        parts, first = [], 0
        for knobs, _ in self.fit.parts:
            parts.append((knobs, at[first : first + knobs.count]))
            first += knobs.count
        return tuple(parts)

    def _extra(self, at: Array) -> Extra | None:
        if self.fit.extra is None:
            return None
        amounts = at[len(self.typical) :]
        key = amounts.tobytes()
        if key not in self._extras:
            if len(self._extras) > 1:  # a point and the one before are asked for again and again
                self._extras.clear()
            self._extras[key] = self.fit.extra.with_amounts(amounts)
        return self._extras[key]

    @cached_property
    def _extras(self) -> dict[bytes, Extra]:
        """Linear terms by their amounts."""
        return {} if self.fit.extra is None else {self.fit.extra.amounts.tobytes(): self.fit.extra}


def flat(vectors: Iterable[ArrayLike]) -> Array:
    """Vectors one after another; none make an empty one."""
    return np.concatenate([np.zeros(0), *map(np.asarray, vectors)])


def slopes(bench: Bench, fit: Fit, share: float = LATER_STEP) -> Array:
    """Change of the surprises per coordinate of the parts and per amount of the linear extra terms."""
    problem = _Parts(bench, fit)
    return problem.whole(slope_of(problem, problem.start, share))


def refined(bench: Bench, fit: Fit, iterations: int = ITERATIONS) -> Fit:
    """The fit with all its coordinates at their best together."""
    if not fit.parts and fit.extra is None:
        return fit
    problem = _Parts(bench, fit)

    def settled(before: Point, after: Point) -> bool:
        count = len(problem.typical)
        return bool(np.all(np.abs(after.at - before.at)[:count] / problem.typical < SETTLED))

    rule = Rule(iterations, settled, least_gain=LEAST_STEP)
    return problem.fit_at(with_near_slope(problem, descend(problem, problem.start, rule)))


@dataclass(frozen=True, eq=False)
class Sums:
    """Normal equations per block: squares (b, m, m), sides (b, m), losses (b,)."""

    squares: Array
    sides: Array
    losses: Array


def block_sums(bench: Bench, slope: Array, surprise: Array) -> Sums:
    """Sums over the blocks of the bench."""
    count, size = len(bench.block_runs), slope.shape[1]
    squares, sides = np.zeros((count, size, size)), np.zeros((count, size))
    add_products(bench.blocks, slope, surprise, squares, sides)
    return Sums(squares, sides, np.bincount(bench.blocks, surprise * surprise, count).astype(np.float64))
