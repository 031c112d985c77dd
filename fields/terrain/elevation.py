"""Heights of a field from a file in any of the formats: rasters or points."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import shapely

from fields.arrays import Flags, Floats
from fields.errors import FieldError, attach_parameter, mark_parameter, shorten_value
from fields.geometry.arithmetic import NEAR_FIELD_M
from fields.geometry.field import Field
from fields.geometry.geodesy import DEGREES_CRS, is_same_crs, is_wgs84_longitude_latitude, measure_distance_m, project
from fields.terrain.checks import (
    MIN_SPIKE_M,
    check_coverage,
    check_height_range,
    check_slopes,
    describe_place,
    describe_spikes,
)
from fields.terrain.elevation_grid import ElevationError, ElevationGrid, fill_gaps, lay_nodes
from fields.terrain.point_files import HeightPoints, read_height_points
from fields.terrain.point_grids import MAX_NODE_SPACING_M, MIN_NODE_SPACING_M, build_point_grid
from fields.terrain.rasters import MAX_CELLS, Raster, average_blocks, is_raster_file, open_raster
from fields.terrain.slopes import compute_gradients
from fields.text_files import quote_path

MARGIN_M = 40.0
"""Ground round a field over which machines may turn; heights there are continued if the raster ends. Chosen: a
bulb of 12 m radius reaches 33 m ahead."""
MAX_CELL_M = 100.0
"""Larger cells say nothing of the slopes of a field; free models of the whole world have cells of 30 and 90 m."""
WHOLE_TOLERANCE, MAX_SLOPE_ERROR = 1e-6, 0.005
"""How near to a whole number a height counts as one, and the error of slopes (m/m) from which that is said."""
SPIKE_CHUNK = 2**16
EXTRA_CELLS, FILLED_CELLS = 3, 8
"""Cells (of the grid, if finer) read beyond those needed, for the curve through them; and how far holes are bridged."""
SPIKE_CELLS = 5


def read_elevation(path: str | Path, field: Field, crs: str | None = None) -> ElevationGrid:
    """Heights of a file on a grid in the plane of a field, reaching a little beyond its outline.

    Args:
        path: a raster (GeoTIFF, GeoPackage, ASCII grid), or points (CSV, GeoJSON, KML, GPX, Shapefile, GeoPackage, the
            Elevation.txt of AgOpenGPS or its folder).
        crs: coordinate system of a file that does not name its own, such as "EPSG:25832".

    Remarks of the grid say what was converted, filled in or left out.

    Raises HeadlandError where the file cannot be read, lies elsewhere, does not cover the field, or holds what is no
    ground. The refusal names the parameter `elevation` or `elevation_crs`.
    """
    with attach_parameter("elevation"):
        label, outline = quote_path(path), shapely.Polygon(field.whole_boundary.exterior)
        if is_raster_file(str(path)):
            raster = open_raster(str(path))
            grid = _build_raster_grid(replace(raster, crs=_choose_crs(label, raster.crs, field, crs)), field, outline)
        else:
            points = read_height_points(str(path))
            grid = _grid_field_points(replace(points, crs=_choose_crs(label, points.crs, field, crs)), field, outline)
        inside = grid.frame.find_inside(field.region_without_obstacles)
        remarks = list(grid.remarks)
        if grid.is_measured is not None:
            remarks += check_coverage(grid.is_measured, inside, grid.spacing_m, label, field)
        slopes = np.hypot(*compute_gradients(grid)[inside].T)
        remarks += check_slopes(slopes, grid.frame.list_places()[inside.ravel()], label, field)
        return replace(grid, remarks=tuple(remarks))


def _grid_field_points(points: HeightPoints, field: Field, outline: shapely.Polygon) -> ElevationGrid:
    """The surface through the points in and near a field; raises ElevationError."""
    label = quote_path(points.path)
    places = _convert_to_field(points.places, points.crs, field)
    reach = outline.buffer(NEAR_FIELD_M)
    shapely.prepare(reach)
    is_near = shapely.contains_xy(reach, places[:, 0], places[:, 1])
    if not is_near.any():
        far_m = float(shapely.distance(outline, shapely.points(places)).min())
        raise ElevationError(
            f"The nearest of {len(places)} points of {label} is {far_m / 1e3:.3g} km from field '{field.name}'; give "
            "heights of the field, or check their coordinate system."
        )
    places, heights_m = places[is_near], points.heights_m[is_near]
    grid = build_point_grid(places, heights_m, outline, MARGIN_M, label, partial(describe_place, field))
    return replace(grid, remarks=(*points.remarks, *grid.remarks))


def _choose_crs(label: str, stated: str | None, field: Field, given: str | None) -> str | None:
    """The coordinate system of a file of heights; None if its coordinates are the local metres of the field.

    `stated` is what the file says, `given` what the user says. Raises ElevationError where nobody says it, the two
    contradict each other, or the field has no place on the earth.
    """
    if given is not None:
        with attach_parameter("elevation_crs"):
            is_wgs84_longitude_latitude(given)  # refuses unknown systems
    if field.crs is None:
        if stated or given:
            raise ElevationError(
                f"Field '{field.name}' is in local metres without a place on the earth, but {label} is in "
                f"{shorten_value(stated or given)}; give heights in the metres of the field, or a field in degrees."
            )
        return None
    if given is not None and stated is not None and not is_same_crs(given, stated):
        raise FieldError(
            f"{label} is in {shorten_value(stated)} by its own header; leave out {mark_parameter('elevation_crs')} "
            f"{shorten_value(given)}."
        )
    if stated is None and given is None:
        raise FieldError(
            f"{label} does not name its coordinate system; name it with {mark_parameter('elevation_crs')}, such as "
            "EPSG:25832 or EPSG:4326."
        )
    return stated or given


def _build_raster_grid(raster: Raster, field: Field, outline: shapely.Polygon) -> ElevationGrid:
    """Heights of a raster on a grid over the outline of a field; its system is None only in that of a local field.

    Raises ElevationError where the raster lies elsewhere, has holes in the field, is too large, or too coarse.
    """
    label = quote_path(raster.path)
    cell_m = _measure_cells(raster, field, outline)
    if max(cell_m) > MAX_CELL_M:
        raise ElevationError(
            f"{label} has cells of {max(cell_m):.3g} m; the slopes of a field need cells of {MAX_CELL_M:.0f} m or "
            "less, so give a finer raster."
        )
    frame = lay_nodes(outline, min(max(MIN_NODE_SPACING_M, *cell_m), MAX_NODE_SPACING_M), MARGIN_M)
    at_nodes = raster.find_cells(_convert_to_raster(frame.list_places(), raster, field))
    extra = EXTRA_CELLS * math.ceil(frame.spacing_m / min(cell_m))
    rows, columns = _choose_window(raster, at_nodes, extra, field, outline)
    step = math.ceil(math.sqrt((rows.stop - rows.start) * (columns.stop - columns.start) / MAX_CELLS))
    cells = raster.read_cells(rows, columns, step)
    remarks = list(raster.remarks)
    if max(cell_m) > MAX_NODE_SPACING_M:
        remarks.append(f"{label} has cells of {max(cell_m):.3g} m; slopes shorter than that are not in it.")
    if raster.to_place[1, 1] > 0.0:
        remarks.append(f"Rows of {label} run from south to north; they are read so.")
    check_height_range(cells, label)
    remarks += _describe_whole_heights(cells, raster.unit_m, max(step * max(cell_m), frame.spacing_m), label)
    remarks += _remove_spikes(cells, step * max(cell_m), raster, (rows.start, columns.start, step), field)
    factors = tuple(max(1, math.floor(frame.spacing_m / (step * size) + 1e-6)) for size in reversed(cell_m))
    at_cells = (at_nodes - (columns.start, rows.start) + 0.5) / step - 0.5
    heights, measured = _sample_cells(cells, at_cells, factors)
    heights, measured = heights.reshape(frame.rows, frame.columns), measured.reshape(frame.rows, frame.columns)
    if not measured.any():
        raise ElevationError(
            f"{label} has no height in field '{field.name}'; give heights of the field, or check its no-data value."
        )
    near = measured | frame.find_inside(outline.buffer(MARGIN_M + frame.spacing_m, join_style="mitre"))
    size = f"{cell_m[0]:.3g} m" if math.isclose(*cell_m, rel_tol=0.02) else f"{cell_m[0]:.3g} by {cell_m[1]:.3g} m"
    return ElevationGrid(
        frame.west_m,
        frame.south_m,
        frame.spacing_m,
        fill_gaps(heights, near),
        measured,
        f"{label}, cells of {size}, on a grid of {frame.spacing_m:.3g} m",
        tuple(remarks),
    )


def _describe_whole_heights(cells: Floats, unit_m: float, spacing_m: float, label: str) -> list[str]:
    """A remark on heights in whole units whose steps would be taken for slopes.

    A step of q rounds heights with a standard deviation of q / sqrt(12), and their difference over two spacings gives
    a slope with sqrt(2) of that.
    """
    units = cells[np.isfinite(cells)] / unit_m
    if not len(units) or np.ptp(units) < 0.5 or float(np.abs(units - np.rint(units)).max()) > WHOLE_TOLERANCE:
        return []
    error = unit_m / math.sqrt(12.0) * math.sqrt(2.0) / (2.0 * spacing_m)
    if error < MAX_SLOPE_ERROR:
        return []
    return [f"Heights of {label} are rounded to {unit_m:.3g} m, so slopes are good to {100.0 * error:.2g} % only; give "
            "heights with decimals if there are any."]  # fmt: skip


def _convert_to_raster(places_m: Floats, raster: Raster, field: Field) -> Floats:
    """Places of the field's plane in the system of the raster."""
    points = places_m + np.asarray(field.origin_m)
    return points if raster.crs is None or field.crs is None else project(points, field.crs, raster.crs)


