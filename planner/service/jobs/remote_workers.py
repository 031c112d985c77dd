"""Workers on any host that take jobs of a service from its PostgreSQL, until somebody ends them."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator

from sqlalchemy.exc import DBAPIError

from planner.service.jobs.workers import SUPERVISE_PERIOD_S, WorkerSupervisor
from planner.service.settings import ServiceSettings
from planner.service.store.carried_bytes import RemoteStore


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
