"""What the readers make of a file or a request, in processes that can do nothing else: no file can hold up, end or
betray the service.

Who asks waits in a queue of his own and in no thread of the server's, and the queues take turns: a file that needs long
or much delays him alone.
"""

from __future__ import annotations

import asyncio
import os
import tempfile
import threading
import time
import traceback
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar

from starlette.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection

from planner.errors import HeadlandError
from planner.service.access.permissions import Caller
from planner.service.errors import BusyError
from planner.service.jobs.input_files import write_inputs
from planner.service.jobs.workers import WORK_FOLDER
from planner.service.sandbox.confined_reading import list_readings
from planner.service.sandbox.reader_processes import ReadOrder, build_refusal, choose_reader, extract_reading_value
from planner.service.settings import MEGABYTE_BYTES, ServiceSettings
from planner.service.store.service_store import Store

T = TypeVar("T")
READ_SLOTS, MOST_WAITING_PER_CLIENT, MOST_WAITING = 4, 8, 200
LONGEST_WAIT_S = 120.0

_WaitingPiece = tuple[float, "Future[Any]", Callable[[], Any]]


class FairQueue:
    """Does work in a few threads of its own, at most one piece at a time for each client, the clients in turn.

    Args:
        slots: pieces that are done at a time.
        each: pieces that may wait for one client.
        all: pieces that may wait at all.
    """

    def __init__(
        self, slots: int = READ_SLOTS, most_per_client: int = MOST_WAITING_PER_CLIENT, most_waiting: int = MOST_WAITING
    ) -> None:
        self._slots, self._most_per_client, self._most_waiting = slots, most_per_client, most_waiting
        self._changed = threading.Condition()
        self._waiting: OrderedDict[str, deque[_WaitingPiece]] = OrderedDict()
        self._busy_clients: set[str] = set()
        self._threads = 0
        self._closed = False

    def submit_work(self, client: str, work: Callable[[], T]) -> Future[T]:
        """Queue a piece of work for a client; raises BusyError where too many wait."""
        future: Future[T] = Future()
        with self._changed:
            waiting = sum(map(len, self._waiting.values()))
            if len(self._waiting.get(client, ())) >= self._most_per_client:
                raise BusyError(
                    f"{self._most_per_client} files of yours wait to be read already; ask again when some are done."
                )
            if waiting >= self._most_waiting:
                raise BusyError(f"{self._most_waiting} files wait to be read already; ask again in a minute.")
            self._waiting.setdefault(client, deque()).append((time.monotonic(), future, work))
            if self._threads < min(self._slots, len(self._busy_clients) + waiting + 1):
                self._threads += 1
                threading.Thread(target=self._run_thread, name=f"reading {self._threads}", daemon=True).start()
            self._changed.notify()
        return future

    def close(self) -> None:
        """Accept no more work, and drop what waits."""
        with self._changed:
            self._closed = True
            dropped = [future for own in self._waiting.values() for _, future, _ in own]
            self._waiting.clear()
            self._changed.notify_all()
        for future in dropped:
            future.cancel()

    def _run_thread(self) -> None:
        while (piece := self._take_next()) is not None:
            client, (since, future, work) = piece
            try:
                self._run_piece(since, future, work)
            finally:
                with self._changed:
                    self._busy_clients.discard(client)
                    self._changed.notify()

    def _take_next(self) -> tuple[str, _WaitingPiece] | None:
        """The next piece of the client whose turn it is; None at the end."""
        with self._changed:
            while not self._closed:
                for client in self._waiting:
                    if client not in self._busy_clients:
                        client_queue = self._waiting.pop(client)
                        piece = client_queue.popleft()
                        if client_queue:
                            self._waiting[client] = client_queue  # behind all others
                        self._busy_clients.add(client)
                        return client, piece
                self._changed.wait()
            return None

    def _run_piece(self, since: float, future: Future[Any], work: Callable[[], Any]) -> None:
        if not future.set_running_or_notify_cancel():
            return
        try:
            if time.monotonic() - since > LONGEST_WAIT_S:
                raise BusyError(
                    f"This file has waited {LONGEST_WAIT_S:.0f} s to be read; try again when the service is less busy."
                )
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)


LONGEST_READ_S, SHORTEST_READ_S, READ_S_PER_MEGABYTE = 60.0, 10.0, 5.0
"""At most, for up to a megabyte, and for every further one."""
LEAST_MEMORY_BYTES, MOST_MEMORY_BYTES = 512 * 2**20, 2 * 2**30
MOST_CACHED_SUMMARIES = 100
_WORKING_FOLDER_LOCK = threading.Lock()  # a process has one working folder


