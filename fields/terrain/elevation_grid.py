"""Heights of a field on a square grid in its plane, and how gaps in them are filled.

Where nothing was measured, heights are continued so that the surface bends as little as possible, and only so far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from dataclasses import field as member

import numpy as np
import shapely

from fields.arrays import Flags, Floats
from fields.errors import HeadlandError

MIN_NODES, MAX_NODES = 4, 250_000
"""Nodes along each side that a smooth surface through them needs, and nodes of one grid at most."""
STENCILS = (
    (((0, -1), 1.0), ((0, 0), -2.0), ((0, 1), 1.0)),
    (((-1, 0), 1.0), ((0, 0), -2.0), ((1, 0), 1.0)),
    (((0, 0), 2.0**0.5), ((0, 1), -(2.0**0.5)), ((1, 0), -(2.0**0.5)), ((1, 1), 2.0**0.5)),
)
"""Second differences whose squares sum up to the bending of a thin plate: along x, along y, and mixed (weight 2)."""
TIE_WEIGHT = 1e-10
"""Pull towards the nearest measured height; it only decides where no stencil does."""


class ElevationError(HeadlandError):
    """Heights that cannot be used for a field; names the parameter `elevation`."""

    def __init__(self, sentence: str, *, parameter: str | None = "elevation") -> None:
        super().__init__(sentence, parameter=parameter)


@dataclass(frozen=True)
class NodeFrame:
    """Places of the nodes of a grid over a field, metres: the south-west one, the spacing, rows and columns."""

    west_m: float
    south_m: float
    spacing_m: float
    rows: int
    columns: int

    def list_places(self) -> Floats:
        """All nodes, shape (rows * columns, 2), row by row from the south-west."""
        xs = self.west_m + self.spacing_m * np.arange(self.columns)
        ys = self.south_m + self.spacing_m * np.arange(self.rows)
        return np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)

    def find_inside(self, region: shapely.Geometry) -> Flags:
        """Whether each node is in a region, shape (rows, columns)."""
        shapely.prepare(region)
        x, y = self.list_places().T
        return np.asarray(shapely.contains_xy(region, x, y)).reshape(self.rows, self.columns)


@dataclass(frozen=True, eq=False)
class ElevationGrid:
    """Heights at the nodes of a grid, metres in the plane of the field: x east, y north.

    Attributes:
        west_m, south_m: place of the node `heights_m[0, 0]`.
        spacing_m: distance of neighbouring nodes, the same both ways.
        heights_m: shape (rows from south to north, columns from west to east), all finite.
        is_measured: same shape; False where a height is continued from measured ones.
        source: where the heights come from and how they were gridded, in words.
        remarks: sentences on what a reader should know: gaps, edges, noise, units.

    Raises ElevationError where the grid is too small, or a height is not finite.
    """

    west_m: float
    south_m: float
    spacing_m: float
    heights_m: Floats
    is_measured: Flags | None = None
    source: str = ""
    remarks: tuple[str, ...] = member(default=())

    def __post_init__(self) -> None:
        heights = np.ascontiguousarray(self.heights_m, dtype=np.float64)
        if heights.ndim != 2 or min(heights.shape) < MIN_NODES:
            raise ElevationError(
                f"A grid of heights has the shape {heights.shape}; it needs {MIN_NODES} rows and columns or more."
            )
        if not (np.isfinite(heights).all() and np.isfinite([self.west_m, self.south_m]).all() and self.spacing_m > 0.0):
            raise ElevationError("A grid of heights has values that are not finite; give measured heights.")
        object.__setattr__(self, "heights_m", heights)

    @property
    def frame(self) -> NodeFrame:
        """Places of its nodes."""
        return NodeFrame(self.west_m, self.south_m, self.spacing_m, *self.heights_m.shape)

    @property
    def xs_m(self) -> Floats:
        """Places of the columns, metres east."""
        return np.asarray(self.west_m + self.spacing_m * np.arange(self.heights_m.shape[1]))

    @property
    def ys_m(self) -> Floats:
        """Places of the rows, metres north."""
        return np.asarray(self.south_m + self.spacing_m * np.arange(self.heights_m.shape[0]))

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east and north of the outermost nodes."""
        return self.west_m, self.south_m, float(self.xs_m[-1]), float(self.ys_m[-1])


