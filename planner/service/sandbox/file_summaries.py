"""Summaries of uploaded files, shown before they are used."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fields.geometry.field import Field

MOST_FIELDS = 500
CoordinateRings = list[list[list[float]]]


def summarize_field(file_path: str, key: str | None = None, **options: Any) -> dict[str, Any]:
    """The fields of a file or sample, and the chosen one with its rings; raises FieldError.

    `options` are `local`, `crs` and `swap_axes` of fields.documents.reader.

    Where no `key` says which of several is meant, `field` is None and `error` says how to choose.
    """
    from fields.documents.reader import list_fields, read_field
    from planner.errors import FieldError, render_refusal

    parcels = list_fields(file_path, **options)
    summary: dict[str, Any] = {"fields": [asdict(one) for one in parcels[:MOST_FIELDS]], "field": None, "error": None}
    try:
        summary["field"] = _describe_field(read_field(file_path if key is None else f"{file_path}#{key}", **options))
    except FieldError as refusal:
        if key is not None or len(parcels) == 1:
            raise
        summary["error"] = render_refusal(refusal)
    return summary


def count_uploaded_fields(file_path: str, **options: Any) -> dict[str, Any]:
    """The number of fields in a file; raises FieldError where there is none or none is readable."""
    from fields.documents.reader import list_fields
    from planner.errors import FieldError

    parcels = list_fields(file_path, **options)
    for otherwise in ({}, {"local": True}, {"swap_axes": True}):
        with suppress(FieldError):
            if not all(one.fault for one in list_fields(file_path, **options | otherwise)):
                return {"fields": len(parcels)}
    if parcels:
        raise FieldError(parcels[0].fault)
    return {"fields": 0}


def _describe_field(field: Field) -> dict[str, Any]:
    from fields.documents.writer import build_field_geojson

    shape = field.original_boundary or field.boundary
    rings = [np.asarray(ring.coords) for ring in (shape.exterior, *shape.interiors)]
    obstacles = [np.asarray(one.shape.exterior.coords) for one in field.obstacles]
    return {
        "name": field.name,
        "area_ha": round(field.area_ha, 4),
        "crs": field.crs,
        "origin_m": list(field.origin_m),
        "rings_m": _round_metres(rings),
        "rings_deg": _convert_lines_to_degrees(field, rings),
        "obstacles_m": _round_metres(obstacles),
        "obstacles_deg": _convert_lines_to_degrees(field, obstacles),
        "obstacles": [
            {"number": one.number, "kind": one.kind, "name": one.name, "assumed": one.is_assumed}
            for one in field.obstacles
        ],
        "fences_m": _round_metres([np.asarray(line.coords) for line in field.fences]),
        "entrance_m": None if field.entrance is None else [round(value, 3) for value in field.entrance],
        "refill_m": None if field.service_point is None else [round(value, 3) for value in field.service_point],
        "lines": [{"name": one.name, "bearing_deg": round(one.bearing_deg, 2)} for one in field.guidance_lines],
        "remarks": list(field.remarks),
        "geojson": json.loads(build_field_geojson(field)),
    }


def _round_metres(lines: list[Any]) -> CoordinateRings:
    return [np.round(line[:, :2], 3).tolist() for line in lines]


def _convert_lines_to_degrees(field: Field, lines: list[Any]) -> CoordinateRings | None:
    """Longitudes and latitudes; None for a field in local metres."""
    if field.crs is None:
        return None
    return [np.round(np.asarray(field.to_wgs84(line[:, :2])), 8).tolist() for line in lines]


def summarize_tractor(file_path: str) -> dict[str, Any]:
    """Every value of a tractor; raises VehicleError."""
    from vehicle.model.tractor import load_tractor

    summary: dict[str, Any] = load_tractor(file_path).model_dump(mode="json")
    return summary


def summarize_farm(file_path: str) -> dict[str, Any]:
    """Machines and values of a farm, each with its source; raises HeadlandError."""
    from planner.farm.inventory import load_farm
    from planner.farm.value_sources import format_farm_json

    farm = load_farm(file_path)
    summary: dict[str, Any] = json.loads(format_farm_json(farm))
    return summary


def summarize_log(file_path: str) -> dict[str, Any]:
    """Size and remarks of a log, or why it cannot be used as it is; raises LogError for a file without a table.

    Columns under other names are no reason to refuse it, as a diagnosis may map them.
    """
    from planner.errors import HeadlandError, render_refusal
    from vehicle.identification.errors import ColumnError
    from vehicle.identification.logs.reader import build_log, list_remarks, resolve_log_path
    from vehicle.identification.logs.table import extract_columns, read_table

    frame = read_table(resolve_log_path(file_path))
    try:
        extract_columns(frame, Path(file_path).stem)
    except ColumnError as refusal:
        if not refusal.mapping:
            raise
    summary: dict[str, Any] = {"rows": len(frame), "columns": [str(name) for name in frame.columns]}
    summary |= {"seconds": None, "remarks": [], "error": None}
    try:
        log = build_log(frame, Path(file_path).stem)
    except HeadlandError as refusal:
        return summary | {"error": render_refusal(refusal)}
    return summary | {"seconds": round(float(log.time_s[-1] - log.time_s[0]), 3), "remarks": list_remarks(log)}


def summarize_table(file_path: str) -> dict[str, Any]:
    """The kind of a table by its columns, rain or GNSS errors; raises HeadlandError for another."""
    from fields.text_files import read_text
    from planner.errors import RequestError
    from planner.risk.rain import parse_rain
    from vehicle.model.gnss import load_error_table

    header = read_text(Path(file_path), "a table", RequestError).removeprefix("\ufeff").partition("\n")[0]
    columns = [each.strip().strip('"').lower() for each in header.split(",")]
    if "east_mm" in columns:
        return {"of": "gnss", "rows": len(load_error_table(file_path))}
    if not {"time", "hours"} & set(columns):
        raise RequestError(
            f"{Path(file_path).stem!r} is neither a table of rain nor one of GNSS errors; give a header with time "
            "(hh:mm) or hours for rain, or make a GNSS table with headland gnss fit."
        )
    rain = parse_rain(file_path, 0)
    return {"of": "rain", "times": len(rain.onsets_s), "share_pct": round(100.0 * sum(rain.probabilities), 3)}


def summarize_elevation(file_path: str) -> dict[str, Any]:
    """The size and coordinate system of heights; raises HeadlandError for a file that holds none.

    Whether they fit a field is said where they are used.
    """
    from fields.terrain.point_files import read_height_points
    from fields.terrain.rasters import is_raster_file, open_raster

    if is_raster_file(file_path):
        raster = open_raster(file_path)
        rows, columns = raster.shape
        return {"of": "raster", "rows": rows, "columns": columns, "crs": raster.crs, "remarks": list(raster.remarks)}
    points = read_height_points(file_path)
    return {"of": "points", "points": len(points.heights_m), "crs": points.crs, "remarks": list(points.remarks)}


SUMMARIES: dict[str, Callable[..., dict[str, Any]]] = {
    "field": summarize_field,
    "tractor": summarize_tractor,
    "farm": summarize_farm,
    "log": summarize_log,
    "table": summarize_table,
    "elevation": summarize_elevation,
}
"""Summaries by kind of file."""
UPLOAD_CHECKS = {**SUMMARIES, "field": count_uploaded_fields}
"""Checks of an upload by kind; whether a field holds degrees or metres may be given later."""
