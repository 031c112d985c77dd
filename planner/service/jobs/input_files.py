"""The requests for jobs, and their input files, kept as they were when it was made: requests name uploads, not paths.

Files of a kind lie in a folder of that name while a job works: "field/north.geojson", "farm/own.toml" with the tractors
it names beside it. What a file of the farm or the day names is looked for among the uploaded files alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, create_model

from fields.nested_text import parse_toml
from fields.sample_fields import list_sample_names
from planner.errors import mark_parameter, strip_unit
from planner.request.job_options import DAY_HELP, DIAGNOSIS_HELP
from planner.request.option_checks import check_day_options, check_demo_options
from planner.request.options import PlanOption
from planner.request.plan_options import PLAN_OPTIONS
from planner.request.plan_request import MAX_SEED
from planner.service.errors import NotFoundError, ServiceError
from planner.service.settings import LIMITS
from planner.service.store.job_queue import JobStore
from planner.service.store.service_store import SUFFIXES_BY_KIND, Store
from vehicle.identification.logs.reader import SAMPLE_LOG
from vehicle.model.soil import load_soils
from vehicle.model.tractor import list_tractor_names

ShortText = Annotated[str, Field(max_length=LIMITS.longest_text_chars)]
ShortTexts = Annotated[list[ShortText], Field(max_length=LIMITS.most_list_entries)]
JobTitle = Annotated[
    str | None, Field(max_length=100, description="What the job is called; by default after its input.")
]
OPTIONS_BY_NAME = {option.name: option for option in PLAN_OPTIONS}
Seed = Annotated[int, Field(ge=0, le=MAX_SEED, description=OPTIONS_BY_NAME["seed"].help)]
ReportProgress = Callable[[int, int, str], None]

DAY_FILE = "day/day.toml"
EXAMPLE_FARM = "example"  # the name of the example farm in a day file
PATH_CHARACTERS = "/\\:\0"

InputFiles = dict[str, str]
"""Files of a request: the path of each in the job's folder, and the SHA-256 of its bytes."""
NamedFile = tuple[str, str, list[str | int]]
"""Kind and name of a file that a TOML file names, and where: keys and positions."""


