"""Products of tall columns against those of numpy, whatever the layout."""

import numpy as np
import pytest

from vehicle.identification.fit.column_products import (
    TILE_COLUMNS,
    TILE_ROWS,
    IndexedColumns,
    add_block_products,
    multiply_columns,
    stack_columns,
    subtract_columns,
    sum_column_squares,
    sum_squares,
)


def test_products_are_those_of_the_columns() -> None:
    rng = np.random.default_rng(2)
    one, two, left = rng.normal(size=(500, 3)), rng.normal(size=(4, 500)).T, rng.normal(size=500)
    assert multiply_columns(one, two) == pytest.approx(one.T @ two)
    assert multiply_columns(two, left) == pytest.approx(two.T @ left) and multiply_columns(two, left).shape == (4,)
    assert multiply_columns(one[:, :1], two[:, :1]) == pytest.approx(one[:, :1].T @ two[:, :1])
    assert multiply_columns(one, two[:, :2]) == pytest.approx(one.T @ two[:, :2]), "fewer columns than the first has"
    assert sum_column_squares(two) == pytest.approx(np.diag(two.T @ two))
    assert sum_squares(left) == pytest.approx(float(left @ left))
    assert subtract_columns(left, one[:, ::2], np.array([2.0, -1.0])) == pytest.approx(
        left - 2.0 * one[:, 0] + one[:, 2]
    )


def test_no_columns_take_nothing_away() -> None:
    left = np.arange(4.0)
    none = np.zeros((4, 0))
    assert multiply_columns(none, left).shape == (0,) and multiply_columns(none, none).shape == (0, 0)
    assert np.array_equal(subtract_columns(left, none, np.zeros(0)), left)


def test_columns_of_one_run_alone_are_passed_over_without_a_trace() -> None:
    """Bit for bit the sums in the order of the rows, whatever is 0 where, and however many rows are over."""
    rng = np.random.default_rng(3)
    for rows in (3, 64, 200):
        columns = rng.normal(size=(rows, 6))
        columns[: rows // 2, 1:3] = columns[rows // 3 :, 4] = 0.0
        slow = np.zeros((6, 6))
        for row in columns:
            slow += row[:, None] * row
        assert np.array_equal(multiply_columns(columns, columns), slow)
        assert np.array_equal(multiply_columns(columns, columns.copy()), slow)
        assert np.array_equal(multiply_columns(columns, columns[:, 4]), slow[:, 4])


def test_many_columns_are_summed_in_the_order_of_the_rows() -> None:
    """Bit for bit, whatever tiles they fill, of all rows and of those of a block."""
    assert (TILE_ROWS, TILE_COLUMNS) == (4, 8)
    rng = np.random.default_rng(6)
    for rows, many, width in ((1, 4, 8), (64, 9, 3), (65, 21, 11), (200, 13, 17), (130, 2, 40), (130, 40, 2)):
        one, two = rng.normal(size=(rows, many)), rng.normal(size=(rows, width))
        one[rows // 3 : rows // 2, 1::2] = two[rows // 2 :, ::3] = 0.0
        cross, square = np.zeros((many, width)), np.zeros((many, many))
        for mine, other in zip(one, two, strict=True):
            cross += mine[:, None] * other
            square += mine[:, None] * mine
        assert np.array_equal(multiply_columns(one, two), cross) and np.array_equal(multiply_columns(one, one), square)
        squares, sides = np.zeros((1, many, many)), np.zeros((1, many))
        add_block_products(np.zeros(rows, np.int64), one, two[:, 0], squares, sides)
        assert np.array_equal(squares[0], square) and np.array_equal(sides[0], cross[:, 0])


def test_columns_looked_at_once_give_the_same_bits() -> None:
    rng = np.random.default_rng(4)
    for rows in (1, 64, 333):
        columns, left = rng.normal(size=(rows, 7)), rng.normal(size=rows)
        columns[: rows // 2, 1:4] = columns[rows // 3 :, 5] = columns[:, 6] = 0.0
        amounts = rng.normal(size=7)
        laid = IndexedColumns(columns)
        assert np.array_equal(laid.multiply_vector(left), multiply_columns(columns, left))
        assert np.array_equal(laid.subtract_columns_from(left, amounts), subtract_columns(left, columns, amounts))
        assert np.array_equal(laid.column_products, multiply_columns(columns, columns)) and np.array_equal(
            laid.columns, columns
        )
        assert np.array_equal(laid.multiply_columns(columns[:, 4:6]), laid.column_products[:, 4:6])
    none = IndexedColumns(np.zeros((4, 0)))
    assert (
        none.multiply_vector(np.ones(4)).shape == (0,)
        and none.subtract_columns_from(np.ones(4), np.zeros(0)).tolist() == [1.0] * 4
    )


def test_products_are_added_to_the_blocks_they_belong_to() -> None:
    rng = np.random.default_rng(5)
    blocks, slope, left = np.repeat([2, 0, 2, 1], [5, 70, 9, 1]), rng.normal(size=(85, 5)), rng.normal(size=85)
    squares, sides = np.zeros((3, 5, 5)), np.zeros((3, 5))
    add_block_products(blocks, slope, left, squares, sides)
    for block in range(3):
        mine = slope[blocks == block]
        assert squares[block] == pytest.approx(mine.T @ mine)
        assert sides[block] == pytest.approx(mine.T @ left[blocks == block])


def test_columns_side_by_side() -> None:
    made = stack_columns([np.arange(3.0), np.ones(3)], 3)
    assert made.tolist() == [[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]] and made.flags.f_contiguous
    assert stack_columns([], 4).shape == (4, 0)
