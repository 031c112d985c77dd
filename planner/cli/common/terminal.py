"""Output for people on a terminal: progress, the notice on the first compilation, remarks and tables."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from fields.errors import make_one_line
from reports.common.language import mark_text, translate, translate_sentence, use_reader

COMPILE_NOTICE_S = 1.5
MIN_COLUMNS, DEFAULT_COLUMNS, MAX_COLUMNS = 20, 80, 160
COMPILED_LOOPS = (("vehicle.sim.loop", "run_fixed"), ("vehicle.sim.loop", "run_loop"))  # these take long to compile
COMPILING_MESSAGE = mark_text("Compiling the simulator for this machine: first run only, about a minute.")


@contextmanager
def create_progress_callback(title: str) -> Iterator[Callable[[int, int], None]]:
    """A function to call with (done, total); it draws a bar on a terminal and nothing elsewhere."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    with use_reader():
        title = translate(title)
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def warm_up() -> None:
    """Load the compiled simulator; prints a notice if it must be compiled first."""
    loaded = threading.Event()
    threading.Thread(target=_announce_compiling, args=(loaded,), daemon=True).start()
    try:
        from planner.pipeline.worker_tasks import warm_up_simulation

        warm_up_simulation()
    finally:
        loaded.set()


def _announce_compiling(loaded: threading.Event) -> None:
    """Print the notice after a while if the compiled loop was not found on disk."""
    wait_s = COMPILE_NOTICE_S
    while not loaded.wait(wait_s):
        loops = [sys.modules[name].__dict__.get(loop) for name, loop in COMPILED_LOOPS if name in sys.modules]
        if any(loop is not None and loop.stats.cache_misses for loop in loops):
            print_sentence(COMPILING_MESSAGE, err=True)
            return
        wait_s = 0.2


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


_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def limit_linear_algebra_threads() -> None:
    """Use one thread for linear algebra on small matrices; works only before numpy is loaded."""
    for name in _THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