class JobRequest(BaseModel):
    """A request for a job. Unknown names, infinity and NaN are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    name: JobTitle = None


class PlanJobRequest(JobRequest):
    """`headland plan`: simulate every combination of tractor count and strategy on a field and rank them.

    Files are named as they were uploaded; `field` may end in #ID.
    """


def _build_api_field(option: PlanOption) -> tuple[Any, Any]:
    """Type and description of an option of a plan for pydantic.

    Limits and choices are shown only; the plan request itself refuses, in the sentences of the command line.
    """
    kind = {str: ShortText, list[str]: ShortTexts}.get(option.type, option.type)
    shown: dict[str, Any] = {}
    if option.limits is not None and isfinite(option.limits.high):
        shown = {
            "exclusiveMinimum" if option.limits.above else "minimum": option.limits.low,
            "maximum": option.limits.high,
        }
    elif option.choices and option.type is str:
        shown = {"enum": [*option.choices, *([None] if option.default is None else [])]}
    description = option.format_help(strip_unit, for_api=True)
    annotation = kind | None if option.default is None else kind
    return annotation, Field(option.default, description=description, json_schema_extra=shown or None)


_API_FIELDS: dict[str, Any] = {name: _build_api_field(option) for name, option in OPTIONS_BY_NAME.items()}
PLAN_JOB_MODEL = create_model(
    PlanJobRequest.__name__, __base__=PlanJobRequest, __doc__=PlanJobRequest.__doc__, **_API_FIELDS
)
"""A plan request with the options of `headland plan`."""


class DayJobRequest(JobRequest):
    """`headland day`: several fields and fleets on one day; `day` is the text of a day file.

    Files that it and the request name are uploads, by their names with or without their endings.
    """

    day: Annotated[str, Field(max_length=LIMITS.most_toml_chars, description="The text of a day file (TOML).")]
    farm: ShortText | None = Field(None, description=DAY_HELP["farm"])
    rain: ShortText | None = Field(None, description=DAY_HELP["rain"])
    certainty: float | None = Field(None, description=DAY_HELP["certainty"])
    samples: Annotated[int, Field(description=DAY_HELP["samples"])] = 10_000
    seed: Seed = 1

    def check_options(self) -> None:
        """Raise RequestError as the command does."""
        check_day_options(self.samples, self.certainty)


class DiagnosisJobRequest(JobRequest):
    """`headland diagnose`: what the simulation gets wrong in measured logs, why, and what correcting it gains."""

    logs: Annotated[ShortTexts, Field(description="Uploaded logs, one run each.")] = []
    tractor: ShortText = Field("eg105", description="eg105, mr1000a or an uploaded tractor.")
    ground: ShortText = Field("soil", description=DIAGNOSIS_HELP["ground"])
    fix: Annotated[ShortTexts, Field(description=DIAGNOSIS_HELP["fix"])] = []
    mapping: Annotated[ShortTexts, Field(description=DIAGNOSIS_HELP["column"])] = []
    as_driven: bool = Field(False, description=DIAGNOSIS_HELP["as_driven"])
    holdout: Annotated[ShortTexts, Field(description=DIAGNOSIS_HELP["holdout"])] = []
    demo: bool = Field(False, description=DIAGNOSIS_HELP["demo"])
    hide: ShortText | None = Field(None, description=DIAGNOSIS_HELP["hide"])
    seed: Annotated[int | None, Field(ge=0, le=MAX_SEED, description=DIAGNOSIS_HELP["seed"])] = None

    def check_options(self) -> None:
        """Raise RequestError for both or neither of logs and demonstration, as the command does."""
        conversions = {mark_parameter("fixes"): self.fix, mark_parameter("mapping"): self.mapping}
        own = {"seed": self.seed, "hide": self.hide}
        check_demo_options(self.demo, self.logs, conversions, own, self.as_driven)


REQUEST_MODELS: dict[str, type[JobRequest]] = {
    "plan": PLAN_JOB_MODEL,
    "day": DayJobRequest,
    "diagnosis": DiagnosisJobRequest,
}
"""The request of every kind of job."""


@dataclass(frozen=True)
class JobContext:
    """One job as its function takes it: the request, processes it may use, and where to report progress.

    Progress is steps done, all steps, and a text. The function is called in the folder of its input files, and gives
    the same bytes whenever it is called.
    """

    request: Mapping[str, Any]
    processes: int
    report_progress: ReportProgress
    cache_folder: str


ResultContents = Mapping[str, str | bytes]
JobFunction = Callable[[JobContext], ResultContents]
"""Runs a job and returns its results by file name; raises HeadlandError."""


class InputCollector:
    """Collects the files of one request from the store."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self.inputs: InputFiles = {}

    def add_file(self, kind: str, name: str, parameter: str, folder: str = "", filename: str = "") -> str:
        """Add an uploaded file; returns its path. Raises ServiceError about the parameter."""
        try:
            stored_file = self._store.get_file(kind, _strip_suffix(kind, name))
        except NotFoundError as error:
            raise ServiceError(str(error), parameter=parameter) from None
        file_path = f"{folder or kind}/{filename or stored_file.name + stored_file.suffix}"
        self._add_bytes(kind, file_path, stored_file.sha256, parameter)
        return file_path

    def add_content(self, kind: str, file_path: str, content: bytes, parameter: str) -> None:
        """Add the bytes of a file that has no name yet; raises ServiceError about the parameter."""
        self._add_bytes(kind, file_path, self._store.blobs.put_bytes(content), parameter)

    def _add_bytes(self, kind: str, file_path: str, sha256: str, parameter: str) -> None:
        """Add bytes at a path; a farm brings the tractor files that it names."""
        self.inputs[file_path] = sha256
        if kind == "farm":
            self._add_named_files("farm", sha256, file_path.partition("/")[0], parameter)

    def add_field(self, name: str, parameter: str) -> tuple[str, dict[str, Any]]:
        """The path of a sample or an uploaded field, with the part after "#", and how it is read, as given with the
        upload."""
        stem, mark, key = name.partition("#")
        if stem in list_sample_names():
            return name, {}
        path = self.add_file("field", stem, parameter) + mark + key
        return path, dict(self._store.get_file("field", _strip_suffix("field", stem)).options)

    def add_tractor(self, name: str, parameter: str) -> str:
        """The name of a built-in tractor, or the path of an uploaded one."""
        return name if name in list_tractor_names() else self.add_file("tractor", name, parameter)

    def add_farm_tractors(self, text: str, folder: str) -> None:
        """The tractor files that the text of a farm names, in a folder, as far as there are any."""
        for kind, name, _ in _list_files_in_toml("farm", text):
            with suppress(ServiceError):
                self.add_file(kind, name, "file", folder, name)

    def add_day(self, text: str) -> None:
        """The text of a day, and the files that it names."""
        sha256 = self._store.blobs.put_bytes(text.encode())
        self.inputs[DAY_FILE] = sha256
        self._add_named_files("day", sha256, "day", "day")

    def _add_named_files(self, of_kind: str, sha256: str, folder: str, parameter: str) -> None:
        """Add the files that a farm or a day names, beside it under those names; a file that is not TOML names none."""
        text = self._store.blobs.read_bytes(sha256).decode("utf-8-sig", "replace")
        for kind, name, _ in _list_files_in_toml(of_kind, text):
            file_path = f"{folder}/{name}"
            if file_path == DAY_FILE:
                raise ServiceError(
                    f"A {kind} of the day has the name {name!r} of the day file itself; upload it under another name.",
                    parameter=parameter,
                )
            before = self.inputs.get(file_path)
            self.add_file(kind, name, parameter, folder, name)
            if before not in (None, self.inputs[file_path]):
                sentence = f"Two files have the name {name!r}; upload one of them under another name."
                raise ServiceError(sentence, parameter=parameter)


