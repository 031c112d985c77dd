"""From a scenario to ranked plans, from measured logs to a diagnosis; and the command line on top.

    from planner import Scenario, plan, study, diagnose, replay, HeadlandError

request        what is asked of a plan, in the words of command line and service
scenario       what is asked for, checked; counts, clocks and names from text
site           what all candidates share: field, tracks, tractor, turns timed, headland sized
refill         where tanks are made good, and whether they last for a track
laying         which layout of the field to plan with
candidates     one candidate: built, simulated, mended, measured
yielding       who waits for whom, so that no two tractors meet
ground         what was worked, missed, driven over and come near
tasks, pool    candidates as tasks for any executor; processes of this machine
interrupts     Ctrl-C that is heard also where a library swallows it
rank           which candidates to try; their results in order
chance         how sure a plan is: rain, stops and speeds that vary, drawn through its legs and gates
outlook        how sure a plan is and what it costs, in its result; which one is advised
price          what a plan costs, which one is best, and the advice in a sentence
many           many fields and widths in one table, on this machine or a cluster
planning       plan: all of it, with the best plan's run and pictures (drive)
fleet_study    study: the tables of the thesis
saving         a plan as text that is driven again
guidance       the lines of a saved plan in longitude and latitude, for terminals and maps
steps, showing  what each tractor does, in order; the same of a saved plan, driven again
diagnosis, replaying  diagnose and replay: from logs to what the simulation gets wrong
describe       a field in figures
day            several fields and fleets on one day
asked          a farm in place of what a scenario leaves open
workday, transport  the clock round field work: the road from the yard, un- and folding, breaks, shifts
workday_words  the same in sentences
farm           the farm file: tractors, implements, prices, times, what is left to chance
parameters     what parameters of the library are called in requests
works          work that was driven: imported, measured, compared with plans, learnt from
service        all of this over HTTP, and fleets that are driven; known by its commands alone
content        what an answer depends on, in a few letters
warmup         every compiled function in memory before it is needed
errors         the base of all refusals
commands, main  the command line; known by nothing else

What is named below is loaded when it is first used, so that `import planner` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planner.diagnosis import diagnose
    from planner.errors import HeadlandError
    from planner.fleet_study import study
    from planner.planning import Planned, plan
    from planner.pool import LocalPool, SerialExecutor, local_pool
    from planner.replaying import Replay, replay
    from planner.scenario import Scenario

__all__ = [
    "HeadlandError",
    "LocalPool",
    "Planned",
    "Replay",
    "Scenario",
    "SerialExecutor",
    "diagnose",
    "local_pool",
    "plan",
    "replay",
    "study",
]

_HOMES = {
    "diagnosis": ("diagnose",),
    "errors": ("HeadlandError",),
    "fleet_study": ("study",),
    "planning": ("Planned", "plan"),
    "pool": ("SerialExecutor", "LocalPool", "local_pool"),
    "replaying": ("Replay", "replay"),
    "scenario": ("Scenario",),
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
