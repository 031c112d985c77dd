"""Processes of the service that are started again whenever they end, and end with it."""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess

from planner.pipeline.executors import hold_interrupts

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0


@dataclass
class KeptProcess:
    """A place for one process, whose main function is `run`; it is started, forgotten when it has ended, and so on.

    One that lives shorter than `short_life_s` is started again after a pause, which doubles each time. One that has not
    ended `patience_s` after it was told to is killed.
    """

    name: str
    run: Callable[..., None]
    short_life_s: float
    patience_s: float
    process: SpawnProcess | None = None
    _changed_s: float = float("-inf")
    _pause_s: float = 0.0

    @property
    def is_due(self) -> bool:
        """Whether there is no process and it is time to start one."""
        return self.process is None and time.monotonic() - self._changed_s >= self._pause_s

    @property
    def end_status(self) -> int | None:
        """The status of a process that has ended; None while it runs or there is none."""
        return None if self.process is None else self.process.exitcode

    def start(self, *arguments: object) -> None:
        """Start the process; Ctrl-C does not reach it. Raises OSError, after which the next start waits too."""
        self._changed_s = time.monotonic()
        try:
            process = multiprocessing.get_context("spawn").Process(target=self.run, args=arguments, name=self.name)
            with hold_interrupts():
                process.start()
        except OSError:
            self._lengthen_pause()
            raise
        self.process = process

    def forget(self, *, is_fault: bool = True) -> None:
        """Forget a process that has ended; the next start waits if that was soon after its start."""
        level = logging.WARNING if is_fault else logging.INFO
        logging.getLogger(__name__).log(level, "The process %s ended with status %s.", self.name, self.end_status)
        if time.monotonic() - self._changed_s < self.short_life_s:
            self._lengthen_pause()
        else:
            self._pause_s = 0.0
        self.process, self._changed_s = None, time.monotonic()

    def end(self) -> None:
        """End the process, whatever it does."""
        if self.process is None:
            return
        self.process.terminate()
        self.process.join(self.patience_s)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
        self.process = None

    def _lengthen_pause(self) -> None:
        self._pause_s = min(max(2.0 * self._pause_s, FIRST_PAUSE_S), LONGEST_PAUSE_S)


def end_with_service() -> None:
    """In a kept process: let it end when the service does, for whatever reason."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_wait_and_exit, args=(parent.sentinel,), daemon=True).start()


def _wait_and_exit(sentinel: int) -> None:
    wait([sentinel])
    os._exit(0)
