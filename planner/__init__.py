"""From a request to ranked plans, from measured logs to a diagnosis. Programs import these names from `headland`.

request     what is asked of a plan, checked; option names and texts
farm        the farm file: machines, prices, times, and the workday
risk        how sure a plan is and what it costs: Monte Carlo, prices
traffic     who waits for whom, so that no two tractors meet
evaluation  one candidate in its planning context: composed, driven, measured
pipeline    plan, study, diagnose: candidates on any executor, ranked; pictures, saved plans
sweeps      many combinations of options, estimated on shared ground
day         several fields and fleets on one day
task_logs   as-driven work: imported, compared with plans, learned from
fleet       fleets while they drive: messages, safety, replanning, robots
service     all of this over HTTP, with pages for people
cli         the command line
errors      the base of all refusals

The names below are imported on first use, so that `import planner` is fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planner.day.planning import plan_day
    from planner.errors import HeadlandError
    from planner.pipeline.diagnosis import diagnose
    from planner.pipeline.executors import LocalPool, SerialExecutor, create_executor
    from planner.pipeline.planning import PlanningResult, plan
    from planner.pipeline.replays import Replay, replay
    from planner.pipeline.thesis_study import study
    from planner.request.plan_request import PlanRequest
    from planner.sweeps.sweep import sweep

__all__ = [
    "HeadlandError",
    "LocalPool",
    "PlanRequest",
    "PlanningResult",
    "Replay",
    "SerialExecutor",
    "create_executor",
    "diagnose",
    "plan",
    "plan_day",
    "replay",
    "study",
    "sweep",
]

_HOMES = {
    "day.planning": ("plan_day",),
    "errors": ("HeadlandError",),
    "pipeline.diagnosis": ("diagnose",),
    "pipeline.executors": ("LocalPool", "SerialExecutor", "create_executor"),
    "pipeline.planning": ("PlanningResult", "plan"),
    "pipeline.replays": ("Replay", "replay"),
    "pipeline.thesis_study": ("study",),
    "request.plan_request": ("PlanRequest",),
    "sweeps.sweep": ("sweep",),
}


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            value = getattr(import_module(f"planner.{home}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
