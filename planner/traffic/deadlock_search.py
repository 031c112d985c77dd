"""How a fleet that stands at hold points can get home, compiled: two of it, or all, one moving at a time.

Of two tractors all states are looked at, once for a plan: where these two alone cannot get home, no fleet with them
can. A way home of all is the order of the tractors in which their segments are driven. It is searched depth first, with
no segment after which two cannot get home. Once there is one, a tractor that goes on out of turn changes only what
comes before its turn: no more of the way is looked at again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle.copying import copy_row
from vehicle.jit import compile_function

MOST_LOOKS = 300_000  # at one tractor for another, beside a few for each move there is
Array = npt.NDArray[Any]


class ScheduleNet(NamedTuple):
    """All that a schedule of a fleet of n tractors depends on; places p are numbered as in traffic.conflict_zones.

    `owner` (p,) is the tractor of a place. The tables `apart`, `stands` and `blockers` of that module come as `_start`,
    `_at` and `_s` each. `waits` are gates of the plan in the same form: the segment that must have been begun, and for
    how long (s). `last_pass` (p, n) is the last segment, by number, on which a tractor passes a place where another
    stands; -1 for none. `near` (n, n) tells which tractors interact. `safe` holds a table for every two that do or wait
    for each other, from `safe_start` (n, n) on (-1 for none): whether these two get home from a hold point of the one
    and one of the other.
    """

    base: Array
    owner: Array
    begins_s: Array
    apart_start: Array
    apart_at: Array
    apart_s: Array
    stands_start: Array
    stands_at: Array
    stands_s: Array
    blockers_start: Array
    blockers_at: Array
    blockers_s: Array
    waits_start: Array
    waits_at: Array
    waits_s: Array
    last_pass: Array
    near: Array
    safe_start: Array
    safe: Array


@compile_function
def round_to_tenths(x: float) -> int:
    """A number in tenths, the nearest; exact, ties to even, as in `round(x, 1)`."""
    eight, two = 8.0 * x, 2.0 * x
    whole = eight + two
    part = whole - eight
    error = (eight - (whole - part)) + (two - part)
    low = np.floor(whole)
    above = whole - low - 0.5
    if above == 0.0:
        above = error
    up = above > 0.0 or (above == 0.0 and low % 2.0 == 1.0)
    return int(low) + (1 if up else 0)


@compile_function
def find_first_place_row(at, start, end, place):  # type: ignore[no-untyped-def]
    """The first of the rows from `start` to `end` that belongs to `place` or a later one."""
    while start < end:
        middle = (start + end) // 2
        if at[middle] < place:
            start = middle + 1
        else:
            end = middle
    return start


@compile_function
def find_last_passes(base, owner, start, at):  # type: ignore[no-untyped-def]
    """`ScheduleNet.last_pass` from the table of hold points and who passes them."""
    last_pass = np.full((len(owner), len(base) - 1), -1, dtype=np.int32)
    for place in range(len(owner)):
        for row in range(start[place], start[place + 1]):
            tractor = owner[at[row]]
            last_pass[place, tractor] = max(last_pass[place, tractor], at[row] - base[tractor])
    return last_pass


@compile_function
def is_off_remaining_paths(net, state, tractor, number):  # type: ignore[no-untyped-def]
    """Whether nobody else passes a hold point of a tractor any more."""
    for other_tractor in range(len(state)):
        if net.last_pass[net.base[tractor] + number, other_tractor] >= state[other_tractor]:
            return False
    return True


@compile_function
def _may_go_on(net, tractor, number, other_tractor, other_number):  # type: ignore[no-untyped-def]
    """Whether a tractor may drive its next segment while another stands, as far as these two are concerned."""
    segment, stood = net.base[tractor] + number, net.base[other_tractor] + other_number
    end = net.blockers_start[segment + 1]
    row = find_first_place_row(net.blockers_at, net.blockers_start[segment], end, stood)
    if row < end and net.blockers_at[row] == stood:
        return False
    for row in range(net.waits_start[segment], net.waits_start[segment + 1]):
        place = net.waits_at[row]
        if net.owner[place] == other_tractor and place >= stood:
            return False
    return True


@compile_function
def fill_safe_pair(net, one, other) -> None:  # type: ignore[no-untyped-def]
    """Fill the table of two tractors, the first of them first, in `ScheduleNet.safe`, from their ends backwards."""
    last, other_last = net.base[one + 1] - net.base[one] - 1, net.base[other + 1] - net.base[other] - 1
    start, width = net.safe_start[one, other], other_last + 1
    if start < 0:
        return
    for number in range(last, -1, -1):
        for other_number in range(other_last, -1, -1):
            at = start + number * width + other_number
            net.safe[at] = number == last and other_number == other_last
            if number < last and net.safe[at + width]:
                net.safe[at] = _may_go_on(net, one, number, other, other_number)
            if not net.safe[at] and other_number < other_last and net.safe[at + 1]:
                net.safe[at] = _may_go_on(net, other, other_number, one, number)


@compile_function
def fill_safe_pairs(net) -> None:  # type: ignore[no-untyped-def]
    """Fill the tables of every two tractors in `ScheduleNet.safe`."""
    count = len(net.base) - 1
    for one in range(count):
        for other in range(one + 1, count):
            fill_safe_pair(net, one, other)


@compile_function
def is_pair_safe(net, one, number, other, other_number):  # type: ignore[no-untyped-def]
    """Whether two tractors that stand at hold points could get home if they were alone."""
    if one > other:
        one, number, other, other_number = other, other_number, one, number
    start = net.safe_start[one, other]
    return start < 0 or net.safe[start + number * (net.base[other + 1] - net.base[other]) + other_number]


@compile_function
def are_pairs_safe(net, state, tractor):  # type: ignore[no-untyped-def]
    """Whether a tractor and each of the others could get home if these two were alone."""
    for other_tractor in range(len(state)):
        if other_tractor != tractor and not is_pair_safe(
            net, tractor, state[tractor], other_tractor, state[other_tractor]
        ):
            return False
    return True


@compile_function
def _can_go_on(net, state, tractor):  # type: ignore[no-untyped-def]
    """Whether a tractor may drive its next segment while all others stand."""
    for other_tractor in range(len(state)):
        concerned = net.safe_start[min(tractor, other_tractor), max(tractor, other_tractor)] >= 0
        if concerned and not _may_go_on(net, tractor, state[tractor], other_tractor, state[other_tractor]):
            return False
    return True


@compile_function
def _is_next_move(net, state, tractor):  # type: ignore[no-untyped-def]
    """Whether a tractor may drive its next segment while all others stand, and no two are stuck after it."""
    if state[tractor] == net.base[tractor + 1] - net.base[tractor] - 1:
        return False
    state[tractor] += 1
    leaves_ways = are_pairs_safe(net, state, tractor)
    state[tractor] -= 1
    return leaves_ways and _can_go_on(net, state, tractor)


@compile_function
def _add_key(keys, key):  # type: ignore[no-untyped-def]
    """Enter a key, not 0, in a hash table; False if it is there."""
    slot = np.int64((key >> np.uint64(20)) % np.uint64(len(keys)))
    while keys[slot] != 0:
        if keys[slot] == key:
            return False
        slot = (slot + 1) % len(keys)
    keys[slot] = key
    return True


@compile_function
def _add_state(keys, seen, state):  # type: ignore[no-untyped-def]
    """The hash table, larger if it was half full, and whether a state was not in it before."""
    if 2 * seen > len(keys):
        grown = np.zeros(4 * len(keys), dtype=np.uint64)
        for slot in range(len(keys)):
            if keys[slot] != 0:
                _add_key(grown, keys[slot])
        keys = grown
    code = np.uint64(1469598103934665603)
    for tractor in range(len(state)):
        code = (code ^ np.uint64(state[tractor])) * np.uint64(1099511628211)
    return keys, _add_key(keys, code | np.uint64(1))


@compile_function
def _find_clear_hold_point(net, state, tractor):  # type: ignore[no-untyped-def]
    """The last hold point of a tractor that nobody else passes any more and to which it can go on while all others
    stand, -1 without any; and how many looks at another tractor that took."""
    looks, hold = np.int64(0), np.int64(-1)
    for number in range(state[tractor], net.base[tractor + 1] - net.base[tractor] - 1):
        for other_tractor in range(len(state)):
            if net.safe_start[min(tractor, other_tractor), max(tractor, other_tractor)] >= 0:
                looks += 1
                if not _may_go_on(net, tractor, number, other_tractor, state[other_tractor]):
                    return hold, looks
        if is_off_remaining_paths(net, state, tractor, number + 1):
            hold = np.int64(number + 1)
    return hold, looks


@compile_function
def _find_next_move(net, state, tried):  # type: ignore[no-untyped-def]
    """The next tractor to go on, of those below `tried`, to which hold point, which tractors are left to try, and how
    many looks at another that took.

    One that can go on to where nobody passes any more is the only one to try, because it blocks nobody. That is never
    undone, so that it counts no looks.
    """
    looks = np.int64(0)
    if tried == len(state):
        for tractor in range(len(state)):
            hold, looked = _find_clear_hold_point(net, state, tractor)
            looks += looked
            if hold >= 0:
                return tractor, hold, 0, np.int64(0)
    for tractor in range(tried - 1, -1, -1):
        looks += len(state)
        if _is_next_move(net, state, tractor):
            return tractor, state[tractor] + 1, tractor, looks
    return -1, 0, 0, looks


@compile_function
def find_way_home(net, start, reached, way):  # type: ignore[no-untyped-def]
    """Whether a way home of all is found; `reached` becomes the farthest state found.

    Its moves, the tractor for each segment that is left, become the last of `way` (one entry for each segment of all).
    Where none is found, there is none if the search looked at all states that can be reached (MOST_LOOKS).
    """
    count, remaining = len(start), np.int64(0)
    for tractor in range(count):
        remaining += net.base[tractor + 1] - net.base[tractor] - 1 - start[tractor]
    moves, tried = np.empty((remaining + 1, 2), dtype=np.int64), np.full(remaining + 1, count)
    keys, seen, depth, driven, farthest = np.zeros(1024, dtype=np.uint64), 1, 0, np.int64(0), np.int64(0)
    state, looks_left = start.copy(), MOST_LOOKS + remaining * count * count
    copy_row(start, reached)
    while driven < remaining and looks_left > 0:
        tractor, hold, tried[depth], looks = _find_next_move(net, state, tried[depth])
        looks_left -= looks
        if tractor < 0:
            if depth == 0:
                return False
            depth -= 1
            driven -= state[moves[depth, 0]] - moves[depth, 1]
            state[moves[depth, 0]] = moves[depth, 1]
            continue
        before, state[tractor] = state[tractor], hold
        keys, is_new = _add_state(keys, seen, state)
        if not is_new:
            state[tractor] = before
            continue
        seen += 1
        moves[depth, 0], moves[depth, 1] = tractor, before
        driven += hold - before
        depth += 1
        tried[depth] = count
        if driven > farthest:
            farthest = driven
            copy_row(state, reached)
    if driven < remaining:
        return False
    _write_way(moves[:depth], state, way)
    return True


@compile_function
def _write_way(moves, state, way) -> None:  # type: ignore[no-untyped-def]
    """Write the moves that led to a state, each a tractor and the hold point it left, at the end of `way`."""
    row = len(way)
    for number in range(len(moves) - 1, -1, -1):
        tractor, before = moves[number, 0], moves[number, 1]
        for _ in range(state[tractor] - before):
            row -= 1
            way[row] = tractor
        state[tractor] = before


@compile_function
def is_on_way_home(net, state_after, tractor, length, way, state):  # type: ignore[no-untyped-def]
    """Whether the moves of `way` lead home also after a tractor has gone on by `length` segments before its turn.

    `way` are the moves that were left before that. `state` is overwritten: it is as it was to be once the turn comes.
    """
    copy_row(state_after, state)
    ahead, row = length, 0
    while ahead > 0:
        if way[row] == tractor:
            ahead -= 1
        elif _can_go_on(net, state, way[row]):
            state[way[row]] += 1
        else:
            return False
        row += 1
    return True


@compile_function
def drop_moves(way, tractor, length) -> None:  # type: ignore[no-untyped-def]
    """Drop the next `length` moves of a tractor from a way home; what comes before is shifted to later rows."""
    ahead, row = length, 0
    while ahead > 0:
        ahead -= way[row] == tractor
        row += 1
    kept = row
    for before in range(row - 1, -1, -1):
        if way[before] != tractor:
            kept -= 1
            way[kept] = way[before]
