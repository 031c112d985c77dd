"""What the readers make of a file, for people to see before they plan with it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fields.field import Field

MOST_FIELDS = 500
Rings = list[list[list[float]]]


def field_summary(place: str, key: str | None = None, **said: Any) -> dict[str, Any]:
    """The fields of a file or sample, and the one that is meant with its rings; raises FieldError.

    `said` is how the file is to be read: `local`, `crs`, `swap` of fields.read.

    Where no `key` says which of several is meant, `field` is None and `error` says how to choose.
    """
    from fields.errors import FieldError
    from fields.read import list_fields, read_field
    from planner.parameters import word_of

    listed = list_fields(place, **said)
    found: dict[str, Any] = {"fields": [asdict(one) for one in listed[:MOST_FIELDS]], "field": None, "error": None}
    try:
        found["field"] = _field(read_field(place if key is None else f"{place}#{key}", **said))
    except FieldError as refusal:
        if key is not None or len(listed) == 1:
            raise
        found["error"] = refusal.spoken(word_of)
    return found


def field_upload(place: str, **said: Any) -> dict[str, Any]:
    """How many fields a file holds; raises FieldError for one that holds none, or none that can be read at all."""
    from fields.errors import FieldError
    from fields.read import list_fields

    listed = list_fields(place, **said)
    if listed and not any(_readable(place, how) for how in (said, said | {"local": True}, said | {"swap": True})):
        raise FieldError(listed[0].fault)
    return {"fields": len(listed)}


def _readable(place: str, how: dict[str, Any]) -> bool:
    """Whether any field of a file can be used where it is read so, as may be said of it later."""
    from fields.errors import FieldError
    from fields.read import list_fields

    try:
        return not all(one.fault for one in list_fields(place, **how))
    except FieldError:
        return False


def _field(field: Field) -> dict[str, Any]:
    shape = field.outline or field.boundary
    rings = [np.asarray(ring.coords) for ring in (shape.exterior, *shape.interiors)]
    obstacles = [np.asarray(one.shape.exterior.coords) for one in field.obstacles]
    return {
        "name": field.name,
        "area_ha": round(field.area_ha, 4),
        "crs": field.crs,
        "origin_m": list(field.origin_m),
        "rings_m": _metres(rings),
        "rings_deg": _degrees(field, rings),
        "obstacles_m": _metres(obstacles),
        "obstacles_deg": _degrees(field, obstacles),
        "fences_m": _metres([np.asarray(line.coords) for line in field.fences]),
        "entrance_m": None if field.entrance is None else [round(value, 3) for value in field.entrance],
        "refill_m": None if field.refill is None else [round(value, 3) for value in field.refill],
        "lines": [{"name": one.name, "bearing_deg": round(one.bearing_deg, 2)} for one in field.lines],
        "remarks": list(field.remarks),
    }


def _metres(lines: list[Any]) -> Rings:
    return [np.round(line[:, :2], 3).tolist() for line in lines]


def _degrees(field: Field, lines: list[Any]) -> Rings | None:
    """Longitudes and latitudes; None for a field in local metres."""
    if field.crs is None:
        return None
    return [np.round(np.asarray(field.to_wgs84(line[:, :2])), 8).tolist() for line in lines]


def tractor_summary(place: str) -> dict[str, Any]:
    """Every value of a tractor; raises VehicleError."""
    from vehicle.tractor import load_tractor

    found: dict[str, Any] = load_tractor(place).model_dump(mode="json")
    return found


def farm_summary(place: str) -> dict[str, Any]:
    """Machines and values of a farm, each with its origin; raises HeadlandError."""
    from planner.farm import load_farm
    from planner.farm.sources import farm_json

    farm = load_farm(place)
    found: dict[str, Any] = json.loads(farm_json(farm))
    return found


def log_summary(place: str) -> dict[str, Any]:
    """What a measured log is, or why it cannot be used as it stands; raises LogError for a file that is no table."""
    from fields.errors import HeadlandError
    from planner.parameters import word_of
    from vehicle.measured.logs.reading import read_log, remarks
    from vehicle.measured.logs.table import columns_of, read_frame

    frame = read_frame(Path(place))
    columns_of(frame, Path(place).stem)
    found: dict[str, Any] = {
        "rows": len(frame), "columns": [str(name) for name in frame.columns], "seconds": None, "remarks": [],
        "error": None,
    }  # fmt: skip
    try:
        log = read_log(place)
    except HeadlandError as refusal:
        return found | {"error": refusal.spoken(word_of)}
    return found | {"seconds": round(float(log.time_s[-1] - log.time_s[0]), 3), "remarks": remarks(log)}


def table_summary(place: str) -> dict[str, Any]:
    """What a table is of, by its columns: rain, or errors of GNSS; raises HeadlandError for one of neither."""
    from fields.reading import read_text
    from planner.chance.rain import parse_rain
    from planner.errors import ScenarioError
    from vehicle.gnss import load_table

    words = read_text(Path(place), "a table", ScenarioError).removeprefix("\ufeff").partition("\n")[0]
    columns = [each.strip().strip('"').lower() for each in words.split(",")]
    if "east_mm" in columns:
        return {"of": "gnss", "rows": len(load_table(place))}
    if not {"time", "hours"} & set(columns):
        raise ScenarioError(
            f"{Path(place).stem!r} is neither a table of rain nor one of GNSS errors; give a header with time (hh:mm) "
            "or hours for rain, or make the other with headland gnss fit."
        )
    rain = parse_rain(place, 0)
    return {"of": "rain", "times": len(rain.onset_s), "share_pct": round(100.0 * sum(rain.shares), 3)}


SUMMARIES: dict[str, Callable[..., dict[str, Any]]] = {
    "field": field_summary,
    "tractor": tractor_summary,
    "farm": farm_summary,
    "log": log_summary,
    "table": table_summary,
}
"""How a file of each kind is summed up."""
UPLOADS = {**SUMMARIES, "field": field_upload}
"""What a file must stand before it is kept; whether a field holds degrees or metres is said later."""
