"""How close two tractors come: distance between their outlines, tractor box and implement box each, and who is near."""

from __future__ import annotations

import math

from vehicle.jit import compiled

# Nobody gains more speed between two looks than this makes up for, and none comes and goes at every look.
NEAR_M, APART_M = 0.5, 0.5
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
def outline_distance(a, am, b, bm) -> float:  # type: ignore[no-untyped-def]
    """Distance (m) between the outlines of two tractors, states `a` and `b` with models `am` and `bm`.

    Exact for boxes that do not cross: the smallest distance of two convex outlines is attained at a corner.
    """
    acos, asin, bcos, bsin = math.cos(a.angle), math.sin(a.angle), math.cos(b.angle), math.sin(b.angle)
    best = 1e9
    for i in range(2):
        af, ar, ah = (am.nose, am.tail, am.half_width) if i == 0 else (am.tool_front, am.tool_tail, am.tool_half_width)
        for j in range(2):
            bf, br, bh = (
                (bm.nose, bm.tail, bm.half_width) if j == 0 else (bm.tool_front, bm.tool_tail, bm.tool_half_width)
            )
            best = min(
                best,
                corners_to_box(a.x, a.y, acos, asin, ar, af, ah, b.x, b.y, bcos, bsin, br, bf, bh),
                corners_to_box(b.x, b.y, bcos, bsin, br, bf, bh, a.x, a.y, acos, asin, ar, af, ah),
            )
    return best


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
            limit = max(clearances[i], clearances[j], clearance) + models[a.model].reach + models[b.model].reach
            dx, dy = a.x - b.x, a.y - b.y
            if dx * dx + dy * dy >= limit * limit:
                continue
            distance = outline_distance(a, models[a.model], b, models[b.model])
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
