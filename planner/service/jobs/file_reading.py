"""What the readers make of a file or a request, in processes that can do nothing else: no file can hold up, end or
betray the service.

Who asks waits in a queue of his own and in no thread of the server's, and the queues take turns: a file that needs long
or much delays him alone.
"""

from __future__ import annotations

import asyncio
import os
import re
import tempfile
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from starlette.concurrency import run_in_threadpool

from planner.service.access.permissions import Caller
from planner.service.errors import BusyError
from planner.service.jobs.input_files import (
    DayJobRequest,
    DiagnosisJobRequest,
    JobRequest,
    PlanJobRequest,
    collect_inputs,
    write_inputs,
)
from planner.service.sandbox.reader_processes import ReadOrder, choose_reader, extract_reading_value
from planner.service.settings import LIMITS, MEGABYTE_BYTES, WORK_FOLDER, ServiceSettings
from planner.service.store.service_store import Store
from planner.service.store.store_part import LONGEST_NAME_CHARS
from planner.service.store.tables import JobRow
from reports.common.wording import get_effect_label

T = TypeVar("T")
MOST_WAITING_PER_CLIENT = 8
LONGEST_WAIT_S = 120.0

_WaitingPiece = tuple[float, "Future[Any]", Callable[[], Any]]

SHOWN_LOGS = 3  # in the name of a job


class FairQueue:
    """Does work in a few threads of its own, at most one piece at a time for each client, the clients in turn.

    A piece whose future is cancelled before its turn is not done, and does not count as waiting.

    Args:
        slots: pieces that are done at a time.
        most_per_client: pieces that may wait for one client.
        most_waiting: pieces that may wait at all.
        pieces: what they are called in refusals.
    """

    def __init__(
        self,
        slots: int = LIMITS.read_slots,
        most_per_client: int = MOST_WAITING_PER_CLIENT,
        most_waiting: int = LIMITS.most_waiting,
        pieces: str = "files",
    ) -> None:
        self._slots, self._most_per_client, self._most_waiting = slots, most_per_client, most_waiting
        self._pieces = pieces
        self._lock, self._threads = threading.Lock(), ThreadPoolExecutor(slots, thread_name_prefix="reading")
        self._waiting: OrderedDict[str, deque[_WaitingPiece]] = OrderedDict()
        self._busy_clients: set[str] = set()
        self._is_closed = False

    def submit_work(self, client: str, work: Callable[[], T]) -> Future[T]:
        """Queue a piece of work for a client; raises BusyError where too many wait, or no more is done."""
        future: Future[T] = Future()
        with self._lock:
            if self._is_closed:
                raise BusyError(f"No more {self._pieces} are taken, as the service is ending; ask again when it runs.")
            self._drop_cancelled()
            if len(self._waiting.get(client, ())) >= self._most_per_client:
                raise BusyError(
                    f"{self._most_per_client} {self._pieces} of yours are waiting already; ask again when some are "
                    "done."
                )
            if sum(map(len, self._waiting.values())) >= self._most_waiting:
                raise BusyError(f"{self._most_waiting} {self._pieces} are waiting already; ask again in a minute.")
            self._waiting.setdefault(client, deque()).append((time.monotonic(), future, work))
            self._start_next()
        return future

    def close(self) -> None:
        """Accept no more work, and drop what waits."""
        with self._lock:
            dropped = [future for own in self._waiting.values() for _, future, _ in own]
            self._waiting.clear()
            self._is_closed = True
            self._threads.shutdown(wait=False)
        for future in dropped:
            future.cancel()

    def _drop_cancelled(self) -> None:
        """Forget what nobody waits for any more; to be called with the lock."""
        for client, pieces in list(self._waiting.items()):
            if kept := deque(piece for piece in pieces if not piece[1].cancelled()):
                self._waiting[client] = kept
            else:
                del self._waiting[client]

    def _start_next(self) -> None:
        """Start the next piece of the client whose turn it is, where a thread is free; to be called with the lock."""
        client = next((each for each in self._waiting if each not in self._busy_clients), None)
        if client is None or len(self._busy_clients) >= self._slots:
            return
        client_queue = self._waiting.pop(client)
        piece = client_queue.popleft()
        if client_queue:
            self._waiting[client] = client_queue  # behind all others
        self._busy_clients.add(client)
        self._threads.submit(self._run_piece, client, *piece)

    def _run_piece(self, client: str, since: float, future: Future[Any], work: Callable[[], Any]) -> None:
        try:
            if future.set_running_or_notify_cancel():
                if time.monotonic() - since > LONGEST_WAIT_S:
                    raise BusyError(
                        f"This has waited {LONGEST_WAIT_S:.0f} s for its turn among {self._pieces}; try again when the "
                        "service is less busy."
                    )
                future.set_result(work())
        except BaseException as error:
            future.set_exception(error)
        finally:
            with self._lock:
                self._busy_clients.discard(client)
                self._start_next()


