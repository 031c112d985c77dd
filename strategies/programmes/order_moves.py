"""Which moves the search for programmes considers: only nodes that are near one another are joined.

A segment is moved, reversed or left, or two tractors exchange the ends of their tours. Only what is near a change is
looked at again (don't-look bits, Bentley 1992). All moves near a line are listed first and then weighed in one loop:
calls that pass all that is known of tours would take longer than the arithmetic.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from strategies.programmes.order_tours import (
    BEGIN,
    FIRST,
    FOURTH,
    MIN_GAIN_S,
    NO_ROW,
    ONWARD,
    REVERSED,
    RULE_S,
    SECOND,
    SIDE_A,
    SIDE_B,
    THIRD,
    can_make_move,
    charge_new_excess,
    clear_pieces,
    count_new_clashes,
    make_move,
    pop_line,
    push_line,
    set_piece,
    weigh_tours,
)
from vehicle.jit import compile_for_views, compile_inlined

MAX_SEGMENT_LINES = 3  # in a segment that is moved; any number may be reversed or change tractors at the end of a tour
TAILS: Any = np.int64(-1)  # stands for the last place of a segment in a move that exchanges tails


@compile_for_views
def list_transfer(moves, a, low, high, is_reversed, b, gap) -> None:  # type: ignore[no-untyped-def]
    """List moving the places low..high of row a before place `gap` of row b (Or 1976), reversed or not.

    Within one row, a gap at `low` reverses the segment where it is. Out of or into the lines that are left as well.
    """
    if low > high or (a == b and (low < gap <= high or gap == high + 1 or (gap == low and not is_reversed))):
        return
    moves[0, 0] += 1
    move = moves[moves[0, 0]]
    move[0], move[1], move[2], move[3], move[4], move[5] = a, low, high, is_reversed, b, gap


@compile_for_views
def _list_tails(moves, a, p, b, q, is_reversed) -> None:  # type: ignore[no-untyped-def]
    """List that two tractors change places (2-opt*, Potvin and Rousseau 1995).

    Row a goes on with row b's places from q when it has come to p, and b with a's from p. Reversed: a goes on with what
    b has before q, the other way round, and b begins with what a had from p, the other way round, and goes on from q.
    """
    moves[0, 0] += 1
    move = moves[moves[0, 0]]
    move[0], move[1], move[2], move[3], move[4], move[5] = a, p, TAILS, is_reversed, b, q


@compile_for_views
def time_join(tables, row, u, v):  # type: ignore[no-untyped-def]
    """Seconds from node u to node v in the tour of a row; u < 0: from the entrance, v < 0: home."""
    seconds = 0.0
    if u >= 0 and v >= 0:
        seconds = tables.move_s[u, v]
    elif v >= 0:
        seconds = tables.begin_s[row, v]
    elif u >= 0:
        seconds = tables.end_s[row, u]
    return seconds


@compile_for_views
def get_node(tours, row, place):  # type: ignore[no-untyped-def]
    """The node at a place of a tour; -1 before its begin and after its end."""
    return tours.nodes[row, place] if 0 <= place < tours.lengths[row] else NO_ROW


@compile_for_views
def _time_segment(tours, row, low, high, is_reversed):  # type: ignore[no-untyped-def]
    """Seconds of a segment without the work on the line at `low`, driven either way round."""
    if is_reversed:
        seconds = tours.backward_s[row, high] - tours.backward_s[row, low]
    else:
        seconds = tours.onward_s[row, high] - tours.onward_s[row, low]
    return seconds


@compile_for_views
def _time_spliced(tours, tables, row, a, low_a, high_a, turns_a, b, low_b, high_b, turns_b):  # type: ignore[no-untyped-def]
    """Seconds of a row's tour that is made of a segment of row a and then one of row b; low > high: none."""
    seconds, last = 0.0, NO_ROW
    if low_a <= high_a:
        first = tours.nodes[a, high_a] ^ 1 if turns_a else tours.nodes[a, low_a]
        last = tours.nodes[a, low_a] ^ 1 if turns_a else tours.nodes[a, high_a]
        seconds = tables.work_s[tours.nodes[a, low_a] // 2] + _time_segment(tours, a, low_a, high_a, turns_a)
        seconds += tables.begin_s[row, first]
    if low_b <= high_b:
        first = tours.nodes[b, high_b] ^ 1 if turns_b else tours.nodes[b, low_b]
        seconds += tables.work_s[tours.nodes[b, low_b] // 2] + _time_segment(tours, b, low_b, high_b, turns_b)
        seconds += time_join(tables, row, last, first)
        last = tours.nodes[b, low_b] ^ 1 if turns_b else tours.nodes[b, high_b]
    return seconds + time_join(tables, row, last, NO_ROW)


@compile_for_views
def _weigh_rows(tours, tables, a, new_a_s, b, new_b_s, left_s):  # type: ignore[no-untyped-def]
    """The cost when the tours of rows a and b (or of one) take so long and lines of this value are left."""
    left = len(tours.seconds) - 1
    total_s, longest_s = tours.total_s[0], 0.0
    if a != left:
        total_s, longest_s = total_s + new_a_s - tours.seconds[a], new_a_s
    if b != left and b != a:
        total_s, longest_s = total_s + new_b_s - tours.seconds[b], max(longest_s, new_b_s)
    for number in range(3):
        row = tours.longest[number]
        if row >= 0 and row != a and row != b:
            longest_s = max(longest_s, tours.seconds[row])
            break
    return (1.0 - tables.sum_share) * longest_s + tables.sum_share * total_s + left_s


@compile_inlined
def _weigh_transfer(tours, tables, move):  # type: ignore[no-untyped-def]
    """The cost after a transfer."""
    left = len(tours.seconds) - 1
    a, low, high, is_reversed, b, gap = move[0], move[1], move[2], move[3] != 0, move[4], move[5]
    first, last = tours.nodes[a, low], tours.nodes[a, high]
    before, after = get_node(tours, a, low - 1), get_node(tours, a, high + 1)
    work_s = tables.work_s[first // 2]
    onward_s, driven_s = _time_segment(tours, a, low, high, ONWARD), _time_segment(tours, a, low, high, is_reversed)
    new_first, new_last = (last ^ 1, first ^ 1) if is_reversed else (first, last)
    new_a_s, new_b_s, left_s = tours.seconds[a], tours.seconds[b], tours.seconds[left]
    if a != left:
        new_a_s -= time_join(tables, a, before, first) + time_join(tables, a, last, after)
        if a != b or gap != low:
            new_a_s += time_join(tables, a, before, after)
    if b != left:
        u, v = (before, after) if a == b and gap == low else (get_node(tours, b, gap - 1), get_node(tours, b, gap))
        added_s = time_join(tables, b, u, new_first) + time_join(tables, b, new_last, v)
        if a != b or gap != low:
            added_s -= time_join(tables, b, u, v)
        if a == b:
            new_a_s += added_s + driven_s - onward_s
        else:
            new_b_s += added_s + driven_s + work_s
    if a != b:
        if a == left or b == left:
            sign = -1.0 if a == left else 1.0
            for place in range(low, high + 1):
                left_s += sign * tables.value_s[tours.nodes[a, place] // 2]
        if a != left:
            new_a_s -= onward_s + work_s
    return _weigh_rows(tours, tables, a, new_a_s, b, new_b_s, left_s)


@compile_inlined
def _weigh_tails(tours, tables, move):  # type: ignore[no-untyped-def]
    """The cost after two tractors have exchanged their tails."""
    a, p, is_reversed, b, q = move[0], move[1], move[3] != 0, move[4], move[5]
    end_a, end_b = tours.lengths[a] - 1, tours.lengths[b] - 1
    if is_reversed:
        new_a_s = _time_spliced(tours, tables, a, a, BEGIN, p - 1, ONWARD, b, BEGIN, q - 1, REVERSED)
        new_b_s = _time_spliced(tours, tables, b, a, p, end_a, REVERSED, b, q, end_b, ONWARD)
    else:
        new_a_s = _time_spliced(tours, tables, a, a, BEGIN, p - 1, ONWARD, b, q, end_b, ONWARD)
        new_b_s = _time_spliced(tours, tables, b, b, BEGIN, q - 1, ONWARD, a, p, end_a, ONWARD)
    return _weigh_rows(tours, tables, a, new_a_s, b, new_b_s, tours.seconds[len(tours.seconds) - 1])


@compile_for_views
def make_best_move(tours, tables, cost) -> bool:  # type: ignore[no-untyped-def]
    """Make the best of the listed moves that cost less than the tours do; whether there was one."""
    best, best_cost = 0, cost
    for number in range(1, tours.moves[0, 0] + 1):
        move = tours.moves[number]
        new_cost = _weigh_tails(tours, tables, move) if move[2] == TAILS else _weigh_transfer(tours, tables, move)
        if new_cost < best_cost - MIN_GAIN_S:
            _set_listed(tours, move)
            new_cost += RULE_S * count_new_clashes(tours, tables) + charge_new_excess(tours, tables)
            if new_cost < best_cost - MIN_GAIN_S and can_make_move(tours, tables):
                best, best_cost = number, new_cost
    if best > 0:
        _set_listed(tours, tours.moves[best])
        make_move(tours, tables)
    tours.moves[0, 0] = 0
    return best > 0


@compile_for_views
def _set_listed(tours, move) -> None:  # type: ignore[no-untyped-def]
    """Set the segments that a listed move makes tours of."""
    set_move(tours, move[0], move[1], move[2], move[3], move[4], move[5])


@compile_for_views
def set_move(tours, a, low, high, is_reversed, b, gap) -> None:  # type: ignore[no-untyped-def]
    """Set the segments that a move makes tours of, as list_transfer and _list_tails take it."""
    end_a, end_b = tours.lengths[a] - 1, tours.lengths[b] - 1
    clear_pieces(tours, a, NO_ROW if a == b else b)
    if high == TAILS:
        set_piece(tours, SIDE_A, FIRST, a, BEGIN, low - 1, ONWARD)
        if is_reversed:
            set_piece(tours, SIDE_A, SECOND, b, BEGIN, gap - 1, REVERSED)
            set_piece(tours, SIDE_B, FIRST, a, low, end_a, REVERSED)
            set_piece(tours, SIDE_B, SECOND, b, gap, end_b, ONWARD)
        else:
            set_piece(tours, SIDE_A, SECOND, b, gap, end_b, ONWARD)
            set_piece(tours, SIDE_B, FIRST, b, BEGIN, gap - 1, ONWARD)
            set_piece(tours, SIDE_B, SECOND, a, low, end_a, ONWARD)
    elif a != b:
        set_piece(tours, SIDE_A, FIRST, a, BEGIN, low - 1, ONWARD)
        set_piece(tours, SIDE_A, SECOND, a, high + 1, end_a, ONWARD)
        set_piece(tours, SIDE_B, FIRST, b, BEGIN, gap - 1, ONWARD)
        set_piece(tours, SIDE_B, SECOND, a, low, high, is_reversed)
        set_piece(tours, SIDE_B, THIRD, b, gap, end_b, ONWARD)
    elif gap <= low:
        set_piece(tours, SIDE_A, FIRST, a, BEGIN, gap - 1, ONWARD)
        set_piece(tours, SIDE_A, SECOND, a, low, high, is_reversed)
        set_piece(tours, SIDE_A, THIRD, a, gap, low - 1, ONWARD)
        set_piece(tours, SIDE_A, FOURTH, a, high + 1, end_a, ONWARD)
    else:
        set_piece(tours, SIDE_A, FIRST, a, BEGIN, low - 1, ONWARD)
        set_piece(tours, SIDE_A, SECOND, a, high + 1, gap - 1, ONWARD)
        set_piece(tours, SIDE_A, THIRD, a, low, high, is_reversed)
        set_piece(tours, SIDE_A, FOURTH, a, gap, end_a, ONWARD)


@compile_for_views
def _time_step(tours, tables, a, p):  # type: ignore[no-untyped-def]
    """Seconds of the step to place p of a row from the one before: from the entrance, or home, where there is none."""
    return time_join(tables, a, get_node(tours, a, p - 1), get_node(tours, a, p))


@compile_for_views
def _get_slack_s(tours, a, b):  # type: ignore[no-untyped-def]
    """Seconds that a move between two tours may add to their sum and still shorten the longest of all."""
    is_longest = a != b and (a == tours.longest[0] or b == tours.longest[0])
    return abs(tours.seconds[a] - tours.seconds[b]) if is_longest else 0.0


@compile_for_views
def _list_after(tours, tables, a, p) -> None:  # type: ignore[no-untyped-def]
    """List the moves that let a near node follow place p of row a by a cheaper step than the one there."""
    u, step_s = tours.nodes[a, p], _time_step(tours, tables, a, p + 1)
    for number in range(tables.after.shape[1]):
        v = tables.after[u, number]
        b, q = tours.row_of[v // 2], tours.place_of[v // 2]
        is_onward = tours.nodes[b, q] == v
        if b == len(tours.seconds) - 1:
            list_transfer(tours.moves, b, q, q, not is_onward, a, p + 1)
        elif tables.move_s[u, v] < step_s + _get_slack_s(tours, a, b):
            for more in range(MAX_SEGMENT_LINES):
                if is_onward and q + more < tours.lengths[b]:
                    list_transfer(tours.moves, b, q, q + more, ONWARD, a, p + 1)
                if is_onward and p - more >= 0:
                    list_transfer(tours.moves, a, p - more, p, ONWARD, b, q)
                if not is_onward and q - more >= 0:
                    list_transfer(tours.moves, b, q - more, q, REVERSED, a, p + 1)
            if a != b:
                _list_tails(tours.moves, a, p + 1, b, q if is_onward else q + 1, not is_onward)
            elif not is_onward and q > p:
                list_transfer(tours.moves, a, p + 1, q, REVERSED, a, p + 1)


@compile_for_views
def _list_before(tours, tables, a, p) -> None:  # type: ignore[no-untyped-def]
    """List the moves that let a near node precede place p of row a by a cheaper step than the one there."""
    u, step_s = tours.nodes[a, p], _time_step(tours, tables, a, p)
    for number in range(tables.before.shape[1]):
        v = tables.before[u, number]
        b, q = tours.row_of[v // 2], tours.place_of[v // 2]
        is_onward = tours.nodes[b, q] == v
        if b == len(tours.seconds) - 1:
            list_transfer(tours.moves, b, q, q, not is_onward, a, p)
        elif tables.move_s[v, u] < step_s + _get_slack_s(tours, a, b):
            for more in range(MAX_SEGMENT_LINES):
                if is_onward and q - more >= 0:
                    list_transfer(tours.moves, b, q - more, q, ONWARD, a, p)
                if is_onward and p + more < tours.lengths[a]:
                    list_transfer(tours.moves, a, p, p + more, ONWARD, b, q + 1)
                if not is_onward and q + more < tours.lengths[b]:
                    list_transfer(tours.moves, b, q, q + more, REVERSED, a, p)
            if a != b and is_onward:
                _list_tails(tours.moves, b, q + 1, a, p, ONWARD)
            elif a != b:
                _list_tails(tours.moves, b, q, a, p, REVERSED)
            elif not is_onward and q < p:
                list_transfer(tours.moves, a, q, p - 1, REVERSED, a, q)


@compile_for_views
def _list_turned(tours, tables, a, p) -> None:  # type: ignore[no-untyped-def]
    """List the moves that turn the line at place p of row a round and let a near node follow or precede it."""
    left, turned = len(tours.seconds) - 1, tours.nodes[a, p] ^ 1
    step_s = max(_time_step(tours, tables, a, p), _time_step(tours, tables, a, p + 1))
    for number in range(tables.after.shape[1]):
        v = tables.after[turned, number]
        b, q = tours.row_of[v // 2], tours.place_of[v // 2]
        if b != left and tours.nodes[b, q] == v and tables.move_s[turned, v] < step_s + _get_slack_s(tours, a, b):
            for more in range(min(MAX_SEGMENT_LINES, tours.lengths[a] - p)):
                list_transfer(tours.moves, a, p, p + more, REVERSED, b, q)
            if a != b:
                _list_tails(tours.moves, a, p, b, q, REVERSED)
            elif q > p:
                list_transfer(tours.moves, a, p, q - 1, REVERSED, a, p)
        v = tables.before[turned, number]
        b, q = tours.row_of[v // 2], tours.place_of[v // 2]
        if b != left and tours.nodes[b, q] == v and tables.move_s[v, turned] < step_s + _get_slack_s(tours, a, b):
            for more in range(min(MAX_SEGMENT_LINES, p + 1)):
                list_transfer(tours.moves, a, p - more, p, REVERSED, b, q + 1)
            if a != b:
                _list_tails(tours.moves, b, q + 1, a, p + 1, REVERSED)
            elif q < p:
                list_transfer(tours.moves, a, q + 1, p, REVERSED, a, q + 1)


@compile_for_views
def _list_ends(tours, tables, a, p) -> None:  # type: ignore[no-untyped-def]
    """List segments at place p at the begin or end of any tour, left, or reversed up to the ends of their own."""
    left, length, u = len(tours.seconds) - 1, tours.lengths[a], tours.nodes[a, p]
    steps_s = _time_step(tours, tables, a, p) + _time_step(tours, tables, a, p + 1)
    for b in range(left):
        end_b, limit_s = tours.lengths[b], steps_s + _get_slack_s(tours, a, b)
        for more in range(1 - MAX_SEGMENT_LINES, MAX_SEGMENT_LINES):
            low, high = min(p, p + more), max(p, p + more)
            if low < 0 or high >= length:
                continue
            if low == p and tables.begin_s[b, u] < limit_s:
                list_transfer(tours.moves, a, low, high, ONWARD, b, BEGIN)
            if high == p and tables.begin_s[b, u ^ 1] < limit_s:
                list_transfer(tours.moves, a, low, high, REVERSED, b, BEGIN)
            if high == p and tables.end_s[b, u] < limit_s:
                list_transfer(tours.moves, a, low, high, ONWARD, b, end_b)
            if low == p and tables.end_s[b, u ^ 1] < limit_s:
                list_transfer(tours.moves, a, low, high, REVERSED, b, end_b)
        if b != a and a == tours.longest[0]:
            for is_reversed in (ONWARD, REVERSED):
                _list_tails(tours.moves, a, p, b, end_b, is_reversed)
                _list_tails(tours.moves, a, p + 1, b, BEGIN, is_reversed)
    for high in range(p, min(p + MAX_SEGMENT_LINES, length)):
        list_transfer(tours.moves, a, p, high, ONWARD, left, tours.lengths[left])
    list_transfer(tours.moves, a, p, length - 1, REVERSED, a, p)
    list_transfer(tours.moves, a, p + 1, length - 1, REVERSED, a, p + 1)
    list_transfer(tours.moves, a, BEGIN, p, REVERSED, a, BEGIN)
    list_transfer(tours.moves, a, BEGIN, p - 1, REVERSED, a, BEGIN)


@compile_for_views
def _list_insertions(tours, tables, line) -> None:  # type: ignore[no-untyped-def]
    """List working a line that is left: beside the nodes near it, or at the begin or end of a tour."""
    left = len(tours.seconds) - 1
    q = tours.place_of[line]
    for node in (2 * line, 2 * line + 1):
        is_reversed = tours.nodes[left, q] != node
        for row in range(left):
            list_transfer(tours.moves, left, q, q, is_reversed, row, BEGIN)
            list_transfer(tours.moves, left, q, q, is_reversed, row, tours.lengths[row])
        for number in range(tables.after.shape[1]):
            u, v = tables.before[node, number], tables.after[node, number]
            row, place = tours.row_of[u // 2], tours.place_of[u // 2]
            if row != left and tours.nodes[row, place] == u:
                list_transfer(tours.moves, left, q, q, is_reversed, row, place + 1)
            row, place = tours.row_of[v // 2], tours.place_of[v // 2]
            if row != left and tours.nodes[row, place] == v:
                list_transfer(tours.moves, left, q, q, is_reversed, row, place)


@compile_for_views
def improve_tours(tours, tables) -> float:  # type: ignore[no-untyped-def]
    """Make the best move near each queued line until none helps; returns the cost of the tours then."""
    left = len(tours.seconds) - 1
    cost = weigh_tours(tours, tables)
    while tours.queue_state[1] > 0:
        line = pop_line(tours)
        a, p = tours.row_of[line], tours.place_of[line]
        if a == left:
            _list_insertions(tours, tables, line)
        else:
            _list_after(tours, tables, a, p)
            _list_before(tours, tables, a, p)
            _list_turned(tours, tables, a, p)
            _list_ends(tours, tables, a, p)
        if make_best_move(tours, tables, cost):
            push_line(tours, line)
            cost = weigh_tours(tours, tables)
    return cost
