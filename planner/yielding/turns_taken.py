"""When each tractor begins each of its stretches, compiled: the entries of a timetable, one after another.

Times that are taken by others are spans; the earliest time outside all of them is where a tractor can begin. Only
stretches that others have begun, or stand before, matter, and of those only what is not over yet.
"""

from __future__ import annotations

import math

import numpy as np

from planner.yielding.ways_home import by_turns, copied, first_row, harmless, one_by_one, tenths
from vehicle.jit import compiled

BEHIND_S = 3.0  # who follows leaves so much time behind the one before
AHEAD_S = 6.0  # who goes before one that is on its way already keeps so much ahead
START_S = 1.5  # lost by a tractor that had to stand
GUARDED_S = 120.0  # an order with less time between is guarded by a gate though none is predicted to be needed
CHAIN = 4  # stretches entered in one go where there is no room to stand between
STOOD_S = 0.5  # who has stood for less has passed by
MOVED_S = 2.0  # a tractor that has been on a stretch for so long has left its hold point
SAME_S = 0.05
NEVER = math.inf


@compiled
def _apart(net, state, begun_s, margins, mine, shift, soonest, spans, count):  # type: ignore[no-untyped-def]
    """Add the spans in which a stretch must not be begun because of stretches that others have begun."""
    start, row = net.apart_start[mine], net.apart_start[mine + 1]
    while row > start:
        other = net.owner[net.apart_at[row - 1]]
        first = net.base[other]
        row = first_row(net.apart_at, start, row, first + state[other])
        while row > start and net.apart_at[row - 1] >= first:
            place = net.apart_at[row - 1]
            lasts_s = net.begins_s[place + 1] - net.begins_s[place]
            if begun_s[place] + lasts_s + 2.0 * margins[0] + START_S < soonest:
                row = first_row(net.apart_at, start, row, first)
                break
            row -= 1
            spans[count, 0] = begun_s[place] + net.apart_s[row, 0] - margins[1] - shift
            spans[count, 1] = begun_s[place] + net.apart_s[row, 1] + margins[0] - shift
            count += 1
    return count


@compiled
def _stood(net, state, begun_s, free_s, margins, mine, shift, soonest, spans, count):  # type: ignore[no-untyped-def]
    """Add the spans in which a stretch must not be begun because of where others stand, or have stood."""
    for row in range(net.blockers_start[mine], net.blockers_start[mine + 1]):
        place = net.blockers_at[row]
        other = net.owner[place]
        number = place - net.base[other]
        if number > state[other]:
            continue
        low, high, came = -NEVER, NEVER, -NEVER
        if number > 0:
            came = begun_s[place - 1] + (net.begins_s[place] - net.begins_s[place - 1])
        if number == state[other]:
            low = free_s[other] - net.blockers_s[row, 1] - margins[1] if number > 0 else -NEVER
        else:
            high = begun_s[place] + max(MOVED_S, margins[0] - net.blockers_s[row, 0])
            if begun_s[place] - came <= STOOD_S or high - shift <= soonest:
                continue
            low = came - net.blockers_s[row, 1] - margins[1]
        spans[count, 0], spans[count, 1] = low - shift, high - shift
        count += 1
    return count


@compiled
def _outside(spans, count, soonest):  # type: ignore[no-untyped-def]
    """The earliest time from `soonest` on that is in none of the spans."""
    before = -NEVER
    while before < soonest:
        before = soonest
        for row in range(count):
            if spans[row, 0] <= soonest < spans[row, 1]:
                soonest = spans[row, 1]
    return soonest


@compiled
def _begin(net, state, begun_s, free_s, margins, one, length, soonest, spans):  # type: ignore[no-untyped-def]
    """The earliest time from `soonest` on at which a tractor can begin so many stretches in one go."""
    base, at, count = net.base[one], state[one], np.int64(0)
    began = net.begins_s[base + at]
    for mine in range(base + at, base + at + length):
        shift = net.begins_s[mine] - began
        for row in range(net.waits_start[mine], net.waits_start[mine + 1]):
            place = net.waits_at[row]
            other = net.owner[place]
            if place - net.base[other] >= state[other]:
                return NEVER
            soonest = max(soonest, begun_s[place] + net.waits_s[row] - shift)
        count = _apart(net, state, begun_s, margins, mine, shift, soonest, spans, count)
        count = _stood(net, state, begun_s, free_s, margins, mine, shift, soonest, spans, count)
    stands, stand_s = base + at + length, net.begins_s[base + at + length] - began
    for row in range(net.stands_start[stands], net.stands_start[stands + 1]):
        place = net.stands_at[row]
        if place - net.base[net.owner[place]] < state[net.owner[place]]:
            soonest = max(soonest, begun_s[place] + net.stands_s[row, 1] + margins[0] - stand_s)
    return _outside(spans, count, soonest)