def lay_nodes(region: shapely.Geometry, spacing_m: float, margin_m: float) -> NodeFrame:
    """Nodes over a region and a margin round it, on whole multiples of the spacing; wider where there were too many."""
    west, south, east, north = region.buffer(margin_m).bounds
    spacing_m = max(spacing_m, math.sqrt((east - west) * (north - south) / MAX_NODES))
    first_column, first_row = math.floor(west / spacing_m), math.floor(south / spacing_m)
    columns, rows = math.ceil(east / spacing_m) - first_column + 1, math.ceil(north / spacing_m) - first_row + 1
    return NodeFrame(
        first_column * spacing_m, first_row * spacing_m, spacing_m, max(rows, MIN_NODES), max(columns, MIN_NODES)
    )


def fill_gaps(heights: Floats, near: Flags) -> Floats:
    """Heights (rows, columns) without NaN.

    Nodes of `near` minimise the sum of squared second differences, so a plane is continued as the same plane; all
    others take the nearest height. Expects at least one finite height.
    """
    from scipy.ndimage import distance_transform_edt

    unknown = ~np.isfinite(heights)
    if not unknown.any():
        return heights
    rows, columns = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    filled = heights[rows, columns]
    wanted = unknown & near
    if wanted.any():
        filled[wanted] += _solve_corrections(filled, unknown, wanted)
    still = unknown & ~near
    rows, columns = distance_transform_edt(still, return_distances=False, return_indices=True)
    return np.asarray(filled[rows, columns])


def _solve_corrections(filled: Floats, unknown: Flags, wanted: Flags) -> Floats:
    """What to add to the nearest heights at the `wanted` nodes, in their order."""
    from scipy.sparse import coo_matrix, identity
    from scipy.sparse.linalg import spsolve

    numbers = np.full(filled.shape, -1)
    numbers[wanted] = np.arange(int(wanted.sum()))
    numbers, is_usable, filled = np.pad(numbers, 1), np.pad(~unknown | wanted, 1), np.pad(filled, 1)
    equations, unknowns, weights, residuals, first = [], [], [], [], 0
    for stencil in STENCILS:
        parts = [(_shift(numbers, place), _shift(is_usable, place), _shift(filled, place), w) for place, w in stencil]
        used = np.logical_and.reduce([usable for _, usable, _, _ in parts])
        used &= np.logical_or.reduce([number >= 0 for number, _, _, _ in parts])
        count = int(used.sum())
        residuals.append(sum(weight * height[used] for _, _, height, weight in parts))
        for number, _, _, weight in parts:
            is_unknown = number[used] >= 0
            equations.append(first + np.flatnonzero(is_unknown))
            unknowns.append(number[used][is_unknown])
            weights.append(np.full(int(is_unknown.sum()), weight))
        first += count
    size = int(wanted.sum())
    matrix = coo_matrix(
        (np.concatenate(weights), (np.concatenate(equations), np.concatenate(unknowns))), (first, size)
    ).tocsc()
    normal = (matrix.T @ matrix + TIE_WEIGHT * identity(size)).tocsc()
    return np.asarray(spsolve(normal, -(matrix.T @ np.concatenate(residuals))))


def _shift(values: Floats | Flags, place: tuple[int, int]) -> Floats | Flags:
    """The inner part of an array, moved by rows and columns of a stencil."""
    rows, columns = values.shape
    return values[1 + place[0] : rows - 1 + place[0], 1 + place[1] : columns - 1 + place[1]]
