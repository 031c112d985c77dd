"""A field shared out in blocks of neighbouring lines, one per tractor, so that the last is done soonest.

Blocks are cut by the work on their lines and then balanced by the orders that are really best inside them: a line at a
border changes sides where the slower of the two blocks becomes quicker by it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

Cost = Callable[[int, int], float]
"""Seconds of the block of lines first..last - 1."""

GAIN_S = 0.01
MOST_ROUNDS = 50


def cut(weights: Sequence[float], count: int) -> list[int]:
    """Borders 0 = b0 < b1 < ... = n of `count` runs whose heaviest is as light as possible (n at least `count`)."""
    low, high = max(weights), sum(weights)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if len(_runs(weights, middle)) <= count else (middle, high)
    sizes = _spread(_runs(weights, high), count)
    borders = [0]
    for size in sizes:
        borders.append(borders[-1] + size)
    return borders


def _runs(weights: Sequence[float], most: float) -> list[int]:
    """Sizes of the fewest runs none of which weighs more than `most`."""
    sizes, total = [0], 0.0
    for each in weights:
        if sizes[-1] and total + each > most * (1 + 1e-12):
            sizes.append(0)
            total = 0.0
        sizes[-1] += 1
        total += each
    return sizes


def _spread(sizes: list[int], count: int) -> list[int]:
    """Split the largest runs until there are so many."""
    sizes = list(sizes)
    while len(sizes) < count:
        largest = max(range(len(sizes)), key=lambda i: sizes[i])
        half = sizes[largest] // 2
        sizes[largest : largest + 1] = [sizes[largest] - half, half]
    return sizes


def balanced(borders: list[int], cost: Cost) -> list[int]:
    """Borders moved line by line while the slower of two neighbouring blocks becomes quicker by it."""
    borders = list(borders)
    for _ in range(MOST_ROUNDS):
        moved = [_move(borders, number, cost) for number in range(1, len(borders) - 1)]
        if not any(moved):
            break
    return borders


def _move(borders: list[int], number: int, cost: Cost) -> bool:
    """Move one border where that helps; whether it did."""
    first, here, last = borders[number - 1 : number + 2]
    one, two = cost(first, here), cost(here, last)
    other = here - 1 if one > two else here + 1
    if not first < other < last:
        return False
    if max(cost(first, other), cost(other, last)) >= max(one, two) - GAIN_S:
        return False
    borders[number] = other
    return True
