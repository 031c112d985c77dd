"""Tours of a programme while it is searched: what is known of them, and what a move would make of them.

A tour is a row of nodes: node 2 i is work line i driven forward, 2 i + 1 backward. The row after the last tractor's
holds the lines that are left. A move gives one or two rows new contents, made of segments of the old ones, its pieces.
Seconds summed along a tour, and along it driven the other way round, make it cheap to weigh, however long the segments
are (Kindervater and Savelsbergh 1997).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vehicle.jit import compile_function, drop_owner

SUM_SHARE = 0.1  # of a second of work of a tractor that does not finish last: fuel and wages beside the finish time
NO_MOVE_S = 1e8  # charged where no move leads: more than all lines are worth, little enough to add up exactly to 1e-4 s
POSSIBLE_S = 1e6  # seconds from which on a move counts as none
MIN_GAIN_S = 1e-3  # above the rounding of sums of NO_MOVE_S
PIECES = 4  # segments of which a move makes a tour
# NumPy's values: for every Python constant passed on, the called function would be compiled once more.
ONWARD: Any = np.bool_(False)
REVERSED: Any = np.bool_(True)
NO_ROW: Any = np.int64(-1)
BEGIN: Any = np.int64(0)
SIDE_A, SIDE_B = BEGIN, np.int64(1)
FIRST, SECOND, THIRD, FOURTH = BEGIN, np.int64(1), np.int64(2), np.int64(3)


class OrderTables(NamedTuple):
    """The problem as the search reads it.

    Seconds of moves (2 n, 2 n), of ways in and home (k, 2 n) and of work (n,), what a line is worth (n,), which tractor
    may work it (k, n), and the nodes that most cheaply follow or precede each node (2 n, neighbours).
    """

    move_s: Any
    begin_s: Any
    end_s: Any
    work_s: Any
    value_s: Any
    allowed: Any
    after: Any
    before: Any


class Tours(NamedTuple):
    """Tours (k + 1, n) with their lengths, and what is known of them.

    `onward_s` and `backward_s` (k + 1, n): seconds from the begin of a tour up to the end of a place, and those of the
    same lines driven the other way round. `seconds` (k + 1,): those of the tours; last the value of the lines left.
    `longest` (3,): the tractors that finish last. `total_s` (1,): the sum of all. `row_of` and `place_of` (n,): where a
    line is. `queue` (n,): a ring of lines near changes, `queue_state` (2,) its begin and length, `queued` (n,) what is
    in it. `pieces` (2, PIECES, 4): the move that is weighed, for either row its segments: row, low, high, whether
    reversed. `best_pieces`: the best so far, for `best_rows` (2,), at `best_cost` (1,). `touched` (k + 1,): rows that
    have changed.
    """

    nodes: Any
    lengths: Any
    onward_s: Any
    backward_s: Any
    seconds: Any
    longest: Any
    total_s: Any
    row_of: Any
    place_of: Any
    queue: Any
    queue_state: Any
    queued: Any
    pieces: Any
    best_pieces: Any
    best_rows: Any
    best_cost: Any
    scratch: Any
    touched: Any


def create_tours(k: int, n: int) -> tuple[Any, ...]:
    """The arrays of tours of k tractors and n lines, with every line left."""
    nodes = np.zeros((k + 1, n), np.int64)
    nodes[k] = 2 * np.arange(n)
    lengths = np.zeros(k + 1, np.int64)
    lengths[k] = n
    return tuple(
        Tours(
            nodes=nodes,
            lengths=lengths,
            onward_s=np.zeros((k + 1, n)),
            backward_s=np.zeros((k + 1, n)),
            seconds=np.zeros(k + 1),
            longest=np.zeros(3, np.int64),
            total_s=np.zeros(1),
            row_of=np.full(n, k),
            place_of=np.arange(n),
            queue=np.zeros(n, np.int64),
            queue_state=np.zeros(2, np.int64),
            queued=np.zeros(n, np.bool_),
            pieces=np.zeros((2, PIECES, 4), np.int64),
            best_pieces=np.zeros((2, PIECES, 4), np.int64),
            best_rows=np.zeros(2, np.int64),
            best_cost=np.zeros(1),
            scratch=np.zeros((2, n), np.int64),
            touched=np.zeros(k + 1, np.bool_),
        )
    )


@compile_function
def borrow_tours(arrays):  # type: ignore[no-untyped-def]
    """Tours of arrays that the caller keeps, so that nobody counts references to them."""
    return Tours(
        drop_owner(arrays[0]),
        drop_owner(arrays[1]),
        drop_owner(arrays[2]),
        drop_owner(arrays[3]),
        drop_owner(arrays[4]),
        drop_owner(arrays[5]),
        drop_owner(arrays[6]),
        drop_owner(arrays[7]),
        drop_owner(arrays[8]),
        drop_owner(arrays[9]),
        drop_owner(arrays[10]),
        drop_owner(arrays[11]),
        drop_owner(arrays[12]),
        drop_owner(arrays[13]),
        drop_owner(arrays[14]),
        drop_owner(arrays[15]),
        drop_owner(arrays[16]),
        drop_owner(arrays[17]),
    )


@compile_function
def borrow_tables(arrays):  # type: ignore[no-untyped-def]
    """Tables of arrays that the caller keeps."""
    return OrderTables(
        drop_owner(arrays[0]),
        drop_owner(arrays[1]),
        drop_owner(arrays[2]),
        drop_owner(arrays[3]),
        drop_owner(arrays[4]),
        drop_owner(arrays[5]),
        drop_owner(arrays[6]),
        drop_owner(arrays[7]),
    )


@compile_function
def update_row(tours, tables, row) -> None:  # type: ignore[no-untyped-def]
    """Bring all that is known of a tour up to date with its nodes."""
    nodes, onward_s, backward_s = tours.nodes[row], tours.onward_s[row], tours.backward_s[row]
    length, left = tours.lengths[row], len(tours.lengths) - 1
    tours.touched[row] = True
    for place in range(length):
        line = nodes[place] // 2
        tours.row_of[line], tours.place_of[line] = row, place
    if row == left:
        worth_s = 0.0
        for place in range(length):
            worth_s += tables.value_s[nodes[place] // 2]
            onward_s[place] = backward_s[place] = 0.0
        tours.seconds[row] = worth_s
        return
    onward = backward = 0.0
    for place in range(length):
        node = nodes[place]
        if place > 0:
            onward += tables.move_s[nodes[place - 1], node]
            backward += tables.move_s[node ^ 1, nodes[place - 1] ^ 1]
        onward += tables.work_s[node // 2]
        backward += tables.work_s[node // 2]
        onward_s[place], backward_s[place] = onward, backward
    tours.seconds[row] = 0.0
    if length > 0:
        tours.seconds[row] = tables.begin_s[row, nodes[0]] + onward + tables.end_s[row, nodes[length - 1]]


@compile_function
def sum_rows(tours) -> None:  # type: ignore[no-untyped-def]
    """Note the three tractors that finish last (-1 where there are fewer), and the seconds of all."""
    first = second = third = NO_ROW
    tours.total_s[0] = 0.0
    for row in range(len(tours.seconds) - 1):
        tours.total_s[0] += tours.seconds[row]
        if first < 0 or tours.seconds[row] > tours.seconds[first]:
            first, second, third = row, first, second
        elif second < 0 or tours.seconds[row] > tours.seconds[second]:
            second, third = row, second
        elif third < 0 or tours.seconds[row] > tours.seconds[third]:
            third = row
    tours.longest[0], tours.longest[1], tours.longest[2] = first, second, third


@compile_function
def weigh_tours(tours) -> float:  # type: ignore[no-untyped-def]
    """The cost of the tours as they are."""
    longest_s = tours.seconds[tours.longest[0]]
    return (1.0 - SUM_SHARE) * longest_s + SUM_SHARE * tours.total_s[0] + tours.seconds[len(tours.seconds) - 1]  # type: ignore[no-any-return]


@compile_function
def set_piece(tours, side, number, row, low, high, is_reversed) -> None:  # type: ignore[no-untyped-def]
    """Let a segment of a tour be part of the move; low > high: none."""
    piece = tours.pieces[side, number]
    piece[0], piece[1], piece[2], piece[3] = row, low, high, is_reversed


@compile_function
def _time_pieces(tours, tables, side, row) -> float:  # type: ignore[no-untyped-def]
    """Seconds of a tractor's tour that is made of the pieces of one side."""
    last, seconds = NO_ROW, 0.0
    for number in range(PIECES):
        piece = tours.pieces[side, number]
        source, low, high = piece[0], piece[1], piece[2]
        if low > high:
            continue
        first, end, sums = tours.nodes[source, low], tours.nodes[source, high], tours.onward_s
        if piece[3]:
            first, end, sums = end ^ 1, first ^ 1, tours.backward_s
        seconds += tables.begin_s[row, first] if last < 0 else tables.move_s[last, first]
        seconds += sums[source, high] - sums[source, low] + tables.work_s[tours.nodes[source, low] // 2]
        last = end
    return seconds + tables.end_s[row, last] if last >= 0 else 0.0


@compile_function
def _is_allowed(tours, tables, side, row) -> bool:  # type: ignore[no-untyped-def]
    """Whether a tractor may work all lines that the pieces bring from elsewhere."""
    if row == len(tours.seconds) - 1:
        return True
    for number in range(PIECES):
        source, low, high = tours.pieces[side, number, 0], tours.pieces[side, number, 1], tours.pieces[side, number, 2]
        if source == row:
            continue
        for place in range(low, high + 1):
            if not tables.allowed[row, tours.nodes[source, place] // 2]:
                return False
    return True


@compile_function
def can_make_move(tours, tables, a, b) -> bool:  # type: ignore[no-untyped-def]
    """Whether both tractors of a move (b < 0: only one) may work what they get."""
    return _is_allowed(tours, tables, SIDE_A, a) and (b < 0 or _is_allowed(tours, tables, SIDE_B, b))


@compile_function
def note_move(tours, a, b, cost) -> None:  # type: ignore[no-untyped-def]
    """Keep the pieces as the best move so far: side A makes the tour of row a, side B that of row b (-1: none)."""
    tours.best_rows[0], tours.best_rows[1], tours.best_cost[0] = a, b, cost
    for side in range(2):
        for number in range(PIECES):
            for value in range(4):
                tours.best_pieces[side, number, value] = tours.pieces[side, number, value]


@compile_function
def consider_move(tours, tables, a, b, left_s) -> None:  # type: ignore[no-untyped-def]
    """Keep the pieces as the best move if it costs less; `left_s` is the value of the lines left by then."""
    left = len(tours.seconds) - 1
    new_a = 0.0 if a == left else _time_pieces(tours, tables, SIDE_A, a)
    new_b = 0.0 if b == left or b < 0 else _time_pieces(tours, tables, SIDE_B, b)
    longest_s = max(new_a, new_b)
    for number in range(3):
        row = tours.longest[number]
        if row >= 0 and row != a and row != b:
            longest_s = max(longest_s, tours.seconds[row])
            break
    total_s = tours.total_s[0] + new_a + new_b
    if a != left:
        total_s -= tours.seconds[a]
    if b >= 0 and b != left:
        total_s -= tours.seconds[b]
    cost = (1.0 - SUM_SHARE) * longest_s + SUM_SHARE * total_s + left_s
    if cost < tours.best_cost[0] - MIN_GAIN_S and can_make_move(tours, tables, a, b):
        note_move(tours, a, b, cost)


@compile_function
def push_line(tours, line) -> None:  # type: ignore[no-untyped-def]
    """Queue a line whose surroundings have changed."""
    if not tours.queued[line]:
        tours.queued[line] = True
        tours.queue[(tours.queue_state[0] + tours.queue_state[1]) % len(tours.queue)] = line
        tours.queue_state[1] += 1


@compile_function
def pop_line(tours) -> int:  # type: ignore[no-untyped-def]
    """The line that has been queued longest."""
    line = tours.queue[tours.queue_state[0]]
    tours.queue_state[0] = (tours.queue_state[0] + 1) % len(tours.queue)
    tours.queue_state[1] -= 1
    tours.queued[line] = False
    return line  # type: ignore[no-any-return]


@compile_function
def make_best_move(tours, tables) -> None:  # type: ignore[no-untyped-def]
    """Make the move that is noted, and queue the lines at the ends of its segments."""
    lengths = [BEGIN, BEGIN]
    for side in range(2):
        if tours.best_rows[side] < 0:
            continue
        for number in range(PIECES):
            piece = tours.best_pieces[side, number]
            source, low, high = piece[0], piece[1], piece[2]
            for step in range(high - low + 1):
                node = tours.nodes[source, high - step] ^ 1 if piece[3] else tours.nodes[source, low + step]
                tours.scratch[side, lengths[side]] = node
                lengths[side] += 1
            if low <= high:
                push_line(tours, tours.nodes[source, low] // 2)
                push_line(tours, tours.nodes[source, high] // 2)
    for side in range(2):
        row = tours.best_rows[side]
        if row >= 0:
            tours.lengths[row] = lengths[side]
            for place in range(lengths[side]):
                tours.nodes[row, place] = tours.scratch[side, place]
            update_row(tours, tables, row)
    sum_rows(tours)
