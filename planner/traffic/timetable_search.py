"""When each tractor begins each of its segments, compiled: the entries of a timetable, one after another.

Times used by others are spans; the earliest time outside all of them is when a tractor can begin. Only segments that
others have begun, or stand before, matter, and of those only what is not over yet.
"""

from __future__ import annotations

import math

import numpy as np

from planner.traffic.deadlock_search import (
    are_pairs_safe,
    drop_moves,
    find_first_place_row,
    find_way_home,
    is_off_remaining_paths,
    is_on_way_home,
    round_to_tenths,
)
from vehicle.copying import copy_row
from vehicle.jit import compile_function

GAP_BEHIND_S = 3.0  # time that a tractor leaves behind the one before
GAP_AHEAD_S = 6.0  # time that a tractor keeps ahead of one already on its way
START_LOSS_S = 1.5  # lost by a tractor that had to stand
GUARD_LIMIT_S = 120.0  # with less time between two a gate guards their order even if predicted unnecessary
MAX_CHAIN = 4  # segments entered in one go if there is no room to stand between them
MIN_STANDING_S = 0.5  # a tractor that stood for less has passed by
MOVED_OFF_S = 2.0  # a tractor that has been on a segment for this long has left its hold point
TIME_TOLERANCE_S = 0.05
NEVER_S = math.inf


@compile_function
def _measure_stand_s(net, begun_s, place, first):  # type: ignore[no-untyped-def]
    """How long a tractor stood before a segment that it has begun, start loss included (s); infinite for its first."""
    if place == first:
        return NEVER_S
    return begun_s[place] - begun_s[place - 1] - (net.begins_s[place] - net.begins_s[place - 1])


@compile_function
def _add_exclusions(net, state, begun_s, margins, own_segment, shift, soonest, spans, count):  # type: ignore[no-untyped-def]
    """Add the spans in which a segment must not be begun because of segments that others have begun."""
    start, row = net.apart_start[own_segment], net.apart_start[own_segment + 1]
    while row > start:
        other_tractor = net.owner[net.apart_at[row - 1]]
        first = net.base[other_tractor]
        row = find_first_place_row(net.apart_at, start, row, first + state[other_tractor])
        while row > start and net.apart_at[row - 1] >= first:
            place = net.apart_at[row - 1]
            lasts_s = net.begins_s[place + 1] - net.begins_s[place]
            if begun_s[place] + lasts_s + 2.0 * margins[0] + START_LOSS_S < soonest:
                row = find_first_place_row(net.apart_at, start, row, first)
                break
            row -= 1
            behind_s = net.apart_s[row, 1] + margins[0]
            # A gate cannot tell how long somebody stands, but that it has gone on.
            if _measure_stand_s(net, begun_s, place, first) > START_LOSS_S + MIN_STANDING_S:
                behind_s = max(behind_s, MOVED_OFF_S)
            spans[count, 0] = begun_s[place] + net.apart_s[row, 0] - margins[1] - shift
            spans[count, 1] = begun_s[place] + behind_s - shift
            count += 1
    return count


@compile_function
def _add_standing_spans(net, state, begun_s, free_s, margins, own_segment, shift, soonest, spans, count):  # type: ignore[no-untyped-def]
    """Add the spans in which a segment must not be begun because of where others stand, or have stood."""
    for row in range(net.blockers_start[own_segment], net.blockers_start[own_segment + 1]):
        place = net.blockers_at[row]
        other_tractor = net.owner[place]
        number = place - net.base[other_tractor]
        if number > state[other_tractor]:
            continue
        low_s, high_s, came_s = -NEVER_S, NEVER_S, -NEVER_S
        if number > 0:
            came_s = begun_s[place - 1] + (net.begins_s[place] - net.begins_s[place - 1])
        if number == state[other_tractor]:
            low_s = free_s[other_tractor] - net.blockers_s[row, 1] - margins[1] if number > 0 else -NEVER_S
        else:
            high_s = begun_s[place] + max(MOVED_OFF_S, margins[0] - net.blockers_s[row, 0])
            if begun_s[place] - came_s <= MIN_STANDING_S or high_s - shift <= soonest:
                continue
            low_s = came_s - net.blockers_s[row, 1] - margins[1]
        spans[count, 0], spans[count, 1] = low_s - shift, high_s - shift
        count += 1
    return count


