"""Saved plans: written as text, read back with their request and machines, and simulated again."""

from __future__ import annotations

import base64
import json
import math
import os
import zlib
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.text_files import read_text
from planner.errors import HeadlandError, RequestError, attach_parameter
from planner.evaluation.context import PlanningContext
from planner.evaluation.field_physics import SAVED_DECIMALS, FieldPhysics, build_level_physics
from planner.evaluation.work_order import PlannedLayout, load_gnss_errors, size_implement
from planner.farm.workday import ROAD, Duty, Workday
from planner.pipeline.outputs.driving_steps import Steps, delay_steps, list_steps
from planner.pipeline.outputs.step_measures import measure_steps
from planner.request.plan_request import PlanRequest
from planner.request.service_points import add_coordinates
from reports.common.plan_results import PlanRanking
from strategies.rules.battery_supply import BatterySupply
from strategies.rules.supply import HEADLAND, PLACE, SERVICE_VEHICLE, Supply
from vehicle.errors import MissionError, VehicleError
from vehicle.missions.plan import REFILL, SWATH, Plan
from vehicle.missions.plan_file import SavedPlan, format_plan, parse_saved_plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Implement, Tractor, list_tractor_names, resolve_tractor
from vehicle.model.work_load import WorkLoad
from vehicle.sim.compile import compute_point_speeds
from vehicle.sim.world import World

MACHINES_KEY = "machines"  # in the scenario of a farm's plan: its tractor and implement, value by value
BARE_KEY = "bare_tractor"  # among these the tractor without what soil and heights do to it, where they do anything
SUPPLY_KEY = "supply"  # among these what the implement carries, value by value
USED_KEY = "used"  # among these what tractors that stand on the field have used of that before the plan, in their order
LOAD_KEY = "load"  # among these in earlier plans: that it carries something
EARLIER_NAMES = {
    "before_s": "deadline_s",
    "draws": "samples",
    "prefer": "objective",
    "swap": "swap_axes",
    "along": "guidance_line",
    "tracks_only": "no_headland",
}
"""Parameters of a request by their names in plans that version 0.1 saved, and the fleets made of them."""
LATER_PARAMETERS = ("draft", "depth_cm", "rain_mm", "et0_mm", "open_edges", "sections", "transport_width_m")
"""Parameters that plans without them do not name, so that an older Headland can read those."""
LATER_IMPLEMENT = ("transport_width_m", "fold_s")
"""Values of an implement that are left out where they are usual, for the same reason."""
WORKDAY_KEY = "workday"  # in what a saved plan states: what precedes field work, breaks and shift
MOST_BREAKS = 1000  # of a saved day
PHYSICS_KEY = "physics"  # in the scenario of a plan whose heights or load its request does not tell
MAX_SAVED_NODES = 4_000_000
_UNIT = 10**SAVED_DECIMALS


@dataclass(frozen=True)
class StatedFigures:
    """What the ranking of a plan stated when it was saved: `end_s` and `late_end_s` in half and in 95 % of the samples.

    `begin_s` and the ends of field work are seconds by the clock from the start; what is not known is None.
    """

    end_s: float
    begin_s: float = 0.0
    late_end_s: float | None = None
    cost: float | None = None
    currency: str | None = None


@dataclass(frozen=True, eq=False)
class SavedPlanRun:
    """A saved plan with its request and machines, its run, and the steps of every tractor."""

    saved: SavedPlan
    request: PlanRequest
    tractor: Tractor
    implement: Implement
    run: SimulationRun
    steps: Steps


def load_saved_plan(path: str | Path) -> SavedPlan:
    """The plan that `headland plan --save` wrote to a file; raises MissionError."""
    return parse_saved_plan(read_text(path, "a plan of headland plan --save", MissionError))


def simulate_saved_plan(path: str | Path) -> SavedPlanRun:
    """Read a plan of `headland plan --save` and simulate it as it was when it was saved.

    The tractor is the one its request names, or for a farm the one saved with the plan; the field is not needed, as
    legs carry their ground. Raises MissionError, RequestError or VehicleError if the file holds no plan, or one that
    this tractor does not finish.
    """
    saved = load_saved_plan(path)
    request = read_request(saved)
    run = rerun_plan(saved, request)
    if run.outcome != DONE:
        raise MissionError(
            f"The plan is not driven to its end ({run.outcome}): it or the tractor {request.tractor!r} was changed "
            f"since it was saved{_describe_old_plan(saved)}; plan again."
        )
    tractor, implement = read_machines(saved, request)
    measures = measure_steps(run, tractor, read_physics(saved, request, tractor))
    steps = list_steps(run, request.width_m, measures, operation=request.operation)
    steps = delay_steps(steps, read_workday(saved, request))
    return SavedPlanRun(saved, request, tractor, implement, run, steps)


