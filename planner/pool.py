"""Executors that plan on this machine, and how any executor is asked.

The pool is the standard library's, with processes that are started afresh (`spawn`) and never forked: the caller may
have threads. A script that uses it keeps what it does under `if __name__ == "__main__":`, as any that starts processes.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, TypeVar

from planner.interrupts import quiet

T = TypeVar("T")
AHEAD = 2  # tasks handed to each process at a time: one to do and one to go on with


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


class LocalPool(ProcessPoolExecutor):
    """Fresh processes that end when the one that started them does, however that one ends.

    `completed` makes the caller one more hand: it does tasks itself where all processes have enough. Leaving the
    `with` block by an exception, such as Ctrl-C, ends what is under way.
    """

    def __init__(self, processes: int) -> None:
        context = multiprocessing.get_context("spawn")
        listen, self._lifeline = context.Pipe(duplex=False)
        with _lost():
            super().__init__(processes, context, _begin, (listen,))
        self.window = AHEAD * processes
        for _ in range(processes):
            self.submit(_load)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """As every executor's; a process that this starts is deaf to Ctrl-C from its first moment."""
        with _lost(), _deaf():
            return super().submit(fn, *args, **kwargs)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            quiet()
            # Else the caller may wait for ever at its end, to hand tasks to nobody.
            self._call_queue.cancel_join_thread()  # type: ignore[attr-defined]
            self._lifeline.close()
        return super().__exit__(kind, error, trace)


@contextmanager
def _lost() -> Iterator[None]:
    """A process that cannot even be started is a lost one: its broken pipe is not that of standard output."""
    try:
        yield
    except BrokenPipeError as error:
        raise BrokenProcessPool("a process could not be started") from error


@contextmanager
def _deaf() -> Iterator[None]:
    """Hold Ctrl-C back, where a system can; processes that start meanwhile never hear it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(lifeline: Connection) -> None:
    """In a new process: leave Ctrl-C to the one that collects the results, and end as soon as the lifeline does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_outlive_nobody, args=(lifeline,), daemon=True).start()


def _outlive_nobody(lifeline: Connection) -> None:
    try:
        lifeline.recv_bytes()
    except (EOFError, OSError):
        os._exit(0)


def _load() -> None:
    """Bring in what every candidate needs while the caller still prepares them."""
    import planner.candidates.evaluate  # noqa: F401


def local_pool(tasks: int, processes: int | None = None) -> Executor:
    """The executor for so many tasks on so many processes of this machine; by default one per core.

    The calling process counts as one: a single task or a single process needs no other.
    """
    count = min(processes or os.cpu_count() or 1, tasks)
    return SerialExecutor() if count <= 1 else LocalPool(count - 1)


def completed(executor: Executor, fn: Callable[..., T], work: list[tuple[Any, ...]]) -> Iterator[tuple[int, T]]:
    """(index, result) of fn(*work[index]) as they are done; what is not begun is cancelled if the caller leaves.

    A `LocalPool` has next to nothing that is not begun: it finishes that or, left by the exception, drops it.
    """
    window = executor.window if isinstance(executor, LocalPool) else len(work)
    waiting: dict[Future[T], int] = {}
    left = list(enumerate(work))[::-1]
    try:
        while left or waiting:
            while left and len(waiting) < window:
                index, arguments = left.pop()
                waiting[executor.submit(fn, *arguments)] = index
                yield from _finished(waiting)
            if left:
                index, arguments = left.pop()
                yield index, fn(*arguments)
            elif waiting:
                wait(waiting, return_when=FIRST_COMPLETED)
            yield from _finished(waiting)
    finally:
        if not isinstance(executor, LocalPool):  # whose broken end stumbles over what is cancelled but still listed
            for future in waiting:
                future.cancel()


def _finished(waiting: dict[Future[T], int]) -> Iterator[tuple[int, T]]:
    """Take out what is done."""
    for future in [future for future in waiting if future.done()]:
        index = waiting.pop(future)
        yield index, future.result()
