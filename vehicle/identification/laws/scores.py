"""How much a law explains beyond a fit: loss, strength against the scatter of blocks, and loss of held-out runs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from vehicle.identification.fit.residual_fit import EffectFit, sum_normal_equations_by_block
from vehicle.identification.laws.bases import LawBasis
from vehicle.identification.laws.columns import LawTarget
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.residual_model import ResidualModel

Indices = npt.NDArray[np.int64]
LEAST_EIGENVALUE = 1e-10  # of scaled squares: smaller ones are rounding


@dataclass(frozen=True, eq=False)
class LawScore:
    """One law of one parameter, fitted beside everything in the fit by one step from it.

    `gain` is the loss that it removes beyond a constant value, which removes `constant_gain`; `strength` is the gain in
    units of the scatter of blocks, `held_out` the loss that the law removes per run with amounts from the other runs.
    `step` changes the constant value and `amounts` (c,) weigh the columns, both in the unit of the effect, with
    standard deviations `sigmas` (c,).
    """

    target: LawTarget
    basis: LawBasis
    gain: float
    constant_gain: float
    strength: float
    held_out: Array
    step: float
    amounts: Array
    sigmas: Array

    @property
    def total_gain(self) -> float:
        """The loss that the law removes together with its constant value."""
        return self.gain + self.constant_gain

    @property
    def freedoms(self) -> int:
        """Free amounts of the law."""
        return len(self.amounts)


class LawScorer:
    """Normal equations per block of a fit, a constant change of a parameter, and the columns of its laws."""

    def __init__(
        self, residual_model: ResidualModel, fit: EffectFit, target: LawTarget, constant: Array, laws: list[Array]
    ) -> None:
        """Sum the normal equations of all columns once; `constant` (n, 1) stands for a parameter outside the fit."""
        self.target, self.fit_count = target, fit.jacobian.shape[1]
        self.own = fit.find_columns(target.effect_id).start if target.is_in_fit else self.fit_count
        columns = np.column_stack([fit.jacobian, *(() if target.is_in_fit else (constant,)), *laws])
        self.scale = np.sqrt(np.maximum(np.sum(columns * columns, axis=0), 1e-12))
        sums = sum_normal_equations_by_block(residual_model, np.asfortranarray(columns / self.scale), fit.residuals)
        self.squares, self.sides = sums.squares, sums.sides
        self.block_runs, self.runs = residual_model.block_runs, len(residual_model.dataset.names)
        self.base = np.arange(columns.shape[1] - sum(law.shape[1] for law in laws))
        ends = np.cumsum([len(self.base), *(law.shape[1] for law in laws)])
        self.law_places = [np.arange(low, high) for low, high in pairwise(ends)]

    def score_law(self, number: int, basis: LawBasis) -> LawScore:
        """Return the score of one of the laws."""
        return self._score(self.law_places[number], basis)

    def _score(self, law: Indices, basis: LawBasis) -> LawScore:
        both = np.concatenate([self.base, law])
        square, side = self.squares.sum(axis=0), self.sides.sum(axis=0)
        step, base_step = _solve(square, side, both), _solve(square, side, self.base)
        gain = float(-step @ side[both] + base_step @ side[self.base])
        constant_gain = 0.0 if self.target.is_in_fit else float(-base_step @ side[self.base])
        strength, covariance = self._compute_strength(law, both, step, gain)
        amounts = step[len(self.base) :] / self.scale[law]
        own = self.target.unit_per_step * step[self.own] / self.scale[self.own]
        return LawScore(
            self.target,
            basis,
            gain,
            constant_gain,
            strength,
            self._compute_held_out(both) - self._compute_held_out(self.base),
            float(own),
            amounts,
            np.sqrt(np.maximum(np.diag(covariance), 0.0)) / self.scale[law],
        )

    def _compute_strength(self, law: Indices, both: Indices, step: Array, gain: float) -> tuple[float, Array]:
        """Return the gain over the scatter between blocks, at least that of noise alone, and the covariance."""
        square = self.squares.sum(axis=0)
        share = _solve_many(square[np.ix_(self.base, self.base)], square[np.ix_(self.base, law)])
        own = square[np.ix_(law, law)] - square[np.ix_(law, self.base)] @ share
        remaining = self.sides + np.einsum("bij,j->bi", self.squares[:, :, both], step)
        sides = remaining[:, law] - remaining[:, self.base] @ share
        inverse = np.linalg.pinv(own, rcond=LEAST_EIGENVALUE, hermitian=True)
        widening = max(1.0, float(np.trace(inverse @ sides.T @ sides)) / len(law))
        return gain / widening, inverse * widening

    def _compute_held_out(self, columns: Indices) -> Array:
        """Return the loss that columns remove in every run with amounts from the other runs (runs,)."""
        squares, sides = self._sum_by_run()
        total_square, total_side, out = squares.sum(axis=0), sides.sum(axis=0), np.zeros(self.runs)
        for run in range(self.runs):
            step = _solve(total_square - squares[run], total_side - sides[run], columns)
            own = squares[run][np.ix_(columns, columns)]
            out[run] = -(2.0 * step @ sides[run][columns] + step @ own @ step)
        return out

    def _sum_by_run(self) -> tuple[Array, Array]:
        squares, sides = np.zeros((self.runs, *self.squares.shape[1:])), np.zeros((self.runs, self.sides.shape[1]))
        np.add.at(squares, self.block_runs, self.squares)
        np.add.at(sides, self.block_runs, self.sides)
        return squares, sides

    def estimate_values_by_run(self) -> tuple[Array, Array]:
        """Return a value of the parameter for every run, and the information on each (runs,), beside the fit."""
        squares, sides = self._sum_by_run()
        square, side = squares.sum(axis=0), sides.sum(axis=0)
        own = self.own
        fit = self.base[self.base != own]
        share = _solve_many(square[np.ix_(fit, fit)], square[fit, own][:, None])[:, 0]
        fit_step = _solve(square, side, fit)
        information, values = np.zeros(self.runs), np.zeros(self.runs)
        for run in range(self.runs):
            remaining = sides[run] + squares[run][:, fit] @ fit_step
            direction = np.zeros(len(self.base))
            direction[fit], direction[own] = -share, 1.0
            information[run] = float(direction @ squares[run][np.ix_(self.base, self.base)] @ direction)
            values[run] = -float(direction @ remaining[self.base]) / max(information[run], 1e-9)
        unit = self.target.unit_per_step / self.scale[own]
        return values * unit, information / unit**2


def _solve(square: Array, side: Array, columns: Indices) -> Array:
    """Return the step (c,) that minimises a quadratic loss in some of its columns."""
    return -_solve_many(square[np.ix_(columns, columns)], side[columns][:, None])[:, 0]


def _solve_many(square: Array, sides: Array) -> Array:
    solution: Array = np.linalg.pinv(square, rcond=LEAST_EIGENVALUE, hermitian=True) @ sides
    return solution
