"""Rasters of heights: GeoTIFF and GeoPackage (by rasterio) and ASCII grids (Esri), read in metres, and written.

A raster says where its cells lie by an affine rule from (column, row) to its coordinates, so rows from south to north
and turned rasters are read as they are.
"""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fields.arrays import Floats
from fields.formats.geopackage import GEOPACKAGE_SUFFIX, list_package_contents
from fields.geometry.arithmetic import PARALLEL_RAD
from fields.terrain.elevation_grid import ElevationError, ElevationGrid
from fields.terrain.height_units import describe_unit, find_axis_units_m, find_unit_m
from fields.text_files import quote_path, read_bytes, read_text

GEOTIFF_SUFFIXES, ASCII_SUFFIXES = (".tif", ".tiff"), (".asc", ".agr")
RASTER_SUFFIXES = (*GEOTIFF_SUFFIXES, *ASCII_SUFFIXES)
"""Endings of rasters; a GeoPackage holds rasters or features."""
PACKAGE_RASTERS = ("2d-gridded-coverage", "tiles")
"""Kinds of rasters in a GeoPackage (OGC 17-066r1, and pictures, which are refused as such)."""
RASTER_FORMATS = {GEOPACKAGE_SUFFIX: ("GPKG", "GeoPackage")}
GEOTIFF_FORMAT = ("GTiff", "GeoTIFF")
"""Driver of GDAL and name of the format of rasters that rasterio reads."""
MAX_CELLS, MAX_READ_CELLS, MAX_ASCII_CELLS = 2**22, 2**30, 2**24
"""Cells held in memory for one field (4 million, 100 ha in cells of 0.5 m; finer ones are averaged as they are read),
those read for it (1 billion, 100 ha in cells of 3 cm, in a minute or two), and those of a grid in text.
"""
NO_DATA = -9999.0
USUAL_NO_DATA = (NO_DATA, -32768.0, -32767.0, -99999.0)
"""Marks of no data that files use without declaring them."""
MAX_HEIGHT_M = 1e30
"""Beyond this a number is no height but a mark for no data, such as -3.4e38."""
ASCII_KEYS = (
    "ncols", "nrows", "xllcorner", "xllcenter", "yllcorner", "yllcenter", "cellsize", "dx", "dy", "nodata_value",
)  # fmt: skip
HEIGHT_DECIMALS = 3


