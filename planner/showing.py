"""A saved plan driven again: what it answers, its run, and what each tractor does."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from fields.reading import read_text
from planner.errors import ScenarioError, about
from planner.scenario import Scenario
from planner.site import Site, gnss_errors
from planner.steps import steps_of
from reports.results import Step
from vehicle.errors import MissionError
from vehicle.plan_file import SavedPlan, saved_from_json
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor, as_tractor, tractor_names
from vehicle.world import World

MACHINES = "machines"  # beside the scenario of a plan for a farm: its tractor and implement, value by value


@dataclass(frozen=True, eq=False)
class Shown:
    """A plan from its file, the question it answers, its run, and the steps of every tractor."""

    saved: SavedPlan
    scenario: Scenario
    run: Run
    steps: tuple[tuple[Step, ...], ...]


def show(path: str | Path) -> Shown:
    """Read a plan of `headland plan --save` and drive it as it was driven when it was saved.

    The tractor is the one its scenario names, or of a farm the one saved with the plan; the field is not needed, as
    the legs tell their ground. Raises MissionError, ScenarioError or VehicleError: the file holds no plan, or one that
    this tractor does not finish.
    """
    saved = saved_from_json(read_text(path, "a plan of headland plan --save", MissionError))
    scenario = scenario_of(saved)
    run = driven_again(saved, scenario)
    if run.outcome != DONE:
        raise MissionError(
            f"The plan is not driven to its end ({run.outcome}): it or the tractor {scenario.tractor!r} was changed "
            f"since{_old_farm(saved)}; plan anew."
        )
    return Shown(saved, scenario, run, steps_of(run, scenario.width_m))


def scenario_of(saved: SavedPlan) -> Scenario:
    """The scenario that was saved with a plan; raises ScenarioError for none or a garbled one."""
    if not saved.scenario:
        raise ScenarioError("The plan has no scenario that names its tractor; save it with headland plan --save.")
    asked = {key: value for key, value in saved.scenario.items() if key != MACHINES}
    strange = sorted(asked.keys() - {each.name for each in fields(Scenario)})
    if strange:
        raise ScenarioError(f"The scenario of the plan has {strange[0]!r}, which is unknown; use a newer Headland.")
    return Scenario(**{key: _tuple(value) for key, value in asked.items()})


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def driven_again(saved: SavedPlan, scenario: Scenario) -> Run:
    """The run of a saved plan by the tractor, the implement and the errors of position of its scenario."""
    tractor, implement = machines_with(saved, scenario)
    return World(saved.plan, tractor, implement, position_errors=gnss_errors(scenario), seed=scenario.seed).run()


def machines_of(site: Site) -> dict[str, Any]:
    """What a plan is saved with of the machines of a farm: no name in its scenario tells them. Nothing without one."""
    if site.terms is None:
        return {}
    return {MACHINES: {"tractor": site.tractor.model_dump(mode="json"), "implement": site.implement.model_dump()}}


def _old_farm(saved: SavedPlan) -> str:
    """What may be wrong with a plan that was saved without machines."""
    return "" if MACHINES in saved.scenario else ", or the plan is of a farm and an older Headland saved no machines"


def machines_with(saved: SavedPlan, scenario: Scenario) -> tuple[Tractor, Implement]:
    """Those saved with the plan, else the tractor that its scenario names and a usual implement of its width."""
    own = saved.scenario.get(MACHINES)
    if own is None:
        name = scenario.tractor
        if name not in tractor_names() and not os.path.lexists(name):
            raise ScenarioError(
                f"The tractor {name!r} of the plan is neither known nor a file that is there{_old_farm(saved)}; plan "
                "anew, or put the tractor's file back.",
                parameter="tractor",
            )
        with about("tractor"):
            return as_tractor(scenario.tractor), Implement(width_m=scenario.width_m)
    try:
        tractor, implement = (json.dumps(own[name]) for name in ("tractor", "implement"))
        return Tractor.model_validate_json(tractor), Implement.model_validate_json(implement)
    except (KeyError, TypeError, ValueError):
        raise ScenarioError(f"The {MACHINES} in the scenario of the plan are garbled; save the plan again.") from None
