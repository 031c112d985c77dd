"""Twins over HTTP: where they are, how they were corrected, what is wrong with them, and taking that into the file."""

from __future__ import annotations

import math
import secrets
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Depends, Path, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from planner.service.access import Who, needs
from planner.service.api.answers import READS, Answer, refusals
from planner.service.links.diagnosing import FINDING, Diagnosing
from planner.service.links.hub import Hub
from planner.service.links.live import LiveFleet
from vehicle.twin.twin import Twin

router = APIRouter(tags=["twins"])
Reader = Annotated[Who, Depends(needs("read"))]
Operator = Annotated[Who, Depends(needs("control"))]
Number = Annotated[int, Path(ge=1, le=999)]
WRITES = refusals(401, 403, 404, 409, 422)
SHOWN = 600  # corrections, ten minutes of them


class TwinAnswer(Answer):
    """A twin. Its `state` is null before its tractor has reported; `diagnosis` is the job that was asked for last.

    `finding` is what that found once it is over: the ids of `named` effects, `words`, and whether it `mends` the file
    of the tractor, or found nothing that could be taken into it.
    """

    fleet: str
    tractor: int
    way: str
    state: dict[str, float] | None = None
    error_m: float | None = None
    error_deg: float | None = None
    corrections: dict[str, list[float]] = Field(default_factory=dict)
    doubt: dict[str, Any] | None = None
    diagnosis: dict[str, Any] | None = None
    finding: dict[str, Any] | None = None


class TwinList(Answer):
    """All twins."""

    items: list[TwinAnswer]


class MendRequest(BaseModel):
    """What the new tractor file is to be called."""

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(min_length=1, max_length=80)] | None = None


class Mended(Answer):
    """The new tractor file."""

    tractor: str


def _fleet(request: Request, id: str, number: int) -> LiveFleet:
    hub: Hub = request.app.state.hub
    live = hub.fleet(id)
    live.centre.check_number(number - 1)
    return live


def _diagnosing(request: Request) -> Diagnosing:
    diagnosing: Diagnosing = request.app.state.diagnosing
    return diagnosing


def _answer(live: LiveFleet, number: int, *, whole: bool) -> TwinAnswer:
    told, twin = live.twins.told(number - 1), live.twins.items[number - 1]
    answer = TwinAnswer(
        fleet=live.id, tractor=number, way=live.twins.way, state=told.get("twin"), error_m=told.get("error_m"),
        error_deg=told.get("error_deg"), finding=live.findings.get(number - 1),
    )  # fmt: skip
    if twin is not None:
        doubt = twin.doubt()
        answer.doubt = None if doubt is None else {
            "since_s": round(doubt.since_s, 1), "like": doubt.like, "amount": round(doubt.amount, 4),
            "times": round(doubt.times, 2), "words": doubt.words,
        }  # fmt: skip
        if whole:
            answer.corrections = _corrections(twin)
    return answer


def _corrections(twin: Twin) -> dict[str, list[float]]:
    columns = {name: values[-SHOWN:] for name, values in twin.corrections.items()}
    columns["heading_deg"] = np.degrees(columns.pop("heading_rad"))
    return {name: [round(float(v), 4) for v in values if math.isfinite(v)] for name, values in columns.items()}


@router.get("/twins", responses=READS)
async def twins(request: Request, _who: Reader) -> TwinList:
    """All twins, without their corrections."""
    hub: Hub = request.app.state.hub
    items = [_answer(live, number, whole=False) for live in hub.fleets.values()
             for number in range(1, live.tractor_count + 1)]  # fmt: skip
    return TwinList(items=items)


@router.get("/twins/{fleet}/{tractor}", responses=WRITES)
async def twin(request: Request, _who: Reader, fleet: str, tractor: Number) -> TwinAnswer:
    """One twin with its last corrections."""
    live = _fleet(request, fleet, tractor)
    answer = _answer(live, tractor, whole=True)
    answer.diagnosis = await run_in_threadpool(_diagnosing(request).job, live, tractor - 1)
    return answer


@router.post("/twins/{fleet}/{tractor}/diagnose", status_code=202, responses=WRITES)
async def diagnose(request: Request, who: Operator, fleet: str, tractor: Number) -> TwinAnswer:
    """Have what was recorded of a tractor diagnosed, as a job."""
    live = _fleet(request, fleet, tractor)
    hub: Hub = request.app.state.hub
    await hub.keep(live)
    await _diagnosing(request).begin(live, tractor - 1, who)
    live.flush()
    answer = _answer(live, tractor, whole=False)
    answer.diagnosis = await run_in_threadpool(_diagnosing(request).job, live, tractor - 1)
    return answer


@router.post("/twins/{fleet}/{tractor}/mend", status_code=201, responses=WRITES)
async def mend(request: Request, who: Operator, fleet: str, tractor: Number, wanted: MendRequest) -> Mended:
    """Take what the diagnosis found into a new tractor file; the twin is one of that from now on."""
    live = _fleet(request, fleet, tractor)
    name = wanted.name or f"{live.name[:40]} tractor {tractor} mended {secrets.token_hex(2)}"
    made = await run_in_threadpool(_diagnosing(request).mended, live, tractor - 1, name)
    live.twins.mended(tractor - 1, made)
    live.mended[tractor - 1] = name
    if tractor - 1 in live.findings:
        live.findings[tractor - 1] |= {"mends": False}
    live.centre.alarms.ended(FINDING, tractor - 1)
    live.centre.note(who.name, "mend", tractor=tractor, file=name)
    live.flush()
    return Mended(tractor=name)
