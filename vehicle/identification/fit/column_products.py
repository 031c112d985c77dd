"""Products of tall columns in row order, on one core, with the inner loop in vector registers.

Linear algebra libraries spread such products over all cores, which then wait for each other: on a busy machine that
took two thirds of a diagnosis, and the last digits depended on the number of cores. Columns should be contiguous
(Fortran order). Many are of one run alone: where a column is 0 for some rows it is skipped.

Four columns with eight others form a tile whose sums stay in registers while all rows pass. Each sum is still added up
in row order, product by product with rounding: bit for bit as in the plain loop.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from vehicle.identification.logs.schema import Array
from vehicle.jit import compile_function, inline_function

# Size of a tile: chosen, its sums and inputs fill sixteen registers of VECTOR_NUMBERS numbers.
TILE_ROWS, TILE_COLUMNS = 4, 8
VECTOR_NUMBERS = 4  # numbers per vector register of 32 bytes, as most processors have


def _generate_add_tile(
    typingctx: Any, left_columns: Any, right_columns: Any, sums: Any, i: Any, j: Any, rows: Any
) -> Any:
    """Add the products of columns `i` to `i + 3` of `one` (r, m) with `j` to `j + 7` of `two` (r, k) to `sums`.

    Sums over `rows` rows, at least one. The arrays are contiguous and contain the whole tile.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _TileWriter(context, builder, signature.args, args).emit_tile()
        return context.get_dummy_value()

    return types.void(left_columns, right_columns, sums, types.intp, types.intp, types.intp), generate


add_tile: Any = intrinsic(_generate_add_tile)


@inline_function
def add_tiles(left_columns, right_columns, is_same, rows, left_count, right_count, sums) -> None:  # type: ignore[no-untyped-def]
    """Add the products of the first `many` columns of `one` (r, m) with the first `width` of `two` (r, k) to `sums`.

    All three have room for whole tiles; the padding may be overwritten. If `same`, products below the diagonal are
    skipped.
    """
    for i in range(0, left_count, TILE_ROWS):
        for j in range(i - i % TILE_COLUMNS if is_same else 0, right_count, TILE_COLUMNS):
            add_tile(left_columns, right_columns, sums, i, j, rows)


class _TileWriter:
    """Emits the instructions of one tile."""

    def __init__(self, context: Any, builder: Any, kinds: Any, args: Any) -> None:
        """Prepare the types and the arguments."""
        self.builder, (self.i, self.j, self.rows) = builder, args[3:]
        self.arrays = [
            context.make_array(kind)(context, builder, value=arg) for kind, arg in zip(kinds[:3], args[:3], strict=True)
        ]
        self.number, self.vector = ir.DoubleType(), ir.VectorType(ir.DoubleType(), VECTOR_NUMBERS)
        self.starts = [(row, column) for row in range(TILE_ROWS) for column in range(0, TILE_COLUMNS, VECTOR_NUMBERS)]

    def emit_tile(self) -> None:
        """Emit loading the sums, looping over the rows, and storing the sums."""
        builder = self.builder
        places = [
            self._find_vector_address(2, self._add_index(self.i, row), self._add_index(self.j, column))
            for row, column in self.starts
        ]
        before, loop, after = builder.block, builder.append_basic_block("rows"), builder.append_basic_block("done")
        sums = [self._load_vector(place) for place in places]
        builder.branch(loop)
        builder.position_at_end(loop)
        row = builder.phi(self.i.type)
        held_sums = [builder.phi(self.vector) for _ in sums]
        added = self._add_row(row, held_sums)
        following = self._add_index(row, 1)
        for phi, initial_value, next_value in zip(
            (row, *held_sums), (self.i.type(0), *sums), (following, *added), strict=True
        ):
            phi.add_incoming(initial_value, before)
            phi.add_incoming(next_value, loop)
        builder.cbranch(builder.icmp_signed("<", following, self.rows), loop, after)
        builder.position_at_end(after)
        for place, tile_sum in zip(places, added, strict=True):
            builder.store(tile_sum, place, align=8)

    def _add_row(self, row: Any, held_sums: list[Any]) -> list[Any]:
        """Emit adding the products of one row to the sums."""
        column_vectors = {
            c: self._load_vector(self._find_vector_address(1, row, self._add_index(self.j, c)))
            for c in range(0, TILE_COLUMNS, VECTOR_NUMBERS)
        }
        row_numbers = [self._broadcast(self._load_number(0, row, self._add_index(self.i, r))) for r in range(TILE_ROWS)]
        return [
            self.builder.fadd(tile_sum, self.builder.fmul(row_numbers[r], column_vectors[c]))
            for tile_sum, (r, c) in zip(held_sums, self.starts, strict=True)
        ]

    def _add_index(self, index: Any, offset: int) -> Any:
        return self.builder.add(index, index.type(offset))

    def _find_address(self, array: int, row: Any, column: Any) -> Any:
        array_struct = self.arrays[array]
        width = self.builder.extract_value(array_struct.shape, 1)
        return self.builder.gep(array_struct.data, [self.builder.add(self.builder.mul(row, width), column)])

    def _find_vector_address(self, array: int, row: Any, column: Any) -> Any:
        return self.builder.bitcast(self._find_address(array, row, column), self.vector.as_pointer())

    def _load_vector(self, place: Any) -> Any:
        return self.builder.load(place, align=8)

    def _load_number(self, array: int, row: Any, column: Any) -> Any:
        return self.builder.load(self._find_address(array, row, column))

    def _broadcast(self, number: Any) -> Any:
        """Emit a vector of one number."""
        undefined = ir.Constant(self.vector, ir.Undefined)
        first = self.builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
        nowhere_else = ir.Constant(ir.VectorType(ir.IntType(32), VECTOR_NUMBERS), [0] * VECTOR_NUMBERS)
        return self.builder.shuffle_vector(first, undefined, nowhere_else)


