"""Jobs are submitted here: a request is checked, its input files are collected, and it is queued."""

from __future__ import annotations

import re

from starlette.concurrency import run_in_threadpool

from planner.service.access.permissions import Caller
from planner.service.jobs.file_reading import FileReader
from planner.service.jobs.input_files import collect_inputs
from planner.service.jobs.job_requests import DayJobRequest, DiagnosisJobRequest, JobRequest, PlanJobRequest
from planner.service.store.service_store import Store
from planner.service.store.store_part import LONGEST_NAME_CHARS
from planner.service.store.tables import JobRow
from reports.common.wording import get_effect_label

SHOWN_LOGS = 3  # in the name of a job


async def submit_job(
    store: Store, reader: FileReader, client: str, kind: str, body: JobRequest, caller: Caller
) -> JobRow:
    """Check a request of a client and make it a job; raises HeadlandError, BusyError."""
    if isinstance(body, DayJobRequest | DiagnosisJobRequest):
        await run_in_threadpool(body.check_options)
    values, inputs = await run_in_threadpool(collect_inputs, store, body)
    await reader.read(client, f"check {kind}", inputs, [values])

    def add_job() -> JobRow:
        request = body.model_dump(exclude_unset=True, exclude_none=True, exclude={"name"})
        row = store.add_job(kind, body.name or _choose_job_name(body), request, inputs, values, caller.owner)
        store.add_event(None, caller.name, f"{kind} asked for", {"id": row.id, "name": row.name})
        return row

    return await run_in_threadpool(add_job)


def _choose_job_name(body: JobRequest) -> str:
    """What a job is called by what it reads."""
    words = "day"
    if isinstance(body, PlanJobRequest):
        words = str(dict(body)["field"])
    elif isinstance(body, DiagnosisJobRequest):
        more = len(body.logs) - SHOWN_LOGS
        logs = ", ".join(body.logs[:SHOWN_LOGS]) + (f" and {more} more" if more > 0 else "")
        if body.demo:
            logs = f"hidden {get_effect_label(body.hide)}" if body.hide else f"hidden effect (seed {body.seed or 1})"
        words = f"{logs} against {body.tractor} on {body.ground}"
    words = re.sub(r"[^\w()+-]+", " ", words).strip(" ()+-_")[:LONGEST_NAME_CHARS].strip()
    return words or "job"
