"""Executors that plan on this machine, and how any executor is asked.

Processes of the pool are started as fresh interpreters, never forked: the caller may have threads, and its main
module is not run again in them. They hear of their tasks through a pipe and end when it is closed, so none outlives
the process that started it, however that one ends.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from multiprocessing.spawn import get_executable
from types import TracebackType
from typing import Any, Self, TypeVar

T = TypeVar("T")
Task = tuple[Future[Any], Callable[..., Any], tuple[Any, ...], dict[str, Any]]
BOOT = "import sys; sys.path[:] = {path!r}; from planner.worker import main; main()"
LOST = "A worker process ended before its result was there, perhaps for want of memory; use fewer processes."


class SerialExecutor(Executor):
    """Does every task where it is submitted, before `submit` returns."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future that is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class WorkerPool(Executor):
    """Fresh processes that start at once, and the caller as one more hand while it waits (`assist`).

    Tasks and results are pickled. A task that fails raises its error from the future; BrokenExecutor where the
    process itself was lost. Leaving the `with` block by an exception, such as Ctrl-C, ends what is under way.
    """

    def __init__(self, processes: int) -> None:
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._processes = [_start() for _ in range(processes)]
        self._threads = [
            threading.Thread(target=self._feed, args=(process,), daemon=True) for process in self._processes
        ]
        self._closed = False
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future of the call in one of the processes, or in the caller's own when it assists."""
        if self._closed:
            raise RuntimeError("This pool is shut down; make another.")
        future: Future[T] = Future()
        self._tasks.put((future, fn, args, kwargs))
        return future

    def assist(self) -> bool:
        """Do one task that nobody has begun, here and now; False when there is none."""
        try:
            task = self._tasks.get_nowait()
        except queue.Empty:
            return False
        if task is None:
            self._tasks.put(None)
            return False
        future, fn, args, kwargs = task
        if future.set_running_or_notify_cancel():
            try:
                future.set_result(fn(*args, **kwargs))
            except Exception as error:
                future.set_exception(error)
        return True

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; the processes end when those submitted, or only those begun, are done."""
        if not self._closed:
            self._closed = True
            if cancel_futures:
                self._drop()
            for _ in self._threads:
                self._tasks.put(None)
        if wait:
            for thread in self._threads:
                thread.join()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            for process in self._processes:
                process.kill()
        self.shutdown(cancel_futures=kind is not None)
        return None

    def __enter__(self) -> Self:
        return self

    def _drop(self) -> None:
        """Cancel what nobody has begun."""
        while True:
            try:
                task = self._tasks.get_nowait()
            except queue.Empty:
                return
            if task is not None:
                task[0].cancel()

    def _feed(self, process: subprocess.Popen[bytes]) -> None:
        """Hand tasks to one process, one at a time, until there are no more."""
        with contextlib.suppress(OSError), process:  # closing the pipe of a process that was killed may complain
            while (task := self._tasks.get()) is not None:
                future, *call = task
                if not future.set_running_or_notify_cancel():
                    continue
                try:
                    done, value = _ask(process, call)
                except (EOFError, OSError, pickle.UnpicklingError):
                    future.set_exception(BrokenExecutor(LOST))
                    return
                except Exception as error:
                    future.set_exception(error)
                    continue
                if done:
                    future.set_result(value)
                else:
                    future.set_exception(value)


def _start() -> subprocess.Popen[bytes]:
    """A process that takes tasks; in a group of its own, so that Ctrl-C is for the one that collects the results."""
    path = [os.path.abspath(place) for place in sys.path]
    words = [os.fsdecode(get_executable()), "-c", BOOT.format(path=path)]
    if os.name == "posix":
        return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, process_group=0)
    flags = int(getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0))
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, creationflags=flags)


def _ask(process: subprocess.Popen[bytes], call: list[Any]) -> tuple[bool, Any]:
    """Send a call, its length first, and wait for (True, its result) or (False, its error)."""
    assert process.stdin is not None and process.stdout is not None
    text = pickle.dumps(call)
    process.stdin.write(len(text).to_bytes(8, "big") + text)
    process.stdin.flush()
    answer: tuple[bool, Any] = pickle.load(process.stdout)
    return answer


def local_pool(tasks: int, processes: int | None = None) -> Executor:
    """The executor for so many tasks on so many processes of this machine; by default one per core.

    The calling process counts as one: a single task or a single process needs no other.
    """
    count = min(processes or os.cpu_count() or 1, tasks)
    return SerialExecutor() if count <= 1 else WorkerPool(count - 1)


def completed(executor: Executor, fn: Callable[..., T], work: list[tuple[Any, ...]]) -> Iterator[tuple[int, T]]:
    """(index, result) of fn(*work[index]) as they are done; what is not begun is cancelled if the caller leaves."""
    waiting: dict[Future[T], int] = {}
    assist: Callable[[], bool] = getattr(executor, "assist", lambda: False)
    try:
        for index, arguments in enumerate(work):
            waiting[executor.submit(fn, *arguments)] = index
            yield from _finished(waiting)
        while waiting:
            if not assist():
                wait(waiting, return_when=FIRST_COMPLETED)
            yield from _finished(waiting)
    finally:
        for future in waiting:
            future.cancel()


def _finished(waiting: dict[Future[T], int]) -> Iterator[tuple[int, T]]:
    """Take out what is done."""
    for future in [future for future in waiting if future.done()]:
        index = waiting.pop(future)
        yield index, future.result()
