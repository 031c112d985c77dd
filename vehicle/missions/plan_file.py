"""Saved plans: a plan as JSON text, with its coordinate system and the request it was made for.

The text names its format version; an older Headland refuses a newer version.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from fields.nested_text import parse_json
from vehicle.errors import MissionError
from vehicle.missions.plan import (
    REFILL,
    FollowOrder,
    Leg,
    LegGate,
    LegTask,
    Mission,
    NotedStop,
    Plan,
    PlanNotes,
    check_plan,
)

FORMAT_VERSION = 1
VERSION_KEY = "format_version"
WHOLE_PLAN, NOTES = "The plan", "The notes of the plan"
STOPS_KEY, STATED_KEY = "refills", "stated"  # in the notes of the file
TYPE_WORDS = {
    dict: "an object", list: "a list", str: "a text",
    bool: "true or false", int: "a whole number", float: "a number",
}  # fmt: skip
LARGEST_NUMBER, SHOWN_LETTERS = 1e300, 40
FARTHEST_M = 1e8  # from the origin of any coordinate system of the earth


@dataclass(frozen=True)
class SavedPlan:
    """A plan as it was saved.

    `crs` is the projected system of its metres, such as "EPSG:32654" (None for local metres), `origin_m` the easting
    and northing that were subtracted from them. `scenario` is the request, `ground` the outlines of the field in those
    metres and `stated` what was said of it when it was saved (both empty where none were saved); all three are passed
    through unchecked.
    """

    plan: Plan
    crs: str | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)
    scenario: dict[str, Any] = field(default_factory=dict)
    ground: dict[str, Any] = field(default_factory=dict)
    stated: dict[str, Any] = field(default_factory=dict)


def format_plan(
    plan: Plan,
    *,
    crs: str | None = None,
    origin_m: tuple[float, float] = (0.0, 0.0),
    scenario: Mapping[str, Any] | None = None,
    ground: Mapping[str, Any] | None = None,
    stated: Mapping[str, Any] | None = None,
    point_speeds: Sequence[Sequence[Sequence[float]]] | None = None,
    indent: int | None = 1,
) -> str:
    """The plan as JSON text, which parse_saved_plan reads back exactly; keywords as in SavedPlan and json.dumps.

    `point_speeds` are the largest speeds (m/s) at the points of each leg of each tractor
    (vehicle.sim.compile.compute_point_speeds), for tractors that do not compute them; reading ignores them.
    `scenario`, `ground` and `stated` may hold numbers, texts, booleans, None, lists and dicts; tuples come back as
    lists.
    """
    content: dict[str, Any] = {
        VERSION_KEY: FORMAT_VERSION,
        "crs": crs,
        "origin_m": list(origin_m),
        "scenario": dict(scenario or {}),
        "notes": _convert_notes(plan.notes) | ({STATED_KEY: dict(stated)} if stated else {}),
        "tractors": [[_convert_leg(leg) for leg in mission.legs] for mission in plan.missions],
    }
    for entries, speeds in zip(content["tractors"], point_speeds or (), strict=False):
        for entry, leg_speeds in zip(entries, speeds, strict=True):
            entry["speeds_mps"] = list(leg_speeds)
    if ground:
        content["ground"] = dict(ground)
    return json.dumps(content, indent=indent, allow_nan=False)


def _convert_notes(notes: PlanNotes) -> dict[str, Any]:
    """Notes as they are in a file: what is known, with tractors counted from 1."""
    known = {one.name: getattr(notes, one.name) for one in fields(notes) if getattr(notes, one.name) != one.default}
    entries = {**known.pop("others", {}), **known}
    stops = entries.pop("stops", None)
    if stops is not None:
        values = [{key: value for key, value in asdict(stop).items() if value is not None} for stop in stops]
        entries[STOPS_KEY] = [value | {"tractor": value["tractor"] + 1} for value in values]
    return entries | ({"apart": [number + 1 for number in notes.apart]} if notes.apart else {})


def _convert_leg(leg: Leg) -> dict[str, Any]:
    task: dict[str, Any] = {"kind": leg.task.kind, "number": leg.task.number, "piece": leg.task.piece}
    if leg.task.is_piece != (leg.task.piece > 0):
        task["is_piece"] = leg.task.is_piece
    entry: dict[str, Any] = {
        "task": task,
        "may_wait": leg.may_wait,
        "gear": leg.gear,
        "speed_mps": leg.speed_mps,
        "implement": leg.implement,
        "ground": leg.ground,
        "points_m": leg.points.tolist(),
        "gates": [asdict(gate) for gate in leg.gates],
    }
    entry |= {name: getattr(leg, name) for name in ("stand_s", "fold_s", "folded") if getattr(leg, name)}
    return entry | ({"follow": asdict(leg.follow)} if leg.follow else {})


def parse_plan(text: str) -> Plan:
    """The plan of a saved plan; raises as parse_saved_plan does."""
    return parse_saved_plan(text).plan


def parse_saved_plan(text: str) -> SavedPlan:
    """Read a saved plan; raises MissionError if it is not a plan, of a newer version, or cannot be executed."""
    try:
        content = parse_json(text)
    except ValueError as error:
        raise MissionError(
            f"This is no saved plan, as it is not JSON ({error}); headland plan --save writes one."
        ) from None
    saved = _build_saved_plan(content)
    check_plan(saved.plan)
    return saved


def _build_saved_plan(data: Any) -> SavedPlan:
    _check_version(_get_checked_entry({"plan": data}, "plan", dict, "The text").get(VERSION_KEY))
    crs = _get_checked_entry(data, "crs", str, WHOLE_PLAN, optional=True)
    scenario = _get_checked_entry(data, "scenario", dict, WHOLE_PLAN)
    notes = dict(_get_checked_entry(data, "notes", dict, WHOLE_PLAN))
    stated = _get_checked_entry({STATED_KEY: {}} | notes, STATED_KEY, dict, NOTES)
    notes.pop(STATED_KEY, None)
    ground = _get_checked_entry({"ground": {}} | data, "ground", dict, WHOLE_PLAN)
    origin_m = _get_checked_entry(data, "origin_m", list, WHOLE_PLAN)
    if len(origin_m) != 2 or not all(type(metres) in (int, float) and abs(metres) <= FARTHEST_M for metres in origin_m):
        raise MissionError(
            f"{WHOLE_PLAN}: origin_m is {_shorten(origin_m)}; it must be two numbers of metres up to {FARTHEST_M:g}."
        )
    missions = []
    for number, legs in enumerate(_get_checked_entry(data, "tractors", list, WHOLE_PLAN)):
        if not isinstance(legs, list):
            raise MissionError(f"{WHOLE_PLAN}: tractor {number} is {_shorten(legs)}, not a list of legs.")
        missions.append(Mission(tuple(_build_leg(leg, f"Tractor {number}, leg {k}") for k, leg in enumerate(legs))))
    origin = (float(origin_m[0]), float(origin_m[1]))
    if not any("is_piece" in leg["task"] for legs in data["tractors"] for leg in legs):
        missions = _mark_pieces(missions)
    return SavedPlan(Plan(tuple(missions), _build_notes(notes)), crs, origin, scenario, ground, stated)


def _build_notes(entries: dict[str, Any]) -> PlanNotes:
    """The notes of a file without what was stated; an entry that is null or not there is unknown."""
    rest = {key: value for key, value in entries.items() if value is not None}

    def take(key: str, kind: type, default: Any) -> Any:
        value = _get_checked_entry({key: default} | rest, key, kind, NOTES, optional=default is None)
        rest.pop(key, None)
        return value

    stops = take(STOPS_KEY, list, None)
    apart = take("apart", list, [])
    if not all(type(number) is int for number in apart):
        raise MissionError(f"{NOTES}: apart is {_shorten(apart)}, not a list of numbers of tractors.")
    return PlanNotes(
        strategy=take("strategy", str, ""),
        headland=take("headland", str, ""),
        tractors=take("tractors", int, None),
        stops=None if stops is None else tuple(_build_stop(stop, f"{NOTES}, stop {k}") for k, stop in enumerate(stops)),
        collects=take("collects", bool, False),
        service=take("service", str, REFILL),
        formation_pct=take("formation_pct", float, None),
        apart=tuple(number - 1 for number in apart),
        loosened=take("loosened", int, 0),
        others=rest,
    )


def _build_stop(entry: Any, where: str) -> NotedStop:
    metres = (_get_checked_entry(entry, key, float, where) for key in ("amount", "x_m", "y_m"))
    number, leg = (_get_checked_entry(entry, key, int, where) for key in ("tractor", "leg"))
    degrees = (_get_checked_entry({key: None} | entry, key, float, where, optional=True) for key in ("lon", "lat"))
    return NotedStop(number - 1, leg, *metres, *degrees)


def _mark_pieces(missions: Sequence[Mission]) -> list[Mission]:
    """Missions of a plan that does not say which lines have several pieces: those of which it works a later one."""
    tasks = {leg.task for mission in missions for leg in mission.legs if leg.task.is_work}
    split = {(task.kind, task.number) for task in tasks if task.piece}

    def mark(leg: Leg) -> Leg:
        is_piece = leg.task.is_piece or (leg.task.kind, leg.task.number) in split
        return leg if is_piece == leg.task.is_piece else replace(leg, task=replace(leg.task, is_piece=is_piece))

    return [Mission(tuple(map(mark, mission.legs))) for mission in missions]


def _check_version(version: Any) -> None:
    if version is None:
        raise MissionError(f"The plan has no {VERSION_KEY!r}, so it is not a saved plan; save it again.")
    if type(version) is not int or version < 1:
        raise MissionError(f"The plan has the {VERSION_KEY} {version!r}; it must be a whole number from 1.")
    if version > FORMAT_VERSION:
        raise MissionError(
            f"The plan has format version {version}, and this Headland reads versions up to {FORMAT_VERSION}; use a "
            "newer Headland."
        )


def _build_leg(entry: Any, where: str) -> Leg:
    task = _get_checked_entry(entry, "task", dict, where)
    number = _get_checked_entry(task, "number", int, f"{where}, task", optional=True)
    piece = _get_checked_entry(task, "piece", int, f"{where}, task")
    gates, follow = _get_checked_entry(entry, "gates", list, where), entry.get("follow")
    return Leg(
        points=_build_points(entry, where),
        speed_mps=_get_checked_entry(entry, "speed_mps", float, where),
        gear=_get_checked_entry(entry, "gear", int, where),
        implement=_get_checked_entry(entry, "implement", bool, where),
        ground=_get_checked_entry(entry, "ground", str, where),
        task=LegTask(
            _get_checked_entry(task, "kind", str, f"{where}, task"),
            number,
            piece,
            _get_checked_entry({"is_piece": piece > 0} | task, "is_piece", bool, f"{where}, task"),
        ),
        may_wait=_get_checked_entry(entry, "may_wait", bool, where),
        gates=tuple(LegGate(*_build_link(gate, "after_m", f"{where}, gate {k}")) for k, gate in enumerate(gates)),
        follow=FollowOrder(*_build_link(follow, "gap_m", f"{where}, follow")) if follow else None,
        stand_s=_get_checked_entry({"stand_s": 0.0} | entry, "stand_s", float, where),
        fold_s=_get_checked_entry({"fold_s": 0.0} | entry, "fold_s", float, where),
        folded=_get_checked_entry({"folded": False} | entry, "folded", bool, where),
    )


def _build_points(entry: dict[str, Any], where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    points = _get_checked_entry(entry, "points_m", list, where)
    try:
        array = np.array(points, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise MissionError(f"{where}: points_m is {_shorten(points)}, not a list of pairs of metres.") from None
    if (np.abs(array) > FARTHEST_M).any():
        raise MissionError(f"{where}: points_m has a coordinate beyond {FARTHEST_M:g} m; save the plan again.")
    return array


def _build_link(entry: Any, metres_key: str, where: str) -> tuple[int, int, float]:
    """Tractor, leg and metres of a gate or an order to follow."""
    number, leg = _get_checked_entry(entry, "tractor", int, where), _get_checked_entry(entry, "leg", int, where)
    return number, leg, _get_checked_entry(entry, metres_key, float, where)


def _get_checked_entry(entries: Any, key: str, kind: type, where: str, *, optional: bool = False) -> Any:
    """An entry of an object in the file, checked for its type; an `optional` one may be null.

    Raises MissionError with `where`.
    """
    if not isinstance(entries, dict):
        raise MissionError(f"{where} is {_shorten(entries)}, not an object with {key!r}.")
    if key not in entries:
        raise MissionError(f"{where} has no {key!r}; save the plan again.")
    value = entries[key]
    if type(value) is kind or (optional and value is None):
        return value
    if kind is float and type(value) is int and abs(value) < LARGEST_NUMBER:
        return float(value)
    raise MissionError(f"{where}: {key} is {_shorten(value)}, not {TYPE_WORDS[kind]}.")


def _shorten(value: Any) -> str:
    words = repr(value)
    return words if len(words) <= SHOWN_LETTERS else f"{words[:SHOWN_LETTERS]}..."
