"""Executors that plan in processes of this machine or on a Dask cluster, and how tasks are given to any executor.

The pool starts fresh processes (`spawn`) and never forks, as the caller may have threads. They do not run the script of
the caller: it needs no `if __name__ == "__main__":`. The cluster (https://distributed.dask.org) needs
`headland[cluster]`.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from types import ModuleType, TracebackType
from typing import Any, TypeVar

from planner.errors import RequestError, WorkerError, mark_parameter
from planner.pipeline.interrupts import stop_repeating

PATIENCE_S = 10.0
SCRIPT_LOCK = threading.Lock()  # a process has one main module
MAX_TRIES = 3  # how often a task is given to another worker when its own has ended
T = TypeVar("T")
LOST_WORKER_MESSAGE = (
    "A planning process ended or could not be started, probably out of memory; use fewer "
    f"({mark_parameter('processes')})."
)
KILLED_WORKER_MESSAGE = (
    "The process for this computation was killed, probably for lack of memory; free some memory on this machine and "
    "try again."
)


class ClusterError(RequestError):
    """A cluster cannot be used."""


@contextmanager
def connect_cluster(address: str) -> Iterator[Executor]:
    """The executor of the cluster whose scheduler has this address, such as tcp://host:8786.

    Raises ClusterError if there is none, WorkerError if its workers keep ending.
    """
    client = _create_client(address)
    try:
        with client.get_executor(pure=False, retries=MAX_TRIES) as executor:
            yield executor
    except Exception as error:
        if type(error).__name__ != "KilledWorker":
            raise
        raise WorkerError(
            f"Workers of the cluster {address} ended while planning, probably out of memory; give each worker one "
            "thread and 2 GB."
        ) from None
    finally:
        client.close()


def _create_client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError(
            f"{mark_parameter('cluster')} needs Dask, which is not installed; install headland[cluster] or plan "
            "without a cluster."
        ) from None
    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError):
        raise ClusterError(
            f"There is no Dask scheduler at {address!r} ({mark_parameter('cluster')}); start one with "
            "'dask scheduler', its workers with 'dask worker ADDRESS --nthreads 1', and give its address, for instance "
            "tcp://127.0.0.1:8786."
        ) from None
    if not client.scheduler_info(n_workers=-1)["workers"]:
        client.close()
        raise ClusterError(
            f"The cluster {address} ({mark_parameter('cluster')}) has no workers; start some with "
            f"'dask worker {address}'."
        )
    return client


class SerialExecutor(Executor):
    """Runs every task in the calling thread, before `submit` returns."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run the task and return its finished future."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class LocalPool(ProcessPoolExecutor):
    """Fresh processes that end with the process that started them, however that one ends.

    In `iter_completed` the caller works too: it runs tasks itself when all processes are busy. Leaving the `with`
    block by an exception, such as Ctrl-C, stops the running tasks. Functions of tasks are those of modules, not of the
    script that runs.
    """

    def __init__(self, processes: int) -> None:
        context = multiprocessing.get_context("spawn")
        listen, self._lifeline = context.Pipe(duplex=False)
        with _convert_start_failure():
            super().__init__(processes, context, _initialise_worker, (listen,))
        self.processes = processes
        for _ in range(processes):
            self.submit(_preload_modules)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Submit a task; a process started for it never receives Ctrl-C, and does not run the caller's script."""
        with _convert_start_failure(), hold_interrupts(), _hide_script():
            return super().submit(fn, *args, **kwargs)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            stop_repeating()
            # Otherwise the caller may hang at exit, waiting to hand over tasks that nobody takes.
            self._call_queue.cancel_join_thread()  # type: ignore[attr-defined]
            self._lifeline.close()
        return super().__exit__(kind, error, trace)


@contextmanager
def _convert_start_failure() -> Iterator[None]:
    """Report a process that cannot be started as a broken pool, not as a broken pipe of standard output or a fault."""
    try:
        yield
    except OSError as error:
        raise BrokenProcessPool("a process could not be started") from error


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """Block Ctrl-C where the system can; processes started in the block never receive it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)


@contextmanager
def _hide_script() -> Iterator[None]:
    """Processes started in the block would import the script of this one, and run what it does at its top level."""
    with SCRIPT_LOCK:
        script, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = script


def _initialise_worker(lifeline: Connection) -> None:
    """In a new process: leave Ctrl-C to the process that collects results, and end when the lifeline closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, args=(lifeline,), daemon=True).start()


def _exit_with_parent(lifeline: Connection) -> None:
    try:
        lifeline.recv_bytes()
    except (EOFError, OSError):
        os._exit(0)


def _preload_modules() -> None:
    """Import what every candidate needs while the caller still prepares the tasks."""
    import planner.evaluation.candidates.evaluate  # noqa: F401