def read_request(saved: SavedPlan) -> PlanRequest:
    """The request saved with a plan; raises RequestError if there is none or it is garbled."""
    if not saved.scenario:
        raise RequestError("The plan has no scenario that names its tractor; save it with headland plan --save.")
    request_values = {
        EARLIER_NAMES.get(key, key): value
        for key, value in saved.scenario.items()
        if key not in (MACHINES_KEY, PHYSICS_KEY)
    }
    unknown_keys = sorted(request_values.keys() - {each.name for each in fields(PlanRequest)})
    if unknown_keys:
        raise RequestError(f"The scenario of the plan has {unknown_keys[0]!r}, which is unknown; use a newer Headland.")
    try:
        return PlanRequest(**{key: _convert_to_tuple(value) for key, value in request_values.items()})
    except RecursionError:
        raise RequestError("The scenario of the plan is nested too deep; save the plan again.") from None


def _convert_to_tuple(value: Any) -> Any:
    """A value with its lists turned into tuples."""
    return tuple(map(_convert_to_tuple, value)) if isinstance(value, list) else value


def rerun_plan(saved: SavedPlan, request: PlanRequest) -> SimulationRun:
    """The run of a saved plan with the tractor, implement, ground and position errors of its request."""
    tractor, implement = read_machines(saved, request)
    physics, errors = read_physics(saved, request, tractor), load_gnss_errors(request)
    world = World(
        saved.plan,
        tractor,
        implement,
        terrain=physics.terrain,
        load=physics.driven_load,
        position_errors=errors,
        seed=request.seed,
    )
    return world.run()


def export_machines(context: PlanningContext) -> dict[str, Any]:
    """The machines of a farm, with a tank, or of a plan that went on, and others that the request does not tell; empty
    without. A battery is told by its tractor."""
    supply = None if isinstance(context.supply, BatterySupply) else context.supply
    if context.cost_terms is None and context.going_on is None and supply is None and _are_machines_named(context):
        return {}
    implement = {
        name: value
        for name, value in context.implement.model_dump().items()
        if name not in LATER_IMPLEMENT or value != Implement.model_fields[name].default
    }
    machines: dict[str, Any] = {"tractor": context.tractor.model_dump(mode="json"), "implement": implement}
    if context.bare_tractor != context.tractor:
        machines[BARE_KEY] = context.bare_tractor.model_dump(mode="json")
    used = () if context.going_on is None else [stand.used for stand in context.going_on.stands]
    machines |= {USED_KEY: used} if any(used) else {}
    return {MACHINES_KEY: machines | ({} if supply is None else {SUPPLY_KEY: asdict(supply)})}


def _are_machines_named(context: PlanningContext) -> bool:
    """Whether a request names tractor and implement as they are driven: no objects of Python, nor effects of a soil."""
    if context.implement != size_implement(None, context.request):
        return False
    try:
        return resolve_tractor(context.request.tractor) == context.tractor
    except HeadlandError:
        return False


def _get_machine_values(saved: SavedPlan) -> dict[str, Any]:
    """What was saved of the machines of a plan; empty where nothing readable was."""
    machines = saved.scenario.get(MACHINES_KEY)
    return machines if isinstance(machines, dict) else {}


def read_supply(saved: SavedPlan) -> Supply | None:
    """What the implement of a saved plan carries, its place in metres of the plan; None where the plan does not say so.

    Raises RequestError where it is garbled.
    """
    values = _get_machine_values(saved).get(SUPPLY_KEY)
    if values is None:
        return None
    try:
        supply = Supply(**values)
        place = None if supply.place is None else (float(supply.place[0]), float(supply.place[1]))
        amounts = [float(value) for value in (supply.capacity, supply.rate_per_m2, supply.stop_s, *(place or ()))]
        is_possible = all(map(math.isfinite, amounts)) and min(amounts[:2]) > 0.0 and amounts[2] >= 0.0
        if not is_possible or supply.served_at not in (PLACE, HEADLAND, SERVICE_VEHICLE):
            raise ValueError
    except (TypeError, ValueError, IndexError, KeyError):
        raise RequestError(f"The {SUPPLY_KEY} in the scenario of the plan is garbled; save the plan again.") from None
    return replace(supply, collects=supply.collects is True, place=place)


