"""Fleets over HTTP: create, start, stop, replan; the AsyncAPI 3.0 document of their links; recordings."""

from __future__ import annotations

import re
import time
from functools import lru_cache
from typing import Annotated, Any, get_args

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, ConfigDict, Field
from pydantic.json_schema import models_json_schema
from starlette.concurrency import run_in_threadpool

from planner.fleet.session import inbound_frames, outbound_messages
from planner.fleet.session.frame_content import build_tick_fleet, build_tick_tractor
from planner.fleet.session.state_recorder import format_log_csv, zip_logs
from planner.service.access.permissions import Caller, OperateAccess, OwnReadAccess, ReadAccess, require_right
from planner.service.errors import NotFoundError
from planner.service.fleets.fleet_creation import FleetRequest, build_requested_fleet
from planner.service.fleets.fleet_sessions import FleetLabel, FleetSessions
from planner.service.gateway.bodies import BODIES_FOLDER, spool_body
from planner.service.gateway.request_gate import LARGE_BODY_KEY
from planner.service.gateway.responses import (
    CHANGE_ERRORS,
    ITEM_ERRORS,
    LIST_ERRORS,
    READ_ROUTE_ERRORS,
    ApiModel,
    document_file,
)
from planner.service.store.service_store import Store

INBOUND_FRAMES: tuple[type[inbound_frames.InboundFrame], ...] = (
    inbound_frames.ConnectFrame,
    inbound_frames.StateFrame,
    *get_args(inbound_frames.OrderFrame),
    inbound_frames.DisconnectFrame,
)
SCHEMA_REFERENCE = "#/components/schemas/{model}"
ROLES_TEXT = (
    "The first frame is connect. A tractor sends state, obstacle and disconnect; operators (control) all other frames; "
    "viewers and twins send only disconnect. Operators need a token of the scope operator, a tractor a token of the "
    "scope robot made for it, in the header Authorization or in connect. An unusable frame is answered with refused "
    "and changes nothing, except an obstacle of a tractor: that tractor stands until an operator has looked or it "
    "sends a readable one."
)
FleetReader = Annotated[Caller, Depends(require_right("read", fleet_parameter="id"))]
JSON_TYPE = "application/json"
REQUEST_BODY = {"required": True, "content": {JSON_TYPE: {"schema": FleetRequest.model_json_schema()}}}
RECORDING_PATH = re.compile(r"/api/v1/fleets/([^/]+)/recording/?")
RECORDING_ANSWERS = ITEM_ERRORS | document_file("One log per tractor", ["application/zip"])


@lru_cache(maxsize=1)
def build_asyncapi_document() -> dict[str, Any]:
    """The AsyncAPI document as plain values."""
    outbound = outbound_messages.list_outbound_messages()
    models = (*INBOUND_FRAMES, *outbound)
    _, schemas = models_json_schema([(model, "validation") for model in models], ref_template=SCHEMA_REFERENCE)
    messages = {model.__name__: _describe_message(model) for model in models}
    return {
        "asyncapi": "3.0.0",
        "info": {"title": "Headland fleet link", "version": str(inbound_frames.VERSION), "description": ROLES_TEXT},
        "defaultContentType": "application/json",
        "channels": {
            "link": {
                "address": "/api/v1/fleets/{id}/link",
                "parameters": {"id": {"description": "The id of a fleet."}},
                "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in messages},
            }
        },
        "operations": {
            "send": _describe_operation("receive", INBOUND_FRAMES, "Frames that clients send."),
            "receive": _describe_operation("send", outbound, "Frames that the service sends."),
        },
        "components": {"messages": messages, "schemas": schemas["$defs"]},
    }


def _describe_message(model: type[Any]) -> dict[str, Any]:
    kind = model.model_fields["kind"]
    word = kind.default if isinstance(kind.default, str) else get_args(kind.annotation)[0]
    payload = {"$ref": SCHEMA_REFERENCE.format(model=model.__name__)}
    return {"name": word, "title": model.__name__, "summary": (model.__doc__ or "").strip(), "payload": payload}


def _describe_operation(action: str, models: tuple[type[Any], ...], summary: str) -> dict[str, Any]:
    return {
        "action": action,
        "summary": summary,
        "channel": {"$ref": "#/channels/link"},
        "messages": [{"$ref": f"#/channels/link/messages/{model.__name__}"} for model in models],
    }


