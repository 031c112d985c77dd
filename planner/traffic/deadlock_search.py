"""Whether a fleet that stands at hold points can get home, compiled: one after another, or in turns.

Whoever goes home in one go needs that nobody stands where it passes, that its gates are open, and that it will stand in
nobody's way at home. Each of these concerns one other tractor that has yet to go, so all get home one after another
exactly if these needs have no circle. In turns, moves are tried depth first, up to a limited number of states.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle.copying import copy_row
from vehicle.jit import compile_function

MAX_STATES = 400  # states searched for a way home
Array = npt.NDArray[Any]


class ScheduleNet(NamedTuple):
    """All that a schedule of a fleet of n tractors depends on; places p are numbered as in traffic.conflict_zones.

    `owner` (p,) is the tractor of a place. The tables `apart`, `stands` and `blockers` of that module come as `_start`,
    `_at` and `_s` each. `waits` are gates of the plan in the same form: the segment that must have been begun, and for
    how long (s). `bound` (p,) is the next number of a place at which its tractor waits by plan. `last_pass` (p, n) is
    the last segment, by number, on which a tractor passes a place where another stands, `last_wait` (p, n) that of
    another tractor which must have been begun before all segments from here on are driven; -1 for none. `near` (n, n)
    tells which tractors interact.
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
    bound: Array
    last_pass: Array
    last_wait: Array
    near: Array


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
def find_last_waits(base, owner, start, at):  # type: ignore[no-untyped-def]
    """`ScheduleNet.last_wait` from the table of gates."""
    last_wait = np.full((len(owner), len(base) - 1), -1, dtype=np.int32)
    for place in range(len(owner) - 1, -1, -1):
        if place + 1 < len(owner) and owner[place + 1] == owner[place]:
            copy_row(last_wait[place + 1], last_wait[place])
        for row in range(start[place], start[place + 1]):
            other_tractor = owner[at[row]]
            last_wait[place, other_tractor] = max(last_wait[place, other_tractor], at[row] - base[other_tractor])
    return last_wait


@compile_function
def is_off_remaining_paths(net, tractor, state):  # type: ignore[no-untyped-def]
    """Whether a tractor stands where nobody else passes any more."""
    place = net.base[tractor] + state[tractor]
    is_free = True
    for other_tractor in range(len(state)):
        is_free = is_free and net.last_pass[place, other_tractor] < state[other_tractor]
    return is_free


@compile_function
def _must_finish_after(net, state, tractor, other_tractor):  # type: ignore[no-untyped-def]
    """Whether a tractor can go home in one go only after another has."""
    base = net.base
    if net.last_pass[base[other_tractor] + state[other_tractor], tractor] >= state[tractor]:
        return True
    if net.last_wait[base[tractor] + state[tractor], other_tractor] >= state[other_tractor]:
        return True
    return net.last_pass[base[tractor + 1] - 1, other_tractor] >= state[other_tractor]


@compile_function
def can_finish_one_by_one(net, state):  # type: ignore[no-untyped-def]
    """Whether each can go home in one go, in some order."""
    count = len(state)
    home = np.empty(count, dtype=np.bool_)
    for tractor in range(count):
        home[tractor] = state[tractor] == net.base[tractor + 1] - net.base[tractor] - 1
    needs = np.zeros(count, dtype=np.int64)
    needed = np.zeros((count, count), dtype=np.bool_)
    ready, ready_count = np.empty(count, dtype=np.int64), 0
    for tractor in range(count):
        if home[tractor]:
            continue
        for other_tractor in range(count):
            if other_tractor != tractor and _must_finish_after(net, state, tractor, other_tractor):
                needed[other_tractor, tractor] = True
                needs[tractor] += 1
        if needs[tractor] == 0:
            ready[ready_count] = tractor
            ready_count += 1
    remaining = -ready_count
    for tractor in range(count):
        remaining += 0 if home[tractor] else 1
    while ready_count > 0:
        ready_count -= 1
        finished = ready[ready_count]
        for tractor in range(count):
            if needed[finished, tractor]:
                needs[tractor] -= 1
                if needs[tractor] == 0:
                    ready[ready_count] = tractor
                    ready_count += 1
                    remaining -= 1
    return remaining == 0


@compile_function
def _find_farthest_hold_point(net, state, tractor):  # type: ignore[no-untyped-def]
    """How far a tractor can go while all others stand, at most to where it waits by plan."""
    base, place = net.base, net.base[tractor] + state[tractor]
    for row in range(net.waits_start[place], net.waits_start[place + 1]):
        other_tractor = net.owner[net.waits_at[row]]
        if state[other_tractor] <= net.waits_at[row] - base[other_tractor]:
            return state[tractor]
    until = base[tractor] + net.bound[place]
    for other_tractor in range(len(state)):
        standing_place = base[other_tractor] + state[other_tractor]
        if net.last_pass[standing_place, tractor] < state[tractor]:
            continue
        end = net.stands_start[standing_place + 1]
        row = find_first_place_row(net.stands_at, net.stands_start[standing_place], end, place)
        if row < end:
            until = min(until, net.stands_at[row])
    return until - base[tractor]


@compile_function
def _blocks_other_tractors(net, state, tractor, hold):  # type: ignore[no-untyped-def]
    """Whether a tractor at a hold point stands in the way of what another does before it waits for anybody."""
    place = net.base[tractor] + hold
    for row in range(net.stands_start[place], net.stands_start[place + 1]):
        other_tractor = net.owner[net.stands_at[row]]
        number = net.stands_at[row] - net.base[other_tractor]
        if state[other_tractor] <= number < net.bound[net.base[other_tractor] + state[other_tractor]]:
            return True
    return False


