"""Which function does which kind of job."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from planner.service.settings import Settings
from planner.service.store.jobs import Made

PLAN, DAY, DIAGNOSIS = "plan", "day", "diagnosis"
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Work:
    """One job as its function takes it: the request, processes it may use, whom to tell (done, all, words).

    The function is called in the folder of its input files, and gives the same bytes whenever it is called.
    """

    request: Mapping[str, Any]
    processes: int
    progress: Progress
    cache: str


Kind = Callable[[Work], Sequence[Made]]
"""Does a job: its results, or a HeadlandError with the one sentence."""


def kind_of(name: str, settings: Settings) -> Kind:
    """The function of a kind; what it needs is loaded only now."""
    if name in settings.kinds:
        return cast(Kind, settings.kinds[name])
    if name == PLAN:
        from planner.service.jobs.plan import run_plan

        return run_plan
    if name == DAY:
        from planner.service.jobs.day import run_day

        return run_day
    if name == DIAGNOSIS:
        from planner.service.jobs.diagnosis import run_diagnosis

        return run_diagnosis
    raise KeyError(name)