def _convert_to_field(places: Floats, crs: str | None, field: Field) -> Floats:
    """Places in a system in the field's plane."""
    metres = places if crs is None or field.crs is None else project(places, crs, field.crs)
    return np.asarray(metres - np.asarray(field.origin_m))


def _measure_cells(raster: Raster, field: Field, outline: shapely.Polygon) -> tuple[float, float]:
    """Metres from column to column and from row to row at the middle of the field."""
    x, y = outline.centroid.x, outline.centroid.y
    cross = np.array([[x - 5.0, y], [x + 5.0, y], [x, y - 5.0], [x, y + 5.0]])
    cells = raster.find_cells(_convert_to_raster(cross, raster, field))
    cells_per_m = np.array([cells[1] - cells[0], cells[3] - cells[2]]) / 10.0
    column_m, row_m = 1.0 / np.hypot(*cells_per_m)
    return float(column_m), float(row_m)


def _choose_window(
    raster: Raster, at_nodes: Floats, extra: int, field: Field, outline: shapely.Polygon
) -> tuple[slice, slice]:
    """Rows and columns of the cells that the nodes need, and `extra` ones round them."""
    low, high = np.floor(at_nodes.min(axis=0)) - extra, np.ceil(at_nodes.max(axis=0)) + extra + 1
    most = np.array(raster.shape[::-1])
    start, stop = np.clip(low, 0, most).astype(int), np.clip(high, 0, most).astype(int)
    in_field = raster.find_cells(_convert_to_raster(shapely.get_coordinates(outline), raster, field))
    is_apart = (in_field.max(axis=0) < -0.5) | (in_field.min(axis=0) > most - 0.5)
    if is_apart.any() or (stop - start < 1).any():
        raise ElevationError(_explain_other_place(raster, field, outline))
    return slice(int(start[1]), int(stop[1])), slice(int(start[0]), int(stop[0]))


