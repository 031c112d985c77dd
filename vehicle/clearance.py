"""How close two tractors come: distance between their outlines, tractor box and implement box each, and who is near."""

from __future__ import annotations

import math

from vehicle.jit import compiled

# Nobody gains more speed between two looks than this makes up for, and none comes and goes at every look.
NEAR_M, APART_M = 0.5, 0.5
ROUNDING_M = 1e-9  # what stands clear by less is looked at more closely
PARALLEL = math.sin(math.radians(10.0))


@compiled
def point_box(px: float, py: float, rear: float, front: float, half: float) -> float:
    """Distance from a point to the box [rear, front] x [-half, half]; 0 inside."""
    dx = max(rear - px, px - front, 0.0)
    dy = max(abs(py) - half, 0.0)
    return math.sqrt(dx * dx + dy * dy)


@compiled
def corners_to_box(  # type: ignore[no-untyped-def]
    ax, ay, acos, asin, arear, afront, ahalf, bx, by, bcos, bsin, brear, bfront, bhalf
) -> float:
    """Smallest distance of the four corners of box a to box b."""
    best = 1e9
    for corner in range(4):
        forward = afront if corner < 2 else arear
        left = ahalf if corner % 2 == 0 else -ahalf
        x = ax + forward * acos - left * asin - bx
        y = ay + forward * asin + left * acos - by
        best = min(best, point_box(x * bcos + y * bsin, y * bcos - x * bsin, brear, bfront, bhalf))
    return best


@compiled
def gap_m(x, y, cos, sin, box, other):  # type: ignore[no-untyped-def]
    """The widest gap between two boxes along the first one's axes (m); negative where they overlap in both.

    Boxes are rear, front and half width. The second tractor is at (x, y) as the first one sees it, and turned by an
    angle of this cos and sin.
    """
    middle, length = 0.5 * (other[0] + other[1]), 0.5 * (other[1] - other[0])
    ahead, aside = x + middle * cos, abs(y + middle * sin)
    long = length * abs(cos) + other[2] * abs(sin)
    wide = length * abs(sin) + other[2] * abs(cos)
    return max(ahead - long - box[1], box[0] - ahead - long, aside - wide - box[2])


@compiled
def boxes_of(model):  # type: ignore[no-untyped-def]
    """Rear, front and half width of the box round a tractor with its implement, of the tractor, of the implement."""
    body = (model.tail, model.nose, model.half_width)
    tool = (model.tool_tail, model.tool_front, model.tool_half_width)
    whole = (min(body[0], tool[0]), max(body[1], tool[1]), max(body[2], tool[2]))
    return whole, body, tool


@compiled
def seen_from_both(a, b, acos, asin, bcos, bsin):  # type: ignore[no-untyped-def]
    """Two poses as each sees the other: (x, y) for the first and for the second, cos and sin of the angle between."""
    dx, dy = b.x - a.x, b.y - a.y
    return (
        dx * acos + dy * asin, dy * acos - dx * asin, -dx * bcos - dy * bsin, dx * bsin - dy * bcos,
        acos * bcos + asin * bsin, acos * bsin - asin * bcos,
    )  # fmt: skip


@compiled
def gap_either_way_m(seen, box, other):  # type: ignore[no-untyped-def]
    """The widest gap between two boxes along the axes of either (m); negative exactly where they overlap."""
    x, y, back_x, back_y, cos, sin = seen
    return max(gap_m(x, y, cos, sin, box, other), gap_m(back_x, back_y, cos, -sin, other, box))


@compiled
def distance_below(a, am, b, bm, limit) -> float:  # type: ignore[no-untyped-def]
    """Distance (m) between the outlines of two tractors where it is less than `limit`; else 1e9, or the distance.

    Boxes that have no gap along any axis of theirs overlap, though no corner of one be inside the other. The distance
    of others is that of a corner. What a gap shows to be far is not worked out.
    """
    acos, asin, bcos, bsin = math.cos(a.angle), math.sin(a.angle), math.cos(b.angle), math.sin(b.angle)
    seen = seen_from_both(a, b, acos, asin, bcos, bsin)
    whole, body, tool = boxes_of(am)
    other_whole, other_body, other_tool = boxes_of(bm)
    best = 1e9
    if gap_either_way_m(seen, whole, other_whole) >= limit + ROUNDING_M:
        return best
    for i in range(2):
        box = body if i == 0 else tool
        for j in range(2):
            other = other_body if j == 0 else other_tool
            gap = gap_either_way_m(seen, box, other)
            if gap < -ROUNDING_M:
                return 0.0
            if gap >= min(limit, best) + ROUNDING_M:
                continue
            ar, af, ah = box
            br, bf, bh = other
            best = min(
                best,
                corners_to_box(a.x, a.y, acos, asin, ar, af, ah, b.x, b.y, bcos, bsin, br, bf, bh),
                corners_to_box(b.x, b.y, bcos, bsin, br, bf, bh, a.x, a.y, acos, asin, ar, af, ah),
            )
    return best


