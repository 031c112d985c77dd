"""Twins over HTTP: their state and corrections, diagnosis of the recording when one is wrong (on request, or once per
doubt), and extending the tractor file by the result."""

from __future__ import annotations

import json
import math
import secrets
from typing import Annotated, Any

import numpy as np
from fastapi import Path
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from planner.errors import HeadlandError
from planner.fleet.manager.fleet_state import FLEET_MANAGER
from planner.fleet.model.alarms import WARNING
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.inbound_frames import MOST_TRACTORS
from planner.fleet.session.state_recorder import average_commands, format_log_csv
from planner.service.access.permissions import Caller, OperateAccess, ReadAccess
from planner.service.errors import BusyError, ConflictError, NotFoundError
from planner.service.fleets.fleet_sessions import FleetSessions, SessionsAccess
from planner.service.gateway.responses import ApiModel, ApiRequest, ApiRouter, ItemList, require_state
from planner.service.jobs.file_reading import FileReader, submit_job
from planner.service.jobs.input_files import DiagnosisJobRequest
from planner.service.settings import LIMITS
from planner.service.store.job_queue import DONE, UNFINISHED_STATUSES
from planner.service.store.service_store import Store
from vehicle.model.tractor import Tractor, parse_tractor
from vehicle.model.tractor_writer import format_tractor_toml

DIAGNOSIS_KIND, RESULT_FILE, TRACTOR_FILE = "diagnosis", "result.json", "tractor.toml"
FINDING = "finding"
DIAGNOSE_AFTER_S = 90.0  # of driving after a doubt is certain: a track and a turn show more than a track alone
TwinTractorNumber = Annotated[int, Path(ge=1, le=MOST_TRACTORS)]


