"""Fields, tractors, farms, logs, tables: uploaded, listed, summed up, deleted; samples are listed as well."""

from collections.abc import Mapping
from importlib import resources
from pathlib import PurePosixPath
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, File, Form, Query, Request, Response, UploadFile

from fields.errors import HeadlandError
from fields.samples_index import sample_names, sample_text
from planner.service.access import Who, needs
from planner.service.api.answers import FileAnswer, FileList, refusals
from planner.service.api.queries import known_form
from planner.service.errors import SizeError, TakenError
from planner.service.jobs.inputs import Gathering
from planner.service.jobs.reading import Reader
from planner.service.settings import MEGABYTE
from planner.service.store import Store
from planner.service.store.base import checked_name
from planner.service.store.files import MEDIA, SUFFIXES, checked_suffix
from vehicle.tractor import tractor_names

KINDS = {"fields": "field", "tractors": "tractor", "farms": "farm", "logs": "log", "tables": "table"}
TEXTS = ("tractor", "farm")  # which are written by hand
Reads = Annotated[Who, Depends(needs("read"))]
Controls = Annotated[Who, Depends(needs("control"))]
Uploaded = Annotated[UploadFile, File(description="The file; its ending says what it is.")]
Name = Annotated[str | None, Form(description="What it is called here; by default its own name.")]
MOST_CRS = 400
FORM = [Depends(known_form)]
CRS = "Coordinate system of a file that names none, such as EPSG:25832."
SWAP = "The file has latitude or northing first: exchange the two."
LOCAL = "The file holds local metres, not longitude and latitude."
AS_SAID = " As was said when it was uploaded, if not given."


def files_router(path: str) -> APIRouter:
    """The routes of one kind of file."""
    kind = KINDS[path]
    router = APIRouter(prefix=f"/{path}", tags=[path])
    _add_lists(router, kind)
    if kind == "field":
        _add_field_uploads(router)
    else:
        _add_uploads(router, kind)
    _add_deletion(router, kind)
    _add_contents(router, kind)
    if kind == "field":
        _add_field_summary(router)
    else:
        _add_summary(router, kind)
    return router


def _add_lists(router: APIRouter, kind: str) -> None:
    @router.get("", responses=refusals(401, 403), operation_id=f"list_{kind}s")
    def listed(request: Request, _who: Reads) -> FileList:
        """All of them by name; those that come with Headland first."""
        store: Store = request.app.state.store
        own = [_sample(kind, name) for name in _samples(kind)]
        return FileList(items=[*own, *(FileAnswer.model_validate(row) for row in store.files(kind))])


def _add_uploads(router: APIRouter, kind: str) -> None:
    @router.post(
        "", status_code=201, responses=refusals(401, 403, 409, 422), operation_id=f"upload_{kind}", dependencies=FORM
    )
    def uploaded(request: Request, who: Controls, file: Uploaded, name: Name = None) -> FileAnswer:
        """Upload a file. It is read before it is kept, and refused in a sentence if it is not what it should be."""
        return _keep(request, who, kind, file, name, {})


def _add_field_uploads(router: APIRouter) -> None:
    @router.post(
        "", status_code=201, responses=refusals(401, 403, 409, 422), operation_id="upload_field", dependencies=FORM
    )
    def uploaded(
        request: Request,
        who: Controls,
        file: Uploaded,
        name: Name = None,
        crs: Annotated[str | None, Form(max_length=MOST_CRS, description=CRS)] = None,
        swap: Annotated[bool, Form(description=SWAP)] = False,
        local: Annotated[bool, Form(description=LOCAL)] = False,
    ) -> FileAnswer:
        """Upload a file of fields. It is read before it is kept, and so are later what is said of it here."""
        said: dict[str, Any] = {"crs": (crs or "").strip() or None, "swap": swap, "local": local}
        return _keep(request, who, "field", file, name, {key: value for key, value in said.items() if value})


def _keep(
    request: Request, who: Who, kind: str, file: UploadFile, name: str | None, options: dict[str, Any]
) -> FileAnswer:
    """Read an uploaded file and keep it; raises HeadlandError."""
    store: Store = request.app.state.store
    stem, suffix = _taken_apart(file.filename or "", kind)
    called, suffix = checked_name(name or stem), checked_suffix(kind, suffix)
    if called in _samples(kind):
        raise TakenError(f"{called!r} comes with Headland; choose another name.", parameter="name")
    content = file.file.read()
    most = MEGABYTE if kind in TEXTS else store.settings.upload_bytes
    if len(content) > most:
        raise SizeError(f"The file is larger than {most // MEGABYTE} MB; give less in it.", parameter="file")
    _check(request.app.state.reader, store, kind, called + suffix, content, options)
    row = store.add_file(kind, called, content, suffix, options)
    store.add_event(None, who.name, f"{kind} uploaded", {"name": called} | options)
    return FileAnswer.model_validate(row)