@compiled
def _entry(net, state, free_s, one, length, begin, entry) -> None:  # type: ignore[no-untyped-def]
    """Write the entry of a tractor: how many stretches, when each begins, and when it stands again."""
    place = net.base[one] + state[one]
    late = START_S if begin > free_s[one] + SAME_S or state[one] == 0 else 0.0
    for number in range(1, length):
        entry[1 + number] = begin + late + net.begins_s[place + number] - net.begins_s[place]
    entry[0], entry[1] = length, begin
    entry[1 + CHAIN] = begin + late + net.begins_s[place + length] - net.begins_s[place]


@compiled
def _earliest(net, state, begun_s, free_s, margins, refused_for, one, spans, entry) -> None:  # type: ignore[no-untyped-def]
    """When a tractor can enter its next stretch, or the next few in one go if that is sooner; length 0 for never."""
    soonest, at = free_s[one], state[one]
    for other in range(len(state)):
        if refused_for[one, other]:
            soonest = max(soonest, begun_s[net.base[other] + state[other] - 1] + MOVED_S)
    entry[0] = 0.0
    for length in range(1, min(CHAIN, net.base[one + 1] - net.base[one] - 1 - at) + 1):
        begin = _begin(net, state, begun_s, free_s, margins, one, length, soonest, spans)
        if begin < NEVER and (entry[0] == 0.0 or begin < entry[1] - SAME_S):
            _entry(net, state, free_s, one, length, begin, entry)
        if begin <= soonest + SAME_S:
            break


@compiled
def _next(net, state, free_s, eager, entries, tried):  # type: ignore[no-untyped-def]
    """The tractor whose entry is to be tried next, of those not tried yet; -1 for none.

    It is who can begin first; among equals who has most to do.
    """
    best, best_turn, best_left = -1, 0, 0
    for one in range(len(state)):
        if tried[one] or entries[one, 0] <= 0.0:
            continue
        turn = tenths(entries[one, 1] - eager * (entries[one, 1] - free_s[one]))
        left = tenths(net.begins_s[net.base[one + 1] - 1] - net.begins_s[net.base[one] + state[one]])
        if best < 0 or turn < best_turn or (turn == best_turn and left > best_left):
            best, best_turn, best_left = one, turn, left
    return best


@compiled
def _leaves_a_way_home(net, state, one, length, deep, after, reached, unsafe):  # type: ignore[no-untyped-def]
    """Whether all still get home when a tractor has gone on by so many stretches.

    What a deep look finds to be otherwise is marked `unsafe`, and not looked at again until that may have changed.
    """
    if unsafe[one, length]:
        return False
    copied(state, after)
    after[one] += length
    found = harmless(net, one, after) or one_by_one(net, after) or by_turns(net, after, deep, reached)
    unsafe[one, length] = deep and not found
    return found


@compiled
def _came_by(net, state, one, first, end, unsafe) -> None:  # type: ignore[no-untyped-def]
    """Look again at what was unsafe only because of stretches, from `first` to `end`, that a tractor has now entered.

    What leaves no way home leaves none after moves that it does not keep anybody from.
    """
    for other in range(len(state)):
        for length in range(unsafe.shape[1]):
            if other == one:
                unsafe[other, length] = False
            elif unsafe[other, length]:
                hold = net.base[other] + state[other] + length
                row = first_row(net.stands_at, net.stands_start[hold], net.stands_start[hold + 1], first)
                unsafe[other, length] = row == net.stands_start[hold + 1] or net.stands_at[row] >= end


@compiled
def _later(net, state, begun_s, free_s, margins, one, length, entry, spans, longer):  # type: ignore[no-untyped-def]
    """Whether so many stretches in one go need not begin much later than the entry has it; `longer` is that entry."""
    if length > net.base[one + 1] - net.base[one] - 1 - state[one]:
        return False
    begin = _begin(net, state, begun_s, free_s, margins, one, length, entry[1], spans)
    if begin > entry[1] + START_S:
        return False
    _entry(net, state, free_s, one, length, begin, longer)
    return True


@compiled
def _guard(net, state, begun_s, behind, mine, other, begin):  # type: ignore[no-untyped-def]
    """What keeps a tractor behind another that it would follow closely: a stretch and seconds; -1 for none."""
    start, first = net.apart_start[mine], net.base[other]
    start = first_row(net.apart_at, start, net.apart_start[mine + 1], first)
    row = first_row(net.apart_at, start, net.apart_start[mine + 1], first + state[other])
    while row > start:
        place = net.apart_at[row - 1]
        if begun_s[place] + (net.begins_s[place + 1] - net.begins_s[place]) < begin - GUARDED_S:
            break
        after, passed = MOVED_S, False
        while row > start and net.apart_at[row - 1] == place:
            row -= 1
            high = net.apart_s[row, 1] + behind
            if begin - GUARDED_S < begun_s[place] + high <= begin + SAME_S:
                after, passed = max(after, high), True
        if passed and begun_s[place] + after <= begin + SAME_S:
            return place, after
    return -1, 0.0


