"""One candidate as a task for an executor: what goes in and what comes out can be sent to another process."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass
from threading import current_thread
from typing import Any

from planner.candidates.beaten import Rival
from planner.candidates.evaluate import Candidate, simulated
from planner.candidates.rivals import hopeless
from planner.drive import picture
from planner.errors import WorkerError, named
from planner.pool import completed
from planner.site import Site
from reports.results import Drive, PlanResult
from vehicle.run import DONE, Run

KEPT = "headland_site"  # what a thread keeps its site as
Progress = Callable[[int, int], None]
LOST = (
    "A process that was planning is gone or could not be started, perhaps for want of memory; use fewer "
    f"({named('processes')}), and in a script keep what it does under if __name__ == '__main__'."
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """A candidate's result, its run where it is feasible, and its picture where that was asked for."""

    result: PlanResult
    run: Run | None = None
    drive: Drive | None = None


def pack(site: Site) -> bytes:
    """A site as every task takes it; each thread unpacks one of its own, so that tasks in threads share nothing.

    The thread that packs it goes on with the site itself, and with the ways that were found to lay it out.
    """
    packed = pickle.dumps(site)
    _keep(packed, site)
    return packed


def work_out(packed: bytes, candidate: Candidate, pictures: bool = False, rival: Rival | None = None) -> Outcome:
    """Evaluate a candidate on a packed site, unless it cannot win against a rival."""
    site = _unpacked(packed)
    behind = hopeless(site, candidate, rival)
    if behind is not None:
        return Outcome(behind)
    one = simulated(site, candidate, rival)
    result, run = one.result, one.run
    if run is None or run.outcome != DONE:
        return Outcome(result)
    return Outcome(result, run if result.feasible else None, picture(site, run, result) if pictures else None)


def _unpacked(packed: bytes) -> Site:
    """A site unpacked, once for the tasks that a worker does one after another: ways found for one serve the next.

    The thread that works on it keeps it, for as long as it lives or until it is given another one.
    """
    kept: tuple[bytes, Site] | None = getattr(current_thread(), KEPT, None)
    if kept is None or kept[0] != packed:
        return _keep(packed, pickle.loads(packed))
    return kept[1]


def _keep(packed: bytes, site: Site) -> Site:
    setattr(current_thread(), KEPT, (packed, site))
    return site


def outcomes(
    executor: Executor, work: Sequence[tuple[Any, ...]], progress: Progress | None, before: int = 0, whole: int = 0
) -> Iterator[tuple[int, Outcome]]:
    """(index, outcome) of every task as they are done; each has the arguments of `work_out`.

    `progress` is called with how many are done, and of how many; `before` are done already, of a `whole` of so many.
    """
    try:
        for done, pair in enumerate(completed(executor, work_out, list(work)), start=before + 1):
            if progress:
                progress(done, whole or len(work))
            yield pair
    except BrokenExecutor:
        raise WorkerError(LOST) from None
