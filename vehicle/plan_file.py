"""Saved plans: a plan as JSON text, with the place its metres are in and the question it answers.

The text says in which version of the format it is written; an older Headland refuses a newer one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vehicle.errors import MissionError
from vehicle.missions import Follow, Gate, Leg, Mission, Plan, Task, check_plan

VERSION = 1
VERSION_KEY = "format_version"


@dataclass(frozen=True)
class SavedPlan:
    """A plan as it was saved.

    `crs` is the projected system of its metres, such as "EPSG:32654" (None for local metres), `origin_m` the easting
    and northing that were subtracted from them. `scenario` is what was asked, as whoever saved it wrote it.
    """

    plan: Plan
    crs: str | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)
    scenario: dict[str, Any] = field(default_factory=dict)


def plan_to_json(
    plan: Plan,
    *,
    crs: str | None = None,
    origin_m: tuple[float, float] = (0.0, 0.0),
    scenario: Mapping[str, Any] | None = None,
) -> str:
    """The plan as JSON text; the keywords are those of SavedPlan, and `saved_from_json` gives all back exactly.

    `scenario` holds what JSON knows: numbers, texts, booleans, None, lists and dicts (tuples come back as lists).
    """
    return json.dumps(
        {
            VERSION_KEY: VERSION,
            "crs": crs,
            "origin_m": list(origin_m),
            "scenario": dict(scenario or {}),
            "notes": plan.notes,
            "tractors": [[_leg_to_dict(leg) for leg in mission.legs] for mission in plan.missions],
        },
        indent=1,
        allow_nan=False,
    )


def _leg_to_dict(leg: Leg) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "task": {"kind": leg.task.kind, "number": leg.task.number, "piece": leg.task.piece},
        "may_wait": leg.may_wait,
        "gear": leg.gear,
        "speed_mps": leg.speed_mps,
        "implement": leg.implement,
        "ground": leg.ground,
        "points_m": leg.points.tolist(),
        "gates": [{"tractor": g.tractor, "leg": g.leg, "after_m": g.after_m} for g in leg.gates],
    }
    if leg.stand_s:
        entry["stand_s"] = leg.stand_s
    if leg.follow:
        entry["follow"] = {"tractor": leg.follow.tractor, "leg": leg.follow.leg, "gap_m": leg.follow.gap_m}
    return entry


def plan_from_json(text: str) -> Plan:
    """The plan alone of a saved plan; raises as `saved_from_json` does."""
    return saved_from_json(text).plan


def saved_from_json(text: str) -> SavedPlan:
    """Read a saved plan; raises MissionError when it is none, of a newer version, or cannot be executed."""
    try:
        saved = _saved(json.loads(text))
    except json.JSONDecodeError as error:
        raise MissionError(f"The plan is not JSON: {error}.") from None
    except MissionError:
        raise
    except RecursionError:
        raise MissionError("The plan is nested too deeply; a saved plan has five levels.") from None
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise MissionError(f"The plan lacks or garbles an entry: {error!r}.") from None
    check_plan(saved.plan)
    return saved


def _saved(data: dict[str, Any]) -> SavedPlan:
    _check_version(data.get(VERSION_KEY))
    crs, scenario = data["crs"], data["scenario"]
    if not (crs is None or isinstance(crs, str)):
        raise TypeError(f"crs is {crs!r}, not a text")
    if not isinstance(scenario, dict):
        raise TypeError(f"scenario is {scenario!r}, not an object")
    east, north = (float(metres) for metres in data["origin_m"])
    if not (math.isfinite(east) and math.isfinite(north)):
        raise ValueError(f"origin_m is {data['origin_m']!r}, not two numbers of metres")
    missions = tuple(Mission(tuple(_leg_from_dict(leg) for leg in legs)) for legs in data["tractors"])
    return SavedPlan(Plan(missions, dict(data["notes"])), crs, (east, north), scenario)


def _check_version(version: Any) -> None:
    if version is None:
        raise MissionError(
            f"The plan has no {VERSION_KEY!r}, so it was saved before there was one or is no plan; save it again."
        )
    if type(version) is not int or version < 1:
        raise MissionError(f"The plan has the {VERSION_KEY} {version!r}; it must be a whole number from 1.")
    if version > VERSION:
        raise MissionError(
            f"The plan is saved in version {version} of the format, and this Headland reads up to {VERSION}; "
            "use a newer Headland."
        )


def _leg_from_dict(entry: dict[str, Any]) -> Leg:
    follow, task = entry.get("follow"), entry["task"]
    number = task["number"]
    return Leg(
        points=np.array(entry["points_m"], dtype=np.float64),
        speed_mps=float(entry["speed_mps"]),
        gear=_exactly(entry, "gear", int),
        implement=_exactly(entry, "implement", bool),
        ground=str(entry["ground"]),
        task=Task(str(task["kind"]), None if number is None else _exactly(task, "number", int),
                  _exactly(task, "piece", int)),
        may_wait=_exactly(entry, "may_wait", bool),
        gates=tuple(Gate(int(g["tractor"]), int(g["leg"]), float(g["after_m"])) for g in entry["gates"]),
        follow=Follow(int(follow["tractor"]), int(follow["leg"]), float(follow["gap_m"])) if follow else None,
        stand_s=float(entry.get("stand_s", 0.0)),
    )  # fmt: skip


def _exactly(entry: dict[str, Any], key: str, kind: type) -> Any:
    value = entry[key]
    if type(value) is not kind:
        raise TypeError(f"{key} is {value!r}, not of type {kind.__name__}")
    return value
