"""Coordinates for data held out against fits that leave the rows out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.identification.fit.residual_fit import NormalEquations, compute_held_out_steps


def pieces_of(columns: np.ndarray, left: np.ndarray, runs: np.ndarray, halves: np.ndarray) -> NormalEquations:
    """Every row a piece of its own."""
    return NormalEquations(np.einsum("ri,rj->rij", columns, columns), columns * left[:, None], runs, halves)


@given(st.integers(0, 10**6))
def test_a_run_held_out_is_a_fit_without_its_rows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, left = rng.standard_normal((60, 3)), rng.standard_normal(60)
    runs, halves = np.repeat(np.arange(3), 20), np.tile([0, 1], 30)
    steps = compute_held_out_steps(pieces_of(columns, left, runs, halves), np.zeros(3))
    for run in range(3):
        kept = runs != run
        exact = np.linalg.lstsq(columns[kept], -left[kept], rcond=None)[0]
        assert np.allclose(steps[run][0], exact, atol=1e-6) and np.array_equal(*steps[run])


@given(st.integers(0, 10**6))
def test_what_one_run_alone_tells_is_told_by_its_other_half(seed: int) -> None:
    rng = np.random.default_rng(seed)
    runs, halves = np.repeat([0, 1], 20), np.tile([0, 1], 20)
    columns, left = rng.standard_normal((40, 2)), rng.standard_normal(40)
    columns[runs == 0, 1] = 0.0
    steps = compute_held_out_steps(pieces_of(columns, left, runs, halves), np.array([9.0, 9.0]))
    for half in (0, 1):
        kept = (runs != 1) | (halves != half)
        exact = np.linalg.lstsq(columns[kept], -left[kept], rcond=None)[0]
        assert np.allclose(steps[1][half], exact, atol=1e-6)


def test_what_nothing_else_tells_goes_back_to_neutral() -> None:
    columns, left = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]), np.array([1.0, 1.0, 3.0])
    pieces = pieces_of(columns, left, np.array([0, 1, 1]), np.array([0, 0, 1]))
    steps = compute_held_out_steps(pieces, np.array([5.0, -7.0]))
    assert steps[0][0] == pytest.approx([-3.0, -1.0])
    assert steps[1][0] == pytest.approx([-2.0, -7.0]) and steps[1][1] == pytest.approx([-1.0, -1.0])
