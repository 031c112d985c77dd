"""One candidate as a task for an executor: what goes in and what comes out can be sent to another process."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass
from functools import lru_cache
from threading import get_ident

from planner.drive import picture
from planner.errors import WorkerError, named
from planner.evaluate import Candidate, simulated
from planner.pool import completed
from planner.site import Site
from reports.results import Drive, PlanResult
from vehicle.run import DONE, Run

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
    """A site as every task takes it; each thread unpacks one of its own, so that tasks in threads share nothing."""
    return pickle.dumps(site)


def work_out(packed: bytes, candidate: Candidate, pictures: bool = False) -> Outcome:
    """Evaluate a candidate on a packed site."""
    site = _unpacked(packed, get_ident())
    one = simulated(site, candidate)
    result, run = one.result, one.run
    if run is None or run.outcome != DONE:
        return Outcome(result)
    return Outcome(result, run if result.feasible else None, picture(site, run, result) if pictures else None)


@lru_cache(maxsize=2)
def _unpacked(packed: bytes, _thread: int) -> Site:
    """A site unpacked, once for the tasks of a thread that follow each other: ways found for one serve the next."""
    site: Site = pickle.loads(packed)
    return site


def outcomes(
    executor: Executor, work: list[tuple[bytes, Candidate, bool]], progress: Progress | None
) -> Iterator[tuple[int, Outcome]]:
    """(index, outcome) of every task as they are done; `progress` is called with how many are, and of how many."""
    try:
        for done, pair in enumerate(completed(executor, work_out, work), start=1):
            if progress:
                progress(done, len(work))
            yield pair
    except BrokenExecutor:
        raise WorkerError(LOST) from None
