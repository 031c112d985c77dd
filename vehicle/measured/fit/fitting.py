"""Fitting effects to a bench, and what the blocks of the data say about the fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from vehicle.measured.fit.knobs import Knobs, block_of, settings_of
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench

Part = tuple[Knobs, Array]
FIRST_STEP, LATER_STEP = 0.3, 0.1
ITERATIONS = 4
RIDGE = 1e-3
SETTLED = 0.02


@dataclass(frozen=True, eq=False)
class Extra:
    """Further terms of the path that are linear: one column of surprises each, and how much of it is in use."""

    columns: Array
    amounts: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """Effects at their best values.

    `surprise` (n,) is what is left, `slope` (n, m) its change per coordinate, in the order of the parts and then of the
    linear extra columns.
    """

    parts: tuple[Part, ...]
    surprise: Array
    slope: Array
    extra: Extra | None = None

    @property
    def loss(self) -> float:
        """Sum of squares."""
        return float(self.surprise @ self.surprise)

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
    return surprise if extra is None else surprise + extra.columns @ extra.amounts


def slopes(bench: Bench, fit: Fit, share: float, only: frozenset[str] | None = None) -> Array:
    """Change of the surprises per coordinate of the parts, by one-sided differences of a share of the typical size."""
    columns = []
    for index, (knobs, at) in enumerate(fit.parts):
        blocks = frozenset({block_of(knobs.id)})
        for axis in range(knobs.count):
            step = share * knobs.typical[axis]
            moved = at.copy()
            moved[axis] += step
            if knobs.inside(moved)[axis] != moved[axis]:
                moved[axis] -= 2.0 * step
            parts = [*fit.parts[:index], (knobs, moved), *fit.parts[index + 1 :]]
            bare = fit.surprise if fit.extra is None else fit.surprise - fit.extra.columns @ fit.extra.amounts
            change = bench.change(settings_of(parts), bare, blocks) - bare
            columns.append(change / (moved[axis] - at[axis]))
    if fit.extra is not None:
        columns += list(fit.extra.columns.T)
    return np.stack(columns, axis=1) if columns else np.zeros((len(fit.surprise), 0))


def refined(bench: Bench, fit: Fit, iterations: int = ITERATIONS) -> Fit:
    """Gauss-Newton with halving over all parts together."""
    if not fit.parts and fit.extra is None:
        return fit
    for number in range(iterations):
        slope = slopes(bench, fit, FIRST_STEP if number == 0 else LATER_STEP)
        change = solve(slope, fit.surprise)
        better = _step(bench, fit, change)
        if better is None:
            return replace(fit, slope=slope)
        settled = _moved(fit, better) < SETTLED
        fit = better
        if settled:
            break
    return replace(fit, slope=slopes(bench, fit, LATER_STEP))


def solve(slope: Array, surprise: Array) -> Array:
    """Change of the coordinates that lowers the loss most."""
    square = slope.T @ slope
    scale = np.diag(square).copy()
    scale[scale <= 0.0] = 1.0
    return np.asarray(np.linalg.solve(square + RIDGE * 1e-3 * np.diag(scale), -slope.T @ surprise))


def _moved(one: Fit, two: Fit) -> float:
    shares = [np.abs(b - a) / k.typical for (k, a), (_, b) in zip(one.parts, two.parts, strict=True)]
    return float(np.max(np.concatenate(shares))) if shares else 0.0


def _step(bench: Bench, fit: Fit, change: Array) -> Fit | None:
    blocks = frozenset(block_of(knobs.id) for knobs, _ in fit.parts)
    for share in (1.0, 0.4, 0.15):
        parts, first = [], 0
        for knobs, at in fit.parts:
            parts.append((knobs, knobs.inside(at + share * change[first : first + knobs.count])))
            first += knobs.count
        extra = fit.extra and Extra(fit.extra.columns, fit.extra.amounts + share * change[first:])
        bare = fit.surprise if fit.extra is None else fit.surprise - fit.extra.columns @ fit.extra.amounts
        surprise = linear_extra(bench.change(settings_of(parts), bare, blocks), extra)
        tried = Fit(tuple(parts), surprise, fit.slope, extra)
        if tried.loss < fit.loss - 1e-6:
            return tried
    return None


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


def add_products(blocks: npt.NDArray[np.int64], slope: Array, left: Array, squares: Array, sides: Array) -> None:
    """Add the products of columns with each other and with what is left to their blocks, stretch by stretch of one."""
    edges = np.flatnonzero(np.diff(blocks, prepend=-1, append=-1))
    for first, end in pairwise(edges):
        rows = slope[first:end]
        squares[blocks[first]] += rows.T @ rows
        sides[blocks[first]] += rows.T @ left[first:end]
