"""Plans for many fields, and for ways to work them: orders, their answers from any executor, and the answer file that
lets a run resume.

Each answer is one line of JSON, written as soon as it is known; an order without an answer does not stop the others.
"""

from __future__ import annotations

import glob
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import asdict, fields, replace
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from fields.documents.reader import describe_listing, list_fields
from fields.documents.sources import list_field_files, parse_field_reference
from fields.formats.features import ALL_FIELDS
from fields.geometry.chosen_places import add_obstacles, leave_out_obstacles
from fields.geometry.field import Field
from fields.text_files import read_text
from planner.errors import FieldError, HeadlandError, RequestError, mark_parameter
from planner.evaluation.field_physics import get_elevation_name, split_soil_name
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.evaluation.ground.wheel_traffic import find_driven_over_ground
from planner.evaluation.work_order import WorkOrder, read_requested_field
from planner.pipeline.executors import SerialExecutor, collect_answers, iter_completed
from planner.pipeline.fingerprint import hash_content, hash_file, hash_height_files, hash_strategies
from planner.pipeline.outputs.pictures import list_simplified_rings
from planner.pipeline.planning import PlanningResult, plan_order
from planner.pipeline.worker_tasks import Progress
from planner.request.option_checks import FULL_CIRCLE_DEG
from planner.request.parameter_names import WISHES
from planner.request.plan_request import CONTOUR, HEADLAND_ORDERS_BY_OPERATION, STRAIGHT, PlanRequest
from reports.common.rendering import make_json_safe, pick_values
from reports.plan.comparison import ComparedWay, Comparison, ComparisonRow
from reports.plan.map_data import SmallMap, build_small_map
from strategies.path_planning.turn_kinds import CORNERS

KEY_FIELD, CHECKSUM_FIELD = "key", "sum"
LINE_START = f'{{"{KEY_FIELD}": "'  # how every line begins
Record = dict[str, Any]
MAX_FIELDS = 100_000
USUAL_BEARINGS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
MAX_BEARINGS = 36


def answer_order(
    order: WorkOrder, describe_refusal: Callable[[HeadlandError], str] = str, with_map: bool = False
) -> ComparisonRow:
    """Plan one order in the current process; a refusal is as `describe_refusal` words it.

    With `with_map` the answer has a small map of the best plan.
    """
    name = order.request.field_name
    way = ComparedWay(**pick_values(order.request, [each.name for each in fields(ComparedWay)]))
    try:
        result = plan_order(order, executor=SerialExecutor())
    except HeadlandError as refusal:
        return ComparisonRow(name, way, refusal=describe_refusal(refusal))
    return ComparisonRow(name, way, result.ranking, map=draw_best_plan(result) if with_map else None)


def draw_best_plan(result: PlanningResult) -> SmallMap | None:
    """The small map of the best plan, with the finished ground under its wheels; None where no plan works."""
    best, run = result.ranking.best, result.run
    if best is None or run is None:
        return None
    ground = find_driven_over_ground(run, result.context, compute_swept_area(run, result.context))
    return build_small_map(result.pictures[best.strategy, best.tractors], list_simplified_rings(ground))


def iter_answers(
    executor: Executor,
    orders: Sequence[WorkOrder],
    report_work: Callable[[list[str]], None] = lambda names: None,
    describe_refusal: Callable[[HeadlandError], str] = str,
    *,
    with_maps: bool = False,
) -> Iterator[tuple[int, ComparisonRow]]:
    """Yield (index, answer) as orders are planned; raises WorkerError if processes keep ending.

    `report_work` is called with the names of the fields at work.

    Each order is one task: on a cluster one worker plans a field, and another takes over if that worker ends.
    """
    return iter_completed(
        executor,
        answer_order,
        [(order, describe_refusal, with_maps) for order in orders],
        lambda indices: report_work([orders[index].request.field_name for index in indices]),
    )


def hash_order(order: WorkOrder) -> str:
    """SHA-256 of everything the answer depends on: values, files and code."""
    request = order.request
    soil_table = None if request.soil is None else split_soil_name(request.soil)[1]
    names = (request.tractor, order.tractor, request.rain, request.rain_mm, request.gnss_table, soil_table)
    files = [Path(name) for name in names if isinstance(name, str | Path) and os.path.isfile(name)]
    hashes = [hash_file(path) for path in (*list_field_files(request.field), *files)]
    hashes += hash_strategies(request.strategies)
    elevation = request.elevation
    if elevation is None:
        with suppress(HeadlandError):  # the answer will be this refusal
            elevation = get_elevation_name(request, read_requested_field(request, None))
    return hash_content(order, hashes, hash_height_files(elevation))


class AnswerFileError(RequestError):
    """The answer file is not one, or was changed."""


def save_record(key: str, record: ComparisonRow) -> Record:
    """A record as plain values for the answer file, with the key of its order and a checksum.

    By the checksum `read_answer_file` detects changes.
    """
    saved: Record = {KEY_FIELD: key, **make_json_safe(asdict(record))}
    return {**saved, CHECKSUM_FIELD: _compute_checksum(saved)}