@compile_function
def _find_free_begin_s(spans, count, soonest):  # type: ignore[no-untyped-def]
    """The earliest time from `soonest` on that is in none of the spans."""
    before = -NEVER_S
    while before < soonest:
        before = soonest
        for row in range(count):
            if spans[row, 0] <= soonest < spans[row, 1]:
                soonest = spans[row, 1]
    return soonest


@compile_function
def _find_begin_s(net, state, begun_s, free_s, margins, tractor, length, soonest, spans):  # type: ignore[no-untyped-def]
    """The earliest time from `soonest` on at which a tractor can begin `length` segments in one go."""
    base, segment_number, count = net.base[tractor], state[tractor], np.int64(0)
    began_s = net.begins_s[base + segment_number]
    for own_segment in range(base + segment_number, base + segment_number + length):
        shift = net.begins_s[own_segment] - began_s
        for row in range(net.waits_start[own_segment], net.waits_start[own_segment + 1]):
            place = net.waits_at[row]
            other_tractor = net.owner[place]
            if place - net.base[other_tractor] >= state[other_tractor]:
                return NEVER_S
            soonest = max(soonest, begun_s[place] + net.waits_s[row] - shift)
        count = _add_exclusions(net, state, begun_s, margins, own_segment, shift, soonest, spans, count)
        count = _add_standing_spans(net, state, begun_s, free_s, margins, own_segment, shift, soonest, spans, count)
    stands, stand_s = base + segment_number + length, net.begins_s[base + segment_number + length] - began_s
    for row in range(net.stands_start[stands], net.stands_start[stands + 1]):
        place = net.stands_at[row]
        if place - net.base[net.owner[place]] < state[net.owner[place]]:
            soonest = max(soonest, begun_s[place] + net.stands_s[row, 1] + margins[0] - stand_s)
    return _find_free_begin_s(spans, count, soonest)


@compile_function
def _write_entry(net, state, free_s, tractor, length, begin_s, entry) -> None:  # type: ignore[no-untyped-def]
    """Write the entry of a tractor: how many segments, when each begins, and when it stands again."""
    place = net.base[tractor] + state[tractor]
    start_loss_s = START_LOSS_S if begin_s > free_s[tractor] + TIME_TOLERANCE_S or state[tractor] == 0 else 0.0
    for number in range(1, length):
        entry[1 + number] = begin_s + start_loss_s + net.begins_s[place + number] - net.begins_s[place]
    entry[0], entry[1] = length, begin_s
    entry[1 + MAX_CHAIN] = begin_s + start_loss_s + net.begins_s[place + length] - net.begins_s[place]


@compile_function
def _find_earliest_entry(net, state, begun_s, free_s, margins, refused_for, tractor, most, spans, entry) -> None:  # type: ignore[no-untyped-def]
    """When a tractor can enter its next segment, or up to `most` in one go if that is sooner; length 0 for never."""
    soonest, segment_number = free_s[tractor], state[tractor]
    for other_tractor in range(len(state)):
        if refused_for[tractor, other_tractor]:
            soonest = max(soonest, begun_s[net.base[other_tractor] + state[other_tractor] - 1] + MOVED_OFF_S)
    entry[0] = 0.0
    for length in range(1, min(most, net.base[tractor + 1] - net.base[tractor] - 1 - segment_number) + 1):
        begin_s = _find_begin_s(net, state, begun_s, free_s, margins, tractor, length, soonest, spans)
        if begin_s < NEVER_S and (entry[0] == 0.0 or begin_s < entry[1] - TIME_TOLERANCE_S):
            _write_entry(net, state, free_s, tractor, length, begin_s, entry)
        if begin_s <= soonest + TIME_TOLERANCE_S:
            break


