"""The GNSS error simulator of section 2.3.1: a table of static fixes, and errors drawn from it.

A table (n, 4) of int64 holds one grid cell a row: the cell's distance from the mean of all fixes (east and north,
mm) and the interval (a, b] of the draw sigma that belongs to it (Eq. 2.6, 2.7). The cells are sorted by number of
fixes, then by place, so that the same fixes always give the same table.

Three slips in Algorithm 1 of the thesis are corrected. Its fourth case (sigma = a) steps back one row without having
searched there; as the intervals are (a, b], sigma = a belongs to a row before, and the search continues to the left.
The middle of the search is rounded down. The last row is `n - 1`, so the right end starts at `n`.
"""

from __future__ import annotations

import math
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np

from fields.arrays import Floats, Integers
from fields.text_files import CellTable, parse_table, read_table
from vehicle.errors import VehicleError
from vehicle.jit import compile_function

FILE_KIND = "a CSV file"
GRID_CELLS, MIN_FIXES = 32, 100
CENTRE_CELL = GRID_CELLS // 2
# Chosen, s: how long a patch of soil pushes, a rut or a clod at walking pace, and a receiver drifts to one side.
SOIL_MEMORY_S, DRIFT_MEMORY_S = 0.5, 60.0
NO_ERROR: Integers = np.zeros((0, 4), dtype=np.int64)
_ODD, _MIX_1, _MIX_2 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)


@compile_function
def draw_uniform(key: int, count: int) -> float:
    """A number in [0, 1) that depends on the key and the count alone: splitmix64 (Steele, Lea and Flood, 2014)."""
    z = np.uint64(key) + _ODD * np.uint64(count)
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    z = z ^ (z >> _S31)
    return float(z >> _S11) * 1.1102230246251565e-16


@compile_function
def find_error_row(table: Integers, sigma: int) -> int:
    """Row whose interval (a, b] holds sigma: Algorithm 1, corrected as described above."""
    left, right = -1, len(table)
    while left + 1 < right:
        middle = (left + right) // 2
        if sigma <= table[middle, 2]:
            right = middle
        elif sigma > table[middle, 3]:
            left = middle
        else:
            return middle
    return min(max(left, 0), len(table) - 1)


@compile_function
def draw_error(state, table) -> None:  # type: ignore[no-untyped-def]
    """Draw the next error of one tractor (m, east and north) into its state."""
    sigma = 1 + int(draw_uniform(state.error_key, state.error_count) * table[-1, 3])
    row = find_error_row(table, sigma)
    state.error_count += 1
    state.error_x, state.error_y = table[row, 0] * 0.001, table[row, 1] * 0.001


@compile_function
def draw_errors(key: int, count: int, table: Integers) -> Integers:
    """The first `count` errors of a key, (count, 2) in mm, in the order in which a tractor with this key draws them."""
    errors_mm = np.empty((count, 2), dtype=np.int64)
    for i in range(count):
        row = find_error_row(table, 1 + int(draw_uniform(key, i) * table[-1, 3]))
        errors_mm[i, 0], errors_mm[i, 1] = table[row, 0], table[row, 1]
    return errors_mm


def make_error_keys(seed: int, tractors: int) -> Integers:
    """One key per tractor, so that each draws its own errors."""
    spread = np.random.SeedSequence(seed).generate_state(tractors, dtype=np.uint64)
    return spread.view(np.int64)


def build_error_table(east_mm: Floats, north_mm: Floats) -> Integers:
    """Count fixes (n,) on the 1 mm grid about their mean, which lies in cell (16, 16) of 32.

    Raises VehicleError for fewer than 100 fixes or fixes that do not fit the grid.
    """
    if len(east_mm) < MIN_FIXES:
        raise VehicleError(f"{len(east_mm)} fixes are too few for a GNSS table; give {MIN_FIXES} or more.")
    cells = np.stack([_compute_cells(east_mm), _compute_cells(north_mm)], axis=1)
    if cells.min() < 0 or cells.max() >= GRID_CELLS:
        worst = float(np.abs(cells - CENTRE_CELL).max())
        raise VehicleError(
            f"The fixes reach {worst:.0f} mm from their mean, but the grid only {CENTRE_CELL} mm each way; remove "
            "fixes from before the receiver had a fixed solution."
        )
    places, counts = np.unique(cells, axis=0, return_counts=True)
    order = np.lexsort((places[:, 1], places[:, 0], counts))
    places, counts = places[order], counts[order]
    ends = np.cumsum(counts)
    return np.column_stack([places - CENTRE_CELL, ends - counts, ends]).astype(np.int64)


def _compute_cells(values: Floats) -> Integers:
    """Grid cell of each value; whole millimetres stay apart whatever the fraction of their mean."""
    cells = np.round(values) - math.floor(float(np.mean(values)) + 0.5) + CENTRE_CELL
    return np.clip(cells, -1e9, 1e9).astype(np.int64)


