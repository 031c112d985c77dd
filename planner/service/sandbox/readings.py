"""What confined processes read: summaries of uploaded files, day and farm files as forms, and checks of requests.

The modules that read are loaded when they are needed, or beforehand by who starts the process.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from pydantic import BaseModel, ValidationError

from fields.geometry.field import Field
from fields.nested_text import parse_toml
from planner.errors import FieldError, HeadlandError, RequestError, attach_parameter, render_refusal
from planner.request.option_texts import convert_time_to_text

if TYPE_CHECKING:
    from planner.evaluation.work_order import WorkOrder

MOST_FIELDS = 500
CoordinateRings = list[list[list[float]]]
ValuePath = list[str | int]
FormFault = dict[str, Any]
"""`path` of the value, empty for the whole file, and a `sentence`."""
MOST_FAULTS = 50


def summarize_field(file_path: str, key: str | None = None, **options: Any) -> dict[str, Any]:
    """The fields of a file or sample, and the chosen one with its rings; raises FieldError.

    `options` are `local`, `crs` and `swap_axes` of fields.documents.reader.

    Where no `key` says which of several is meant, `field` is None and `error` says how to choose.
    """
    from fields.documents.reader import list_fields, read_field

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

    shape = field.whole_boundary
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

    return load_tractor(file_path).model_dump(mode="json")


def summarize_farm(file_path: str) -> dict[str, Any]:
    """Machines and values of a farm, each with its source; raises HeadlandError."""
    from planner.farm.inventory import load_farm
    from planner.farm.value_sources import format_farm_json

    return dict(json.loads(format_farm_json(load_farm(file_path))))


def summarize_log(file_path: str) -> dict[str, Any]:
    """Size and remarks of a log, or why it cannot be used as it is; raises LogError for a file without a table.

    Columns under other names are no reason to refuse it, as a diagnosis may map them.
    """
    from vehicle.identification.errors import ColumnError
    from vehicle.identification.logs.reader import build_log, list_remarks, resolve_log_path
    from vehicle.identification.logs.table import extract_columns, read_log_table

    frame = read_log_table(resolve_log_path(file_path))
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


def read_day_form(text: str, changes: Sequence[Mapping[str, Any]], farm_path: str | None = None) -> dict[str, Any]:
    """Text, values, faults and choices of a day; `farm_path` is the file of the farm that it names, if there is one.

    Raises RequestError for changes that cannot be made.
    """
    from planner.day.input_file import EXAMPLE, DayFile, parse_day
    from planner.farm.inventory import load_example_farm, load_farm

    form = _read_form(text, changes, DayFile)
    choices: dict[str, list[str]] = {}
    with suppress(HeadlandError):
        is_example = form["values"].get("farm") == EXAMPLE
        farm = load_example_farm() if is_example else load_farm(farm_path) if farm_path else None
        if farm is not None:
            choices["tractor"] = [each.name for each in farm.tractors]
            choices["implement"] = [each.name for each in farm.implements]
    has_farm = form["values"].get("farm") is None or bool(choices)
    if not form["faults"] and has_farm:
        parse = partial(parse_day, form["text"], "day", farm=farm_path)
        form["contradictions"] = _list_contradictions(parse, form["values"])
    return form | {"choices": choices}


def read_farm_form(text: str, changes: Sequence[Mapping[str, Any]], farm_path: str | None = None) -> dict[str, Any]:
    """Text, values, faults and choices of a farm; `farm_path` is where it lies beside its tractors.

    Raises RequestError for changes that cannot be made.
    """
    from planner.farm.inventory import FarmFile, parse_farm

    form = _read_form(text, changes, FarmFile)
    folder = Path(farm_path).parent if farm_path else Path()
    if not form["faults"]:
        parse = partial(parse_farm, form["text"], "farm", folder)
        form["contradictions"] = _list_contradictions(parse, form["values"])
    tractors = form["values"].get("tractors")
    names = [each.get("name") for each in tractors if isinstance(each, dict)] if isinstance(tractors, list) else []
    return form | {"choices": {"tractor": [name for name in names if isinstance(name, str)]}}


FORMS = {"day": read_day_form, "farm": read_farm_form}


def _read_form(text: str, changes: Sequence[Mapping[str, Any]], model: type[BaseModel]) -> dict[str, Any]:
    """Text, values and faults of a file, after changes."""
    try:
        parse_toml(text)
    except ValueError as error:
        sentence = f"This is not TOML: {error}."
        if changes:
            raise RequestError(f"{sentence} Correct the text first.", parameter="text") from None
        return {"text": text, "values": {}, "faults": [{"path": [], "sentence": sentence}], "contradictions": []}
    text = _change_text(text, changes) if changes else text
    values = parse_toml(text)
    faults = list(_list_faults(values, model))
    return {"text": text, "values": _make_plain(values), "faults": faults, "contradictions": []}


def _make_plain(value: Any) -> Any:
    """A value as JSON can hold it: times, dates and numbers without end as texts, as files have them in quotes."""
    value = convert_time_to_text(value)
    if isinstance(value, dict):
        return {key: _make_plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_make_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, str | int | float) else str(value)


def _list_faults(values: Mapping[str, Any], model: type[BaseModel]) -> Iterator[FormFault]:
    """Each wrong or missing value with its place."""
    from vehicle.model.validation_messages import describe_validation_errors

    try:
        model.model_validate(values)
    except ValidationError as error:
        for fault in error.errors()[:MOST_FAULTS]:
            alone = SimpleNamespace(errors=lambda fault=fault: [fault])
            clause = describe_validation_errors(cast(ValidationError, alone), model)
            yield {"path": list(fault["loc"]), "sentence": _format_sentence(clause, fault["loc"])}


def _format_sentence(clause: str, place: Sequence[str | int]) -> str:
    """A clause about a key of a file as a sentence beside its control, where the key need not be named."""
    key = ".".join(str(part) for part in place)
    clause = clause.removeprefix(f"it lacks {key}").removeprefix(key).removeprefix(" = ").removeprefix(": ").strip()
    clause = re.sub(r",? in quotes\b", "", clause)
    if clause.startswith("("):
        clause = f"give {clause.strip('()')}"
    return f"{clause[:1].upper()}{clause[1:]}." if clause else "This is missing."


def _list_contradictions(read: Any, values: Mapping[str, Any]) -> list[FormFault]:
    """What contradicts what, as one fault at the first value that it names."""
    try:
        read()
    except HeadlandError as refusal:
        sentence = render_refusal(refusal).partition(" cannot be used: ")
        words = sentence[2] or sentence[0]
        quoted = [text for pair in re.findall(r"'([^']+)'|\"([^\"]+)\"", words) for text in pair if text]
        places = (place for text in quoted for place in _find_text(values, text))
        return [{"path": next(places, []), "sentence": f"{words[:1].upper()}{words[1:]}"}]
    return []


def _find_text(value: Any, text: str, place: ValuePath | None = None) -> Iterator[ValuePath]:
    """The places of a text among values."""
    place = place or []
    if value == text:
        yield place
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in pairs:
        yield from _find_text(each, text, [*place, key])


def _change_text(text: str, changes: Sequence[Mapping[str, Any]]) -> str:
    """The text with values set, added or removed; comments and order stay."""
    import tomlkit

    try:
        document: Any = tomlkit.parse(text)
        for change in changes:
            _apply_change(document, list(change["path"]), change["value"])
        changed_text = tomlkit.dumps(document)
        parse_toml(changed_text)
        return changed_text
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        raise RequestError(
            "The text has no place for this value; correct it as text, or begin with the example.", parameter="changes"
        ) from None


def _apply_change(document: Any, path: ValuePath, value: Any) -> None:
    """Set the value at a path; None removes it, and a table at the end of a list is added."""
    import tomlkit

    if isinstance(value, dict):
        new_table = tomlkit.table()
        for key, each in value.items():
            new_table[key] = each
        value = new_table
    home, (*sections, last) = document, path
    for place, following in zip(sections, path[1:], strict=True):
        if isinstance(place, str) and place not in home:
            home[place] = tomlkit.aot() if isinstance(following, int) else tomlkit.table()
        home = home[place]
    if value is None:
        if isinstance(last, int) or last in home:
            del home[last]
    elif isinstance(last, int) and last == len(home):
        home.append(value)
    else:
        home[last] = value


def build_work_order(values: Mapping[str, Any]) -> WorkOrder:
    """What to plan, from the options of a plan request and its farm; raises HeadlandError as the command does."""
    from planner.pipeline.farm_inputs import GivenOptions

    given = GivenOptions(values, values)
    return given.build_order(given.build_request())


def check_plan_request(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a plan request that cannot be fulfilled; all its files are read."""
    from fields.geometry.field_lines import find_line_bearing_deg
    from fields.layout.swaths import check_width
    from planner.evaluation.field_physics import find_requested_soil, read_requested_elevation
    from planner.evaluation.work_order import load_gnss_errors, read_requested_field
    from planner.request.service_points import locate_service_point
    from planner.risk.assessment import build_decision_criteria

    order = build_work_order(values)
    request = order.request
    with attach_parameter("rain"):
        build_decision_criteria(request)
    with attach_parameter("gnss_table"):
        load_gnss_errors(request)
    with attach_parameter("field"):
        field = read_requested_field(request, None)
        check_width(field, request.width_m)
        if request.guidance_line is not None:
            find_line_bearing_deg(field.guidance_lines, request.guidance_line, f"'{field.name}'")
    read_requested_elevation(request, field)
    find_requested_soil(request)
    with attach_parameter("tractor"):
        machine = None if request.refill is None else order.resolve_tractor()
    with attach_parameter("refill"):
        locate_service_point(
            request, field, order.supply, is_electric=machine is not None and machine.battery is not None
        )