class TwinDiagnosis:
    """Diagnoses of the tractors of live fleets, as jobs; results are in `findings` of the fleet."""

    def __init__(self, store: Store, reader: FileReader) -> None:
        self.store, self.reader = store, reader

    async def follow_up(self, session: FleetSession, now: float) -> None:
        """Diagnose new doubts and show new findings; to be called about once a second."""
        for number in range(session.tractor_count):
            doubted_s = _find_due_doubt_s(session, number)
            if doubted_s is not None and session.diagnosed_doubts.get(number) != doubted_s:
                await self._begin_automatic_diagnosis(session, number, doubted_s)
            if number in session.diagnoses and number not in session.findings:
                await self._show_finding(session, number, now)

    async def _begin_automatic_diagnosis(self, session: FleetSession, number: int, doubted_s: float) -> None:
        who = Caller(f"twin of tractor {number + 1}", ())
        try:
            await self.begin_diagnosis(session, number, who)
        except BusyError:
            return  # try again when fewer jobs wait
        except HeadlandError as refusal:
            session.findings[number] = _build_empty_finding(str(refusal))
        session.diagnosed_doubts[number] = doubted_s

    async def begin_diagnosis(self, session: FleetSession, number: int, who: Caller) -> None:
        """Diagnose the recording of a tractor, as a job. Raises HeadlandError, NotFoundError without a recording."""
        body = await run_in_threadpool(self._build_request, session, number)
        row = await submit_job(self.store, self.reader, who.token_sha256 or who.name, DIAGNOSIS_KIND, body, who)
        session.diagnoses[number] = row.id
        session.findings.pop(number, None)
        session.manager.alarms.end_alarm(FINDING, number)
        session.manager.log_event(who.name, "diagnose", tractor=number + 1, job=session.diagnoses[number])

    def _build_request(self, session: FleetSession, number: int) -> DiagnosisJobRequest:
        """A request to diagnose the recording with the tractor file of the twin."""
        rows = self.store.read_recording(session.id, number)
        if not rows:
            raise NotFoundError(f"Tractor {number + 1} of this fleet has not reported yet.", parameter="tractor")
        name = f"fleet {session.id[:6]} tractor {number + 1} {secrets.token_hex(3)}"
        self.store.add_file("log", name, format_log_csv(average_commands(rows)).encode())
        self.store.add_file("tractor", name, format_tractor_toml(session.twins.tractors[number]).encode())
        request_name = f"{session.name[:60].strip()} tractor {number + 1}"
        return DiagnosisJobRequest.model_validate({"name": request_name, "logs": [name], "tractor": name})

    async def _show_finding(self, session: FleetSession, number: int, now: float) -> None:
        """Raise an alarm with the result of a tractor's diagnosis, once it is done."""
        id = session.diagnoses[number]
        finding = await run_in_threadpool(self._read_finding, id, session.twins.tractors[number])
        if finding is None or session.diagnoses.get(number) != id:
            return
        session.findings[number] = finding
        sentence = f"Diagnosis of tractor {number + 1}: {finding['words']}"
        session.manager.alarms.raise_alarm(FINDING, number, WARNING, sentence, now)
        session.manager.log_event(FLEET_MANAGER, FINDING, tractor=number + 1, **finding)

    def _read_finding(self, id: str, tractor: Tractor) -> dict[str, Any] | None:
        """The effects and verdict of a job, and whether they extend the file of `tractor`; or why there are none. None
        while it is not done."""
        try:
            row = self.store.get_job(id, DIAGNOSIS_KIND)
        except NotFoundError:
            return _build_empty_finding("it was deleted.")
        if row.status in UNFINISHED_STATUSES:
            return None
        if row.status != DONE:
            return _build_empty_finding(row.error or f"it was {row.status}.")
        result = json.loads(self.store.read_result(id, RESULT_FILE, DIAGNOSIS_KIND))
        has_file = any(each.name == TRACTOR_FILE for each in row.results)
        content = self.store.read_result(id, TRACTOR_FILE, DIAGNOSIS_KIND) if has_file else None
        diagnosed = tractor if content is None else parse_tractor(content.decode(), TRACTOR_FILE)
        extends_model = is_different_tractor(diagnosed, tractor)
        return {"named": result["named"], "words": result["verdict"], "extends_model": extends_model}

    def get_last_diagnosis_job(self, session: FleetSession, number: int) -> dict[str, Any] | None:
        """The last diagnosis job of a tractor, None without one. Raises NotFoundError if it was deleted."""
        id = session.diagnoses.get(number)
        if id is None:
            return None
        row = self.store.get_job(id, DIAGNOSIS_KIND)
        results = [result.name for result in row.results]
        return {"id": row.id, "status": row.status, "error": row.error, "results": results}

    def save_extended_tractor(self, session: FleetSession, number: int, name: str) -> Tractor:
        """Save the tractor of the last diagnosis under a name.

        Raises ConflictError while there is none, and if it adds nothing to the file of the twin.
        """
        job = self.get_last_diagnosis_job(session, number)
        if job is None or job["status"] != DONE:
            raise ConflictError(
                f"No diagnosis of tractor {number + 1} is done; start one and wait for it.", parameter="tractor"
            )
        if TRACTOR_FILE not in job["results"]:
            raise ConflictError(
                f"What the diagnosis of tractor {number + 1} found does not lower the error of driving that it was "
                "not fitted to; there is nothing to add.",
                parameter="tractor",
            )
        content = self.store.read_result(job["id"], TRACTOR_FILE, DIAGNOSIS_KIND)
        diagnosed = parse_tractor(content.decode(), TRACTOR_FILE)
        if not is_different_tractor(diagnosed, session.twins.tractors[number]):
            raise ConflictError(
                f"The diagnosis of tractor {number + 1} found nothing that its file lacks; there is nothing to add.",
                parameter="tractor",
            )
        self.store.add_file("tractor", name, content)
        return diagnosed


def is_different_tractor(diagnosed: Tractor, previous: Tractor) -> bool:
    """Whether two tractors differ in more than name and source."""
    ignored = {"name", "source"}
    return diagnosed.model_dump(exclude=ignored) != previous.model_dump(exclude=ignored)


def _build_empty_finding(reason: str) -> dict[str, Any]:
    """The finding of a diagnosis without a result."""
    return {"named": [], "words": reason, "extends_model": False}


def _find_due_doubt_s(session: FleetSession, number: int) -> float | None:
    """When a doubt about a twin was certain, if DIAGNOSE_AFTER_S have passed since; else None."""
    twin = session.twins.items[number]
    doubt = None if twin is None else twin.find_mismatch()
    if twin is None or doubt is None or twin.state.time_s - doubt.detected_s < DIAGNOSE_AFTER_S:
        return None
    return doubt.detected_s


twin_router = ApiRouter(tags=["twins"])


class TwinAnswer(ApiModel):
    """A twin. Its `state` is null before its tractor has reported; `diagnosis` is the last job.

    `finding` is its result: the ids of `named` effects, `words`, and `extends_model`, whether it adds to the tractor
    file.
    """

    fleet: str
    tractor: int
    method: str
    state: dict[str, float] | None = None
    error_m: float | None = None
    error_deg: float | None = None
    corrections: dict[str, list[float]] = Field(default_factory=dict)
    doubt: dict[str, Any] | None = None
    diagnosis: dict[str, Any] | None = None
    finding: dict[str, Any] | None = None


