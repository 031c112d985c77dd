"""What a body may touch, as a grid of signed distances, and how much room a body has on it, compiled.

Distances are exact near the edges of the allowed ground and capped at `cap_m` away from them: a little more than a body
reaches is all that matters. Between the points of the grid they are interpolated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats, Integers
from strategies.path_planning.machine_body import POINT_STEP_M
from vehicle.jit import compile_for_views, compile_function

CELL_M = (
    POINT_STEP_M  # of the grid, and between places that are looked up in it: distances err by centimetres at corners
)
BORDER_CELLS = 4  # beyond the allowed ground, so that a body just outside is measured too
PATH_STEP_M = 0.4  # between the poses checked on a path
AMPLE_M = 0.25  # beyond the room asked for: more makes no difference
STEEPEST = math.sqrt(2.0)  # how much interpolated distances differ over a metre at most, on the grid


@compile_function
def fill_distances(edges, west, south, cell, cap, grid) -> None:  # type: ignore[no-untyped-def]
    """Lower the distances of a grid (ny, nx) to those from edges (n, 4) where these are nearer than `cap`."""
    rows, columns = grid.shape
    for k in range(len(edges)):
        ax, ay, bx, by = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        left = max(0, int((min(ax, bx) - cap - west) / cell))
        right = min(columns - 1, int((max(ax, bx) + cap - west) / cell) + 1)
        low = max(0, int((min(ay, by) - cap - south) / cell))
        high = min(rows - 1, int((max(ay, by) + cap - south) / cell) + 1)
        for j in range(low, high + 1):
            for i in range(left, right + 1):
                px, py = west + i * cell - ax, south + j * cell - ay
                share = 0.0 if square == 0.0 else min(1.0, max(0.0, (px * dx + py * dy) / square))
                apart = math.hypot(px - share * dx, py - share * dy)
                if apart < grid[j, i]:
                    grid[j, i] = apart


@compile_function
def negate_outside(edges, west, south, cell, grid) -> None:  # type: ignore[no-untyped-def]
    """Make the distances of a grid negative outside the region whose boundary the edges (n, 4) are."""
    rows, columns = grid.shape
    crossings = np.zeros((rows, columns + 1), np.int8)  # parity of the boundaries crossed left of a point
    for k in range(len(edges)):
        ax, ay, bx, by = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if ay == by:
            continue
        first = max(0, math.ceil((min(ay, by) - south) / cell))
        for j in range(first, rows):
            y = south + j * cell
            if y >= max(ay, by):
                break
            column = math.ceil((ax + (y - ay) / (by - ay) * (bx - ax) - west) / cell)
            crossings[j, min(max(column, 0), columns)] ^= 1
    for j in range(rows):
        inside = 0
        for i in range(columns):
            inside ^= crossings[j, i]
            if not inside:
                grid[j, i] = -grid[j, i]


@compile_for_views
def get_distance(x, y, grid, frame) -> float:  # type: ignore[no-untyped-def]
    """Signed distance (m, inside positive) at a place; beyond the grid minus its cap.

    `frame` is west, south, cell and cap.
    """
    u, v = (x - frame[0]) / frame[2], (y - frame[1]) / frame[2]
    i, j = math.floor(u), math.floor(v)
    if i < 0 or j < 0 or i >= grid.shape[1] - 1 or j >= grid.shape[0] - 1:
        return -frame[3]  # type: ignore[no-any-return]
    u -= i
    v -= j
    low = (1.0 - u) * grid[j, i] + u * grid[j, i + 1]
    high = (1.0 - u) * grid[j + 1, i] + u * grid[j + 1, i + 1]
    return (1.0 - v) * low + v * high  # type: ignore[no-any-return]


@compile_for_views
def measure_body_room(x, y, cosine, sine, points, grid, frame, enough, most) -> float:  # type: ignore[no-untyped-def]
    """Least signed distance (m) of the points (n, 3) of a body with its rear axle at a pose, `most` if it is more.

    The heading is given by its cosine and sine. Below `enough` it stops at the first point that shows it. Points that
    are too near to one with more room to have less are skipped, so that what is beyond the grid may count as less far
    outside.
    """
    least, spare = most, 0.0
    for k in range(len(points)):
        spare -= STEEPEST * points[k, 2]
        if spare > 0.0:
            continue
        px, py = points[k, 0], points[k, 1]
        distance = get_distance(x + px * cosine - py * sine, y + px * sine + py * cosine, grid, frame)
        if distance < least:
            least = distance
            if least < enough:
                return least
        spare = distance - least
    return least  # type: ignore[no-any-return]


@compile_for_views
def measure_path_room(a, rows, guide, points, reach, grid, frame, enough):  # type: ignore[no-untyped-def]
    """Least room (m) of a body on a path of rows (n, 3: length, curvature, gear), and the metres driven up to there if
    it is below `enough`.

    The guided point, `guide` ahead of the rear axle, begins at the pose a (3,). Forwards the axle trails it, in reverse
    the body lies along the path. Below `enough` it stops at the first place that shows it; a place with more room than
    ample, `AMPLE_M` beyond that, counts as that.
    """
    px, py, heading, driven = a[0], a[1], a[2], 0.0
    x, y = px - guide * math.cos(heading), py - guide * math.sin(heading)
    least = enough + AMPLE_M
    for k in range(len(rows)):
        length, bend, gear = rows[k, 0], rows[k, 1], rows[k, 2]
        if length <= 1e-9:
            continue
        steps = max(1, math.ceil(length / PATH_STEP_M))
        half = 0.5 * bend * gear * length / steps
        chord = gear * length / steps * (math.sin(half) / half if half != 0.0 else 1.0)
        dx, dy = chord * math.cos(heading + half), chord * math.sin(heading + half)
        turn_x, turn_y = math.cos(2.0 * half), math.sin(2.0 * half)
        for number in range(1, steps + 1):
            ahead_x, ahead_y = (-dx, -dy) if gear < 0.0 else (px + dx - x, py + dy - y)
            px, py = px + dx, py + dy
            long = math.sqrt(ahead_x * ahead_x + ahead_y * ahead_y)
            cosine, sine = ahead_x / long, ahead_y / long
            x, y = px - guide * cosine, py - guide * sine
            if get_distance(x, y, grid, frame) < reach + least:
                least = measure_body_room(x, y, cosine, sine, points, grid, frame, enough, least)
                if least < enough:
                    return least, driven + length * number / steps
            dx, dy = dx * turn_x - dy * turn_y, dx * turn_y + dy * turn_x
        heading += bend * gear * length
        driven += length
    return least, driven


@compile_for_views
def has_room_on_path(a, rows, guide, points, reach, grid, frame, margin) -> bool:  # type: ignore[no-untyped-def]
    """Whether a body keeps `margin` (m) on a path, as measure_path_room has it."""
    room, _ = measure_path_room(a, rows, guide, points, reach, grid, frame, margin)
    return room >= margin  # type: ignore[no-any-return]


@compile_function
def measure_rooms(poses, axle, points, reach, grid, frame, cap):  # type: ignore[no-untyped-def]
    """Room (t,) of a body at poses (t, 3) of a point `axle` ahead of its rear axle, exact below `cap` (m)."""
    rooms = np.empty(len(poses))
    for k in range(len(poses)):
        cosine, sine = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        x, y = poses[k, 0] - axle * cosine, poses[k, 1] - axle * sine
        rooms[k] = get_distance(x, y, grid, frame) - reach
        if rooms[k] < cap:
            rooms[k] = measure_body_room(x, y, cosine, sine, points, grid, frame, -np.inf, cap)
    return rooms


@compile_for_views
def measure_length_inside(a, rows, grid, frame, depth) -> float:  # type: ignore[no-untyped-def]
    """Metres of a path of rows (n, 3) from a pose (3,) that lie deeper than `depth` (m) in the region of a grid."""
    x, y, heading, inside = a[0], a[1], a[2], 0.0
    for k in range(len(rows)):
        length, bend, gear = rows[k, 0], rows[k, 1], rows[k, 2]
        if length <= 1e-9:
            continue
        steps = max(1, math.ceil(length))
        for number in range(steps):
            run = gear * length * (number + 0.5) / steps
            half = 0.5 * bend * run
            chord = run * (math.sin(half) / half if half != 0.0 else 1.0)
            if (
                get_distance(x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), grid, frame)
                > depth
            ):
                inside += length / steps
        run = gear * length
        half = 0.5 * bend * run
        chord = run * (math.sin(half) / half if half != 0.0 else 1.0)
        x, y = x + chord * math.cos(heading + half), y + chord * math.sin(heading + half)
        heading += 2.0 * half
    return inside


@dataclass(frozen=True, eq=False)
class Ground:
    """Ground that bodies may touch, with signed distances known up to a cap.

    Attributes:
        grid: (ny, nx) signed distances, metres, positive inside.
        frame: (4,) west and south end of the grid, its cell and the cap, metres.
        region: the ground that it is of.
    """

    grid: npt.NDArray[np.float32]
    frame: Floats
    region: shapely.Geometry

    def number_parts(self, half_m: float, places: Floats) -> Integers:
        """In which part of the ground places (n, 2) lie, where parts are joined by passages that a machine of half that
        width gets through; 0 for a place that has less room to an edge, or lies outside.

        To half a cell of the grid, as near as room is known, parts are not held for apart.
        """
        parts = shapely.get_parts(self.region.buffer(0.5 * CELL_M - half_m))
        found, number = shapely.STRtree(parts).query(shapely.points(places), predicate="intersects")
        numbers = np.zeros(len(places), np.int64)
        numbers[found] = number + 1
        return numbers


def build_ground(allowed: shapely.Geometry, cap_m: float) -> Ground:
    """The ground of a region, with distances up to `cap_m`; nowhere where the region is empty."""
    if allowed.is_empty:
        return Ground(np.full((2, 2), -cap_m, np.float32), np.array([0.0, 0.0, CELL_M, cap_m]), allowed)
    west, south, east, north = allowed.bounds
    west, south = west - BORDER_CELLS * CELL_M, south - BORDER_CELLS * CELL_M
    columns, rows = (int(span / CELL_M) + 2 * BORDER_CELLS + 2 for span in (east - west, north - south))
    edges = list_edges(allowed)
    grid = np.full((rows, columns), cap_m, np.float32)
    fill_distances(edges, west, south, CELL_M, cap_m, grid)
    negate_outside(edges, west, south, CELL_M, grid)
    return Ground(grid, np.array([west, south, CELL_M, cap_m]), allowed)


def list_edges(region: shapely.Geometry) -> Floats:
    """The straight pieces (n, 4) of the boundary of a region: x and y of both ends."""
    points, owner = shapely.get_coordinates(shapely.get_parts(region.boundary), return_index=True)
    inner = np.flatnonzero(owner[1:] == owner[:-1])
    return np.ascontiguousarray(np.column_stack([points[inner], points[inner + 1]]))
