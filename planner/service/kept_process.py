"""Processes of the service that are started again whenever they end, and end with it."""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess

from planner.pipeline.executors import hold_interrupts

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
LOOK_PERIOD_S = 0.2


@dataclass
class KeptProcess:
    """A place for one process, whose main function is `run`: a thread starts it, and again whenever it has ended.

    `prepare` gives the name and the arguments of the next process, `look` is called a few times a second while it runs,
    and `conclude` with the name and the status of one that has ended by itself; it says whether that was a fault. One
    that lives shorter than `short_life_s` is started again after a pause, which doubles each time. One that has not
    ended `patience_s` after it was told to is killed. Several may share `is_stopping`.
    """

    run: Callable[..., None]
    prepare: Callable[[], tuple[str, Sequence[object]]]
    conclude: Callable[[str, int], bool]
    short_life_s: float
    patience_s: float
    look: Callable[[], None] = lambda: None
    name: str = ""
    process: SpawnProcess | None = None
    starts: int = 0
    is_stopping: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the process, and again whenever it ends; Ctrl-C does not reach it."""
        self._thread = threading.Thread(target=self._keep_running, name="headland-keeper", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the process, whatever it does, and start none again."""
        self.is_stopping.set()
        if self._thread is not None:
            self._thread.join()
        if self.process is not None:
            self.process.terminate()
            self.process.join(self.patience_s)
            if self.process.exitcode is None:
                self.process.kill()
                self.process.join()
            self.process = None

    def _keep_running(self) -> None:
        pause_s = 0.0
        while not self.is_stopping.wait(pause_s):
            begun_s = time.monotonic()
            try:
                self._run_process()
            except OSError:
                logging.getLogger(__name__).exception("The process %s cannot be started", self.name)
            lives_short = time.monotonic() - begun_s < self.short_life_s
            pause_s = min(max(2.0 * pause_s, FIRST_PAUSE_S), LONGEST_PAUSE_S) if lives_short else 0.0

    def _run_process(self) -> None:
        """Run one process to its end, or until this is stopping. Raises OSError where it cannot be started."""
        self.name, arguments = self.prepare()
        process = multiprocessing.get_context("spawn").Process(target=self.run, args=arguments, name=self.name)
        with hold_interrupts():
            process.start()
        self.process, self.starts = process, self.starts + 1
        while process.exitcode is None:
            if self.is_stopping.is_set():
                return
            process.join(LOOK_PERIOD_S)
            self.look()
        level = logging.WARNING if self.conclude(self.name, process.exitcode) else logging.INFO
        logging.getLogger(__name__).log(level, "The process %s ended with status %s.", self.name, process.exitcode)
        self.process = None


def end_with_service() -> None:
    """In a kept process: let it end when the service does, for whatever reason."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_wait_and_exit, args=(parent.sentinel,), daemon=True).start()


def _wait_and_exit(sentinel: int) -> None:
    wait([sentinel])
    os._exit(0)
