"""The closed-form ways to join two poses, compiled: which words there are, what they cost, whether they stay inside.

A word is a row of `MOST_PIECES` segments (length m, curvature 1/m, gear) with zero lengths where it has fewer. Words
come in families, the shortest first in each: Dubins' six (with both places of the middle circle of the three-arc
ones), Reeds and Shepp's C|C|C, and arc, straight in reverse, arc. `ways.paths` gives the sources and says it in
objects.
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.jit import compiled

ROUTE, U, OMEGA, SWITCH_BACK = 0, 1, 2, 3
MOST_WORDS, MOST_PIECES = 16, 5
TAU = 2.0 * math.pi
SNAP = 1e-12  # arcs (rad) and straights (m) shorter than this are rounding, not driving
FULL_TURN = TAU + 1e-9
SAME_LENGTH = 1e-9


@compiled
def remainder(angle: float) -> float:
    """The angle in [-pi, pi]; halves go to the even multiple, as math.remainder has it."""
    return angle - TAU * np.round(angle / TAU)  # type: ignore[no-any-return]


@compiled
def turned(hand: float, start: float, end: float) -> float:
    """Angle in [0, 2 pi) turned to the given hand (1 left, -1 right) from one heading to another."""
    angle = (hand * (end - start)) % TAU
    return 0.0 if angle > TAU - SNAP else angle


@compiled
def advanced(x, y, heading, length, curvature, gear):  # type: ignore[no-untyped-def]
    """Pose after a segment."""
    run = gear * length
    half = 0.5 * curvature * run
    chord = run * (math.sin(half) / half if half != 0.0 else 1.0)
    angle = heading + half
    return x + chord * math.cos(angle), y + chord * math.sin(angle), remainder(heading + 2.0 * half)


@compiled
def _put(out, count, p0, k0, g0, p1, k1, g1, p2, k2, g2) -> None:  # type: ignore[no-untyped-def]
    out[count] = 0.0
    out[count, 0, 0], out[count, 0, 1], out[count, 0, 2] = p0, k0, g0
    out[count, 1, 0], out[count, 1, 1], out[count, 1, 2] = p1, k1, g1
    out[count, 2, 0], out[count, 2, 1], out[count, 2, 2] = p2, k2, g2
    out[count, 3, 2] = out[count, 4, 2] = 1.0


@compiled
def _arc_straight_arc(ax, ay, ah, bx, by, bh, radius, one, two, gear, out, count, kinds):  # type: ignore[no-untyped-def]
    """Put the word with the hands `one`, `two` and the straight in the given gear; the number of words then."""
    cx, cy = ax - one * radius * math.sin(ah), ay + one * radius * math.cos(ah)
    dx = gear * (bx - two * radius * math.sin(bh) - cx)
    dy = gear * (by + two * radius * math.cos(bh) - cy)
    run = math.hypot(dx, dy)
    heading = math.atan2(dy, dx) if run > SNAP else ah
    if one != two:
        square = run * run - 4.0 * radius * radius
        if square < -SNAP * radius * radius:
            return count
        run = math.sqrt(max(square, 0.0))
        heading += math.atan2(2.0 * gear * one * radius, run)
    first, second = turned(one, ah, heading), turned(two, heading, bh)
    if gear < 0.0 and first + second > FULL_TURN:
        return count
    _put(out, count, first * radius, one / radius, 1.0, run, 0.0, gear, second * radius, two / radius, 1.0)
    change = abs(remainder(bh - ah))
    if gear < 0.0:
        kinds[count] = SWITCH_BACK
    elif first + second - change > 0.5 * math.pi + 1e-9:
        kinds[count] = OMEGA
    else:
        kinds[count] = U if change >= 0.5 * math.pi - 1e-9 else ROUTE
    return count + 1


@compiled
def _three_arcs(ax, ay, ah, bx, by, bh, radius, hand, gear, out, count, kinds):  # type: ignore[no-untyped-def]
    """Put both words arc, arc the other way in the given gear, arc; the number of words then."""
    cx, cy = ax - hand * radius * math.sin(ah), ay + hand * radius * math.cos(ah)
    ex, ey = bx - hand * radius * math.sin(bh), by + hand * radius * math.cos(bh)
    dx, dy = ex - cx, ey - cy
    apart = math.hypot(dx, dy)
    square = 4.0 * radius * radius - 0.25 * apart * apart
    if square < -SNAP * radius * radius:
        return count
    rise = math.sqrt(max(square, 0.0))
    ux, uy = (dx / apart, dy / apart) if apart > SNAP else (math.cos(ah), math.sin(ah))
    for side in (hand, -hand):
        mx, my = 0.5 * (cx + ex) - side * rise * uy, 0.5 * (cy + ey) + side * rise * ux
        near = math.atan2(-hand * (cx - mx), hand * (cy - my))
        far = math.atan2(-hand * (ex - mx), hand * (ey - my))
        one, two, three = turned(hand, ah, near), turned(-hand, near, far), turned(hand, far, bh)
        if gear < 0.0:
            # Driven in reverse, the middle arc bends the same way while the heading turns on.
            two = turned(hand, near, far)
            if one + two + three > FULL_TURN:
                continue
        _put(
            out, count, one * radius, hand / radius, 1.0, two * radius, -hand / radius, gear, three * radius,
            hand / radius, 1.0,
        )  # fmt: skip
        kinds[count] = OMEGA if gear > 0.0 else SWITCH_BACK
        count += 1
    return count


@compiled
def _length(word) -> float:  # type: ignore[no-untyped-def]
    total = 0.0
    for piece in range(len(word)):
        total += word[piece, 0]
    return total


@compiled
def _sorted_family(out, kinds, begin, end) -> None:  # type: ignore[no-untyped-def]
    """Order words begin..end - 1 by length, equal ones as they were (insertion sort of a few)."""
    for i in range(begin + 1, end):
        word, kind, length = out[i].copy(), kinds[i], _length(out[i])
        j = i
        while j > begin and _length(out[j - 1]) > length + SAME_LENGTH:
            out[j], kinds[j] = out[j - 1], kinds[j - 1]
            j -= 1
        out[j], kinds[j] = word, kind


@compiled
def forward_words(a, b, radius, out, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """Put Dubins' words from pose a to pose b behind the first `count`, the shortest first; how many there are then."""
    begin = count
    for one, two in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        count = _arc_straight_arc(a[0], a[1], a[2], b[0], b[1], b[2], radius, one, two, 1.0, out, count, kinds)
    for hand in (1.0, -1.0):
        count = _three_arcs(a[0], a[1], a[2], b[0], b[1], b[2], radius, hand, 1.0, out, count, kinds)
    _sorted_family(out, kinds, begin, count)
    return count  # type: ignore[no-any-return]