@compile_function
def _is_earlier_move(move, begins_s, harm, when_s, tractor, hold):  # type: ignore[no-untyped-def]
    """Whether a move is to be tried before another one."""
    if move[0] != harm:
        return move[0] < harm
    if begins_s != when_s:
        return begins_s < when_s
    if move[1] != tractor:
        return move[1] < tractor
    return move[2] < hold


@compile_function
def _insert_sorted(moves, when, count, harm, tractor, hold, begins_s):  # type: ignore[no-untyped-def]
    """Insert a move before those that are to be tried sooner; returns the number of moves."""
    row = count
    while row > 0 and _is_earlier_move(moves[row - 1], when[row - 1], harm, begins_s, tractor, hold):
        copy_row(moves[row - 1], moves[row])
        when[row] = when[row - 1]
        row -= 1
    moves[row, 0], moves[row, 1], moves[row, 2], when[row] = harm, tractor, hold, begins_s
    return count + 1


@compile_function
def _find_clear_hold_point(net, state, tractor, reach):  # type: ignore[no-untyped-def]
    """The farthest hold point up to `reach` that nobody else passes any more; else where the tractor is."""
    for hold in range(reach, state[tractor], -1):
        is_free = True
        for other_tractor in range(len(state)):
            if net.last_pass[net.base[tractor] + hold, other_tractor] >= state[other_tractor]:
                is_free = False
                break
        if is_free:
            return hold
    return state[tractor]


@compile_function
def _list_moves(net, state, deep, moves, when):  # type: ignore[no-untyped-def]
    """Number of possible next moves, the best last: rows (blocks, tractor, hold point), and when they begin.

    A tractor goes on to where it waits for others by plan, or else as far as it does not block what another has to do
    before it waits for anybody. In a deep search none goes home while others have to pass there; and if one can go on
    to where nobody passes any more, that is the only next move, because it blocks nobody.
    """
    count, no_harm = np.int64(0), np.int64(0)
    for tractor in range(len(state)):
        place, home = net.base[tractor] + state[tractor], net.base[tractor + 1] - net.base[tractor] - 1
        reach = _find_farthest_hold_point(net, state, tractor) if state[tractor] < home else state[tractor]
        if reach == state[tractor]:
            continue
        hold = _find_clear_hold_point(net, state, tractor, reach) if deep else state[tractor]
        if hold > state[tractor]:
            return _insert_sorted(moves, when, no_harm, no_harm, tractor, hold, net.begins_s[place])
        reach -= 1 if deep and reach == home else 0
        hold = reach
        while hold > state[tractor] and _blocks_other_tractors(net, state, tractor, hold):
            hold -= 1
        if hold > state[tractor]:
            count = _insert_sorted(moves, when, count, no_harm, tractor, hold, net.begins_s[place])
        if hold < reach:
            count = _insert_sorted(moves, when, count, no_harm + 1, tractor, reach, net.begins_s[place])
    return count


@compile_function
def _is_new_state(states, slots, count):  # type: ignore[no-untyped-def]
    """Whether state number `count` differs from all before it; if so it is entered in the hash table `slots`."""
    code = np.uint64(1469598103934665603)
    for tractor in range(states.shape[1]):
        code = (code ^ np.uint64(states[count, tractor])) * np.uint64(1099511628211)
    slot = np.int64((code >> np.uint64(20)) % np.uint64(len(slots)))
    while slots[slot] >= 0:
        is_same = True
        for tractor in range(states.shape[1]):
            is_same = is_same and states[slots[slot], tractor] == states[count, tractor]
        if is_same:
            return False
        slot = (slot + 1) % len(slots)
    slots[slot] = count
    return True


@compile_function
def _sum_driven_tenths(net, state):  # type: ignore[no-untyped-def]
    """What a fleet has driven so far, in tenths of a second."""
    total = 0.0
    for tractor in range(len(state)):
        total += net.begins_s[net.base[tractor] + state[tractor]]
    return round_to_tenths(total)


@compile_function
def compute_state_limit(count, deep):  # type: ignore[no-untyped-def]
    """Number of states searched for a fleet; in a deep search more, the more tractors there are."""
    return MAX_STATES * (1 + count * count // 50 if deep else 1)


@compile_function
def can_finish_by_turns(net, start, deep, reached):  # type: ignore[no-untyped-def]
    """Whether an order of moves in which all get home is found; `reached` becomes the farthest state found."""
    count = len(start)
    max_states = compute_state_limit(count, deep)
    room = max_states + 2 * count + 1
    states, slots = np.empty((room, count), dtype=np.int64), np.full(4 * room, -1)
    stack, seen, stack_size = np.empty(room, dtype=np.int64), np.int64(0), 1
    moves, when = np.empty((2 * count + 1, 3), dtype=np.int64), np.empty(2 * count + 1)
    copy_row(start, states[0])
    copy_row(start, reached)
    stack[0] = 0
    _is_new_state(states, slots, seen)
    seen += 1
    farthest = _sum_driven_tenths(net, start)
    while stack_size > 0 and seen < max_states:
        stack_size -= 1
        state = states[stack[stack_size]]
        is_home = True
        for tractor in range(count):
            is_home = is_home and state[tractor] == net.base[tractor + 1] - net.base[tractor] - 1
        driven_tenths = _sum_driven_tenths(net, state)
        if is_home or driven_tenths > farthest:
            farthest = driven_tenths
            copy_row(state, reached)
        if is_home:
            return True
        for row in range(_list_moves(net, state, deep, moves, when)):
            copy_row(state, states[seen])
            states[seen, moves[row, 1]] = moves[row, 2]
            if _is_new_state(states, slots, seen):
                stack[stack_size] = seen
                stack_size += 1
                seen += 1
    return False
