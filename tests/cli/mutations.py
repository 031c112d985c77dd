"""Saved plans, and other JSON, with one value replaced by what nobody would write there."""

import copy
import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
import pyproj

from planner.request.plan_request import PlanRequest
from tests.drawn_fields import ring
from vehicle.missions.plan import SWATH, TURN, Leg, LegGate, LegTask, Mission, Plan, PlanNotes
from vehicle.missions.plan_file import format_plan
from vehicle.model.tractor import Implement, resolve_tractor

CRS, ORIGIN_M = "EPSG:32631", (680_000.0, 5_760_000.0)
OUTLINE_M = [[-10.0, -10.0], [40.0, -10.0], [40.0, 60.0], [-10.0, 60.0]]
FIELD = "small.geojson"
HUGE, DEEP = 10**400, 600
Path = tuple[str | int, ...]


def nested(levels: int) -> list[Any]:
    """A list in a list in a list."""
    inner: list[Any] = []
    for _ in range(levels):
        inner = [inner]
    return inner


ODD: dict[str, Any] = {
    "null": None, "nan": float("nan"), "list": [], "pair": [1.0, "x"], "object": {}, "filled": {"a": [1]},
    "huge": HUGE, "large": 1e300, "minus": -1, "text": "x" * 10_000, "break": "a\nb\x1b[31m", "true": True,
    "deep": nested(DEEP),
}  # fmt: skip


def small_field() -> dict[str, Any]:
    """GeoJSON of the field of `small_plan`."""
    to_degrees = pyproj.Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)
    corners = [to_degrees.transform(x + ORIGIN_M[0], y + ORIGIN_M[1]) for x, y in OUTLINE_M]
    return ring(*corners)


def small_plan(machines: bool = False) -> dict[str, Any]:
    """Two tractors with a track and a turn each, as a saved plan is; with the `machines` of a farm if asked for."""
    legs = [_legs(0.0, ()), _legs(12.0, (LegGate(0, 0, 20.0),))]
    asked = PlanRequest(
        field=FIELD, tractors=(2,), strategies=("split-field",), cell_bearings=((1, 0.0),), start_s=28_800
    )
    own = {"tractor": resolve_tractor("eg105").model_dump(mode="json"), "implement": Implement().model_dump()}
    text = format_plan(
        Plan(tuple(Mission(own) for own in legs), PlanNotes("split-field")), crs=CRS, origin_m=ORIGIN_M,
        scenario=asdict(asked) | ({"machines": own} if machines else {}), ground=_ground(),
    )  # fmt: skip
    plan: dict[str, Any] = json.loads(text)
    return plan


def _legs(x: float, gates: tuple[LegGate, ...]) -> tuple[Leg, ...]:
    up = np.array([[x, 0.0], [x, 40.0]])
    across = np.array([[x, 40.0], [x, 44.0], [x, 48.0]])
    first = Leg(up, 1.4, implement=True, task=LegTask(SWATH, 0 if x == 0.0 else 3), gates=gates)
    return first, Leg(across, 1.4, task=LegTask(TURN, 1), may_wait=True)


def _ground() -> dict[str, Any]:
    return {
        "name": "small", "boundary_m": [OUTLINE_M],
        "inside_headland_m": [[[[-2.0, -2.0], [30.0, -2.0], [30.0, 50.0], [-2.0, 50.0]]]],
        "obstacles": [{"name": "pole", "outline_m": [[[35.0, 1.0], [36.0, 1.0], [36.0, 2.0]]]}],
        "entrance_m": [-10.0, 0.0],
    }  # fmt: skip


def paths(value: Any, here: Path = ()) -> Iterator[Path]:
    """Every place in JSON, the whole of it first."""
    yield here
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from paths(inner, (*here, key))


def replaced(whole: Any, path: Path, value: Any) -> Any:
    """The same JSON with another value in one place."""
    if not path:
        return value
    changed = copy.deepcopy(whole)
    inner = changed
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return changed
