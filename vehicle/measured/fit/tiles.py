"""Products of four columns with eight others, whose sums stay in the processor while all rows pass.

A loop over many sums reads and writes each of them for every few rows. Here a tile of 4 by 8 is held in vectors. Each
is still added up in the order of the rows, product by product and each rounded: bit for bit the plain loop.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from vehicle.jit import inlined

HIGH, WIDE = 4, 8  # of a tile: chosen, its sums and what they are made of fill sixteen vectors of LANES numbers
LANES = 4  # numbers of a vector: those of 32 bytes, as most processors have


def _add_tile(typingctx: Any, one: Any, two: Any, sums: Any, i: Any, j: Any, rows: Any) -> Any:
    """Add the products of columns `i` to `i + 3` of `one` (r, m) with `j` to `j + 7` of `two` (r, k) to `sums` there.

    Summed are so many `rows`, at least one. The arrays are contiguous and hold the whole tile.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _Tile(context, builder, signature.args, args).add()
        return context.get_dummy_value()

    return types.void(one, two, sums, types.intp, types.intp, types.intp), generate


add_tile: Any = intrinsic(_add_tile)


@inlined
def add_tiles(one, two, same, rows, many, width, sums) -> None:  # type: ignore[no-untyped-def]
    """Add the products of the first `many` columns of `one` (r, m) with the first `width` of `two` (r, k) to `sums`.

    All three have room for whole tiles, in which anything may be written. Of the `same` columns those below the
    diagonal are left out.
    """
    for i in range(0, many, HIGH):
        for j in range(i - i % WIDE if same else 0, width, WIDE):
            add_tile(one, two, sums, i, j, rows)


class _Tile:
    """Writes the instructions of one tile."""

    def __init__(self, context: Any, builder: Any, kinds: Any, args: Any) -> None:
        self.builder, (self.i, self.j, self.rows) = builder, args[3:]
        self.arrays = [
            context.make_array(kind)(context, builder, value=arg) for kind, arg in zip(kinds[:3], args[:3], strict=True)
        ]
        self.number, self.vector = ir.DoubleType(), ir.VectorType(ir.DoubleType(), LANES)
        self.starts = [(row, column) for row in range(HIGH) for column in range(0, WIDE, LANES)]

    def add(self) -> None:
        """Take the sums up, pass all rows, and put them down."""
        builder = self.builder
        places = [self._place(2, self._plus(self.i, row), self._plus(self.j, column)) for row, column in self.starts]
        before, loop, after = builder.block, builder.append_basic_block("rows"), builder.append_basic_block("done")
        sums = [self._vector(place) for place in places]
        builder.branch(loop)
        builder.position_at_end(loop)
        row = builder.phi(self.i.type)
        held = [builder.phi(self.vector) for _ in sums]
        added = self._with_row(row, held)
        following = self._plus(row, 1)
        for phi, first, then in zip((row, *held), (self.i.type(0), *sums), (following, *added), strict=True):
            phi.add_incoming(first, before)
            phi.add_incoming(then, loop)
        builder.cbranch(builder.icmp_signed("<", following, self.rows), loop, after)
        builder.position_at_end(after)
        for place, one in zip(places, added, strict=True):
            builder.store(one, place, align=8)

    def _with_row(self, row: Any, held: list[Any]) -> list[Any]:
        """The sums with the products of one row."""
        others = {c: self._vector(self._place(1, row, self._plus(self.j, c))) for c in range(0, WIDE, LANES)}
        mine = [self._everywhere(self._number(0, row, self._plus(self.i, r))) for r in range(HIGH)]
        return [
            self.builder.fadd(one, self.builder.fmul(mine[r], others[c]))
            for one, (r, c) in zip(held, self.starts, strict=True)
        ]

    def _plus(self, index: Any, more: int) -> Any:
        return self.builder.add(index, index.type(more))

    def _address(self, array: int, row: Any, column: Any) -> Any:
        laid = self.arrays[array]
        width = self.builder.extract_value(laid.shape, 1)
        return self.builder.gep(laid.data, [self.builder.add(self.builder.mul(row, width), column)])

    def _place(self, array: int, row: Any, column: Any) -> Any:
        return self.builder.bitcast(self._address(array, row, column), self.vector.as_pointer())

    def _vector(self, place: Any) -> Any:
        return self.builder.load(place, align=8)

    def _number(self, array: int, row: Any, column: Any) -> Any:
        return self.builder.load(self._address(array, row, column))

    def _everywhere(self, number: Any) -> Any:
        """A vector of one number."""
        undefined = ir.Constant(self.vector, ir.Undefined)
        first = self.builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
        nowhere_else = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return self.builder.shuffle_vector(first, undefined, nowhere_else)
