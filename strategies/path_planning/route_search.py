"""The quickest chain of poses joined by forward primitives, compiled: A* over the poses of a route.

A graph says which poses may follow which: `indptr` (n + 1,) and `after` (k,) as in a sparse matrix, with the seconds of
each link (k,), UNKNOWN until computed and infinite if no primitive fits. A link is computed only when its straight-line
bound comes up first. Ring poses have a graph of their own, whose links serve later searches too.

Most searches along rings fail, and a search for the quickest chain must try every pose before it knows. So whether any
chain exists is checked first, without regard to time; which ring poses are joined to an end is cached.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from strategies.path_planning.paths import DrivePath, Pose
from strategies.path_planning.primitive_search import find_fitting_in_room, measure_room_m
from strategies.path_planning.primitives import MAX_PIECES, TAU, compute_drive_time_s
from vehicle.jit import compile_function

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MAX_LINKS = 2500
UNKNOWN, NOWHERE = -1.0, -2
FAR_RADII = 6.0  # radii; three arcs lead no farther
ROUNDING_RAD = 1e-5  # radians
REACH_TOLERANCE_M = 1e-6


@compile_function
def compute_link_s(poses, p, q, rooms, barrier, radius, speeds, edges, row) -> float:  # type: ignore[no-untyped-def]
    """Seconds of the shortest fitting of the three shortest forward primitives from pose p, inside, to pose q.

    Infinite for none. Most primitives fail in one of their end arcs, which shows in `rooms` (n, 4): how far arcs lead
    from every pose, to the left and right, ahead and back; UNKNOWN until needed. `barrier` is as in
    primitive_search.find_fitting_in_room.
    """
    if rooms[p, 0] == UNKNOWN:
        measure_room_m(poses[p], 1.0, radius, edges, rooms[p, :2])
    if rooms[q, 2] == UNKNOWN:
        measure_room_m(poses[q], -1.0, radius, edges, rooms[q, 2:])
    if _is_pointing_away(poses[p], poses[q], rooms[p, :2], rooms[q, 2:], radius):
        return np.inf
    if find_fitting_in_room(poses[p], poses[q], rooms[p, :2], rooms[q, 2:], barrier, radius, edges, 3, row) < 0:
        return np.inf
    return compute_drive_time_s(row, speeds)


@compile_function
def _is_pointing_away(a, b, ahead, behind, radius) -> bool:  # type: ignore[no-untyped-def]
    """Whether no primitive can lead from a to b, because their arcs would have to turn farther than they have room.

    Poses this far apart are joined by arc, straight, arc, whose straight points at b as seen from a, except for the
    offset of the arcs.
    """
    x, y = b[0] - a[0], b[1] - a[1]
    apart = math.hypot(x, y)
    if apart <= FAR_RADII * radius:
        return False
    aside = min(2.0 * radius, max(ahead[0], ahead[1])) + min(2.0 * radius, max(behind[0], behind[1]))
    direction, max_aside_rad = math.atan2(y, x), math.asin(min(1.0, aside / apart)) + ROUNDING_RAD
    left_rad, right_rad = (direction - a[2]) % TAU, (a[2] - direction) % TAU
    if left_rad > ahead[0] / radius + max_aside_rad and right_rad > ahead[1] / radius + max_aside_rad:
        return True
    left_rad, right_rad = (b[2] - direction) % TAU, (direction - b[2]) % TAU
    return left_rad > behind[0] / radius + max_aside_rad and right_rad > behind[1] / radius + max_aside_rad  # type: ignore[no-any-return]


@compile_function
def _compute_remaining_s(poses, first_goal, after_s, speed):  # type: ignore[no-untyped-def]
    """Least remaining seconds from every pose."""
    remaining_s = np.empty(len(poses))
    for i in range(len(poses)):
        best = np.inf
        for goal in range(len(after_s)):
            x, y = poses[first_goal + goal, 0] - poses[i, 0], poses[first_goal + goal, 1] - poses[i, 1]
            best = min(best, math.hypot(x, y) / speed + after_s[goal])
        remaining_s[i] = best
    return remaining_s


@compile_function
def find_quickest_chain(  # type: ignore[no-untyped-def]
    poses, rooms, before_s, after_s, graph, ring_graph, radius, speeds, edges, limit_s
):
    """Numbers of the poses of the quickest chain from a start to a goal; empty if there is none within `limit_s`.

    `poses` (n, 3) begin with the starts and end with the goals, with `before_s` and `after_s` seconds spent before and
    after them. `graph` is (indptr, after, links) of all poses, `ring_graph` that of the poses between starts and goals,
    numbered from the first of these; `rooms` is as in `compute_link_s`. Stops after MAX_LINKS links.
    """
    count, speed, row = len(poses), speeds[0], np.zeros((MAX_PIECES, 3))
    barrier = np.full((1, 4), np.inf)
    starts, first_goal = len(before_s), count - len(after_s)
    remaining_s = _compute_remaining_s(poses, first_goal, after_s, speed)
    came_from = np.full(count + 1, NOWHERE)
    heap = [(before_s[i] + remaining_s[i], i, -1, before_s[i], True, 0) for i in range(starts)]
    heapq.heapify(heap)
    tried_links = 0
    while len(heap) > 0 and tried_links < MAX_LINKS:
        bound, node, parent, cost, is_exact, place = heapq.heappop(heap)
        if bound >= limit_s:
            break
        if came_from[node] != NOWHERE:
            continue
        if not is_exact:
            tried_links += 1
            links, at = (graph[2], place) if place >= 0 else (ring_graph[2], -1 - place)
            if links[at] == UNKNOWN:
                links[at] = compute_link_s(poses, parent, node, rooms, barrier, radius, speeds, edges, row)
            if links[at] < np.inf:
                cost += links[at]
                heapq.heappush(heap, (cost + remaining_s[node], node, parent, cost, True, place))
            continue
        came_from[node] = parent
        if node == count:
            return _trace_chain(came_from, parent)
        if node >= first_goal:
            whole = cost + after_s[node - first_goal]
            heapq.heappush(heap, (whole, count, node, whole, True, 0))
        for k in range(graph[0][node], graph[0][node + 1]):
            _push_link(heap, poses, came_from, remaining_s, node, graph[1][k], cost, speed, k)
        if starts <= node < first_goal:
            for k in range(ring_graph[0][node - starts], ring_graph[0][node - starts + 1]):
                _push_link(heap, poses, came_from, remaining_s, node, ring_graph[1][k] + starts, cost, speed, -1 - k)
    return np.empty(0, np.int64)


@compile_function
def _push_link(heap, poses, came_from, remaining_s, node, next_node, cost, speed, place) -> None:  # type: ignore[no-untyped-def]
    """Put a link that is not computed yet on the heap, with the least time it can take."""
    if came_from[next_node] == NOWHERE:
        x, y = poses[next_node, 0] - poses[node, 0], poses[next_node, 1] - poses[node, 1]
        least = math.hypot(x, y) / speed
        heapq.heappush(heap, (cost + least + remaining_s[next_node], next_node, node, cost, False, place))


@compile_function
def _trace_chain(came_from, node):  # type: ignore[no-untyped-def]
    """The poses from a start to this one."""
    count, current_node = 0, node
    while current_node >= 0:
        count += 1
        current_node = came_from[current_node]
    chain = np.empty(count, np.int64)
    current_node = node
    for k in range(count - 1, -1, -1):
        chain[k] = current_node
        current_node = came_from[current_node]
    return chain


@compile_function
def is_in_reach(x, y, reach_m) -> bool:  # type: ignore[no-untyped-def]
    """Whether something `x` and `y` away is within `reach_m` metres."""
    return max(abs(x), abs(y)) <= reach_m + REACH_TOLERANCE_M and math.hypot(x, y) <= reach_m  # type: ignore[no-any-return]


@compile_function
def find_close_spots(pose, spots, reach_m, behind_m, out) -> int:  # type: ignore[no-untyped-def]
    """Put the numbers of the spots (n, 2+) within `reach_m`, not farther back than `behind_m`, into `out`."""
    count = 0
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(spots)):
        x, y = spots[k, 0] - pose[0], spots[k, 1] - pose[1]
        if is_in_reach(x, y, reach_m) and x * cosine + y * sine > -behind_m:
            out[count] = k
            count += 1
    return count


@compile_function
def find_all_close_poses(poses, reach_m, behind_m):  # type: ignore[no-untyped-def]
    """For every pose (n, 3) the others it may lead to, as in `find_close_spots`: indptr (n + 1,) and after (k,).

    Poses are compared only with those of a strip round them.
    """
    count = len(poses)
    indptr = np.zeros(count + 1, np.int64)
    order = np.argsort(poses[:, 0])
    east = poses[order, 0]
    strips = np.empty((count, 2), np.int64)
    for k in range(count):
        strips[k, 0] = np.searchsorted(east, poses[k, 0] - reach_m - REACH_TOLERANCE_M)
        strips[k, 1] = np.searchsorted(east, poses[k, 0] + reach_m + REACH_TOLERANCE_M)
    _collect_close_poses(poses, order, strips, reach_m, behind_m, indptr[1:], np.empty(0, np.int64))
    indptr = np.cumsum(indptr)
    after = np.empty(indptr[-1], np.int64)
    _collect_close_poses(poses, order, strips, reach_m, behind_m, indptr[:-1].copy(), after)
    return indptr, after


@compile_function
def _collect_close_poses(poses, order, strips, reach_m, behind_m, place, after) -> None:  # type: ignore[no-untyped-def]
    """Add to `place` (n,) for each pose the number it may lead to, and write these to `after` unless it is empty.

    `order` are the poses by their easting, `strips` (n, 2) where in it those near enough to each begin and end.
    """
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    for k in range(len(poses)):
        for at in range(strips[k, 0], strips[k, 1]):
            i = order[at]
            x, y = poses[k, 0] - poses[i, 0], poses[k, 1] - poses[i, 1]
            if is_in_reach(x, y, reach_m) and x * cosine[i] + y * sine[i] > -behind_m:
                if len(after):
                    after[place[i]] = k
                place[i] += 1


@compile_function
def link_layers(sizes):  # type: ignore[no-untyped-def]
    """Links from every pose of a layer to every pose of the next, for layers of these sizes: indptr and after."""
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


@compile_function
def link_rings(poses, starts, first_goal, reach_m, behind_m):  # type: ignore[no-untyped-def]
    """Links from all poses to all goals, and from those outside the rings to close ring poses: indptr and after."""
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
            close_count = find_close_spots(poses[node], poses[starts:first_goal], reach_m, behind_m, after[place:])
            after[place : place + close_count] += starts
            place += close_count
        indptr[node + 1] = place
    return indptr, after[:place]


UNCHECKED, APART, JOINED = -1, 0, 1


@dataclass(eq=False)
class RoutePoses:
    """Poses (n, 3) that routes lead through, and their room (n, 4) as known so far (compute_link_s)."""

    poses: Floats
    rooms: Floats

    @classmethod
    def from_poses(cls, poses: Sequence[Pose]) -> RoutePoses:
        """Poses whose room is still unknown."""
        return cls(np.array(poses, dtype=np.float64).reshape(-1, 3), np.full((len(poses), 4), UNKNOWN))

    @classmethod
    def from_parts(cls, parts: Sequence[RoutePoses]) -> RoutePoses:
        """The poses of some parts, one after another."""
        return cls(np.concatenate([part.poses for part in parts]), np.concatenate([part.rooms for part in parts]))

    def update_parts(self, parts: Sequence[RoutePoses]) -> None:
        """Copy what is now known of the room back to the parts."""
        first = 0
        for part in parts:
            part.rooms[:] = self.rooms[first : first + len(part.rooms)]
            first += len(part.rooms)


@dataclass(eq=False)
class RouteLayers:
    """Layers of poses of which a route takes one each: the size of each layer, and all poses one after another."""

    sizes: list[int]
    spots: RoutePoses

    @classmethod
    def from_layers(cls, layers: Sequence[Sequence[Pose]]) -> RouteLayers:
        """From the poses of each layer."""
        return cls(
            [len(layer) for layer in layers], RoutePoses.from_poses([pose for layer in layers for pose in layer])
        )


@dataclass(eq=False)
class EndMoves:
    """What may be driven at one end of a route, and whether each ring pose is joined to any of it.

    `spots` is where the rest of the route joins each path, `seconds` (n,) how long they take. `ring_states` (poses,) is
    empty until rings are needed, and UNCHECKED where not checked yet.
    """

    paths: list[DrivePath]
    spots: RoutePoses
    seconds: Floats
    ring_states: npt.NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))

    def get_ring_states(self, poses: int) -> npt.NDArray[np.int8]:
        """`ring_states` for this number of ring poses."""
        if len(self.ring_states) != poses:
            self.ring_states = np.full(poses, UNCHECKED, np.int8)
        return self.ring_states


@compile_function
def can_rings_connect(  # type: ignore[no-untyped-def]
    poses, rooms, starts, first_goal, ring_graph, from_start, to_goal, reach_m, behind_m, radius, speeds, edges
):
    """Whether ring poses lead from a start to a goal; results are cached in `ring_graph`, `from_start` and `to_goal`.

    `poses` (n, 3) are `starts` starts, the ring poses, and goals from `first_goal` on; `rooms` and `ring_graph` are as
    in `find_quickest_chain`, whose links are the same: from starts to ring poses within `reach_m` that are not farther
    back than `behind_m`, and from every ring pose to every goal.
    """
    rings, row, barriers = first_goal - starts, np.zeros((MAX_PIECES, 3)), np.full((3, 1, 4), np.inf)
    seen, stack, high = np.zeros(rings, np.bool_), np.empty(rings, np.int64), 0
    for first in range(rings):
        if from_start[first] == UNCHECKED and not seen[first]:
            from_start[first] = APART
            for start in range(starts):
                if from_start[first] == APART and _is_close(poses[start], poses[starts + first], reach_m, behind_m):
                    link = compute_link_s(poses, start, starts + first, rooms, barriers[0], radius, speeds, edges, row)
                    from_start[first] = JOINED if link < np.inf else APART
        if from_start[first] == JOINED and not seen[first]:
            seen[first], stack[0], high = True, first, 1
        while high > 0:
            high -= 1
            node = stack[high]
            if to_goal[node] == UNCHECKED:
                to_goal[node] = APART
                for goal in range(first_goal, len(poses)):
                    if to_goal[node] == APART:
                        link = compute_link_s(
                            poses, starts + node, goal, rooms, barriers[1], radius, speeds, edges, row
                        )
                        to_goal[node] = JOINED if link < np.inf else APART
            if to_goal[node] == JOINED:
                return True
            for k in range(ring_graph[0][node], ring_graph[0][node + 1]):
                from_pose, to_pose = starts + node, starts + ring_graph[1][k]
                if not seen[ring_graph[1][k]]:
                    if ring_graph[2][k] == UNKNOWN:
                        ring_graph[2][k] = compute_link_s(
                            poses, from_pose, to_pose, rooms, barriers[2], radius, speeds, edges, row
                        )
                    if ring_graph[2][k] < np.inf:
                        seen[ring_graph[1][k]], stack[high] = True, ring_graph[1][k]
                        high += 1
    return False


@compile_function
def _is_close(pose, spot, reach_m, behind_m) -> bool:  # type: ignore[no-untyped-def]
    """Whether a spot is close to a pose, as in `find_close_spots`."""
    x, y = spot[0] - pose[0], spot[1] - pose[1]
    return is_in_reach(x, y, reach_m) and x * math.cos(pose[2]) + y * math.sin(pose[2]) > -behind_m
