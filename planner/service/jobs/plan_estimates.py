"""The service's side of estimates: whose turn it is, how much computing each may use, and the process that answers."""

from __future__ import annotations

import asyncio
import json
import logging
import shutil
import tempfile
import threading
import time
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from fields.units import HOUR_S
from planner.service.errors import BusyError, ServiceError
from planner.service.gateway.connection_limits import RateLimiter
from planner.service.jobs.file_reading import FairQueue, compute_reading_memory_limit_bytes
from planner.service.jobs.input_files import write_inputs
from planner.service.sandbox.reader_processes import (
    BOOTSTRAP_CODE,
    extract_value,
    parse_answer,
    start_linked_python,
)
from planner.service.settings import WORK_FOLDER, ServiceSettings
from planner.service.store.service_store import Store

MOST_WAITING_PER_CLIENT = 3
START_WAIT_S, LONGEST_ESTIMATE_S = 20.0, 60.0
PROCESS_LIFE_S = HOUR_S
COMPUTING_SHARE, MOST_COMPUTING_S = 0.5, 60.0
"""Each user may keep half a core busy, and has a minute of computing in advance, which an estimate may overdraw."""
MOST_FOLDERS = 50
ESTIMATE_FAULT = (
    "This cannot be estimated: it triggers a fault of Headland, described in the log of the service; run the plan "
    "instead, and please report it."
)
SERVE_CODE = (
    f"{BOOTSTRAP_CODE}from planner.service.sandbox import estimating; "
    "estimating.serve(int(sys.argv[2]), sys.argv[3], int(sys.argv[4]), float(sys.argv[5]))"
)


class _EstimatingProcess:
    """A running process, and the stream to it."""

    def __init__(self, folder: Path, memory_bytes: int) -> None:
        arguments = (str(folder), str(memory_bytes), str(PROCESS_LIFE_S))
        self._process, self._socket = start_linked_python(SERVE_CODE, *arguments)
        self._received, self._is_ready = b"", False

    def wait_until_ready(self) -> bool:
        """Wait until it takes orders, not long; raises OSError where it has ended."""
        self._is_ready = self._is_ready or bool(self._receive_line(START_WAIT_S))
        return self._is_ready

    def ask(self, order: Mapping[str, Any]) -> bytes | None:
        """Its answer, None where it takes too long; raises OSError where it has ended."""
        self._socket.settimeout(LONGEST_ESTIMATE_S)
        self._socket.sendall(json.dumps(order).encode() + b"\n")
        return self._receive_line(LONGEST_ESTIMATE_S)

    def interrupt(self) -> None:
        """Let who waits for an answer see the end of the process."""
        self._process.kill()

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        self._socket.close()

    def _receive_line(self, seconds: float) -> bytes | None:
        deadline_s = time.monotonic() + seconds
        while b"\n" not in self._received:
            self._socket.settimeout(max(0.001, deadline_s - time.monotonic()))
            try:
                part = self._socket.recv(1 << 16)
            except TimeoutError:
                return None
            if not part:
                raise ConnectionError
            self._received += part
        line, _, self._received = self._received.partition(b"\n")
        return line


class PlanEstimator:
    """Estimates plans in confined processes, started when first needed.

    One process lays out what is asked for, the other answers at once, so that nothing keeps it waiting. Clients take
    turns at each, and have a budget of computing for both.
    """

    def __init__(self, settings: ServiceSettings, store: Store) -> None:
        self.budget = RateLimiter(COMPUTING_SHARE, MOST_COMPUTING_S)
        self._at_once, self._laid_out = (_EstimateQueue(settings, store, self.budget) for _ in range(2))

    async def estimate(
        self, client: str, values: Mapping[str, Any], inputs: Mapping[str, str], *, at_once: bool = False
    ) -> dict[str, Any]:
        """The estimate of the options of a plan and its files, at the client's turn.

        With `at_once` it may be scaled from another (KeptGrounds). Raises HeadlandError for what cannot be planned,
        BusyError where the client asks for too much.
        """
        wait_s = self.budget.measure_wait_s(client)
        if wait_s > 0.0:
            raise BusyError(f"Your estimates have computed much; ask again in {wait_s + 1.0:.0f} s, or run the plan.")
        queue = self._at_once if at_once else self._laid_out
        return await queue.estimate(client, {"values": dict(values), "at_once": at_once}, inputs)

    def close(self) -> None:
        """End the processes; what waits is dropped."""
        self._at_once.close()
        self._laid_out.close()


