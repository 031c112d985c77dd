"""Routes for uploaded fields, tractors, farms, logs, tables and heights: upload, list, summarise, download, delete."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, File, Form, Query, Request, Response, UploadFile
from starlette.concurrency import run_in_threadpool

from fields.errors import HeadlandError
from planner.service.access.permissions import Caller, require_right
from planner.service.api.library import (
    SearchParameter,
    add_file_change_routes,
    describe_sample,
    find_changeable_file,
    list_samples,
    read_sample,
    refuse_sample_name,
)
from planner.service.errors import ConflictError, NotFoundError, TooLargeError
from planner.service.gateway.request_gate import refuse_unknown_form_parts
from planner.service.gateway.responses import FileInfo, FileList, document_errors
from planner.service.jobs.file_reading import FileReader, build_client_queue_key
from planner.service.jobs.input_files import InputCollector, InputFiles
from planner.service.settings import MEGABYTE_BYTES
from planner.service.store.file_table import MEDIA_BY_SUFFIX, SUFFIXES_BY_KIND, check_suffix, choose_article
from planner.service.store.service_store import Store
from planner.service.store.store_part import is_found

FILE_KIND_BY_PATH = {
    "fields": "field", "tractors": "tractor", "farms": "farm", "logs": "log", "tables": "table",
    "elevations": "elevation",
}  # fmt: skip
HAND_WRITTEN_KINDS = ("tractor", "farm")  # they stay small
ReadAccess = Annotated[Caller, Depends(require_right("read"))]
PlanAccess = Annotated[Caller, Depends(require_right("plan"))]
UploadParameter = Annotated[UploadFile, File(description="The file; its ending gives the format.")]
NameParameter = Annotated[str | None, Form(description="Its name here; by default the name of the file.")]
ReplaceParameter = Annotated[
    bool, Form(description="A file of the same name is replaced; plans made from the old one keep it.")
]
LONGEST_CRS_CHARS = 400
FORM_DEPENDENCIES = [Depends(refuse_unknown_form_parts)]
CRS_HELP = "Coordinate system of a file that names none, such as EPSG:25832."
SWAP_AXES_HELP = "The file has latitude or northing first: exchange the two."
LOCAL_METRES_HELP = "The file holds local metres, not longitude and latitude."
UPLOAD_DEFAULT_HELP = " By default as given with the upload."


def build_files_router(path: str) -> APIRouter:
    """The routes of one kind of file."""
    kind = FILE_KIND_BY_PATH[path]
    router = APIRouter(prefix=f"/{path}", tags=[path])
    _add_list_route(router, kind)
    if kind == "field":
        _add_field_upload_route(router)
    else:
        _add_upload_route(router, kind)
    add_file_change_routes(router, kind)
    _add_download_route(router, kind)
    if kind == "field":
        _add_field_summary_route(router)
    else:
        _add_summary_route(router, kind)
    return router


def _add_list_route(router: APIRouter, kind: str) -> None:
    @router.get("", responses=document_errors(401, 403), operation_id=f"list_{kind}s")
    def list_files(request: Request, _who: ReadAccess, search: SearchParameter = "") -> FileList:
        """All of them by name, or those that are searched for; those of Headland first."""
        store: Store = request.app.state.store
        samples = [describe_sample(kind, name) for name in list_samples(kind) if is_found(name, search)]
        return FileList(items=[*samples, *(FileInfo.model_validate(row) for row in store.list_files(kind, search))])


def _add_upload_route(router: APIRouter, kind: str) -> None:
    @router.post(
        "",
        status_code=201,
        responses=document_errors(401, 403, 409, 422),
        operation_id=f"upload_{kind}",
        dependencies=FORM_DEPENDENCIES,
    )
    async def upload_file(
        request: Request,
        caller: PlanAccess,
        file: UploadParameter,
        name: NameParameter = None,
        replace: ReplaceParameter = False,
    ) -> FileInfo:
        """Upload a file. It is read before it is stored, and refused in a sentence if it is not of its kind."""
        return await _store_upload(request, caller, kind, file, name, {}, replace)


def _add_field_upload_route(router: APIRouter) -> None:
    @router.post(
        "",
        status_code=201,
        responses=document_errors(401, 403, 409, 422),
        operation_id="upload_field",
        dependencies=FORM_DEPENDENCIES,
    )
    async def upload_field(
        request: Request,
        who: PlanAccess,
        file: UploadParameter,
        name: NameParameter = None,
        crs: Annotated[str | None, Form(max_length=LONGEST_CRS_CHARS, description=CRS_HELP)] = None,
        swap_axes: Annotated[bool, Form(description=SWAP_AXES_HELP)] = False,
        local: Annotated[bool, Form(description=LOCAL_METRES_HELP)] = False,
        replace: ReplaceParameter = False,
    ) -> FileInfo:
        """Upload a file of fields. It is read before it is stored; later readings use the same options."""
        options: dict[str, Any] = {"crs": (crs or "").strip() or None, "swap_axes": swap_axes, "local": local}
        return await _store_upload(
            request, who, "field", file, name, {key: value for key, value in options.items() if value}, replace
        )


async def _store_upload(
    request: Request,
    caller: Caller,
    kind: str,
    file: UploadFile,
    name: str | None,
    options: dict[str, Any],
    replaces: bool,
) -> FileInfo:
    """Read an uploaded file and store it; raises HeadlandError."""
    store: Store = request.app.state.store
    stem, suffix = _split_filename(file.filename or "", kind)
    stored_name, suffix = refuse_sample_name(kind, name or stem), check_suffix(kind, suffix)
    content = await file.read()
    most_bytes = MEGABYTE_BYTES if kind in HAND_WRITTEN_KINDS else store.settings.upload_bytes
    if len(content) > most_bytes:
        raise TooLargeError(
            f"The file is larger than {most_bytes // MEGABYTE_BYTES} MB; split it or leave something out.",
            parameter="file",
        )
    upload = Upload(kind, stored_name, suffix, content, options, replaces)
    await run_in_threadpool(_check_taken_name, store, caller, upload)
    inputs = await run_in_threadpool(_collect_upload, store, kind, upload.file_path, content)
    await _check_upload(request, caller, kind, upload.file_path, inputs, options)
    return await run_in_threadpool(_store_checked_file, store, caller, upload)


@dataclass(frozen=True)
class Upload:
    """An uploaded file under the name it gets; it `replaces` one of the same name, or is refused."""

    kind: str
    name: str
    suffix: str
    content: bytes
    options: dict[str, Any]
    replaces: bool

    @property
    def file_path(self) -> str:
        """Its path while it is read."""
        return f"{self.kind}/{self.name}{self.suffix}"


def _check_taken_name(store: Store, caller: Caller, upload: Upload) -> None:
    """Raise ScopeError where the upload would change a file of somebody else, ConflictError for a name that is taken.

    This comes before the reading, which may take long.
    """
    try:
        row = store.get_file(upload.kind, upload.name)
    except NotFoundError:
        return
    is_same = row.sha256 == hashlib.sha256(upload.content).hexdigest()
    if is_same and row.options == upload.options and row.suffix == upload.suffix:
        return
    if not is_same and not upload.replaces:
        raise ConflictError(
            f"There is {choose_article(row.kind)} {row.kind} {row.name!r} with other content; replace it or choose "
            "another name.",
            parameter="name",
        )
    find_changeable_file(store, caller, row.kind, row.name)


def _store_checked_file(store: Store, caller: Caller, upload: Upload) -> FileInfo:
    """Store a file that was read; its name is checked again, as somebody may have taken it meanwhile."""
    _check_taken_name(store, caller, upload)
    kind, name, suffix, options = upload.kind, upload.name, upload.suffix, upload.options
    replaced = upload.replaces and any(row.name == name for row in store.list_files(kind))
    if replaced:
        row = store.replace_file(kind, name, upload.content, suffix, options)
    else:
        row = store.add_file(kind, name, upload.content, suffix, options, caller.owner_name)
    store.add_event(None, caller.name, f"{kind} {'replaced' if replaced else 'uploaded'}", {"name": name} | options)
    return FileInfo.model_validate(row)


def _add_download_route(router: APIRouter, kind: str) -> None:
    media = sorted({MEDIA_BY_SUFFIX[suffix].split(";")[0] for suffix in SUFFIXES_BY_KIND[kind]})
    responses = document_errors(401, 403, 404, 422) | {
        200: {"content": {each: {} for each in media}, "description": "The file"}
    }

    @router.get("/{name}", response_class=Response, responses=responses, operation_id=f"read_{kind}")
    def download_file(request: Request, _who: ReadAccess, name: str) -> Response:
        """The uploaded file."""
        if name in list_samples(kind):
            return build_download(
                read_sample(kind, name), MEDIA_BY_SUFFIX[SUFFIXES_BY_KIND[kind][0]], name + SUFFIXES_BY_KIND[kind][0]
            )
        store: Store = request.app.state.store
        row = store.get_file(kind, name)
        return build_download(store.blobs.read_bytes(row.sha256), row.media, row.name + row.suffix)


def _add_summary_route(router: APIRouter, kind: str) -> None:
    @router.get("/{name}/summary", responses=document_errors(401, 403, 404, 422), operation_id=f"sum_up_{kind}")
    async def summarize(request: Request, caller: ReadAccess, name: str) -> dict[str, Any]:
        """A summary of the file."""
        return await _summarize_file(request, caller, kind, name)


def _add_field_summary_route(router: APIRouter) -> None:
    @router.get("/{name}/summary", responses=document_errors(401, 403, 404, 422), operation_id="sum_up_field")
    async def summarize_field(
        request: Request,
        who: ReadAccess,
        name: str,
        key: Annotated[str | None, Query(max_length=100, description="Which of several fields.")] = None,
        local: Annotated[bool | None, Query(description=LOCAL_METRES_HELP + UPLOAD_DEFAULT_HELP)] = None,
        crs: Annotated[
            str | None, Query(max_length=LONGEST_CRS_CHARS, description=CRS_HELP + UPLOAD_DEFAULT_HELP)
        ] = None,
        swap_axes: Annotated[bool | None, Query(description=SWAP_AXES_HELP + UPLOAD_DEFAULT_HELP)] = None,
    ) -> dict[str, Any]:
        """The fields of the file, and the chosen one: area, rings in metres and in degrees, obstacles."""
        options = {"local": local, "crs": crs, "swap_axes": swap_axes}
        given_options = {one: value for one, value in options.items() if value is not None}
        return await _summarize_file(request, who, "field", name, key=key, **given_options)


async def _summarize_file(
    request: Request, caller: Caller, kind: str, name: str, **extra_options: Any
) -> dict[str, Any]:
    reader: FileReader = request.app.state.reader
    file_path, inputs, stored_options = await run_in_threadpool(_find_stored_file, request.app.state.store, kind, name)
    return await reader.summarize_file(
        build_client_queue_key(request, caller), kind, file_path, inputs, **stored_options | extra_options
    )


def _find_stored_file(store: Store, kind: str, name: str) -> tuple[str, InputFiles, dict[str, Any]]:
    """The path of a stored file, the files it needs, and its options; a sample has no path."""
    if name in list_samples(kind):
        return name, {}, {}
    collector, row = InputCollector(store), store.get_file(kind, name)
    file_path = collector.add_file(kind, name, "name")
    return file_path, collector.inputs, dict(row.options)


def _collect_upload(store: Store, kind: str, file_path: str, content: bytes) -> InputFiles:
    """An uploaded file at its path; a farm brings the tractors that it names."""
    collector = InputCollector(store)
    collector.add_bytes(kind, file_path, store.blobs.put_bytes(content), "file")
    return collector.inputs


async def _check_upload(
    request: Request, caller: Caller, kind: str, file_path: str, inputs: InputFiles, options: Mapping[str, Any]
) -> None:
    """Raise HeadlandError for a file that is not of its kind."""
    reader: FileReader = request.app.state.reader
    try:
        await reader.check_upload(build_client_queue_key(request, caller), kind, file_path, inputs, **options)
    except HeadlandError as refusal:
        refusal.parameter = refusal.parameter if refusal.parameter in ("crs", "swap_axes", "local") else "file"
        raise


def _split_filename(filename: str, kind: str) -> tuple[str, str]:
    """Name and ending of an uploaded file; of a path only its last part."""
    file_path = PurePosixPath(filename.replace("\\", "/"))
    suffix = file_path.suffix.lower()
    return (
        (file_path.name.removesuffix(file_path.suffix), suffix)
        if suffix
        else (file_path.name, SUFFIXES_BY_KIND[kind][0])
    )


def build_download(content: bytes, media: str, filename: str, headers: Mapping[str, str] | None = None) -> Response:
    """Bytes as a download with a file name."""
    disposition = f"attachment; filename*=UTF-8''{quote(filename)}"
    return Response(content, media_type=media, headers={"content-disposition": disposition, **(headers or {})})
