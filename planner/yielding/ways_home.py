"""Ways home of a fleet that stands at hold points, compiled: one after another, or by turns.

Whoever goes home in one go needs that nobody stands where it comes by, that its gates are open, and that it will stand
in nobody's way at home. Each of these is about one other tractor that has yet to go: so all get home one after another
exactly if these needs have no circle. By turns, moves are tried in depth first, a limited number of states in all.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle.jit import compiled

MOST_STATES = 400  # looked at for a way home
Array = npt.NDArray[Any]


class Net(NamedTuple):
    """All that a schedule of a fleet of n tractors depends on; places p as numbered in planner.yielding.crossings.

    `owner` (p,) tells whose a place is. `apart`, `stands` and `blockers` are the tables of that module, as `start`,
    `at` and `s` each. `waits` are gates of the plan in the same form: the stretch that must have been begun, and since
    when (s). `bound` (p,) is the next number of a place at which its tractor waits by plan. `last_pass` (p, n) is the
    last stretch, by number, on which a tractor comes by a place where another stands, `last_wait` (p, n) that of
    another tractor which must have been begun before all stretches from here on are driven; -1 for none.
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


@compiled
def tenths(x: float) -> int:
    """A number in tenths, the nearest; exact, ties to even, as `round(x, 1)` has it."""
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


@compiled
def first_row(at, start, end, place):  # type: ignore[no-untyped-def]
    """The first of the rows from `start` to `end` that is about `place` or a later one."""
    while start < end:
        middle = (start + end) // 2
        if at[middle] < place:
            start = middle + 1
        else:
            end = middle
    return start


@compiled
def copied(values, into) -> None:  # type: ignore[no-untyped-def]
    """Copy a row of numbers; a loop compiles sooner than an assignment of arrays."""
    for number in range(len(values)):
        into[number] = values[number]


@compiled
def last_passes(base, owner, start, at):  # type: ignore[no-untyped-def]
    """`Net.last_pass` from the table of hold points and who comes by."""
    last = np.full((len(owner), len(base) - 1), -1, dtype=np.int32)
    for place in range(len(owner)):
        for row in range(start[place], start[place + 1]):
            one = owner[at[row]]
            last[place, one] = max(last[place, one], at[row] - base[one])
    return last


@compiled
def last_waits(base, owner, start, at):  # type: ignore[no-untyped-def]
    """`Net.last_wait` from the table of gates."""
    last = np.full((len(owner), len(base) - 1), -1, dtype=np.int32)
    for place in range(len(owner) - 1, -1, -1):
        if place + 1 < len(owner) and owner[place + 1] == owner[place]:
            copied(last[place + 1], last[place])
        for row in range(start[place], start[place + 1]):
            other = owner[at[row]]
            last[place, other] = max(last[place, other], at[row] - base[other])
    return last


@compiled
def harmless(net, one, state):  # type: ignore[no-untyped-def]
    """Whether a tractor stands where nobody else comes by any more."""
    place = net.base[one] + state[one]
    free = True
    for other in range(len(state)):
        free = free and net.last_pass[place, other] < state[other]
    return free


@compiled
def _needs(net, state, one, other):  # type: ignore[no-untyped-def]
    """Whether a tractor can go home in one go only after another has."""
    base = net.base
    if net.last_pass[base[other] + state[other], one] >= state[one]:
        return True
    if net.last_wait[base[one] + state[one], other] >= state[other]:
        return True
    return net.last_pass[base[one + 1] - 1, other] >= state[other]


@compiled
def one_by_one(net, state):  # type: ignore[no-untyped-def]
    """Whether each can go home in one go, in some order."""
    count = len(state)
    home = np.empty(count, dtype=np.bool_)
    for one in range(count):
        home[one] = state[one] == net.base[one + 1] - net.base[one] - 1
    needs = np.zeros(count, dtype=np.int64)
    needed = np.zeros((count, count), dtype=np.bool_)
    ready, some = np.empty(count, dtype=np.int64), 0
    for one in range(count):
        if home[one]:
            continue
        for other in range(count):
            if other != one and _needs(net, state, one, other):
                needed[other, one] = True
                needs[one] += 1
        if needs[one] == 0:
            ready[some] = one
            some += 1
    left = -some
    for one in range(count):
        left += 0 if home[one] else 1
    while some > 0:
        some -= 1
        gone = ready[some]
        for one in range(count):
            if needed[gone, one]:
                needs[one] -= 1
                if needs[one] == 0:
                    ready[some] = one
                    some += 1
                    left -= 1
    return left == 0


@compiled
def _reach(net, state, one):  # type: ignore[no-untyped-def]
    """How far a tractor can go while all others stand, at most to where it waits by plan."""
    base, place = net.base, net.base[one] + state[one]
    for row in range(net.waits_start[place], net.waits_start[place + 1]):
        other = net.owner[net.waits_at[row]]
        if state[other] <= net.waits_at[row] - base[other]:
            return state[one]
    until = base[one] + net.bound[place]
    for other in range(len(state)):
        stood = base[other] + state[other]
        if net.last_pass[stood, one] < state[one]:
            continue
        end = net.stands_start[stood + 1]
        row = first_row(net.stands_at, net.stands_start[stood], end, place)
        if row < end:
            until = min(until, net.stands_at[row])
    return until - base[one]