def collect_inputs(store: Store, request: JobRequest) -> tuple[dict[str, Any], InputFiles]:
    """The request with paths in its folder, and the files to write there; raises ServiceError."""
    collector = InputCollector(store)
    values = request.model_dump(exclude_unset=True, exclude_none=True, exclude={"name"})
    if _is_rain_table(values.get("rain")):
        values["rain"] = collector.add_file("table", values["rain"].strip(), "rain")
    if isinstance(request, PlanJobRequest):
        values = _collect_plan_files(store, collector, dict(request), values)
    elif isinstance(request, DayJobRequest):
        collector.add_day(request.day)
        values["day"] = DAY_FILE
        if request.farm not in (None, EXAMPLE_FARM):
            values["farm"] = collector.add_file("farm", str(request.farm), "farm")
    elif isinstance(request, DiagnosisJobRequest):
        logs = request.logs
        values["logs"] = [name if name == SAMPLE_LOG else collector.add_file("log", name, "logs") for name in logs]
        values["tractor"] = collector.add_tractor(request.tractor, "tractor")
    return values, collector.inputs


def _collect_plan_files(
    store: Store, collector: InputCollector, options: Mapping[str, Any], values: dict[str, Any]
) -> dict[str, Any]:
    """The given values of a plan request with the paths of its files; `options` has defaults as well."""
    values["field"], upload_options = collector.add_field(options["field"], "field")
    values = upload_options | values
    for parameter, kind in (("gnss_table", "table"), ("elevation", "elevation"), ("farm", "farm")):
        if options[parameter] is not None:
            values[parameter] = collector.add_file(kind, options[parameter], parameter)
    if options["soil"] is not None and options["soil"] not in load_soils():  # a request names no table by its path
        sentence = f"The soil {options['soil'][:60]!r} is unknown; use one of: {', '.join(load_soils())}."
        raise ServiceError(sentence, parameter="soil")
    if _is_rain_table(options["rain_mm"]):
        sentence = "The rain of the last days cannot be a file here; give millimetres by day, such as 0,12,5."
        raise ServiceError(sentence, parameter="rain_mm")
    if "tractor" in values and not _is_farm_tractor(store, options["farm"], options["tractor"]):
        values["tractor"] = collector.add_tractor(options["tractor"], "tractor")
    return values