@compiled
def _noted(gates, count, mine, place, after):  # type: ignore[no-untyped-def]
    """The gates with one more: before stretch `mine`, open when another has been on the stretch `place` for so long."""
    if count == len(gates):
        more = np.empty((2 * len(gates), 3))
        for row in range(count):
            copied(gates[row], more[row])
        gates = more
    gates[count, 0], gates[count, 1], gates[count, 2] = mine, place, after
    return gates, count + 1


@compiled
def _cleared(net, state, begun_s, behind, refused_for, one, entry, gates, count):  # type: ignore[no-untyped-def]
    """Gates on those that had to get on first, lest not all get home, or to come by where this one will stand."""
    mine, length = net.base[one] + state[one], int(entry[0])
    for other in range(len(state)):
        if refused_for[one, other]:
            gates, count = _noted(gates, count, mine, net.base[other] + state[other] - 1, MOVED_S)
    stand_s = entry[1 + CHAIN] - entry[1]
    for row in range(net.stands_start[mine + length], net.stands_start[mine + length + 1]):
        place = net.stands_at[row]
        if place - net.base[net.owner[place]] < state[net.owner[place]]:
            after = net.stands_s[row, 1] + behind - stand_s
            due = begun_s[place] + max(after, MOVED_S)
            if after > 0.0 and entry[1] - GUARDED_S < due <= entry[1] + SAME_S:
                gates, count = _noted(gates, count, mine, place, after)
    return gates, count


@compiled
def _enter(net, state, begun_s, free_s, behind, refused, refused_for, one, entry, gates, count):  # type: ignore[no-untyped-def]
    """Write an entry into the timetable, with the gates that make it so."""
    mine, length = net.base[one] + state[one], int(entry[0])
    for number in range(length):
        for other in range(len(state)):
            if net.near[one, other]:
                place, after = _guard(net, state, begun_s, behind, mine + number, other, entry[1 + number])
                if place >= 0:
                    gates, count = _noted(gates, count, mine + number, place, after)
    gates, count = _cleared(net, state, begun_s, behind, refused_for, one, entry, gates, count)
    for number in range(length):
        begun_s[mine + number] = entry[1 + number]
    state[one] += length
    free_s[one] = entry[1 + CHAIN]
    for other in range(len(state)):
        place = net.base[other] + state[other] - 1 if net.near[one, other] else -1
        while place >= net.base[other] and begun_s[place] > entry[1]:
            ahead, after = _guard(net, state, begun_s, behind, place, one, begun_s[place])
            if ahead >= 0:
                gates, count = _noted(gates, count, place, ahead, after)
            place -= 1
        refused_for[one, other] = False
        refused_for[other, one] = refused[other] and other != one
    refused[one] = False
    return gates, count


@compiled
def filled(net, concerned, most, margins, manner, deep):  # type: ignore[no-untyped-def]
    """A timetable in which the entry comes next that can be soonest and leaves everybody a way home.

    `margins` are seconds behind and ahead, `manner` how eager and whether to go on, `deep` how ways home are looked
    for; `concerned` (n, n) tells whether what one may do can depend on another, `most` how many spans one entry can
    depend on. Returns when each stretch is begun (p,), when each tractor stands for good (n,; the first nan where no
    entry was left), and gates (k, 3): before which stretch, open when which other has been begun for so long.
    """
    count = len(net.base) - 1
    state, free_s, begun_s = np.zeros(count, dtype=np.int64), np.zeros(count), np.full(len(net.owner), np.nan)
    entries, known, longer = np.zeros((count, CHAIN + 2)), np.zeros(count, dtype=np.bool_), np.zeros(CHAIN + 2)
    refused, refused_for = np.zeros(count, dtype=np.bool_), np.zeros((count, count), dtype=np.bool_)
    unsafe, tried = np.zeros((count, CHAIN + 1), dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    spans, after, reached = np.empty((most, 2)), np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    gates, written = np.empty((64, 3)), np.int64(0)
    left = len(net.owner) - count
    while left > 0:
        for one in range(count):
            tried[one] = False
            if not known[one]:
                _earliest(net, state, begun_s, free_s, margins, refused_for, one, spans, entries[one])
                known[one] = True
        one, length = _next(net, state, free_s, manner[0], entries, tried), 0
        while one >= 0:
            length = int(entries[one, 0])
            copied(entries[one], longer)
            while not _leaves_a_way_home(net, state, one, length, deep, after, reached, unsafe):
                length += 1
                while length <= CHAIN and not (
                    manner[1] and _later(net, state, begun_s, free_s, margins, one, length, entries[one], spans, longer)
                ):
                    length += 1
                if length > CHAIN:
                    break
            if length <= CHAIN:
                break
            tried[one] = refused[one] = True
            one = _next(net, state, free_s, manner[0], entries, tried)
        if one < 0:
            free_s[0] = np.nan
            break
        first = net.base[one] + state[one]
        left -= length
        gates, written = _enter(
            net, state, begun_s, free_s, margins[0], refused, refused_for, one, longer, gates, written
        )
        _came_by(net, state, one, first, first + length, unsafe)
        for other in range(count):
            if other == one or refused[other] or concerned[other, one]:
                known[other] = False
    return begun_s, free_s, gates[:written]
