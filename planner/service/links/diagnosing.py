"""Why twins are wrong: diagnoses of what was recorded, asked for by operators and, once per doubt, by the twins."""

from __future__ import annotations

import json
import secrets
import tomllib
from typing import Any

from starlette.concurrency import run_in_threadpool

from planner.errors import HeadlandError
from planner.service.access import Who
from planner.service.api.jobs import ask
from planner.service.centre.alarms import WARNING
from planner.service.centre.core import CENTRE
from planner.service.errors import BusyError, MissingError, TakenError
from planner.service.jobs.reading import Reader
from planner.service.jobs.requests import DiagnosisRequest
from planner.service.links.live import LiveFleet
from planner.service.links.recording import holding, log_csv
from planner.service.store import Store
from planner.service.store.jobs import DONE, OPEN
from vehicle.measured.answer.save import tractor_toml
from vehicle.tractor import Tractor

KIND, RESULT, FILE = "diagnosis", "result.json", "tractor.toml"
FINDING = "finding"
LATER_S = 90.0  # of driving after a doubt is sure: a row and a turn show more of it than a row alone


class Diagnosing:
    """Diagnoses of the tractors of live fleets, as jobs; what they find is kept in `findings` of the fleet."""

    def __init__(self, store: Store, reader: Reader) -> None:
        self.store, self.reader = store, reader

    async def look(self, live: LiveFleet, now: float) -> None:
        """Ask for what has begun to be doubted, and show what was found; to be called about once a second."""
        for number in range(live.tractor_count):
            told_s = _doubted(live, number)
            if told_s is not None and live.doubted.get(number) != told_s:
                await self._of_itself(live, number, told_s)
            if number in live.diagnoses and number not in live.findings:
                await self._found(live, number, now)

    async def _of_itself(self, live: LiveFleet, number: int, told_s: float) -> None:
        who = Who(f"twin of tractor {number + 1}", None, True)
        try:
            await self.begin(live, number, who)
        except BusyError:
            return  # asked again when fewer jobs wait
        except HeadlandError as refusal:
            live.findings[number] = _nothing(str(refusal))
        live.doubted[number] = told_s

    async def begin(self, live: LiveFleet, number: int, who: Who) -> None:
        """Have what is recorded of a tractor diagnosed. Raises HeadlandError, MissingError where nothing is."""
        live.diagnoses[number] = await run_in_threadpool(self._asked, live, number, who)
        live.findings.pop(number, None)
        live.centre.alarms.ended(FINDING, number)
        live.centre.note(who.name, "diagnose", tractor=number + 1, job=live.diagnoses[number])

    def _asked(self, live: LiveFleet, number: int, who: Who) -> str:
        """The id of a job that diagnoses the recording by the tractor file that the twin has."""
        rows = self.store.recording(live.id, number)
        if not rows:
            raise MissingError(f"Tractor {number + 1} of this fleet has not reported yet.", parameter="tractor")
        name = f"fleet {live.id[:6]} tractor {number + 1} {secrets.token_hex(3)}"
        self.store.add_file("log", name, log_csv(holding(rows)).encode())
        self.store.add_file("tractor", name, tractor_toml(live.twins.tractors[number]).encode())
        told = f"{live.name[:60].strip()} tractor {number + 1}"
        body = DiagnosisRequest.model_validate({"name": told, "logs": [name], "tractor": name})
        return ask(self.store, self.reader, KIND, body, who).id

    async def _found(self, live: LiveFleet, number: int, now: float) -> None:
        """Raise an alarm with what the diagnosis of a tractor found, once it is over."""
        id = live.diagnoses[number]
        found = await run_in_threadpool(self._finding, id, live.twins.tractors[number])
        if found is None or live.diagnoses.get(number) != id:
            return
        live.findings[number] = found
        told = f"Diagnosis of tractor {number + 1}: {found['words']}"
        live.centre.alarms.raised(FINDING, number, WARNING, told, now)
        live.centre.note(CENTRE, FINDING, tractor=number + 1, **found)

    def _finding(self, id: str, tractor: Tractor) -> dict[str, Any] | None:
        """The effects that a job has named, its verdict, and whether what it found is more than the file of `tractor`
        has; or why it found nothing. None while it is open."""
        try:
            row = self.store.job(id, KIND)
        except MissingError:
            return _nothing("it was deleted.")
        if row.status in OPEN:
            return None
        if row.status != DONE:
            return _nothing(row.error or f"it was {row.status}.")
        result = json.loads(self.store.blobs.get(self.store.result(id, RESULT, KIND).sha256))
        mends = differs(self._tractor(id), tractor)
        return {"named": result["named"], "words": result["verdict"], "mends": mends}

    def _tractor(self, id: str) -> Tractor:
        """The tractor that a job which is done has found."""
        content = self.store.blobs.get(self.store.result(id, FILE, KIND).sha256)
        return Tractor(**tomllib.loads(content.decode()))

    def job(self, live: LiveFleet, number: int) -> dict[str, Any] | None:
        """The job that was asked for last of a tractor, None for none. Raises MissingError for one that is deleted."""
        id = live.diagnoses.get(number)
        if id is None:
            return None
        row = self.store.job(id, KIND)
        return {"id": row.id, "status": row.status, "error": row.error, "results": [one.name for one in row.results]}

    def mended(self, live: LiveFleet, number: int, name: str) -> Tractor:
        """The tractor of the last diagnosis, kept under a name.

        Raises TakenError while there is none, and where it found nothing that the file of the twin lacks.
        """
        job = self.job(live, number)
        if job is None or job["status"] != DONE or FILE not in job["results"]:
            raise TakenError(
                f"No diagnosis of tractor {number + 1} is done; ask for one and wait for it.", parameter="tractor"
            )
        made = self._tractor(job["id"])
        if not differs(made, live.twins.tractors[number]):
            raise TakenError(
                f"The diagnosis of tractor {number + 1} found nothing that its file lacks; there is nothing to take "
                "into it.", parameter="tractor",
            )  # fmt: skip
        self.store.add_file("tractor", name, self.store.blobs.get(self.store.result(job["id"], FILE, KIND).sha256))
        return made


def differs(made: Tractor, before: Tractor) -> bool:
    """Whether two tractors drive unlike, whatever they are called and wherever their values come from."""
    told = {"name", "source"}
    return made.model_dump(exclude=told) != before.model_dump(exclude=told)


def _nothing(why: str) -> dict[str, Any]:
    """What a diagnosis that gave no answer found."""
    return {"named": [], "words": why, "mends": False}


def _doubted(live: LiveFleet, number: int) -> float | None:
    """Since when the twin of a tractor is sure that it is wrong, some time after that; None while it is not."""
    twin = live.twins.items[number]
    doubt = None if twin is None else twin.doubt()
    if twin is None or doubt is None or twin.state.time_s - doubt.told_s < LATER_S:
        return None
    return doubt.told_s
