"""Routes of the forms for days and farms: the text of a file with changes made, its values and its faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Annotated, Any, Literal

from fastapi import Request
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from fields.nested_text import parse_toml
from fields.sample_fields import list_sample_names
from planner.day.input_file import read_example_day_text
from planner.farm.inventory import read_example_farm_text
from planner.request.parameter_names import LABELS, STRATEGY_LABELS, UNLAID
from planner.service.access.permissions import Caller, ReadAccess
from planner.service.errors import ServiceError
from planner.service.gateway.responses import ApiModel, ApiRequest, ApiRouter
from planner.service.jobs.file_reading import FileReader, build_client_queue_key
from planner.service.jobs.input_files import EXAMPLE_FARM, PLAN_OPTIONS, InputCollector
from planner.service.settings import LIMITS
from planner.service.store.service_store import Store
from vehicle.model.tractor import list_tractor_names

FormKind = Literal["day", "farm"]
KeyName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Position = Annotated[int, Field(ge=0, le=999)]
ValueText = Annotated[str, Field(max_length=LIMITS.longest_value_chars)]
WholeNumber = Annotated[int, Field(ge=-(10**9), le=10**9)]
PlainValue = bool | WholeNumber | float | ValueText | Annotated[list[ValueText], Field(max_length=100)]

KIND_BY_TYPE: dict[Any, Literal["check", "list", "number", "text"]] = {
    bool: "check", list[str]: "list", float: "number", int: "number", str: "text",
}  # fmt: skip
"""What an option without choices takes, by its type."""

form_router = ApiRouter(prefix="/forms", tags=["forms"])


class FormChange(ApiRequest):
    """A value to set: `path` is its keys and positions, such as ["fields", 0, "name"]; null removes it.

    An object as the value is a new entry; its position is one after the last.
    """

    path: Annotated[list[KeyName | Position], Field(min_length=1, max_length=5)]
    value: PlainValue | dict[KeyName, PlainValue] | None


class FormRequest(ApiRequest):
    """The text of a day or farm file (TOML), and values to change in it."""

    text: Annotated[str, Field(max_length=LIMITS.most_form_chars)]
    changes: Annotated[list[FormChange], Field(default_factory=list, max_length=LIMITS.most_changes)]


class FormFault(ApiModel):
    """A value that cannot be used: its place, empty for the whole file, and why."""

    path: list[str | int]
    sentence: str


class FormInfo(ApiModel):
    """The text after the changes, its values, what is wrong, and names to choose from by key (tractor, implement)."""

    text: str
    values: dict[str, Any]
    faults: list[FormFault]
    choices: dict[str, list[str]]


class PlanOptionInfo(ApiModel):
    """What an option of a plan takes; the first of its `choices` is the default.

    With another value of one that `numbers_tracks` the same numbers may mean other tracks.
    """

    kind: Literal["check", "choice", "list", "number", "text"]
    choices: list[str] = Field(default_factory=list)
    numbers_tracks: bool


class PlanFormInfo(ApiModel):
    """What forms call the options of a plan, with units, and its strategies, by name, and what each option takes."""

    labels: dict[str, str]
    strategies: dict[str, str]
    options: dict[str, PlanOptionInfo]


@form_router.get("/plan", operation_id="read_plan_labels")
async def read_plan_labels(_caller: ReadAccess) -> PlanFormInfo:
    """Labels of the options and strategies of a plan, and what the options take."""
    return build_plan_form()


def build_plan_form() -> PlanFormInfo:
    """The form of a plan, made from its request."""
    options = {}
    for name, option in PLAN_OPTIONS.items():
        numbers_tracks = option.parameter not in UNLAID
        if option.rules.choices and option.type is str:
            choices = list(dict.fromkeys([option.default or "", *option.rules.choices]))
            options[name] = PlanOptionInfo(kind="choice", choices=choices, numbers_tracks=numbers_tracks)
        else:
            options[name] = PlanOptionInfo(kind=KIND_BY_TYPE[option.type], numbers_tracks=numbers_tracks)
    return PlanFormInfo(labels=LABELS, strategies=STRATEGY_LABELS, options=options)


@form_router.get("/{kind}", operation_id="read_form_example")
async def read_form_example(request: Request, caller: ReadAccess, kind: FormKind) -> FormInfo:
    """The example that comes with Headland, as a form."""
    text = read_example_day_text() if kind == "day" else read_example_farm_text()
    return await _read_form(request, caller, kind, text, [])


@form_router.post("/{kind}", operation_id="change_form")
async def change_form(request: Request, caller: ReadAccess, kind: FormKind, body: FormRequest) -> FormInfo:
    """Change values in the text of a file and read it; nothing is stored. Comments and the order stay."""
    return await _read_form(request, caller, kind, body.text, [each.model_dump() for each in body.changes])


async def _read_form(
    request: Request, caller: Caller, kind: FormKind, text: str, changes: list[dict[str, Any]]
) -> FormInfo:
    store: Store = request.app.state.store
    reader: FileReader = request.app.state.reader
    farm_path, inputs = await run_in_threadpool(_collect_farm, store, kind, text, changes)
    client = build_client_queue_key(request, caller)
    form = await reader.read(client, f"form {kind}", inputs, [text, changes, farm_path])
    missing = await run_in_threadpool(list, _list_missing_files(store, form["values"]))
    contradictions = form.pop("contradictions")
    return FormInfo(**form | {"faults": [*form["faults"], *(missing or contradictions)]})


def _collect_farm(
    store: Store, kind: str, text: str, changes: list[dict[str, Any]]
) -> tuple[str | None, dict[str, str]]:
    """The path of the farm of a form, and the files to be written for it; None for a day without an uploaded farm."""
    collector = InputCollector(store)
    if kind == "farm":
        collector.add_farm_tractors(text, "farm")
        return "farm/own.toml", collector.inputs
    with suppress(ValueError, RecursionError, ServiceError):
        name = parse_toml(text).get("farm")
        name = next((each["value"] for each in changes if each["path"] == ["farm"]), name)
        if isinstance(name, str) and name != EXAMPLE_FARM:
            return collector.add_file("farm", name, "farm"), collector.inputs
    return None, {}


def _list_missing_files(store: Store, values: Mapping[str, Any]) -> Iterator[FormFault]:
    """Fields, farms and tractors that a file names and that are not there."""
    for section, kind, known_names in (
        ("fields", "field", list_sample_names()), ("tractors", "tractor", list_tractor_names()),
    ):  # fmt: skip
        entries = values.get(section)
        for position, entry in enumerate(entries if isinstance(entries, list) else ()):
            name = entry.get("file") if isinstance(entry, dict) else None
            if isinstance(name, str) and name.partition("#")[0] not in known_names:
                yield from _find_missing(store, kind, name.partition("#")[0], [section, position, "file"])
    if isinstance(values.get("farm"), str) and values["farm"] != EXAMPLE_FARM:
        yield from _find_missing(store, "farm", values["farm"], ["farm"])


def _find_missing(store: Store, kind: str, name: str, path: list[str | int]) -> Iterator[FormFault]:
    try:
        InputCollector(store).add_file(kind, name, kind)
    except ServiceError as refusal:
        yield FormFault(path=path, sentence=str(refusal))
