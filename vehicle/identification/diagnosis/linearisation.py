"""The fit of a diagnosis as linear least squares about where it stands, which says what a hypothesis would gain.

It holds what every amount changes in the prediction, weighted as the likelihood weighs the windows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vehicle.identification.diagnosis.grammar import Hypothesis
from vehicle.identification.logs.schema import Array, Mask

# Effects of the steering system act by thresholds: their cost has many minima, and both signs are tried.
RUGGED_CHAINS = frozenset({"steering"})


@dataclass(frozen=True)
class Gain:
    """What a hypothesis would gain on top of a fit (nats, less its penalty), by linear prediction, and its amounts."""

    nats: float
    hypothesis: Hypothesis
    amounts: Array


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Per channel the whitened change of the prediction per width of each amount (w, n, k), the whitened residuals
    (w, n), and the roots of the weights of the windows (w,)."""

    changes: Mapping[str, Array]
    residuals: Mapping[str, Array]
    roots: Mapping[str, Array]

    @cached_property
    def matrix(self) -> Array:
        """Weighted changes of all channels (rows, k)."""
        return self.stack(self.changes)

    @cached_property
    def target(self) -> Array:
        """Weighted residuals of all channels (rows,)."""
        return self.stack({channel: values[:, :, None] for channel, values in self.residuals.items()})[:, 0]

    @cached_property
    def curvature(self) -> Array:
        """Curvature (k, k) of the cost per width, with the prior."""
        return np.asarray(np.eye(self.matrix.shape[1]) + self.matrix.T @ self.matrix)

    @cached_property
    def inverse(self) -> Array:
        """The inverse of the curvature."""
        return np.asarray(np.linalg.inv(self.curvature), dtype=np.float64)

    def stack(self, changes: Mapping[str, Array]) -> Array:
        """Whitened changes per channel (w, n, j) as one weighted matrix (rows, j)."""
        parts = [(changes[c] * root[:, None, None]).reshape(-1, changes[c].shape[2]) for c, root in self.roots.items()]
        return np.concatenate(parts)

    def sum_windows(self, inside: Mask) -> tuple[Array, Array]:
        """What some windows (w,) add to the curvature (k, k), and to the slope of the likelihood per width (k,)."""
        size = self.matrix.shape[1]
        information, slope = np.zeros((size, size)), np.zeros(size)
        for channel, root in self.roots.items():
            weights = root[inside][:, None]
            columns = (self.changes[channel][inside] * weights[:, :, None]).reshape(-1, size)
            information += columns.T @ columns
            slope += columns.T @ (self.residuals[channel][inside] * weights).ravel()
        return information, slope

    def step_without(self, inside: Mask) -> tuple[Array, Array]:
        """The step in widths (k,) to the amounts that the other windows give, and the curvature (k, k) these leave."""
        information, slope = self.sum_windows(inside)
        curvature = self.curvature - information
        return np.asarray(-np.linalg.solve(curvature, slope), dtype=np.float64), curvature

    def reduce(self, columns: Array) -> Array:
        """Weighted columns (rows, j) without what the amounts of the fit would take up of them."""
        return np.asarray(columns - self.matrix @ (self.inverse @ (self.matrix.T @ columns)))

    def predict_gain(self, hypothesis: Hypothesis, columns: Array, sign: float) -> Gain | None:
        """The gain of a hypothesis with weighted columns (rows, k) beside the fit; None on the wrong side.

        `sign` is the direction in which the columns were computed.
        """
        own = self.reduce(columns)
        curvature = columns.T @ own + np.eye(hypothesis.size)
        slope = own.T @ self.target
        amounts = np.linalg.solve(curvature, slope)
        if hypothesis.size == 1:
            coordinate = hypothesis.coordinates[0]
            if (amounts[0] < 0.0 and coordinate.low >= 0.0) or (amounts[0] > 0.0 and coordinate.high <= 0.0):
                return None
            if len(list_signs(hypothesis)) > 1 and amounts[0] * sign < 0.0:
                return None
        nats = 0.5 * float(slope @ amounts) - 0.5 * float(np.linalg.slogdet(curvature)[1]) - hypothesis.penalty
        widths = np.array([one.width for one in hypothesis.coordinates])
        return Gain(nats, hypothesis, amounts * widths)


def list_signs(hypothesis: Hypothesis) -> tuple[float, ...]:
    """Directions to try: of effects of the steering system, and of limits, both sides act differently."""
    low, high = hypothesis.coordinates[0].low, hypothesis.coordinates[0].high
    if low >= 0.0:
        return (1.0,)
    if high <= 0.0:
        return (-1.0,)
    return (1.0, -1.0) if hypothesis.chains & RUGGED_CHAINS else (1.0,)
