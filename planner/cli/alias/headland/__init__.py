"""Headland by its own name, with everything that programs import of it.

    import headland

    answer = headland.plan(headland.PlanRequest(field="denmark", tractors=(1, 2)))

help(headland.plan) says what comes back; `python -m headland` is the command line. Names are loaded on first use, from
`planner`, `fields` and the modules below, whose own names may change.
"""

from __future__ import annotations

from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

_ROOMS = {
    "fields": "raw_document",
    "planner": "pipeline",
    "reports": "languages",
    "strategies": "path_planning",
    "vehicle": "missions",
}
"""The packages that Headland is made of, each with a module by which it is told from one of the same name."""


def _refuse_hidden_rooms() -> None:
    """Raise ImportError where a module of the user has the name of a package that Headland is made of."""
    for room, part in _ROOMS.items():
        spec = find_spec(room)
        folders = [] if spec is None else list(spec.submodule_search_locations or ())
        if spec is not None and (not folders or PathFinder.find_spec(f"{room}.{part}", folders) is None):
            place = spec.origin or folders[0]
            raise ImportError(
                f"{place} hides the package {room!r} of Headland; rename it, as the names {', '.join(_ROOMS)} are "
                "Headland's own.",
                name=room,
                path=place,
            )


_refuse_hidden_rooms()

import fields  # noqa: E402
import planner  # noqa: E402

if TYPE_CHECKING:
    from fields import *  # noqa: F403
    from planner import *  # noqa: F403
    from planner.pipeline.outputs.saved_plans import simulate_saved_plan
    from strategies.path_planning.errors import StrategyError
    from strategies.rules.dealing import DealtLine, LineDeal, free_other_lines, group_swath_lines
    from strategies.rules.driving_rules import DrivingRules
    from strategies.strategy_record import Strategy
    from vehicle.energy.load import build_work_load
    from vehicle.energy.run_energy import compute_run_energy
    from vehicle.missions.plan import Leg, LegGate, Mission, Plan
    from vehicle.missions.plan_file import parse_plan
    from vehicle.model.soil import find_soil
    from vehicle.model.tractor import Implement, Tractor, list_tractor_names, load_tractor

_HOMES = {
    "planner": planner.__all__,
    "fields": fields.__all__,
    "planner.pipeline.outputs.saved_plans": ["simulate_saved_plan"],
    "strategies.path_planning.errors": ["StrategyError"],
    "strategies.rules.dealing": ["DealtLine", "LineDeal", "free_other_lines", "group_swath_lines"],
    "strategies.rules.driving_rules": ["DrivingRules"],
    "strategies.strategy_record": ["Strategy"],
    "vehicle.energy.load": ["build_work_load"],
    "vehicle.energy.run_energy": ["compute_run_energy"],
    "vehicle.missions.plan": ["Leg", "LegGate", "Mission", "Plan"],
    "vehicle.missions.plan_file": ["parse_plan"],
    "vehicle.model.soil": ["find_soil"],
    "vehicle.model.tractor": ["Implement", "Tractor", "list_tractor_names", "load_tractor"],
}
__all__ = [
    "DealtLine", "DrivingRules", "Implement", "Leg", "LegGate", "LineDeal", "Mission", "Plan", "Strategy",
    "StrategyError", "Tractor", "build_work_load", "compute_run_energy", "find_soil", "free_other_lines",
    "group_swath_lines", "list_tractor_names", "load_tractor", "parse_plan", "simulate_saved_plan",
]  # fmt: skip
__all__ += planner.__all__
__all__ += fields.__all__


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
