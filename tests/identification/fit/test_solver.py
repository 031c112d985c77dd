"""The solver on problems whose answers are known: linear, at a bound, with a kink, and curved."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.identification.fit.column_products import IndexedColumns
from vehicle.identification.fit.solver import (
    LATER_STEP,
    STEP_SHARES,
    SolverPoint,
    StopRule,
    add_jacobian,
    compute_jacobian,
    minimise_loss,
    perturb_coordinate,
    solve_linear_step,
    take_descent_step,
    update_outdated_jacobian,
)


class Stand:
    """A problem from a function, with linear columns if wanted."""

    def __init__(
        self, of: Callable[[np.ndarray], np.ndarray], size: int, typical: float = 1.0, low: float = -math.inf,
        high: float = math.inf, linear: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.of = of
        extra = 0 if linear is None else linear.shape[1]
        self.typical = np.full(size, typical)
        self.low, self.high = np.full(size + extra, low), np.full(size + extra, high)
        self.linear = None if linear is None else IndexedColumns(linear)
        self.axes: list[int] = []

    def compute_residuals(self, at: np.ndarray, start: SolverPoint) -> np.ndarray:
        return self.of(at)

    def compute_changes(
        self, places: Sequence[np.ndarray], axes: Sequence[int], start: SolverPoint
    ) -> Iterator[np.ndarray]:
        self.axes += axes
        return (self.of(at) - start.residuals for at in places)

    def start(self, *at: float) -> SolverPoint:
        return SolverPoint(np.array(at), self.of(np.array(at)))


def never(before: SolverPoint, after: SolverPoint) -> bool:
    return False


@given(st.integers(0, 10**6))
def test_a_linear_problem_is_solved_in_one_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, side = rng.standard_normal((30, 3)), rng.standard_normal(30)
    problem = Stand(lambda at: columns @ at - side, 3)
    end = minimise_loss(problem, problem.start(0.0, 0.0, 0.0), StopRule(1, never))
    exact = np.linalg.lstsq(columns, side, rcond=None)[0]
    assert end.coordinates == pytest.approx(exact, abs=1e-4)
    assert not end.has_own_jacobian and end.jacobian == pytest.approx(columns, abs=1e-9)


@given(st.integers(0, 10**6))
def test_linear_columns_are_stepped_along_as_if_they_were_axes_that_bend(seed: int) -> None:
    """The steps are the same to the last bit: products of columns do not depend on what stands beside them."""
    rng = np.random.default_rng(seed)
    bent, straight, side = (rng.standard_normal((130, size)) for size in (2, 3, 1))
    straight[:70, 1] = bent[64:, 0] = 0.0

    def left(at: np.ndarray) -> np.ndarray:
        return np.sin(bent @ at[:2]) + straight @ at[2:] - side[:, 0]

    split, whole = Stand(left, 2, linear=straight), Stand(left, 5)
    start = add_jacobian(split, split.start(*np.zeros(5)))
    same = replace(start, jacobian=np.concatenate([start.jacobian, straight], axis=1))
    one, other = take_descent_step(split, start), take_descent_step(whole, same)
    assert one is not None and other is not None and np.array_equal(one.coordinates, other.coordinates)


def test_a_step_ends_at_the_box() -> None:
    problem = Stand(lambda at: at - 5.0, 1, high=2.0)
    end = minimise_loss(problem, problem.start(0.0), StopRule(3, never))
    assert end.coordinates.tolist() == [2.0] and end.loss == 9.0
    # There is no way on from there: the last point keeps its own slope.
    assert end.has_own_jacobian and end.jacobian.tolist() == [[pytest.approx(1.0)]]


def test_slopes_are_taken_upwards_and_at_the_upper_end_downwards() -> None:
    """Below the kink of max(x, 0) nothing changes, above it one for one."""
    kinked = Stand(lambda at: np.maximum(at, 0.0), 1, low=-1.0, high=1.0)
    assert compute_jacobian(kinked, kinked.start(0.0), LATER_STEP).tolist() == [[pytest.approx(1.0)]]
    capped = Stand(lambda at: np.maximum(at, 0.0), 1, low=-1.0, high=0.0)
    assert compute_jacobian(capped, capped.start(0.0), LATER_STEP).tolist() == [[0.0]]
    assert perturb_coordinate(capped.typical, capped.high, np.array([0.0]), 0, 0.3).tolist() == [-0.3]
    assert perturb_coordinate(kinked.typical, kinked.high, np.array([0.0]), 0, 0.3).tolist() == [0.3]


def test_slopes_of_later_axes_alone_and_none_along_linear_columns() -> None:
    linear = np.array([[7.0], [8.0]])
    problem = Stand(lambda at: np.array([2.0 * at[0] + 3.0 * at[1], 5.0 * at[1]]) + linear @ at[2:], 2, linear=linear)
    start = problem.start(0.0, 0.0, 1.0)
    assert compute_jacobian(problem, start, 0.1) == pytest.approx(np.array([[2.0, 3.0], [0.0, 5.0]]))
    assert compute_jacobian(problem, start, 0.1, first=1) == pytest.approx(np.array([[3.0], [5.0]]))
    assert problem.axes == [0, 1, 1]


def test_a_step_too_far_is_shortened() -> None:
    """Newton on atan from 1.5 lands beyond the mirrored point; four tenths of the step do not."""
    problem = Stand(np.arctan, 1, typical=1e-6)
    start = add_jacobian(problem, problem.start(1.5))
    full = -math.atan(1.5) * (1.0 + 1.5**2)
    after = take_descent_step(problem, start)
    assert abs(1.5 + full) > 1.5 and STEP_SHARES[1] == 0.4
    assert after is not None and after.coordinates == pytest.approx([1.5 + 0.4 * full], abs=1e-4)
    assert after.jacobian is start.jacobian and not after.has_own_jacobian


def test_no_step_is_taken_for_less_than_the_least_gain() -> None:
    problem = Stand(lambda at: at - 1.0, 1)
    start = add_jacobian(problem, problem.start(0.0))
    assert take_descent_step(problem, start, least_gain=2.0) is None
    assert take_descent_step(problem, start, least_gain=0.5) is not None


def test_the_valley_of_rosenbrock_is_descended() -> None:
    problem = Stand(lambda at: np.array([10.0 * (at[1] - at[0] ** 2), 1.0 - at[0]]), 2, typical=1e-4)
    losses = []

    def watch(before: SolverPoint, after: SolverPoint) -> bool:
        losses.append((before.loss, after.loss))
        return False

    end = minimise_loss(problem, problem.start(0.0, 0.0), StopRule(60, watch))
    assert all(after < before for before, after in losses)
    assert end.loss < 1e-6 and end.coordinates == pytest.approx([1.0, 1.0], abs=1e-2)


def test_the_rule_ends_the_descent() -> None:
    problem = Stand(lambda at: at * at, 1)
    once = minimise_loss(problem, problem.start(4.0), StopRule(9, lambda before, after: True))
    assert once.coordinates[0] == pytest.approx(4.0 - 16.0 / 8.3)  # the slope over 0.3 is 2 * 4 + 0.3
    stayed = minimise_loss(problem, problem.start(4.0), StopRule(9, never, is_worthwhile=lambda point: False))
    assert stayed.coordinates.tolist() == [4.0] and stayed.has_own_jacobian
    assert minimise_loss(problem, problem.start(4.0), StopRule(0, never)).jacobian.size == 0


def test_a_point_keeps_its_own_slope_and_gets_one_where_it_has_none() -> None:
    problem = Stand(lambda at: at * at, 1)
    bare = problem.start(3.0)
    assert update_outdated_jacobian(problem, bare).jacobian.tolist() == [[pytest.approx(6.1)]]
    steep = add_jacobian(problem, bare, 1.0)
    assert update_outdated_jacobian(problem, steep) is steep and steep.jacobian.tolist() == [[pytest.approx(7.0)]]


def test_a_slope_serves_near_points_while_it_keeps_its_promise() -> None:
    """A straight line needs one slope however many steps; a bend that breaks the promise gets a new one."""
    straight = Stand(lambda at: at - 3.0, 1, typical=100.0)
    known = replace(straight.start(0.0), jacobian=np.array([[1.3]]), jacobian_coordinates=np.zeros(1))
    end = minimise_loss(straight, known, StopRule(4, never))
    assert straight.axes == [] and end.coordinates == pytest.approx([3.0], abs=0.01) and not end.has_own_jacobian
    assert update_outdated_jacobian(straight, end) is end
    wrong = replace(straight.start(0.0), jacobian=np.array([[9.0]]), jacobian_coordinates=np.zeros(1))
    assert minimise_loss(straight, wrong, StopRule(4, never)).coordinates == pytest.approx([3.0]) and straight.axes
    tiny = replace(straight.start(0.0), jacobian=np.array([[9.0]]), jacobian_coordinates=np.zeros(1))
    small = StopRule(4, lambda before, after: bool(np.all(np.abs(after.coordinates - before.coordinates) < 0.5)))
    assert minimise_loss(straight, tiny, small).coordinates == pytest.approx([3.0]), (
        "a step is small also where a slope is too steep"
    )
    far = Stand(lambda at: at - 3.0, 1, typical=1.0)
    minimise_loss(far, far.start(0.0), StopRule(2, never))
    assert far.axes == [0, 0], "three usual sizes away a slope is taken again"


def test_columns_that_look_alike_share_the_change() -> None:
    column = np.array([1.0, 2.0, 2.0])
    change = solve_linear_step(np.stack([column, column], axis=1), np.array([1.0, 2.0, 2.0]))
    assert change == pytest.approx([-0.5, -0.5], rel=1e-5)
    assert solve_linear_step(np.zeros((3, 1)), np.ones(3)).tolist() == [0.0]
