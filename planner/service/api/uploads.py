"""Routes for uploaded fields, tractors, farms, logs and tables: upload, list, summarise, download, delete."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import PurePosixPath
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, File, Form, Query, Request, Response, UploadFile
from starlette.concurrency import run_in_threadpool

from fields.errors import HeadlandError
from fields.sample_fields import list_sample_names, read_sample_text
from planner.service.access.permissions import Caller, require_right
from planner.service.errors import ConflictError, TooLargeError
from planner.service.gateway.request_gate import refuse_unknown_form_parts
from planner.service.gateway.responses import FileInfo, FileList, document_errors
from planner.service.jobs.file_reading import FileReader, build_client_queue_key
from planner.service.jobs.input_files import InputCollector, InputFiles
from planner.service.settings import MEGABYTE_BYTES
from planner.service.store.file_table import MEDIA_BY_SUFFIX, SUFFIXES_BY_KIND, check_suffix
from planner.service.store.service_store import Store
from planner.service.store.store_part import check_name
from vehicle.model.tractor import list_tractor_names

FILE_KIND_BY_PATH = {"fields": "field", "tractors": "tractor", "farms": "farm", "logs": "log", "tables": "table"}
HAND_WRITTEN_KINDS = ("tractor", "farm")  # they stay small
ReadAccess = Annotated[Caller, Depends(require_right("read"))]
PlanAccess = Annotated[Caller, Depends(require_right("plan"))]
UploadParameter = Annotated[UploadFile, File(description="The file; its ending gives the format.")]
NameParameter = Annotated[str | None, Form(description="Its name here; by default the name of the file.")]
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
    _add_delete_route(router, kind)
    _add_download_route(router, kind)
    if kind == "field":
        _add_field_summary_route(router)
    else:
        _add_summary_route(router, kind)
    return router


def _add_list_route(router: APIRouter, kind: str) -> None:
    @router.get("", responses=document_errors(401, 403), operation_id=f"list_{kind}s")
    def list_files(request: Request, _who: ReadAccess) -> FileList:
        """All of them by name; those of Headland first."""
        store: Store = request.app.state.store
        samples = [_describe_sample(kind, name) for name in _list_samples(kind)]
        return FileList(items=[*samples, *(FileInfo.model_validate(row) for row in store.list_files(kind))])


def _add_upload_route(router: APIRouter, kind: str) -> None:
    @router.post(
        "",
        status_code=201,
        responses=document_errors(401, 403, 409, 422),
        operation_id=f"upload_{kind}",
        dependencies=FORM_DEPENDENCIES,
    )
    async def upload_file(
        request: Request, caller: PlanAccess, file: UploadParameter, name: NameParameter = None
    ) -> FileInfo:
        """Upload a file. It is read before it is stored, and refused in a sentence if it is not of its kind."""
        return await _store_upload(request, caller, kind, file, name, {})


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
    ) -> FileInfo:
        """Upload a file of fields. It is read before it is stored; later readings use the same options."""
        options: dict[str, Any] = {"crs": (crs or "").strip() or None, "swap_axes": swap_axes, "local": local}
        return await _store_upload(
            request, who, "field", file, name, {key: value for key, value in options.items() if value}
        )


async def _store_upload(
    request: Request, caller: Caller, kind: str, file: UploadFile, name: str | None, options: dict[str, Any]
) -> FileInfo:
    """Read an uploaded file and store it; raises HeadlandError."""
    store: Store = request.app.state.store
    stem, suffix = _split_filename(file.filename or "", kind)
    stored_name, suffix = check_name(name or stem), check_suffix(kind, suffix)
    if stored_name in _list_samples(kind):
        raise ConflictError(f"{stored_name!r} comes with Headland; choose another name.", parameter="name")
    content = await file.read()
    most_bytes = MEGABYTE_BYTES if kind in HAND_WRITTEN_KINDS else store.settings.upload_bytes
    if len(content) > most_bytes:
        raise TooLargeError(
            f"The file is larger than {most_bytes // MEGABYTE_BYTES} MB; split it or leave something out.",
            parameter="file",
        )
    file_path = f"{kind}/{stored_name}{suffix}"
    inputs = await run_in_threadpool(_collect_upload, store, kind, file_path, content)
    await _check_upload(request, caller, kind, file_path, inputs, options)
    return await run_in_threadpool(_store_checked_file, store, caller, kind, stored_name, content, suffix, options)


def _store_checked_file(
    store: Store, caller: Caller, kind: str, stored_name: str, content: bytes, suffix: str, options: dict[str, Any]
) -> FileInfo:
    row = store.add_file(kind, stored_name, content, suffix, options)
    store.add_event(None, caller.name, f"{kind} uploaded", {"name": stored_name} | options)
    return FileInfo.model_validate(row)


def _add_delete_route(router: APIRouter, kind: str) -> None:
    @router.delete(
        "/{name}", status_code=204, responses=document_errors(401, 403, 404, 409, 422), operation_id=f"delete_{kind}"
    )
    def delete_file(request: Request, caller: PlanAccess, name: str) -> None:
        """Delete a file; jobs that use it keep their copy."""
        if name in _list_samples(kind):
            raise ConflictError(f"{name!r} comes with Headland and cannot be deleted.", parameter="name")
        request.app.state.store.delete_file(kind, name)
        request.app.state.store.add_event(None, caller.name, f"{kind} deleted", {"name": name})


def _add_download_route(router: APIRouter, kind: str) -> None:
    media = sorted({MEDIA_BY_SUFFIX[suffix].split(";")[0] for suffix in SUFFIXES_BY_KIND[kind]})
    responses = document_errors(401, 403, 404, 422) | {
        200: {"content": {each: {} for each in media}, "description": "The file"}
    }

    @router.get("/{name}", response_class=Response, responses=responses, operation_id=f"read_{kind}")
    def download_file(request: Request, _who: ReadAccess, name: str) -> Response:
        """The uploaded file."""
        if name in _list_samples(kind):
            return build_download(
                _read_sample(kind, name), MEDIA_BY_SUFFIX[SUFFIXES_BY_KIND[kind][0]], name + SUFFIXES_BY_KIND[kind][0]
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
    if name in _list_samples(kind):
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


def _list_samples(kind: str) -> tuple[str, ...]:
    return {"field": list_sample_names, "tractor": list_tractor_names}.get(kind, tuple)()


def _describe_sample(kind: str, name: str) -> FileInfo:
    suffix, content = SUFFIXES_BY_KIND[kind][0], _read_sample(kind, name)
    return FileInfo(
        kind=kind, name=name, suffix=suffix, size=len(content), media=MEDIA_BY_SUFFIX[suffix], created=None, sample=True
    )


def _read_sample(kind: str, name: str) -> bytes:
    if kind == "field":
        return read_sample_text(name).encode()
    return (resources.files("vehicle") / "data" / f"{name}.toml").read_bytes()


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
