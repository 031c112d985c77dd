"""Heights where none were measured: continued so that the surface bends as little as possible, and only so far."""

from __future__ import annotations

import numpy as np

from fields.terrain.elevation_grid import BoolArray, FloatArray

STENCILS = (
    (((0, -1), 1.0), ((0, 0), -2.0), ((0, 1), 1.0)),
    (((-1, 0), 1.0), ((0, 0), -2.0), ((1, 0), 1.0)),
    (((0, 0), 2.0**0.5), ((0, 1), -(2.0**0.5)), ((1, 0), -(2.0**0.5)), ((1, 1), 2.0**0.5)),
)
"""Second differences whose squares sum up to the bending of a thin plate: along x, along y, and mixed (weight 2)."""
TIE_WEIGHT = 1e-10
"""Pull towards the nearest measured height; it only decides where no stencil does."""


def fill_gaps(heights: FloatArray, near: BoolArray) -> FloatArray:
    """Heights (rows, columns) without NaN.

    Nodes of `near` minimise the sum of squared second differences, so a plane is continued as the same plane; all
    others take the nearest height. Expects at least one finite height.
    """
    from scipy.ndimage import distance_transform_edt

    unknown = ~np.isfinite(heights)
    if not unknown.any():
        return heights
    rows, columns = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    filled = heights[rows, columns]
    wanted = unknown & near
    if wanted.any():
        filled[wanted] += _solve_corrections(filled, unknown, wanted)
    still = unknown & ~near
    rows, columns = distance_transform_edt(still, return_distances=False, return_indices=True)
    return np.asarray(filled[rows, columns])


def _solve_corrections(filled: FloatArray, unknown: BoolArray, wanted: BoolArray) -> FloatArray:
    """What to add to the nearest heights at the `wanted` nodes, in their order."""
    from scipy.sparse import coo_matrix, identity
    from scipy.sparse.linalg import spsolve

    numbers = np.full(filled.shape, -1)
    numbers[wanted] = np.arange(int(wanted.sum()))
    numbers, is_usable, filled = np.pad(numbers, 1), np.pad(~unknown | wanted, 1), np.pad(filled, 1)
    equations, unknowns, weights, residuals, first = [], [], [], [], 0
    for stencil in STENCILS:
        parts = [(_shift(numbers, place), _shift(is_usable, place), _shift(filled, place), w) for place, w in stencil]
        used = np.logical_and.reduce([usable for _, usable, _, _ in parts])
        used &= np.logical_or.reduce([number >= 0 for number, _, _, _ in parts])
        count = int(used.sum())
        residuals.append(sum(weight * height[used] for _, _, height, weight in parts))
        for number, _, _, weight in parts:
            is_unknown = number[used] >= 0
            equations.append(first + np.flatnonzero(is_unknown))
            unknowns.append(number[used][is_unknown])
            weights.append(np.full(int(is_unknown.sum()), weight))
        first += count
    size = int(wanted.sum())
    matrix = coo_matrix(
        (np.concatenate(weights), (np.concatenate(equations), np.concatenate(unknowns))), (first, size)
    ).tocsc()
    normal = (matrix.T @ matrix + TIE_WEIGHT * identity(size)).tocsc()
    return np.asarray(spsolve(normal, -(matrix.T @ np.concatenate(residuals))))


def _shift(values: FloatArray | BoolArray, place: tuple[int, int]) -> FloatArray | BoolArray:
    """The inner part of an array, moved by rows and columns of a stencil."""
    rows, columns = values.shape
    return values[1 + place[0] : rows - 1 + place[0], 1 + place[1] : columns - 1 + place[1]]
