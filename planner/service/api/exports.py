"""A plan that a job made, as lines for terminals and maps: what `headland export` writes, as one file."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response

from planner.guidance import form_for, guidance_of
from planner.service.access import Who, needs
from planner.service.api.answers import refusals
from planner.service.api.files import download
from planner.service.store import Store
from reports.guidance.forms import FORMS, written
from reports.guidance.packing import MEDIA as ZIP
from reports.guidance.packing import zipped
from vehicle.plan_file import saved_from_json

Reads = Annotated[Who, Depends(needs("read"))]
To = Annotated[str, Query(max_length=20, description=f"One of {', '.join(form.name for form in FORMS)}.")]
Tractor = Annotated[int | None, Query(description="This tractor alone, counted from 1.")]
Curves = Annotated[
    bool | None, Query(description="Curves too, or straight lines alone; by default as the form has it.")
]
CONTENT: dict[str, object] = {media: {} for media in sorted({ZIP, *(form.media for form in FORMS)})}

router = APIRouter(tags=["plans"])


@router.get(
    "/plans/{id}/results/{name}/export",
    response_class=Response,
    responses=refusals(401, 403, 404, 422)
    | {200: {"content": CONTENT, "description": "The file, or a ZIP of several"}},
    operation_id="export_plan_result",
)
def exported(
    request: Request, _who: Reads, id: str, name: str, to: To, tractor: Tractor = None, curves: Curves = None
) -> Response:
    """Boundary, headland and lines of plan.json, or of another plan of the job, by tractor in driving order."""
    store: Store = request.app.state.store
    row, form = store.result(id, name, "plan"), form_for(to)
    saved = saved_from_json(store.blobs.get(row.sha256).decode("utf-8", "replace"))
    made = written(guidance_of(saved, tractor), form, curves)
    stem = PurePosixPath(row.name).stem
    if made.single:
        return download(next(iter(made.files.values())), form.media, f"{stem}{form.ending}")
    return download(zipped(made.files), ZIP, f"{stem}-{form.name}.zip")