@compiled
def cusped_words(a, b, radius, out, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """As `forward_words`: three arcs, the middle one in reverse."""
    begin = count
    for hand in (1.0, -1.0):
        count = _three_arcs(a[0], a[1], a[2], b[0], b[1], b[2], radius, hand, -1.0, out, count, kinds)
    _sorted_family(out, kinds, begin, count)
    return count  # type: ignore[no-any-return]


@compiled
def backing_words(a, b, radius, out, kinds, count) -> int:  # type: ignore[no-untyped-def]
    """As `forward_words`: two arcs and between them a straight in reverse."""
    begin = count
    for one, two in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        count = _arc_straight_arc(a[0], a[1], a[2], b[0], b[1], b[2], radius, one, two, -1.0, out, count, kinds)
    _sorted_family(out, kinds, begin, count)
    return count  # type: ignore[no-any-return]


@compiled
def driven_s(word, speeds) -> float:  # type: ignore[no-untyped-def]
    """Seconds to drive a word (n, 3), or a whole way of any number of segments; a direction change at its ends counts.

    `speeds` (4,): forward and reverse (m/s; a way with any reversing is driven at the latter all along), seconds per
    direction change, and seconds per 1/m of curvature by which the wheels must be turned over meanwhile.
    """
    length, reverse = 0.0, False
    gear, curvature, lost = 1.0, 0.0, 0.0
    for piece in range(len(word)):
        if word[piece, 0] <= SNAP:
            continue
        length += word[piece, 0]
        reverse = reverse or word[piece, 2] < 0.0
        if word[piece, 2] != gear:
            lost += speeds[2] + speeds[3] * abs(word[piece, 1] - curvature)
        gear, curvature = word[piece, 2], word[piece, 1]
    if gear < 0.0:
        lost += speeds[2] + speeds[3] * abs(curvature)
    return length / (speeds[1] if reverse else speeds[0]) + lost  # type: ignore[no-any-return]


@compiled
def awkward_s(word, radius, full_arc, short_s, curved_s) -> float:  # type: ignore[no-untyped-def]
    """Charge for reversing on an arc, and for arcs beside a direction change too short to come round on."""
    reverse = curved = False
    first = last = -1.0
    for piece in range(len(word)):
        if word[piece, 0] <= SNAP:
            continue
        reverse = reverse or word[piece, 2] < 0.0
        if word[piece, 1] != 0.0:
            if first < 0.0:
                first = word[piece, 0]
            last = word[piece, 0]
            curved = curved or word[piece, 2] < 0.0
    if not reverse:
        return 0.0
    short = first >= 0.0 and min(first, last) < full_arc * radius
    return short_s * short + curved_s * curved  # type: ignore[no-any-return]


@compiled
def _straight_meets(x, y, u, v, edges) -> int:  # type: ignore[no-untyped-def]
    """An edge that the straight from (x, y) to (u, v) meets, -1 for none; `edges` (n, 4) are x, y of both ends."""
    west, east, south, north = min(x, u), max(x, u), min(y, v), max(y, v)
    for k in range(len(edges)):
        p, q, r, s = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if max(p, r) < west or min(p, r) > east or max(q, s) < south or min(q, s) > north:
            continue
        one = (u - x) * (q - y) - (v - y) * (p - x)
        two = (u - x) * (s - y) - (v - y) * (r - x)
        three = (r - p) * (y - q) - (s - q) * (x - p)
        four = (r - p) * (v - q) - (s - q) * (u - p)
        if one * two <= 0.0 and three * four <= 0.0:
            return k
    return -1


@compiled
def _angle_to(p, q, r, s, radius, begin, way) -> float:  # type: ignore[no-untyped-def]
    """Angle (rad) through which a point goes round a centre before it meets an edge; infinite for never.

    The edge leads from (p, q) to (r, s), counted from the centre. The point starts at the angle `begin` and goes round
    in the sense `way`, 1 anticlockwise. Edges clear of the circle's box are left out by the caller, which costs less.
    """
    dx, dy = r - p, s - q
    a = dx * dx + dy * dy
    b = p * dx + q * dy
    root = b * b - a * (p * p + q * q - radius * radius)
    if a == 0.0 or root < 0.0:
        return np.inf
    root, least = math.sqrt(root), np.inf
    for t in ((-b - root) / a, (-b + root) / a):
        if 0.0 <= t <= 1.0:
            angle = way * (math.atan2(q + t * dy, p + t * dx) - begin) % TAU
            least = min(least, 0.0 if angle >= TAU - 1e-12 else angle)
    return least


@compiled
def _circle(x, y, heading, curvature, gear):  # type: ignore[no-untyped-def]
    """What `_angle_to` is told of an arc: centre, radius, the angle it begins at and the sense it goes round in."""
    radius, hand = abs(1.0 / curvature), (1.0 if curvature > 0.0 else -1.0)
    cx, cy = x - hand * radius * math.sin(heading), y + hand * radius * math.cos(heading)
    return cx, cy, radius, math.atan2(y - cy, x - cx), hand * gear


@compiled
def _arc_meets(x, y, heading, length, curvature, gear, edges) -> int:  # type: ignore[no-untyped-def]
    """An edge that an arc meets, -1 for none."""
    cx, cy, radius, begin, way = _circle(x, y, heading, curvature, gear)
    for k in range(len(edges)):
        p, q, r, s = edges[k, 0] - cx, edges[k, 1] - cy, edges[k, 2] - cx, edges[k, 3] - cy
        if min(p, r) > radius or max(p, r) < -radius or min(q, s) > radius or max(q, s) < -radius:
            continue
        if _angle_to(p, q, r, s, radius, begin, way) <= length / radius:
            return k
    return -1


@compiled
def arc_room_m(x, y, heading, curvature, gear, edges) -> float:  # type: ignore[no-untyped-def]
    """How far an arc leads before it meets an edge (m); infinite where a full circle meets none."""
    cx, cy, radius, begin, way = _circle(x, y, heading, curvature, gear)
    least = np.inf
    for k in range(len(edges)):
        p, q, r, s = edges[k, 0] - cx, edges[k, 1] - cy, edges[k, 2] - cx, edges[k, 3] - cy
        if min(p, r) > radius or max(p, r) < -radius or min(q, s) > radius or max(q, s) < -radius:
            continue
        least = min(least, _angle_to(p, q, r, s, radius, begin, way))
    return least * radius  # type: ignore[no-any-return]


@compiled
def inside(x, y, edges) -> bool:  # type: ignore[no-untyped-def]
    """Whether a point lies in the region whose boundary the edges are (even and odd crossings)."""
    odd = False
    for k in range(len(edges)):
        p, q, r, s = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if (q > y) != (s > y) and x < p + (y - q) / (s - q) * (r - p):
            odd = not odd
    return odd


@compiled
def edge_met(a, word, edges) -> int:  # type: ignore[no-untyped-def]
    """An edge that a word driven from pose a meets, -1 for none."""
    x, y, heading = a[0], a[1], a[2]
    for piece in range(len(word)):
        length, curvature, gear = word[piece, 0], word[piece, 1], word[piece, 2]
        if length <= SNAP:
            continue
        u, v, after = advanced(x, y, heading, length, curvature, gear)
        if curvature == 0.0:
            met = _straight_meets(x, y, u, v, edges)
        else:
            met = _arc_meets(x, y, heading, length, curvature, gear, edges)
        if met >= 0:
            return met
        x, y, heading = u, v, after
    return -1


@compiled
def word_fits(a, word, edges) -> bool:  # type: ignore[no-untyped-def]
    """Whether a word driven from pose a, which lies in the region, never meets its boundary."""
    return edge_met(a, word, edges) < 0


@compiled
def stays_inside(a, word, edges) -> bool:  # type: ignore[no-untyped-def]
    """Whether a way of any number of segments from pose a stays in the region whose boundary the edges are."""
    return inside(a[0], a[1], edges) and word_fits(a, word, edges)
