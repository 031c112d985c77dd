"""Heights and load in a saved plan, so that it is driven again as it was without the files they came from."""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import asdict
from typing import Any

import numpy as np

from planner.errors import RequestError
from planner.evaluation.field_physics import HEIGHT_DECIMALS, FieldPhysics, build_level_physics
from planner.request.plan_request import PlanRequest
from vehicle.errors import VehicleError
from vehicle.missions.plan_file import SavedPlan
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad

PHYSICS_KEY = "physics"  # in the scenario of a plan whose heights or load its request does not tell
MAX_SAVED_NODES = 4_000_000
_UNIT = 10**HEIGHT_DECIMALS


def export_physics(physics: FieldPhysics, request: PlanRequest, tractor: Tractor) -> dict[str, Any]:
    """Heights and load of a plan as plain values; empty where request and tractor tell all.

    They do not on heights, on a soil, and where a farm knows the power of the engine, by which fuel is told.
    """
    load_of_request = build_level_physics(request, tractor).load
    if physics.load is None or (not physics.drives_with_load and physics.load == load_of_request):
        return {}
    load: dict[str, Any] = asdict(physics.load)
    power_w = load["engine_power_w"]
    values = {
        "load": load | {"engine_power_w": None if math.isinf(power_w) else power_w},
        "drives_with_load": physics.drives_with_load,
        "takes_shaft_power": physics.takes_shaft_power,
        "terrain": None if physics.terrain is None else _export_terrain(physics.terrain),
    }
    return {PHYSICS_KEY: values}


def _export_terrain(terrain: Terrain) -> dict[str, Any]:
    """Heights as differences from node to node in tenths of millimetres, compressed."""
    units = np.round(terrain.heights_m * _UNIT).astype(np.int64)
    steps = np.diff(units.ravel(), prepend=0).astype("<i4")
    return {
        "west_m": terrain.west_m,
        "south_m": terrain.south_m,
        "spacing_m": terrain.spacing_m,
        "shape": list(units.shape),
        "heights": base64.b64encode(zlib.compress(steps.tobytes(), 9)).decode("ascii"),
    }


def read_physics(saved: SavedPlan, request: PlanRequest, tractor: Tractor) -> FieldPhysics:
    """The physics of a saved plan; raises RequestError where they are garbled."""
    values = saved.scenario.get(PHYSICS_KEY)
    if values is None:
        return build_level_physics(request, tractor)
    try:
        load = dict(values["load"])
        load["draft_n"] = tuple(load["draft_n"])
        load["engine_power_w"] = math.inf if load["engine_power_w"] is None else load["engine_power_w"]
        terrain = None if values["terrain"] is None else _read_terrain(values["terrain"])
        drives_with_load = values.get("drives_with_load", True) is True
        return FieldPhysics(terrain, WorkLoad(**load), drives_with_load, values["takes_shaft_power"] is True)
    except (KeyError, TypeError, ValueError, OverflowError, VehicleError, zlib.error):
        raise RequestError(f"The {PHYSICS_KEY} in the scenario of the plan are garbled; save the plan again.") from None


def _read_terrain(values: dict[str, Any]) -> Terrain:
    """Raises ValueError for heights that do not fit their shape."""
    rows, columns = (int(count) for count in values["shape"])
    if not 0 < rows * columns <= MAX_SAVED_NODES:
        raise ValueError("too many heights")
    unpacker = zlib.decompressobj()
    content = unpacker.decompress(base64.b64decode(values["heights"], validate=True), 4 * rows * columns + 1)
    steps = np.frombuffer(content, dtype="<i4").astype(np.int64)
    heights_m = np.cumsum(steps).reshape(rows, columns) / _UNIT
    return Terrain(float(values["west_m"]), float(values["south_m"]), float(values["spacing_m"]), heights_m)