class TwinList(ItemList[TwinAnswer]):
    """Twins of a fleet."""


class ExtendModelRequest(ApiRequest):
    """The name of the new tractor file."""

    name: Annotated[str, Field(min_length=1, max_length=80)] | None = None


class ExtendedModelAnswer(ApiModel):
    """The new tractor file."""

    tractor: str


DiagnosisAccess = Annotated[TwinDiagnosis, require_state("diagnosing")]


def _get_session(sessions: FleetSessions, id: str, number: int) -> FleetSession:
    session = sessions.get_session(id)
    session.manager.check_tractor_number(number - 1)
    return session


def _build_twin_answer(session: FleetSession, number: int, *, with_corrections: bool) -> TwinAnswer:
    description, twin = session.twins.build_tick_entries(number - 1), session.twins.items[number - 1]
    answer = TwinAnswer(
        fleet=session.id,
        tractor=number,
        method=session.twins.method,
        state=description.get("twin"),
        error_m=description.get("error_m"),
        error_deg=description.get("error_deg"),
        finding=session.findings.get(number - 1),
    )
    if twin is not None:
        doubt = twin.find_mismatch()
        if doubt is not None:
            ratio, amount = round(doubt.innovation_ratio, 2), round(doubt.amount, 4)
            answer.doubt = {"since_s": round(doubt.since_s, 1), "like": doubt.effect_id, "amount": amount}
            answer.doubt |= {"times": ratio, "words": doubt.words}
        if with_corrections:
            columns = {name: values[-LIMITS.shown_corrections :] for name, values in twin.corrections.items()}
            columns["heading_deg"] = np.degrees(columns.pop("heading_rad"))
            answer.corrections = {
                name: [round(float(v), 4) for v in values if math.isfinite(v)] for name, values in columns.items()
            }
    return answer


@twin_router.get("/twins")
async def list_twins(sessions: SessionsAccess, _who: ReadAccess) -> TwinList:
    """All twins, without their corrections."""
    items = [
        _build_twin_answer(session, number, with_corrections=False)
        for session in sessions.by_id.values()
        for number in range(1, session.tractor_count + 1)
    ]
    return TwinList(items=items)


@twin_router.get("/twins/{fleet}/{tractor}")
async def get_twin(
    sessions: SessionsAccess, diagnosis: DiagnosisAccess, _who: ReadAccess, fleet: str, tractor: TwinTractorNumber
) -> TwinAnswer:
    """One twin with its last corrections."""
    session = _get_session(sessions, fleet, tractor)
    answer = _build_twin_answer(session, tractor, with_corrections=True)
    answer.diagnosis = await run_in_threadpool(diagnosis.get_last_diagnosis_job, session, tractor - 1)
    return answer


@twin_router.post("/twins/{fleet}/{tractor}/diagnose", status_code=202)
async def diagnose(
    sessions: SessionsAccess, diagnosis: DiagnosisAccess, who: OperateAccess, fleet: str, tractor: TwinTractorNumber
) -> TwinAnswer:
    """Diagnose the recording of a tractor, as a job."""
    session = _get_session(sessions, fleet, tractor)
    await sessions.save(session)
    await diagnosis.begin_diagnosis(session, tractor - 1, who)
    session.send_pending_outputs()
    answer = _build_twin_answer(session, tractor, with_corrections=False)
    answer.diagnosis = await run_in_threadpool(diagnosis.get_last_diagnosis_job, session, tractor - 1)
    return answer


@twin_router.post("/twins/{fleet}/{tractor}/mend", status_code=201)
async def extend_model(
    sessions: SessionsAccess,
    diagnosis: DiagnosisAccess,
    who: OperateAccess,
    fleet: str,
    tractor: TwinTractorNumber,
    body: ExtendModelRequest,
) -> ExtendedModelAnswer:
    """Save the result of the diagnosis as a new tractor file, which the twin uses from now on."""
    session = _get_session(sessions, fleet, tractor)
    name = body.name or f"{session.name[:40]} tractor {tractor} extended {secrets.token_hex(2)}"
    extended = await run_in_threadpool(diagnosis.save_extended_tractor, session, tractor - 1, name)
    session.twins.change_tractor(tractor - 1, extended)
    session.twin_files[tractor - 1] = name
    if tractor - 1 in session.findings:
        session.findings[tractor - 1] |= {"extends_model": False}
    session.manager.alarms.end_alarm(FINDING, tractor - 1)
    session.manager.log_event(who.name, "mend", tractor=tractor, file=name)
    session.send_pending_outputs()
    return ExtendedModelAnswer(tractor=name)