def _add_deletion(router: APIRouter, kind: str) -> None:
    @router.delete(
        "/{name}", status_code=204, responses=refusals(401, 403, 404, 409, 422), operation_id=f"delete_{kind}"
    )
    def deleted(request: Request, who: Controls, name: str) -> None:
        """Take a file off the list; jobs that were asked for with it keep it."""
        if name in _samples(kind):
            raise TakenError(f"{name!r} comes with Headland and stays.", parameter="name")
        request.app.state.store.delete_file(kind, name)
        request.app.state.store.add_event(None, who.name, f"{kind} deleted", {"name": name})


def _add_contents(router: APIRouter, kind: str) -> None:
    media = sorted({MEDIA[suffix].split(";")[0] for suffix in SUFFIXES[kind]})
    answers = refusals(401, 403, 404, 422) | {200: {"content": {each: {} for each in media}, "description": "The file"}}

    @router.get("/{name}", response_class=Response, responses=answers, operation_id=f"read_{kind}")
    def content(request: Request, _who: Reads, name: str) -> Response:
        """The file as it was uploaded."""
        if name in _samples(kind):
            return download(_sample_bytes(kind, name), MEDIA[SUFFIXES[kind][0]], name + SUFFIXES[kind][0])
        store: Store = request.app.state.store
        row = store.file(kind, name)
        return download(store.blobs.get(row.sha256), row.media, row.name + row.suffix)


def _add_summary(router: APIRouter, kind: str) -> None:
    @router.get("/{name}/summary", responses=refusals(401, 403, 404, 422), operation_id=f"sum_up_{kind}")
    def summary(request: Request, _who: Reads, name: str) -> dict[str, Any]:
        """What the reader makes of it."""
        return _summary(request, kind, name)


def _add_field_summary(router: APIRouter) -> None:
    @router.get("/{name}/summary", responses=refusals(401, 403, 404, 422), operation_id="sum_up_field")
    def summary(
        request: Request,
        _who: Reads,
        name: str,
        key: Annotated[str | None, Query(max_length=100, description="Which of several fields.")] = None,
        local: Annotated[bool | None, Query(description=LOCAL + AS_SAID)] = None,
        crs: Annotated[str | None, Query(max_length=MOST_CRS, description=CRS + AS_SAID)] = None,
        swap: Annotated[bool | None, Query(description=SWAP + AS_SAID)] = None,
    ) -> dict[str, Any]:
        """The fields in it, and the one that is meant: area, rings in metres and in degrees, what stands in it."""
        said = {"local": local, "crs": crs, "swap": swap}
        given = {one: value for one, value in said.items() if value is not None}
        return _summary(request, "field", name, key=key, **given)


def _summary(request: Request, kind: str, name: str, **more: Any) -> dict[str, Any]:
    reader: Reader = request.app.state.reader
    if name in _samples(kind):
        return reader.summary(kind, name, {}, **more)
    found = Gathering(request.app.state.store)
    row = request.app.state.store.file(kind, name)
    place = found.file(kind, name, "name")
    return reader.summary(kind, place, found.inputs, **row.options | more)


def _check(reader: Reader, store: Store, kind: str, called: str, content: bytes, options: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a file that is not one of its kind; a farm brings the tractors it names."""
    found, place = Gathering(store), f"{kind}/{called}"
    found.add(kind, place, store.blobs.put(content), "file")
    try:
        reader.upload(kind, place, found.inputs, **options)
    except HeadlandError as refusal:
        refusal.parameter = refusal.parameter if refusal.parameter in ("crs", "swap", "local") else "file"
        raise


def _samples(kind: str) -> tuple[str, ...]:
    return {"field": sample_names, "tractor": tractor_names}.get(kind, tuple)()


def _sample(kind: str, name: str) -> FileAnswer:
    suffix, content = SUFFIXES[kind][0], _sample_bytes(kind, name)
    return FileAnswer(
        kind=kind, name=name, suffix=suffix, size=len(content), media=MEDIA[suffix], created=None, sample=True
    )


def _sample_bytes(kind: str, name: str) -> bytes:
    if kind == "field":
        return sample_text(name).encode()
    return (resources.files("vehicle") / "data" / f"{name}.toml").read_bytes()


def _taken_apart(filename: str, kind: str) -> tuple[str, str]:
    """Name and ending of an uploaded file; of a path only its last part."""
    own = PurePosixPath(filename.replace("\\", "/"))
    suffix = own.suffix.lower()
    return (own.name.removesuffix(own.suffix), suffix) if suffix else (own.name, SUFFIXES[kind][0])


def download(content: bytes, media: str, name: str, headers: Mapping[str, str] | None = None) -> Response:
    """Bytes as a file of a name."""
    disposition = f"attachment; filename*=UTF-8''{quote(name)}"
    return Response(content, media_type=media, headers={"content-disposition": disposition, **(headers or {})})
