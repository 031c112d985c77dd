"""Fleets over HTTP: create, start, stop, replan; the AsyncAPI 3.0 document of their links; recordings.

A fleet is made of its request in a process of its own, so that large ones are never in the one that stops tractors.
"""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import asdict
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, get_args

from fastapi import Depends, Request, Response
from pydantic import Field, ValidationError
from pydantic.json_schema import models_json_schema

from fields.formats.guidance import ZIP_MEDIA_TYPE, zip_files
from planner.fleet.manager.finish_forecast import FinishDistribution, read_finish_distribution
from planner.fleet.model.rules import LONGEST_HORIZON_S, SHORTEST_HORIZON_S, FleetRules
from planner.fleet.session import inbound_frames, outbound_messages
from planner.fleet.session.clients import CONTROL, FleetClient
from planner.fleet.session.frame_content import build_tick_fleet, build_tick_tractor, find_next_time_s
from planner.fleet.session.state_recorder import format_log_csv
from planner.request.option_texts import parse_clock
from planner.request.validation import describe_fault, format_location
from planner.service.access.permissions import (
    READ,
    Caller,
    OperateAccess,
    OwnReadAccess,
    ReadAccess,
    RequiredRight,
)
from planner.service.errors import BusyError, NotFoundError, ServiceError
from planner.service.fleets.fleet_sessions import (
    Files,
    FleetLabel,
    FleetSessions,
    NewFleet,
    SessionsAccess,
    prepare_with_files,
)
from planner.service.gateway.request_gate import BODIES_FOLDER, LARGE_BODY_KEY
from planner.service.gateway.responses import ApiModel, ApiRequest, ApiRouter, ItemList, StoreAccess, document_file
from planner.service.settings import LIMITS, MEGABYTE_BYTES, ServiceSettings
from planner.service.store.disk_storage import translate_disk_full
from planner.service.store.service_store import Store, open_store
from planner.service.store.store_part import check_name

RANKING_FILE, FIELD_FOLDER = "result.json", "field/"
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
FleetReader = Annotated[Caller, Depends(RequiredRight(READ, fleet_parameter="id").admit_caller)]
JSON_TYPE = "application/json"
RECORDING_PATH = re.compile(r"/api/v1/fleets/([^/]+)/recording/?")
RECORDING_MODE = 0o600  # where tractors were is for who asked for it alone, also where it is unpacked
WRITTEN_BYTES = 2**18  # of a body, written at a time
RECORDING_ANSWERS = document_file("One log per tractor", [ZIP_MEDIA_TYPE])


class FleetRequest(ApiRequest):
    """A fleet to create: `plan` is the id of a plan job (with `result`, one of its saved plans) or a saved plan.

    `field` is by default that of the job. `deadline` (hh:mm, the next one) is by default that of the plan. `horizon_s`
    is for how many seconds tractors drive their base without contact to the service.
    """

    name: Annotated[str, Field(min_length=1, max_length=80)]
    plan: Annotated[str, Field(min_length=1, max_length=LIMITS.longest_plan_chars)]
    result: Annotated[str, Field(max_length=120)] = "plan.json"
    field: Annotated[str, Field(max_length=80)] | None = None
    tractor: Annotated[str, Field(max_length=80)] | None = None
    deadline: Annotated[str, Field(max_length=5)] | None = None
    twin_method: Literal["predict", "thesis"] = "predict"
    times: Annotated[float, Field(ge=0.1, le=100.0, allow_inf_nan=False)] = 1.0
    horizon_s: Annotated[float, Field(ge=SHORTEST_HORIZON_S, le=LONGEST_HORIZON_S, allow_inf_nan=False)] = (
        FleetRules.horizon_s
    )


def build_requested_fleet(id: str, room_bytes: int, settings: ServiceSettings, body: Path) -> NewFleet:
    """Read the request of a fleet from a file, and store the fleet under an id; raises HeadlandError.

    `room_bytes` is how large its plan may be beside those of other fleets.
    """
    try:
        fleet_request = FleetRequest.model_validate_json(body.read_bytes())
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        name = next((part for part in fault["loc"] if isinstance(part, str)), None)
        sentence = describe_fault(fault, format_location(fault["loc"]) or "The body")
        raise ServiceError(sentence, parameter=name) from None
    check_name(fleet_request.name)
    with open_store(settings) as store:
        text, finish_distribution = _read_plan(store, fleet_request)
        files, stored_files = _read_replacement_files(store, fleet_request)
        deadline_s = None
        if fleet_request.deadline is not None:
            deadline_s = find_next_time_s(parse_clock(fleet_request.deadline, "deadline"))
        given: dict[str, Any] = fleet_request.model_dump(include={"times", "horizon_s"})
        given |= {"way": fleet_request.twin_method, "deadline_s": deadline_s, "files": stored_files}
        given["chances"] = None if finish_distribution is None else asdict(finish_distribution)
        return store_new_fleet(id, room_bytes, store, fleet_request.name, text, files, given)