def restore_record(saved: Mapping[str, Any]) -> ComparisonRow:
    """The record of a line of the answer file that this Headland wrote."""
    return TypeAdapter(ComparisonRow).validate_python(saved)


def has_checksum(record: Mapping[str, Any]) -> bool:
    """Whether a record has a checksum; records of an older Headland have none and are not used."""
    return CHECKSUM_FIELD in record


def read_answer_file(path: Path) -> dict[str, Record]:
    """Records of an answer file by key; empty if there is no file yet.

    A truncated last line is skipped. Raises AnswerFileError for another kind of file or a changed record.
    """
    if not path.exists() or not path.stat().st_size:
        return {}
    text = read_text(path, f"a file of answers ({mark_parameter('checkpoint')})", AnswerFileError)
    *lines, last_line = text.split("\n")
    if not (last_line.startswith(LINE_START) or LINE_START.startswith(last_line)):
        raise _build_garbled_error(path, len(lines) + 1)
    records = [_read_record(path, number, line) for number, line in enumerate(lines, start=1)]
    return {record[KEY_FIELD]: record for record in records}


def _read_record(path: Path, number: int, line: str) -> Record:
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        record = None
    if not isinstance(record, dict) or not isinstance(record.get(KEY_FIELD), str):
        raise _build_garbled_error(path, number)
    if has_checksum(record) and record[CHECKSUM_FIELD] != _compute_checksum(record):
        raise AnswerFileError(
            f"Line {number} of {path} ({mark_parameter('checkpoint')}) was changed after it was saved; delete that "
            "line or name another file."
        )
    return record


def _build_garbled_error(path: Path, number: int) -> AnswerFileError:
    return AnswerFileError(
        f"Line {number} of {path} ({mark_parameter('checkpoint')}) is not an answer of Headland; name another file."
    )


def _compute_checksum(record: Mapping[str, Any]) -> str:
    """SHA-256 of the record without its checksum."""
    content = {name: value for name, value in record.items() if name != CHECKSUM_FIELD}
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def replace_records(path: Path | None, records: Iterable[Record]) -> None:
    """Replace an answer file by these records; does nothing without a path."""
    if path is not None:
        draft = path.with_name(path.name + ".part")
        draft.write_text("".join(map(_format_line, records)), encoding="utf-8", newline="\n")
        draft.replace(path)


def append_record(path: Path | None, record: Mapping[str, Any]) -> None:
    """Append a record to an answer file, flushed to disk before the next; does nothing without a path."""
    if path is not None:
        with path.open("a", encoding="utf-8", newline="\n") as file:
            file.write(_format_line(record))
            file.flush()
            os.fsync(file.fileno())


def _format_line(record: Mapping[str, Any]) -> str:
    return json.dumps(record, ensure_ascii=False) + "\n"


def expand_field_names(
    names: Iterable[str],
    *,
    local: bool = False,
    crs: str | None = None,
    swap_axes: bool = False,
    show_remarks: Callable[[Iterable[str]], None] = lambda remarks: None,
) -> tuple[str, ...]:
    """The fields that names stand for, each once, in the order given.

    ``file.geojson#*`` stands for every field of a file, ``*.geojson`` for every such file, sorted by name, if the
    shell has not expanded it. Polygons within a field, such as ponds, are no fields; `show_remarks` is called with a
    sentence on them. Raises FieldError for a file that is missing, or listed and cannot be read, RequestError for a
    pattern that matches no file.
    """
    field_names: dict[str, None] = {}
    for file in (file for name in names for file in _iter_files(name)):
        source = parse_field_reference(file)
        if source.key != ALL_FIELDS:
            field_names[file] = None
            continue
        listed = list_fields(source.place, local=local, crs=crs, swap_axes=swap_axes)
        show_remarks(describe_listing(listed))
        field_names |= {f"{source.place}#{parcel.key}": None for parcel in listed if parcel.inside is None}
    if len(field_names) > MAX_FIELDS:
        raise RequestError(
            f"{mark_parameter('field')} matches {len(field_names)} fields; plan at most {MAX_FIELDS} at once."
        )
    return tuple(field_names)


def _iter_files(name: str) -> Iterator[str]:
    source = parse_field_reference(name)
    place, key = source.place, "" if source.key is None else f"#{source.key}"
    if os.path.exists(place) or not glob.has_magic(place):
        source.check_exists()
        yield name
        return
    files = sorted(glob.glob(place))
    if not files:
        raise RequestError(f"No file matches {place!r}; check the folder and the extension.", parameter="field")
    yield from (file + key for file in files)


