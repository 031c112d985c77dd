"""Routes for plans, days and diagnoses: submit, watch, cancel, delete, results, views, exports and estimates.

Forms for days and farms: the text of a file with changes made, its values and its faults.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from fields.formats.guidance import ZIP_MEDIA_TYPE, zip_files
from fields.nested_text import parse_toml
from planner.farm.settings import read_example_text
from planner.pipeline.outputs.guidance_lines import build_guidance, find_format
from planner.request.parameter_names import LABELS, STRATEGY_LABELS, UNLAID
from planner.service.access.browsers import REPORT_SECURITY_POLICY
from planner.service.access.permissions import Caller, PlanAccess, ReadAccess
from planner.service.api.uploads import CopyRequest, RenameRequest, SearchParameter, build_download
from planner.service.errors import ServiceError
from planner.service.gateway.request_gate import name_client
from planner.service.gateway.responses import (
    ApiModel,
    ApiRequest,
    ApiRouter,
    JobInfo,
    JobList,
    JobProgress,
    StoreAccess,
    ViewInfo,
    document_file,
    wait_for_disconnect,
    wait_while_connected,
)
from planner.service.jobs.file_reading import FileReader, submit_job
from planner.service.jobs.input_files import (
    EXAMPLE_FARM,
    OPTIONS_BY_NAME,
    PLAN_JOB_MODEL,
    REQUEST_MODELS,
    InputCollector,
    collect_inputs,
    list_named_files,
)
from planner.service.jobs.plan_estimates import PlanEstimator
from planner.service.settings import LIMITS
from planner.service.store.service_store import Store
from planner.service.store.tables import JobRow, ResultRow
from reports.plan.guidance_export import GUIDANCE_FORMATS, write_guidance
from vehicle.missions.plan_file import parse_saved_plan

FormParameter = Annotated[
    str, Query(max_length=20, description=f"One of {', '.join(form.name for form in GUIDANCE_FORMATS)}.")
]
TractorParameter = Annotated[int | None, Query(description="Only this tractor, counted from 1.")]
CurvesParameter = Annotated[
    bool | None, Query(description="Curves too, or straight lines only; by default as the format has it.")
]
EXPORT_ANSWER = document_file(
    "The file, or a ZIP of several", {ZIP_MEDIA_TYPE, *(form.media_type for form in GUIDANCE_FORMATS)}
)

plans_router = ApiRouter(tags=["plans"])
all_jobs_router = ApiRouter(tags=["jobs"])
EstimateRequest: Any = PLAN_JOB_MODEL
JOB_KIND_BY_PATH = {"plans": "plan", "days": "day", "diagnoses": "diagnosis"}
RESULT_ANSWER = document_file(
    "The file", ("application/json", "application/toml", "image/png", "text/csv", "text/html")
)
INLINE_MEDIA_TYPES = ("text/html", "image/png")

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


@plans_router.get(
    "/plans/{id}/results/{name}/export",
    response_class=Response,
    responses=EXPORT_ANSWER,
    operation_id="export_plan_result",
)
def export_plan_result(
    store: StoreAccess,
    _caller: ReadAccess,
    id: str,
    name: str,
    to: FormParameter,
    tractor: TractorParameter = None,
    curves: CurvesParameter = None,
) -> Response:
    """Boundary, headland and lines of plan.json, or of another plan of the job, by tractor in driving order."""
    content, form = store.read_result(id, name, "plan"), find_format(to)
    mission = parse_saved_plan(content.decode("utf-8", "replace"))
    export = write_guidance(build_guidance(mission, tractor), form, curves)
    stem = PurePosixPath(name).stem
    if export.is_single_file:
        return build_download(next(iter(export.files.values())), form.media_type, f"{stem}{form.extension}")
    return build_download(zip_files(export.files), ZIP_MEDIA_TYPE, f"{stem}-{form.name}.zip")


@all_jobs_router.get("/jobs", operation_id="list_jobs")
def list_jobs_of_all_kinds(store: StoreAccess, _caller: ReadAccess) -> JobList:
    """Jobs of all kinds, the newest first, at most 500."""
    return JobList(items=[describe_job(row) for row in store.list_jobs()])


@all_jobs_router.get("/views/{view}", response_class=Response, responses=RESULT_ANSWER, operation_id="show_view")
def show_view(request: Request, view: str) -> Response:
    """The file of a view, once."""
    return build_result_response(request.app.state.store, request.app.state.views.take_view(view))


def build_result_response(store: Store, result: ResultRow) -> Response:
    """A result as a file, or as a page that may do nothing but show itself, with its security headers."""
    response = build_download(store.blobs.read_bytes(result.sha256), result.media, result.name)
    if result.media.split(";")[0] in INLINE_MEDIA_TYPES:
        response.headers["content-disposition"] = "inline"
        response.headers["content-security-policy"] = REPORT_SECURITY_POLICY
        response.headers["x-frame-options"] = "SAMEORIGIN"
    return response


def build_jobs_router(path: str) -> APIRouter:
    """The routes of one kind of job."""
    kind = JOB_KIND_BY_PATH[path]
    router = ApiRouter(prefix=f"/{path}", tags=[path])
    model: Any = REQUEST_MODELS[kind]

    @router.post("", status_code=202, operation_id=f"ask_{kind}")
    async def submit(request: Request, caller: PlanAccess, body: model) -> JobInfo:
        """Submit a job; a request that cannot be fulfilled is refused at once, as on the command line."""
        store, client = request.app.state.store, name_client(request.scope)
        row = await submit_job(store, request.app.state.reader, client, kind, body, caller)
        return await run_in_threadpool(describe_job, row)

    _add_read_routes(router, kind)
    _add_change_routes(router, kind)
    return router


def _add_read_routes(router: APIRouter, kind: str) -> None:
    @router.get("", operation_id=f"list_{kind}_jobs")
    def list_jobs(store: StoreAccess, _who: ReadAccess, search: SearchParameter = "") -> JobList:
        """All of them or those that are searched for, the newest first, at most 500."""
        return JobList(items=[describe_job(row) for row in store.list_jobs(kind, search)])

    @router.get("/{id}", operation_id=f"watch_{kind}")
    def show_job(store: StoreAccess, _who: ReadAccess, id: str) -> JobInfo:
        """Progress and results of a job."""
        return describe_job(store.get_job(id, kind))

    @router.get(
        "/{id}/results/{name}", response_class=Response, responses=RESULT_ANSWER, operation_id=f"download_{kind}_result"
    )
    def download_result(store: StoreAccess, _who: ReadAccess, id: str, name: str) -> Response:
        """One result of the job: result.json or another that it lists."""
        return build_result_response(store, store.get_result(id, name, kind))

    @router.post("/{id}/results/{name}/view", operation_id=f"view_{kind}_result")
    def create_view(request: Request, store: StoreAccess, _who: ReadAccess, id: str, name: str) -> ViewInfo:
        """An address that shows the file once, within a minute and without a token, for the frame of a page."""
        return ViewInfo(path=f"views/{request.app.state.views.add_view(store.get_result(id, name, kind))}")


def _add_change_routes(router: APIRouter, kind: str) -> None:
    def check_may_change(store: Store, caller: Caller, id: str) -> None:
        """Raise NotFoundError, ScopeError for a job of somebody else."""
        row = store.get_job(id, kind)
        caller.check_may_change(row, f"The job {row.name!r}")

    @router.post("/{id}/cancel", operation_id=f"cancel_{kind}")
    def cancel_job(store: StoreAccess, caller: PlanAccess, id: str) -> JobInfo:
        """Cancel a queued or running job."""
        check_may_change(store, caller, id)
        row = store.cancel_job(id, kind)
        store.add_event(None, caller.name, f"{kind} cancelled", {"id": id})
        return describe_job(row)

    @router.delete("/{id}", status_code=204, operation_id=f"delete_{kind}")
    def delete_job(store: StoreAccess, caller: PlanAccess, id: str) -> None:
        """Delete a job and its results; one that runs is ended."""
        check_may_change(store, caller, id)
        store.delete_job(id, kind)
        store.add_event(None, caller.name, f"{kind} deleted", {"id": id})

    @router.patch("/{id}", operation_id=f"rename_{kind}_job")
    def rename_job(store: StoreAccess, caller: PlanAccess, id: str, body: RenameRequest) -> JobInfo:
        """Give a job another name."""
        check_may_change(store, caller, id)
        row = store.rename_job(id, kind, body.name)
        store.add_event(None, caller.name, f"{kind} renamed", {"id": id, "to": row.name})
        return describe_job(row)

    @router.post("/{id}/copy", status_code=201, operation_id=f"copy_{kind}_job")
    def copy_job(store: StoreAccess, caller: PlanAccess, id: str, body: CopyRequest) -> JobInfo:
        """Copy a job that has ended, with its results; the copy belongs to who makes it."""
        row = store.copy_job(id, kind, body.name, caller.owner)
        store.add_event(None, caller.name, f"{kind} copied", {"id": id, "to": row.id})
        return describe_job(row)


def describe_job(job: JobRow) -> JobInfo:
    """A job as an answer."""
    values = {key: getattr(job, key) for key in JobInfo.model_fields.keys() - {"progress", "results"}}
    progress, results = JobProgress.model_validate(job), [each.name for each in job.results]
    return JobInfo(**values, progress=progress, results=results)


class EstimatedPlan(ApiModel):
    """The plan of one number of tractors, estimated; where it is not possible, `reason` says why.

    `done_s` is the end of field work, seconds after the start by the clock, and `end` the same as hh:mm where there is
    a start; `finished_s` has the time for ground that is left as well.
    """

    tractors: int
    feasible: bool
    reason: str | None = None
    time_s: float | None = None
    finished_s: float | None = None
    done_s: float | None = None
    end: str | None = None
    cost: float | None = None
    worked_pct: float | None = None
    in_time: bool | None = None


class LineInfo(ApiModel):
    """A track or the side of a headland pass: its name as on maps, who works it and when, and its path in metres."""

    name: str
    tractor: int | None = Field(description="The tractor that works it, from 1; null where it is left.")
    place: int | None = Field(description="Its place in the tour of that tractor, from 1.")
    points: list[list[float]]


class EstimateInfo(ApiModel):
    """Plans by their number of tractors, the one to take, and the layout: bearing in degrees, headland passes.

    Where `is_layout_borrowed`, the layout is that of another width or speed, and a plan may choose a better one. Where
    `is_scaled`, so are the tours, or they are those of another number of tractors. `lines` are those of the plan to
    take, `outlines` the field and its holes, in metres east and north of a point of it; a scaled answer has neither.
    """

    recommended: int | None = Field(description="Number of tractors of the plan to take; null where none is possible.")
    plans: list[EstimatedPlan]
    caution: str | None = Field(
        description="Why the plan to take is no recommendation (a tractor too weak, too little ground, too late), or "
        "what to check of it."
    )
    currency: str | None
    width: float
    bearing: float
    headland_passes: int
    is_layout_borrowed: bool
    lines: list[LineInfo]
    outlines: list[list[list[float]]]
    is_scaled: bool


@plans_router.post("/estimates", operation_id="estimate_plan")
async def estimate_plan(
    request: Request, caller: PlanAccess, body: EstimateRequest, at_once: bool = False
) -> EstimateInfo:
    """Estimate plans without driving them; nothing is stored. It takes what a plan job takes.

    Where the client closes the connection before its turn, nothing is computed. With `at_once` tours of another width
    or number of tractors are scaled instead of new ones being laid out.
    """
    estimator: PlanEstimator = request.app.state.estimator
    values, inputs = await run_in_threadpool(collect_inputs, request.app.state.store, body)
    work = estimator.estimate(name_client(request.scope), values, inputs, at_once=at_once)
    return EstimateInfo(**await wait_while_connected(wait_for_disconnect(request.receive), work))


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
    for name, option in OPTIONS_BY_NAME.items():
        numbers_tracks = option.parameter not in UNLAID
        if option.choices and option.type is str:
            choices = list(dict.fromkeys([option.default or "", *option.choices]))
            options[name] = PlanOptionInfo(kind="choice", choices=choices, numbers_tracks=numbers_tracks)
        else:
            options[name] = PlanOptionInfo(kind=KIND_BY_TYPE[option.type], numbers_tracks=numbers_tracks)
    return PlanFormInfo(labels=LABELS, strategies=STRATEGY_LABELS, options=options)


@form_router.get("/{kind}", operation_id="read_form_example")
async def read_form_example(request: Request, caller: ReadAccess, kind: FormKind) -> FormInfo:
    """The example that comes with Headland, as a form."""
    text = read_example_text(kind)
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
    form = await reader.read(name_client(request.scope), f"form {kind}", inputs, [text, changes, farm_path])
    missing = await run_in_threadpool(list, _list_missing_files(store, kind, form["values"]))
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


def _list_missing_files(store: Store, kind: str, values: Mapping[str, Any]) -> Iterator[FormFault]:
    """The files that a form names and that are not there."""
    for file_kind, name, place in list_named_files(kind, values):
        try:
            InputCollector(store).add_file(file_kind, name, file_kind)
        except ServiceError as refusal:
            yield FormFault(path=place, sentence=str(refusal))