fleet_router = APIRouter(tags=["fleets"])


class ReplanRequest(BaseModel):
    """Tractors that are left out; failed ones always are. The others take over, with `goes_on` all is planned anew."""

    model_config = ConfigDict(extra="forbid")
    without: Annotated[list[Annotated[int, Field(ge=1, le=999)]], Field(max_length=999)] = []
    goes_on: bool = False


class AcceptRequest(BaseModel):
    """The proposal to accept."""

    model_config = ConfigDict(extra="forbid")
    proposal: Annotated[int, Field(ge=1)]


class FleetAnswer(ApiModel):
    """A fleet; `fleet` and `tractors` are as in the last tick, empty for one that could not be restored.

    `recorded` is whether there is a recording to replay, `videos` are addresses of video by tractor.
    """

    id: str
    name: str
    created: str
    error: str | None = None
    recorded: bool = False
    fleet: dict[str, Any] = Field(default_factory=dict)
    tractors: list[dict[str, Any]] = Field(default_factory=list)
    videos: dict[int, str] = Field(default_factory=dict)


class FleetList(ApiModel):
    """All fleets, the oldest first."""

    items: list[FleetAnswer]


class ProposalAnswer(ApiModel):
    """The number of a proposal; the link sends it once it is ready."""

    proposal: int


def _get_sessions(request: Request) -> FleetSessions:
    sessions: FleetSessions = request.app.state.hub
    return sessions


def _build_answer(sessions: FleetSessions, label: FleetLabel) -> FleetAnswer:
    """A fleet from memory: answers do not wait for the database."""
    answer = FleetAnswer(id=label.id, name=label.name, created=label.created, error=sessions.faults.get(label.id))
    session = sessions.by_id.get(label.id)
    if session is None:
        return answer
    now = time.monotonic()
    answer.videos = sessions.videos.get_addresses(label.id)
    answer.recorded = max(session.recorder.received) >= 0
    answer.fleet = build_tick_fleet(session.manager, session.compute_deadline_s(), session.finish_distribution)
    answer.tractors = [
        build_tick_tractor(session.manager, number, now, None) for number in range(session.tractor_count)
    ]
    return answer


@fleet_router.get("/fleets", responses=READ_ROUTE_ERRORS)
async def list_fleets(request: Request, who: OwnReadAccess) -> FleetList:
    """All fleets; a robot sees only its own."""
    sessions = _get_sessions(request)
    labels = sorted(sessions.labels.values(), key=lambda label: (label.created, label.id))
    return FleetList(items=[_build_answer(sessions, label) for label in labels if who.can_see_fleet(label.id)])


@fleet_router.post(
    "/fleets",
    status_code=201,
    responses=CHANGE_ERRORS,
    openapi_extra={LARGE_BODY_KEY: True, "requestBody": REQUEST_BODY},
)
async def create_fleet(request: Request, who: OperateAccess) -> FleetAnswer:
    """Create a fleet from a plan; it stands until it is started."""
    state, sessions = request.app.state, _get_sessions(request)
    async with spool_body(request.stream(), state.settings.data / BODIES_FOLDER) as path:
        session = await sessions.create_session(build_requested_fleet, state.settings, path)
    session.manager.log_event(who.name, "created", name=session.name)
    return _build_answer(sessions, sessions.get_label(session.id))


@fleet_router.get("/fleets/{id}", responses=CHANGE_ERRORS)
async def get_fleet(request: Request, _who: FleetReader, id: str) -> FleetAnswer:
    """One fleet."""
    return _build_answer(_get_sessions(request), _get_sessions(request).get_label(id))


@fleet_router.delete("/fleets/{id}", status_code=204, responses=CHANGE_ERRORS)
async def delete_fleet(request: Request, _who: OperateAccess, id: str) -> Response:
    """Stop and delete a fleet with its recording."""
    await _get_sessions(request).delete(id)
    return Response(status_code=204)


@fleet_router.post("/fleets/{id}/start", responses=CHANGE_ERRORS)
async def start_fleet(request: Request, who: OperateAccess, id: str) -> FleetAnswer:
    """Start all tractors."""
    session = _get_sessions(request).get_session(id)
    session.manager.operators.start_fleet_work(who.name, time.monotonic())
    return _send_and_answer(request, id)


