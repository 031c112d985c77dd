"""One candidate as a task for an executor: what goes in and what comes out can be sent to another process."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

from planner.drive import picture
from planner.evaluate import Candidate, evaluate_run
from planner.pool import completed
from planner.site import Site
from reports.results import Drive, PlanResult
from vehicle.run import DONE, Run

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Attempt:
    """A candidate's result, its run where it is feasible, and its picture where that was asked for."""

    result: PlanResult
    run: Run | None = None
    drive: Drive | None = None


def pack(site: Site) -> bytes:
    """A site as every task takes it: each gets one of its own, so that tasks in threads share nothing."""
    return pickle.dumps(site)


def attempt(packed: bytes, candidate: Candidate, pictures: bool = False) -> Attempt:
    """Evaluate a candidate on a packed site."""
    site: Site = pickle.loads(packed)
    result, run = evaluate_run(site, candidate)
    if run is None or run.outcome != DONE:
        return Attempt(result)
    return Attempt(result, run if result.feasible else None, picture(site, run, result) if pictures else None)


def attempts(
    executor: Executor, work: list[tuple[bytes, Candidate, bool]], progress: Progress | None
) -> Iterator[tuple[int, Attempt]]:
    """(index, attempt) of every task as they are done; `progress` is called with how many are, and of how many."""
    for done, pair in enumerate(completed(executor, attempt, work), start=1):
        if progress:
            progress(done, len(work))
        yield pair
