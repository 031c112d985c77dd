"""The quickest chain of poses joined by forward words, compiled: A* over the poses of a route.

A graph says which poses may follow which: `indptr` (n + 1,) and `after` (k,) as in a sparse matrix, with `links` (k,)
the seconds of each link, UNKNOWN where it is not worked out yet and infinite where no word fits. A link is worked out
only when its straight-line bound comes up first. Poses between starts and goals may have a graph of their own beside
that of the search, whose links serve the next search as well.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
import numpy.typing as npt

from strategies.ways.search import fitting_in_room, room_m
from strategies.ways.words import MOST_PIECES, TAU, driven_s
from vehicle.jit import compiled

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MOST_LINKS = 2500
UNKNOWN, NOWHERE = -1.0, -2
FAR = 6.0  # radii; three arcs lead no farther
ROUNDING = 1e-5  # radians
SPARE_M = 1e-6


@compiled
def link_s(poses, p, q, rooms, barrier, radius, speeds, edges, row) -> float:  # type: ignore[no-untyped-def]
    """Seconds of the shortest fitting of the three shortest forward words from pose p, inside, to pose q.

    Infinite for none. Most words fail in one of their arcs at the ends, which is told from `rooms` (n, 4): how far arcs
    lead from every pose, to the left and to the right, ahead and back; UNKNOWN until it is asked for. `barrier` is as
    of search.fitting_in_room.
    """
    if rooms[p, 0] == UNKNOWN:
        room_m(poses[p], 1.0, radius, edges, rooms[p, :2])
    if rooms[q, 2] == UNKNOWN:
        room_m(poses[q], -1.0, radius, edges, rooms[q, 2:])
    if _points_away(poses[p], poses[q], rooms[p, :2], rooms[q, 2:], radius):
        return np.inf
    if fitting_in_room(poses[p], poses[q], rooms[p, :2], rooms[q, 2:], barrier, radius, edges, 3, row) < 0:
        return np.inf
    return driven_s(row, speeds)


@compiled
def _points_away(a, b, ahead, behind, radius) -> bool:  # type: ignore[no-untyped-def]
    """Whether no word can lead from a to b, as their arcs would have to turn farther than they have room.

    Poses as far apart as this are joined by arc, straight, arc, whose straight points at b as seen from a, but for what
    the arcs lead aside.
    """
    x, y = b[0] - a[0], b[1] - a[1]
    apart = math.hypot(x, y)
    if apart <= FAR * radius:
        return False
    aside = min(2.0 * radius, max(ahead[0], ahead[1])) + min(2.0 * radius, max(behind[0], behind[1]))
    way, most = math.atan2(y, x), math.asin(min(1.0, aside / apart)) + ROUNDING
    left, right = (way - a[2]) % TAU, (a[2] - way) % TAU
    if left > ahead[0] / radius + most and right > ahead[1] / radius + most:
        return True
    left, right = (b[2] - way) % TAU, (way - b[2]) % TAU
    return left > behind[0] / radius + most and right > behind[1] / radius + most  # type: ignore[no-any-return]


@compiled
def _left(poses, first_goal, after_s, speed):  # type: ignore[no-untyped-def]
    """Seconds that are left from every pose at the least."""
    left = np.empty(len(poses))
    for i in range(len(poses)):
        best = np.inf
        for goal in range(len(after_s)):
            x, y = poses[first_goal + goal, 0] - poses[i, 0], poses[first_goal + goal, 1] - poses[i, 1]
            best = min(best, math.hypot(x, y) / speed + after_s[goal])
        left[i] = best
    return left


@compiled
def quickest_chain(  # type: ignore[no-untyped-def]
    poses, rooms, before_s, after_s, graph, kept, radius, speeds, edges, limit_s
):  # fmt: skip
    """Numbers of the poses of the quickest chain from a start to a goal; empty where there is none within `limit_s`.

    `poses` (n, 3) begin with the starts and end with the goals, with `before_s` and `after_s` seconds spent before and
    after them. `graph` is (indptr, after, links) of all poses, `kept` that of those between starts and goals, counted
    from the first of these; `rooms` is as of `link_s`. It gives up after MOST_LINKS links.
    """
    count, speed, row = len(poses), speeds[0], np.zeros((MOST_PIECES, 3))
    barrier = np.full((1, 4), np.inf)
    starts, first_goal = len(before_s), count - len(after_s)
    left = _left(poses, first_goal, after_s, speed)
    came = np.full(count + 1, NOWHERE)
    heap = [(before_s[i] + left[i], i, -1, before_s[i], True, 0) for i in range(starts)]
    heapq.heapify(heap)
    tried = 0
    while len(heap) > 0 and tried < MOST_LINKS:
        bound, node, parent, cost, known, place = heapq.heappop(heap)
        if bound >= limit_s:
            break
        if came[node] != NOWHERE:
            continue
        if not known:
            tried += 1
            links, at = (graph[2], place) if place >= 0 else (kept[2], -1 - place)
            if links[at] == UNKNOWN:
                links[at] = link_s(poses, parent, node, rooms, barrier, radius, speeds, edges, row)
            if links[at] < np.inf:
                cost += links[at]
                heapq.heappush(heap, (cost + left[node], node, parent, cost, True, place))
            continue
        came[node] = parent
        if node == count:
            return _chain_to(came, parent)
        if node >= first_goal:
            whole = cost + after_s[node - first_goal]
            heapq.heappush(heap, (whole, count, node, whole, True, 0))
        for k in range(graph[0][node], graph[0][node + 1]):
            _offer(heap, poses, came, left, node, graph[1][k], cost, speed, k)
        if starts <= node < first_goal:
            for k in range(kept[0][node - starts], kept[0][node - starts + 1]):
                _offer(heap, poses, came, left, node, kept[1][k] + starts, cost, speed, -1 - k)
    return np.empty(0, np.int64)


@compiled
def _offer(heap, poses, came, left, node, to, cost, speed, place) -> None:  # type: ignore[no-untyped-def]
    """Put a link that is not worked out on the heap, with the least it can take."""
    if came[to] == NOWHERE:
        x, y = poses[to, 0] - poses[node, 0], poses[to, 1] - poses[node, 1]
        least = math.hypot(x, y) / speed
        heapq.heappush(heap, (cost + least + left[to], to, node, cost, False, place))


@compiled
def _chain_to(came, node):  # type: ignore[no-untyped-def]
    """The poses from a start to this one."""
    count, at = 0, node
    while at >= 0:
        count += 1
        at = came[at]
    chain = np.empty(count, np.int64)
    at = node
    for k in range(count - 1, -1, -1):
        chain[k] = at
        at = came[at]
    return chain


@compiled
def in_reach(x, y, near) -> bool:  # type: ignore[no-untyped-def]
    """Whether something `x` and `y` away is within `near` metres."""
    return max(abs(x), abs(y)) <= near + SPARE_M and math.hypot(x, y) <= near  # type: ignore[no-any-return]


@compiled
def close_by(pose, spots, near, behind, out) -> int:  # type: ignore[no-untyped-def]
    """Put the numbers of the spots (n, 2+) within `near` metres, not farther back than `behind`, into `out`."""
    count = 0
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(spots)):
        x, y = spots[k, 0] - pose[0], spots[k, 1] - pose[1]
        if in_reach(x, y, near) and x * cosine + y * sine > -behind:
            out[count] = k
            count += 1
    return count


@compiled
def all_close_by(poses, near, behind):  # type: ignore[no-untyped-def]
    """For every pose (n, 3) the others it may lead to, as `close_by` has it: indptr (n + 1,) and after (k,).

    Poses are held against those of a strip about them only.
    """
    count = len(poses)
    indptr = np.zeros(count + 1, np.int64)
    order = np.argsort(poses[:, 0])
    east = poses[order, 0]
    strips = np.empty((count, 2), np.int64)
    for k in range(count):
        strips[k, 0] = np.searchsorted(east, poses[k, 0] - near - SPARE_M)
        strips[k, 1] = np.searchsorted(east, poses[k, 0] + near + SPARE_M)
    _lead(poses, order, strips, near, behind, indptr[1:], np.empty(0, np.int64))
    indptr = np.cumsum(indptr)
    after = np.empty(indptr[-1], np.int64)
    _lead(poses, order, strips, near, behind, indptr[:-1].copy(), after)
    return indptr, after


@compiled
def _lead(poses, order, strips, near, behind, place, after) -> None:  # type: ignore[no-untyped-def]
    """Count in `place` (n,) on for each pose that it may lead to; these are put into `after` there, unless it is empty.

    `order` are the poses by their easting, and `strips` (n, 2) where in it those near enough to each begin and end.
    """
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    for k in range(len(poses)):
        for at in range(strips[k, 0], strips[k, 1]):
            i = order[at]
            x, y = poses[k, 0] - poses[i, 0], poses[k, 1] - poses[i, 1]
            if in_reach(x, y, near) and x * cosine[i] + y * sine[i] > -behind:
                if len(after):
                    after[place[i]] = k
                place[i] += 1


@compiled
def layered(sizes):  # type: ignore[no-untyped-def]
    """Every pose of a layer leads to every pose of the next, for layers of so many poses: indptr and after."""
    count, total = 0, 0
    for layer in range(len(sizes)):
        count += sizes[layer]
        total += sizes[layer] * sizes[layer + 1] if layer + 1 < len(sizes) else 0
    indptr, after = np.zeros(count + 1, np.int64), np.empty(total, np.int64)
    node, place, end = 0, 0, 0
    for layer in range(len(sizes)):
        end += sizes[layer]
        for _ in range(sizes[layer]):
            for k in range(sizes[layer + 1] if layer + 1 < len(sizes) else 0):
                after[place] = end + k
                place += 1
            node += 1
            indptr[node] = place
    return indptr, after


@compiled
def round_rings(poses, starts, first_goal, near, behind):  # type: ignore[no-untyped-def]
    """All poses lead to all goals, those outside the rings to the ring poses close by as well: indptr and after."""
    goals, rings = len(poses) - first_goal, first_goal - starts
    outside = len(poses) - rings
    indptr = np.zeros(len(poses) + 1, np.int64)
    after = np.empty(len(poses) * goals + outside * rings, np.int64)
    place = 0
    for node in range(len(poses)):
        for goal in range(first_goal, len(poses)):
            after[place] = goal
            place += 1
        if node < starts or node >= first_goal:
            found = close_by(poses[node], poses[starts:first_goal], near, behind, after[place:])
            after[place : place + found] += starts
            place += found
        indptr[node + 1] = place
    return indptr, after[:place]
