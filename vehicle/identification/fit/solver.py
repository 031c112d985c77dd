"""Bounded Gauss-Newton least squares with one-sided differences: the solver of all fits.

A dead band or a limit has no gradient on one side of its value, so differences are taken over a good share of a typical
size and on one side only, the other one at the end of the box. A jacobian serves all points near where it was computed,
axis by axis, while steps gain what it predicted. A step that does not lower the loss is shortened, at most twice:
beyond that the jacobian does not hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from vehicle.identification.fit.column_products import IndexedColumns, multiply_columns, stack_columns, sum_squares
from vehicle.identification.logs.schema import Array

FIRST_STEP, LATER_STEP = 0.3, 0.1  # of a typical size: chosen, wide enough to cross a dead band, then finer
STEP_SHARES = (1.0, 0.4, 0.15)  # shares of a step to try: chosen, nearly a decade in three simulations
NEAR_STEP = 0.03  # of a typical size: chosen, small against the difference step, so that the jacobian still holds
STEPS_PER_JACOBIAN = 3  # chosen: limits the steps with one jacobian, which are cheap against computing it
LEAST_PREDICTED_SHARE = 0.7  # chosen, of the predicted gain: if a step gains less, the jacobian does not hold
Sizes = Array | Sequence[float]
RIDGE_SHARE = 1e-6  # of every diagonal entry: chosen, keeps similar columns from diverging


@dataclass(frozen=True, eq=False)
class SolverPoint:
    """Coordinates (m + k,), residuals there (n,), and a jacobian with the coordinates where it was computed; None
    without one.

    The jacobian (n, m) is of the nonlinear coordinates; along the others it is constant.
    """

    coordinates: Array
    residuals: Array
    jacobian: Array = field(default_factory=lambda: np.zeros((0, 0)))
    jacobian_coordinates: Array | None = None

    @property
    def has_own_jacobian(self) -> bool:
        """Whether the jacobian was computed here on every axis."""
        return self.jacobian_coordinates is not None and np.array_equal(self.jacobian_coordinates, self.coordinates)

    @property
    def loss(self) -> float:
        """Sum of squares."""
        return sum_squares(self.residuals)


class LeastSquaresProblem(Protocol):
    """Residuals at coordinates (m + k,): m nonlinear ones, then k amounts of the columns (n, k) of `linear`.

    `typical` (m,) are typical sizes, `low` and `high` (m + k,) the box.
    """

    @property
    def typical(self) -> Array:
        """Typical sizes of the first m coordinates."""

    @property
    def low(self) -> Array:
        """Lower ends of the box."""

    @property
    def high(self) -> Array:
        """Upper ends of the box."""

    @property
    def linear(self) -> IndexedColumns | None:
        """Columns of the last k coordinates; None without any."""

    def compute_residuals(self, coordinates: Array, start: SolverPoint) -> Array:
        """Return the residuals (n,) at coordinates, given a known start."""

    def compute_changes(self, places: Sequence[Array], axes: Sequence[int], start: SolverPoint) -> Iterator[Array]:
        """Return the residuals at points that differ from a start on one axis each, minus those at the start (n,)."""


@dataclass(frozen=True)
class StopRule:
    """When to stop: after the steps of `iterations` jacobians, or when a step removes at most `least_gain` of the loss.

    `settled` sees the points before and after a step and says whether that was the last; `worthwhile` sees a point with
    its jacobian before a step is tried. The first jacobian uses `first_step` of the typical sizes; `jacobian_count` is
    how many of them a resumed start has already used.
    """

    iterations: int
    is_settled: Callable[[SolverPoint, SolverPoint], bool]
    least_gain: float = 0.0
    first_step: float = FIRST_STEP
    is_worthwhile: Callable[[SolverPoint], bool] = lambda _: True
    jacobian_count: int = 0


def compute_jacobian(problem: LeastSquaresProblem, start: SolverPoint, share: float, first: int = 0) -> Array:
    """Return the jacobian (n, m - first) on the nonlinear axes from `first`, by one-sided differences."""
    return stack_columns(
        _compute_columns(problem, start, range(first, len(problem.typical)), share), len(start.residuals)
    )


def _compute_columns(
    problem: LeastSquaresProblem, start: SolverPoint, axes: Sequence[int], share: float
) -> list[Array]:
    """Return the jacobian columns (n,) of some axes."""
    shifted = [perturb_coordinate(problem.typical, problem.high, start.coordinates, axis, share) for axis in axes]
    changes = problem.compute_changes(shifted, axes, start)
    return [
        change / (coordinates[axis] - start.coordinates[axis])
        for change, coordinates, axis in zip(changes, shifted, axes, strict=True)
    ]


def perturb_coordinate(typical: Sizes, high: Sizes, coordinates: Array, axis: int, share: float) -> Array:
    """Return coordinates with one increased by a share of its typical size, or decreased at the end of the box."""
    shifted = coordinates.copy()
    shifted[axis] += share * typical[axis]
    if shifted[axis] > high[axis]:
        shifted[axis] = coordinates[axis] - share * typical[axis]
    return shifted


def solve_linear_step(jacobian: Array, residuals: Array) -> Array:
    """Return the change of the coordinates (m,) that lowers the loss most, for a jacobian (n, m) and residuals (n,)."""
    return _solve_normal_equations(multiply_columns(jacobian, jacobian), multiply_columns(jacobian, residuals))


def _solve_normal_equations(square: Array, side: Array) -> Array:
    scale = np.diag(square).copy()
    scale[scale <= 0.0] = 1.0
    return np.asarray(np.linalg.solve(square + RIDGE_SHARE * np.diag(scale), -side))


def _build_normal_equations(start: SolverPoint, linear: IndexedColumns | None) -> tuple[Array, Array]:
    """Return products of all columns with each other (m + k, m + k), and with the residuals (m + k,)."""
    square, side = multiply_columns(start.jacobian, start.jacobian), multiply_columns(start.jacobian, start.residuals)
    if linear is None:
        return square, side
    cross = linear.multiply_columns(start.jacobian)
    return np.block([[square, cross.T], [cross, linear.column_products]]), np.append(
        side, linear.multiply_vector(start.residuals)
    )


def take_descent_step(problem: LeastSquaresProblem, start: SolverPoint, least_gain: float = 0.0) -> SolverPoint | None:
    """Take one step inside the box, shortened until the loss is lower; None when it never is."""
    return _try_step(problem, start, least_gain)[0]


def _try_step(problem: LeastSquaresProblem, start: SolverPoint, least_gain: float) -> tuple[SolverPoint | None, bool]:
    """As take_descent_step, and whether it gained what the jacobian predicted."""
    square, side = _build_normal_equations(start, problem.linear)
    change, before = _solve_normal_equations(square, side), start.loss
    for share in STEP_SHARES:
        coordinates = np.clip(start.coordinates + share * change, problem.low, problem.high)
        after = SolverPoint(
            coordinates, problem.compute_residuals(coordinates, start), start.jacobian, start.jacobian_coordinates
        )
        loss, step = after.loss, coordinates - start.coordinates
        if loss < before - least_gain:
            return after, before - loss >= -LEAST_PREDICTED_SHARE * float(2.0 * side @ step + step @ square @ step)
    return None, False


def minimise_loss(problem: LeastSquaresProblem, start: SolverPoint, rule: StopRule) -> SolverPoint:
    """Take steps until the rule ends them; the jacobian of the result may be an earlier one, computed nearby.

    Points near an existing jacobian use it, also the start.
    """
    point, jacobian_holds, jacobian_count = start, True, rule.jacobian_count
    for _ in range(STEPS_PER_JACOBIAN * rule.iterations):
        if not jacobian_holds or not is_jacobian_valid(problem, point):
            if jacobian_count == rule.iterations:
                break
            start_point = point if jacobian_holds else replace(point, jacobian_coordinates=None)
            point = update_outdated_jacobian(
                problem, start_point, rule.first_step if jacobian_count == 0 else LATER_STEP
            )
            jacobian_count += 1
        if not rule.is_worthwhile(point):
            break
        after, jacobian_holds = _try_step(problem, point, rule.least_gain)
        if after is None:
            if point.has_own_jacobian:
                return point
            continue  # with its own jacobian
        previous, point = point, after
        if jacobian_holds and rule.is_settled(
            previous, after
        ):  # with an invalid jacobian a step may be small far from the best
            break
    return point if jacobian_holds else replace(point, jacobian_coordinates=None)


def is_jacobian_valid(problem: LeastSquaresProblem, point: SolverPoint) -> bool:
    """Whether the jacobian of a point was computed near it on every axis."""
    return point.jacobian_coordinates is not None and not _find_outdated_axes(problem, point).size


def _find_outdated_axes(problem: LeastSquaresProblem, point: SolverPoint) -> npt.NDArray[np.int64]:
    """Return the axes on which the jacobian was computed too far away."""
    assert point.jacobian_coordinates is not None
    count = len(problem.typical)
    return np.flatnonzero(np.abs(point.coordinates - point.jacobian_coordinates)[:count] > NEAR_STEP * problem.typical)


def add_jacobian(problem: LeastSquaresProblem, point: SolverPoint, share: float = LATER_STEP) -> SolverPoint:
    """Return the point with its own jacobian."""
    return SolverPoint(point.coordinates, point.residuals, compute_jacobian(problem, point, share), point.coordinates)


def update_outdated_jacobian(
    problem: LeastSquaresProblem, point: SolverPoint, share: float = LATER_STEP
) -> SolverPoint:
    """Return the point unchanged where its jacobian is near enough, else with recomputed columns on the axes where it
    is not."""
    if point.jacobian_coordinates is None:
        return add_jacobian(problem, point, share)
    far_axes = _find_outdated_axes(problem, point)
    if not far_axes.size:
        return point
    jacobian, jacobian_coordinates = point.jacobian.copy(order="F"), point.coordinates.copy()
    near_axes = np.setdiff1d(np.arange(len(problem.typical)), far_axes)
    jacobian_coordinates[near_axes] = point.jacobian_coordinates[near_axes]
    for axis, column in zip(far_axes, _compute_columns(problem, point, far_axes.tolist(), share), strict=True):
        jacobian[:, axis] = column
    return SolverPoint(point.coordinates, point.residuals, jacobian, jacobian_coordinates)
