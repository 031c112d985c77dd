"""Models of requests and answers of the API, its routers, and errors as answers: one sentence, never a traceback."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import Annotated, Any, Generic, Literal, TypeVar

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, ConfigDict, field_validator
from sqlalchemy.exc import InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match
from starlette.types import Receive

from planner.errors import HeadlandError, render_refusal, strip_unit
from planner.request.parameter_names import quote_label
from planner.request.validation import describe_fault, format_location
from planner.service.errors import StorageError
from planner.service.store.disk_storage import DISK_FULL, is_disk_full
from planner.service.store.job_queue import JobStatus
from planner.service.store.service_store import Store
from planner.service.store.token_table import TokenScope

Item = TypeVar("Item")
_STATUS_MEANINGS = {
    401: "No token, or an unknown or expired one", 403: "The token lacks the right", 404: "Nothing of that name",
    409: "A name is taken, or the state does not allow it", 413: "Too many bytes", 422: "A value that cannot be used",
    429: "Too many requests, or too many jobs waiting", 503: "The database cannot be used",
    507: "No room left on the disk",
}  # fmt: skip
COMMON_ERROR_STATUSES = (413, 429, 503, 507)
INTERNAL_ERROR = "This is a fault of Headland; the log of the service has the details. Please report it."
HTTP_METHODS = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")


class ApiModel(BaseModel):
    """An answer, built from any object with attributes of the same names."""

    model_config = ConfigDict(from_attributes=True)


class ApiRequest(BaseModel):
    """A body that a route takes; unknown names, infinity and NaN are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class ItemList(ApiModel, Generic[Item]):
    """All there are, in the order that the route describes; each kind has a name of its own in the documentation."""

    items: list[Item]


class ErrorInfo(ApiModel):
    """A refusal: one sentence and its parameter; `labelled` is the sentence with labels of forms, where it has any."""

    error: str
    parameter: str | None = None
    labelled: str | None = None


class HealthInfo(ApiModel):
    """Whether the service is in order; `faults` are sentences about what is missing while it is degraded."""

    status: Literal["ok", "degraded"]
    version: str
    faults: list[str]


class ReadinessInfo(ApiModel):
    """Whether everything can be used, and what is missing."""

    ready: bool
    faults: list[str]


class CallerInfo(ApiModel):
    """The caller; a robot is bound to one tractor of one fleet.

    `identity` is that of the token, which files and jobs name as their owner. `token_command` makes a token where it is
    entered on the machine of the service.
    """

    name: str
    rights: list[str]
    fleet: str | None
    tractor: int | None
    token_command: str
    identity: str | None = None


class FileInfo(ApiModel):
    """A file by its name; a `sample` comes with Headland, `options` say how a field is read (crs, swap_axes, local).

    `owner` is the name of the token that added it, `owner_identity` tells it from other tokens of that name; it and an
    administrator may change and delete it.
    """

    kind: str
    name: str
    suffix: str
    size: int
    media: str
    created: str | None
    sample: bool = False
    options: dict[str, Any] = {}
    owner: str | None = None
    owner_identity: str | None = None
    changed: str | None = None


class FileList(ItemList[FileInfo]):
    """Files, those that come with Headland first."""


class JobProgress(ApiModel):
    """Progress of a job: steps done, all steps, and what it is doing now."""

    done: int
    all: int
    words: str


class JobInfo(ApiModel):
    """A job; `error` says in one sentence why it failed, `results` are the names of its files.

    `owner` is the name of the token that asked for it, `owner_identity` tells it from other tokens of that name; it and
    an administrator may rename, cancel and delete it.
    """

    id: str
    kind: str
    name: str
    status: JobStatus
    progress: JobProgress
    error: str | None
    created: str
    finished: str | None
    request: dict[str, Any]
    results: list[str]
    owner: str | None = None
    owner_identity: str | None = None


class JobList(ItemList[JobInfo]):
    """Jobs, the newest first."""


class ViewInfo(ApiModel):
    """The path below /api/v1 at which a result is shown once."""

    path: str


class TokenInfo(ApiModel):
    """A token; a robot's is bound to one `tractor` of one `fleet`. It is valid until it `expires`, if it does."""

    name: str
    scopes: list[TokenScope]
    created: str
    fleet: str | None = None
    tractor: int | None = None
    expires: str | None = None

    @field_validator("scopes", mode="before")
    @classmethod
    def _split_scopes(cls, scopes: object) -> object:
        return scopes.split() if isinstance(scopes, str) else scopes


class TokenList(ItemList[TokenInfo]):
    """Tokens, the oldest first."""


class NewToken(TokenInfo):
    """A new token; its text is shown only once."""

    token: str


class EventInfo(ApiModel):
    """Who did what, and when (UTC)."""

    id: int
    time: str
    fleet: str | None
    who: str
    what: str
    data: dict[str, Any]


class EventList(ItemList[EventInfo]):
    """Events, the oldest first."""