def share_obstacles(requests: Sequence[PlanRequest]) -> list[PlanRequest]:
    """Requests for many fields, each with those of its obstacles, and names to ignore, that its field has.

    Raises HeadlandError for an obstacle or a name that no field has, and for a number, which every field may have.
    """
    if len({request.field for request in requests}) < 2:
        return list(requests)
    if any(request.line_wishes for request in requests):
        wishes = ", ".join(map(mark_parameter, WISHES))
        raise RequestError(f"Every field numbers its own tracks, so {wishes} are for one field; give one.")
    fields: dict[str, Field] = {}
    for request in requests:
        if (request.obstacles or request.ignored) and request.field not in fields:
            with suppress(FieldError):  # refused when it is planned
                fields[request.field] = read_requested_field(replace(request, obstacles=(), ignored=()), None)
    given = dict.fromkeys(text for request in requests for text in request.obstacles)
    added = {text: _find_fitting(add_obstacles, fields, text) for text in given}
    ignored = {}
    for text in dict.fromkeys(text for request in requests for text in request.ignored):
        if text.strip().isdecimal():
            raise RequestError(
                f"{mark_parameter('ignored')} {text.strip()} is the number of another obstacle in every field; with "
                "several fields give the name of the obstacle."
            )
        ignored[text] = _find_fitting(leave_out_obstacles, fields, text)
    return [
        replace(
            request,
            obstacles=tuple(text for text in request.obstacles if request.field in added[text]),
            ignored=tuple(text for text in request.ignored if request.field in ignored[text]),
        )
        for request in requests
    ]


def _find_fitting(
    change: Callable[[Field, Sequence[str]], Field], fields: Mapping[str, Field], text: str
) -> frozenset[str]:
    """The names of the fields that a text is of use for; raises the refusal of the first where it is for none."""
    refusals: dict[str, FieldError] = {}
    for name, field in fields.items():
        try:
            change(field, [text])
        except FieldError as refusal:
            refusals[name] = refusal
    if refusals and len(refusals) == len(fields):
        raise next(iter(refusals.values()))
    return frozenset(fields.keys() - refusals.keys())


def list_headland_requests(
    request: PlanRequest, corners: Sequence[str] = (), orders: Sequence[str] = (), passes: Sequence[int] = ()
) -> list[PlanRequest]:
    """The request with every way to work the headland: every corner with every order and number of passes.

    Empty lists leave the default: all kinds of corners, what the work allows, and as many passes as turns need. Raises
    RequestError for values that cannot be planned.
    """
    allowed = orders or HEADLAND_ORDERS_BY_OPERATION[request.operation]
    return [
        replace(request, corners=corner, headland_order=order, headland_passes=count)
        for corner, order, count in product(corners or CORNERS, allowed, passes or (None,))
    ]


def compare_ways(
    orders: Sequence[WorkOrder],
    executor: Executor,
    progress: Progress | None = None,
    describe_refusal: Callable[[HeadlandError], str] = str,
    *,
    with_maps: bool = False,
) -> Comparison:
    """Plan every order on an executor; `progress` is called with (done, total).

    What cannot be planned has its reason, as `describe_refusal` words it. Raises WorkerError if processes keep ending.
    """
    tasks = [(order, describe_refusal, with_maps) for order in orders]
    return Comparison(tuple(collect_answers(executor, answer_order, tasks, progress)))


def list_bearing_requests(request: PlanRequest, bearings_deg: Sequence[float]) -> list[PlanRequest]:
    """The request with each bearing, with the bearing that planning chooses, and along contours, in this order.

    Raises RequestError for too many bearings, or one out of range.
    """
    if len(bearings_deg) > MAX_BEARINGS:
        raise RequestError(f"{len(bearings_deg)} bearings are more than one table holds; give {MAX_BEARINGS} at most.")
    for bearing in bearings_deg:
        if not abs(bearing) <= FULL_CIRCLE_DEG:
            raise RequestError(
                f"A bearing of {bearing:g} degrees is none; give {-FULL_CIRCLE_DEG:g} to {FULL_CIRCLE_DEG:g}."
            )
    return [
        *(replace(request, bearing_deg=bearing, swaths=STRAIGHT) for bearing in bearings_deg),
        replace(request, bearing_deg=None, swaths=STRAIGHT),
        replace(request, bearing_deg=None, swaths=CONTOUR),
    ]


def compare_bearings(
    orders: Sequence[WorkOrder],
    executor: Executor,
    progress: Progress | None = None,
    describe_refusal: Callable[[HeadlandError], str] = str,
) -> Comparison:
    """Plan every request of `list_bearing_requests`; see `compare_ways`.

    Raises RequestError without heights, and the refusal that all requests share, as it is of the field or its heights.
    """
    comparison = compare_ways(orders, executor, progress, describe_refusal)
    refusals = {row.refusal for row in comparison.rows}
    if None not in refusals and len(refusals) == 1:
        raise RequestError(str(refusals.pop()))
    if all(row.ranking is None or row.ranking.cross_slope_pct is None for row in comparison.rows):
        raise RequestError(
            f"Bearings are compared on slopes, and no heights are known; give {mark_parameter('elevation')}.",
            parameter="elevation",
        )
    return comparison
