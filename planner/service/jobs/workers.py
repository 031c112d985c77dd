"""Worker processes, which run one job after another, and their supervisor.

A worker holds its job by reporting it, and ends with the server. A worker that ends is replaced, and its job goes back
into the queue.
"""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar, cast

from sqlalchemy.exc import DBAPIError, OperationalError

from planner.errors import HeadlandError, render_refusal
from planner.service.errors import StorageError
from planner.service.jobs.input_files import JobContext, JobFunction, write_inputs
from planner.service.kept_process import KeptProcess, end_with_service
from planner.service.settings import WORK_FOLDER, ServiceSettings
from planner.service.store.disk_storage import DISK_FULL, is_disk_full
from planner.service.store.job_queue import JobStore, RemoteStore, ResultFiles
from planner.service.store.service_store import Store
from planner.service.store.tables import JobRow

T = TypeVar("T")
LOST_STATUS = 4
"""Exit status of a worker whose job was cancelled or given to another, or that lost the database: it is started again,
and nothing is counted against the job."""
CLAIM_PERIOD_S, REPORTS_PER_LEASE, LONGEST_REPORT_PERIOD_S = 0.2, 5, 0.5
CACHE_FOLDER = "field-times"
DISK_RETRY_S, LONGEST_DISK_RETRY_S = 1.0, 30.0
MOST_ATTEMPTS = 5  # to write what became of a job to a database that cannot be reached
DATABASE_WRITE_ERRORS = (DBAPIError, StorageError)
"""Errors for which nothing can be written to the database now."""
JOB_FAULT = "This is a fault of Headland ({words}); please report it."
SUPERVISE_PERIOD_S = 1.0


def get_job_function(name: str, settings: ServiceSettings) -> JobFunction:
    """The function of a kind of job; its modules are loaded only now."""
    if name in settings.job_functions:
        return cast(JobFunction, settings.job_functions[name])
    from planner.service.jobs.job_runs import JOB_FUNCTIONS

    return JOB_FUNCTIONS[name]


