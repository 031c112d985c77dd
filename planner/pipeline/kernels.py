"""The compiled functions that commands call, listed in `kernels.csv`: which are missing on disk, and compiling them.

All cores compile at the same time. Each process takes whole families of functions, as what these call is compiled once
for a family. The list only saves time: a function that is not in it is compiled when it is first called.

A row of the list holds who uses a function (PLAN or MORE), the seconds it takes to compile, the function, and the types
of its arguments: `float64:2C` is a contiguous array of two dimensions (A: any), in capitals a record,
with brackets a tuple. `python -m tests.planner.kernel_list` renews it.
"""

from __future__ import annotations

import csv
import gc
import os
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module, resources
from typing import Any

import numba
import numpy as np

from planner.errors import WorkerError
from planner.pipeline.executors import create_executor
from reports.common.language import mark_text
from vehicle.jit import is_compiled

PLAN, MORE = "plan", "more"
COMPILING = mark_text("Compiling functions")
LIST_FILE = "kernels.csv"
POLL_S = 0.3
RECORD_HOMES = {
    **dict.fromkeys(("STATE", "GROUND", "LEG", "GATE"), "vehicle.records"),
    "MODEL": "vehicle.sim.compile",
    "POSE": "vehicle.sim.path_conflicts",
}
Report = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Kernel:
    """A compiled function for one set of argument types, as `kernels.csv` lists it."""

    use: str
    seconds: float
    function: str
    arguments: str

    @property
    def family(self) -> str:
        """The package of the function: those of one family call the same functions."""
        return ".".join(self.function.split(".")[:2])

    def find_dispatcher(self) -> Any:
        """The function itself, after its module is loaded."""
        module, _, name = self.function.rpartition(".")
        return getattr(import_module(module), name)

    def is_stored(self) -> bool:
        """Whether it need not be compiled: it is on disk, or cannot be kept there, or is no longer what was listed."""
        try:
            return is_compiled(self.find_dispatcher(), parse_types(self.arguments))
        except (ImportError, AttributeError, KeyError):
            return True


@cache
def read_kernels() -> tuple[Kernel, ...]:
    """Every kernel of the list."""
    text = resources.files(__package__).joinpath(LIST_FILE).read_text(encoding="utf-8")
    return tuple(Kernel(use, float(seconds), *rest) for use, seconds, *rest in csv.reader(text.splitlines()))


def list_missing_kernels(uses: Sequence[str] = (PLAN,)) -> list[Kernel]:
    """The kernels of these uses that are not on disk yet."""
    return [kernel for kernel in read_kernels() if kernel.use in uses and not kernel.is_stored()]


def compile_kernels(kernels: Sequence[Kernel], processes: int | None = None, report: Report | None = None) -> None:
    """Compile kernels and store them on disk, in this many processes, by default one per core; this one counts.

    `report` is called about three times a second with the kernels that are done, all kernels, and the share of the work
    that is done.
    """
    shares = share_kernels(kernels, processes or os.cpu_count() or 1)
    if not shares:
        return
    futures = list[Future[None]]()
    with _Watch(kernels, report), ExitStack() as opened:
        with suppress(WorkerError, BrokenExecutor):  # what no other process compiles now is compiled when it is called
            executor = opened.enter_context(create_executor(len(shares), len(shares)))
            if isinstance(executor, ProcessPoolExecutor):
                futures += [executor.submit(compile_share, share) for share in shares[1:]]
        compile_share(shares[0])
        wait(futures)


def share_kernels(kernels: Sequence[Kernel], processes: int) -> list[list[Kernel]]:
    """At most so many lists of about the same seconds, each of whole families; the first is that of this process."""
    families: dict[str, list[Kernel]] = {}
    for kernel in kernels:
        families.setdefault(kernel.family, []).append(kernel)
    shares: list[list[Kernel]] = [[] for _ in range(min(processes, len(families)))]
    for family in sorted(families.values(), key=_sum_seconds, reverse=True):
        min(shares, key=_sum_seconds).extend(family)
    return shares[::-1]


def _sum_seconds(kernels: Sequence[Kernel]) -> float:
    return sum(kernel.seconds for kernel in kernels)


def compile_share(kernels: Sequence[Kernel]) -> None:
    """Compile kernels one after another; one that fails here fails again, and is told, where it is called."""
    was_enabled = gc.isenabled()
    gc.disable()  # compilers make many objects that stay: looking for garbage takes a tenth of the time
    try:
        for kernel in kernels:
            try:
                kernel.find_dispatcher().compile(parse_types(kernel.arguments))
            except Exception:
                continue
    finally:
        if was_enabled:
            gc.enable()


class _Watch:
    """While it is open, another thread reports how far the compilation is."""

    def __init__(self, kernels: Sequence[Kernel], report: Report | None) -> None:
        self._kernels, self._report = kernels, report
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> None:
        if self._report is not None:
            self._report(0, len(self._kernels), 0.0)
            self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._report is not None:
            self._thread.join()
            self._report(len(self._kernels), len(self._kernels), 1.0)

    def _run(self) -> None:
        assert self._report is not None
        pending, total_s = list(self._kernels), _sum_seconds(self._kernels) or 1.0
        while pending and not self._ended.wait(POLL_S):
            pending = [kernel for kernel in pending if not kernel.is_stored()]
            self._report(len(self._kernels) - len(pending), len(self._kernels), 1.0 - _sum_seconds(pending) / total_s)


def parse_types(text: str) -> tuple[Any, ...]:
    """The argument types that a row of the list names; raises ImportError, AttributeError or KeyError for old ones."""
    return tuple(_iter_types(iter(re.findall(r"[\w.:]*\(|[\w.:]+|\)", text))))


def _iter_types(words: Iterator[str]) -> Iterator[Any]:
    for word in words:
        if word == ")":
            return
        if word.endswith("("):
            yield _build_tuple(word[:-1], list(_iter_types(words)))
        else:
            yield _parse_type(word)


def _build_tuple(name: str, members: list[Any]) -> Any:
    if not name:
        return numba.types.Tuple(members)
    module, _, class_name = name.rpartition(".")
    kind = getattr(import_module(module), class_name)
    if len(kind._fields) != len(members):
        raise KeyError(name)
    return numba.types.BaseTuple.from_types(members, kind)


def _parse_type(word: str) -> Any:
    kind, _, shape = word.partition(":")
    if kind in RECORD_HOMES:
        element = numba.from_dtype(getattr(import_module(RECORD_HOMES[kind]), kind))
    else:
        element = numba.from_dtype(np.dtype(kind))
    array: Any = numba.types.Array
    return array(element, int(shape[0]), shape[1]) if shape else element


def format_types(types: Sequence[Any]) -> str:
    """Argument types as a row of the list names them."""
    return " ".join(map(_format_type, types))


def _format_type(kind: Any) -> str:
    is_tuple = isinstance(kind, numba.types.BaseTuple)
    if isinstance(kind, numba.types.Array):
        return f"{_format_type(kind.dtype)}:{kind.ndim}{kind.layout}"
    if is_tuple:
        name = getattr(kind, "instance_class", None)
        return f"{f'{name.__module__}.{name.__qualname__}' if name else ''}({format_types(list(kind))})"
    if isinstance(kind, numba.types.Record):
        names = [name for name, home in RECORD_HOMES.items() if kind == _parse_type(name)]
        return names[0]
    return str(kind)
