"""The height of the ground as a function of place, smooth enough to drive on.

Heights stand on a square grid. Between its nodes they follow cubic convolution (Keys 1981, a = -1/2): the surface goes
through every height, its gradient is continuous, and planes and parabolas come out exactly. The gradient is the
derivative of that same surface, so that a lap that ends where it began has climbed nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from fields.arrays import Floats
from vehicle.errors import VehicleError
from vehicle.jit import compile_function, inline_function

MIN_NODES = 2  # along each side
NO_TERRAIN = np.zeros((0, 0))
"""The grid of a world without heights."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights of the ground, metres in the plane of the field: x east, y north.

    Attributes:
        west_m, south_m: place of the node `heights_m[0, 0]`.
        spacing_m: distance of neighbouring nodes, the same both ways.
        heights_m: shape (rows from south to north, columns from west to east), all finite.

    Beyond its outermost nodes the ground goes on at their height; `covers` says whether places lie inside.

    Raises VehicleError where the grid is too small, or a value is not finite.
    """

    west_m: float
    south_m: float
    spacing_m: float
    heights_m: Floats

    def __post_init__(self) -> None:
        heights = np.ascontiguousarray(self.heights_m, dtype=np.float64)
        if heights.ndim != 2 or min(heights.shape) < MIN_NODES:
            raise VehicleError(f"Heights of shape {heights.shape} are no ground; give {MIN_NODES} rows and columns.")
        if not np.isfinite([self.west_m, self.south_m]).all() or not 0.0 < self.spacing_m < math.inf:
            raise VehicleError(
                f"A grid of heights at ({self.west_m}, {self.south_m}) with nodes {self.spacing_m} m apart is none; "
                "give finite metres and a spacing above 0."
            )
        if not np.isfinite(heights).all():
            raise VehicleError("A height of the ground is not a number; fill the gaps of the grid first.")
        object.__setattr__(self, "heights_m", heights)

    @cached_property
    def grid(self) -> Floats:
        """The heights with one more node on every side, continued straight (rows + 2, columns + 2)."""
        return np.ascontiguousarray(np.pad(self.heights_m, 1, mode="reflect", reflect_type="odd"))

    @cached_property
    def frame(self) -> Floats:
        """West, south (m) of the first height and nodes per metre (3,), as compiled functions take them."""
        return np.array([self.west_m, self.south_m, 1.0 / self.spacing_m])

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east and north of the outermost nodes."""
        rows, columns = self.heights_m.shape
        east, north = self.west_m + (columns - 1) * self.spacing_m, self.south_m + (rows - 1) * self.spacing_m
        return self.west_m, self.south_m, east, north

    def covers(self, points: npt.ArrayLike, margin_m: float = 0.0) -> bool:
        """Whether all of `points` (n, 2) lie inside of the outermost nodes or at most `margin_m` outside."""
        places = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        west, south, east, north = self.bounds_m
        low, high = np.array([west, south]) - margin_m, np.array([east, north]) + margin_m
        return bool(((places >= low) & (places <= high)).all())

    def compute_heights(self, points: npt.ArrayLike) -> Floats:
        """Heights (n,) at `points` (n, 2)."""
        return np.array(_fill_surface(self.grid, self.frame, _make_places(points))[:, 0])

    def compute_gradients(self, points: npt.ArrayLike) -> Floats:
        """Rise per metre to the east and to the north (n, 2) at `points` (n, 2)."""
        return np.array(_fill_surface(self.grid, self.frame, _make_places(points))[:, 1:])


def _make_places(points: npt.ArrayLike) -> Floats:
    return np.ascontiguousarray(np.asarray(points, dtype=np.float64).reshape(-1, 2))


@inline_function
def _compute_weights(share: float) -> tuple[float, float, float, float]:
    """Weights of four nodes in a row, `share` of the way from the second to the third."""
    square = share * share
    cube = square * share
    return (
        square - 0.5 * (share + cube),
        1.0 - 2.5 * square + 1.5 * cube,
        0.5 * share + 2.0 * square - 1.5 * cube,
        0.5 * (cube - square),
    )


@inline_function
def _compute_weight_slopes(share: float) -> tuple[float, float, float, float]:
    """Derivatives of the weights by `share`."""
    square = share * share
    return (
        2.0 * share - 0.5 - 1.5 * square,
        4.5 * square - 5.0 * share,
        0.5 + 4.0 * share - 4.5 * square,
        1.5 * square - share,
    )


@inline_function
def _locate(place: float, count: int) -> tuple[int, float]:
    """The cell of a coordinate in units of nodes, and the share of it that lies behind; clamped to `count` nodes."""
    inside = min(max(place, 0.0), count - 1.0)
    cell = min(int(inside), count - 2)
    return cell, inside - cell


@inline_function
def _mix(grid, row: int, column: int, a: float, b: float, c: float, d: float) -> float:  # type: ignore[no-untyped-def]
    """Weighted sum of four heights of a row."""
    return (a * grid[row, column] + b * grid[row, column + 1]) + (c * grid[row, column + 2] + d * grid[row, column + 3])  # type: ignore[no-any-return]


@compile_function
def compute_gradient(grid, frame, x: float, y: float) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Rise per metre to the east and to the north at (x, y), of Terrain.grid and Terrain.frame; 0 beyond an edge."""
    east, north = (x - frame[0]) * frame[2], (y - frame[1]) * frame[2]
    rows, columns = grid.shape[0] - 2, grid.shape[1] - 2
    column, across = _locate(east, columns)
    row, up = _locate(north, rows)
    a, b, c, d = _compute_weights(across)
    e, f, g, h = _compute_weight_slopes(across)
    i, j, k, m = _compute_weights(up)
    p, q, r, s = _compute_weight_slopes(up)
    to_east = (i * _mix(grid, row, column, e, f, g, h) + j * _mix(grid, row + 1, column, e, f, g, h)) + (
        k * _mix(grid, row + 2, column, e, f, g, h) + m * _mix(grid, row + 3, column, e, f, g, h)
    )
    to_north = (p * _mix(grid, row, column, a, b, c, d) + q * _mix(grid, row + 1, column, a, b, c, d)) + (
        r * _mix(grid, row + 2, column, a, b, c, d) + s * _mix(grid, row + 3, column, a, b, c, d)
    )
    if not 0.0 <= east <= columns - 1.0:
        to_east = 0.0
    if not 0.0 <= north <= rows - 1.0:
        to_north = 0.0
    return to_east * frame[2], to_north * frame[2]


@compile_function
def compute_height(grid, frame, x: float, y: float) -> float:  # type: ignore[no-untyped-def]
    """Height (m) at (x, y), of Terrain.grid and Terrain.frame; beyond an edge, that of the edge."""
    column, across = _locate((x - frame[0]) * frame[2], grid.shape[1] - 2)
    row, up = _locate((y - frame[1]) * frame[2], grid.shape[0] - 2)
    a, b, c, d = _compute_weights(across)
    i, j, k, m = _compute_weights(up)
    return (i * _mix(grid, row, column, a, b, c, d) + j * _mix(grid, row + 1, column, a, b, c, d)) + (
        k * _mix(grid, row + 2, column, a, b, c, d) + m * _mix(grid, row + 3, column, a, b, c, d)
    )


@compile_function
def _fill_surface(grid: Any, frame: Any, points: Any) -> Any:
    """Height, rise to the east and to the north (n, 3) at points (n, 2)."""
    surface = np.empty((len(points), 3))
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        surface[n, 0] = compute_height(grid, frame, x, y)
        surface[n, 1], surface[n, 2] = compute_gradient(grid, frame, x, y)
    return surface
