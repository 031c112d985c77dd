"""Which function does which kind of job."""

from __future__ import annotations

from typing import cast

from planner.service.jobs.work import Kind
from planner.service.settings import Settings

PLAN, DAY, DIAGNOSIS = "plan", "day", "diagnosis"


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
