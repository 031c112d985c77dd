"""Fleets over HTTP: made of plans, started and stopped, recorded."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from planner.scenario import parse_clock
from planner.service.access import Who, needs
from planner.service.api.answers import READS, Answer, refusals
from planner.service.centre.chances import Chances, chances_of
from planner.service.errors import MissingError
from planner.service.links.asyncapi import document
from planner.service.links.converting import next_shown
from planner.service.links.hub import Hub
from planner.service.links.live import LiveFleet
from planner.service.links.recording import log_csv, zipped
from planner.service.links.telling import fleet_told, tractor_told
from planner.service.store import Store
from planner.service.store.base import checked_name

router = APIRouter(tags=["fleets"])
Reader = Annotated[Who, Depends(needs("read"))]
Operator = Annotated[Who, Depends(needs("control"))]
WRITES = refusals(401, 403, 404, 409, 422)
LONGEST_PLAN = 30_000_000
RANKING, FIELDS = "result.json", "field/"


class FleetRequest(BaseModel):
    """A fleet to be made: `plan` is the id of a plan job (with `result`, one of its saved plans) or a saved plan.

    `field` is by default that of the job. `deadline` (hh:mm) is by default that of the plan: the next time that the
    clock shows it.
    """

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(min_length=1, max_length=80)]
    plan: Annotated[str, Field(min_length=1, max_length=LONGEST_PLAN)]
    result: Annotated[str, Field(max_length=120)] = "plan.json"
    field: Annotated[str, Field(max_length=80)] | None = None
    tractor: Annotated[str, Field(max_length=80)] | None = None
    deadline: Annotated[str, Field(max_length=5)] | None = None
    way: Literal["predict", "thesis"] = "predict"
    times: Annotated[float, Field(ge=0.1, le=100.0, allow_inf_nan=False)] = 1.0


class ReplanRequest(BaseModel):
    """Tractors whose tracks the others are to take over; those that have failed in any case."""

    model_config = ConfigDict(extra="forbid")
    without: Annotated[list[Annotated[int, Field(ge=1, le=999)]], Field(max_length=999)] = []


class AcceptRequest(BaseModel):
    """A proposal to be driven."""

    model_config = ConfigDict(extra="forbid")
    proposal: Annotated[int, Field(ge=1)]


class FleetAnswer(Answer):
    """A fleet; `fleet` and `tractors` are as in the last tick, empty for one that could not be taken up again.

    `recorded` is whether its tractors have reported something that can be replayed.
    """

    id: str
    name: str
    created: str
    error: str | None = None
    recorded: bool = False
    fleet: dict[str, Any] = Field(default_factory=dict)
    tractors: list[dict[str, Any]] = Field(default_factory=list)


class FleetList(Answer):
    """All fleets, the oldest first."""

    items: list[FleetAnswer]


class Proposed(Answer):
    """The number of a proposal, which the link shows once it is ready."""

    proposal: int


def _hub(request: Request) -> Hub:
    hub: Hub = request.app.state.hub
    return hub


def _store(request: Request) -> Store:
    store: Store = request.app.state.store
    return store


def _answer(hub: Hub, row: Any) -> FleetAnswer:
    answer = FleetAnswer(id=row.id, name=row.name, created=row.created, error=hub.faults.get(row.id))
    live = hub.fleets.get(row.id)
    if live is None:
        return answer
    now = time.monotonic()
    answer.recorded = max(live.recorder.seen) >= 0
    answer.fleet = fleet_told(live.centre, live.deadline_s(), live.chances)
    answer.tractors = [tractor_told(live.centre, number, now, None) for number in range(live.tractor_count)]
    return answer


@router.get("/fleets", responses=READS)
async def fleets(request: Request, _who: Reader) -> FleetList:
    """All fleets."""
    rows = await run_in_threadpool(_store(request).fleets)
    return FleetList(items=[_answer(_hub(request), row) for row in rows])


@router.post("/fleets", status_code=201, responses=WRITES)
async def new_fleet(request: Request, who: Operator, wanted: FleetRequest) -> FleetAnswer:
    """Make a fleet of a plan; it stands until it is started."""
    store, hub = _store(request), _hub(request)
    checked_name(wanted.name)
    text, chances = await run_in_threadpool(_plan, store, wanted)
    files, kept = await run_in_threadpool(_files, store, wanted)
    deadline_s = None if wanted.deadline is None else next_shown(parse_clock(wanted.deadline, "deadline"))
    settings = {"times": wanted.times, "way": wanted.way, "deadline_s": deadline_s, "files": kept,
                "chances": None if chances is None else asdict(chances)}  # fmt: skip
    live = await hub.create(wanted.name, text, files, settings)
    live.centre.note(who.name, "created", name=wanted.name)
    return _answer(hub, await run_in_threadpool(store.fleet, live.id))


def _plan(store: Store, wanted: FleetRequest) -> tuple[str, Chances | None]:
    """The text of the plan that is meant, with its chances where it is that of a job with draws."""
    if wanted.plan.lstrip().startswith("{"):
        return wanted.plan, None
    result = store.result(wanted.plan, wanted.result, "plan")
    text = store.blobs.get(result.sha256).decode("utf-8", "replace")
    ranking = json.loads(store.blobs.get(store.result(wanted.plan, RANKING, "plan").sha256))
    return text, chances_of(ranking, wanted.result)


def _files(store: Store, wanted: FleetRequest) -> tuple[dict[str, tuple[str, bytes]], dict[str, tuple[str, str]]]:
    """Contents of the files that are named, and how they are named in the store."""
    kept: dict[str, tuple[str, str]] = {}
    for kind, name in (("field", wanted.field), ("tractor", wanted.tractor)):
        if name is not None:
            row = store.file(kind, name)
            kept[kind] = row.suffix, row.sha256
    if wanted.field is None and not wanted.plan.lstrip().startswith("{"):
        # The field that the plan was made for, as it was then; without it nobody knows its boundary.
        for place, sha256 in store.job(wanted.plan, "plan").inputs.items():
            if place.startswith(FIELDS):
                kept["field"] = PurePosixPath(place).suffix, sha256
    return {kind: (suffix, store.blobs.get(sha256)) for kind, (suffix, sha256) in kept.items()}, kept


@router.get("/fleets/{id}", responses=WRITES)
async def fleet(request: Request, _who: Reader, id: str) -> FleetAnswer:
    """One fleet."""
    return _answer(_hub(request), await run_in_threadpool(_store(request).fleet, id))


@router.delete("/fleets/{id}", status_code=204, responses=WRITES)
async def delete(request: Request, _who: Operator, id: str) -> Response:
    """End a fleet and forget it with its recording."""
    await _hub(request).delete(id)
    return Response(status_code=204)


async def _ordered(request: Request, id: str, order: str, who: Who) -> FleetAnswer:
    live = _hub(request).fleet(id)
    now = time.monotonic()
    if order == "start":
        live.centre.start(who.name, now)
    elif order == "stop":
        live.centre.stop_all(who.name, now)
    elif order == "pause":
        live.centre.pause(who.name, None, now)
    else:
        live.centre.resume(who.name, None, now)
    live.flush()
    return _answer(_hub(request), await run_in_threadpool(_store(request).fleet, id))


@router.post("/fleets/{id}/start", responses=WRITES)
async def start(request: Request, who: Operator, id: str) -> FleetAnswer:
    """Everybody drives."""
    return await _ordered(request, id, "start", who)


@router.post("/fleets/{id}/pause", responses=WRITES)
async def pause(request: Request, who: Operator, id: str) -> FleetAnswer:
    """Everybody stands until resumed."""
    return await _ordered(request, id, "pause", who)


@router.post("/fleets/{id}/resume", responses=WRITES)
async def resume(request: Request, who: Operator, id: str) -> FleetAnswer:
    """Everybody goes on."""
    return await _ordered(request, id, "resume", who)


@router.post("/fleets/{id}/stop", responses=WRITES)
async def stop(request: Request, who: Operator, id: str) -> FleetAnswer:
    """Everybody stands, those driven by remote control too."""
    return await _ordered(request, id, "stop", who)


@router.post("/fleets/{id}/replan", status_code=202, responses=WRITES)
async def replan(request: Request, who: Operator, id: str, wanted: ReplanRequest) -> Proposed:
    """Have the rest planned without some tractors."""
    live = _hub(request).fleet(id)
    number = live.replan(who.name, [each - 1 for each in wanted.without])
    live.flush()
    return Proposed(proposal=number)


@router.post("/fleets/{id}/accept", responses=WRITES)
async def accept(request: Request, who: Operator, id: str, wanted: AcceptRequest) -> FleetAnswer:
    """Go on by a proposal that is ready."""
    live = _hub(request).fleet(id)
    live.accept(who.name, wanted.proposal, time.monotonic())
    live.flush()
    return _answer(_hub(request), await run_in_threadpool(_store(request).fleet, id))


@router.get(
    "/fleets/{id}/recording", response_class=Response,
    responses=WRITES | {200: {"content": {"application/zip": {}}, "description": "One log per tractor"}},
)  # fmt: skip
async def recording(request: Request, _who: Reader, id: str) -> Response:
    """What tractors reported, as logs that diagnosis reads; raises MissingError where nothing was."""
    store, hub = _store(request), _hub(request)
    await run_in_threadpool(store.fleet, id)
    live: LiveFleet | None = hub.fleets.get(id)
    if live is not None:
        await hub.keep(live)
    count = live.tractor_count if live is not None else 0
    content = await run_in_threadpool(_zip, store, id, count)
    name = f"fleet-{id}.zip"
    return Response(content, media_type="application/zip",
                    headers={"content-disposition": f'attachment; filename="{name}"'})  # fmt: skip


def _zip(store: Store, id: str, tractors: int) -> bytes:
    logs = []
    for number in range(tractors):
        rows = store.recording(id, number)
        if rows:
            logs.append((f"tractor-{number + 1}.csv", log_csv(rows)))
    if not logs:
        raise MissingError("No tractor of this fleet has reported yet; start it first.", parameter="id")
    return zipped(logs)


@router.get("/asyncapi.json", responses=refusals(401, 403))
async def asyncapi(_who: Reader) -> dict[str, Any]:
    """The frames of the link (AsyncAPI)."""
    return document()
