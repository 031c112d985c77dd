"""Routes for plans, days and diagnoses: submit, watch, cancel, delete, results, views, exports and estimates."""

from pathlib import PurePosixPath
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from fields.formats.guidance import ZIP_MEDIA_TYPE, zip_files
from planner.pipeline.outputs.guidance_lines import build_guidance, find_format
from planner.service.access.browsers import REPORT_SECURITY_POLICY
from planner.service.access.permissions import Caller, PlanAccess, ReadAccess
from planner.service.api.uploads import CopyRequest, RenameRequest, SearchParameter, build_download
from planner.service.gateway.responses import (
    ApiModel,
    ApiRouter,
    JobInfo,
    JobList,
    JobProgress,
    StoreAccess,
    ViewInfo,
    document_file,
)
from planner.service.jobs.file_reading import build_client_queue_key, submit_job
from planner.service.jobs.input_files import PLAN_JOB_MODEL, REQUEST_MODELS, collect_inputs
from planner.service.jobs.plan_estimates import PlanEstimator
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
    row, form = store.get_result(id, name, "plan"), find_format(to)
    mission = parse_saved_plan(store.blobs.read_bytes(row.sha256).decode("utf-8", "replace"))
    export = write_guidance(build_guidance(mission, tractor), form, curves)
    stem = PurePosixPath(row.name).stem
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
        store, client = request.app.state.store, build_client_queue_key(request, caller)
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

    With `at_once` tours of another width or number of tractors are scaled instead of new ones being laid out.
    """
    estimator: PlanEstimator = request.app.state.estimator
    values, inputs = await run_in_threadpool(collect_inputs, request.app.state.store, body)
    client = build_client_queue_key(request, caller)
    return EstimateInfo(**await estimator.estimate(client, values, inputs, at_once=at_once))