@compile_function
def _pick_next_tractor(net, state, free_s, eager, leads_s, entries, tried):  # type: ignore[no-untyped-def]
    """The tractor whose entry is to be tried next, of those not tried yet; -1 for none.

    It is the one that can begin first, with its lead; among equals the one with most left to do.
    """
    best_tractor, best_turn, best_remaining = -1, 0, 0
    for tractor in range(len(state)):
        if tried[tractor] or entries[tractor, 0] <= 0.0:
            continue
        waits_s = entries[tractor, 1] - free_s[tractor]
        turn = round_to_tenths(entries[tractor, 1] - leads_s[tractor] - eager * waits_s)
        remaining = round_to_tenths(
            net.begins_s[net.base[tractor + 1] - 1] - net.begins_s[net.base[tractor] + state[tractor]]
        )
        if best_tractor < 0 or turn < best_turn or (turn == best_turn and remaining > best_remaining):
            best_tractor, best_turn, best_remaining = tractor, turn, remaining
    return best_tractor


@compile_function
def _stays_deadlock_free(net, state, tractor, length, way, states, unsafe):  # type: ignore[no-untyped-def]
    """Whether all can still get home after a tractor has gone on by `length` segments; `way` then tells how.

    `way` are the moves that were left before, and becomes what is left after, at its end. Where none is found `unsafe`
    is marked, and none searched again until that may have changed. `states` (2, n) is overwritten.
    """
    state_after = states[0]
    copy_row(state, state_after)
    state_after[tractor] += length
    if is_off_remaining_paths(net, state, tractor, state[tractor] + length) or is_on_way_home(
        net, state_after, tractor, length, way, states[1]
    ):
        drop_moves(way, tractor, length)
        return True
    if not unsafe[tractor, length]:
        unsafe[tractor, length] = not (
            are_pairs_safe(net, state_after, tractor) and find_way_home(net, state_after, states[1], way)
        )
    return not unsafe[tractor, length]


@compile_function
def _clear_unsafe_marks(net, state, tractor, first, end, unsafe) -> None:  # type: ignore[no-untyped-def]
    """Clear `unsafe` marks due only to segments from `first` to `end` that a tractor has now entered.

    A state with no way home still has none after moves that it does not block.
    """
    for other_tractor in range(len(state)):
        for length in range(unsafe.shape[1]):
            if other_tractor == tractor:
                unsafe[other_tractor, length] = False
            elif unsafe[other_tractor, length]:
                hold = net.base[other_tractor] + state[other_tractor] + length
                row = find_first_place_row(net.stands_at, net.stands_start[hold], net.stands_start[hold + 1], first)
                unsafe[other_tractor, length] = row == net.stands_start[hold + 1] or net.stands_at[row] >= end


@compile_function
def _find_following_guard(net, state, begun_s, behind_s, own_segment, other_tractor, begin_s):  # type: ignore[no-untyped-def]
    """What keeps a tractor behind another that it would follow closely: a segment and seconds; -1 for none.

    It is the last segment that the other has been on for a while then, with the seconds after which it is clear of all.
    """
    start, first = net.apart_start[own_segment], net.base[other_tractor]
    start = find_first_place_row(net.apart_at, start, net.apart_start[own_segment + 1], first)
    row = find_first_place_row(net.apart_at, start, net.apart_start[own_segment + 1], first + state[other_tractor])
    clear_s, guard = -NEVER_S, np.int64(-1)
    while row > start:
        place = net.apart_at[row - 1]
        if begun_s[place] + (net.begins_s[place + 1] - net.begins_s[place]) < begin_s - GUARD_LIMIT_S:
            break
        while row > start and net.apart_at[row - 1] == place:
            row -= 1
            passed_s = begun_s[place] + net.apart_s[row, 1] + behind_s
            if max(begin_s - GUARD_LIMIT_S, clear_s) < passed_s <= begin_s + TIME_TOLERANCE_S:
                clear_s, guard = passed_s, max(guard, place)
    while guard > first and begun_s[guard] + MOVED_OFF_S > begin_s + TIME_TOLERANCE_S:
        guard -= 1
    if guard < 0 or begun_s[guard] + MOVED_OFF_S > begin_s + TIME_TOLERANCE_S:
        return -1, 0.0
    return guard, max(MOVED_OFF_S, clear_s - begun_s[guard])