class _EstimateQueue:
    """One process, who waits for it, and the folder that it reads."""

    def __init__(self, settings: ServiceSettings, store: Store, budget: RateLimiter) -> None:
        self._work_folder, self._store = settings.data.resolve() / WORK_FOLDER, store
        self._memory_bytes = compute_reading_memory_limit_bytes()
        self._budget, self._queue = budget, FairQueue(1, MOST_WAITING_PER_CLIENT, pieces="estimates")
        self._process: _EstimatingProcess | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._lock = threading.Lock()

    async def estimate(self, client: str, order: Mapping[str, Any], inputs: Mapping[str, str]) -> dict[str, Any]:
        """The answer to an order, at the client's turn."""
        return await asyncio.wrap_future(self._queue.submit_work(client, lambda: self._run(client, order, inputs)))

    def close(self) -> None:
        """End the process; what waits is dropped."""
        self._queue.close()
        process = self._process
        if process is not None:
            process.interrupt()
        with self._lock:
            self._end_process()
            if self._folder is not None:
                self._folder.cleanup()
                self._folder = None

    def _run(self, client: str, order: Mapping[str, Any], inputs: Mapping[str, str]) -> dict[str, Any]:
        files = sha256(json.dumps(sorted(inputs.items())).encode()).hexdigest()
        with self._lock:
            folder = str(self._write_files(files, inputs))
            report = self._ask_process({**order, "folder": folder, "files": files})
            self._budget.spend_tokens(client, float(report.get("computing_s", 0.0)))
        if "value" in report or "refused" in report:
            value: dict[str, Any] = extract_value(report)
            return value
        if "fault" in report:
            logging.getLogger(__name__).error("An estimate ended in a fault: %s", ascii(report["fault"]))
            raise ServiceError(ESTIMATE_FAULT)
        if "memory" in report:
            raise ServiceError("Estimating this needed too much memory; run the plan instead.")
        if "late" in report:
            raise ServiceError(f"Estimating this takes longer than {LONGEST_ESTIMATE_S:.0f} s; run the plan instead.")
        raise BusyError("The process that estimates has ended; ask again, and see the log of the service if it stays.")

    def _write_files(self, files: str, inputs: Mapping[str, str]) -> Path:
        """The folder of the files of a request, below that which the process may read."""
        if self._folder is None:
            self._work_folder.mkdir(parents=True, exist_ok=True)
            self._folder = tempfile.TemporaryDirectory(dir=self._work_folder, prefix="estimates-")
        home = Path(self._folder.name)
        folder, unfinished = home / files, home / "unfinished"
        if not folder.is_dir():
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            write_inputs(self._store, inputs, unfinished)
            for old in sorted(home.iterdir(), key=lambda each: each.stat().st_mtime)[:-MOST_FOLDERS]:
                shutil.rmtree(old)
            unfinished.rename(folder)
        return folder

    def _ask_process(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """The answer of the process, {} where it ended meanwhile; the next one starts another."""
        if self._process is None:
            self._process = _EstimatingProcess(Path(order["folder"]).parent, self._memory_bytes)
        try:
            is_ready = self._process.wait_until_ready()
            answer = self._process.ask(order) if is_ready else None
        except OSError:
            self._end_process()
            return {}
        if not is_ready:
            raise BusyError("The simulator is still being loaded; ask again in a few seconds.")
        if answer is None:
            self._end_process()
            return {"late": True, "computing_s": LONGEST_ESTIMATE_S}
        report = parse_answer(answer)
        if "memory" in report:  # what it keeps of earlier answers fills it, and goes with it
            self._end_process()
        return report

    def _end_process(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.end()
