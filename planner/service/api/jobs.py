"""Plans, days and diagnoses: asked for, watched, cancelled, their results."""

import re
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request, Response

from planner.service.access import Who, needs
from planner.service.access.headers import REPORT_POLICY
from planner.service.api.answers import JobAnswer, JobList, ViewAnswer, refusals
from planner.service.api.files import download
from planner.service.jobs.inputs import gathered
from planner.service.jobs.reading import Reader
from planner.service.jobs.requests import MODELS, DayRequest, DiagnosisRequest, PlanRequest
from planner.service.jobs.requests import Request as Asked
from planner.service.store import Store
from planner.service.store.base import MOST_NAME
from planner.service.store.models import Job, Result

KINDS = {"plans": "plan", "days": "day", "diagnoses": "diagnosis"}
MEDIA = ("application/json", "application/toml", "image/png", "text/csv", "text/html")
SHOWN = ("text/html", "image/png")
Reads = Annotated[Who, Depends(needs("read"))]
Controls = Annotated[Who, Depends(needs("control"))]

every_job = APIRouter(tags=["jobs"])


@every_job.get("/jobs", responses=refusals(401, 403), operation_id="list_jobs")
def all_jobs(request: Request, _who: Reads) -> JobList:
    """Jobs of all kinds, the newest first, at most 500."""
    return JobList(items=[answer_of(row) for row in request.app.state.store.jobs()])


views = APIRouter(tags=["jobs"])


@views.get(
    "/views/{view}",
    response_class=Response,
    responses=refusals(404, 422) | {200: {"content": {each: {} for each in MEDIA}, "description": "The file"}},
    operation_id="show_view",
)
def view(request: Request, view: str) -> Response:
    """The file of a view, once."""
    return shown(request.app.state.store, request.app.state.views.take(view))


def shown(store: Store, row: Result) -> Response:
    """A result as a file, or as a page that may do nothing but show itself."""
    answer = download(store.blobs.get(row.sha256), row.media, row.name)
    if row.media.split(";")[0] in SHOWN:
        answer.headers["content-disposition"] = "inline"
        answer.headers["content-security-policy"] = REPORT_POLICY
        answer.headers["x-frame-options"] = "SAMEORIGIN"
    return answer


def jobs_router(path: str) -> APIRouter:
    """The routes of one kind of job."""
    kind = KINDS[path]
    router = APIRouter(prefix=f"/{path}", tags=[path])
    _add_asking(router, kind)
    _add_reading(router, kind)
    _add_ending(router, kind)
    return router


def _add_asking(router: APIRouter, kind: str) -> None:
    model: Any = MODELS[kind]

    @router.post("", status_code=202, responses=refusals(401, 403, 422), operation_id=f"ask_{kind}")
    def asked(request: Request, who: Controls, body: model) -> JobAnswer:
        """Ask for one; what cannot be asked is refused at once, as on the command line."""
        store: Store = request.app.state.store
        return answer_of(ask(store, request.app.state.reader, kind, body, who))


def ask(store: Store, reader: Reader, kind: str, body: Asked, who: Who) -> Job:
    """Check a request and make it a job; raises HeadlandError."""
    if isinstance(body, DayRequest | DiagnosisRequest):
        body.check()
    values, inputs = gathered(store, body)
    reader.check(kind, values, inputs)
    shown = body.model_dump(exclude_unset=True, exclude_none=True, exclude={"name"})
    row = store.add_job(kind, body.name or _called(body), shown, inputs, values)
    store.add_event(None, who.name, f"{kind} asked for", {"id": row.id, "name": row.name})
    return row


def _called(body: Asked) -> str:
    """What a job is called by what it reads."""
    words = "day"
    if isinstance(body, PlanRequest):
        words = body.field
    elif isinstance(body, DiagnosisRequest):
        words = ", ".join(body.logs[:3]) or "demonstration"
    words = re.sub(r"[^\w()+-]+", " ", words).strip(" ()+-_")[:MOST_NAME].strip()
    return words or "job"


def _add_reading(router: APIRouter, kind: str) -> None:
    @router.get("", responses=refusals(401, 403), operation_id=f"list_{kind}_jobs")
    def listed(request: Request, _who: Reads) -> JobList:
        """All of them, the newest first, at most 500."""
        return JobList(items=[answer_of(row) for row in request.app.state.store.jobs(kind)])

    @router.get("/{id}", responses=refusals(401, 403, 404, 422), operation_id=f"watch_{kind}")
    def one(request: Request, _who: Reads, id: str) -> JobAnswer:
        """How far one is, and what results it has."""
        return answer_of(request.app.state.store.job(id, kind))

    answers = refusals(401, 403, 404, 422) | {200: {"content": {each: {} for each in MEDIA}, "description": "The file"}}

    @router.get(
        "/{id}/results/{name}", response_class=Response, responses=answers, operation_id=f"download_{kind}_result"
    )
    def result(request: Request, _who: Reads, id: str, name: str) -> Response:
        """One file that the job made: result.json and others that it names."""
        store: Store = request.app.state.store
        return shown(store, store.result(id, name, kind))

    @router.post(
        "/{id}/results/{name}/view", responses=refusals(401, 403, 404, 422), operation_id=f"view_{kind}_result"
    )
    def viewed(request: Request, _who: Reads, id: str, name: str) -> ViewAnswer:
        """An address at which the file is shown once within a minute without a token, as in a frame of a page."""
        row = request.app.state.store.result(id, name, kind)
        return ViewAnswer(path=f"views/{request.app.state.views.add(row)}")


def _add_ending(router: APIRouter, kind: str) -> None:
    @router.post("/{id}/cancel", responses=refusals(401, 403, 404, 409, 422), operation_id=f"cancel_{kind}")
    def cancelled(request: Request, who: Controls, id: str) -> JobAnswer:
        """End one that is queued or running."""
        row = request.app.state.store.cancel_job(id, kind)
        request.app.state.store.add_event(None, who.name, f"{kind} cancelled", {"id": id})
        return answer_of(row)

    @router.delete("/{id}", status_code=204, responses=refusals(401, 403, 404, 409, 422), operation_id=f"delete_{kind}")
    def deleted(request: Request, who: Controls, id: str) -> None:
        """Forget one and its results; one that runs is cancelled first."""
        request.app.state.store.delete_job(id, kind)
        request.app.state.store.add_event(None, who.name, f"{kind} deleted", {"id": id})


def answer_of(row: Job) -> JobAnswer:
    """A job as it is answered."""
    return JobAnswer.model_validate(
        {
            "id": row.id, "kind": row.kind, "name": row.name, "status": row.status,
            "progress": {"done": row.done, "all": row.all, "words": row.words}, "error": row.error,
            "created": row.created, "finished": row.finished, "request": row.request,
            "results": [each.name for each in row.results],
        }
    )  # fmt: skip