@compiled
def _blocks(net, state, one, hold):  # type: ignore[no-untyped-def]
    """Whether a tractor at a hold point stands in the way of what another does before it waits for anybody."""
    place = net.base[one] + hold
    for row in range(net.stands_start[place], net.stands_start[place + 1]):
        other = net.owner[net.stands_at[row]]
        number = net.stands_at[row] - net.base[other]
        if state[other] <= number < net.bound[net.base[other] + state[other]]:
            return True
    return False


@compiled
def _sooner(move, begins_s, harm, when, one, hold):  # type: ignore[no-untyped-def]
    """Whether a move is to be tried before another one."""
    if move[0] != harm:
        return move[0] < harm
    if begins_s != when:
        return begins_s < when
    if move[1] != one:
        return move[1] < one
    return move[2] < hold


@compiled
def _sorted_in(moves, when, count, harm, one, hold, begins_s):  # type: ignore[no-untyped-def]
    """Write a move before those that are to be tried sooner; returns how many there are now."""
    row = count
    while row > 0 and _sooner(moves[row - 1], when[row - 1], harm, begins_s, one, hold):
        copied(moves[row - 1], moves[row])
        when[row] = when[row - 1]
        row -= 1
    moves[row, 0], moves[row, 1], moves[row, 2], when[row] = harm, one, hold, begins_s
    return count + 1


@compiled
def _for_good(net, state, one, reach):  # type: ignore[no-untyped-def]
    """The farthest hold point up to `reach` by which nobody else comes any more; else where it is."""
    for hold in range(reach, state[one], -1):
        free = True
        for other in range(len(state)):
            if net.last_pass[net.base[one] + hold, other] >= state[other]:
                free = False
                break
        if free:
            return hold
    return state[one]


@compiled
def _moves(net, state, deep, moves, when):  # type: ignore[no-untyped-def]
    """Number of the moves that may be done next, the best last: rows (blocks, tractor, hold point), when they begin.

    A tractor goes on to where it waits for others by plan, or else as far as it does not stand in the way of what
    another has to do before it waits for anybody. When looking `deep`, none goes home while others have to come by
    there; and where one can go on to where nobody comes by any more, that alone is the next move, as it keeps nobody
    from anything.
    """
    count, no_harm = np.int64(0), np.int64(0)
    for one in range(len(state)):
        place, home = net.base[one] + state[one], net.base[one + 1] - net.base[one] - 1
        reach = _reach(net, state, one) if state[one] < home else state[one]
        if reach == state[one]:
            continue
        hold = _for_good(net, state, one, reach) if deep else state[one]
        if hold > state[one]:
            return _sorted_in(moves, when, no_harm, no_harm, one, hold, net.begins_s[place])
        reach -= 1 if deep and reach == home else 0
        hold = reach
        while hold > state[one] and _blocks(net, state, one, hold):
            hold -= 1
        if hold > state[one]:
            count = _sorted_in(moves, when, count, no_harm, one, hold, net.begins_s[place])
        if hold < reach:
            count = _sorted_in(moves, when, count, no_harm + 1, one, reach, net.begins_s[place])
    return count


@compiled
def _new(states, slots, count):  # type: ignore[no-untyped-def]
    """Whether state number `count` is none of those before it; it is noted in the table of `slots` then."""
    code = np.uint64(1469598103934665603)
    for one in range(states.shape[1]):
        code = (code ^ np.uint64(states[count, one])) * np.uint64(1099511628211)
    slot = np.int64((code >> np.uint64(20)) % np.uint64(len(slots)))
    while slots[slot] >= 0:
        same = True
        for one in range(states.shape[1]):
            same = same and states[slots[slot], one] == states[count, one]
        if same:
            return False
        slot = (slot + 1) % len(slots)
    slots[slot] = count
    return True


@compiled
def _driven(net, state):  # type: ignore[no-untyped-def]
    """What a fleet has behind it, in tenths of a second of driving."""
    total = 0.0
    for one in range(len(state)):
        total += net.begins_s[net.base[one] + state[one]]
    return tenths(total)


@compiled
def most_states(count, deep):  # type: ignore[no-untyped-def]
    """How many states are looked at for a fleet; when deep, the more the more moves there are to choose from."""
    return MOST_STATES * (1 + count * count // 50 if deep else 1)


@compiled
def by_turns(net, start, deep, reached):  # type: ignore[no-untyped-def]
    """Whether an order of moves in which all get home is found; `reached` becomes the farthest on that was found."""
    count = len(start)
    most = most_states(count, deep)
    room = most + 2 * count + 1
    states, slots = np.empty((room, count), dtype=np.int64), np.full(4 * room, -1)
    stack, seen, some = np.empty(room, dtype=np.int64), np.int64(0), 1
    moves, when = np.empty((2 * count + 1, 3), dtype=np.int64), np.empty(2 * count + 1)
    copied(start, states[0])
    copied(start, reached)
    stack[0] = 0
    _new(states, slots, seen)
    seen += 1
    farthest = _driven(net, start)
    while some > 0 and seen < most:
        some -= 1
        state = states[stack[some]]
        home = True
        for one in range(count):
            home = home and state[one] == net.base[one + 1] - net.base[one] - 1
        driven = _driven(net, state)
        if home or driven > farthest:
            farthest = driven
            copied(state, reached)
        if home:
            return True
        for row in range(_moves(net, state, deep, moves, when)):
            copied(state, states[seen])
            states[seen, moves[row, 1]] = moves[row, 2]
            if _new(states, slots, seen):
                stack[some] = seen
                some += 1
                seen += 1
    return False