@compile_function
def _append_gate(gates, count, own_segment, place, after_s):  # type: ignore[no-untyped-def]
    """The gates with one more: before `own_segment`, open when another has been on segment `place` for `after_s`."""
    if count == len(gates):
        grown_gates = np.empty((2 * len(gates), 3))
        for row in range(count):
            copy_row(gates[row], grown_gates[row])
        gates = grown_gates
    gates[count, 0], gates[count, 1], gates[count, 2] = own_segment, place, after_s
    return gates, count + 1


@compile_function
def _add_clearing_gates(net, state, begun_s, behind_s, refused_for, tractor, entry, gates, count):  # type: ignore[no-untyped-def]
    """Gates on those that must move on first: so that all get home, off the way, or past where this one will stand."""
    own_segment, length = net.base[tractor] + state[tractor], int(entry[0])
    for other_tractor in range(len(state)):
        if refused_for[tractor, other_tractor]:
            gates, count = _append_gate(
                gates, count, own_segment, net.base[other_tractor] + state[other_tractor] - 1, MOVED_OFF_S
            )
    for number in range(length):
        for row in range(net.blockers_start[own_segment + number], net.blockers_start[own_segment + number + 1]):
            place = net.blockers_at[row]
            if place - net.base[net.owner[place]] < state[net.owner[place]]:
                after_s = max(MOVED_OFF_S, behind_s - net.blockers_s[row, 0])
                due_s = begun_s[place] + after_s
                if entry[1 + number] - GUARD_LIMIT_S < due_s <= entry[1 + number] + TIME_TOLERANCE_S:
                    gates, count = _append_gate(gates, count, own_segment + number, place, after_s)
    stand_s = entry[1 + MAX_CHAIN] - entry[1]
    for row in range(net.stands_start[own_segment + length], net.stands_start[own_segment + length + 1]):
        place = net.stands_at[row]
        if place - net.base[net.owner[place]] < state[net.owner[place]]:
            after_s = net.stands_s[row, 1] + behind_s - stand_s
            due_s = begun_s[place] + max(after_s, MOVED_OFF_S)
            if after_s > 0.0 and entry[1] - GUARD_LIMIT_S < due_s <= entry[1] + TIME_TOLERANCE_S:
                gates, count = _append_gate(gates, count, own_segment, place, after_s)
    return gates, count


@compile_function
def _commit_entry(net, state, begun_s, free_s, behind_s, refused, refused_for, tractor, entry, gates, count):  # type: ignore[no-untyped-def]
    """Write an entry into the timetable, with the gates that enforce it."""
    own_segment, length = net.base[tractor] + state[tractor], int(entry[0])
    for number in range(length):
        for other_tractor in range(len(state)):
            if net.near[tractor, other_tractor]:
                place, after_s = _find_following_guard(
                    net, state, begun_s, behind_s, own_segment + number, other_tractor, entry[1 + number]
                )
                if place >= 0:
                    gates, count = _append_gate(gates, count, own_segment + number, place, after_s)
    gates, count = _add_clearing_gates(net, state, begun_s, behind_s, refused_for, tractor, entry, gates, count)
    for number in range(length):
        begun_s[own_segment + number] = entry[1 + number]
    state[tractor] += length
    free_s[tractor] = entry[1 + MAX_CHAIN]
    for other_tractor in range(len(state)):
        place = net.base[other_tractor] + state[other_tractor] - 1 if net.near[tractor, other_tractor] else -1
        while place >= net.base[other_tractor] and begun_s[place] > entry[1]:
            ahead, after_s = _find_following_guard(net, state, begun_s, behind_s, place, tractor, begun_s[place])
            if ahead >= 0:
                gates, count = _append_gate(gates, count, place, ahead, after_s)
            place -= 1
        refused_for[tractor, other_tractor] = False
        refused_for[other_tractor, tractor] = refused[other_tractor] and other_tractor != tractor
    refused[tractor] = False
    return gates, count