def read_used(saved: SavedPlan) -> tuple[float, ...]:
    """What every tractor of a saved plan had used of its load before it.

    Raises RequestError where it is garbled.
    """
    values = _get_machine_values(saved).get(USED_KEY, ())
    try:
        used = [float(value) for value in values]
        if not all(0.0 <= value < math.inf for value in used):
            raise ValueError
    except (TypeError, ValueError):
        raise RequestError(
            f"The {MACHINES_KEY} in the scenario of the plan are garbled; save the plan again."
        ) from None
    return (*used, *[0.0] * (saved.plan.tractors - len(used)))


def has_unknown_tank(saved: SavedPlan, request: PlanRequest) -> bool:
    """Whether the implement of a saved plan carries something, and the plan does not say how much."""
    legs = (leg for mission in saved.plan.missions for leg in mission.legs)
    is_refilled = request.refill is not None or any(leg.task.kind == REFILL for leg in legs)
    tractor, _ = read_machines(saved, request)
    is_loaded = is_refilled or LOAD_KEY in _get_machine_values(saved)
    return tractor.battery is None and is_loaded and read_supply(saved) is None


def _describe_old_plan(saved: SavedPlan) -> str:
    """A possible cause for a plan saved without machines."""
    return (
        ""
        if MACHINES_KEY in saved.scenario
        else ", or it is a farm's plan from an older Headland that saved no machines"
    )


def read_machines(saved: SavedPlan, request: PlanRequest) -> tuple[Tractor, Implement]:
    """The machines saved with the plan, or the tractor of its request and a default implement of its width.

    The tractor is as it drove the plan: with what soil and heights did to it.
    """
    saved_machines = saved.scenario.get(MACHINES_KEY)
    if saved_machines is None:
        name = request.tractor
        if name not in list_tractor_names() and not os.path.lexists(name):
            raise RequestError(
                f"The tractor {name!r} of the plan is neither known nor an existing file{_describe_old_plan(saved)}; "
                "plan again, or put the tractor's file back.",
                parameter="tractor",
            )
        with attach_parameter("tractor"):
            return resolve_tractor(request.tractor), size_implement(None, request)
    try:
        tractor, implement = (json.dumps(saved_machines[name]) for name in ("tractor", "implement"))
        return Tractor.model_validate_json(tractor), Implement.model_validate_json(implement)
    except (KeyError, TypeError, ValueError):
        raise RequestError(
            f"The {MACHINES_KEY} in the scenario of the plan are garbled; save the plan again."
        ) from None


def read_bare_tractor(saved: SavedPlan, request: PlanRequest) -> Tractor:
    """The tractor of a saved plan without what soil and heights did to it."""
    machines = _get_machine_values(saved)
    if BARE_KEY not in machines:
        return read_machines(saved, request)[0]
    bare = replace(saved, scenario=saved.scenario | {MACHINES_KEY: machines | {"tractor": machines[BARE_KEY]}})
    return read_machines(bare, request)[0]


def write_saved_plan(context: PlanningContext, plan: Plan, ranking: PlanRanking | None = None) -> str:
    """A plan as JSON: legs and gates with the request and the machines they are for, and what its ranking states."""
    field = context.layout.field
    physics = export_physics(context.physics, context.request, context.tractor)
    request_values = _export_request(context.request) | export_machines(context) | physics
    text = format_plan(
        add_coordinates(plan, field),
        crs=field.crs,
        origin_m=field.origin_m,
        scenario=request_values,
        ground=_export_ground(context),
        stated=_export_stated_figures(plan, context.workday, ranking),
        point_speeds=compute_point_speeds(plan, context.tractor),
    )
    return text + "\n"


def _export_request(request: PlanRequest) -> dict[str, Any]:
    """The values of a request by name; later parameters only where they are given."""
    defaults = {one.name: one.default for one in fields(request) if one.name in LATER_PARAMETERS}
    return {name: value for name, value in asdict(request).items() if name not in defaults or value != defaults[name]}


def read_stated_figures(saved: SavedPlan) -> StatedFigures | None:
    """What the ranking of a saved plan stated; None where nothing readable was saved."""
    kinds: dict[str, Any] = {one.name: str if one.name == "currency" else int | float for one in fields(StatedFigures)}
    values: dict[str, Any] = {
        key: value for key, value in saved.stated.items() if key in kinds and isinstance(value, kinds[key])
    }
    return StatedFigures(**values) if "end_s" in values else None