@dataclass(frozen=True, eq=False)
class Raster:
    """A raster whose cells can be read.

    Attributes:
        path: of its file.
        crs: coordinate system that the file names, None without one.
        to_place: shape (2, 3); coordinates = to_place @ (column, row, 1), whole numbers at the corners of cells.
        shape: rows and columns in the order of the file.
        unit_m: metres of one unit of its heights.
        remarks: sentences on units and order.
        cells: all heights in file units if they are already in memory, NaN without data.
    """

    path: str
    crs: str | None
    to_place: Floats
    shape: tuple[int, int]
    unit_m: float = 1.0
    remarks: tuple[str, ...] = ()
    cells: Floats | None = None

    def read_cells(self, rows: slice, columns: slice, step: int = 1) -> Floats:
        """Heights in metres of a window, means of `step` by `step` cells, NaN where there are none.

        Raises ElevationError where the file cannot be read, or has too many cells there.
        """
        count = (rows.stop - rows.start) * (columns.stop - columns.start)
        if count > MAX_READ_CELLS:
            raise ElevationError(
                f"{quote_path(self.path)} has {count / 1e6:.0f} million cells over the field; at most "
                f"{MAX_READ_CELLS / 1e6:.0f} million are read, so make them larger, for instance with gdalwarp "
                "-tr 0.5 0.5 -r average (0.5 m)."
            )
        strip = step * max(1, MAX_CELLS // (step * (columns.stop - columns.start)))
        parts = []
        for first in range(rows.start, rows.stop, strip):
            part = slice(first, min(first + strip, rows.stop))
            cells = self.cells[part, columns] if self.cells is not None else _read_window(self.path, part, columns)
            is_mark = np.isin(cells, USUAL_NO_DATA) | (np.abs(cells) > MAX_HEIGHT_M)
            parts.append(average_blocks(np.where(is_mark, np.nan, cells) * self.unit_m, (step, step)))
        return np.concatenate(parts)

    def find_cells(self, places: Floats) -> Floats:
        """Column and row (n, 2) of places in the coordinates of the raster; centres of cells are whole numbers."""
        matrix = self.to_place[:, :2]
        return np.asarray(np.linalg.solve(matrix, (places - self.to_place[:, 2]).T).T - 0.5)

    def list_corners(self) -> Floats:
        """The four corners, shape (4, 2), in the coordinates of the raster."""
        rows, columns = self.shape
        corners = np.array([[0.0, 0.0, 1.0], [columns, 0.0, 1.0], [columns, rows, 1.0], [0.0, rows, 1.0]])
        return np.asarray(corners @ self.to_place.T)


def average_blocks(cells: Floats, factors: tuple[int, ...]) -> Floats:
    """Means of whole blocks of rows and columns, without cells that have no height; NaN where fewer than half have one.

    Rows and columns that make no whole block are left out, as their mean would lie beside the middle of a block.
    """
    by_rows, by_columns = factors
    if by_rows == by_columns == 1:
        return cells
    rows, columns = cells.shape[0] // by_rows, cells.shape[1] // by_columns
    blocks = cells[: rows * by_rows, : columns * by_columns].reshape(rows, by_rows, columns, by_columns)
    known = np.isfinite(blocks)
    counts = known.sum(axis=(1, 3))
    sums = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(2 * counts >= by_rows * by_columns, sums / np.maximum(counts, 1), np.nan)


def is_raster_file(path: str) -> bool:
    """Whether a file holds a raster of heights, by its ending, or by the contents of a GeoPackage.

    Raises HeadlandError where a GeoPackage cannot be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix != GEOPACKAGE_SUFFIX:
        return suffix in RASTER_SUFFIXES
    return any(kind in PACKAGE_RASTERS for kind in list_package_contents(path, quote_path(path)).values())


def open_raster(path: str) -> Raster:
    """The raster in a file, by its ending; raises ElevationError."""
    raster = _parse_ascii_grid(path) if Path(path).suffix.lower() in ASCII_SUFFIXES else _open_gdal_raster(path)
    _check_place(raster)
    return raster


def _check_place(raster: Raster) -> None:
    """Raise ElevationError if the cells of a raster have no size or no place."""
    (a, b, x), (d, e, y) = raster.to_place.tolist()
    across, along, area = math.hypot(a, d), math.hypot(b, e), abs(a * e - b * d)
    if not math.isfinite(across + along + area + x + y) or not area > PARALLEL_RAD * across * along:
        raise ElevationError(
            f"{quote_path(raster.path)} has cells of {across:.3g} by {along:.3g} (area {area:.3g}) that begin at "
            f"({x:.6g}, {y:.6g}); cells need a place and a size, so export it again with its georeference."
        )


def _open_gdal_raster(path: str) -> Raster:
    """A GeoTIFF or the raster of a GeoPackage."""
    with _open_dataset(path) as dataset:
        _check_dataset(dataset, path)
        crs = None
        if dataset.crs is not None:
            code = dataset.crs.to_epsg()
            crs = dataset.crs.to_wkt() if code is None else f"EPSG:{code}"
        stated = (dataset.units[0] or "") if dataset.units else ""
        remarks = []
        if dataset.count > 1:
            remarks.append(f"Of the {dataset.count} bands of {quote_path(path)} the first is taken as heights.")
        unit_m, unit_remarks = _choose_unit(stated, None if dataset.crs is None else dataset.crs.to_wkt(), path)
        place = dataset.transform
        return Raster(
            path,
            crs,
            np.array([[place.a, place.b, place.c], [place.d, place.e, place.f]]),
            (dataset.height, dataset.width),
            unit_m,
            (*remarks, *unit_remarks),
        )


def _check_dataset(dataset: Any, path: str) -> None:
    """Raise ElevationError for a raster that holds no heights, several of them, or nothing that says where they are."""
    label = quote_path(path)
    if len(dataset.subdatasets) > 1:
        names = ", ".join(one.rsplit(":", 1)[-1] for one in dataset.subdatasets[:4])
        raise ElevationError(f"{label} has {len(dataset.subdatasets)} rasters ({names}); keep the one with heights.")
    if not dataset.count:
        raise ElevationError(f"{label} holds no raster of heights; export it again.")
    if dataset.count >= 3 and dataset.dtypes[0] == "uint8":
        raise ElevationError(f"{label} is a picture of {dataset.count} colours; give a raster of heights (DTM, DEM).")
    if dataset.dtypes[0].startswith("complex"):
        raise ElevationError(f"{label} holds complex numbers; give a raster of heights (DTM, DEM).")
    if dataset.transform.is_identity:
        raise ElevationError(
            f"{label} does not say where its cells are (no georeference); export it with one, for instance with "
            "gdal_translate -a_srs EPSG:25832 -a_ullr WEST NORTH EAST SOUTH."
        )


def _choose_unit(stated: str, wkt: str | None, path: str) -> tuple[float, tuple[str, ...]]:
    """Metres of a unit of height by the band, else by the vertical axis; remarks where it is not plain metres."""
    unit_m = find_unit_m(stated)
    if stated and unit_m is None:
        raise ElevationError(f"Heights of {quote_path(path)} are in {stated[:20]!r}; convert them to metres.")
    horizontal_m, vertical_m = (None, None) if wkt is None else find_axis_units_m(wkt)
    unit_m = vertical_m if unit_m is None else unit_m
    if unit_m is None and horizontal_m not in (None, 1.0):
        remark = (
            f"{quote_path(path)} does not say the unit of its heights; they are taken as metres, though its places are "
            "in feet. If its heights are too, convert them to metres, for instance with gdal_calc.py --calc A*0.3048."
        )
        return 1.0, (remark,)
    unit_m = unit_m or 1.0
    return unit_m, describe_unit(unit_m, quote_path(path))


def _read_window(path: str, rows: slice, columns: slice) -> Floats:
    """Heights in file units, NaN without data, with the scale and offset of the band applied."""
    with _open_dataset(path) as dataset:
        window = ((rows.start, rows.stop), (columns.start, columns.stop))
        masked = dataset.read(1, window=window, masked=True)
        cells = np.ma.filled(masked.astype(np.float64), np.nan)
        return np.asarray(cells * dataset.scales[0] + dataset.offsets[0])


@contextlib.contextmanager
def _open_dataset(path: str) -> Iterator[Any]:
    try:
        import rasterio
        import rasterio.errors
    except ImportError:
        raise ElevationError(
            f"{quote_path(path)} needs rasterio to be read; install it with pip install 'headland[geotiff]', or give "
            "an ASCII grid (.asc)."
        ) from None
    if not Path(path).is_file():
        raise ElevationError(f"There is no file of heights {quote_path(path)}; check its name and its folder.")
    driver, name = RASTER_FORMATS.get(Path(path).suffix.lower(), GEOTIFF_FORMAT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path, driver=driver) as dataset:
                yield dataset
    except (rasterio.errors.RasterioError, rasterio.errors.CRSError) as error:
        raise ElevationError(
            f"{quote_path(path)} cannot be read as a {name} ({_explain_gdal_error(error, path)}); export it again."
        ) from None


def _explain_gdal_error(error: Exception, path: str) -> str:
    """What is wrong with a file: rasterio says the cause of a failed reading in another exception."""
    if "not recognized as being in a supported file format" in str(error):
        return "it is in another format"
    cause = error.__cause__ or error
    lines = str(cause).splitlines() or [type(cause).__name__]
    return f"damaged or cut off: {lines[0].replace(path, 'it')[:120]}"


def _parse_ascii_grid(path: str) -> Raster:
    """An Esri ASCII grid: up to seven lines of names and numbers, then rows of heights from north to south."""
    text = read_text(path, "an ASCII grid", ElevationError)
    header: dict[str, float] = {}
    place = 0
    for match in re.finditer(r"[ \t]*([A-Za-z_]+)[ \t]+(\S+)[ \t]*(?:\r?\n|\r|$)", text):
        if match.start() != place or match[1].lower() not in ASCII_KEYS:
            break
        try:
            header[match[1].lower()] = float(match[2].replace(",", "."))
        except ValueError:
            raise ElevationError(f"{quote_path(path)} has {match[1]} {match[2][:20]!r}; write a number.") from None
        place = match.end()
    rows, columns, (width, depth), west, south = _check_ascii_header(header, path)
    cells = _parse_heights(text[place:].strip(), path)
    if len(cells) != rows * columns:
        raise ElevationError(
            f"{quote_path(path)} has {len(cells)} heights, but {rows} rows and {columns} columns by its first lines; "
            "it is cut off or garbled, so export it again."
        )
    cells[cells == header.get("nodata_value", NO_DATA)] = np.nan
    to_place = np.array([[width, 0.0, west], [0.0, -depth, south + rows * depth]])
    crs = _read_projection(path)
    unit_m, remarks = _choose_unit("", crs, path)
    return Raster(path, crs, to_place, (rows, columns), unit_m, remarks, cells.reshape(rows, columns))


def _parse_heights(text: str, path: str) -> Floats:
    """Numbers between spaces and line ends, without a Python object for each.

    Commas beside points stand between numbers, and without points they are decimal marks; whether that is right, the
    count of numbers says.
    """
    if not text:
        return np.empty(0)
    if "," in text:
        text = text.replace(",", " " if "." in text else ".")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # older NumPy warns of what is no number
            return np.fromstring(text, dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        raise ElevationError(f"{quote_path(path)} has heights that are not numbers; export the grid again.") from None


def _check_ascii_header(header: dict[str, float], path: str) -> tuple[int, int, tuple[float, float], float, float]:
    """Rows, columns, width and depth of a cell, and the outer south-west corner."""
    rows, columns, cell = (header.get(key, 0.0) for key in ("nrows", "ncols", "cellsize"))
    width, depth = header.get("dx", cell), header.get("dy", cell)  # of GDAL, for cells that are not square
    has_corner = ({"xllcorner", "xllcenter"} & header.keys()) and ({"yllcorner", "yllcenter"} & header.keys())
    is_sized = rows >= 1.0 and columns >= 1.0 and width > 0.0 and depth > 0.0
    if not has_corner or not (is_sized and rows * columns <= MAX_ASCII_CELLS):
        raise ElevationError(
            f"{quote_path(path)} does not begin like an ASCII grid (ncols, nrows, xllcorner, yllcorner, cellsize) of "
            f"at most {MAX_ASCII_CELLS / 1e6:.0f} million cells; export it again."
        )
    west = header["xllcorner"] if "xllcorner" in header else header["xllcenter"] - 0.5 * width
    south = header["yllcorner"] if "yllcorner" in header else header["yllcenter"] - 0.5 * depth
    return int(rows), int(columns), (width, depth), west, south


def _read_projection(path: str) -> str | None:
    """The coordinate system in the .prj (or .PRJ) file beside a grid, None without one."""
    exact = Path(path).with_suffix(".prj")
    try:
        beside = [one for one in exact.parent.iterdir() if one.name.lower() == exact.name.lower() and one.is_file()]
    except OSError:  # a folder that may not be listed
        beside = [exact] if exact.is_file() else []
    if not beside:
        return None
    chosen = exact if exact in beside else min(beside)
    return read_bytes(chosen, "a .prj file", ElevationError).decode("utf-8", "replace").strip() or None


def list_raster_files(path: Path) -> tuple[Path, ...]:
    """The files that a raster of this name is written to; raises ElevationError for a name of none."""
    suffix = path.suffix.lower()
    if suffix not in RASTER_SUFFIXES:
        raise ElevationError(
            f"{quote_path(path)} is no name of a raster; end it in .tif (GeoTIFF) or .asc (ASCII grid).",
            parameter="out",
        )
    return (path,) if suffix in GEOTIFF_SUFFIXES else (path, path.with_suffix(".prj"))


def render_raster(grid: ElevationGrid, crs: str, path: Path) -> tuple[bytes, ...]:
    """The contents of `list_raster_files`; heights that were not measured are marked as no data.

    `crs` is the coordinate system of the metres of the grid; the ending of `path` chooses the format. Raises
    ElevationError where the ending is neither of a GeoTIFF nor of an ASCII grid, or rasterio is missing.
    """
    files = list_raster_files(path)
    heights = np.where(True if grid.is_measured is None else grid.is_measured, grid.heights_m, NO_DATA)[::-1]
    west_m, south_m = grid.west_m - 0.5 * grid.spacing_m, grid.south_m - 0.5 * grid.spacing_m
    if len(files) == 1:
        return (_render_geotiff(heights, (west_m, south_m), grid.spacing_m, crs, path),)
    return _render_ascii_grid(heights, (west_m, south_m), grid.spacing_m, crs)


def _render_geotiff(heights: Floats, corner_m: tuple[float, float], spacing_m: float, crs: str, path: Path) -> bytes:
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


def _render_ascii_grid(heights: Floats, corner_m: tuple[float, float], spacing_m: float, crs: str) -> tuple[bytes, ...]:
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
