"""Products of tall columns in the order of their rows, on one core.

Libraries of linear algebra share such products out to every core, which then wait for each other: on a busy machine
that was two thirds of a diagnosis, and the last digits depended on the number of cores.
"""

from __future__ import annotations

import numpy as np

from vehicle.jit import compiled
from vehicle.measured.logs.record import Array


def squared(left: Array) -> float:
    """Sum of squares of a vector (n,)."""
    return float(np.einsum("i,i", left, left))


def crossed(one: Array, two: Array) -> Array:
    """Products (m, k) of all columns (n, m) with all columns (n, k), or (m,) with a vector (n,)."""
    wide, tall = np.ascontiguousarray(one), np.ascontiguousarray(two.reshape(len(two), -1))
    if tall.shape[1] < wide.shape[1]:  # the inner loop is the longer one: several columns are added up at once
        turned = np.zeros((tall.shape[1], wide.shape[1]))
        _crossed(tall, wide, turned)
        return np.ascontiguousarray(turned.T).reshape(one.shape[1], *two.shape[1:])
    out = np.zeros((wide.shape[1], tall.shape[1]))
    _crossed(wide, tall, out)
    return out.reshape(one.shape[1], *two.shape[1:])


def squares(columns: Array) -> Array:
    """Sum of squares (m,) of every column (n, m)."""
    out = np.zeros(columns.shape[1])
    _squares(np.ascontiguousarray(columns), out)
    return out


def without(vector: Array, columns: Array, amounts: Array) -> Array:
    """A vector (n,) less so much (m,) of each column (n, m)."""
    out = vector.copy()
    _take(out, np.ascontiguousarray(columns), amounts)
    return out


@compiled
def _crossed(one, two, out) -> None:  # type: ignore[no-untyped-def]
    if one.shape[1] == 1 and two.shape[1] == 1:
        whole = 0.0
        for row in range(len(one)):
            whole += one[row, 0] * two[row, 0]
        out[0, 0] = whole
        return
    for row in range(len(one)):
        for i in range(one.shape[1]):
            for j in range(two.shape[1]):
                out[i, j] += one[row, i] * two[row, j]


@compiled
def _squares(columns, out) -> None:  # type: ignore[no-untyped-def]
    for row in range(len(columns)):
        for i in range(len(out)):
            out[i] += columns[row, i] * columns[row, i]


@compiled
def _take(vector, columns, amounts) -> None:  # type: ignore[no-untyped-def]
    for row in range(len(vector)):
        for i in range(len(amounts)):
            vector[row] -= columns[row, i] * amounts[i]
