"""Surfaces in closed form, and files of their heights, written without the code under test."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.arrays import Floats
from fields.geometry.field import Field

Surface = Callable[[Floats, Floats], Floats]

CRS, ORIGIN_M = "EPSG:32632", (557_000.0, 6_314_000.0)
FIELD = Field("Hill", shapely.box(-100.0, -80.0, 100.0, 80.0), CRS, ORIGIN_M)


def build_plane(east: float, north: float, base_m: float = 50.0) -> Surface:
    return lambda x, y: base_m + east * x + north * y


def bowl(x: Floats, y: Floats) -> Floats:
    """A paraboloid: slope x / 2000 east and y / 1500 north."""
    return 50.0 + x**2 / 4000.0 + y**2 / 3000.0


def hills(x: Floats, y: Floats) -> Floats:
    return 100.0 + 1.5 * np.sin(2 * np.pi * x / 350.0) * np.cos(2 * np.pi * y / 260.0) + 0.002 * x


def project(points: Floats, from_crs: str, to_crs: str) -> Floats:
    from pyproj import Transformer

    return np.column_stack(Transformer.from_crs(from_crs, to_crs, always_xy=True).transform(*points.T))


def write_geotiff(
    path: Path,
    surface: Surface,
    *,
    cell: float = 5.0,
    crs: str | None = CRS,
    margin_m: float = 40.0,
    south_up: bool = False,
    turned_deg: float = 0.0,
    unit: str = "",
    scale: float = 1.0,
    nodata: float | None = -9999.0,
    edit: Callable[[Floats], None] | None = None,
    moved_m: tuple[float, float] = (0.0, 0.0),
    dtype: str = "float64",
) -> Path:
    """A raster over FIELD and a margin, whose cells hold the surface at their centres (divided by `scale`)."""
    import rasterio
    from rasterio.transform import Affine

    west, south, east, north = FIELD.boundary.buffer(margin_m).bounds
    corners = np.array([[west, south], [east, south], [east, north], [west, north]]) + ORIGIN_M + moved_m
    placed = corners if crs in (CRS, None) else project(corners, CRS, str(crs))
    (low_x, low_y), (high_x, high_y) = placed.min(axis=0), placed.max(axis=0)
    columns, rows = round((high_x - low_x) / cell), round((high_y - low_y) / cell)
    middle = np.array([0.5 * (low_x + high_x), 0.5 * (low_y + high_y)])
    turn = np.radians(turned_deg)
    steps = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    steps = steps @ np.diag([cell, cell if south_up else -cell])  # one column, one row
    first = middle - steps @ (0.5 * columns, 0.5 * rows)
    place = Affine(*steps[0], first[0], *steps[1], first[1])
    column, row = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    x, y = steps @ (column.ravel(), row.ravel()) + first[:, None]
    centres = np.column_stack([x, y])
    centres = (centres if crs in (CRS, None) else project(centres, str(crs), CRS)) - ORIGIN_M
    heights = (surface(*centres.T) / scale).reshape(rows, columns)
    if edit is not None:
        edit(heights)
    options: dict[str, Any] = {"height": rows, "width": columns, "count": 1, "dtype": dtype, "transform": place}
    with rasterio.open(path, "w", driver="GTiff", crs=crs, nodata=nodata, **options) as dataset:
        dataset.write(heights.astype(dtype), 1)
        if unit:
            dataset.units = (unit,)
    return path


def write_ascii_grid(path: Path, surface: Surface, *, cell: float = 5.0, by_centre: bool = False) -> Path:
    """An Esri ASCII grid over FIELD, rows from north to south."""
    west, south, east, north = FIELD.boundary.buffer(60.0).bounds
    columns, rows = round((east - west) / cell), round((north - south) / cell)
    x = west + cell * (np.arange(columns) + 0.5)
    y = south + cell * (np.arange(rows)[::-1] + 0.5)
    shift, word = (0.5 * cell, "center") if by_centre else (0.0, "corner")
    lines = [
        f"ncols {columns}", f"nrows {rows}", f"xll{word} {west + ORIGIN_M[0] + shift}",
        f"yll{word} {south + ORIGIN_M[1] + shift}", f"cellsize {cell}", "NODATA_value -9999",
    ]  # fmt: skip
    lines += [" ".join(f"{height:.6f}" for height in row) for row in surface(*np.meshgrid(x, y))]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def lay_passes(spacing_m: float = 6.0, step_m: float = 1.7, seed: int = 1) -> Floats:
    """Points of passes from south to north over FIELD, starting at chance."""
    chance = np.random.default_rng(seed)
    west, south, east, north = FIELD.boundary.bounds
    passes = [
        np.column_stack([np.full(len(y), x), y])
        for x in np.arange(west + 0.5 * spacing_m, east, spacing_m)
        for y in [np.arange(south + chance.uniform(0.0, step_m), north, step_m)]
    ]
    return np.concatenate(passes)


def write_points_csv(
    path: Path, points: Floats, heights: Floats, header: Sequence[str] = ("lon", "lat", "elevation_m")
) -> Path:
    """Points in degrees with heights."""
    degrees = project(points + ORIGIN_M, CRS, "EPSG:4326")
    rows = [f"{lon:.9f},{lat:.9f},{height:.4f}" for (lon, lat), height in zip(degrees, heights, strict=True)]
    path.write_text("\n".join([",".join(header), *rows]) + "\n", encoding="utf-8")
    return path
