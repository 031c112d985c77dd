"""Runs of lines of any length in the search for programmes: left where they cost more than they are worth, or turned.

Moves of the search turn the order of a run round and each of its lines with it. On neighbouring tracks driven to and
fro it may pay to turn only the order, or only the lines.
"""

from __future__ import annotations

from strategies.programmes.order_moves import get_node, set_move, time_join
from strategies.programmes.order_tours import (
    BEGIN,
    MIN_GAIN_S,
    NO_ROW,
    ONWARD,
    RULE_S,
    count_new_clashes,
    make_move,
    push_line,
    sum_rows,
    update_row,
)
from vehicle.jit import compile_for_views


@compile_for_views
def _find_others_s(tours, row) -> float:  # type: ignore[no-untyped-def]
    """When the last of all other tractors finishes."""
    others_s = 0.0
    for other in range(len(tours.seconds) - 1):
        if other != row:
            others_s = max(others_s, tours.seconds[other])
    return others_s


@compile_for_views
def _weigh_saving(tours, tables, row, others_s, saved_s) -> float:  # type: ignore[no-untyped-def]
    """By how much the cost falls if a tour becomes shorter by so many seconds."""
    finish_s = max(tours.seconds[row], others_s) - max(tours.seconds[row] - saved_s, others_s)
    return (1.0 - tables.sum_share) * finish_s + tables.sum_share * saved_s  # type: ignore[no-any-return]


@compile_for_views
def _time_run(tours, tables, row, low, high) -> float:  # type: ignore[no-untyped-def]
    """Seconds by which a tour is shorter without its places low..high."""
    nodes = tours.nodes[row]
    before, after = get_node(tours, row, low - 1), get_node(tours, row, high + 1)
    seconds = tours.onward_s[row, high] - tours.onward_s[row, low] + tables.work_s[nodes[low] // 2]
    seconds += time_join(tables, row, before, nodes[low]) + time_join(tables, row, nodes[high], after)
    return seconds - time_join(tables, row, before, after)  # type: ignore[no-any-return]


@compile_for_views
def drop_runs(tours, tables) -> None:  # type: ignore[no-untyped-def]
    """Leave runs of lines of any length that cost more than they are worth, among them all that no move reaches."""
    left, row = len(tours.seconds) - 1, BEGIN
    while row < left:
        others_s = _find_others_s(tours, row)
        most_gain, best_low, best_high = MIN_GAIN_S, NO_ROW, NO_ROW
        for low in range(tours.lengths[row]):
            worth_s = 0.0
            for high in range(low, tours.lengths[row]):
                worth_s += tables.value_s[tours.nodes[row, high] // 2]
                gain = _weigh_saving(tours, tables, row, others_s, _time_run(tours, tables, row, low, high)) - worth_s
                if gain > most_gain:
                    set_move(tours, row, low, high, ONWARD, left, tours.lengths[left])
                    gain -= RULE_S * (count_new_clashes(tours, tables) - tours.clashes[0])
                if gain > most_gain:
                    most_gain, best_low, best_high = gain, low, high
        if best_low < 0:
            row += 1
            continue
        set_move(tours, row, best_low, best_high, ONWARD, left, tours.lengths[left])
        make_move(tours, tables)


@compile_for_views
def turn_runs(tours, tables) -> None:  # type: ignore[no-untyped-def]
    """Turn each line of a run where it is, or the order of a run whose lines are driven as before, while it helps.

    Where tours may clash, how they begin and end stays.
    """
    spared, row = 1 if tables.clashes.shape[1] > 0 else 0, BEGIN
    while row < len(tours.seconds) - 1:
        nodes, length, others_s = tours.nodes[row], tours.lengths[row], _find_others_s(tours, row)
        most_gain, best_low, best_high, turns_order = MIN_GAIN_S, NO_ROW, NO_ROW, False
        for low in range(spared, length - spared):
            onward_s = turned_s = back_s = 0.0
            before, first = get_node(tours, row, low - 1), nodes[low]
            for high in range(low, length - spared):
                u, v = nodes[high - 1] if high > low else NO_ROW, nodes[high]
                if high > low:
                    onward_s += tables.move_s[u, v]
                    turned_s += tables.move_s[u ^ 1, v ^ 1]
                    back_s += tables.move_s[v, u]
                after = get_node(tours, row, high + 1)
                now_s = time_join(tables, row, before, first) + onward_s + time_join(tables, row, v, after)
                lines_s = time_join(tables, row, before, first ^ 1) + turned_s + time_join(tables, row, v ^ 1, after)
                order_s = time_join(tables, row, before, v) + back_s + time_join(tables, row, first, after)
                gain = _weigh_saving(tours, tables, row, others_s, now_s - min(lines_s, order_s))
                if gain > most_gain:
                    most_gain, best_low, best_high, turns_order = gain, low, high, order_s < lines_s
        if best_low < 0:
            row += 1
            continue
        _turn_run(tours, tables, row, best_low, best_high, turns_order)


@compile_for_views
def _turn_run(tours, tables, row, low, high, turns_order) -> None:  # type: ignore[no-untyped-def]
    """Turn the order of the places low..high of a tour, or each of their lines."""
    nodes = tours.nodes[row]
    if turns_order:
        for step in range((high - low + 1) // 2):
            nodes[low + step], nodes[high - step] = nodes[high - step], nodes[low + step]
    else:
        for place in range(low, high + 1):
            nodes[place] ^= 1
    update_row(tours, tables, row)
    sum_rows(tours, tables)
    for place in (low - 1, low, high, high + 1):
        if 0 <= place < tours.lengths[row]:
            push_line(tours, nodes[place] // 2)
