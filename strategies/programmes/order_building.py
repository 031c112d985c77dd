"""First programmes by insertion: the line that loses most by waiting comes next (regret; Potvin and Rousseau 1993)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from strategies.programmes.order_tours import NO_MOVE_S, sum_rows, update_row
from vehicle.jit import compile_for_views, compile_function

NO_GAP: Any = np.int64(-1)


class Insertions(NamedTuple):
    """The cheapest and second cheapest gap of each row for each line that waits: seconds, gap and node (k, n, 2)."""

    seconds: Any
    gaps: Any
    nodes: Any


@compile_for_views
def _compare_gap(insertions, tours, tables, row, line, gap) -> None:  # type: ignore[no-untyped-def]
    """Keep a gap of a row if it is among the two cheapest for a line."""
    nodes, length = tours.nodes[row], tours.lengths[row]
    best_s, best_node = np.inf, 2 * line
    for node in (2 * line, 2 * line + 1):
        added_s = tables.begin_s[row, node] if gap == 0 else tables.move_s[nodes[gap - 1], node]
        added_s += tables.end_s[row, node] if gap == length else tables.move_s[node, nodes[gap]]
        if added_s < best_s:
            best_s, best_node = added_s, node
    best_s += tables.work_s[line]
    if length > 0:
        if gap == 0:
            best_s -= tables.begin_s[row, nodes[0]]
        elif gap == length:
            best_s -= tables.end_s[row, nodes[length - 1]]
        else:
            best_s -= tables.move_s[nodes[gap - 1], nodes[gap]]
    seconds, gaps, chosen = insertions.seconds[row, line], insertions.gaps[row, line], insertions.nodes[row, line]
    if best_s < seconds[0]:
        seconds[1], gaps[1], chosen[1] = seconds[0], gaps[0], chosen[0]
        seconds[0], gaps[0], chosen[0] = best_s, gap, best_node
    elif best_s < seconds[1]:
        seconds[1], gaps[1], chosen[1] = best_s, gap, best_node


@compile_for_views
def _update_insertions(insertions, tours, tables, row, filled) -> None:  # type: ignore[no-untyped-def]
    """Bring the gaps of a row up to date after one was filled (-1: look at all of them)."""
    left, length = len(tours.lengths) - 1, tours.lengths[row]
    for place in range(tours.lengths[left]):
        line = tours.nodes[left, place] // 2
        if not tables.allowed[row, line]:
            continue
        gaps = insertions.gaps[row, line]
        if filled < 0 or gaps[0] == filled or gaps[1] == filled:
            insertions.seconds[row, line, 0] = insertions.seconds[row, line, 1] = np.inf
            gaps[0] = gaps[1] = NO_GAP
            for gap in range(length + 1):
                _compare_gap(insertions, tours, tables, row, line, gap)
            continue
        for number in range(2):
            if gaps[number] > filled:
                gaps[number] += 1
        _compare_gap(insertions, tours, tables, row, line, filled)
        _compare_gap(insertions, tours, tables, row, line, filled + 1)


@compile_for_views
def _choose_insertion(insertions, tours, tables):  # type: ignore[no-untyped-def]
    """The row and the line (its place among those left) to be inserted next; -1 if no move reaches any."""
    left = len(tours.lengths) - 1
    longest_s, best_regret_s = tours.seconds[tours.longest[0]], -np.inf
    best_row, best_place = NO_GAP, NO_GAP
    for place in range(tours.lengths[left]):
        line = tours.nodes[left, place] // 2
        first, second, line_row = np.inf, tables.value_s[line], NO_GAP
        for row in range(left):
            for number in range(2):
                added_s = insertions.seconds[row, line, number]
                if added_s >= NO_MOVE_S:
                    break
                finish_s = tours.seconds[row] + added_s
                cost = (1.0 - tables.sum_share) * max(finish_s - longest_s, 0.0) + tables.sum_share * added_s
                if cost < first:
                    first, second, line_row = cost, min(first, second), row
                else:
                    second = min(second, cost)
        if line_row >= 0 and second - first > best_regret_s:
            best_regret_s, best_row, best_place = second - first, line_row, place
    return best_row, best_place


@compile_function
def insert_lines(tours, tables) -> None:  # type: ignore[no-untyped-def]
    """Insert every line that a move reaches, worth it or not: together lines may be worth a long way."""
    left, n = len(tours.lengths) - 1, len(tours.row_of)
    insertions = Insertions(
        np.full((left, n, 2), np.inf), np.full((left, n, 2), NO_GAP), np.zeros((left, n, 2), np.int64)
    )
    for row in range(left):
        _update_insertions(insertions, tours, tables, row, NO_GAP)
    while True:
        row, place = _choose_insertion(insertions, tours, tables)
        if row < 0:
            return
        line = tours.nodes[left, place] // 2
        gap = insertions.gaps[row, line, 0]
        for later in range(tours.lengths[row], gap, -1):
            tours.nodes[row, later] = tours.nodes[row, later - 1]
        tours.nodes[row, gap] = insertions.nodes[row, line, 0]
        tours.lengths[row] += 1
        tours.lengths[left] -= 1
        tours.nodes[left, place] = tours.nodes[left, tours.lengths[left]]
        update_row(tours, tables, row)
        update_row(tours, tables, left)
        sum_rows(tours, tables)
        _update_insertions(insertions, tours, tables, row, gap)