def _explain_other_place(raster: Raster, field: Field, outline: shapely.Polygon) -> str:
    """The refusal of a raster of another place, with where it is."""
    corners = raster.list_corners()
    units, name = ("", "metres") if raster.crs is None else (" degrees", "longitude and latitude")
    if raster.crs is None:
        middle_m = corners.mean(axis=0) - np.asarray(field.origin_m)
        far_m = float(np.hypot(*(middle_m - (outline.centroid.x, outline.centroid.y))))
    else:
        corners = project(corners, raster.crs, DEGREES_CRS)
        here = field.to_wgs84([[outline.centroid.x, outline.centroid.y]])[0]
        far_m = measure_distance_m(corners.mean(axis=0), here)
    (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
    far = f"{far_m / 1e3:.0f} km" if far_m >= 1e4 else f"{far_m:.0f} m"
    return (
        f"{quote_path(raster.path)} covers {west:.6g} to {east:.6g} and {south:.6g} to {north:.6g}{units} ({name}), "
        f"{far} from field '{field.name}'; give heights of the field, or check the coordinate system of the raster."
    )


def _remove_spikes(
    cells: Floats, cell_m: float, raster: Raster, window: tuple[int, int, int], field: Field
) -> list[str]:
    """Set cells that stand out from the median of their neighbours to NaN, in place; remarks on them.

    `window` are the first row and column of the cells in the raster, and how many of its cells each of them is wide.
    """
    from scipy.ndimage import uniform_filter

    known = np.isfinite(cells)
    limit_m = max(MIN_SPIKE_M, cell_m)
    if not known.any():
        return []
    padded = np.pad(
        np.where(known, cells, np.nan), SPIKE_CELLS // 2, mode="reflect" if min(cells.shape) > 2 else "edge"
    )
    level = np.where(known, cells, float(np.nanmedian(cells)))
    suspects = np.argwhere(known & (np.abs(level - uniform_filter(level, SPIKE_CELLS)) > 0.5 * limit_m))
    if not len(suspects):
        return []
    windows = np.lib.stride_tricks.sliding_window_view(padded, (SPIKE_CELLS, SPIKE_CELLS))
    deviations = cells[tuple(suspects.T)]
    for first in range(0, len(suspects), SPIKE_CHUNK):  # as each takes 25 numbers
        chunk = slice(first, first + SPIKE_CHUNK)
        around = windows[tuple(suspects[chunk].T)].reshape(-1, SPIKE_CELLS**2)
        deviations[chunk] -= np.nanmedian(around, axis=1)
    is_spike = np.abs(deviations) > limit_m
    spikes, deviations = suspects[is_spike], deviations[is_spike]
    cells[tuple(spikes.T)] = np.nan

    def name_place(number: int) -> str:
        row, column = (spikes[number] + 0.5) * window[2] + window[:2]
        place = np.array([[column, row, 1.0]]) @ raster.to_place.T
        return describe_place(field, *_convert_to_field(place, raster.crs, field)[0].tolist())

    return describe_spikes(deviations, name_place, int(known.sum()), quote_path(raster.path))


def _sample_cells(cells: Floats, at: Floats, factors: tuple[int, ...]) -> tuple[Floats, Flags]:
    """Heights (n,) at places (column, row) among the cells, NaN beyond, and whether the cell there has a height.

    Cells are averaged over blocks of `factors` rows and columns; a cubic spline leads through them, which follows
    planes and paraboloids up to the edge.
    """
    from scipy.interpolate import RectBivariateSpline
    from scipy.ndimage import distance_transform_edt

    blocks = average_blocks(cells, factors)
    at = (at + 0.5) / np.array(factors[::-1]) - 0.5
    if not blocks.size:
        return np.full(len(at), np.nan), np.zeros(len(at), dtype=np.bool_)
    known = np.isfinite(blocks)
    most = np.array(blocks.shape[::-1]) - 1
    nearest = np.clip(np.floor(at + 0.5), 0, most).astype(int)
    is_within = ((at >= -0.5) & (at <= most + 0.5)).all(axis=1)
    measured = is_within & known[nearest[:, 1], nearest[:, 0]]
    if not known.any():
        return np.full(len(at), np.nan), measured
    blocks = fill_gaps(blocks, distance_transform_edt(~known) <= FILLED_CELLS)
    inside = np.clip(at, 0, most)
    if most.min() < 1:
        heights = np.asarray(blocks[tuple(np.rint(inside[:, ::-1]).astype(int).T)])
    else:
        degrees = np.minimum(3, most)  # lower where there are fewer than four
        spline = RectBivariateSpline(*map(np.arange, blocks.shape), blocks, kx=degrees[1], ky=degrees[0])
        heights = np.asarray(spline.ev(inside[:, 1], inside[:, 0]))
    is_beyond = ((at < -1e-9) | (at > most + 1e-9)).any(axis=1)
    return np.where(is_beyond, np.nan, heights), measured