@fleet_router.post("/fleets/{id}/pause", responses=CHANGE_ERRORS)
async def pause_fleet(request: Request, who: OperateAccess, id: str) -> FleetAnswer:
    """Pause all tractors until they are resumed."""
    session = _get_sessions(request).get_session(id)
    session.manager.operators.pause_tractors(who.name, None, time.monotonic())
    return _send_and_answer(request, id)


@fleet_router.post("/fleets/{id}/resume", responses=CHANGE_ERRORS)
async def resume_fleet(request: Request, who: OperateAccess, id: str) -> FleetAnswer:
    """Resume all tractors."""
    session = _get_sessions(request).get_session(id)
    session.manager.operators.resume_tractors(who.name, None, time.monotonic())
    return _send_and_answer(request, id)


@fleet_router.post("/fleets/{id}/stop", responses=CHANGE_ERRORS)
async def stop_fleet(request: Request, who: OperateAccess, id: str) -> FleetAnswer:
    """Stop all tractors, also those driven by remote control."""
    session, ordered_s = _get_sessions(request).get_session(id), time.monotonic()
    session.manager.operators.stop_all(who.name, ordered_s)
    session.send_pending_outputs()
    request.app.state.metrics.count_stop("http", time.monotonic() - ordered_s)
    return _send_and_answer(request, id)


def _send_and_answer(request: Request, id: str) -> FleetAnswer:
    """Send what was ordered at once, as it is saved afterwards; the answer is the fleet as it is then."""
    sessions = _get_sessions(request)
    sessions.get_session(id).send_pending_outputs()
    return _build_answer(sessions, sessions.get_label(id))


@fleet_router.post("/fleets/{id}/replan", status_code=202, responses=CHANGE_ERRORS)
async def replan_fleet(request: Request, who: OperateAccess, id: str, body: ReplanRequest) -> ProposalAnswer:
    """Replan the remaining work without some tractors."""
    session = _get_sessions(request).get_session(id)
    number = session.replan(who.name, [tractor - 1 for tractor in body.without], goes_on=body.goes_on)
    session.send_pending_outputs()
    return ProposalAnswer(proposal=number)


@fleet_router.post("/fleets/{id}/accept", responses=CHANGE_ERRORS)
async def accept_proposal(request: Request, who: OperateAccess, id: str, body: AcceptRequest) -> FleetAnswer:
    """Accept a proposal that is ready."""
    session = _get_sessions(request).get_session(id)
    session.accept_proposal(who.name, body.proposal, time.monotonic())
    return _send_and_answer(request, id)


@fleet_router.get("/asyncapi.json", responses=LIST_ERRORS)
async def get_asyncapi(_who: ReadAccess) -> dict[str, Any]:
    """The frames of the link (AsyncAPI)."""
    return build_asyncapi_document()


recording_router = APIRouter(tags=["fleets"])


@recording_router.get("/fleets/{id}/recording", response_class=Response, responses=RECORDING_ANSWERS)
async def get_recording(request: Request, _who: ReadAccess, id: str) -> Response:
    """The recorded states as logs for diagnosis; raises NotFoundError if there are none."""
    sessions: FleetSessions | None = getattr(request.app.state, "hub", None)
    if sessions is not None:
        await save_recording_before_read(sessions, request.url.path)
    content = await run_in_threadpool(_pack_recording, request.app.state.store, id)
    headers = {"content-disposition": f'attachment; filename="fleet-{id}.zip"'}
    return Response(content, media_type="application/zip", headers=headers)


async def save_recording_before_read(sessions: FleetSessions, path: str) -> None:
    """Save the states of a live fleet first, if the path is that of its recording."""
    matched = RECORDING_PATH.fullmatch(path)
    session = sessions.by_id.get(matched[1]) if matched else None
    if session is not None:
        await sessions.save(session)


def _pack_recording(store: Store, id: str) -> bytes:
    store.get_fleet(id)
    logs = [
        (f"tractor-{number + 1}.csv", format_log_csv(store.read_recording(id, number)))
        for number in store.list_recorded_tractors(id)
    ]
    if not logs:
        raise NotFoundError("No tractor of this fleet has reported yet; start it first.", parameter="id")
    return zip_logs(logs)
