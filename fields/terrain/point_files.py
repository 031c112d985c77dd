"""Points with heights from files: CSV, GeoJSON, KML, GPX, Shapefiles, GeoPackages, the Elevation.txt of AgOpenGPS.

Heights are third coordinates, or a column or property with a usual name, which may end in a unit: elevation_ft.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import shapely

from fields.arrays import Floats
from fields.formats.features import get_member_object
from fields.formats.gdal import GEOPACKAGE_DRIVER, GPX_DRIVER, KML_DRIVERS, SHAPEFILE_DRIVER, LayerTable, read_tables
from fields.formats.geopackage import GEOPACKAGE_SUFFIX, list_package_contents
from fields.formats.kml import ROOT_TAGS, read_kml_texts
from fields.formats.markup import check_xml_root
from fields.formats.shapefile import find_component_files, find_shapefiles, pack_component_files
from fields.geometry.geodesy import DEGREES_CRS
from fields.nested_text import parse_json
from fields.raw_document import LOCAL_METRES
from fields.terrain.elevation_grid import ElevationError
from fields.terrain.height_units import describe_unit, find_axis_units_m, find_unit_m
from fields.terrain.rasters import RASTER_SUFFIXES
from fields.text_files import (
    count_noun,
    decode_table,
    parse_number,
    quote_path,
    read_bytes,
    read_table,
    read_text,
)

AGOPENGPS_FILE = "elevation.txt"
AGOPENGPS_HEADER = ("latitude", "longitude", "elevation", "quality")
RTK_FIXED = 4
"""Quality of a position with centimetres (NMEA 0183, GGA)."""
POINT_SUFFIXES = (".csv", ".txt", ".geojson", ".json", ".kml", ".kmz", ".gpx", ".shp", ".zip", GEOPACKAGE_SUFFIX)
HEIGHT_NAMES = ("elevation", "elev", "altitude", "alt", "height", "ele", "z", "hoehe", "höhe", "elevtn", "elevatn")
LONGITUDE_NAMES, LATITUDE_NAMES = ("longitude", "lon", "lng", "long"), ("latitude", "lat")
EAST_NAMES, NORTH_NAMES = ("easting", "east", "x"), ("northing", "north", "y")
GPX_POINT_LAYERS = ("waypoints", "route_points", "track_points")
MIN_POINTS = 10
_UNIT = re.compile(r"^(?P<name>.+?)[\s_]*[\[(]?(?P<unit>us-ft|us_ft|ftus|metres|meters|feet|foot|mm|cm|ft|m)?[\])]?$")


@dataclass(frozen=True, eq=False)
class HeightPoints:
    """Points of a file with their heights.

    Attributes:
        path: of the file.
        crs: coordinate system that it names, None without one.
        places: shape (n, 2), x or longitude first, in that system.
        heights_m: shape (n,).
        remarks: sentences on units and on what was skipped.
    """

    path: str
    crs: str | None
    places: Floats
    heights_m: Floats
    remarks: tuple[str, ...] = ()


def read_height_points(path: str) -> HeightPoints:
    """The points of a file, by its ending; raises HeadlandError."""
    place = Path(path)
    if place.is_dir():
        place = next((one for one in sorted(place.iterdir()) if one.name.lower() == AGOPENGPS_FILE), place)
    suffix = place.suffix.lower()
    if suffix in (".geojson", ".json"):
        points = _read_geojson(str(place))
    elif suffix in (".kml", ".kmz", ".gpx", ".shp", ".zip", GEOPACKAGE_SUFFIX) or place.is_dir():
        points = _read_gdal_file(str(place), suffix)
    elif suffix in (".csv", ".txt"):
        points = _read_text_table(str(place))
    else:
        raise ElevationError(
            f"{quote_path(path)} has an ending that says no format of heights; give a raster "
            f"({', '.join(RASTER_SUFFIXES)}) or points ({', '.join(POINT_SUFFIXES)})."
        )
    if len(points.heights_m) < MIN_POINTS:
        raise ElevationError(
            f"{quote_path(path)} has {count_noun(len(points.heights_m), 'point')} with a height; give at least "
            f"{MIN_POINTS}, as third coordinates or in a column such as elevation_m."
        )
    return points


def _split_unit(column: str) -> tuple[str, str]:
    """The name of a column in lower case without its unit, and the unit."""
    match = _UNIT.match(column.strip().lower())
    return (match["name"].rstrip(" _"), match["unit"] or "") if match else (column.strip().lower(), "")


def _find_column(columns: Iterable[str], names: Sequence[str]) -> str | None:
    """The column with the first of these names, with or without a unit."""
    by_name = {_split_unit(column)[0]: column for column in reversed(list(columns))}
    return next((by_name[name] for name in names if name in by_name), None)


def _find_height_unit(column: str, path: str) -> tuple[float, tuple[str, ...]]:
    """Metres of the unit of a column of heights, with a remark unless it says metres."""
    unit_m = find_unit_m(_split_unit(column)[1])
    if unit_m is None:
        return 1.0, (
            f"Column {column!r} of {quote_path(path)} does not say its unit; its heights are taken as metres. If they "
            f"are in feet, name it {column.strip()}_ft.",
        )
    return unit_m, describe_unit(unit_m, quote_path(path))


def _read_text_table(path: str) -> HeightPoints:
    """A table of comma-separated text, or Elevation.txt of AgOpenGPS, which has such a table below its header."""
    text = decode_table(read_bytes(path, "a table of points", ElevationError))
    lines = [line for line in text.splitlines() if line.strip()]
    heads = [tuple(cell.strip().lower() for cell in line.split(",")[:4]) for line in lines[:20]]
    start = heads.index(AGOPENGPS_HEADER) if AGOPENGPS_HEADER in heads else None
    if start is not None:
        return _parse_agopengps(lines[start:], path)
    table = read_table(path, "a table of points", ElevationError)
    header = table.header
    if not header:
        raise ElevationError(f"{quote_path(path)} is empty; give points with their heights.")
    height = _find_column(header, HEIGHT_NAMES)
    names = (_find_column(header, LONGITUDE_NAMES), _find_column(header, LATITUDE_NAMES))
    crs: str | None = DEGREES_CRS
    if None in names:
        names, crs = (_find_column(header, EAST_NAMES), _find_column(header, NORTH_NAMES)), None
    if height is None or names[0] is None or names[1] is None:
        raise ElevationError(
            f"{quote_path(path)} has the columns {', '.join(header)[:80]}; it needs longitude and latitude, or easting "
            "and northing, and elevation_m."
        )
    unit_m, remarks = _find_height_unit(height, path)
    numbers = np.array([table.list_numbers(name) for name in (names[0], names[1], height)])
    return _build_points(path, crs, numbers[:2].T, numbers[2] * unit_m, remarks)


def _parse_agopengps(lines: list[str], path: str) -> HeightPoints:
    """Rows of Elevation.txt: latitude, longitude, elevation (ground, metres), quality; without RTK all of them."""
    width = len(lines[0].split(","))
    rows = [cells for line in lines[1:] if len(cells := line.split(",")) == width]
    table = np.array([[parse_number(row[place]) for place in (1, 0, 2, 3)] for row in rows]).reshape(-1, 4)
    fixed = table[:, 3] == RTK_FIXED
    remarks = []
    if fixed.sum() >= MIN_POINTS and not fixed.all():
        remarks.append(f"{count_noun(int((~fixed).sum()), 'point')} of {quote_path(path)} without an RTK fix left out.")
        table = table[fixed]
    elif not fixed.any():
        remarks.append(f"No point of {quote_path(path)} has an RTK fix; its heights may be off by metres.")
    unread = len(lines) - 1 - len(rows)
    if unread:
        remarks.append(f"{count_noun(unread, 'line')} of {quote_path(path)} cut off or garbled; left out.")
    return _build_points(path, DEGREES_CRS, table[:, :2], table[:, 2], tuple(remarks))


def _read_geojson(path: str) -> HeightPoints:
    text = read_text(path, "a GeoJSON file", ElevationError)
    try:
        root = parse_json(text)
    except ValueError as error:
        raise ElevationError(f"{quote_path(path)} is not JSON ({error}); export it again.") from None
    if not isinstance(root, dict):
        raise ElevationError(f"{quote_path(path)} is JSON, but not GeoJSON; give a FeatureCollection.")
    listed = root.get("features")
    features = listed if isinstance(listed, list) else [root]
    remarks: tuple[str, ...] = ()
    rows: list[tuple[float, float, float]] = []
    for feature in features:
        feature = feature if isinstance(feature, dict) else {}
        properties = get_member_object(feature, "properties")
        column = _find_column([key for key in properties if isinstance(key, str)], HEIGHT_NAMES)
        own, unit_m = properties.get(column) if column else None, 1.0
        if math.isfinite(_convert_json_number(own)) and column:
            unit_m, remarks = _find_height_unit(column, path)
        for position in _iter_positions(feature.get("geometry") if "geometry" in feature else feature):
            is_own = len(position) < 3
            height = own if is_own else position[2]
            if height is not None:
                x, y, z = (_convert_json_number(value) for value in (position[0], position[1], height))
                rows.append((x, y, z * (unit_m if is_own else 1.0)))
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    _check_any_height(table[:, 2], path)
    named = get_member_object(get_member_object(root, "crs"), "properties").get("name")
    is_local = get_member_object(root, "headland").get("frame") == LOCAL_METRES
    crs = None if is_local else named if isinstance(named, str) else DEGREES_CRS
    return _build_points(path, crs, table[:, :2], table[:, 2], remarks)


def _convert_json_number(value: Any) -> float:
    """A number of JSON, NaN for what is none: true and false, texts, whole numbers of hundreds of digits."""
    try:
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:
        return math.nan


def _iter_positions(raw: Any) -> Iterator[list[Any]]:
    """Every position of a geometry, or of those in a collection, that has two values or more."""
    pending = [raw]
    while pending:
        one = pending.pop()
        if isinstance(one, dict):
            pending.extend([one.get("geometries"), one.get("coordinates")])
        elif not isinstance(one, list) or not one:
            continue
        elif isinstance(one[0], list | dict):
            pending.extend(reversed(one))
        elif len(one) >= 2:
            yield one


def _read_gdal_file(path: str, suffix: str) -> HeightPoints:
    """KML, GPX, GeoPackage or a Shapefile."""
    label = quote_path(path)
    if suffix == ".gpx":
        content = read_bytes(path, "a GPX file", ElevationError)
        check_xml_root(content, label, "GPX", ("gpx",))
        tables = read_tables(content, label, "GPX", (GPX_DRIVER,), GPX_POINT_LAYERS)
        return _collect_table_points(tables, path, DEGREES_CRS, is_in_metres=True)
    if suffix in (".kml", ".kmz"):
        tables = []
        for content in read_kml_texts(path, label):
            check_xml_root(content, label, "KML", ROOT_TAGS)
            tables += read_tables(content, label, "KML", KML_DRIVERS)
        return _collect_table_points(tables, path, DEGREES_CRS)
    if suffix == GEOPACKAGE_SUFFIX:
        if not list_package_contents(path, label):
            raise ElevationError(f"{label} is empty; give a GeoPackage with a raster or points of heights.")
        tables = read_tables(Path(path), label, "a GeoPackage", (GEOPACKAGE_DRIVER,))
        tables = [table for table in tables if any(shape is not None for shape in table.shapes)]
        systems = sorted({str(table.crs) for table in tables})
        if len(systems) > 1:
            raise ElevationError(
                f"Layers of {label} are in {len(systems)} coordinate systems; keep the one with heights."
            )
        return _collect_table_points(tables, path, tables[0].crs if tables else None)
    members, names = find_shapefiles(Path(path))
    if not names:
        raise ElevationError(f"{label} holds no Shapefile and no Elevation.txt; give one with heights.")
    if len(names) > 1:
        found = ", ".join(PurePosixPath(name).name for name in names[:4])
        raise ElevationError(f"{label} has {len(names)} Shapefiles ({found}); name the one with heights.")
    parts = find_component_files(members, names[0], label)
    tables = read_tables(pack_component_files(parts), label, "a Shapefile", (SHAPEFILE_DRIVER,))
    return _collect_table_points(tables, path, tables[0].crs if tables else None)


def _collect_table_points(
    tables: list[LayerTable], path: str, crs: str | None, *, is_in_metres: bool = False
) -> HeightPoints:
    """All points of layers: with their own heights, else with that of their feature's column.

    `is_in_metres`: columns are in metres by the rules of the format.
    """
    places, heights, remarks = [np.empty((0, 2))], [np.empty(0)], []
    unit_m = (find_axis_units_m(crs)[1] if crs else None) or 1.0
    for table in tables:
        shapes = shapely.from_wkb(table.shapes, on_invalid="ignore")
        points, owners = shapely.get_coordinates(shapes, include_z=True, return_index=True)
        own = points[:, 2] * unit_m
        column = _find_column(table.columns, HEIGHT_NAMES)
        if column is not None and not (np.isfinite(own) & (own != 0.0)).any():
            column_unit_m, found = (1.0, ()) if is_in_metres else _find_height_unit(column, path)
            remarks += [one for one in found if one not in remarks]
            own = np.array([parse_number(value) for value in table.columns[column]])[owners] * column_unit_m
        places.append(points[:, :2])
        heights.append(own)
    all_heights = np.concatenate(heights)
    _check_any_height(all_heights, path)
    return _build_points(path, crs, np.concatenate(places), all_heights, tuple(remarks))


def _check_any_height(heights_m: Floats, path: str) -> None:
    """Raise ElevationError for third coordinates that were written as 0 because there were none."""
    if len(heights_m) and not (np.isfinite(heights_m) & (heights_m != 0.0)).any():
        raise ElevationError(
            f"All {len(heights_m)} points of {quote_path(path)} are without a height or at 0; export them with "
            "heights, or give another file."
        )


def _build_points(
    path: str, crs: str | None, places: Floats, heights_m: Floats, remarks: tuple[str, ...]
) -> HeightPoints:
    """The points with finite numbers, with a remark on the others."""
    is_usable = np.isfinite(places).all(axis=1) & np.isfinite(heights_m)
    unusable = int((~is_usable).sum())
    if unusable and is_usable.any():
        remarks = (*remarks, f"{count_noun(unusable, 'point')} of {quote_path(path)} without place or height left out.")
    return HeightPoints(path, crs, places[is_usable], heights_m[is_usable], remarks)