class ApiRouter(APIRouter):
    """Routes whose refusals are documented by what they are: a path may name nothing, and a change may conflict."""

    def add_api_route(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        """Overrides APIRouter.add_api_route, to which every decorator of a route comes."""
        changes = set(options.get("methods") or ("GET",)) != {"GET"}
        statuses = {401, 403, 422, *COMMON_ERROR_STATUSES}
        statuses |= ({404} if changes or "{" in path else set()) | ({409} if changes else set())
        refusals = {each: {"model": ErrorInfo, "description": _STATUS_MEANINGS[each]} for each in sorted(statuses)}
        options["responses"] = refusals | (options.get("responses") or {})
        super().add_api_route(path, endpoint, **options)


def document_file(description: str, media_types: Iterable[str]) -> dict[int | str, dict[str, Any]]:
    """Documentation of an answer that is a file of one of these media types."""
    return {200: {"content": {each: {} for each in sorted(media_types)}, "description": description}}


def require_state(name: str) -> Any:
    """A dependency of routes: what the app keeps in its state under a name."""

    async def get_from_state(request: Request) -> Any:
        return getattr(request.app.state, name)

    return Depends(get_from_state)


StoreAccess = Annotated[Store, require_state("store")]


def build_error_response(
    status: int, message: str, headers: Mapping[str, str] | None = None, parameter: str | None = None, **more: str
) -> JSONResponse:
    """A sentence as an answer; `more` are further keys of it."""
    headers = dict(headers or {}) | ({"www-authenticate": "Bearer"} if status == 401 else {})
    return JSONResponse({"error": message, "parameter": parameter, **more}, status, headers)


def build_refusal_response(error: HeadlandError) -> JSONResponse:
    """A refusal as an answer, with the API's name of its parameter."""
    parameter = None if error.parameter is None else strip_unit(error.parameter)
    sentence, labelled = render_refusal(error), error.render_sentence(quote_label)
    more = {"labelled": labelled} if labelled != sentence else {}
    return build_error_response(getattr(error, "http_status", 422), sentence, None, parameter, **more)


def add_error_handlers(app: FastAPI) -> None:
    """Let an app answer errors as sentences, with the API's names of parameters."""

    async def handle_headland_error(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HeadlandError)
        return build_refusal_response(error)

    async def handle_invalid_request(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        fault = error.errors()[0]
        if fault["type"] == "json_invalid":
            return build_error_response(422, describe_fault(fault, "The body"))
        location = fault["loc"][1:]
        name = next((part for part in location if isinstance(part, str)), None)
        sentence = describe_fault(fault, format_location(location) or f"The {fault['loc'][0]}")
        return build_error_response(422, sentence, None, name)

    async def handle_lost_database(_request: Request, error: Exception) -> JSONResponse:
        logging.getLogger(__name__).error("The database: %s", error)
        return build_error_response(503, "The database cannot be reached now; try again.")

    async def handle_gone_client(_request: Request, _error: Exception) -> Response:
        return Response(status_code=400)  # which nobody reads

    async def handle_os_error(_request: Request, error: Exception) -> JSONResponse:
        if not is_disk_full(error):
            raise error
        return build_error_response(StorageError.http_status, DISK_FULL)

    async def handle_internal_error(_request: Request, _error: Exception) -> JSONResponse:
        return build_error_response(500, INTERNAL_ERROR)

    app.add_exception_handler(HeadlandError, handle_headland_error)
    app.add_exception_handler(RequestValidationError, handle_invalid_request)
    app.add_exception_handler(HTTPException, _answer_http_exception)
    for kind in (OperationalError, InterfaceError, PoolTimeout):
        app.add_exception_handler(kind, handle_lost_database)
    app.add_exception_handler(ClientDisconnect, handle_gone_client)
    app.add_exception_handler(OSError, handle_os_error)
    app.add_exception_handler(Exception, handle_internal_error)


async def wait_while_connected(gone: Awaitable[None], work: Awaitable[Item]) -> Item:
    """The result of work, which is cancelled when the client has `gone`; then raises ClientDisconnect."""
    working = asyncio.ensure_future(work)
    tasks = working, asyncio.ensure_future(gone)
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            tasks[1].result()
            raise ClientDisconnect
        return await working
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def wait_for_disconnect(receive: Receive) -> None:
    """Wait until a client whose request is read closes the connection."""
    while (await receive())["type"] != "http.disconnect":
        pass


async def _answer_http_exception(request: Request, error: Exception) -> JSONResponse:
    """What Starlette refuses, and refusals of the gate within a body, in a sentence of the service."""
    assert isinstance(error, HTTPException)
    headers = {name.lower(): value for name, value in (error.headers or {}).items()}
    if error.status_code == 404:
        return build_error_response(404, "There is nothing at this address; the API is documented at /api/v1/docs.")
    if error.status_code == 405:
        scopes = {method: dict(request.scope) | {"method": method} for method in HTTP_METHODS}
        headers["allow"] = ", ".join(
            method
            for method, scope in scopes.items()
            if any(route.matches(scope)[0] == Match.FULL for route in request.app.router.routes)
        )
        sentence = f"This address does not take {request.method[:20]}; it takes {headers['allow']}."
        return build_error_response(405, sentence, headers)
    if error.status_code == 400:
        if is_disk_full(error):  # the temporary folder for bodies is full
            return build_error_response(StorageError.http_status, DISK_FULL)
        return build_error_response(
            422, "The body cannot be read; send JSON in UTF-8, or a form with the file for uploads."
        )
    return build_error_response(error.status_code, str(error.detail), headers)
