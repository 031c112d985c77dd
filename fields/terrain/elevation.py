"""Heights of a field from a file in any of the formats: rasters or points."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import shapely

from fields.errors import FieldError, attach_parameter, mark_parameter, shorten_value
from fields.geometry.field import Field
from fields.geometry.geodesy import is_same_crs, is_wgs84_longitude_latitude, project
from fields.geometry.tolerances import NEAR_FIELD_M
from fields.terrain.checks import check_coverage, check_slopes, describe_place
from fields.terrain.elevation_grid import ElevationError, ElevationGrid
from fields.terrain.point_files import HeightPoints, read_height_points
from fields.terrain.point_grids import build_point_grid
from fields.terrain.raster_grids import MARGIN_M, build_raster_grid
from fields.terrain.rasters import is_raster_file, open_raster
from fields.terrain.slopes import compute_gradients
from fields.text_files import quote_path

"""Points so near to a field count for heights at its edge."""


def read_elevation(path: str | Path, field: Field, crs: str | None = None) -> ElevationGrid:
    """Heights of a file on a grid in the plane of a field, reaching a little beyond its outline.

    Args:
        path: a raster (GeoTIFF, GeoPackage, ASCII grid), or points (CSV, GeoJSON, KML, GPX, Shapefile, GeoPackage, the
            Elevation.txt of AgOpenGPS or its folder).
        crs: coordinate system of a file that does not name its own, such as "EPSG:25832".

    Remarks of the grid say what was converted, filled in or left out.

    Raises:
        HeadlandError: the file cannot be read, lies elsewhere, does not cover the field, or holds what is no ground.
            The refusal names the parameter `elevation` or `elevation_crs`.
    """
    with attach_parameter("elevation"):
        outline = shapely.Polygon((field.original_boundary or field.boundary).exterior)
        if is_raster_file(str(path)):
            raster = open_raster(str(path))
            grid = build_raster_grid(raster, field, outline, choose_crs(str(path), raster.crs, field, crs))
        else:
            points = read_height_points(str(path))
            grid = _grid_field_points(points, field, outline, choose_crs(str(path), points.crs, field, crs))
        return _check_ground(grid, quote_path(path), field)


def _grid_field_points(points: HeightPoints, field: Field, outline: shapely.Polygon, crs: str | None) -> ElevationGrid:
    """The surface through the points in and near a field; raises ElevationError."""
    label = quote_path(points.path)
    is_earth = crs is not None and field.crs is not None
    places = project(points.places, str(crs), str(field.crs)) if is_earth else points.places
    places = places - np.asarray(field.origin_m)
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


def _check_ground(grid: ElevationGrid, label: str, field: Field) -> ElevationGrid:
    """The grid with remarks on gaps and banks; raises ElevationError for too many of them outside of obstacles."""
    frame = grid.frame
    inside = frame.find_inside(field.region_without_obstacles)
    remarks = [] if grid.is_measured is None else check_coverage(grid.is_measured, inside, grid.spacing_m, label, field)
    gradients = compute_gradients(grid)[inside]
    places = frame.list_places()[inside.ravel()]
    remarks += check_slopes(np.hypot(gradients[:, 0], gradients[:, 1]), places, label, field)
    return replace(grid, remarks=(*grid.remarks, *remarks))


def choose_crs(path: str, stated: str | None, field: Field, given: str | None) -> str | None:
    """The coordinate system of a file of heights; None if its coordinates are the local metres of the field.

    Args:
        stated: what the file says.
        given: what the user says.

    Raises:
        ElevationError: nobody says it, the two contradict each other, or the field has no place on the earth.
    """
    label = quote_path(path)
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
