"""Evaluate candidates on all cores; the results come in the order asked for, whatever the number of processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence

from planner.evaluate import Candidate, evaluate
from planner.site import Site
from reports.results import PlanResult


def evaluated(work: Sequence[tuple[Site, Candidate]], processes: int | None = None) -> Iterator[PlanResult]:
    """Results of (site, candidate) pairs, in order.

    Processes are forked where that exists, so that they share the compiled loop; elsewhere each loads it from disk.
    """
    count = min(processes or os.cpu_count() or 1, len(work))
    if count <= 1:
        yield from (evaluate(site, candidate) for site, candidate in work)
        return
    method = "fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn"
    with multiprocessing.get_context(method).Pool(count, _leave_interrupts) as pool:
        yield from pool.imap(_evaluate, work)


def _leave_interrupts() -> None:
    """Ctrl-C reaches every process of a terminal; only the one that collects the results answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _evaluate(pair: tuple[Site, Candidate]) -> PlanResult:
    return evaluate(*pair)