def store_new_fleet(
    id: str, room_bytes: int, store: Store, name: str, text: str, files: Files, given: Mapping[str, Any]
) -> NewFleet:
    """Prepare the plan of a fleet and store it with its settings; its deadline is by default that of its plan.

    Raises BusyError for a plan that has no room, HeadlandError for one that cannot be driven.
    """
    plan_bytes = len(text.encode())
    if plan_bytes > room_bytes:
        raise BusyError(
            f"The plan has {plan_bytes / MEGABYTE_BYTES:.1f} MB, and beside those of the live fleets there is room for "
            f"{max(room_bytes, 0) / MEGABYTE_BYTES:.1f} MB; delete a fleet first.",
            parameter="plan",
        )
    plan, settings = prepare_with_files(text, files), {**given, "begin_s": time.time()}
    if settings.get("deadline_s") is None and plan.scenario.deadline_s is not None:
        settings["deadline_s"] = find_next_time_s(plan.scenario.deadline_s)
    label = FleetLabel(id, name, store.save_fleet(id, name, text, settings), plan_bytes)
    return label, plan, settings


def _read_plan(store: Store, fleet_request: FleetRequest) -> tuple[str, FinishDistribution | None]:
    """The text of the plan, with its finish times if it is from a job with samples."""
    if fleet_request.plan.lstrip().startswith("{"):
        return fleet_request.plan, None
    text = store.read_result(fleet_request.plan, fleet_request.result, "plan").decode("utf-8", "replace")
    ranking = json.loads(store.read_result(fleet_request.plan, RANKING_FILE, "plan"))
    return text, read_finish_distribution(ranking, fleet_request.result)


def _read_replacement_files(
    store: Store, fleet_request: FleetRequest
) -> tuple[dict[str, tuple[str, bytes]], dict[str, tuple[str, str]]]:
    """Contents of the named files, and their suffixes and digests in the store."""
    stored_files: dict[str, tuple[str, str]] = {}
    for kind, name in (("field", fleet_request.field), ("tractor", fleet_request.tractor)):
        if name is not None:
            row = store.get_file(kind, name)
            stored_files[kind] = row.suffix, row.sha256
    if fleet_request.field is None and not fleet_request.plan.lstrip().startswith("{"):
        # The field as the plan was made for it: the boundary is not in the plan.
        for place, sha256 in store.get_job(fleet_request.plan, "plan").inputs.items():
            if place.startswith(FIELD_FOLDER):
                stored_files["field"] = PurePosixPath(place).suffix, sha256
    files = {kind: (suffix, store.blobs.read_bytes(sha256)) for kind, (suffix, sha256) in stored_files.items()}
    return files, stored_files


REQUEST_BODY = {"required": True, "content": {JSON_TYPE: {"schema": FleetRequest.model_json_schema()}}}


@cache
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


fleet_router = ApiRouter(tags=["fleets"])
recording_router = ApiRouter(tags=["fleets"])


class ReplanRequest(ApiRequest):
    """Tractors that are left out; failed ones always are. All that is left is planned anew for the others."""

    without: Annotated[
        list[inbound_frames.TractorNumber], Field(default_factory=list, max_length=inbound_frames.MOST_TRACTORS)
    ]


class ProposalNumber(ApiRequest):
    """The number of a proposal; the link sends it once it is ready to be accepted."""

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


class FleetList(ItemList[FleetAnswer]):
    """Fleets of the caller."""


def _build_answer(sessions: FleetSessions, label: FleetLabel) -> FleetAnswer:
    """A fleet from memory: answers do not wait for the database."""
    answer = FleetAnswer(id=label.id, name=label.name, created=label.created, error=label.fault)
    session = sessions.by_id.get(label.id)
    if session is None:
        return answer
    now = time.monotonic()
    answer.videos = sessions.video_hosts.select_allowed(label.videos)
    answer.recorded = max(session.recorder.received) >= 0
    answer.fleet = build_tick_fleet(session.manager, session.compute_deadline_s(), session.finish_distribution)
    answer.tractors = [
        build_tick_tractor(session.manager, number, now, None) for number in range(session.tractor_count)
    ]
    return answer


@fleet_router.get("/fleets")
async def list_fleets(sessions: SessionsAccess, who: OwnReadAccess) -> FleetList:
    """All fleets; a robot sees only its own."""
    labels = sorted(sessions.labels.values(), key=lambda label: (label.created, label.id))
    return FleetList(items=[_build_answer(sessions, label) for label in labels if who.has_right(READ, label.id)])


@asynccontextmanager
async def spool_body(stream: AsyncIterator[bytes], folder: Path) -> AsyncIterator[Path]:
    """A body in a file, which is gone afterwards; a thread writes it, so it takes no memory and nobody waits for it.

    Raises StorageError where there is no room.
    """
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / secrets.token_hex(8)
    try:
        with translate_disk_full(), open(path, "xb") as file:
            waiting, waiting_bytes = list[bytes](), 0
            async for part in stream:
                waiting.append(part)
                waiting_bytes += len(part)
                if waiting_bytes >= WRITTEN_BYTES:
                    await asyncio.to_thread(file.writelines, waiting)
                    waiting, waiting_bytes = [], 0
            await asyncio.to_thread(file.writelines, waiting)
        yield path
    finally:
        path.unlink(missing_ok=True)


