"""What the readers make of a file or a request, in a process of its own: no file can hold up or end the service."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from planner.pool import LocalPool, SerialExecutor
from planner.service.errors import ServiceError
from planner.service.jobs.asking import CHECKS
from planner.service.jobs.inputs import lay
from planner.service.jobs.summaries import SUMMARIES, UPLOADS
from planner.service.jobs.worker import WORK
from planner.service.settings import Settings
from planner.service.store import Store

T = TypeVar("T")
PATIENCE_S = 60.0


class Reader:
    """Reads in a process that is started when it is first needed, or here with `inline`."""

    def __init__(self, settings: Settings, store: Store, *, inline: bool = False) -> None:
        self._base, self._store, self._inline = settings.data.resolve() / WORK, store, inline
        self._executor: Executor | None = None
        self._lock = threading.Lock()
        self._known: dict[tuple[Any, ...], dict[str, Any]] = {}

    def warm(self) -> None:
        """Start the process and load what reading takes, so that the first who asks need not wait for it."""
        self._pool().submit(_load)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            pool, self._executor = self._executor, None
        if isinstance(pool, LocalPool):
            pool.__exit__(SystemExit, None, None)

    def check(self, kind: str, values: Mapping[str, Any], inputs: Mapping[str, str]) -> None:
        """Raise HeadlandError for a request that cannot be asked."""
        self._in_folder(inputs, CHECKS[kind], dict(values))

    def upload(self, kind: str, place: str, inputs: Mapping[str, str], **options: Any) -> None:
        """Raise HeadlandError for a file that is not one of its kind, read by the options that were given with it."""
        self._in_folder(inputs, partial(UPLOADS[kind], **options), place)

    def summary(self, kind: str, place: str, inputs: Mapping[str, str], **more: Any) -> dict[str, Any]:
        """What the reader of a kind makes of a file at its place, or of a sample; raises HeadlandError."""
        key = (kind, place, *sorted(inputs.items()), *sorted(more.items()))
        if key not in self._known:
            found = self._in_folder(inputs, partial(SUMMARIES[kind], **more), place)
            if len(self._known) > 100:
                self._known.clear()
            self._known[key] = found
        return self._known[key]

    def _in_folder(self, inputs: Mapping[str, str], read: Callable[..., T], *arguments: Any) -> T:
        self._base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=self._base, prefix="read-") as folder:
            lay(self._store, inputs, Path(folder))
            try:
                return self._pool().submit(_there, folder, read, *arguments).result(PATIENCE_S)
            except TimeoutError:
                self.close()
                raise ServiceError(f"This cannot be read within {PATIENCE_S:.0f} seconds; give less in it.") from None
            except BrokenExecutor:
                self.close()
                raise ServiceError("This cannot be read: the process that did so ended; give less in it.") from None

    def _pool(self) -> Executor:
        with self._lock:
            if self._executor is None:
                self._executor = SerialExecutor() if self._inline else LocalPool(1)
            return self._executor


def _there(folder: str, read: Callable[..., T], *arguments: Any) -> T:
    """Read inside a folder, so that files are called what they were uploaded as."""
    with ExitStack() as back:
        back.callback(os.chdir, os.getcwd())
        os.chdir(folder)
        return read(*arguments)


def _load() -> None:
    """Bring in what reading takes."""
    import planner.asked
    import planner.farm
    import planner.scenario  # noqa: F401
