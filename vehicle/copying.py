"""Copies inside compiled functions: a loop compiles sooner than an assignment of arrays, which checks their shapes."""

from __future__ import annotations

from vehicle.jit import compile_function


@compile_function
def copy_row(values, into) -> None:  # type: ignore[no-untyped-def]
    """Copy a row of numbers."""
    for number in range(len(values)):
        into[number] = values[number]


@compile_function
def copy_table(values, into) -> None:  # type: ignore[no-untyped-def]
    """Copy a table of numbers (n, m)."""
    for row in range(values.shape[0]):
        for column in range(values.shape[1]):
            into[row, column] = values[row, column]
