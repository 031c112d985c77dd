"""Routes for uploaded fields, tractors, farms, logs, tables and heights, and for the files that come with Headland.

They are uploaded, listed, summarised, downloaded, renamed, copied and deleted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import PurePosixPath
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, File, Form, Query, Request, Response, UploadFile
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from fields.errors import HeadlandError
from fields.sample_fields import list_sample_names, read_sample_text
from planner.service.access.permissions import Caller, PlanAccess, ReadAccess
from planner.service.errors import ConflictError, NotFoundError, TooLargeError
from planner.service.gateway.request_gate import name_client, refuse_unknown_form_parts
from planner.service.gateway.responses import ApiRequest, ApiRouter, FileInfo, FileList, StoreAccess, document_file
from planner.service.jobs.file_reading import FileReader
from planner.service.jobs.input_files import InputCollector, ShortText, list_tractor_users
from planner.service.settings import MEGABYTE_BYTES
from planner.service.store.disk_storage import hash_bytes
from planner.service.store.service_store import (
    SUFFIXES_BY_KIND,
    Store,
    build_other_content_error,
    build_taken_name_error,
    check_suffix,
)
from planner.service.store.store_part import check_name, choose_copy_name, find_media, is_found
from planner.service.store.tables import FileRow
from vehicle.identification.logs.reader import SAMPLE_LOG, resolve_log_path
from vehicle.model.tractor import list_tractor_names

HAND_WRITTEN_KINDS = ("tractor", "farm")  # they stay small
FIELD_OPTIONS = ("crs", "swap_axes", "local")
SearchParameter = Annotated[
    str, Query(max_length=100, description="Only those whose names have all of these words, in any case.")
]
UploadParameter = Annotated[UploadFile, File(description="The file; its ending gives the format.")]
NameParameter = Annotated[str | None, Form(description="Its name here; by default the name of the file.")]
ReplaceParameter = Annotated[
    bool, Form(description="A file of the same name is replaced; plans made from the old one keep it.")
]
CRS_HELP = "Coordinate system of a file that names none, such as EPSG:25832."
SWAP_AXES_HELP = "The file has latitude or northing first: exchange the two."
LOCAL_METRES_HELP = "The file holds local metres, not longitude and latitude."
UPLOAD_DEFAULT_HELP = " By default as given with the upload."
NewName = Annotated[ShortText, Field(description="Begins with a letter or digit; at most 100 characters.")]


class RenameRequest(ApiRequest):
    """A new name."""

    name: NewName


class CopyRequest(ApiRequest):
    """The name of a copy; by default the old one with "copy" after it."""

    name: NewName | None = None


def build_files_router(kind: str) -> APIRouter:
    """The routes of one kind of file."""
    router = ApiRouter(prefix=f"/{kind}s", tags=[f"{kind}s"])
    _add_read_routes(router, kind)
    _add_change_routes(router, kind)
    if kind == "field":
        upload, summarize = upload_field, summarize_field
    else:
        upload, summarize = _build_plain_routes(kind)
    router.post(
        "", status_code=201, operation_id=f"upload_{kind}",
        dependencies=[Depends(refuse_unknown_form_parts)],
    )(upload)  # fmt: skip
    router.get("/{name}/summary", operation_id=f"sum_up_{kind}")(summarize)
    return router


def _add_read_routes(router: APIRouter, kind: str) -> None:
    @router.get("", operation_id=f"list_{kind}s")
    def list_files(store: StoreAccess, _who: ReadAccess, search: SearchParameter = "") -> FileList:
        """All of them by name, or those that are searched for; those of Headland first."""
        suffix = SUFFIXES_BY_KIND[kind][0]
        describe = partial(FileInfo, kind=kind, suffix=suffix, media=find_media(suffix), created=None, sample=True)
        names = (name for name in list_samples(kind) if is_found(name, search))
        samples = [describe(name=name, size=len(_read_sample(kind, name))) for name in names]
        return FileList(items=[*samples, *(FileInfo.model_validate(row) for row in store.list_files(kind, search))])

    file_answer = document_file("The file", {find_media(each).split(";")[0] for each in SUFFIXES_BY_KIND[kind]})

    @router.get("/{name}", response_class=Response, responses=file_answer, operation_id=f"read_{kind}")
    def download_file(store: StoreAccess, _who: ReadAccess, name: str) -> Response:
        """The uploaded file."""
        if name in list_samples(kind):
            suffix = SUFFIXES_BY_KIND[kind][0]
            return build_download(_read_sample(kind, name), find_media(suffix), name + suffix)
        row = store.get_file(kind, name)
        return build_download(store.blobs.read_bytes(row.sha256), row.media, row.name + row.suffix)


def _add_change_routes(router: APIRouter, kind: str) -> None:
    @router.patch("/{name}", operation_id=f"rename_{kind}")
    def rename_file(store: StoreAccess, caller: PlanAccess, name: str, body: RenameRequest) -> FileInfo:
        """Rename a file. Plans, days and diagnoses keep what they were asked for with."""
        _check_may_move(store, caller, kind, name)
        row = store.rename_file(kind, name, _refuse_sample_name(kind, body.name))
        store.add_event(None, caller.name, f"{kind} renamed", {"name": name, "to": row.name})
        return FileInfo.model_validate(row)

    @router.post("/{name}/copy", status_code=201, operation_id=f"copy_{kind}")
    def copy_file(store: StoreAccess, caller: PlanAccess, name: str, body: CopyRequest) -> FileInfo:
        """Copy a file, or one that comes with Headland; the copy belongs to who makes it."""
        taken = {*list_samples(kind), *(row.name for row in store.list_files(kind))}
        copy_name = choose_copy_name(name, taken) if body.name is None else _refuse_sample_name(kind, body.name)
        if copy_name in taken:
            raise build_taken_name_error(kind, copy_name)
        if name in list_samples(kind):
            row = store.add_file(kind, copy_name, _read_sample(kind, name), owner=caller.owner)
        else:
            source = store.get_file(kind, name)
            content = store.blobs.read_bytes(source.sha256)
            row = store.add_file(kind, copy_name, content, source.suffix, source.options, caller.owner)
        store.add_event(None, caller.name, f"{kind} copied", {"name": name, "to": row.name})
        return FileInfo.model_validate(row)

    @router.delete("/{name}", status_code=204, operation_id=f"delete_{kind}")
    def delete_file(store: StoreAccess, caller: PlanAccess, name: str) -> None:
        """Delete a file; jobs that use it keep their copy."""
        _check_may_move(store, caller, kind, name)
        store.delete_file(kind, name)
        store.add_event(None, caller.name, f"{kind} deleted", {"name": name})


def _build_plain_routes(kind: str) -> tuple[Any, Any]:
    """How files other than fields are uploaded and summarised: without options."""

    async def upload_file(
        request: Request,
        caller: PlanAccess,
        file: UploadParameter,
        name: NameParameter = None,
        replace: ReplaceParameter = False,
    ) -> FileInfo:
        """Upload a file. It is read before it is stored, and refused in a sentence if it is not of its kind."""
        return await _store_upload(request, caller, kind, file, name, {}, replaces=replace)

    async def summarize(request: Request, _who: ReadAccess, name: str) -> dict[str, Any]:
        """A summary of the file."""
        return await _summarize_file(request, kind, name)

    return upload_file, summarize


async def upload_field(
    request: Request,
    who: PlanAccess,
    file: UploadParameter,
    name: NameParameter = None,
    crs: Annotated[ShortText | None, Form(description=CRS_HELP)] = None,
    swap_axes: Annotated[bool, Form(description=SWAP_AXES_HELP)] = False,
    local: Annotated[bool, Form(description=LOCAL_METRES_HELP)] = False,
    replace: ReplaceParameter = False,
) -> FileInfo:
    """Upload a file of fields. It is read before it is stored; later readings use the same options."""
    values: dict[str, Any] = {"crs": (crs or "").strip(), "swap_axes": swap_axes, "local": local}
    options = {key: value for key, value in values.items() if value}
    return await _store_upload(request, who, "field", file, name, options, replaces=replace)


async def summarize_field(
    request: Request,
    _who: ReadAccess,
    name: str,
    key: Annotated[str | None, Query(max_length=100, description="Which of several fields.")] = None,
    local: Annotated[bool | None, Query(description=LOCAL_METRES_HELP + UPLOAD_DEFAULT_HELP)] = None,
    crs: Annotated[ShortText | None, Query(description=CRS_HELP + UPLOAD_DEFAULT_HELP)] = None,
    swap_axes: Annotated[bool | None, Query(description=SWAP_AXES_HELP + UPLOAD_DEFAULT_HELP)] = None,
) -> dict[str, Any]:
    """The fields of the file, and the chosen one: area, rings in metres and in degrees, obstacles."""
    options = {"local": local, "crs": crs, "swap_axes": swap_axes}
    given_options = {one: value for one, value in options.items() if value is not None}
    return await _summarize_file(request, "field", name, key=key, **given_options)


@dataclass(frozen=True)
class Upload:
    """An uploaded file under the name it gets; it `replaces` one of the same name, or is refused."""

    kind: str
    name: str
    suffix: str
    content: bytes
    options: dict[str, Any]
    replaces: bool


async def _store_upload(
    request: Request,
    caller: Caller,
    kind: str,
    file: UploadFile,
    name: str | None,
    options: dict[str, Any],
    *,
    replaces: bool,
) -> FileInfo:
    """Read an uploaded file and store it; of a path only the last part is its name. Raises HeadlandError."""
    store: Store = request.app.state.store
    reader: FileReader = request.app.state.reader
    file_path = PurePosixPath((file.filename or "").replace("\\", "/"))
    stored_name = _refuse_sample_name(kind, name or file_path.name.removesuffix(file_path.suffix))
    suffix = check_suffix(kind, file_path.suffix.lower() or SUFFIXES_BY_KIND[kind][0])
    upload = Upload(kind, stored_name, suffix, await file.read(), options, replaces)
    most_bytes = MEGABYTE_BYTES if kind in HAND_WRITTEN_KINDS else store.settings.upload_bytes
    if len(upload.content) > most_bytes:
        raise TooLargeError(
            f"The file is larger than {most_bytes // MEGABYTE_BYTES} MB; split it or leave something out.",
            parameter="file",
        )
    await run_in_threadpool(_find_named_file, store, caller, upload)  # before the reading, which may take long
    collector, read_path = InputCollector(store), f"{kind}/{stored_name}{suffix}"
    await run_in_threadpool(collector.add_content, kind, read_path, upload.content, "file")
    try:
        await reader.read(name_client(request.scope), f"upload {kind}", collector.inputs, [read_path], options)
    except HeadlandError as refusal:
        refusal.parameter = refusal.parameter if refusal.parameter in FIELD_OPTIONS else "file"
        raise
    return await run_in_threadpool(_store_checked_file, store, caller, upload)


def _find_named_file(store: Store, caller: Caller, upload: Upload) -> FileRow | None:
    """The file that has the name of an upload; None where there is none.

    Raises ScopeError where the upload would change a file of somebody else, ConflictError for a name that is taken.
    """
    try:
        row = store.get_file(upload.kind, upload.name)
    except NotFoundError:
        return None
    is_same = row.sha256 == hash_bytes(upload.content)
    if not is_same and not upload.replaces:
        raise build_other_content_error(row.kind, row.name)
    if not is_same or row.options != upload.options or row.suffix != upload.suffix:
        caller.check_may_change(row, f"The {row.kind} {row.name!r}")
    return row


def _store_checked_file(store: Store, caller: Caller, upload: Upload) -> FileInfo:
    """Store a file that was read; its name is checked again, as somebody may have taken it meanwhile."""
    kind, name, suffix, options = upload.kind, upload.name, upload.suffix, upload.options
    replaced = _find_named_file(store, caller, upload) is not None and upload.replaces
    if replaced:
        row = store.replace_file(kind, name, upload.content, suffix, options)
    else:
        row = store.add_file(kind, name, upload.content, suffix, options, caller.owner)
    store.add_event(None, caller.name, f"{kind} {'replaced' if replaced else 'uploaded'}", {"name": name} | options)
    return FileInfo.model_validate(row)


async def _summarize_file(request: Request, kind: str, name: str, **options: Any) -> dict[str, Any]:
    """The summary of a sample or a stored file, which is read as given with its upload where nothing else is said."""
    store: Store = request.app.state.store
    reader: FileReader = request.app.state.reader
    collector, file_path = InputCollector(store), name
    if name not in list_samples(kind):
        row = await run_in_threadpool(store.get_file, kind, name)
        file_path, options = await run_in_threadpool(collector.add_file, kind, name, "name"), row.options | options
    summary: dict[str, Any] = await reader.read(
        name_client(request.scope), f"summary {kind}", collector.inputs, [file_path], options, is_shared=True
    )
    return summary


def _check_may_move(store: Store, caller: Caller, kind: str, name: str) -> None:
    """Raise NotFoundError, ScopeError or ConflictError where the caller may not take a file away from its name.

    ConflictError is for a file of Headland, and for a tractor that farms or fleets name.
    """
    if name in list_samples(kind):
        raise ConflictError(f"{name!r} comes with Headland and cannot be changed; copy it.", parameter="name")
    row = store.get_file(kind, name)
    caller.check_may_change(row, f"The {kind} {row.name!r}")
    users = list_tractor_users(store, name) if kind == "tractor" else []
    if users:
        more = f" and {len(users) - 1} more" if len(users) > 1 else ""
        raise ConflictError(f"The tractor {name!r} is used by {users[0]}{more}; change that first.", parameter="name")


def _refuse_sample_name(kind: str, name: str) -> str:
    """A checked name; raises ServiceError, or ConflictError for the name of a file of Headland."""
    checked_name = check_name(name)
    if checked_name in list_samples(kind):
        raise ConflictError(f"{checked_name!r} comes with Headland; choose another name.", parameter="name")
    return checked_name


def list_samples(kind: str) -> tuple[str, ...]:
    """Names of the files of a kind that come with Headland."""
    if kind == "log":
        return (SAMPLE_LOG,)
    return {"field": list_sample_names, "tractor": list_tractor_names}.get(kind, tuple)()


def _read_sample(kind: str, name: str) -> bytes:
    """The bytes of a file that comes with Headland."""
    if kind == "field":
        return read_sample_text(name).encode()
    if kind == "log":
        return resolve_log_path(name).read_bytes()
    return (resources.files("vehicle") / "data" / f"{name}.toml").read_bytes()


def build_download(content: bytes, media: str, filename: str) -> Response:
    """Bytes as a download with a file name."""
    disposition = f"attachment; filename*=UTF-8''{quote(filename)}"
    return Response(content, media_type=media, headers={"content-disposition": disposition})