class FileReader:
    """Reads files in confined processes, started when first needed, or with `reads_inline` in this process."""

    def __init__(self, settings: ServiceSettings, store: Store, *, reads_inline: bool = False) -> None:
        self._work_folder, self._store, self._reads_inline = settings.data.resolve() / WORK_FOLDER, store, reads_inline
        self._queue, self._processes = FairQueue(), choose_reader()
        self._memory_bytes = compute_reading_memory_limit_bytes()
        self._lock = threading.Lock()
        self._cache: dict[str, Any] = {}
        self._running_reads: dict[str, tuple[str, Future[Any]]] = {}

    def start_processes(self) -> None:
        """Start the processes, so that the first request need not wait for them."""
        if not self._reads_inline:
            self._processes.start_process()

    def close(self) -> None:
        """End the processes; waiting work is dropped."""
        self._queue.close()
        self._processes.close()
        self._queue, self._processes = FairQueue(), choose_reader()

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
        """The result of a reading (confined_reading.list_readings) at the client's turn.

        Where it `is_shared`, who asks for the same while it is read waits for the same reading, and results are kept.
        Raises HeadlandError as the reading does, BusyError where too many of a client's wait.
        """
        options = dict(options or {})
        key = repr((reading, arguments, sorted(inputs.items()), sorted(options.items()))) if is_shared else ""

        def read_and_cache() -> Any:
            result = self._read_in_folder(reading, inputs, arguments, options)
            if key:
                with self._lock:
                    if len(self._cache) >= MOST_CACHED_SUMMARIES:
                        self._cache.clear()
                    self._cache[key] = result
            return result

        with self._lock:
            if key in self._cache:
                return self._cache[key]
            owner, shared = self._running_reads.get(key, ("", None))
            # A piece that waits stays in the queue of its own client, so nobody else waits behind it.
            if self._reads_inline:
                future = None
            elif shared is not None and (owner == client or shared.running()):
                future = shared
            else:
                future = self._queue.submit_work(client, read_and_cache)
            if key and future is not None:
                self._running_reads[key] = client, future
        if future is None:
            return await run_in_threadpool(read_and_cache)
        if not key:
            return await asyncio.wrap_future(future)
        future.add_done_callback(lambda done: self._forget_running(key, done))
        return await asyncio.shield(asyncio.wrap_future(future))

    def _forget_running(self, key: str, future: Future[Any]) -> None:
        with self._lock:
            if self._running_reads.get(key, ("", None))[1] is future:
                del self._running_reads[key]

    def _read_in_folder(
        self, reading: str, inputs: Mapping[str, str], arguments: list[Any], options: dict[str, Any]
    ) -> Any:
        """Write the files of a reading to a folder of its own and read them there."""
        self._work_folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=self._work_folder, prefix="read-") as folder:
            write_inputs(self._store, inputs, Path(folder))
            if self._reads_inline:
                return _read_in_process(folder, list_readings()[reading], arguments, options)
            size_bytes = sum(each.stat().st_size for each in Path(folder).rglob("*") if each.is_file())
            seconds = LONGEST_READ_S if reading.startswith("check ") else compute_read_timeout_s(size_bytes)
            order = ReadOrder(reading, folder, arguments, options, seconds, self._memory_bytes)
            return extract_reading_value(self._processes.read_order(order), seconds, self._memory_bytes)


def build_client_queue_key(request: HTTPConnection, caller: Caller) -> str:
    """Name of the client for the queue: its token, or its address without one."""
    if caller.token_sha256 is not None:
        return f"token {caller.name}"
    return f"address {request.client.host if request.client else ''}"


def compute_read_timeout_s(size_bytes: int) -> float:
    """Time limit for reading files of this total size, seconds; small files get little."""
    return min(LONGEST_READ_S, SHORTEST_READ_S + READ_S_PER_MEGABYTE * max(0.0, size_bytes / MEGABYTE_BYTES - 1.0))


def compute_reading_memory_limit_bytes() -> int:
    """Memory limit of one reading, bytes: an eighth of the memory of the machine, within bounds."""
    try:
        total_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return MOST_MEMORY_BYTES
    return max(LEAST_MEMORY_BYTES, min(MOST_MEMORY_BYTES, total_bytes // 8))


def _read_in_process(
    folder: str, read_function: Callable[..., Any], arguments: list[Any], options: dict[str, Any]
) -> Any:
    """Read inside a folder, where files have the names of their uploads."""
    with _WORKING_FOLDER_LOCK, ExitStack() as stack:
        stack.callback(os.chdir, os.getcwd())
        os.chdir(folder)
        try:
            return read_function(*arguments, **options)
        except (HeadlandError, MemoryError):
            raise
        except Exception:
            raise build_refusal(traceback.format_exc()) from None