class FileReader:
    """Reads files in confined processes, started when first needed."""

    def __init__(self, settings: ServiceSettings, store: Store) -> None:
        self._work_folder, self._store = settings.data.resolve() / WORK_FOLDER, store
        self._queue, self._processes = FairQueue(), choose_reader()
        self._memory_bytes = compute_reading_memory_limit_bytes()
        self._lock = threading.Lock()
        self._shared_reads: dict[str, tuple[str, Future[Any]]] = {}

    def start_processes(self) -> None:
        """Start the processes, so that the first request need not wait for them."""
        self._processes.start_process()

    def close(self) -> None:
        """End the processes; waiting work is dropped."""
        self._queue.close()
        self._processes.close()

    async def read(
        self,
        client: str,
        reading: str,
        inputs: Mapping[str, str],
        arguments: list[Any],
        options: Mapping[str, Any] | None = None,
        *,
        is_shared: bool = False,
    ) -> Any:
        """The result of a reading (readings.READINGS) at the client's turn.

        Where it `is_shared`, who asks for the same while it is read waits for the same reading, and results are kept.
        Raises HeadlandError as the reading does, BusyError where too many of a client's wait.
        """
        options = dict(options or {})
        key = repr((reading, arguments, sorted(inputs.items()), sorted(options.items()))) if is_shared else ""
        work = partial(self._read_in_folder, reading, inputs, arguments, options)
        if not key:
            return await asyncio.wrap_future(self._queue.submit_work(client, work))
        with self._lock:
            owner, future = self._shared_reads.get(key, ("", None))
            # A piece that waits stays in the queue of its own client, so nobody else waits behind it.
            is_shared = future is not None and (owner == client or future.running() or future.done())
            if future is None or not is_shared:
                future = self._queue.submit_work(client, work)
                self._share_read(key, client, future)
        future.add_done_callback(lambda done: self._keep_result(key, client, done))
        return await asyncio.shield(asyncio.wrap_future(future))

    def _share_read(self, key: str, client: str, future: Future[Any]) -> None:
        """Let others have the result of a reading; to be called with the lock."""
        done_keys = [each for each, (_, shared) in self._shared_reads.items() if shared.done()]
        if len(done_keys) >= LIMITS.most_cached_summaries:
            for each in done_keys:
                del self._shared_reads[each]
        self._shared_reads[key] = client, future

    def _keep_result(self, key: str, client: str, future: Future[Any]) -> None:
        """Let others have what a reading came to, though another of the same may wait; forget one that failed."""
        has_failed = future.cancelled() or future.exception() is not None
        with self._lock:
            _, shared = self._shared_reads.get(key, ("", future))
            if has_failed and shared is future:
                self._shared_reads.pop(key, None)
            elif not has_failed and not shared.done():
                self._shared_reads[key] = client, future

    def _read_in_folder(
        self, reading: str, inputs: Mapping[str, str], arguments: list[Any], options: dict[str, Any]
    ) -> Any:
        """Write the files of a reading to a folder of its own and read them there."""
        self._work_folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=self._work_folder, prefix="read-") as folder:
            write_inputs(self._store, inputs, Path(folder))
            size_bytes = sum(each.stat().st_size for each in Path(folder).rglob("*") if each.is_file())
            seconds = LIMITS.longest_read_s if reading.startswith("check ") else compute_read_timeout_s(size_bytes)
            order = ReadOrder(reading, folder, arguments, options, seconds, self._memory_bytes)
            return extract_reading_value(self._processes.read_order(order), seconds, self._memory_bytes)


def compute_read_timeout_s(size_bytes: int) -> float:
    """Time limit for reading files of this total size, seconds; small files get little."""
    return min(
        LIMITS.longest_read_s,
        LIMITS.shortest_read_s + LIMITS.read_s_per_megabyte * max(0.0, size_bytes / MEGABYTE_BYTES - 1.0),
    )


def compute_reading_memory_limit_bytes() -> int:
    """Memory limit of one reading, bytes: an eighth of the memory of the machine, within bounds."""
    try:
        total_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return LIMITS.most_memory_bytes
    return max(LIMITS.least_memory_bytes, min(LIMITS.most_memory_bytes, total_bytes // 8))


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