@compiled
def outline_distance(a, am, b, bm) -> float:  # type: ignore[no-untyped-def]
    """Distance (m) between the outlines of tractors, states `a` and `b`, models `am` and `bm`; 0 where they cross."""
    return distance_below(a, am, b, bm, math.inf)


@compiled
def beside(a, am, b, bm) -> bool:  # type: ignore[no-untyped-def]
    """Whether two tractors are on nearly parallel lines, and neither's tractor is in line with anything of the other.

    That is how they work neighbouring tracks, queue and pass each other on them.
    """
    acos, asin, bcos, bsin = math.cos(a.angle), math.sin(a.angle), math.cos(b.angle), math.sin(b.angle)
    if abs(acos * bsin - asin * bcos) > PARALLEL:
        return False
    dx, dy = b.x - a.x, b.y - a.y
    aside = min(abs(acos * dy - asin * dx), abs(bcos * dy - bsin * dx))
    in_line = max(
        am.half_width + max(bm.half_width, bm.tool_half_width), bm.half_width + max(am.half_width, am.tool_half_width)
    )
    return aside > in_line  # type: ignore[no-any-return]


@compiled
def too_close(  # type: ignore[no-untyped-def]
    states, models, clearances, clearance, beside_clearance
) -> tuple[float, int, int]:
    """Update the smallest clearance so far per tractor; return the pair that is closest of those too close.

    Two are too close within `clearance`, or where they are `beside` each other within `beside_clearance`; where none
    are, the distance returned is 1e9. Pairs whose enclosing circles are farther apart than that and than what either
    has already come close to are skipped, and so are tractors off the field.
    """
    best, first, second = 1e9, -1, -1
    for i in range(len(states)):
        a = states[i]
        if a.away == 1:
            continue
        for j in range(i):
            b = states[j]
            if b.away == 1:
                continue
            counts = max(clearances[i], clearances[j], clearance)
            limit = counts + models[a.model].reach + models[b.model].reach
            dx, dy = a.x - b.x, a.y - b.y
            if dx * dx + dy * dy >= limit * limit:
                continue
            distance = distance_below(a, models[a.model], b, models[b.model], counts)
            clearances[i] = min(clearances[i], distance)
            clearances[j] = min(clearances[j], distance)
            if distance >= min(clearance, best):
                continue
            if distance >= beside_clearance and beside(a, models[a.model], b, models[b.model]):
                continue
            best, first, second = distance, j, i
    return best, first, second


@compiled
def look_around(states, models, interval, near, wanted) -> bool:  # type: ignore[no-untyped-def]
    """Mark in `wanted` (n,) every tractor that could touch another before the next look; whether it is not `near`.

    Two are near when their enclosing circles could meet at twice the way that both drive in the `interval` (s) between
    two looks; those that are `near` already must be a little farther apart to leave.
    """
    for i in range(len(states)):
        wanted[i] = False
    for i in range(len(states)):
        a = states[i]
        if a.away == 1:
            continue
        for j in range(i):
            if wanted[i] and wanted[j]:
                continue
            b = states[j]
            if b.away == 1:
                continue
            limit = models[a.model].reach + models[b.model].reach + NEAR_M
            limit += 2.0 * interval * (abs(a.forward) + abs(b.forward))
            if near[i] and near[j]:
                limit += APART_M
            dx, dy = a.x - b.x, a.y - b.y
            if dx * dx + dy * dy < limit * limit:
                wanted[i] = wanted[j] = True
    return (wanted != near).any()  # type: ignore[no-any-return]