def create_executor(task_count: int, processes: int | None = None) -> Executor:
    """The executor for this many tasks in this many processes of this machine; by default one process per core.

    The calling process counts as one of them: a single task or process needs no other. Raises WorkerError where
    processes cannot be started.
    """
    count = min(processes or os.cpu_count() or 1, task_count)
    try:
        return SerialExecutor() if count <= 1 else LocalPool(count - 1)
    except BrokenExecutor:
        raise WorkerError(LOST_WORKER_MESSAGE) from None


class _SharedTasks:
    """Tasks that the processes of an executor take from the front, each one at a time, and the caller from either end.

    A process that has finished gets its next task without waiting for the caller to finish its own.
    """

    def __init__(self, executor: Executor, function: Callable[..., Any], arguments: list[tuple[Any, ...]]) -> None:
        self._executor, self._function = executor, function
        self._pending, self._lock = deque(enumerate(arguments)), threading.RLock()
        self._given: dict[Future[Any], int] = {}

    def begin(self, count: int) -> None:
        """Give the processes so many tasks."""
        for _ in range(count):
            self._give()

    def _give(self) -> None:
        with self._lock:
            if not self._pending:
                return
            index, arguments = self._pending[0]
            future = self._executor.submit(self._function, *arguments)
            if self._pending:  # not dropped meanwhile
                self._pending.popleft()
            self._given[future] = index
        future.add_done_callback(self._give_next)

    def _give_next(self, finished: Future[Any]) -> None:
        if finished.cancelled() or isinstance(finished.exception(), BrokenExecutor):
            return  # the pool may hold its lock here
        with suppress(BrokenExecutor, RuntimeError):  # the caller sees a broken pool, and has ended one shut down
            self._give()

    def take(self, from_end: bool) -> tuple[int, tuple[Any, ...]] | None:
        """The index and the arguments of a task for the caller; None when all are taken."""
        with self._lock:
            if not self._pending:
                return None
            return self._pending.pop() if from_end else self._pending.popleft()

    def take_finished(self) -> dict[Future[Any], int]:
        """The tasks that processes have finished, each once."""
        with self._lock:
            return {future: self._given.pop(future) for future in list(self._given) if future.done()}

    def list_given(self) -> dict[Future[Any], int]:
        """The tasks that processes are at work on, or have finished since they were taken last."""
        with self._lock:
            return dict(self._given)

    def drop(self) -> None:
        """Give no more, and take back from other executors than a pool what none has begun."""
        with self._lock:
            self._pending.clear()
            # A pool that is broken by a task, such as an interrupt, cannot end those that were cancelled.
            for future in [] if isinstance(self._executor, LocalPool) else self._given:
                future.cancel()


def iter_completed(
    executor: Executor,
    function: Callable[..., T],
    arguments: list[tuple[Any, ...]],
    report_work: Callable[[list[int]], None] = lambda indices: None,
    from_both_ends: bool = False,
) -> Iterator[tuple[int, T]]:
    """Yield (index, function(*arguments[index])) as tasks finish; those not begun are dropped if the caller stops.

    The caller of a `LocalPool` works too, and that of a `SerialExecutor` alone; with `from_both_ends` the former begins
    with the last task: each process then finds most of what neighbours share itself, and no other does. `report_work`
    is called with the indices of the tasks at work before the caller begins one and while all are waited for. Raises
    WorkerError where processes are lost.
    """
    tasks, is_pool = _SharedTasks(executor, function, arguments), isinstance(executor, LocalPool)
    given_at_once = 0 if isinstance(executor, SerialExecutor) else len(arguments)
    try:
        tasks.begin(executor.processes if isinstance(executor, LocalPool) else given_at_once)
        while True:
            yield from ((index, future.result()) for future, index in tasks.take_finished().items())
            task, given = tasks.take(from_both_ends and is_pool), tasks.list_given()
            if task is not None:
                index, task_arguments = task
                report_work([*given.values(), index])
                yield index, function(*task_arguments)
            elif given:
                report_work(list(given.values()))
                wait(given, return_when=FIRST_COMPLETED)
            else:
                return
    except BrokenExecutor:
        raise WorkerError(LOST_WORKER_MESSAGE) from None
    finally:
        tasks.drop()


def collect_answers(
    executor: Executor,
    function: Callable[..., T],
    arguments: list[tuple[Any, ...]],
    progress: Callable[[int, int], None] | None = None,
) -> list[T]:
    """All results in the order of their arguments; `progress` is called with (done, total)."""
    answers: dict[int, T] = {}
    for index, answer in iter_completed(executor, function, arguments):
        answers[index] = answer
        if progress:
            progress(len(answers), len(arguments))
    return [answers[index] for index in range(len(arguments))]