def write_inputs(store: JobStore, inputs: Mapping[str, str], folder: Path) -> None:
    """Write the files of a request to a folder."""
    for file_path, sha256 in inputs.items():
        path = folder / file_path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(store.blobs.read_bytes(sha256))


def _is_farm_tractor(store: Store, farm: str | None, tractor: str) -> bool:
    """Whether a tractor is one of the farm: neither built in nor uploaded, and no path."""
    uploaded_names = {each.name for each in store.list_files("tractor")} | set(list_tractor_names())
    if farm is None or any(mark in tractor for mark in PATH_CHARACTERS):
        return False
    return _strip_suffix("tractor", tractor) not in uploaded_names


def list_tractor_users(store: Store, name: str) -> list[str]:
    """The farms and fleets that name an uploaded tractor, in words: "the farm 'own'"."""
    users = []
    for farm in store.list_files("farm"):
        text = store.blobs.read_bytes(farm.sha256).decode("utf-8-sig", "replace")
        if any(_strip_suffix("tractor", file) == name for _, file, _ in _list_files_in_toml("farm", text)):
            users.append(f"the farm {farm.name!r}")
    fleets = [each.name for each in store.list_fleets() if name in each.progress.get("mended", {}).values()]
    return users + [f"the fleet {each!r}" for each in fleets]


def _strip_suffix(kind: str, name: str) -> str:
    """A name without the ending of its kind."""
    return next((name.removesuffix(end) for end in SUFFIXES_BY_KIND[kind] if name.endswith(end)), name)


def _list_files_in_toml(of_kind: str, text: str) -> list[NamedFile]:
    """The files that the text of a farm or a day names; one that is not TOML names none."""
    try:
        return list(list_named_files(of_kind, parse_toml(text)))
    except (ValueError, RecursionError):
        return []


def list_named_files(of_kind: str, values: Mapping[str, Any]) -> Iterator[NamedFile]:
    """Tractors that a farm names; fields, their heights, the farm and the table of rain that a day names."""
    if of_kind == "farm":
        for name, place in _list_texts(values, "tractors", "file"):
            if name not in list_tractor_names():
                yield "tractor", name, place
        return
    for name, place in _list_texts(values, "fields", "file"):
        if name.partition("#")[0] not in list_sample_names():
            yield "field", name.partition("#")[0], place
    for name, place in _list_texts(values, "fields", "elevation"):
        yield "elevation", name, place
    farm = values.get("farm")
    if isinstance(farm, str) and farm != EXAMPLE_FARM:
        yield "farm", farm, ["farm"]
    if _is_rain_table(values.get("rain")):
        yield "table", values["rain"].strip(), ["rain"]


def _list_texts(values: Mapping[str, Any], section: str, key: str) -> Iterator[tuple[str, list[str | int]]]:
    """The texts of a key in the tables of a section, and their places."""
    tables = values.get(section)
    for position, table in enumerate(tables if isinstance(tables, list) else ()):
        if isinstance(table, Mapping) and isinstance(table.get(key), str):
            yield table[key], [section, position, key]


def _is_rain_table(rain: Any) -> bool:
    """Whether rain is given as a table (planner.risk.rain)."""
    return isinstance(rain, str) and rain.strip().lower().endswith(".csv")