@compile_function
def fill_timetable(net, is_concerned, max_spans, margins_s, eager, leads_s, start, way):  # type: ignore[no-untyped-def]
    """A timetable in which the earliest possible entry comes next that leaves everybody a way home.

    `margins_s` are seconds behind and ahead, `leads_s` (n,) by how much earlier a tractor is taken than it can begin,
    `eager` as in precedence.EAGERNESS. `start` (n,) is where each begins: 1 is already on its first segment. `way`
    (k,) is a way home from there, the tractors by whom the segments of all are driven, one moving at a time.
    `is_concerned` (n, n) tells whether what one may do can depend on another, `max_spans` how many spans one entry can
    depend on.

    Returns when each segment is begun (p,), when each tractor stands for good (n,; the first nan if no entry was left),
    and gates (k, 3): before which segment, which other segment, and for how long that must have been begun (s).
    """
    count = len(net.base) - 1
    state, free_s, begun_s = start.copy(), np.zeros(count), np.full(len(net.owner), np.nan)
    entries, is_current = np.zeros((count, MAX_CHAIN + 2)), np.zeros(count, dtype=np.bool_)
    refused, refused_for = np.zeros(count, dtype=np.bool_), np.zeros((count, count), dtype=np.bool_)
    unsafe, tried = np.zeros((count, MAX_CHAIN + 1), dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    spans = np.empty((max_spans, 2))
    states, way = np.empty((2, count), dtype=np.int64), way.copy()
    gates, gate_count = np.empty((64, 3)), np.int64(0)
    remaining = len(net.owner) - count
    for tractor in range(count):
        if state[tractor] > 0:
            first = net.base[tractor]
            begun_s[first], free_s[tractor] = 0.0, net.begins_s[first + 1] - net.begins_s[first]
            remaining -= 1
    while remaining > 0:
        for tractor in range(count):
            tried[tractor] = False
            if not is_current[tractor]:
                is_current[tractor], most = True, MAX_CHAIN
                _find_earliest_entry(
                    net, state, begun_s, free_s, margins_s, refused_for, tractor, most, spans, entries[tractor]
                )
        tractor = _pick_next_tractor(net, state, free_s, eager, leads_s, entries, tried)
        while tractor >= 0:
            most = int(entries[tractor, 0]) - 1
            if _stays_deadlock_free(net, state, tractor, most + 1, way[len(way) - remaining :], states, unsafe):
                break
            refused[tractor], tried[tractor] = True, most == 0
            _find_earliest_entry(
                net, state, begun_s, free_s, margins_s, refused_for, tractor, most, spans, entries[tractor]
            )
            tractor = _pick_next_tractor(net, state, free_s, eager, leads_s, entries, tried)
        if tractor < 0:
            free_s[0] = np.nan
            break
        length = int(entries[tractor, 0])
        first = net.base[tractor] + state[tractor]
        remaining -= length
        gates, gate_count = _commit_entry(
            net,
            state,
            begun_s,
            free_s,
            margins_s[0],
            refused,
            refused_for,
            tractor,
            entries[tractor],
            gates,
            gate_count,
        )
        _clear_unsafe_marks(net, state, tractor, first, first + length, unsafe)
        for other_tractor in range(count):
            if other_tractor == tractor or refused[other_tractor] or is_concerned[other_tractor, tractor]:
                is_current[other_tractor] = False
    return begun_s, free_s, gates[:gate_count]
