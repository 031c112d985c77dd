"""Item 12: the disk that holds the folder of the service is full."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service, run_service
from tests.benchmarks.attack.squad import wait_for
from tests.benchmarks.attack.web import API, Answer, ask, square_field, upload

DISK_MB, BLOCK = 400, 2**20
FULL = 507
LOOKS_S, DONE_S = 10.0, 120.0
ENDED = ("done", "failed", "cancelled")


def attack_full_disk(command: Sequence[str], short: bool) -> list[Row]:
    """Upload, and ask for a job, while nothing can be written."""
    try:
        with _small_disk() as disk, run_service(command, data=disk / "data") as service:
            return _attack(service, disk / "filler", short)
    except PermissionError as error:
        return [Row("12", "a full disk", str(error)[:80], "507, jobs wait", None)]


def _attack(service: Service, filler: Path, short: bool) -> list[Row]:
    token = service.token("planner")
    upload(service.port, "fields", "small.geojson", square_field(), token, local="true")
    _fill(filler)
    refused = upload(service.port, "fields", "late.geojson", square_field(61.0) + b" " * 900_000, token, local="true")
    asked_full = _ask_plan(service)
    filler.unlink()
    sentence = str(refused.json.get("error", refused.why))
    first = Row("12a", "upload on a full disk", f"{refused.status} {sentence}"[:90], f"{FULL} and a sentence",
                refused.status == FULL and sentence.endswith((".", "!")) and len(sentence) > 20,
                {"status": refused.status, "sentence": sentence, "job_asked": asked_full.status})  # fmt: skip
    return [first, _judge_job(service, filler, short)]


def _judge_job(service: Service, filler: Path, short: bool) -> Row:
    """A job for whose results there is no room: it waits, and is done once there is some."""
    job = _ask_plan(service)
    id = str(job.json.get("id"))
    wait_for(lambda: _watch(service, id).get("status") != "queued", DONE_S)
    _fill(filler)
    wait_for(lambda: _has_noticed(_watch(service, id)), LOOKS_S if short else 2.0 * LOOKS_S)
    meanwhile = _watch(service, id)
    filler.unlink()
    begin = time.monotonic()
    wait_for(lambda: _watch(service, id).get("status") in ENDED, DONE_S)
    end = _watch(service, id)
    said = str((meanwhile.get("progress") or {}).get("words") or meanwhile.get("error") or "")
    words = f"{meanwhile.get('status')} while full ({said[:50]}), then {end.get('status')}"
    values: dict[str, Any] = {"asked": job.status, "while_full": meanwhile.get("status"), "said": said,
                              "end": end.get("status"), "after_s": round(time.monotonic() - begin, 1)}  # fmt: skip
    held = meanwhile.get("status") not in ENDED and end.get("status") == "done"
    return Row("12b", "a job on a full disk", words, "waits, then done", held, values)


def _has_noticed(job: dict[str, Any]) -> bool:
    """Whether a job has ended, or says that it waits for room."""
    return job.get("status") in ENDED or "room" in str((job.get("progress") or {}).get("words"))


def _ask_plan(service: Service) -> Answer:
    body = {"field": "small", "local": True, "tractors": "1-2"}
    return ask(service.port, "POST", f"{API}/plans", token=service.token("planner"), json_body=body)


def _watch(service: Service, id: str) -> dict[str, Any]:
    return ask(service.port, "GET", f"{API}/plans/{id}", token=service.token("planner")).json


def _fill(filler: Path) -> None:
    """Write a file until there is no room for another block, or a part of one."""
    with filler.open("wb", buffering=0) as file:
        for size in (BLOCK, 1024, 1):
            try:
                while True:
                    if file.write(b"\0" * size) < size:
                        break
            except OSError:
                continue


@contextmanager
def _small_disk() -> Iterator[Path]:
    """A file system of its own in memory; raises PermissionError where none may be mounted."""
    with tempfile.TemporaryDirectory(prefix="headland-disk-") as folder:
        words = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m,mode=700,uid={os.getuid()}", "tmpfs", folder]
        try:
            done = subprocess.run(words, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            raise PermissionError("there is no mount here") from None
        if done.returncode != 0:
            raise PermissionError(f"no file system may be mounted: {done.stderr.strip()}")
        try:
            yield Path(folder)
        finally:
            subprocess.run(["umount", "--lazy", folder], check=False)
