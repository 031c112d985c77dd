"""Least squares by bounded Gauss-Newton steps with one-sided slopes: the one solver of all fits.

Effects such as a dead band or a limit have no trace on one side of where they stand, so slopes are taken over a good
share of a usual size and on one side only, the other one where the box ends. A slope serves all points near where it
was taken, axis by axis, while steps gain what it promised. A step that does not lower the loss is shortened, twice at
most: further the slope does not hold, and the next one will not either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from vehicle.measured.fit.products import Tall, crossed, side_by_side, squared
from vehicle.measured.logs.record import Array

FIRST_STEP, LATER_STEP = 0.3, 0.1  # of a typical size: chosen, wide enough to cross a dead band, then finer
SHORTENED = (1.0, 0.4, 0.15)  # shares of a step that are tried: chosen, nearly a decade in three simulations
NEAR = 0.03  # of a typical size: chosen, little beside what a slope is taken over, so that it holds as well there
STEPS_A_SLOPE = 3  # chosen: bounds the steps with one slope, which cost little beside it
KEPT_PROMISE = 0.7  # chosen, of what a slope promised: a step that gains less says that it does not hold
Sizes = Array | Sequence[float]
RIDGE = 1e-6  # of every diagonal entry: chosen, keeps columns that look alike from running apart


@dataclass(frozen=True, eq=False)
class Point:
    """Coordinates (m + k,), what is left there (n,), and a slope taken at the coordinates `taken`; None without one.

    The slope (n, m) is that of the coordinates that bend what is left; along the others it is the same everywhere.
    """

    at: Array
    left: Array
    slope: Array = field(default_factory=lambda: np.zeros((0, 0)))
    taken: Array | None = None

    @property
    def own(self) -> bool:
        """Whether the slope was taken here on every axis."""
        return self.taken is not None and np.array_equal(self.taken, self.at)

    @property
    def loss(self) -> float:
        """Sum of squares."""
        return squared(self.left)


class Problem(Protocol):
    """What is left at coordinates (m + k,): m that bend it, then k that move it along the columns (n, k) of `linear`.

    `typical` (m,) are usual sizes, `low` and `high` (m + k,) the box.
    """

    @property
    def typical(self) -> Array:
        """Usual sizes of the first m coordinates."""

    @property
    def low(self) -> Array:
        """Lower ends of the box."""

    @property
    def high(self) -> Array:
        """Upper ends of the box."""

    @property
    def linear(self) -> Tall | None:
        """Columns of the last k coordinates; None without such."""

    def left(self, at: Array, start: Point) -> Array:
        """What is left at coordinates (n,), when it is known at a start."""

    def changes(self, places: Sequence[Array], axes: Sequence[int], start: Point) -> Iterator[Array]:
        """What is left at places that differ from a start on one axis each, minus what is left at the start (n,)."""


@dataclass(frozen=True)
class Rule:
    """When to stop: after the steps of `iterations` slopes, or when a step takes at most `least_gain` off the loss.

    `settled` sees the points before and after a step and says whether that was the last; `worthwhile` sees a point with
    its slope before a step is tried. The first slope is taken over `first_step` of the typical sizes; `slopes` is how
    many of them a start has behind it that others were led to, and is stepped from on.
    """

    iterations: int
    settled: Callable[[Point, Point], bool]
    least_gain: float = 0.0
    first_step: float = FIRST_STEP
    worthwhile: Callable[[Point], bool] = lambda _: True
    slopes: int = 0


def slope_of(problem: Problem, start: Point, share: float, first: int = 0) -> Array:
    """Slope (n, m - first) of what is left on the axes from `first` on that bend it, by one-sided differences."""
    return side_by_side(_columns(problem, start, range(first, len(problem.typical)), share), len(start.left))


def _columns(problem: Problem, start: Point, axes: Sequence[int], share: float) -> list[Array]:
    """Columns (n,) of the slope on some axes."""
    moved = [aside(problem.typical, problem.high, start.at, axis, share) for axis in axes]
    changes = problem.changes(moved, axes, start)
    return [
        change / (at[axis] - start.at[axis]) for change, at, axis in zip(changes, moved, axes, strict=True)
    ]


def aside(typical: Sizes, high: Sizes, at: Array, axis: int, share: float) -> Array:
    """Coordinates with one of them a share of its typical size larger, or smaller where the box ends before."""
    moved = at.copy()
    moved[axis] += share * typical[axis]
    if moved[axis] > high[axis]:
        moved[axis] = at[axis] - share * typical[axis]
    return moved


def solve(slope: Array, left: Array) -> Array:
    """Change of the coordinates (m,) that lowers the loss most, for a slope (n, m) and what is left (n,)."""
    return _solved(crossed(slope, slope), crossed(slope, left))


def _solved(square: Array, side: Array) -> Array:
    scale = np.diag(square).copy()
    scale[scale <= 0.0] = 1.0
    return np.asarray(np.linalg.solve(square + RIDGE * np.diag(scale), -side))


def _products(start: Point, linear: Tall | None) -> tuple[Array, Array]:
    """Products of all columns with each other (m + k, m + k), and with what is left (m + k,)."""
    square, side = crossed(start.slope, start.slope), crossed(start.slope, start.left)
    if linear is None:
        return square, side
    cross = linear.crossed_with(start.slope)
    return np.block([[square, cross.T], [cross, linear.square]]), np.append(side, linear.crossed(start.left))


def downhill(problem: Problem, start: Point, least_gain: float = 0.0) -> Point | None:
    """One step inside the box, shortened until the loss is lower; None when it never is."""
    return _step(problem, start, least_gain)[0]


def _step(problem: Problem, start: Point, least_gain: float) -> tuple[Point | None, bool]:
    """The step of downhill, and whether it gained what the slope promised of it."""
    square, side = _products(start, problem.linear)
    change, before = _solved(square, side), start.loss
    for share in SHORTENED:
        at = np.clip(start.at + share * change, problem.low, problem.high)
        after = Point(at, problem.left(at, start), start.slope, start.taken)
        loss, way = after.loss, at - start.at
        if loss < before - least_gain:
            return after, before - loss >= -KEPT_PROMISE * float(2.0 * side @ way + way @ square @ way)
    return None, False


def descend(problem: Problem, start: Point, rule: Rule) -> Point:
    """The point that steps lead to until the rule ends them; its slope may be one taken before, near it.

    Points that are near where a slope was taken are stepped from with that one, also the start.
    """
    point, holds, slopes = start, True, rule.slopes
    for _ in range(STEPS_A_SLOPE * rule.iterations):
        if not holds or not is_near(problem, point):
            if slopes == rule.iterations:
                break
            known = point if holds else replace(point, taken=None)
            point = with_near_slope(problem, known, rule.first_step if slopes == 0 else LATER_STEP)
            slopes += 1
        if not rule.worthwhile(point):
            break
        after, holds = _step(problem, point, rule.least_gain)
        if after is None:
            if point.own:
                return point
            continue  # with a slope of its own
        before, point = point, after
        if holds and rule.settled(before, after):  # a step of a slope that does not hold may be small far from the best
            break
    return point if holds else replace(point, taken=None)


def is_near(problem: Problem, point: Point) -> bool:
    """Whether the slope of a point was taken near it on every axis."""
    return point.taken is not None and not _far(problem, point).size


def _far(problem: Problem, point: Point) -> npt.NDArray[np.int64]:
    """Axes on which the slope was taken too far away."""
    assert point.taken is not None
    count = len(problem.typical)
    return np.flatnonzero(np.abs(point.at - point.taken)[:count] > NEAR * problem.typical)


def with_slope(problem: Problem, point: Point, share: float = LATER_STEP) -> Point:
    """The point with its own slope."""
    return Point(point.at, point.left, slope_of(problem, point, share), point.at)


def with_near_slope(problem: Problem, point: Point, share: float = LATER_STEP) -> Point:
    """The point as it is where its slope was taken near enough, else with its own on the axes where it was not."""
    if point.taken is None:
        return with_slope(problem, point, share)
    far = _far(problem, point)
    if not far.size:
        return point
    slope, taken = point.slope.copy(order="F"), point.at.copy()
    near = np.setdiff1d(np.arange(len(problem.typical)), far)
    taken[near] = point.taken[near]
    for axis, column in zip(far, _columns(problem, point, far.tolist(), share), strict=True):
        slope[:, axis] = column
    return Point(point.at, point.left, slope, taken)
