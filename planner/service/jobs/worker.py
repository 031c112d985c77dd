"""The process that does one job after another: it holds what it does by reporting, and ends with its server."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from pathlib import Path

from sqlalchemy.exc import DBAPIError

from planner.errors import HeadlandError
from planner.parameters import word_of
from planner.service.jobs.inputs import lay
from planner.service.jobs.kinds import kind_of
from planner.service.jobs.work import Work
from planner.service.settings import Settings
from planner.service.store import Store
from planner.service.store.jobs import Made
from planner.service.store.models import Job

LOST_STATUS = 4
"""Exit status of a worker whose job was cancelled or given to another: it stops at once, and is started anew."""
LOOK_S, BEATS, LONGEST_BEAT_S = 0.2, 5, 0.5
WORK, CACHE = "work", "field-times"
FAULT = "A fault of Headland ({words}); please report it."


def work_for_ever(settings: Settings, worker: str) -> None:
    """Do jobs until the server is gone or says so; the main function of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_outlive_nobody, daemon=True).start()
    store = Store(settings)
    while True:
        job = _claimed(store, worker)
        if job is None:
            time.sleep(LOOK_S)
        else:
            do_job(store, worker, job)


def do_job(store: Store, worker: str, job: Job) -> None:
    """Do one job that this worker has claimed, and keep its results or the reason why there are none."""
    held = Held(store, worker, job.number)
    with held.reporting():
        made, sentence = _done(store, job, held)

    def kept() -> bool:
        if held.latest is not None:
            store.report_job(job.number, worker, held.latest)
        if sentence is not None:
            return store.fail_job(job.number, worker, sentence)
        return store.finish_job(job.number, worker, made)

    _again_while_busy(kept)


def _done(store: Store, job: Job, held: Held) -> tuple[Sequence[Made], str | None]:
    """What a job made, or the sentence why it made nothing."""
    settings = store.settings
    try:
        with _folder(store, job):
            work = Work(job.work, settings.processes, held.told, str(settings.data.resolve() / CACHE))
            return kind_of(job.kind, settings)(work), None
    except HeadlandError as refusal:
        return (), refusal.spoken(word_of)
    except MemoryError:
        return (), "There is not enough memory for this; try fewer tractors or a smaller field."
    except Exception as error:
        logging.getLogger(__name__).exception("The job %s", job.id)
        return (), FAULT.format(words=" ".join(f"{type(error).__name__}: {error}".split())[:200])


@dataclass
class Held:
    """A job that a worker holds: a thread reports, and ends the process once the job is another's or nobody's."""

    store: Store
    worker: str
    number: int
    latest: tuple[int, int, str] | None = None
    over: threading.Event = field(default_factory=threading.Event)

    def told(self, done: int, all: int, words: str) -> None:
        """How far it is; written down with the next report."""
        self.latest = (done, all, words)

    @contextlib.contextmanager
    def reporting(self) -> Iterator[None]:
        """Report for as long as the body takes."""
        thread = threading.Thread(target=self._report, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self.over.set()
            thread.join()

    def _report(self) -> None:
        beat_s = min(LONGEST_BEAT_S, self.store.settings.lease_s / BEATS)
        while not self.over.wait(beat_s):
            with contextlib.suppress(DBAPIError):
                if not self.store.report_job(self.number, self.worker, self.latest):
                    os._exit(LOST_STATUS)


def _claimed(store: Store, worker: str) -> Job | None:
    """The next job, None where there is none or the database cannot say so just now."""
    try:
        return store.claim_job(worker)
    except DBAPIError as error:
        logging.getLogger(__name__).warning("The database: %s", error.orig)
        time.sleep(1.0)
        return None


def _again_while_busy(keep: Callable[[], bool], most: int = 5) -> None:
    """Keep a result; a database that cannot be reached is asked again, and at last another worker begins anew."""
    for attempt in range(most):
        try:
            keep()
            return
        except DBAPIError:
            if attempt == most - 1:
                raise
            time.sleep(0.5 * 2**attempt)


@contextlib.contextmanager
def _folder(store: Store, job: Job) -> Iterator[None]:
    """Be in a folder of its own with the files of a job, so that files are called what they were uploaded as."""
    base = store.settings.data.resolve() / WORK
    base.mkdir(parents=True, exist_ok=True)
    before = os.getcwd()
    with tempfile.TemporaryDirectory(dir=base, prefix=f"{job.id}-") as folder:
        lay(store, job.inputs, Path(folder))
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


def _outlive_nobody() -> None:
    """End as soon as the server does, however that ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(0)
