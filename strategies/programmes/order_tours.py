"""Tours of a programme while it is searched: what is known of them, and what a move would make of them.

A tour is a row of nodes: node 2 i is work line i driven forward, 2 i + 1 backward. The row after the last tractor's
holds the lines that are left. A move gives one or two rows new contents, made of segments of the old ones, its pieces.
Seconds summed along a tour, and along it driven the other way round, make it cheap to weigh, however long the segments
are (Kindervater and Savelsbergh 1997).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fields.geometry.arithmetic import ROUNDING
from vehicle.jit import compile_for_views

SUM_SHARE = 0.1  # of a second of work of a tractor that does not finish last: fuel and wages beside the finish time
UNREACHED_S = 1e8  # charged where no move leads: more than all lines are worth, and still adds up exactly to 1e-4 s
RULE_S = 1e6  # a hard rule: dearer than any line is worth, cheaper than a move that does not exist
NO_MOVE_S = RULE_S  # seconds from which on a move counts as none
ANY_WAY_S = 1e4  # more than any way takes
DETOUR_S = 90.0  # guessed for a move that only a search may find, beside its way; charged where two have met
MIN_GAIN_S = 1e-3  # above the rounding of sums of UNREACHED_S
PIECES = 4  # segments of which a move makes a tour
# NumPy's values: for every Python constant passed on, the called function would be compiled once more.
ONWARD: Any = np.bool_(False)
REVERSED: Any = np.bool_(True)
NO_ROW: Any = np.int64(-1)
NEIGHBOURS = 8  # nodes that may follow or precede a node by a move that is considered, and is estimated first
MOVES, MOVES_PER_ROW = 32 * NEIGHBOURS, 32  # weighed at once, at most 23 for each neighbour and 16 for each tour
BEGIN: Any = np.int64(0)
SIDE_A, SIDE_B = BEGIN, np.int64(1)
FIRST, SECOND, THIRD, FOURTH = BEGIN, np.int64(1), np.int64(2), np.int64(3)


class OrderTables(NamedTuple):
    """The problem as the search reads it.

    Seconds of moves (2 n, 2 n), of ways in and home (k, 2 n) and of work (n,), what a line is worth (n,), which tractor
    may work it (k, n), the nodes that most cheaply follow or precede each node (2 n, neighbours), of which nodes no
    two tours may begin or end with both (2, 2 n, 2 n; empty: any may), the share of a load that a line takes (n; empty:
    none), and what a second of the sum of all tours costs.
    """

    move_s: Any
    begin_s: Any
    end_s: Any
    work_s: Any
    value_s: Any
    allowed: Any
    after: Any
    before: Any
    clashes: Any
    need: Any
    sum_share: Any


class Tours(NamedTuple):
    """Tours (k + 1, n) with their lengths, and what is known of them.

    `onward_s` and `backward_s` (k + 1, n): seconds from the begin of a tour up to the end of a place, and those of the
    same lines driven the other way round. `seconds` (k + 1,): those of the tours; last the value of the lines left.
    `longest` (3,): the tractors that finish last. `total_s` (1,): the sum of all. `clashes` (1,): how many pairs of
    tours begin, and end, as no two may. `needs` (k + 1,): the loads that the lines of a row take. `excess` (1,): what
    tours are charged that take more than one. `row_of` and `place_of` (n,): where a line is. `queue` (n,): a ring of
    lines near changes, `queue_state` (2,) its begin and length, `queued` (n,) what is in it. `pieces` (2, PIECES, 4):
    the segments (row, low, high, whether reversed) of which a move makes the two rows `rows` (2,), -1: none. `moves`
    (m, 6): those to be weighed, from the second on; the first holds how many there are. `scratch` (2, n): the rows it
    makes. `touched` (k + 1,): rows that have changed.
    """

    nodes: Any
    lengths: Any
    onward_s: Any
    backward_s: Any
    seconds: Any
    longest: Any
    total_s: Any
    clashes: Any
    needs: Any
    excess: Any
    row_of: Any
    place_of: Any
    queue: Any
    queue_state: Any
    queued: Any
    pieces: Any
    rows: Any
    moves: Any
    scratch: Any
    touched: Any


def create_tours(k: int, n: int) -> Tours:
    """The arrays of tours of k tractors and n lines, with every line left."""
    nodes = np.zeros((k + 1, n), np.int64)
    nodes[k] = 2 * np.arange(n)
    lengths = np.zeros(k + 1, np.int64)
    lengths[k] = n
    return Tours(
        nodes=nodes,
        lengths=lengths,
        onward_s=np.zeros((k + 1, n)),
        backward_s=np.zeros((k + 1, n)),
        seconds=np.zeros(k + 1),
        longest=np.zeros(3, np.int64),
        total_s=np.zeros(1),
        clashes=np.zeros(1, np.int64),
        needs=np.zeros(k + 1),
        excess=np.zeros(1),
        row_of=np.full(n, k),
        place_of=np.arange(n),
        queue=np.zeros(n, np.int64),
        queue_state=np.zeros(2, np.int64),
        queued=np.zeros(n, np.bool_),
        pieces=np.zeros((2, PIECES, 4), np.int64),
        rows=np.zeros(2, np.int64),
        moves=np.zeros((MOVES + MOVES_PER_ROW * (k + 1), 6), np.int64),
        scratch=np.zeros((2, n), np.int64),
        touched=np.zeros(k + 1, np.bool_),
    )


@compile_for_views
def update_row(tours, tables, row) -> None:  # type: ignore[no-untyped-def]
    """Bring all that is known of a tour up to date with its nodes."""
    nodes, onward_s, backward_s = tours.nodes[row], tours.onward_s[row], tours.backward_s[row]
    length, left = tours.lengths[row], len(tours.lengths) - 1
    tours.touched[row] = True
    tours.needs[row] = 0.0
    for place in range(length):
        line = nodes[place] // 2
        tours.row_of[line], tours.place_of[line] = row, place
        if len(tables.need) > 0:
            tours.needs[row] += tables.need[line]
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


@compile_for_views
def _charge_excess(need) -> float:  # type: ignore[no-untyped-def]
    """What a tour is charged whose lines take so many loads (s)."""
    return RULE_S * max(0.0, need - 1.0 - ROUNDING)  # type: ignore[no-any-return]


@compile_for_views
def sum_rows(tours, tables) -> None:  # type: ignore[no-untyped-def]
    """Note the three tractors that finish last (-1: there are fewer), the seconds of all, their clashes and excess."""
    first = second = third = NO_ROW
    tours.total_s[0] = tours.excess[0] = 0.0
    for row in range(len(tours.seconds) - 1):
        tours.total_s[0] += tours.seconds[row]
        tours.excess[0] += _charge_excess(tours.needs[row])
        if first < 0 or tours.seconds[row] > tours.seconds[first]:
            first, second, third = row, first, second
        elif second < 0 or tours.seconds[row] > tours.seconds[second]:
            second, third = row, second
        elif third < 0 or tours.seconds[row] > tours.seconds[third]:
            third = row
    tours.longest[0], tours.longest[1], tours.longest[2] = first, second, third
    tours.clashes[0] = 0
    if tables.clashes.shape[1] > 0:
        for row in range(1, len(tours.seconds) - 1):
            for side in range(2):
                for other in range(row):
                    if _do_clash(tables, side, _get_end(tours, row, side), _get_end(tours, other, side)):
                        tours.clashes[0] += 1


@compile_for_views
def _do_clash(tables, side, u, v) -> bool:  # type: ignore[no-untyped-def]
    """Whether no two tours may begin (0) or end (1) with these nodes; -1: none."""
    return u >= 0 and v >= 0 and tables.clashes[side, u, v]  # type: ignore[no-any-return]


@compile_for_views
def _get_end(tours, row, side):  # type: ignore[no-untyped-def]
    """The node that a tour begins (0) or ends (1) with; -1 for none."""
    if row < 0 or row == len(tours.seconds) - 1 or tours.lengths[row] == 0:
        return NO_ROW
    return tours.nodes[row, side * (tours.lengths[row] - 1)]


@compile_for_views
def _find_new_end(tours, number, side):  # type: ignore[no-untyped-def]
    """The node that one of the rows of the move that is set will begin (0) or end (1) with; -1 for none."""
    if tours.rows[number] < 0 or tours.rows[number] == len(tours.seconds) - 1:
        return NO_ROW
    for step in range(PIECES):
        piece = tours.pieces[number, PIECES - 1 - step if side == 1 else step]
        if piece[1] <= piece[2]:
            is_reversed = piece[3] != 0
            node = tours.nodes[piece[0], piece[1] if is_reversed == (side == 1) else piece[2]]
            return node ^ 1 if is_reversed else node
    return NO_ROW


@compile_for_views
def _count_clashes(tours, tables, side, u, v):  # type: ignore[no-untyped-def]
    """How often the rows of the move that is set clash with each other and with others if they begin or end so."""
    count = 1 if _do_clash(tables, side, u, v) else 0
    for row in range(len(tours.seconds) - 1):
        if row != tours.rows[SIDE_A] and row != tours.rows[SIDE_B]:
            node = _get_end(tours, row, side)
            count += (1 if _do_clash(tables, side, u, node) else 0) + (1 if _do_clash(tables, side, v, node) else 0)
    return count


@compile_for_views
def count_new_clashes(tours, tables):  # type: ignore[no-untyped-def]
    """How many pairs of tours begin or end as no two may once the move that is set is made."""
    count, a, b = tours.clashes[0], tours.rows[SIDE_A], tours.rows[SIDE_B]
    if tables.clashes.shape[1] > 0:
        for side in range(2):
            count -= _count_clashes(tours, tables, side, _get_end(tours, a, side), _get_end(tours, b, side))
            new_a, new_b = _find_new_end(tours, SIDE_A, side), _find_new_end(tours, SIDE_B, side)
            count += _count_clashes(tours, tables, side, new_a, new_b)
    return count


@compile_for_views
def charge_new_excess(tours, tables) -> float:  # type: ignore[no-untyped-def]
    """What all tours are charged for more than a load each once the move that is set is made (s)."""
    charge, left = tours.excess[0], len(tours.seconds) - 1
    for side in range(2 if len(tables.need) > 0 else 0):
        row, need = tours.rows[side], 0.0
        if row < 0 or row == left:
            continue
        for number in range(PIECES):
            piece = tours.pieces[side, number]
            for place in range(piece[1], piece[2] + 1):
                need += tables.need[tours.nodes[piece[0], place] // 2]
        charge += _charge_excess(need) - _charge_excess(tours.needs[row])
    return charge  # type: ignore[no-any-return]


@compile_for_views
def weigh_tours(tours, tables) -> float:  # type: ignore[no-untyped-def]
    """The cost of the tours as they are."""
    longest_s = tours.seconds[tours.longest[0]]
    left_s = tours.seconds[len(tours.seconds) - 1] + RULE_S * tours.clashes[0] + tours.excess[0]
    return (1.0 - tables.sum_share) * longest_s + tables.sum_share * tours.total_s[0] + left_s  # type: ignore[no-any-return]


@compile_for_views
def set_piece(tours, side, number, row, low, high, is_reversed) -> None:  # type: ignore[no-untyped-def]
    """Let a segment of a tour be part of the move; low > high: none."""
    piece = tours.pieces[side, number]
    piece[0], piece[1], piece[2], piece[3] = row, low, high, is_reversed


@compile_for_views
def clear_pieces(tours, a, b) -> None:  # type: ignore[no-untyped-def]
    """Begin a move of rows a and b (-1: only a) that brings them nothing yet."""
    tours.rows[SIDE_A], tours.rows[SIDE_B] = a, b
    for side in range(2):
        for number in range(PIECES):
            set_piece(tours, side, number, BEGIN, SIDE_B, BEGIN, ONWARD)


@compile_for_views
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


@compile_for_views
def can_make_move(tours, tables) -> bool:  # type: ignore[no-untyped-def]
    """Whether both tractors of the move that is set may work what they get."""
    for side in range(2):
        if tours.rows[side] >= 0 and not _is_allowed(tours, tables, side, tours.rows[side]):
            return False
    return True


@compile_for_views
def push_line(tours, line) -> None:  # type: ignore[no-untyped-def]
    """Queue a line whose surroundings have changed."""
    if not tours.queued[line]:
        tours.queued[line] = True
        tours.queue[(tours.queue_state[0] + tours.queue_state[1]) % len(tours.queue)] = line
        tours.queue_state[1] += 1


@compile_for_views
def pop_line(tours) -> int:  # type: ignore[no-untyped-def]
    """The line that has been queued longest."""
    line = tours.queue[tours.queue_state[0]]
    tours.queue_state[0] = (tours.queue_state[0] + 1) % len(tours.queue)
    tours.queue_state[1] -= 1
    tours.queued[line] = False
    return line  # type: ignore[no-any-return]


@compile_for_views
def make_move(tours, tables) -> None:  # type: ignore[no-untyped-def]
    """Make the move that is set, and queue the lines at the ends of its segments."""
    for side in range(2):
        if tours.rows[side] < 0:
            continue
        place = 0
        for number in range(PIECES):
            piece = tours.pieces[side, number]
            source, low, high = piece[0], piece[1], piece[2]
            for step in range(high - low + 1):
                node = tours.nodes[source, high - step] ^ 1 if piece[3] else tours.nodes[source, low + step]
                tours.scratch[side, place] = node
                place += 1
            if low <= high:
                push_line(tours, tours.nodes[source, low] // 2)
                push_line(tours, tours.nodes[source, high] // 2)
    for side in range(2):
        row = tours.rows[side]
        if row >= 0:
            tours.lengths[row] = 0
            for number in range(PIECES):
                tours.lengths[row] += max(0, tours.pieces[side, number, 2] - tours.pieces[side, number, 1] + 1)
            for place in range(tours.lengths[row]):
                tours.nodes[row, place] = tours.scratch[side, place]
            update_row(tours, tables, row)
    sum_rows(tours, tables)
