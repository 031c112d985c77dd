"""A fleet made of a request, in a process of its own, so that large ones are never in the one that stops tractors."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from planner.fleet.manager.finish_forecast import FinishDistribution, read_finish_distribution
from planner.fleet.session.frame_content import find_next_time_s
from planner.request.option_texts import parse_clock
from planner.request.validation_messages import describe_fault, format_location
from planner.service.errors import BusyError, ServiceError
from planner.service.fleets.fleet_sessions import Files, NewFleet, prepare_with_files
from planner.service.settings import MEGABYTE_BYTES, ServiceSettings
from planner.service.store.service_store import Store, open_store
from planner.service.store.store_part import check_name

LONGEST_PLAN = 30_000_000
RANKING_FILE, FIELD_FOLDER = "result.json", "field/"


class FleetRequest(BaseModel):
    """A fleet to create: `plan` is the id of a plan job (with `result`, one of its saved plans) or a saved plan.

    `field` is by default that of the job. `deadline` (hh:mm, the next one) is by default that of the plan. `horizon_s`
    is for how many seconds tractors drive their base without contact to the service.
    """

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(min_length=1, max_length=80)]
    plan: Annotated[str, Field(min_length=1, max_length=LONGEST_PLAN)]
    result: Annotated[str, Field(max_length=120)] = "plan.json"
    field: Annotated[str, Field(max_length=80)] | None = None
    tractor: Annotated[str, Field(max_length=80)] | None = None
    deadline: Annotated[str, Field(max_length=5)] | None = None
    twin_method: Literal["predict", "thesis"] = "predict"
    times: Annotated[float, Field(ge=0.1, le=100.0, allow_inf_nan=False)] = 1.0
    horizon_s: Annotated[float, Field(ge=2.0, le=600.0, allow_inf_nan=False)] = 20.0


def build_requested_fleet(id: str, room_bytes: int, settings: ServiceSettings, body: Path) -> NewFleet:
    """Read the request of a fleet from a file, and store the fleet under an id; raises HeadlandError.

    `room_bytes` is how large its plan may be beside those of other fleets.
    """
    fleet_request = read_fleet_request(body.read_bytes())
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
    created = store.save_fleet(id, name, text, settings)
    return NewFleet(id, name, plan, settings, created, plan_bytes)


def read_fleet_request(body: bytes) -> FleetRequest:
    """Read a request. Raises ServiceError."""
    try:
        return FleetRequest.model_validate_json(body)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    place = format_location(fault["loc"]) or "The body"
    name = next((part for part in fault["loc"] if isinstance(part, str)), None)
    raise ServiceError(describe_fault(fault, place), parameter=name)


def _read_plan(store: Store, fleet_request: FleetRequest) -> tuple[str, FinishDistribution | None]:
    """The text of the plan, with its finish times if it is from a job with samples."""
    if fleet_request.plan.lstrip().startswith("{"):
        return fleet_request.plan, None
    result = store.get_result(fleet_request.plan, fleet_request.result, "plan")
    text = store.blobs.read_bytes(result.sha256).decode("utf-8", "replace")
    ranking = json.loads(store.blobs.read_bytes(store.get_result(fleet_request.plan, RANKING_FILE, "plan").sha256))
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