@lru_cache(maxsize=1)
def load_default_error_table() -> Integers:
    """The table that comes with Headland (vehicle/data/gnss_rtk.csv).

    It is made from 8000 synthetic fixes of an RTK receiver: a slow wander of the solution and white noise, together
    3.2 mm east and 4.1 mm north.
    """
    text = (resources.files("vehicle") / "data" / "gnss_rtk.csv").read_text(encoding="utf-8")
    return _build_own_table(parse_table(text, "the table of Headland", VehicleError))


def format_error_table(table: Integers) -> str:
    """A table as CSV."""
    rows = "\n".join(",".join(str(int(value)) for value in row) for row in table)
    return f"east_mm,north_mm,above,up_to\n{rows}\n"


def load_error_table(path: str | Path) -> Integers:
    """Read a table written by format_table; raises VehicleError naming the line."""
    return _build_own_table(read_table(path, FILE_KIND, VehicleError))


def _build_own_table(cells: CellTable) -> Integers:
    where, rows = cells.label, _list_columns(cells, ("east_mm", "north_mm", "above", "up_to"))
    table = np.clip(rows, -1e9, 1e9).astype(np.int64)
    whole = len(table) > 0 and (table == rows).all() and table[0, 2] == 0
    whole = whole and table[:, :2].min() >= -CENTRE_CELL and table[:, :2].max() < GRID_CELLS - CENTRE_CELL
    if not (whole and (table[1:, 2] == table[:-1, 3]).all() and (table[:, 3] > table[:, 2]).all()):
        raise VehicleError(
            f"{where} is no GNSS table: errors must lie on the {GRID_CELLS} mm grid, and intervals must be whole "
            "numbers that start at 0 and follow on from each other; make a table with headland gnss fit."
        )
    return table


def load_static_fixes(path: str | Path) -> tuple[Floats, Floats]:
    """East and north (mm) of a file of static fixes: columns x_m, y_m or longitude, latitude in degrees.

    Raises VehicleError for unreadable files, missing columns, too few rows and values that are not numbers.
    """
    cells = read_table(path, FILE_KIND, VehicleError)
    if cells.find_column(("x_m",)) and cells.find_column(("y_m",)):
        values = 1000.0 * _list_columns(cells, ("x_m", "y_m"))
    elif cells.find_column(("longitude",)) and cells.find_column(("latitude",)):
        degrees = _list_columns(cells, ("longitude", "latitude"))
        if (np.abs(degrees) > (180.0, 90.0)).any():
            raise VehicleError(f"{path} holds longitudes beyond 180 or latitudes beyond 90 degrees; give degrees.")
        values = 1000.0 * project_to_metres(degrees, degrees[0]) if len(degrees) else degrees
    else:
        columns = ", ".join(cells.header) or "none"
        raise VehicleError(
            f"{path} has the columns {columns}; fixes need x_m, y_m (metres) or longitude, latitude (degrees)."
        )
    if len(values) < MIN_FIXES:
        raise VehicleError(f"{path} holds {len(values)} fixes; a GNSS table needs {MIN_FIXES} or more.")
    return values[:, 0], values[:, 1]


def project_to_metres(degrees: Floats, origin_deg: Floats) -> Floats:
    """Metres (n, 2) to the east and the north of a place, from longitudes and latitudes (n, 2).

    By the radii of curvature of the WGS 84 ellipsoid there: true north stays north, and a field is a plane.
    """
    phi = math.radians(float(origin_deg[1]))
    a, e2 = 6378137.0, 6.69437999014e-3
    w = math.sqrt(1.0 - e2 * math.sin(phi) ** 2)
    scale = np.radians([a / w * math.cos(phi), a * (1.0 - e2) / w**3])
    return np.asarray((degrees - origin_deg) * scale)


def _list_columns(cells: CellTable, columns: tuple[str, ...]) -> Floats:
    """The named columns of a table, (n, columns); raises VehicleError for a row that is not finite numbers."""
    where, found = cells.label, {name: cells.find_column((name,)) for name in columns}
    missing = [name for name, own_name in found.items() if own_name is None]
    if missing:
        raise VehicleError(f"{where} lacks the column {missing[0]!r}; it needs {', '.join(columns)}.")
    own_names = [str(own_name) for own_name in found.values()]
    values = np.column_stack([np.asarray(cells.list_numbers(own_name), dtype=np.float64) for own_name in own_names])
    for row in np.flatnonzero(~np.isfinite(values).all(axis=1)).tolist():
        number, shown = cells.rows[row][0], ", ".join(cells.get_cell(row, own_name)[:40] for own_name in own_names)
        raise VehicleError(f"{where}, line {number}: {shown!r} are not numbers; correct or remove the line.")
    return values