BLOCK_ROWS = 64  # rows processed together: chosen, few enough to stay in the cache
FEW_COLUMNS = 3  # chosen: products with fewer columns are faster without tiles


class IndexedColumns:
    """Columns (n, m) that are used again and again, with an index of where each is not 0."""

    def __init__(self, columns: Array) -> None:
        """Index the columns once."""
        self._columns = np.ascontiguousarray(columns.T)
        pieces = -(-len(columns) // BLOCK_ROWS)
        self._counts = np.zeros(pieces, np.int64)
        self._places = np.zeros((pieces, columns.shape[1]), np.int64)
        _find_nonzero(self._columns, self._counts, self._places)

    @property
    def columns(self) -> Array:
        """The columns (n, m)."""
        return self._columns.T

    @cached_property
    def column_products(self) -> Array:
        """Return the products (m, m) of the columns with each other."""
        columns = self.columns  # the same object: only products above the diagonal are summed
        return multiply_columns(columns, columns)

    def multiply_columns(self, other_columns: Array) -> Array:
        """Return the products (m, k) with a few other columns (n, k)."""
        return stack_columns([self.multiply_vector(column) for column in other_columns.T], len(self._columns))

    def multiply_vector(self, vector: Array) -> Array:
        """Products (m,) with a vector (n,): those of `crossed`."""
        out = np.zeros(len(self._columns))
        _add_nonzero_vector_products(self._columns, self._counts, self._places, np.ascontiguousarray(vector), out)
        return out

    def subtract_columns_from(self, vector: Array, amounts: Array) -> Array:
        """Return a vector (n,) minus the columns times amounts (m,)."""
        out = vector.copy()
        _subtract_nonzero_columns(out, self._columns, self._counts, self._places, amounts)
        return out


def sum_squares(vector: Array) -> float:
    """Return the sum of squares of a vector (n,)."""
    return float(np.einsum("i,i", vector, vector))


def multiply_columns(left_columns: Array, right_columns: Array) -> Array:
    """Products (m, k) of all columns (n, m) with all columns (n, k), or (m,) with a vector (n,)."""
    packed_left = np.ascontiguousarray(left_columns.T)
    if right_columns.ndim == 1:
        sides = np.zeros(len(packed_left))
        _add_vector_products(packed_left, np.ascontiguousarray(right_columns), 0, len(right_columns), sides)
        return sides
    is_same = left_columns is right_columns
    packed_right = packed_left if is_same else np.ascontiguousarray(right_columns.T)
    out = np.zeros((len(packed_left), len(packed_right)))
    _add_column_products(packed_left, packed_right, is_same, 0, len(right_columns), out)
    return out


def sum_column_squares(columns: Array) -> Array:
    """Return the sum of squares (m,) of every column (n, m)."""
    out: Array = np.einsum("ni,ni->i", columns, columns)
    return out


def subtract_columns(vector: Array, columns: Array, amounts: Array) -> Array:
    """Return a vector (n,) minus the columns (n, m) times amounts (m,)."""
    out = vector.copy()
    _subtract_columns(out, np.ascontiguousarray(columns.T), amounts)
    return out


def stack_columns(columns: list[Array], rows: int) -> Array:
    """Stack columns (n,) to an array (n, m) in Fortran order; an empty list gives no columns."""
    return np.array(columns).T if columns else np.zeros((rows, 0))


def add_block_products(
    blocks: npt.NDArray[np.int64], jacobian: Array, residuals: Array, squares: Array, sides: Array
) -> None:
    """Add the products of columns with each other and with residuals to their blocks, run of equal block by run."""
    edges = np.flatnonzero(np.diff(blocks, prepend=-1, append=-1))
    _add_block_products(
        edges, blocks, np.ascontiguousarray(jacobian.T), np.ascontiguousarray(residuals), squares, sides
    )


@compile_function
def _add_block_products(edges, blocks, columns, residuals, squares, sides) -> None:  # type: ignore[no-untyped-def]
    for number in range(len(edges) - 1):
        first, last = edges[number], edges[number + 1]
        _add_column_products(columns, columns, True, first, last, squares[blocks[first]])
        _add_vector_products(columns, residuals, first, last, sides[blocks[first]])


@compile_function
def _add_column_products(left_columns, right_columns, is_same, begin, end, out) -> None:  # type: ignore[no-untyped-def]
    """Add the products of columns (m, n) and (k, n) over rows `begin` to before `end` to `out` (m, k)."""
    packed_left, packed_right = (
        np.zeros((BLOCK_ROWS, len(left_columns) + TILE_COLUMNS)),
        np.zeros((BLOCK_ROWS, len(right_columns) + TILE_COLUMNS)),
    )
    left_places, right_places = np.empty(len(left_columns), np.int64), np.empty(len(right_columns), np.int64)
    sums = np.zeros((len(left_columns) + TILE_ROWS, len(right_columns) + TILE_COLUMNS))
    if is_same:
        packed_right, right_places = packed_left, left_places
    for first in range(begin, end, BLOCK_ROWS):
        rows = min(BLOCK_ROWS, end - first)
        left_count = _pack_columns(left_columns, first, rows, packed_left, left_places)
        right_count = left_count if is_same else _pack_columns(right_columns, first, rows, packed_right, right_places)
        for i in range(left_count):
            for j in range(i if is_same else 0, right_count):
                sums[i, j] = out[left_places[i], right_places[j]]
        if right_count < FEW_COLUMNS:
            _add_packed_products(packed_left, packed_right, is_same, rows, left_count, right_count, sums)
        else:
            add_tiles(packed_left, packed_right, is_same, rows, left_count, right_count, sums)
        for i in range(left_count):
            for j in range(i if is_same else 0, right_count):
                out[left_places[i], right_places[j]] = sums[i, j]
    if is_same:
        for i in range(len(left_columns)):
            for j in range(i):
                out[i, j] = out[j, i]


@compile_function
def _pack_columns(columns, first, rows, packed, places) -> int:  # type: ignore[no-untyped-def]
    """Copy some rows of the columns (m, n) that are not 0 there side by side; `places` gets their indices; returns
    their number."""
    count = 0
    for i in range(len(columns)):
        is_nonzero = columns[i, first] != 0.0
        if not is_nonzero:
            for row in range(first + 1, first + rows):  # to the end, so that the loop vectorises
                is_nonzero |= columns[i, row] != 0.0
        if is_nonzero:
            places[count] = i
            for row in range(rows):
                packed[row, count] = columns[i, first + row]
            count += 1
    return count


@compile_function
def _add_packed_products(packed_left, packed_right, is_same, rows, left_count, width, sums) -> None:  # type: ignore[no-untyped-def]
    """Add the products of packed columns to sums, four rows at once, so that a sum is read and written once for them.

    If `same`, only those above the diagonal, which equal those below it.
    """
    whole_rows = rows - rows % 4
    for row in range(0, whole_rows, 4):
        for i in range(left_count):
            a, b, c, d = packed_left[row, i], packed_left[row + 1, i], packed_left[row + 2, i], packed_left[row + 3, i]
            for j in range(i if is_same else 0, width):
                sums[i, j] = (
                    sums[i, j]
                    + a * packed_right[row, j]
                    + b * packed_right[row + 1, j]
                    + c * packed_right[row + 2, j]
                    + d * packed_right[row + 3, j]
                )
    for row in range(whole_rows, rows):
        for i in range(left_count):
            for j in range(i if is_same else 0, width):
                sums[i, j] += packed_left[row, i] * packed_right[row, j]


@compile_function
def _add_vector_products(columns, vector, begin, end, out) -> None:  # type: ignore[no-untyped-def]
    """Add the products of columns (m, n) with a vector (n,) to `out` (m,), four at once to hide latency."""
    whole_columns = len(columns) - len(columns) % 4
    for i in range(0, whole_columns, 4):
        a, b, c, d = out[i], out[i + 1], out[i + 2], out[i + 3]
        for row in range(begin, end):
            a += columns[i, row] * vector[row]
            b += columns[i + 1, row] * vector[row]
            c += columns[i + 2, row] * vector[row]
            d += columns[i + 3, row] * vector[row]
        out[i], out[i + 1], out[i + 2], out[i + 3] = a, b, c, d
    for i in range(whole_columns, len(columns)):
        for row in range(begin, end):
            out[i] += columns[i, row] * vector[row]


@compile_function
def _subtract_columns(vector, columns, amounts) -> None:  # type: ignore[no-untyped-def]
    for first in range(0, len(vector), BLOCK_ROWS):
        last = min(first + BLOCK_ROWS, len(vector))
        for i in range(len(amounts)):
            if amounts[i] != 0.0:
                for row in range(first, last):
                    vector[row] -= columns[i, row] * amounts[i]


@compile_function
def _find_nonzero(columns, counts, places) -> None:  # type: ignore[no-untyped-def]
    """Find, per piece of ROWS rows, the number of columns (m, n) that are not 0 there, `counts` (p,), and their
    indices, `places` (p, m)."""
    for piece in range(len(counts)):
        first, last = piece * BLOCK_ROWS, min((piece + 1) * BLOCK_ROWS, columns.shape[1])
        for i in range(len(columns)):
            for row in range(first, last):
                if columns[i, row] != 0.0:
                    places[piece, counts[piece]] = i
                    counts[piece] += 1
                    break


@compile_function
def _add_nonzero_vector_products(columns, counts, places, vector, out) -> None:  # type: ignore[no-untyped-def]
    """As _add_vector_products over all rows; zeros are skipped, which does not change the sums."""
    for piece in range(len(counts)):
        first, last = piece * BLOCK_ROWS, min((piece + 1) * BLOCK_ROWS, len(vector))
        whole_columns = counts[piece] - counts[piece] % 4
        for k in range(0, whole_columns, 4):
            i, j, m, n = places[piece, k], places[piece, k + 1], places[piece, k + 2], places[piece, k + 3]
            a, b, c, d = out[i], out[j], out[m], out[n]
            for row in range(first, last):
                a += columns[i, row] * vector[row]
                b += columns[j, row] * vector[row]
                c += columns[m, row] * vector[row]
                d += columns[n, row] * vector[row]
            out[i], out[j], out[m], out[n] = a, b, c, d
        for k in range(whole_columns, counts[piece]):
            i = places[piece, k]
            a = out[i]
            for row in range(first, last):
                a += columns[i, row] * vector[row]
            out[i] = a


@compile_function
def _subtract_nonzero_columns(vector, columns, counts, places, amounts) -> None:  # type: ignore[no-untyped-def]
    """Subtract columns times amounts, skipping zeros."""
    for piece in range(len(counts)):
        first, last = piece * BLOCK_ROWS, min((piece + 1) * BLOCK_ROWS, len(vector))
        whole_columns = counts[piece] - counts[piece] % 4
        for k in range(0, whole_columns, 4):
            i, j, m, n = places[piece, k], places[piece, k + 1], places[piece, k + 2], places[piece, k + 3]
            a, b, c, d = amounts[i], amounts[j], amounts[m], amounts[n]
            for row in range(first, last):
                vector[row] = (
                    vector[row] - columns[i, row] * a - columns[j, row] * b - columns[m, row] * c - columns[n, row] * d
                )
        for k in range(whole_columns, counts[piece]):
            i = places[piece, k]
            amount = amounts[i]
            for row in range(first, last):
                vector[row] -= columns[i, row] * amount
