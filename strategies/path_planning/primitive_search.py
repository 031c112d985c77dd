"""The best primitive between two poses inside a region, compiled: the inner loop of every search for a path.

`rules` holds what a search needs besides the poses, a record of SEARCH_RULES made by Connector.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from strategies.path_planning.primitives import (
    COST_COUNT,
    MAX_PIECES,
    MAX_PRIMITIVES,
    SNAP,
    add_forward_primitives,
    add_reverse_arc_primitives,
    add_reverse_straight_primitives,
    compute_awkwardness_s,
    compute_drive_time_s,
    find_primitive_contact,
    is_point_inside,
    is_primitive_inside,
    measure_arc_room_m,
    wrap_angle,
)
from vehicle.copying import copy_row, copy_table
from vehicle.jit import compile_function

Floats = npt.NDArray[np.float64]

# Fields of the rules of a search.
SEARCH_RULES = np.dtype(
    [
        ("radius", "f8"),
        ("speeds", "f8", (COST_COUNT,)),  # see primitives.compute_drive_time_s
        ("kinds", "f8", (4,)),  # 1 where ROUTE, U, OMEGA, SWITCH_BACK are allowed
        ("full_arc", "f8"),  # radii
        ("short_s", "f8"),
        ("curved_s", "f8"),
        ("near", "f8"),  # radii within which straights at the ends are tried
        ("steps", "f8", (3,)),  # their lengths, m
        ("most_reverse", "f8"),  # m in one primitive
    ]
)
ARC_TOLERANCE_M = 1e-6  # above the rounding of an arc driven backwards
NO_END = np.full(2, np.inf)
REACH_RADII = 6.0  # radii: no primitive without end straights leads farther from the box of its ends


@compile_function
def compute_primitive_cost_s(primitive, rules) -> float:  # type: ignore[no-untyped-def]
    """Seconds to drive a primitive, plus the charge for being hard to follow."""
    return compute_drive_time_s(primitive, rules.speeds) + compute_awkwardness_s(
        primitive, rules.radius, rules.full_arc, rules.short_s, rules.curved_s
    )


@compile_function
def _find_cheapest_fitting(a, out, costs, count, edges) -> tuple[int, bool]:  # type: ignore[no-untyped-def]
    """Index of the cheapest primitive that fits, -1 for none, and whether it is the cheapest of all."""
    first = True
    while True:
        best = -1
        for k in range(count):
            if costs[k] < np.inf and (best < 0 or costs[k] < costs[best]):
                best = k
        if best < 0 or is_primitive_inside(a, out[best], edges):
            return best, first
        costs[best] = np.inf
        first = False


@compile_function
def _list_primitives(a, b, rules, limit_s, out, kinds, costs) -> int:  # type: ignore[no-untyped-def]
    """Number of primitives allowed from a to b, with rounded costs; those of `limit_s` or more may be missing."""
    count = add_forward_primitives(a, b, rules.radius, out, kinds, 0)
    for k in range(count):
        length = 0.0
        for piece in range(MAX_PIECES):
            length += out[k, piece, 0]
        costs[k] = 0.0 if length < limit_s * rules.speeds[0] else np.inf
    forward = count
    if rules.kinds[3] > 0.0:
        turning = abs(wrap_angle(b[2] - a[2])) * rules.radius
        if turning / max(rules.speeds[0], rules.speeds[1]) + 2.0 * rules.speeds[2] < limit_s:
            count = add_reverse_arc_primitives(a, b, rules.radius, out, kinds, count)
            count = add_reverse_straight_primitives(a, b, rules.radius, out, kinds, count)
    for k in range(count):
        is_too_long = costs[k] == np.inf if k < forward else out[k, 1, 0] > rules.most_reverse
        if is_too_long or rules.kinds[kinds[k]] == 0.0:
            costs[k] = np.inf
        else:
            costs[k] = round(compute_primitive_cost_s(out[k], rules), 6)
    return count


@compile_function
def _get_straights_m(a, b, rules, number) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """The straights (m) before and after a primitive in attempt `number`; (-1, -1) when there are no more."""
    if number < 8:
        pair = number + 1  # (0, 0) is the plain primitive
        return rules.steps[pair // 3], rules.steps[pair % 3]
    on = (b[0] - a[0]) * math.cos(a[2]) + (b[1] - a[1]) * math.sin(a[2])
    if number < 11 and abs(on) > 1e-6 and math.cos(b[2] - a[2]) < -0.9:
        step = rules.steps[number - 8]
        return step + max(0.0, on), step + max(0.0, -on)
    return -1.0, -1.0


@compile_function
def _add_straights(primitive, before, after, out) -> None:  # type: ignore[no-untyped-def]
    """Add a straight before and one after the three pieces of a primitive."""
    for piece in range(3):
        out[piece + 1, 0], out[piece + 1, 1], out[piece + 1, 2] = (
            primitive[piece, 0],
            primitive[piece, 1],
            primitive[piece, 2],
        )
    out[0, 0], out[0, 1], out[0, 2] = before, 0.0, 1.0
    out[4, 0], out[4, 1], out[4, 2] = after, 0.0, 1.0


@compile_function
def _find_with_straights(a, b, rules, edges, max_cost_s, best) -> int:  # type: ignore[no-untyped-def]
    """The cheapest fitting primitive with straights at its ends, if cheaper than `max_cost_s`, into `best` (5, 3).

    Returns its kind, -1 if there is none.
    """
    most = 11 * MAX_PRIMITIVES
    longer, kind_of, cost_of = np.empty((most, MAX_PIECES, 3)), np.empty(most, np.int64), np.empty(most)
    out, kinds, costs = (
        np.empty((MAX_PRIMITIVES, MAX_PIECES, 3)),
        np.empty(MAX_PRIMITIVES, np.int64),
        np.empty(MAX_PRIMITIVES),
    )
    p, q = np.empty(3), np.empty(3)
    total = 0
    for number in range(11):
        before, after = _get_straights_m(a, b, rules, number)
        if before < 0.0:
            break
        p[0], p[1], p[2] = a[0] + before * math.cos(a[2]), a[1] + before * math.sin(a[2]), wrap_angle(a[2])
        q[0], q[1], q[2] = b[0] - after * math.cos(b[2]), b[1] - after * math.sin(b[2]), b[2]
        count = _list_primitives(p, q, rules, max_cost_s - (before + after) / rules.speeds[0], out, kinds, costs)
        for k in range(count):
            if costs[k] == np.inf:
                continue
            _add_straights(out[k], before, after, longer[total])
            cost = round(compute_primitive_cost_s(longer[total], rules), 6)
            if cost < max_cost_s:
                kind_of[total], cost_of[total] = kinds[k], cost
                total += 1
    place, _ = _find_cheapest_fitting(a, longer, cost_of, total, edges)
    if place < 0:
        return -1
    copy_table(longer[place], best)
    return kind_of[place]  # type: ignore[no-any-return]


@compile_function
def find_near_edges(a, b, reach_m, edges):  # type: ignore[no-untyped-def]
    """The edges that come within `reach_m` of the box of two poses."""
    west, east = min(a[0], b[0]) - reach_m, max(a[0], b[0]) + reach_m
    south, north = min(a[1], b[1]) - reach_m, max(a[1], b[1]) + reach_m
    near_edges = np.empty_like(edges)
    count = 0
    for k in range(len(edges)):
        p, q, r, s = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if max(p, r) >= west and min(p, r) <= east and max(q, s) >= south and min(q, s) <= north:
            near_edges[count, 0], near_edges[count, 1], near_edges[count, 2], near_edges[count, 3] = p, q, r, s
            count += 1
    return near_edges[:count]


@compile_function
def find_best_primitive(a, b, rules, edges, best) -> int:  # type: ignore[no-untyped-def]
    """The cheapest primitive from a to b inside the region, into `best` (5, 3); returns its kind, -1 if there is none.

    If the poses are near each other and the cheapest primitive does not fit, straights at its ends are tried.
    """
    if not is_point_inside(a[0], a[1], edges) or not is_point_inside(b[0], b[1], edges):
        return -1
    return find_best_inside(a, b, rules, edges, best)


@compile_function
def find_best_inside(a, b, rules, edges, best) -> int:  # type: ignore[no-untyped-def]
    """As `find_best_primitive` between poses known to lie inside; `edges` are all within reach of them."""
    apart_m = math.hypot(b[0] - a[0], b[1] - a[1])
    edges = find_near_edges(a, b, apart_m + REACH_RADII * rules.radius + 2.0 * rules.steps[2], edges)
    out, kinds, costs = (
        np.empty((MAX_PRIMITIVES, MAX_PIECES, 3)),
        np.empty(MAX_PRIMITIVES, np.int64),
        np.empty(MAX_PRIMITIVES),
    )
    count = _list_primitives(a, b, rules, np.inf, out, kinds, costs)
    place, is_cheapest = _find_cheapest_fitting(a, out, costs, count, edges)
    kind, max_cost_s = -1, np.inf
    if place >= 0:
        copy_table(out[place], best)
        kind, max_cost_s = kinds[place], costs[place]
    is_near = apart_m <= rules.near * rules.radius
    if is_near and (place < 0 or not is_cheapest):
        lengthened_kind = _find_with_straights(a, b, rules, edges, max_cost_s, best)
        kind = lengthened_kind if lengthened_kind >= 0 else kind
    return kind


@compile_function
def compute_shortest_m(a, b, radius) -> float:  # type: ignore[no-untyped-def]
    """Length of the shortest forward primitive, whether it fits or not (m)."""
    out, kinds = np.empty((MAX_PRIMITIVES, MAX_PIECES, 3)), np.empty(MAX_PRIMITIVES, np.int64)
    add_forward_primitives(a, b, radius, out, kinds, 0)
    total = 0.0
    for piece in range(MAX_PIECES):
        total += out[0, piece, 0]
    return total


@compile_function
def find_shortest_forward(a, b, radius, edges, most, best) -> int:  # type: ignore[no-untyped-def]
    """The shortest fitting of the `most` shortest forward primitives into `best`; returns its kind, -1 for none."""
    if not is_point_inside(a[0], a[1], edges):
        return -1
    return find_fitting_forward(a, b, radius, edges, most, best)


@compile_function
def find_fitting_forward(a, b, radius, edges, most, best) -> int:  # type: ignore[no-untyped-def]
    """As `find_shortest_forward` from a pose known to lie inside."""
    return find_fitting_in_room(a, b, NO_END, NO_END, np.full((1, 4), np.inf), radius, edges, most, best)


@compile_function
def find_fitting_in_room(a, b, ahead, behind, barrier, radius, edges, most, best) -> int:  # type: ignore[no-untyped-def]
    """As `find_fitting_forward` with known lengths that arcs to the left and right have before they meet an edge.

    `ahead` (2,) are those lengths from a, `behind` (2,) those driven back from b (m). `barrier` (1, 4) is the edge met
    last: it blocks most primitives between poses near the last ones too, and is tried first; infinite at the beginning.
    """
    out, kinds = np.empty((MAX_PRIMITIVES, MAX_PIECES, 3)), np.empty(MAX_PRIMITIVES, np.int64)
    count = min(add_forward_primitives(a, b, radius, out, kinds, 0), most)
    edges_in_reach = edges[:0]
    for k in range(count):
        if _exceeds_room(out[k, 0], ahead) or _exceeds_room(out[k, 2], behind):
            continue
        if not is_primitive_inside(a, out[k], barrier):
            continue
        if not len(edges_in_reach):
            edges_in_reach = find_near_edges(a, b, math.hypot(b[0] - a[0], b[1] - a[1]) + REACH_RADII * radius, edges)
        met_edge = find_primitive_contact(a, out[k], edges_in_reach)
        if met_edge < 0:
            copy_table(out[k], best)
            return kinds[k]  # type: ignore[no-any-return]
        copy_row(edges_in_reach[met_edge], barrier[0])
    return -1


@compile_function
def _exceeds_room(arc, room) -> bool:  # type: ignore[no-untyped-def]
    """Whether an arc at one end of a primitive is clearly longer than its room."""
    return arc[0] > SNAP and arc[0] > room[0 if arc[1] > 0.0 else 1] + ARC_TOLERANCE_M  # type: ignore[no-any-return]


@compile_function
def measure_room_m(pose, gear, radius, edges, out) -> None:  # type: ignore[no-untyped-def]
    """Put into `out` (2,) how far arcs to the left and right lead from a pose before they meet an edge (m)."""
    edges_in_reach = find_near_edges(pose, pose, 2.0 * radius, edges)
    for side in range(2):
        out[side] = measure_arc_room_m(pose[0], pose[1], pose[2], (1.0 - 2.0 * side) / radius, gear, edges_in_reach)