def run_worker(
    settings: ServiceSettings, worker: str, open_store: Callable[[ServiceSettings], JobStore] = Store
) -> None:
    """Run jobs until the server is gone or ends this; the main function of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_service()
    store, is_prepared = open_store(settings), bool(settings.job_functions)  # other kinds of jobs load what they need
    while True:
        job = _claim_next_job(store, worker)
        if job is not None:
            try:
                run_and_store_job(store, worker, job)
            except OperationalError as error:
                logging.getLogger(__name__).warning("The database: %s", error)
                sys.exit(LOST_STATUS)
        elif is_prepared:
            time.sleep(CLAIM_PERIOD_S)
        else:
            from planner.service.jobs.job_runs import load_job_libraries

            load_job_libraries()
        is_prepared = True


def run_and_store_job(store: JobStore, worker: str, job: JobRow) -> None:
    """Run one claimed job, and store its results or the reason for its failure.

    Where the disk has no room for it, it waits, and nothing is counted against it.
    """
    claim = ClaimedJob(store, worker, job.number)
    with claim.report_while_running():
        files, sentence = _retry_while_disk_full(store, claim, lambda: _compute_job_results(store, job, claim))
        # Bytes first, as they need the most room; reports go on meanwhile.
        _retry_while_disk_full(store, claim, lambda: store.keep_results(job.number, files))

    attempt = 0
    while True:
        try:
            if claim.latest_progress is not None:
                store.report_job(job.number, worker, claim.latest_progress)
            if sentence is not None:
                store.fail_job(job.number, worker, sentence)
            else:
                store.finish_job(job.number, worker, files)
            return
        except StorageError:  # no other worker could do anything meanwhile, so that there is no end of attempts
            time.sleep(DISK_RETRY_S)
        except DBAPIError:
            attempt += 1
            if attempt == MOST_ATTEMPTS:  # the job is left to another worker
                raise
            time.sleep(0.5 * 2 ** (attempt - 1))


def _compute_job_results(store: JobStore, job: JobRow, claim: ClaimedJob) -> tuple[ResultFiles, str | None]:
    """The results of a job, or the sentence why it failed. Raises StorageError where the disk is full."""
    settings = store.settings
    try:
        with _enter_job_folder(store, job):
            context = JobContext(
                job.work, settings.processes, claim.note_progress, str(settings.data.resolve() / CACHE_FOLDER)
            )
            results = get_job_function(job.kind, settings)(context)
        return {
            name: content.encode("utf-8", "replace") if isinstance(content, str) else content
            for name, content in results.items()
        }, None
    except StorageError:
        raise
    except HeadlandError as refusal:
        return {}, render_refusal(refusal)
    except MemoryError:
        return {}, "This needs more memory than there is; try fewer tractors or a smaller field."
    except Exception as error:
        if is_disk_full(error, settings.data):
            raise StorageError(DISK_FULL) from error
        if isinstance(error, OperationalError):  # inputs may come by the database
            raise
        logging.getLogger(__name__).exception("The job %s", job.id)
        return {}, JOB_FAULT.format(words=" ".join(f"{type(error).__name__}: {error}".split())[:200])


@dataclass
class ClaimedJob:
    """A job that a worker holds: a thread reports it, and ends the process once the worker has lost the job."""

    store: JobStore
    worker: str
    job_number: int
    latest_progress: tuple[int, int, str] | None = None
    is_over: threading.Event = field(default_factory=threading.Event)

    def note_progress(self, done: int, all: int, words: str) -> None:
        """Note the progress; the next report stores it."""
        self.latest_progress = (done, all, words)

    @contextlib.contextmanager
    def report_while_running(self) -> Iterator[None]:
        """Report while the body runs."""
        thread = threading.Thread(target=self._report_forever, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self.is_over.set()
            thread.join()

    def _report_forever(self) -> None:
        period_s = min(LONGEST_REPORT_PERIOD_S, self.store.settings.lease_s / REPORTS_PER_LEASE)
        while not self.is_over.wait(period_s):
            with contextlib.suppress(*DATABASE_WRITE_ERRORS):
                if not self.store.report_job(self.job_number, self.worker, self.latest_progress):
                    os._exit(LOST_STATUS)


def _retry_while_disk_full(store: JobStore, claim: ClaimedJob, action: Callable[[], T]) -> T:
    """The result of an action that writes to the disk or a store; while there is no room, it is retried.

    The job says that it waits until an attempt reports something or succeeds.
    """
    pause_s, before, waiting = DISK_RETRY_S, claim.latest_progress, None
    while True:
        try:
            result = action()
            break
        except StorageError as error:
            logging.getLogger(__name__).warning("The job %s %s: %s", claim.job_number, error.waiting, error)
            words = error.waiting
        before = before if claim.latest_progress is waiting else claim.latest_progress
        done, all_, _ = before or (0, 0, "")
        waiting = claim.latest_progress = (done, all_, words)
        time.sleep(pause_s)
        pause_s = min(2 * pause_s, LONGEST_DISK_RETRY_S)
    if waiting is not None and claim.latest_progress is waiting:
        claim.latest_progress = before or (0, 0, "")
    return result


def _claim_next_job(store: JobStore, worker: str) -> JobRow | None:
    """The next job; None where there is none or the database does not answer."""
    try:
        return store.claim_job(worker)
    except DATABASE_WRITE_ERRORS as error:
        logging.getLogger(__name__).warning("The database: %s", error)
        time.sleep(1.0)
        return None


@contextlib.contextmanager
def _enter_job_folder(store: JobStore, job: JobRow) -> Iterator[None]:
    """Work in a folder of its own with the files of a job, which keep the names of their uploads."""
    base = store.settings.data.resolve() / WORK_FOLDER
    base.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=base, prefix=f"{job.id}-") as folder:
        write_inputs(store, job.inputs, Path(folder))
        with contextlib.chdir(folder):
            yield


class WorkerSupervisor:
    """Keeps worker processes and tends the queue, in a thread of its own."""

    def __init__(self, settings: ServiceSettings, store: JobStore) -> None:
        self.settings, self.store = settings, store
        self._is_stopping = threading.Event()
        self._slots = [
            KeptProcess(
                run_worker, self._prepare_worker, self._release_ended, short_life_s=1.0, patience_s=10.0,
                is_stopping=self._is_stopping,
            )
            for _ in range(settings.workers)
        ]  # fmt: skip
        self._was_unwritable = False
        self._thread = threading.Thread(target=self._tend_queue, name="headland-workers", daemon=True)

    def start(self) -> None:
        """Start; delete work folders that an earlier service left behind."""
        shutil.rmtree(self.settings.data / WORK_FOLDER, ignore_errors=True)
        for slot in self._slots:
            slot.start()
        self._thread.start()

    def stop(self) -> None:
        """End all workers; their jobs go back into the queue without counting a try."""
        self._is_stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        for slot in self._slots:
            slot.stop()
            with contextlib.suppress(*DATABASE_WRITE_ERRORS):
                self.store.release_jobs(slot.name, counts_try=False)

    def _prepare_worker(self) -> tuple[str, Sequence[object]]:
        name = f"{socket.gethostname()[:40]}:{os.getpid()}:{secrets.token_hex(4)}"
        return name, (self.settings, name, type(self.store))

    def _release_ended(self, name: str, status: int) -> bool:
        """Put the job of a worker that has ended back, as soon as that can be written; whether its end was a fault."""
        while not self._is_stopping.is_set():
            with contextlib.suppress(*DATABASE_WRITE_ERRORS):
                self.store.release_jobs(name, counts_try=status != LOST_STATUS)
                break
            self._is_stopping.wait(SUPERVISE_PERIOD_S)
        return status != LOST_STATUS

    def _tend_queue(self) -> None:
        while not self._is_stopping.wait(SUPERVISE_PERIOD_S):
            self._release_unreported()

    def _release_unreported(self) -> None:
        """Put back jobs that nobody reports; after a time without writes, living workers may report first."""
        try:
            if self._was_unwritable:
                self.store.renew_leases()
                self._was_unwritable = False
            else:
                self.store.tend_queue()
        except DATABASE_WRITE_ERRORS:
            self._was_unwritable = True


def run_remote_workers(settings: ServiceSettings, report_start: Callable[[], None]) -> None:
    """Run `settings.workers` jobs at a time until SIGTERM or Ctrl-C; jobs that are under way then are given back.

    Raises DatabaseError where the database cannot be used, VersionError as soon as the service is of another version.
    """
    with contextlib.closing(RemoteStore(settings)) as store, _note_end_signals() as is_ending:
        supervisor = WorkerSupervisor(settings, store)
        supervisor.start()
        report_start()
        try:
            while not is_ending.wait(SUPERVISE_PERIOD_S):
                with contextlib.suppress(DBAPIError):  # it may come back
                    store.check_version()
        finally:
            supervisor.stop()


@contextlib.contextmanager
def _note_end_signals() -> Iterator[threading.Event]:
    """An event that SIGTERM and Ctrl-C set, instead of ending the process at once."""
    is_ending = threading.Event()
    previous = {number: signal.signal(number, lambda *_: is_ending.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield is_ending
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