def read_workday(saved: SavedPlan, request: PlanRequest) -> Workday:
    """The working day of a saved plan up to its field work, with its breaks, of which earlier Headlands saved none.

    Raises RequestError where it is garbled.
    """
    stated = read_stated_figures(saved)
    values = saved.stated.get(WORKDAY_KEY)
    if stated is None or values is None:
        return Workday(duties_before=() if stated is None else (Duty(ROAD, stated.begin_s),))
    try:
        breaks_s = tuple((int(first), int(last)) for first, last in values["breaks_s"])
        begin_s, end_s = (None if at is None else int(at) for at in values["shift_s"])
        before = (Duty(ROAD, float(values["before_s"])),)
        if not (0.0 <= before[0].seconds < math.inf and len(breaks_s) <= MOST_BREAKS):
            raise ValueError
        return Workday(request.start_s, before, breaks_s=breaks_s, shift_s=(begin_s, end_s))
    except (TypeError, ValueError, KeyError, OverflowError, HeadlandError):
        raise RequestError(f"The {WORKDAY_KEY} in the notes of the plan is garbled; save the plan again.") from None


def _export_stated_figures(plan: Plan, workday: Workday | None, ranking: PlanRanking | None) -> dict[str, Any]:
    """Time (s) and cost of a plan as every report states them, and its working day; empty without its ranking."""
    key = plan.notes.strategy, plan.notes.tractors or plan.tractors
    results = [] if ranking is None else ranking.plans
    result = next((each for each in results if each.feasible and (each.strategy, each.tractors) == key), None)
    if result is None or ranking is None:
        return {}
    day = {}
    if workday is not None:
        duties = {"before_s": workday.before_field_s, "breaks_s": workday.breaks_s, "shift_s": workday.shift_s}
        day = {WORKDAY_KEY: duties}
    end_s, late_end_s = result.stated_end_s, result.stated_late_end_s
    return day | asdict(StatedFigures(end_s, result.ready_s or 0.0, late_end_s, result.stated_cost, ranking.currency))


def _export_ground(context: PlanningContext) -> dict[str, Any]:
    """Outlines of the field in metres to 0.1 mm, which `headland export` writes with the lines.

    Polygons are lists of rings, outer ring first, without the closing point. ``inside_headland_m`` is the ground inside
    the headland passes; empty where the headland is only room for turning.
    """
    layout, field = context.layout, context.layout.field
    inside = shapely.get_parts(layout.inner_region) if layout.headland_passes else ()
    return {
        "name": field.name,
        "boundary_m": _export_rings(field.whole_boundary),
        "inside_headland_m": [_export_rings(part) for part in inside if part.area > 0.0],
        "done_m": [] if field.done is None else [_export_rings(part) for part in shapely.get_parts(field.done)],
        "obstacles": [
            {"name": one.name or one.kind, "outline_m": _export_rings(part)}
            for one in field.obstacles
            for part in shapely.get_parts(one.shape)
        ],
        "entrance_m": None if field.entrance is None else [round(value, SAVED_DECIMALS) for value in field.entrance],
    }


def read_done_ground(saved: SavedPlan) -> list[shapely.Polygon]:
    """The ground that was done before a saved plan, in its metres; raises RequestError where it is garbled."""
    try:
        return [shapely.Polygon(rings[0], rings[1:]) for rings in saved.ground.get("done_m", ())]
    except (TypeError, ValueError, IndexError, shapely.errors.GEOSException):
        raise RequestError("The ground done before the plan is garbled; save the plan again.") from None


def read_planned_layout(saved: SavedPlan) -> PlannedLayout:
    """The layout of a saved plan; raises RequestError where it is garbled."""
    tracks = [
        shapely.LineString(leg.points)
        for mission in saved.plan.missions
        for leg in mission.legs
        if leg.implement and leg.task.kind == SWATH
    ]
    middles = shapely.get_coordinates(shapely.line_interpolate_point(tracks, 0.5, normalized=True))
    try:
        parts = [shapely.Polygon(rings[0], rings[1:]) for rings in saved.ground.get("inside_headland_m", ())]
        return PlannedLayout(saved.origin_m, shapely.unary_union(shapely.make_valid(parts)), middles)
    except (TypeError, ValueError, IndexError, shapely.errors.GEOSException):
        raise RequestError("The ground inside the headland of the plan is garbled; save the plan again.") from None


def _export_rings(polygon: shapely.Polygon) -> list[list[list[float]]]:
    loops = (polygon.exterior, *polygon.interiors)
    return [shapely.get_coordinates(loop)[:-1].round(SAVED_DECIMALS).tolist() for loop in loops]


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
