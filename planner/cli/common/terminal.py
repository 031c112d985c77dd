"""Output for people on a terminal: progress, also of the first compilation, remarks and tables."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import typer

from planner.errors import RequestError, WorkerError, make_one_line
from reports.common.language import (
    Reader,
    get_language,
    get_units,
    mark_text,
    set_reader,
    translate,
    translate_sentence,
    use_reader,
)

if TYPE_CHECKING:
    from planner.cli.common.progress import StageBar

COMPILE_NOTICE_S = 3.0
MIN_COLUMNS, DEFAULT_COLUMNS, MAX_COLUMNS = 20, 80, 160
LOADING = mark_text("Loading the simulator")
_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def create_progress_callback(title: str) -> Iterator[Callable[[int, int], None]]:
    """A function to call with (done, total); it draws a bar on a terminal and nothing elsewhere."""
    from planner.cli.common.progress import open_stage_bar

    with open_stage_bar(title) as bar:
        yield bar.count


def warm_up(bar: StageBar | None = None, next_stages_s: Mapping[str, float] | None = None) -> None:
    """Load the compiled simulator; what is missing of it is compiled first, and counted in the bar.

    `next_stages_s` are the stages after this in that bar, with about the seconds of each.
    """
    from planner.cli.common.progress import open_stage_bar
    from planner.pipeline.kernels import PLAN
    from planner.pipeline.worker_tasks import warm_up_simulation

    with open_stage_bar(LOADING) if bar is None else nullcontext(bar) as shown:
        compile_missing(shown, (PLAN,), next_stages_s)
        warm_up_simulation()


def compile_missing(bar: StageBar, uses: Sequence[str], next_stages_s: Mapping[str, float] | None = None) -> int:
    """Compile the kernels of these uses that are missing on disk, on all cores, and count them in the bar.

    Where no bar can be drawn, a sentence says that it takes a while, down to 5 s. Returns how many were missing.
    """
    from planner.pipeline.kernels import COMPILING, compile_kernels, list_missing_kernels, share_kernels

    missing = list_missing_kernels(uses)
    shares = share_kernels(missing, os.cpu_count() or 1)
    seconds = max((sum(kernel.seconds for kernel in share) for share in shares), default=0.0)
    bar.expect({COMPILING: seconds, **(next_stages_s or {})})
    if seconds > COMPILE_NOTICE_S and not sys.stderr.isatty():
        with use_reader():
            notice = translate(
                "Compiling the simulator for this machine ({count} functions): first run only, about {seconds} s.",
                count=len(missing),
                seconds=5 * max(1, round(seconds / 5)),
            )
        print_sentence(notice, err=True)
    if missing:
        compile_kernels(missing, report=partial(bar.report, COMPILING))
    return len(missing)


def compile_apart(uses: Sequence[str]) -> None:
    """As `compile_missing`, in a process of its own: what compilers leave in memory ends with it.

    Raises WorkerError where that is killed.
    """
    from concurrent.futures.process import BrokenProcessPool

    from planner.pipeline.executors import KILLED_WORKER_MESSAGE, LocalPool

    with use_reader():
        reader = Reader(get_language(), get_units())
    try:
        with LocalPool(1) as pool:
            pool.submit(_compile_for, reader, uses).result()
    except BrokenProcessPool:
        raise WorkerError(KILLED_WORKER_MESSAGE) from None


def _compile_for(reader: Reader, uses: Sequence[str]) -> None:
    from planner.cli.common.progress import open_stage_bar

    set_reader(reader)
    with open_stage_bar(LOADING) as bar:
        compile_missing(bar, uses)


def print_remarks(sentences: Iterable[str]) -> None:
    """Print remarks on the input on standard error, one line each."""
    for sentence in sentences:
        with use_reader():
            text = translate("Note: {sentence}", sentence=translate_sentence(sentence))
        print(make_one_line(text), file=sys.stderr, flush=True)


def print_sentence(sentence: str, *, err: bool = False) -> None:
    """Print a sentence in one line, on standard output or standard error."""
    with use_reader():
        text = translate_sentence(sentence)
    print(make_one_line(text), file=sys.stderr if err else sys.stdout, flush=True)


def print_renderable(renderable: object, *arguments: Any, **options: Any) -> None:
    """Print on standard output, at most 160 columns wide, 80 if the width is unknown.

    A function is called with what follows it, so that its texts are in the language and units of the reader.
    """
    from rich.console import Console

    width = max(min(Console().width or DEFAULT_COLUMNS, MAX_COLUMNS), MIN_COLUMNS)
    with use_reader():
        Console(width=width).print(renderable(*arguments, **options) if callable(renderable) else renderable)


@dataclass(frozen=True)
class AnswerForm:
    """How a command prints its answer: JSON or CSV for programs, else a screen, with `explain` also the tables."""

    json: bool = False
    csv: bool = False
    explain: bool = False

    def __post_init__(self) -> None:
        if self.json and self.csv:
            raise RequestError("--json and --csv both print to standard output; choose one.")

    @property
    def is_for_programs(self) -> bool:
        """Whether JSON or CSV is printed."""
        return self.json or self.csv

    def print_answer(
        self,
        *results: Any,
        json: Callable[..., str],
        screen: Callable[..., object],
        csv: Callable[..., str] | None = None,
        table: Callable[..., object] | None = None,
    ) -> None:
        """Print results by what makes a text, a screen or a table of them; a screen with a table says what is next."""
        if self.csv and csv is not None:
            typer.echo(csv(*results), nl=False)
        elif self.json:
            typer.echo(json(*results), nl=False)
        elif table is None:
            print_renderable(screen, *results)
        else:
            print_renderable(screen, *results, with_next=not self.explain)
            if self.explain:
                print_renderable("")
                print_renderable(table, *results)


def limit_linear_algebra_threads() -> None:
    """Use one thread for linear algebra on small matrices; works only before numpy is loaded."""
    for name in _THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
