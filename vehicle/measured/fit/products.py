"""Products of tall columns in the order of their rows, on one core.

Libraries of linear algebra share such products out to every core, which then wait for each other: on a busy machine
that was two thirds of a diagnosis, and the last digits depended on the number of cores. Columns are best kept one after
another (in the order of Fortran). Many are of one run alone: where a column is 0 for some rows it is passed over.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.jit import compiled
from vehicle.measured.fit.tiles import HIGH, WIDE, add_tiles
from vehicle.measured.logs.record import Array

ROWS = 64  # that are looked at together: chosen, few enough to stay near the processor
FEW = 3  # chosen: products with fewer columns than these are quicker without tiles


class Tall:
    """Columns (n, m) that are asked for again and again, with where each of them is not 0 all along."""

    def __init__(self, columns: Array) -> None:
        """Look at the columns once."""
        self._columns = np.ascontiguousarray(columns.T)
        pieces = -(-len(columns) // ROWS)
        self._counts = np.zeros(pieces, np.int64)
        self._places = np.zeros((pieces, columns.shape[1]), np.int64)
        _look(self._columns, self._counts, self._places)

    @property
    def columns(self) -> Array:
        """The columns (n, m)."""
        return self._columns.T

    @cached_property
    def square(self) -> Array:
        """Products (m, m) of the columns with each other."""
        columns = self.columns  # one object: products with itself are summed above the diagonal only
        return crossed(columns, columns)

    def crossed_with(self, others: Array) -> Array:
        """Products (m, k) with other columns (n, k), which are few: those of `crossed`."""
        return side_by_side([self.crossed(one) for one in others.T], len(self._columns))

    def crossed(self, vector: Array) -> Array:
        """Products (m,) with a vector (n,): those of `crossed`."""
        out = np.zeros(len(self._columns))
        _sided_where(self._columns, self._counts, self._places, np.ascontiguousarray(vector), out)
        return out

    def without(self, vector: Array, amounts: Array) -> Array:
        """A vector (n,) less so much (m,) of each column."""
        out = vector.copy()
        _take_where(out, self._columns, self._counts, self._places, amounts)
        return out


def squared(left: Array) -> float:
    """Sum of squares of a vector (n,)."""
    return float(np.einsum("i,i", left, left))


def crossed(one: Array, two: Array) -> Array:
    """Products (m, k) of all columns (n, m) with all columns (n, k), or (m,) with a vector (n,)."""
    mine = np.ascontiguousarray(one.T)
    if two.ndim == 1:
        sides = np.zeros(len(mine))
        _sided(mine, np.ascontiguousarray(two), 0, len(two), sides)
        return sides
    same = one is two
    others = mine if same else np.ascontiguousarray(two.T)
    out = np.zeros((len(mine), len(others)))
    _crossed(mine, others, same, 0, len(two), out)
    return out


def squares(columns: Array) -> Array:
    """Sum of squares (m,) of every column (n, m)."""
    out: Array = np.einsum("ni,ni->i", columns, columns)
    return out


def without(vector: Array, columns: Array, amounts: Array) -> Array:
    """A vector (n,) less so much (m,) of each column (n, m)."""
    out = vector.copy()
    _take(out, np.ascontiguousarray(columns.T), amounts)
    return out


def side_by_side(columns: list[Array], rows: int) -> Array:
    """Columns (n,) as one array (n, m), one after another in memory; none make one without columns."""
    return np.array(columns).T if columns else np.zeros((rows, 0))


def add_products(blocks: npt.NDArray[np.int64], slope: Array, left: Array, squares: Array, sides: Array) -> None:
    """Add the products of columns with each other and with what is left to their blocks, stretch by stretch of one."""
    edges = np.flatnonzero(np.diff(blocks, prepend=-1, append=-1))
    _add(edges, blocks, np.ascontiguousarray(slope.T), np.ascontiguousarray(left), squares, sides)


@compiled
def _add(edges, blocks, columns, left, squares, sides) -> None:  # type: ignore[no-untyped-def]
    for number in range(len(edges) - 1):
        first, last = edges[number], edges[number + 1]
        _crossed(columns, columns, True, first, last, squares[blocks[first]])
        _sided(columns, left, first, last, sides[blocks[first]])


@compiled
def _crossed(one, two, same, begin, end, out) -> None:  # type: ignore[no-untyped-def]
    """Add the products of columns (m, n) and (k, n) in the rows from `begin` to before `end` to `out` (m, k)."""
    mine, others = np.zeros((ROWS, len(one) + WIDE)), np.zeros((ROWS, len(two) + WIDE))
    places, theirs = np.empty(len(one), np.int64), np.empty(len(two), np.int64)
    sums = np.zeros((len(one) + HIGH, len(two) + WIDE))
    if same:
        others, theirs = mine, places
    for first in range(begin, end, ROWS):
        rows = min(ROWS, end - first)
        many = _packed(one, first, rows, mine, places)
        width = many if same else _packed(two, first, rows, others, theirs)
        for i in range(many):
            for j in range(i if same else 0, width):
                sums[i, j] = out[places[i], theirs[j]]
        if width < FEW:
            _summed(mine, others, same, rows, many, width, sums)
        else:
            add_tiles(mine, others, same, rows, many, width, sums)
        for i in range(many):
            for j in range(i if same else 0, width):
                out[places[i], theirs[j]] = sums[i, j]
    if same:
        for i in range(len(one)):
            for j in range(i):
                out[i, j] = out[j, i]


@compiled
def _packed(columns, first, rows, packed, places) -> int:  # type: ignore[no-untyped-def]
    """Some rows of the columns (m, n) that are not 0 there, side by side; `places` gets which; returned is how many."""
    count = 0
    for i in range(len(columns)):
        some = columns[i, first] != 0.0
        if not some:
            for row in range(first + 1, first + rows):  # to the end, so that it is made of vectors
                some |= columns[i, row] != 0.0
        if some:
            places[count] = i
            for row in range(rows):
                packed[row, count] = columns[i, first + row]
            count += 1
    return count


@compiled
def _summed(one, two, same, rows, many, width, sums) -> None:  # type: ignore[no-untyped-def]
    """Add the products of packed columns to sums: four rows at once, for a sum is read and written once for them.

    Of the `same` columns only those above the diagonal, which those below it are.
    """
    whole = rows - rows % 4
    for row in range(0, whole, 4):
        for i in range(many):
            a, b, c, d = one[row, i], one[row + 1, i], one[row + 2, i], one[row + 3, i]
            for j in range(i if same else 0, width):
                sums[i, j] = (
                    sums[i, j] + a * two[row, j] + b * two[row + 1, j] + c * two[row + 2, j] + d * two[row + 3, j]
                )
    for row in range(whole, rows):
        for i in range(many):
            for j in range(i if same else 0, width):
                sums[i, j] += one[row, i] * two[row, j]


@compiled
def _sided(columns, left, begin, end, out) -> None:  # type: ignore[no-untyped-def]
    """Add the products of columns (m, n) with a vector (n,) to `out` (m,): four at once, for each waits for its sum."""
    whole = len(columns) - len(columns) % 4
    for i in range(0, whole, 4):
        a, b, c, d = out[i], out[i + 1], out[i + 2], out[i + 3]
        for row in range(begin, end):
            a += columns[i, row] * left[row]
            b += columns[i + 1, row] * left[row]
            c += columns[i + 2, row] * left[row]
            d += columns[i + 3, row] * left[row]
        out[i], out[i + 1], out[i + 2], out[i + 3] = a, b, c, d
    for i in range(whole, len(columns)):
        for row in range(begin, end):
            out[i] += columns[i, row] * left[row]


@compiled
def _take(vector, columns, amounts) -> None:  # type: ignore[no-untyped-def]
    for first in range(0, len(vector), ROWS):
        last = min(first + ROWS, len(vector))
        for i in range(len(amounts)):
            if amounts[i] != 0.0:
                for row in range(first, last):
                    vector[row] -= columns[i, row] * amounts[i]


@compiled
def _look(columns, counts, places) -> None:  # type: ignore[no-untyped-def]
    """Per piece of ROWS rows how many columns (m, n) are not 0 there, `counts` (p,), and which, `places` (p, m)."""
    for piece in range(len(counts)):
        first, last = piece * ROWS, min((piece + 1) * ROWS, columns.shape[1])
        for i in range(len(columns)):
            for row in range(first, last):
                if columns[i, row] != 0.0:
                    places[piece, counts[piece]] = i
                    counts[piece] += 1
                    break


@compiled
def _sided_where(columns, counts, places, left, out) -> None:  # type: ignore[no-untyped-def]
    """As _sided, of all rows: what is 0 is passed over, which leaves the sums as they are."""
    for piece in range(len(counts)):
        first, last = piece * ROWS, min((piece + 1) * ROWS, len(left))
        whole = counts[piece] - counts[piece] % 4
        for k in range(0, whole, 4):
            i, j, m, n = places[piece, k], places[piece, k + 1], places[piece, k + 2], places[piece, k + 3]
            a, b, c, d = out[i], out[j], out[m], out[n]
            for row in range(first, last):
                a += columns[i, row] * left[row]
                b += columns[j, row] * left[row]
                c += columns[m, row] * left[row]
                d += columns[n, row] * left[row]
            out[i], out[j], out[m], out[n] = a, b, c, d
        for k in range(whole, counts[piece]):
            i = places[piece, k]
            a = out[i]
            for row in range(first, last):
                a += columns[i, row] * left[row]
            out[i] = a


@compiled
def _take_where(vector, columns, counts, places, amounts) -> None:  # type: ignore[no-untyped-def]
    """As _take."""
    for piece in range(len(counts)):
        first, last = piece * ROWS, min((piece + 1) * ROWS, len(vector))
        whole = counts[piece] - counts[piece] % 4
        for k in range(0, whole, 4):
            i, j, m, n = places[piece, k], places[piece, k + 1], places[piece, k + 2], places[piece, k + 3]
            a, b, c, d = amounts[i], amounts[j], amounts[m], amounts[n]
            for row in range(first, last):
                vector[row] = (
                    vector[row] - columns[i, row] * a - columns[j, row] * b - columns[m, row] * c - columns[n, row] * d
                )
        for k in range(whole, counts[piece]):
            i = places[piece, k]
            amount = amounts[i]
            for row in range(first, last):
                vector[row] -= columns[i, row] * amount