def check_day_request(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a day that cannot be planned."""
    from planner.day.input_file import load_day

    with attach_parameter("day"):
        load_day(values["day"], farm=values.get("farm"), rain=values.get("rain"), certainty_pct=values.get("certainty"))


def check_diagnosis_request(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for an unknown tractor, ground, conversion or effect.

    The logs are read when the job is done.
    """
    from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect
    from vehicle.identification.logs.reader import parse_conventions
    from vehicle.identification.logs.table import parse_mapping
    from vehicle.model.ground import find_ground_index
    from vehicle.model.tractor import resolve_tractor

    tractor = resolve_tractor(values["tractor"])
    with attach_parameter("ground"):
        find_ground_index(values.get("ground", "soil"))
    with attach_parameter("fixes"):
        parse_conventions(values.get("fix", ()))
    parse_mapping(values.get("mapping", ()))
    with attach_parameter("hide"):
        draw_hidden_effect(1, tractor, values.get("hide"))


SUMMARIES = {
    "field": summarize_field, "tractor": summarize_tractor, "farm": summarize_farm, "log": summarize_log,
    "table": summarize_table, "elevation": summarize_elevation,
}  # fmt: skip
READINGS: dict[str, Callable[..., Any]] = {
    "check plan": check_plan_request,
    "check day": check_day_request,
    "check diagnosis": check_diagnosis_request,
    **{f"upload {kind}": summarize for kind, summarize in SUMMARIES.items()},
    "upload field": count_uploaded_fields,  # whether it holds degrees or metres may be given later
    **{f"summary {kind}": summarize for kind, summarize in SUMMARIES.items()},
    **{f"form {kind}": read for kind, read in FORMS.items()},
}
"""All readings: checks of requests and uploads, summaries and forms, by kind of file or request."""
