"""Coordinates for data that had no part in finding them: whole runs left out, and halves of a run where they must be.

An effect that shows in one run only would never be told by the others. There, and where there is one run only, the
run's own 20 s windows stand in: those with even numbers are simulated with what the odd ones tell, and the other way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.measured.logs.record import Array
from vehicle.measured.thresholds import TOLD

GUARD = 1e-9  # of every diagonal entry: keeps a solvable system solvable, and changes nothing else
Steps = dict[int, tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Pieces:
    """Normal equations of a fit, piece by piece: squares (p, m, m), sides (p, m), run and half (0 or 1) of each."""

    squares: Array
    sides: Array
    runs: npt.NDArray[np.int64]
    halves: npt.NDArray[np.int64]


def steps_without(pieces: Pieces, to_neutral: Array) -> Steps:
    """Per run, the change of the coordinates (m,) for its even and for its odd windows, found without them.

    One step from the common fit. What nothing else tells goes back to neutral, by `to_neutral` (m,).
    """
    steps: Steps = {}
    whole = np.diag(pieces.squares.sum(axis=0))
    for run in np.unique(pieces.runs):
        others = pieces.runs != run
        told = np.diag(pieces.squares[others].sum(axis=0)) > TOLD * whole
        if told.all():
            step = _step(pieces, others, told, to_neutral)
            steps[int(run)] = (step, step)
            continue
        both = []
        for half in (0, 1):
            kept = others | (pieces.halves != half)
            known = np.diag(pieces.squares[kept].sum(axis=0)) > TOLD * whole
            both.append(_step(pieces, kept, known, to_neutral))
        steps[int(run)] = (both[0], both[1])
    return steps


def _step(pieces: Pieces, kept: npt.NDArray[np.bool_], told: npt.NDArray[np.bool_], to_neutral: Array) -> Array:
    square, side = pieces.squares[kept].sum(axis=0), pieces.sides[kept].sum(axis=0)
    step = np.where(told, 0.0, to_neutral)
    if told.any():
        inner = square[np.ix_(told, told)]
        push = (side + square @ step)[told]
        step[told] = -np.linalg.solve(inner + GUARD * np.diag(np.maximum(np.diag(inner), 1e-12)), push)
    return step
