"""What a person sees while waiting: a progress bar on standard error, and a word about the first compilation."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

PATIENCE_S = 1.5
NARROWEST, USUAL_WIDTH, WIDEST = 20, 80, 160
LOOPS = (("vehicle.loop", "run_fixed"), ("vehicle.loop", "run_loop"))  # what takes long to compile
COMPILING = "Compiling the simulator for this machine: first run only, about a minute."


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """A function to call with (done, total); draws a bar on a terminal and nothing elsewhere."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def warm_up() -> None:
    """Load the compiled loop; says so where it must be compiled first and that takes a while."""
    loaded = threading.Event()
    threading.Thread(target=_tell_of_compiling, args=(loaded,), daemon=True).start()
    try:
        from planner.warmup import run_once

        run_once()
    finally:
        loaded.set()


def _tell_of_compiling(loaded: threading.Event) -> None:
    """After a while, and once it is known that the loop is not on disk, say so; nothing when it is loaded before."""
    wait_s = PATIENCE_S
    while not loaded.wait(wait_s):
        loops = [sys.modules[name].__dict__.get(loop) for name, loop in LOOPS if name in sys.modules]
        if any(loop is not None and loop.stats.cache_misses for loop in loops):
            print(COMPILING, file=sys.stderr, flush=True)
            return
        wait_s = 0.2


def remark(sentences: Iterable[str]) -> None:
    """Sentences on standard error about what a person should know of the input."""
    for sentence in sentences:
        print(f"Note: {sentence}", file=sys.stderr, flush=True)


def out(renderable: object) -> None:
    """Print for people on standard output, at most 160 columns wide; where no width is known, 80."""
    from rich.console import Console

    width = max(min(Console().width or USUAL_WIDTH, WIDEST), NARROWEST)
    Console(width=width).print(renderable)
