"""Which moves the search for programmes considers: only nodes that are near one another are joined.

A segment is moved, reversed or left, or two tractors exchange the ends of their tours. Only what is near a change is
looked at again (don't-look bits, Bentley 1992).
"""

from __future__ import annotations

from strategies.programmes.order_tours import (
    BEGIN,
    FIRST,
    FOURTH,
    NO_ROW,
    ONWARD,
    REVERSED,
    SECOND,
    SIDE_A,
    SIDE_B,
    THIRD,
    consider_move,
    make_best_move,
    pop_line,
    push_line,
    set_piece,
    weigh_tours,
)
from vehicle.jit import compile_function

MAX_SEGMENT_LINES = 3  # in a segment that is moved; any number may be reversed or change tractors at the end of a tour
IS_AFTER, IS_BEFORE = REVERSED, ONWARD


@compile_function
def try_transfer(tours, tables, a, low, high, is_reversed, b, gap) -> None:  # type: ignore[no-untyped-def]
    """Consider moving the places low..high of row a before place `gap` of row b (Or 1976), reversed or not.

    Within one row, a gap at `low` reverses the segment where it is. Out of or into the lines that are left as well.
    """
    left = len(tours.seconds) - 1
    end_a, end_b, left_s = tours.lengths[a] - 1, tours.lengths[b] - 1, tours.seconds[left]
    if a == b:
        if low < gap <= high or (not is_reversed and (gap == low or gap == high + 1)):
            return
        if gap <= low:
            set_piece(tours, SIDE_A, FIRST, a, BEGIN, gap - 1, ONWARD)
            set_piece(tours, SIDE_A, SECOND, a, low, high, is_reversed)
            set_piece(tours, SIDE_A, THIRD, a, gap, low - 1, ONWARD)
            set_piece(tours, SIDE_A, FOURTH, a, high + 1, end_a, ONWARD)
        else:
            set_piece(tours, SIDE_A, FIRST, a, BEGIN, low - 1, ONWARD)
            set_piece(tours, SIDE_A, SECOND, a, high + 1, gap - 1, ONWARD)
            set_piece(tours, SIDE_A, THIRD, a, low, high, is_reversed)
            set_piece(tours, SIDE_A, FOURTH, a, gap, end_a, ONWARD)
        consider_move(tours, tables, a, NO_ROW, left_s)
        return
    if a == left or b == left:
        sign = -1.0 if a == left else 1.0
        for place in range(low, high + 1):
            left_s += sign * tables.value_s[tours.nodes[a, place] // 2]
    set_piece(tours, SIDE_A, FIRST, a, BEGIN, low - 1, ONWARD)
    set_piece(tours, SIDE_A, SECOND, a, high + 1, end_a, ONWARD)
    set_piece(tours, SIDE_B, FIRST, b, BEGIN, gap - 1, ONWARD)
    set_piece(tours, SIDE_B, SECOND, a, low, high, is_reversed)
    set_piece(tours, SIDE_B, THIRD, b, gap, end_b, ONWARD)
    for side, number in ((SIDE_A, 2), (SIDE_A, 3), (SIDE_B, 3)):
        tours.pieces[side, number, 1], tours.pieces[side, number, 2] = 1, 0
    consider_move(tours, tables, a, b, left_s)


@compile_function
def try_tails(tours, tables, a, p, b, q, is_reversed) -> None:  # type: ignore[no-untyped-def]
    """Consider that two tractors change places (2-opt*, Potvin and Rousseau 1995).

    Row a goes on with row b's places from q when it has come to p, and b with a's from p. Reversed: a goes on with what
    b has before q, the other way round, and b begins with what a had from p, the other way round, and goes on from q.
    """
    end_a, end_b = tours.lengths[a] - 1, tours.lengths[b] - 1
    set_piece(tours, SIDE_A, FIRST, a, BEGIN, p - 1, ONWARD)
    if is_reversed:
        set_piece(tours, SIDE_A, SECOND, b, BEGIN, q - 1, REVERSED)
        set_piece(tours, SIDE_B, FIRST, a, p, end_a, REVERSED)
        set_piece(tours, SIDE_B, SECOND, b, q, end_b, ONWARD)
    else:
        set_piece(tours, SIDE_A, SECOND, b, q, end_b, ONWARD)
        set_piece(tours, SIDE_B, FIRST, b, BEGIN, q - 1, ONWARD)
        set_piece(tours, SIDE_B, SECOND, a, p, end_a, ONWARD)
    for side, number in ((SIDE_A, 2), (SIDE_A, 3), (SIDE_B, 2), (SIDE_B, 3)):
        tours.pieces[side, number, 1], tours.pieces[side, number, 2] = 1, 0
    consider_move(tours, tables, a, b, tours.seconds[len(tours.seconds) - 1])


@compile_function
def _time_step(tours, tables, a, p) -> float:  # type: ignore[no-untyped-def]
    """Seconds of the step to place p of a row from the one before: from the entrance, or home, where there is none."""
    length = tours.lengths[a]
    if p == 0:
        return tables.begin_s[a, tours.nodes[a, 0]]  # type: ignore[no-any-return]
    if p == length:
        return tables.end_s[a, tours.nodes[a, length - 1]]  # type: ignore[no-any-return]
    return tables.move_s[tours.nodes[a, p - 1], tours.nodes[a, p]]  # type: ignore[no-any-return]


@compile_function
def _get_slack_s(tours, a, b) -> float:  # type: ignore[no-untyped-def]
    """Seconds that a move between two tours may add to their sum and still shorten the longest of all."""
    if a != b and (a == tours.longest[0] or b == tours.longest[0]):
        return abs(tours.seconds[a] - tours.seconds[b])  # type: ignore[no-any-return]
    return 0.0


@compile_function
def _is_promising(tours, tables, a, step_a, b, step_b, new_s) -> bool:  # type: ignore[no-untyped-def]
    """Whether a new step is cheaper than the two that it could replace, with what the longest tour may gain."""
    old_s = _time_step(tours, tables, a, step_a) + _time_step(tours, tables, b, step_b)
    return new_s < old_s + _get_slack_s(tours, a, b)  # type: ignore[no-any-return]


@compile_function
def _try_after(tours, tables, a, p, v) -> None:  # type: ignore[no-untyped-def]
    """Consider the moves that let node v follow place p of row a."""
    b, q = tours.row_of[v // 2], tours.place_of[v // 2]
    if b == len(tours.seconds) - 1:
        try_transfer(tours, tables, b, q, q, tours.nodes[b, q] != v, a, p + 1)
        return
    is_onward = tours.nodes[b, q] == v
    if not _is_promising(tours, tables, a, p + 1, b, q if is_onward else q + 1, tables.move_s[tours.nodes[a, p], v]):
        return
    for more in range(MAX_SEGMENT_LINES):
        if is_onward:
            if q + more < tours.lengths[b]:
                try_transfer(tours, tables, b, q, q + more, ONWARD, a, p + 1)
            if p - more >= 0:
                try_transfer(tours, tables, a, p - more, p, ONWARD, b, q)
        elif q - more >= 0:
            try_transfer(tours, tables, b, q - more, q, REVERSED, a, p + 1)
    if a != b:
        try_tails(tours, tables, a, p + 1, b, q if is_onward else q + 1, not is_onward)
    elif not is_onward and q > p:
        try_transfer(tours, tables, a, p + 1, q, REVERSED, a, p + 1)


@compile_function
def _try_before(tours, tables, a, p, v) -> None:  # type: ignore[no-untyped-def]
    """Consider the moves that let node v precede place p of row a."""
    b, q = tours.row_of[v // 2], tours.place_of[v // 2]
    if b == len(tours.seconds) - 1:
        try_transfer(tours, tables, b, q, q, tours.nodes[b, q] != v, a, p)
        return
    is_onward = tours.nodes[b, q] == v
    if not _is_promising(tours, tables, a, p, b, q + 1 if is_onward else q, tables.move_s[v, tours.nodes[a, p]]):
        return
    for more in range(MAX_SEGMENT_LINES):
        if is_onward:
            if q - more >= 0:
                try_transfer(tours, tables, b, q - more, q, ONWARD, a, p)
            if p + more < tours.lengths[a]:
                try_transfer(tours, tables, a, p, p + more, ONWARD, b, q + 1)
        elif q + more < tours.lengths[b]:
            try_transfer(tours, tables, b, q, q + more, REVERSED, a, p)
    if a != b:
        if is_onward:
            try_tails(tours, tables, b, q + 1, a, p, ONWARD)
        else:
            try_tails(tours, tables, b, q, a, p, REVERSED)
    elif not is_onward and q < p:
        try_transfer(tours, tables, a, q, p - 1, REVERSED, a, q)


@compile_function
def _try_turned(tours, tables, a, p, v, is_after) -> None:  # type: ignore[no-untyped-def]
    """Consider the moves that turn the line at place p of row a round and let node v follow (or precede) it."""
    b, q = tours.row_of[v // 2], tours.place_of[v // 2]
    if b == len(tours.seconds) - 1 or tours.nodes[b, q] != v:
        return
    turned = tours.nodes[a, p] ^ 1
    step, new_s = (0, tables.move_s[turned, v]) if is_after else (1, tables.move_s[v, turned])
    if not _is_promising(tours, tables, a, p + step, b, q + step, new_s):
        return
    for more in range(MAX_SEGMENT_LINES):
        if is_after and p + more < tours.lengths[a]:
            try_transfer(tours, tables, a, p, p + more, REVERSED, b, q)
        elif not is_after and p - more >= 0:
            try_transfer(tours, tables, a, p - more, p, REVERSED, b, q + 1)
    if a != b:
        if is_after:
            try_tails(tours, tables, a, p, b, q, REVERSED)
        else:
            try_tails(tours, tables, b, q + 1, a, p + 1, REVERSED)
    elif is_after and q > p:
        try_transfer(tours, tables, a, p, q - 1, REVERSED, a, p)
    elif not is_after and q < p:
        try_transfer(tours, tables, a, q + 1, p, REVERSED, a, q + 1)


@compile_function
def _try_ends(tours, tables, a, p) -> None:  # type: ignore[no-untyped-def]
    """Consider segments at place p at the begin or end of any tour, left, or reversed up to the ends of their own."""
    left, length, u = len(tours.seconds) - 1, tours.lengths[a], tours.nodes[a, p]
    steps_s = _time_step(tours, tables, a, p) + _time_step(tours, tables, a, p + 1)
    for b in range(left):
        end_b, limit_s = tours.lengths[b], steps_s + _get_slack_s(tours, a, b)
        for more in range(1 - MAX_SEGMENT_LINES, MAX_SEGMENT_LINES):
            low, high = min(p, p + more), max(p, p + more)
            if low < 0 or high >= length:
                continue
            if low == p and tables.begin_s[b, u] < limit_s:
                try_transfer(tours, tables, a, low, high, ONWARD, b, BEGIN)
            if high == p and tables.begin_s[b, u ^ 1] < limit_s:
                try_transfer(tours, tables, a, low, high, REVERSED, b, BEGIN)
            if high == p and tables.end_s[b, u] < limit_s:
                try_transfer(tours, tables, a, low, high, ONWARD, b, end_b)
            if low == p and tables.end_s[b, u ^ 1] < limit_s:
                try_transfer(tours, tables, a, low, high, REVERSED, b, end_b)
        if b != a and a == tours.longest[0]:
            for is_reversed in (ONWARD, REVERSED):
                try_tails(tours, tables, a, p, b, end_b, is_reversed)
                try_tails(tours, tables, a, p + 1, b, BEGIN, is_reversed)
    for high in range(p, min(p + MAX_SEGMENT_LINES, length)):
        try_transfer(tours, tables, a, p, high, ONWARD, left, tours.lengths[left])
    try_transfer(tours, tables, a, p, length - 1, REVERSED, a, p)
    try_transfer(tours, tables, a, p + 1, length - 1, REVERSED, a, p + 1)
    try_transfer(tours, tables, a, BEGIN, p, REVERSED, a, BEGIN)
    try_transfer(tours, tables, a, BEGIN, p - 1, REVERSED, a, BEGIN)


@compile_function
def _try_insertions(tours, tables, line) -> None:  # type: ignore[no-untyped-def]
    """Consider working a line that is left: beside the nodes near it, or at the begin or end of a tour."""
    left = len(tours.seconds) - 1
    q = tours.place_of[line]
    for node in (2 * line, 2 * line + 1):
        is_reversed = tours.nodes[left, q] != node
        for row in range(left):
            try_transfer(tours, tables, left, q, q, is_reversed, row, BEGIN)
            try_transfer(tours, tables, left, q, q, is_reversed, row, tours.lengths[row])
        for number in range(tables.after.shape[1]):
            u, v = tables.before[node, number], tables.after[node, number]
            row, place = tours.row_of[u // 2], tours.place_of[u // 2]
            if row != left and tours.nodes[row, place] == u:
                try_transfer(tours, tables, left, q, q, is_reversed, row, place + 1)
            row, place = tours.row_of[v // 2], tours.place_of[v // 2]
            if row != left and tours.nodes[row, place] == v:
                try_transfer(tours, tables, left, q, q, is_reversed, row, place)


@compile_function
def improve_tours(tours, tables) -> float:  # type: ignore[no-untyped-def]
    """Make the best move near each queued line until none helps; returns the cost of the tours then."""
    left = len(tours.seconds) - 1
    cost = weigh_tours(tours)
    while tours.queue_state[1] > 0:
        line = pop_line(tours)
        tours.best_cost[0] = cost
        a, p = tours.row_of[line], tours.place_of[line]
        if a == left:
            _try_insertions(tours, tables, line)
        else:
            u = tours.nodes[a, p]
            for number in range(tables.after.shape[1]):
                _try_after(tours, tables, a, p, tables.after[u, number])
                _try_before(tours, tables, a, p, tables.before[u, number])
                _try_turned(tours, tables, a, p, tables.after[u ^ 1, number], IS_AFTER)
                _try_turned(tours, tables, a, p, tables.before[u ^ 1, number], IS_BEFORE)
            _try_ends(tours, tables, a, p)
        if tours.best_cost[0] < cost:
            make_best_move(tours, tables)
            push_line(tours, line)
            cost = weigh_tours(tours)
    return cost
