"""As many workers as there should be: who ends is replaced, and what it had goes back into the queue."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import secrets
import shutil
import socket
import threading
import time
from dataclasses import dataclass
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess

from sqlalchemy.exc import DBAPIError

from planner.service.jobs.worker import LOST_STATUS, WORK, work_for_ever
from planner.service.settings import Settings
from planner.service.store import Store

LOOK_S, PATIENCE_S = 1.0, 5.0
SOON_S, LONGEST_PAUSE_S = 1.0, 30.0
"""A worker that ends sooner than that is replaced after a pause, which doubles each time."""


@dataclass
class _Place:
    """One place for a worker, and who has it."""

    process: SpawnProcess | None = None
    worker: str = ""
    since: float = 0.0
    pause_s: float = 0.0


class Supervisor:
    """Starts workers and keeps them, in a thread of its own."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self.settings, self.store = settings, store
        self._context = multiprocessing.get_context("spawn")
        self._places = [_Place() for _ in range(settings.workers)]
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="headland-workers", daemon=True)

    def start(self) -> None:
        """Begin; folders that an earlier service left behind in the midst of work go."""
        shutil.rmtree(self.settings.data / WORK, ignore_errors=True)
        self._thread.start()

    def stop(self) -> None:
        """End all workers; what they were at goes back into the queue, and no try of it is counted."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        for place in self._places:
            self._end(place)

    def pids(self) -> list[int]:
        """Processes that work now."""
        return [one.process.pid for one in self._places if one.process is not None and one.process.pid is not None]

    def _watch(self) -> None:
        while not self._over.is_set():
            for place in self._places:
                with contextlib.suppress(DBAPIError):
                    self._look_after(place)
            with contextlib.suppress(DBAPIError):
                self.store.release_expired()
            sentinels = [place.process.sentinel for place in self._places if place.process is not None]
            if sentinels and not wait(sentinels, timeout=LOOK_S):
                continue
            self._over.wait(0.05 if sentinels else LOOK_S)

    def _look_after(self, place: _Place) -> None:
        """Start a worker where there is none; what one that ended had goes back."""
        if place.process is not None and place.process.exitcode is not None:
            lived_s, status = time.monotonic() - place.since, place.process.exitcode
            logging.getLogger(__name__).info("The worker %s ended with status %s.", place.worker, status)
            self.store.release_jobs(place.worker, blame=status != LOST_STATUS)
            place.process = None
            place.pause_s = min(max(2 * place.pause_s, SOON_S), LONGEST_PAUSE_S) if lived_s < SOON_S else 0.0
            place.since = time.monotonic()
        if place.process is None and time.monotonic() - place.since >= place.pause_s:
            place.worker = f"{socket.gethostname()[:40]}:{os.getpid()}:{secrets.token_hex(4)}"
            place.process = self._context.Process(
                target=work_for_ever, args=(self.settings, place.worker), name="headland-worker"
            )
            place.process.start()
            place.since = time.monotonic()

    def _end(self, place: _Place) -> None:
        if place.process is None:
            return
        place.process.terminate()
        place.process.join(PATIENCE_S)
        if place.process.exitcode is None:
            place.process.kill()
            place.process.join()
        with contextlib.suppress(DBAPIError):
            self.store.release_jobs(place.worker, blame=False)
        place.process = None
