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
WHOLE = "The plan"
KINDS = {
    dict: "an object", list: "a list", str: "a text", bool: "true or false", int: "a whole number", float: "a number",
}  # fmt: skip
LARGEST, BRIEF = 1e300, 40


@dataclass(frozen=True)
class SavedPlan:
    """A plan as it was saved.

    `crs` is the projected system of its metres, such as "EPSG:32654" (None for local metres), `origin_m` the easting
    and northing that were subtracted from them. `scenario` is what was asked, and `ground` the outlines of the field in
    those metres (empty where none were saved), as whoever saved it wrote them.
    """

    plan: Plan
    crs: str | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)
    scenario: dict[str, Any] = field(default_factory=dict)
    ground: dict[str, Any] = field(default_factory=dict)


def plan_to_json(
    plan: Plan,
    *,
    crs: str | None = None,
    origin_m: tuple[float, float] = (0.0, 0.0),
    scenario: Mapping[str, Any] | None = None,
    ground: Mapping[str, Any] | None = None,
) -> str:
    """The plan as JSON text; the keywords are those of SavedPlan, and `saved_from_json` gives all back exactly.

    `scenario` and `ground` hold what JSON knows: numbers, texts, booleans, None, lists and dicts (tuples come back as
    lists).
    """
    content: dict[str, Any] = {
        VERSION_KEY: VERSION,
        "crs": crs,
        "origin_m": list(origin_m),
        "scenario": dict(scenario or {}),
        "notes": plan.notes,
        "tractors": [[_leg_to_dict(leg) for leg in mission.legs] for mission in plan.missions],
    }
    if ground:
        content["ground"] = dict(ground)
    return json.dumps(content, indent=1, allow_nan=False)


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
    except ValueError:
        raise MissionError("The plan has a number of too many digits; a saved plan has none of more than 20.") from None
    check_plan(saved.plan)
    return saved


def _saved(data: Any) -> SavedPlan:
    _check_version(_entry({"plan": data}, "plan", dict, "The text").get(VERSION_KEY))
    crs = None if _entry(data, "crs", None, WHOLE) is None else _entry(data, "crs", str, WHOLE)
    scenario, notes = _entry(data, "scenario", dict, WHOLE), _entry(data, "notes", dict, WHOLE)
    ground = _entry({"ground": {}} | data, "ground", dict, WHOLE)
    origin_m = _entry(data, "origin_m", list, WHOLE)
    if len(origin_m) != 2 or not all(type(each) in (int, float) and math.isfinite(each) for each in origin_m):
        raise MissionError(f"{WHOLE}: origin_m is {_brief(origin_m)}, not two numbers of metres.")
    missions = []
    for number, legs in enumerate(_entry(data, "tractors", list, WHOLE)):
        if not isinstance(legs, list):
            raise MissionError(f"{WHOLE}: tractor {number} is {_brief(legs)}, not a list of legs.")
        missions.append(Mission(tuple(_leg(leg, f"Tractor {number}, leg {k}") for k, leg in enumerate(legs))))
    origin = (float(origin_m[0]), float(origin_m[1]))
    return SavedPlan(Plan(tuple(missions), dict(notes)), crs, origin, scenario, ground)


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


def _leg(entry: Any, where: str) -> Leg:
    task, number = _entry(entry, "task", dict, where), None
    if _entry(task, "number", None, f"{where}, task") is not None:
        number = _entry(task, "number", int, f"{where}, task")
    gates = [_gate(gate, f"{where}, gate {k}") for k, gate in enumerate(_entry(entry, "gates", list, where))]
    return Leg(
        points=_points(entry, where),
        speed_mps=_entry(entry, "speed_mps", float, where),
        gear=_entry(entry, "gear", int, where),
        implement=_entry(entry, "implement", bool, where),
        ground=_entry(entry, "ground", str, where),
        task=Task(_entry(task, "kind", str, f"{where}, task"), number, _entry(task, "piece", int, f"{where}, task")),
        may_wait=_entry(entry, "may_wait", bool, where),
        gates=tuple(gates),
        follow=_follow(entry["follow"], f"{where}, follow") if entry.get("follow") else None,
        stand_s=_entry({"stand_s": 0.0} | entry, "stand_s", float, where),
    )


def _points(entry: dict[str, Any], where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    points = _entry(entry, "points_m", list, where)
    try:
        return np.array(points, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise MissionError(f"{where}: points_m is {_brief(points)}, not a list of pairs of metres.") from None


def _gate(entry: Any, where: str) -> Gate:
    number, leg = _entry(entry, "tractor", int, where), _entry(entry, "leg", int, where)
    return Gate(number, leg, _entry(entry, "after_m", float, where))


def _follow(entry: Any, where: str) -> Follow:
    number, leg = _entry(entry, "tractor", int, where), _entry(entry, "leg", int, where)
    return Follow(number, leg, _entry(entry, "gap_m", float, where))


def _entry(entries: Any, key: str, kind: type | None, where: str) -> Any:
    """An entry of an object of the file, of a kind where one is given; raises MissionError that says where it is."""
    if not isinstance(entries, dict):
        raise MissionError(f"{where} is {_brief(entries)}, not an object with {key!r}.")
    if key not in entries:
        raise MissionError(f"{where} has no {key!r}; save the plan again.")
    value = entries[key]
    if kind is None or type(value) is kind:
        return value
    if kind is float and type(value) is int and abs(value) < LARGEST:
        return float(value)
    raise MissionError(f"{where}: {key} is {_brief(value)}, not {KINDS[kind]}.")


def _brief(value: Any) -> str:
    words = repr(value)
    return words if len(words) <= BRIEF else f"{words[:BRIEF]}..."
