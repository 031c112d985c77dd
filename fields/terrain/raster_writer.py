"""A grid of heights as a raster file: GeoTIFF (by rasterio) or ASCII grid with its .prj."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fields.terrain.elevation_grid import ElevationError, ElevationGrid, FloatArray
from fields.terrain.rasters import ASCII_SUFFIXES, GEOTIFF_SUFFIXES
from fields.text_files import quote_path

NO_DATA = -9999.0
HEIGHT_DECIMALS = 3


def list_raster_files(path: Path) -> tuple[Path, ...]:
    """The files that a raster of this name is written to; raises ElevationError for a name of none."""
    suffix = path.suffix.lower()
    if suffix not in (*GEOTIFF_SUFFIXES, *ASCII_SUFFIXES):
        raise ElevationError(
            f"{quote_path(path)} is no name of a raster; end it in .tif (GeoTIFF) or .asc (ASCII grid).",
            parameter="out",
        )
    return (path,) if suffix in GEOTIFF_SUFFIXES else (path, path.with_suffix(".prj"))


def render_raster(grid: ElevationGrid, crs: str, path: Path) -> tuple[bytes, ...]:
    """The contents of `list_raster_files`; heights that were not measured are marked as no data.

    Args:
        crs: coordinate system of the metres of the grid.
        path: its ending chooses the format.

    Raises:
        ElevationError: the ending is neither of a GeoTIFF nor of an ASCII grid, or rasterio is missing.
    """
    files = list_raster_files(path)
    heights = np.where(True if grid.is_measured is None else grid.is_measured, grid.heights_m, NO_DATA)[::-1]
    west_m, south_m = grid.west_m - 0.5 * grid.spacing_m, grid.south_m - 0.5 * grid.spacing_m
    if len(files) == 1:
        return (_render_geotiff(heights, (west_m, south_m), grid.spacing_m, crs, path),)
    return _render_ascii_grid(heights, (west_m, south_m), grid.spacing_m, crs)


def _render_geotiff(
    heights: FloatArray, corner_m: tuple[float, float], spacing_m: float, crs: str, path: Path
) -> bytes:
    try:
        from rasterio import Affine
        from rasterio.io import MemoryFile
    except ImportError:
        raise ElevationError(
            f"{quote_path(path)} needs rasterio to be written; install it with pip install 'headland[geotiff]', or "
            "write an ASCII grid (.asc).",
            parameter="out",
        ) from None
    rows, columns = heights.shape
    place = Affine(spacing_m, 0.0, corner_m[0], 0.0, -spacing_m, corner_m[1] + rows * spacing_m)
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff", height=rows, width=columns, count=1, dtype="float32", crs=crs, transform=place,
            nodata=NO_DATA, compress="deflate",
        ) as dataset:  # fmt: skip
            dataset.write(heights.astype(np.float32), 1)
            dataset.units = ("m",)
        return bytes(memory.read())


def _render_ascii_grid(
    heights: FloatArray, corner_m: tuple[float, float], spacing_m: float, crs: str
) -> tuple[bytes, ...]:
    from pyproj import CRS

    rows, columns = heights.shape
    header = {
        "ncols": columns, "nrows": rows, "xllcorner": corner_m[0], "yllcorner": corner_m[1], "cellsize": spacing_m,
        "NODATA_value": int(NO_DATA),
    }  # fmt: skip
    lines = [f"{key} {value!r}" for key, value in header.items()]
    lines += [" ".join(f"{height:.{HEIGHT_DECIMALS}f}" for height in row) for row in heights.tolist()]
    projection = CRS.from_user_input(crs).to_wkt("WKT1_ESRI")
    return ("\n".join(lines) + "\n").encode("ascii"), f"{projection}\n".encode()
