"""Routes that change the library: rename, copy and delete uploaded files; and the files that come with Headland."""

from __future__ import annotations

from importlib import resources
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request
from pydantic import BaseModel, ConfigDict, Field

from fields.sample_fields import list_sample_names, read_sample_text
from planner.service.access.permissions import Caller, require_right
from planner.service.errors import ConflictError
from planner.service.gateway.responses import FileInfo, document_errors
from planner.service.jobs.input_files import list_tractor_users
from planner.service.store.file_table import MEDIA_BY_SUFFIX, SUFFIXES_BY_KIND
from planner.service.store.service_store import Store
from planner.service.store.store_part import check_name, choose_copy_name
from planner.service.store.tables import FileRow
from vehicle.identification.logs.reader import SAMPLE_LOG, resolve_log_path
from vehicle.model.tractor import list_tractor_names

PlanAccess = Annotated[Caller, Depends(require_right("plan"))]
SearchParameter = Annotated[
    str, Query(max_length=100, description="Only those whose names have all of these words, in any case.")
]
NewName = Annotated[str, Field(max_length=400, description="Begins with a letter or digit; at most 100 characters.")]


class RenameRequest(BaseModel):
    """A new name."""

    model_config = ConfigDict(extra="forbid")
    name: NewName


class CopyRequest(BaseModel):
    """The name of a copy; by default the old one with "copy" after it."""

    model_config = ConfigDict(extra="forbid")
    name: NewName | None = None


def add_file_change_routes(router: APIRouter, kind: str) -> None:
    """Add the routes that rename, copy and delete files of a kind."""

    @router.patch("/{name}", responses=document_errors(401, 403, 404, 409, 422), operation_id=f"rename_{kind}")
    def rename_file(request: Request, caller: PlanAccess, name: str, body: RenameRequest) -> FileInfo:
        """Rename a file. Plans, days and diagnoses keep what they were asked for with."""
        store: Store = request.app.state.store
        find_changeable_file(store, caller, kind, name)
        _refuse_used_tractor(store, kind, name)
        row = store.rename_file(kind, name, refuse_sample_name(kind, body.name))
        store.add_event(None, caller.name, f"{kind} renamed", {"name": name, "to": row.name})
        return FileInfo.model_validate(row)

    @router.post(
        "/{name}/copy",
        status_code=201,
        responses=document_errors(401, 403, 404, 409, 422),
        operation_id=f"copy_{kind}",
    )
    def copy_file(request: Request, caller: PlanAccess, name: str, body: CopyRequest) -> FileInfo:
        """Copy a file, or one that comes with Headland; the copy belongs to who makes it."""
        store: Store = request.app.state.store
        row = _copy_file(store, caller, kind, name, body.name)
        store.add_event(None, caller.name, f"{kind} copied", {"name": name, "to": row.name})
        return FileInfo.model_validate(row)

    @router.delete(
        "/{name}", status_code=204, responses=document_errors(401, 403, 404, 409, 422), operation_id=f"delete_{kind}"
    )
    def delete_file(request: Request, caller: PlanAccess, name: str) -> None:
        """Delete a file; jobs that use it keep their copy."""
        store: Store = request.app.state.store
        find_changeable_file(store, caller, kind, name)
        _refuse_used_tractor(store, kind, name)
        store.delete_file(kind, name)
        store.add_event(None, caller.name, f"{kind} deleted", {"name": name})


def find_changeable_file(store: Store, caller: Caller, kind: str, name: str) -> FileRow:
    """A file that the caller may change.

    Raises NotFoundError, ConflictError for a file of Headland, ScopeError for one of somebody else.
    """
    if name in list_samples(kind):
        raise ConflictError(f"{name!r} comes with Headland and cannot be changed; copy it.", parameter="name")
    row = store.get_file(kind, name)
    caller.check_may_change(row.owner, f"The {kind} {row.name!r}")
    return row


def refuse_sample_name(kind: str, name: str) -> str:
    """A checked name; raises ServiceError, or ConflictError for the name of a file of Headland."""
    checked_name = check_name(name)
    if checked_name in list_samples(kind):
        raise ConflictError(f"{checked_name!r} comes with Headland; choose another name.", parameter="name")
    return checked_name


def _copy_file(store: Store, caller: Caller, kind: str, name: str, new_name: str | None) -> FileRow:
    """A copy of a file or a sample under a name that is free."""
    taken = {*list_samples(kind), *(row.name for row in store.list_files(kind))}
    chosen_name = choose_copy_name(name, taken) if new_name is None else refuse_sample_name(kind, new_name)
    if chosen_name in taken:
        raise ConflictError(f"There is a {kind} {chosen_name!r} already; choose another name.", parameter="name")
    if name in list_samples(kind):
        return store.add_file(kind, chosen_name, read_sample(kind, name), owner=caller.owner_name)
    row = store.get_file(kind, name)
    content = store.blobs.read_bytes(row.sha256)
    return store.add_file(kind, chosen_name, content, row.suffix, row.options, caller.owner_name)


def _refuse_used_tractor(store: Store, kind: str, name: str) -> None:
    """Raise ConflictError for a tractor that farms or fleets name."""
    users = list_tractor_users(store, name) if kind == "tractor" else []
    if users:
        more = f" and {len(users) - 1} more" if len(users) > 1 else ""
        raise ConflictError(f"The tractor {name!r} is used by {users[0]}{more}; change that first.", parameter="name")


def list_samples(kind: str) -> tuple[str, ...]:
    """Names of the files of a kind that come with Headland."""
    if kind == "log":
        return (SAMPLE_LOG,)
    return {"field": list_sample_names, "tractor": list_tractor_names}.get(kind, tuple)()


def describe_sample(kind: str, name: str) -> FileInfo:
    """A file that comes with Headland, as an answer."""
    suffix, content = SUFFIXES_BY_KIND[kind][0], read_sample(kind, name)
    values: dict[str, Any] = {"kind": kind, "name": name, "suffix": suffix, "media": MEDIA_BY_SUFFIX[suffix]}
    return FileInfo(**values, size=len(content), created=None, sample=True)


def read_sample(kind: str, name: str) -> bytes:
    """The bytes of a file that comes with Headland."""
    if kind == "field":
        return read_sample_text(name).encode()
    if kind == "log":
        return resolve_log_path(name).read_bytes()
    return (resources.files("vehicle") / "data" / f"{name}.toml").read_bytes()
