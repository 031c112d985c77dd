"""A route where corners and rings lead nowhere: hybrid A* over places and headings, compiled.

From every pose short arcs to either side and a short straight lead on, in reverse too if allowed. Poses keep their
exact place and heading; one per cell and sector of headings is followed further, the most promising first. Near the end
a forward primitive is tried to every goal. The chain found is shortened: a primitive that fits replaces as much of it
as it can.

Source: D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel, "Practical search techniques in path planning for autonomous
driving", STAIR workshop at AAAI (2008).
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from strategies.path_planning.paths import DrivePath, PathSegment, join_paths, make_pose, merge_segments
from strategies.path_planning.primitive_search import find_near_edges, find_shortest_forward
from strategies.path_planning.primitives import MAX_PIECES, TAU, advance_pose, compute_drive_time_s, is_primitive_inside
from strategies.path_planning.route_search import EndMoves
from vehicle.copying import copy_row, copy_table
from vehicle.jit import compile_function

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SECTORS = 24  # of headings
CELL_RADII = 0.25
MOST_CELLS = 60_000  # cells grow with the field beyond these
STEP_CELLS = 1.5  # a straight as long as this leaves its cell
MAX_NODES = 120_000
GOAL_REACH_RADII = 6.0  # radii within which a primitive to a goal is tried
GREED = 1.3  # weight of the way that remains: a path a little longer is found much sooner
ROUNDING_M = 1e-6
BEND_COST = 1.03  # of a straight as long, so that straights are preferred


@dataclass(frozen=True, eq=False)
class LatticeGrid:
    """Cells over a region: the place of the first, their size (m), and which are within the region (nx, ny)."""

    west_m: float
    south_m: float
    cell_m: float
    is_free: npt.NDArray[np.bool_]

    @property
    def reach_m(self) -> float:
        """More than any path between neighbouring cells (m): a limit where there is none."""
        return self.cell_m * self.is_free.size

    @classmethod
    def from_region(cls, region: BaseGeometry, radius_m: float) -> LatticeGrid:
        """Cells of a quarter of the radius, larger ones on large fields."""
        west, south, east, north = region.bounds
        cell_m = max(CELL_RADII * radius_m, math.sqrt((east - west) * (north - south) / MOST_CELLS))
        counts = (math.ceil(span / cell_m) + 1 for span in (east - west, north - south))
        x, y = (first + cell_m * np.arange(n) for first, n in zip((west, south), counts, strict=True))
        near = region.buffer(cell_m)
        shapely.prepare(near)
        return cls(west, south, cell_m, shapely.contains_xy(near, *np.meshgrid(x, y, indexing="ij")))


@compile_function
def find_cell(x, y, west, south, cell):  # type: ignore[no-untyped-def]
    """Numbers of the cell of a place."""
    return int(np.floor((x - west) / cell + 0.5)), int(np.floor((y - south) / cell + 0.5))


@compile_function
def measure_remaining_m(goals, is_free, west, south, cell):  # type: ignore[no-untyped-def]
    """Metres from every cell (nx, ny) to the nearest goal over free cells and their diagonals; infinite for none."""
    columns, rows = is_free.shape
    remaining_m = np.full((columns, rows), np.inf)
    heap = [(0.0, 0, 0)]
    heap.pop()
    for k in range(len(goals)):
        i, j = find_cell(goals[k, 0], goals[k, 1], west, south, cell)
        if 0 <= i < columns and 0 <= j < rows and remaining_m[i, j] > 0.0:
            remaining_m[i, j] = 0.0
            heapq.heappush(heap, (0.0, i, j))
    while len(heap) > 0:
        distance, i, j = heapq.heappop(heap)
        if distance > remaining_m[i, j]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                p, q = i + di, j + dj
                if (di == 0 and dj == 0) or p < 0 or q < 0 or p >= columns or q >= rows or not is_free[p, q]:
                    continue
                longer = distance + cell * math.sqrt(di * di + dj * dj)
                if longer < remaining_m[p, q] - ROUNDING_M:
                    remaining_m[p, q] = longer
                    heapq.heappush(heap, (longer, p, q))
    return remaining_m


@compile_function
def find_sector(heading) -> int:  # type: ignore[no-untyped-def]
    """Number of the sector of a heading."""
    return int(np.floor((heading % TAU) / TAU * SECTORS)) % SECTORS


@compile_function
def search_lattice(  # type: ignore[no-untyped-def]
    starts, before_s, goals, after_s, remaining_m, west, south, cell, radius, speeds, edges, max_reverse
):
    """Steps (k, 3) from a start, the primitive (5, 3) on to a goal, and the numbers of both, -1 for no route.

    `starts` (n, 3) and `goals` (m, 3) are poses with the seconds `before_s` and `after_s` spent before and after them.
    At most `max_reverse` metres of the steps are in reverse.
    """
    gears, step = 2 if max_reverse > 0.0 else 1, max(STEP_CELLS * cell, TAU * radius / SECTORS)
    poses, came_from, cost_s = np.empty((MAX_NODES, 3)), np.empty(MAX_NODES, np.int64), np.empty(MAX_NODES)
    steps, back_m = np.zeros((MAX_NODES, 3)), np.zeros(MAX_NODES)
    is_closed = np.zeros((*remaining_m.shape, SECTORS, gears), np.bool_)
    piece, link, best_link = np.zeros((1, 3)), np.zeros((MAX_PIECES, 3)), np.zeros((MAX_PIECES, 3))
    heap = [(0.0, 0)]
    heap.pop()
    count, best_s, best_node, best_goal = 0, np.inf, -1, -1
    for k in range(len(starts)):
        left_m = get_remaining_m(starts[k, 0], starts[k, 1], remaining_m, west, south, cell)
        if left_m < np.inf and count < MAX_NODES:
            copy_row(starts[k], poses[count])
            came_from[count], cost_s[count], steps[count, 2] = -1 - k, before_s[k], 1.0
            heapq.heappush(heap, (before_s[k] + GREED * left_m / speeds[0], count))
            count += 1
    while len(heap) > 0 and count + 3 * gears <= MAX_NODES:
        bound, node = heapq.heappop(heap)
        if bound >= best_s:
            break
        i, j = find_cell(poses[node, 0], poses[node, 1], west, south, cell)
        place = i, j, find_sector(poses[node, 2]), 0 if steps[node, 2] > 0.0 else 1
        if is_closed[place]:
            continue
        is_closed[place] = True
        if steps[node, 2] > 0.0 and remaining_m[i, j] <= GOAL_REACH_RADII * radius:
            limit_s = best_s - cost_s[node]
            goal, seconds = find_quickest_goal(poses[node], goals, after_s, limit_s, radius, speeds, edges, link)
            if goal >= 0:
                best_s, best_node, best_goal = cost_s[node] + seconds, node, goal
                copy_table(link, best_link)
        edges_in_reach = find_near_edges(poses[node], poses[node], step, edges)
        for action in range(3 * gears):
            gear, bend = (1.0 if action < 3 else -1.0), action % 3 - 1
            run_m = back_m[node] + (step if gear < 0.0 else 0.0)
            piece[0, 0], piece[0, 1], piece[0, 2] = step, bend / radius, gear
            x, y, heading = advance_pose(poses[node, 0], poses[node, 1], poses[node, 2], step, bend / radius, gear)
            left_m = get_remaining_m(x, y, remaining_m, west, south, cell)
            if left_m == np.inf or (gear < 0.0 and run_m > max_reverse):
                continue
            i, j = find_cell(x, y, west, south, cell)
            if is_closed[i, j, find_sector(heading), 0 if gear > 0.0 else 1] or not is_primitive_inside(
                poses[node], piece, edges_in_reach
            ):
                continue
            seconds = step / (speeds[0] if gear > 0.0 else speeds[1]) * (BEND_COST if bend != 0 else 1.0)
            seconds += speeds[2] if gear != steps[node, 2] else 0.0
            poses[count, 0], poses[count, 1], poses[count, 2] = x, y, heading
            copy_row(piece[0], steps[count])
            came_from[count] = node
            cost_s[count], back_m[count] = cost_s[node] + seconds, run_m
            heapq.heappush(heap, (cost_s[count] + GREED * left_m / speeds[0], count))
            count += 1
    chain, start = trace_steps(steps, came_from, best_node)
    return chain, best_link, start, best_goal


@compile_function
def get_remaining_m(x, y, remaining_m, west, south, cell) -> float:  # type: ignore[no-untyped-def]
    """The metres that remain from the cell of a place; infinite outside the cells."""
    i, j = find_cell(x, y, west, south, cell)
    if i < 0 or j < 0 or i >= remaining_m.shape[0] or j >= remaining_m.shape[1]:
        return np.inf
    return remaining_m[i, j]  # type: ignore[no-any-return]


@compile_function
def find_quickest_goal(pose, goals, after_s, limit_s, radius, speeds, edges, best):  # type: ignore[no-untyped-def]
    """The goal (m, 3) that a forward primitive reaches soonest, and the seconds, into `best`; -1 for none in time."""
    best_goal, link = -1, np.zeros((MAX_PIECES, 3))
    for goal in range(len(goals)):
        flight_m = math.hypot(goals[goal, 0] - pose[0], goals[goal, 1] - pose[1])
        if after_s[goal] + flight_m / speeds[0] < limit_s and (
            find_shortest_forward(pose, goals[goal], radius, edges, 3, link) >= 0
        ):
            seconds = compute_drive_time_s(link, speeds) + after_s[goal]
            if seconds < limit_s:
                limit_s, best_goal = seconds, goal
                copy_table(link, best)
    return best_goal, limit_s


@compile_function
def trace_steps(steps, came_from, node):  # type: ignore[no-untyped-def]
    """The steps (k, 3) that lead to a node, and the number of the start they begin at; -1 for node -1."""
    length, current_node = 0, node
    while current_node >= 0 and came_from[current_node] >= 0:
        length, current_node = length + 1, came_from[current_node]
    chain, start = np.empty((length, 3)), -1 - came_from[current_node] if node >= 0 else -1
    current_node = node
    for k in range(length - 1, -1, -1):
        copy_row(steps[current_node], chain[k])
        current_node = came_from[current_node]
    return chain, start


@compile_function
def shorten_chain(poses, lengths, radius, edges, links):  # type: ignore[no-untyped-def]
    """For each pose (n, 3) of a forward chain the one to drive to next, 0 if not passed; its primitive is in `links`.

    `lengths` (n,) are metres along the chain, `links` (n, 5, 3). A link that is no shorter than the chain is not taken:
    then the next pose follows, and no primitive is given (its first length is negative).
    """
    after, i = np.zeros(len(poses), np.int64), 0
    while i < len(poses) - 1:
        after[i], links[i, 0, 0] = i + 1, -1.0
        for j in range(len(poses) - 1, i, -1):
            is_joined = find_shortest_forward(poses[i], poses[j], radius, edges, 3, links[i]) >= 0
            if is_joined and links[i, :, 0].sum() <= lengths[j] - lengths[i] + ROUNDING_M:
                after[i] = j
                break
            links[i, 0, 0] = -1.0
        i = after[i]
    return after


def find_lattice_route(
    begin: EndMoves, end: EndMoves, grid: LatticeGrid, radius_m: float, speeds: Floats, edges: Floats, reverse_m: float
) -> DrivePath | None:
    """The quickest route found from one of the moves at its beginning to one of those at its end; None for none.

    Up to `reverse_m` metres between them are in reverse.
    """
    if not begin.paths or not end.paths:
        return None
    place = grid.west_m, grid.south_m, grid.cell_m
    remaining_m = measure_remaining_m(end.spots.poses, grid.is_free, *place)
    rows, link, start, goal = search_lattice(
        begin.spots.poses,
        begin.seconds,
        end.spots.poses,
        end.seconds,
        remaining_m,
        *place,
        radius_m,
        speeds,
        edges,
        reverse_m,
    )
    if start < 0:
        return None
    chain = _build_segments(np.concatenate([rows, link[link[:, 0] > 0.0]]))
    first = make_pose(begin.spots.poses[start])
    between = _shorten_runs(merge_segments(first, chain, "route"), radius_m, edges)
    tail = end.paths[goal]
    return join_paths((begin.paths[start], between, tail), "route")


def _build_segments(rows: Floats) -> list[PathSegment]:
    return [PathSegment(length, curvature, 1 if gear > 0.0 else -1) for length, curvature, gear in rows.tolist()]


def _shorten_runs(path: DrivePath, radius_m: float, edges: Floats) -> DrivePath:
    """The path with every forward run replaced by primitives that lead on as far as they can."""
    cuts = [k + 1 for k, (p, q) in enumerate(pairwise(path.segments)) if p.gear != q.gear]
    poses, segments = list(path.list_segment_starts()), list[PathSegment]()
    for first, last in pairwise([0, *cuts, len(path.segments)]):
        run = path.segments[first:last]
        if not run or run[0].gear < 0:
            segments += run
            continue
        part = merge_segments(poses[first], run, "route")
        segments += _shorten_run(part, radius_m, edges)
    return merge_segments(path.start, segments, "route")


def _shorten_run(path: DrivePath, radius_m: float, edges: Floats) -> list[PathSegment]:
    """The segments of a forward path, of which primitives replace as much as they can."""
    pieces = [
        PathSegment(segment.length_m / count, segment.curvature, 1)
        for segment in path.segments
        for count in [max(1, math.ceil(segment.length_m / radius_m))]
        for _ in range(count)
    ]
    poses = np.array([*DrivePath(path.start, tuple(pieces), "route").list_segment_starts(), path.end])
    lengths_m = np.concatenate([[0.0], np.cumsum([piece.length_m for piece in pieces])])
    links = np.zeros((len(poses), MAX_PIECES, 3))
    after = shorten_chain(poses, lengths_m, radius_m, edges, links)
    segments, node = list[PathSegment](), 0
    while node < len(poses) - 1:
        is_direct = links[node, 0, 0] >= 0.0
        segments += _build_segments(links[node][links[node, :, 0] > 0.0]) if is_direct else [pieces[node]]
        node = int(after[node])
    return segments
