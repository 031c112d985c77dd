"""The best word between two poses inside a region, compiled: the inner loop of every way that is looked for.

`rules` gathers what a search needs beside the poses: see `make_rules`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from strategies.ways.words import (
    MOST_PIECES,
    MOST_WORDS,
    SNAP,
    TAU,
    arc_room_m,
    awkward_s,
    backing_words,
    cusped_words,
    driven_s,
    edge_met,
    forward_words,
    inside,
    remainder,
    word_fits,
)
from vehicle.jit import compiled

Floats = npt.NDArray[np.float64]

# Fields of the rules of a search.
RULES = np.dtype(
    [
        ("radius", "f8"),
        ("speeds", "f8", (4,)),  # forward and reverse (m/s), seconds per direction change, seconds per 1/m of swing
        ("kinds", "f8", (4,)),  # 1 where ROUTE, U, OMEGA, SWITCH_BACK are allowed
        ("full_arc", "f8"),  # radii
        ("short_s", "f8"),
        ("curved_s", "f8"),
        ("near", "f8"),  # radii within which straights at the ends are tried
        ("steps", "f8", (3,)),  # their lengths, m
    ]
)
CLEARLY_M = 1e-6  # more than an arc driven the other way round differs by rounding
NO_END = np.full(2, np.inf)
REACH = 6.0  # radii: no word leads farther from the box of its ends, straights at the ends apart


@compiled
def cost_s(word, rules) -> float:  # type: ignore[no-untyped-def]
    """Seconds to drive a word and what it is charged for being hard to follow."""
    return driven_s(word, rules.speeds) + awkward_s(word, rules.radius, rules.full_arc, rules.short_s, rules.curved_s)


@compiled
def _cheapest_fitting(a, out, costs, count, edges) -> tuple[int, bool]:  # type: ignore[no-untyped-def]
    """Place of the cheapest word that fits, -1 for none, and whether it is the cheapest of all."""
    first = True
    while True:
        best = -1
        for k in range(count):
            if costs[k] < np.inf and (best < 0 or costs[k] < costs[best]):
                best = k
        if best < 0 or word_fits(a, out[best], edges):
            return best, first
        costs[best] = np.inf
        first = False


@compiled
def _words_of(a, b, rules, limit, out, kinds, costs) -> int:  # type: ignore[no-untyped-def]
    """Words allowed from a to b, with their rounded costs; those that must take `limit` seconds or more may lack."""
    count = forward_words(a, b, rules.radius, out, kinds, 0)
    for k in range(count):
        length = 0.0
        for piece in range(MOST_PIECES):
            length += out[k, piece, 0]
        costs[k] = 0.0 if length < limit * rules.speeds[0] else np.inf
    forward = count
    if rules.kinds[3] > 0.0:
        turning = abs(remainder(b[2] - a[2])) * rules.radius
        if turning / max(rules.speeds[0], rules.speeds[1]) + 2.0 * rules.speeds[2] < limit:
            count = cusped_words(a, b, rules.radius, out, kinds, count)
            count = backing_words(a, b, rules.radius, out, kinds, count)
    for k in range(count):
        if rules.kinds[kinds[k]] == 0.0 or (k < forward and costs[k] == np.inf):
            costs[k] = np.inf
        else:
            costs[k] = round(cost_s(out[k], rules), 6)
    return count


@compiled
def _level(a, b, rules, number) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """The straights (m) before and after a word that are tried as the `number`-th; (-1, -1) when there are no more."""
    if number < 8:
        pair = number + 1  # (0, 0) is the plain word
        return rules.steps[pair // 3], rules.steps[pair % 3]
    on = (b[0] - a[0]) * math.cos(a[2]) + (b[1] - a[1]) * math.sin(a[2])
    if number < 11 and abs(on) > 1e-6 and math.cos(b[2] - a[2]) < -0.9:
        step = rules.steps[number - 8]
        return step + max(0.0, on), step + max(0.0, -on)
    return -1.0, -1.0


@compiled
def _lengthened(word, before, after, out) -> None:  # type: ignore[no-untyped-def]
    """Put a straight before and one after the three pieces of a word."""
    for piece in range(3):
        out[piece + 1, 0], out[piece + 1, 1], out[piece + 1, 2] = word[piece, 0], word[piece, 1], word[piece, 2]
    out[0, 0], out[0, 1], out[0, 2] = before, 0.0, 1.0
    out[4, 0], out[4, 1], out[4, 2] = after, 0.0, 1.0


@compiled
def _with_straights(a, b, rules, edges, bar, best) -> int:  # type: ignore[no-untyped-def]
    """The cheapest fitting word after driving straight on at either end, if cheaper than `bar`, into `best` (5, 3).

    Returns its kind, -1 when there is none.
    """
    most = 11 * MOST_WORDS
    longer, kind_of, cost_of = np.empty((most, MOST_PIECES, 3)), np.empty(most, np.int64), np.empty(most)
    out, kinds, costs = np.empty((MOST_WORDS, MOST_PIECES, 3)), np.empty(MOST_WORDS, np.int64), np.empty(MOST_WORDS)
    p, q = np.empty(3), np.empty(3)
    total = 0
    for number in range(11):
        before, after = _level(a, b, rules, number)
        if before < 0.0:
            break
        p[0], p[1], p[2] = a[0] + before * math.cos(a[2]), a[1] + before * math.sin(a[2]), remainder(a[2])
        q[0], q[1], q[2] = b[0] - after * math.cos(b[2]), b[1] - after * math.sin(b[2]), b[2]
        count = _words_of(p, q, rules, bar - (before + after) / rules.speeds[0], out, kinds, costs)
        for k in range(count):
            if costs[k] == np.inf:
                continue
            _lengthened(out[k], before, after, longer[total])
            cost = round(cost_s(longer[total], rules), 6)
            if cost < bar:
                kind_of[total], cost_of[total] = kinds[k], cost
                total += 1
    place, _ = _cheapest_fitting(a, longer, cost_of, total, edges)
    if place < 0:
        return -1
    best[:] = longer[place]
    return kind_of[place]  # type: ignore[no-any-return]


@compiled
def edges_near(a, b, reach, edges):  # type: ignore[no-untyped-def]
    """The edges that come within `reach` of the box of two poses."""
    west, east = min(a[0], b[0]) - reach, max(a[0], b[0]) + reach
    south, north = min(a[1], b[1]) - reach, max(a[1], b[1]) + reach
    near = np.empty_like(edges)
    count = 0
    for k in range(len(edges)):
        p, q, r, s = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if max(p, r) >= west and min(p, r) <= east and max(q, s) >= south and min(q, s) <= north:
            near[count, 0], near[count, 1], near[count, 2], near[count, 3] = p, q, r, s
            count += 1
    return near[:count]


@compiled
def best_word(a, b, rules, edges, best) -> int:  # type: ignore[no-untyped-def]
    """The cheapest word from a to b inside the region, put into `best` (5, 3); its kind, -1 when there is none.

    Where the poses are near each other and the cheapest word of all does not fit, straights at its ends are tried.
    """
    if not inside(a[0], a[1], edges) or not inside(b[0], b[1], edges):
        return -1
    return best_inside(a, b, rules, edges, best)


@compiled
def best_inside(a, b, rules, edges, best) -> int:  # type: ignore[no-untyped-def]
    """As `best_word` between poses that are known to lie inside; `edges` are all that are within reach of them."""
    apart = math.hypot(b[0] - a[0], b[1] - a[1])
    edges = edges_near(a, b, apart + REACH * rules.radius + 2.0 * rules.steps[2], edges)
    out, kinds, costs = np.empty((MOST_WORDS, MOST_PIECES, 3)), np.empty(MOST_WORDS, np.int64), np.empty(MOST_WORDS)
    count = _words_of(a, b, rules, np.inf, out, kinds, costs)
    place, first = _cheapest_fitting(a, out, costs, count, edges)
    kind, bar = -1, np.inf
    if place >= 0:
        best[:] = out[place]
        kind, bar = kinds[place], costs[place]
    near = apart <= rules.near * rules.radius
    if near and (place < 0 or not first):
        other = _with_straights(a, b, rules, edges, bar, best)
        kind = other if other >= 0 else kind
    return kind


@compiled
def shortest_m(a, b, radius) -> float:  # type: ignore[no-untyped-def]
    """Length of the shortest forward word, whether it fits anywhere or not (m)."""
    out, kinds = np.empty((MOST_WORDS, MOST_PIECES, 3)), np.empty(MOST_WORDS, np.int64)
    forward_words(a, b, radius, out, kinds, 0)
    total = 0.0
    for piece in range(MOST_PIECES):
        total += out[0, piece, 0]
    return total


@compiled
def best_costs(starts, ends, pairs, rules, edges):  # type: ignore[no-untyped-def]
    """Seconds, as of `cost_s`, and metres (k, 2) of the best words of many pairs; infinite where there is none.

    `pairs` (k, 2) are numbers of `starts` (n, 3) and `ends` (m, 3); those with one start follow one another. A word so
    much longer than the shortest that a route may beat it is none, nor one with so much reversing.
    """
    out, row, spare = np.full((len(pairs), 2), np.inf), np.empty((MOST_PIECES, 3)), 2.0 * TAU * rules.radius
    ends_held = np.array([inside(ends[q, 0], ends[q, 1], edges) for q in range(len(ends))])
    k = 0
    while k < len(pairs):
        a, last, far = starts[pairs[k, 0]], k, 0.0
        while last < len(pairs) and pairs[last, 0] == pairs[k, 0]:
            b = ends[pairs[last, 1]]
            far = max(far, math.hypot(b[0] - a[0], b[1] - a[1]))
            last += 1
        if inside(a[0], a[1], edges):
            near = edges_near(a, a, 2.0 * far + REACH * rules.radius + 2.0 * rules.steps[2], edges)
            for place in range(k, last):
                b = ends[pairs[place, 1]]
                if not ends_held[pairs[place, 1]] or best_inside(a, b, rules, near, row) < 0:
                    continue
                length, reverse = row[:, 0].sum(), (row[:, 0] * (row[:, 2] < 0.0)).sum()
                if length <= shortest_m(a, b, rules.radius) + spare and reverse <= spare:
                    out[place, 0], out[place, 1] = cost_s(row, rules), length
        k = last
    return out


@compiled
def shortest_forward(a, b, radius, edges, most, best) -> int:  # type: ignore[no-untyped-def]
    """The shortest fitting of the `most` shortest forward words into `best`; its kind, -1 when there is none."""
    if not inside(a[0], a[1], edges):
        return -1
    return fitting_forward(a, b, radius, edges, most, best)


@compiled
def fitting_forward(a, b, radius, edges, most, best) -> int:  # type: ignore[no-untyped-def]
    """As `shortest_forward` from a pose that is known to lie inside."""
    return fitting_in_room(a, b, NO_END, NO_END, np.full((1, 4), np.inf), radius, edges, most, best)


@compiled
def fitting_in_room(a, b, ahead, behind, barrier, radius, edges, most, best) -> int:  # type: ignore[no-untyped-def]
    """As `fitting_forward` where it is known how far arcs to the left and to the right lead before they meet an edge.

    `ahead` (2,) is that from a, `behind` (2,) that driven back from b (m). `barrier` (1, 4) is the edge met last, which
    is in the way of most words between poses near the last ones too, and so is asked first; infinite at the beginning.
    """
    out, kinds = np.empty((MOST_WORDS, MOST_PIECES, 3)), np.empty(MOST_WORDS, np.int64)
    count = min(forward_words(a, b, radius, out, kinds, 0), most)
    near = edges[:0]
    for k in range(count):
        if _leaves(out[k, 0], ahead) or _leaves(out[k, 2], behind):
            continue
        if not word_fits(a, out[k], barrier):
            continue
        if not len(near):
            near = edges_near(a, b, math.hypot(b[0] - a[0], b[1] - a[1]) + REACH * radius, edges)
        met = edge_met(a, out[k], near)
        if met < 0:
            best[:] = out[k]
            return kinds[k]  # type: ignore[no-any-return]
        barrier[0] = near[met]
    return -1


@compiled
def _leaves(arc, room) -> bool:  # type: ignore[no-untyped-def]
    """Whether an arc at one end of a word is clearly longer than there is room for."""
    return arc[0] > SNAP and arc[0] > room[0 if arc[1] > 0.0 else 1] + CLEARLY_M  # type: ignore[no-any-return]


@compiled
def room_m(pose, gear, radius, edges, out) -> None:  # type: ignore[no-untyped-def]
    """Put into `out` (2,) how far arcs to the left and to the right lead from a pose before they meet an edge (m)."""
    near = edges_near(pose, pose, 2.0 * radius, edges)
    for side in range(2):
        out[side] = arc_room_m(pose[0], pose[1], pose[2], (1.0 - 2.0 * side) / radius, gear, near)