@fleet_router.post("/fleets", status_code=201, openapi_extra={LARGE_BODY_KEY: True, "requestBody": REQUEST_BODY})
async def create_fleet(request: Request, sessions: SessionsAccess, who: OperateAccess) -> FleetAnswer:
    """Create a fleet from a plan; it stands until it is started."""
    state = request.app.state
    async with spool_body(request.stream(), state.settings.data / BODIES_FOLDER) as path:
        session = await sessions.create_session(build_requested_fleet, state.settings, path)
    session.manager.log_event(who.name, "created", name=session.name)
    return _build_answer(sessions, sessions.get_label(session.id))


@fleet_router.get("/fleets/{id}")
async def get_fleet(sessions: SessionsAccess, _who: FleetReader, id: str) -> FleetAnswer:
    """One fleet."""
    return _build_answer(sessions, sessions.get_label(id))


@fleet_router.delete("/fleets/{id}", status_code=204)
async def delete_fleet(sessions: SessionsAccess, _who: OperateAccess, id: str) -> Response:
    """Stop and delete a fleet with its recording."""
    await sessions.delete(id)
    return Response(status_code=204)


@fleet_router.post("/fleets/{id}/start")
async def start_fleet(sessions: SessionsAccess, who: OperateAccess, id: str) -> FleetAnswer:
    """Start all tractors."""
    return _carry_out(sessions, who, id, inbound_frames.StartFrame(kind="start"))


@fleet_router.post("/fleets/{id}/pause")
async def pause_fleet(sessions: SessionsAccess, who: OperateAccess, id: str) -> FleetAnswer:
    """Pause all tractors until they are resumed."""
    return _carry_out(sessions, who, id, inbound_frames.PauseFrame(kind="pause"))


@fleet_router.post("/fleets/{id}/resume")
async def resume_fleet(sessions: SessionsAccess, who: OperateAccess, id: str) -> FleetAnswer:
    """Resume all tractors."""
    return _carry_out(sessions, who, id, inbound_frames.ResumeFrame(kind="resume"))


@fleet_router.post("/fleets/{id}/stop")
async def stop_fleet(request: Request, sessions: SessionsAccess, who: OperateAccess, id: str) -> FleetAnswer:
    """Stop all tractors, also those driven by remote control."""
    session, ordered_s = sessions.get_session(id), time.monotonic()
    session.manager.operators.stop_all(who.name, ordered_s)
    session.send_pending_outputs()
    request.app.state.metrics.count_stop("http", time.monotonic() - ordered_s)
    return _build_answer(sessions, sessions.get_label(id))


def _carry_out(sessions: FleetSessions, who: Caller, id: str, frame: inbound_frames.OrderFrame) -> FleetAnswer:
    """Carry an order out as one of a link; it is sent at once and saved afterwards. The answer is the fleet then."""
    sessions.get_session(id).carry_out(FleetClient(CONTROL, who.name), frame, time.monotonic())
    return _build_answer(sessions, sessions.get_label(id))


@fleet_router.post("/fleets/{id}/replan", status_code=202)
async def replan_fleet(sessions: SessionsAccess, who: OperateAccess, id: str, body: ReplanRequest) -> ProposalNumber:
    """Plan all work that is left anew, without some tractors."""
    session = sessions.get_session(id)
    number = session.replan(who.name, [tractor - 1 for tractor in body.without])
    session.send_pending_outputs()
    return ProposalNumber(proposal=number)


@fleet_router.post("/fleets/{id}/accept")
async def accept_proposal(sessions: SessionsAccess, who: OperateAccess, id: str, body: ProposalNumber) -> FleetAnswer:
    """Accept a proposal that is ready."""
    return _carry_out(sessions, who, id, inbound_frames.AcceptFrame(kind="accept", proposal=body.proposal))


@fleet_router.get("/asyncapi.json")
async def get_asyncapi(_who: ReadAccess) -> dict[str, Any]:
    """The frames of the link (AsyncAPI)."""
    return build_asyncapi_document()


@recording_router.get("/fleets/{id}/recording", response_class=Response, responses=RECORDING_ANSWERS)
def get_recording(store: StoreAccess, _who: ReadAccess, id: str) -> Response:
    """The recorded states as logs for diagnosis; raises NotFoundError if there are none."""
    store.get_fleet(id)
    logs = {
        f"tractor-{number + 1}.csv": format_log_csv(store.read_recording(id, number)).encode()
        for number in store.list_recorded_tractors(id)
    }
    if not logs:
        raise NotFoundError("No tractor of this fleet has reported yet; start it first.", parameter="id")
    headers = {"content-disposition": f'attachment; filename="fleet-{id}.zip"'}
    return Response(zip_files(logs, RECORDING_MODE), media_type=ZIP_MEDIA_TYPE, headers=headers)


async def save_recording_before_read(sessions: FleetSessions, path: str) -> None:
    """Save the states of a live fleet first, if the path is that of its recording."""
    matched = RECORDING_PATH.fullmatch(path)
    session = sessions.by_id.get(matched[1]) if matched else None
    if session is not None:
        await sessions.save(session)
