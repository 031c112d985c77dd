"""The forces that a request adds to driving on level ground without a load: heights, soil and the work's draft.

They are read from what the request names, and every world that drives a plan gets them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fields.geometry.field import Field
from fields.terrain.elevation import read_elevation
from fields.terrain.elevation_grid import ElevationGrid
from fields.text_files import quote_path
from planner.errors import RequestError, attach_parameter, mark_parameter
from planner.evaluation.pull_check import find_engine_power_kw
from planner.farm.machines import FarmTractor
from planner.request.plan_request import LEAST_FUEL, PlanRequest
from planner.request.recent_rain import parse_recent_rain
from vehicle.energy.load import build_work_load
from vehicle.model.effect_kinds import PER_SLOPE
from vehicle.model.effects import SLOPE_DRIFT, get_effect
from vehicle.model.ground import GROUNDS, find_ground_index
from vehicle.model.soil import Soil, find_soil, get_soil_rows, load_soils, replace_soil_effects
from vehicle.model.soil_water import MoistureEstimate, build_estimated_soil, estimate_moisture
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import EffectSetting, Tractor
from vehicle.model.work_load import WorkLoad

SAVED_DECIMALS = 4  # of metres: a saved plan keeps them, and is then driven on the same ground
TABLE_SUFFIX, NAME_MARK = ".csv", "#"


@dataclass(frozen=True, eq=False)
class FieldPhysics:
    """Forces of a field beyond those on level ground without load.

    Attributes:
        terrain: heights in metres of the field; None for level ground.
        load: what the tractor pulls, and what its engine and tyres give.
        drives_with_load: whether plans are driven with the load; else it only tells what they use.
        takes_shaft_power: whether the implement is driven by the shaft, so that draft does not tell what it needs.
        soil: the soil of the request; None without one.
        elevation: the heights with where they come from; None for level ground and for a saved plan.
        moisture: that of the soil by the rain of the last days; None without rain and for a saved plan.
    """

    terrain: Terrain | None = None
    load: WorkLoad | None = None
    drives_with_load: bool = False
    takes_shaft_power: bool = False
    soil: Soil | None = None
    elevation: ElevationGrid | None = None
    moisture: MoistureEstimate | None = None

    @property
    def fuel_load(self) -> WorkLoad | None:
        """The load by which fuel is known; None where the engine is not, or drives the implement by its shaft."""
        return (
            None if self.load is None or self.takes_shaft_power or math.isinf(self.load.engine_power_w) else self.load
        )

    @property
    def driven_load(self) -> WorkLoad | None:
        """The load that plans are driven with."""
        return self.load if self.drives_with_load else None


LEVEL_GROUND = FieldPhysics()


def build_field_physics(
    request: PlanRequest, field: Field, tractor: Tractor, farm_tractor: FarmTractor | None = None
) -> FieldPhysics:
    """The physics of a request: heights from its file or that of the field, soil and load.

    Raises HeadlandError for heights that do not fit the field, an unknown soil, or a tractor without what a load needs.
    """
    elevation = read_requested_elevation(request, field)
    soil = find_requested_soil(request)
    rule = request.find_draft_rule()
    with attach_parameter("tractor"):
        power_kw = find_engine_power_kw(tractor, farm_tractor)
        load = build_work_load(tractor, request.width_m, request.operation, soil, rule=rule, engine_power_kw=power_kw)
    return FieldPhysics(
        None if elevation is None else build_terrain(elevation),
        load,
        elevation is not None or soil is not None,
        rule is None,
        soil,
        elevation,
        estimate_requested_moisture(request),
    )


def adapt_to_ground(tractor: Tractor, physics: FieldPhysics, ground: str) -> Tractor:
    """The tractor as it drives on this field: unchanged on level ground without a soil.

    What logs said of the soil stands in for the same effects of the tractor file. A drift that is known per slope is
    that of the mean slope of this field, less what the tyres give way by themselves on heights. Raises VehicleError for
    an unknown ground.
    """
    if physics.soil is not None:
        tractor = replace_soil_effects(tractor, physics.soil.effects)
    drift = tractor.effects.get(SLOPE_DRIFT)
    if physics.terrain is None or drift is None or PER_SLOPE not in drift.value:
        return tractor
    east, north = (-float(fall) for fall in _compute_mean_gradient(physics.terrain))
    left = max(drift.value[PER_SLOPE] - compute_tyre_drift(ground), 0.0)
    ratio, bearing = get_effect(SLOPE_DRIFT).params
    value = {
        **drift.value,
        ratio.name: left * math.hypot(east, north),
        bearing.name: math.degrees(math.atan2(east, north)) % 360.0,
    }
    interval = {name: bounds for name, bounds in drift.interval.items() if name == PER_SLOPE}
    setting = EffectSetting(**(dict(drift) | {"value": value, "interval": interval}))
    return tractor.model_copy(update={"effects": {**tractor.effects, SLOPE_DRIFT: setting}})


def compute_tyre_drift(ground: str) -> float:
    """Drift (m/m) per slope that the tyres of the simulation give way by: the slip angle of the rear axle.

    Raises VehicleError for an unknown ground.
    """
    return math.radians(1.0 / GROUNDS[find_ground_index(ground)].rear_slope_per_deg)


def _compute_mean_gradient(terrain: Terrain) -> tuple[float, float]:
    """Mean rise per metre to the east and to the north."""
    rows, columns = terrain.heights_m.shape
    xs, ys = (low + terrain.spacing_m * np.arange(count) for low, count in (
        (terrain.west_m, columns), (terrain.south_m, rows),
    ))  # fmt: skip
    east, north = terrain.compute_gradients(np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)).mean(axis=0)
    return float(east), float(north)


def build_level_physics(request: PlanRequest, tractor: Tractor) -> FieldPhysics:
    """The physics of a request on level ground without a soil: only what it uses."""
    rule = request.find_draft_rule()
    load = build_work_load(tractor, request.width_m, request.operation, rule=rule)
    return FieldPhysics(load=load, takes_shaft_power=rule is None)


def check_fuel_is_known(request: PlanRequest, physics: FieldPhysics, has_farm: bool) -> None:
    """Refuse the objective fuel where it cannot be judged; raises RequestError."""
    if request.objective != LEAST_FUEL or physics.fuel_load is not None or has_farm:
        return
    cause = (
        f"{request.operation} takes power from the shaft, which is not known; give a {mark_parameter('farm')}"
        if physics.takes_shaft_power
        else f"the tractor file says no engine; add power_kw under [engine], or give a {mark_parameter('farm')}"
    )
    raise RequestError(
        f"{mark_parameter('objective')} is {LEAST_FUEL!r}, and the fuel of these plans is not known: {cause}.",
        parameter="objective",
    )


def read_requested_elevation(request: PlanRequest, field: Field) -> ElevationGrid | None:
    """The heights of a request, else those that the field names; None without either.

    Raises HeadlandError for heights that are missing or do not fit the field, and a coordinate system without heights.
    """
    name = get_elevation_name(request, field)
    if name is None and request.elevation_crs is not None:
        raise RequestError(
            f"{mark_parameter('elevation_crs')} is of heights; name those with {mark_parameter('elevation')} as well."
        )
    if request.elevation is None and field.elevation is not None and not Path(field.elevation).exists():
        raise RequestError(
            f"Field '{field.name}' names the heights {quote_path(Path(field.elevation).name)}, and no such file is "
            f"beside that of the field; put it there, or give it as {mark_parameter('elevation')} (upload it first "
            "where fields are uploaded), or remove the property elevation of the field."
        )
    return None if name is None else read_elevation(name, field, request.elevation_crs)


def get_elevation_name(request: PlanRequest, field: Field) -> str | None:
    """The file of heights that a request names, else that of the field; None without either."""
    return field.elevation if request.elevation is None else request.elevation


def build_terrain(elevation: ElevationGrid) -> Terrain:
    """The ground to drive on, with heights as a saved plan keeps them."""
    unit = 10**SAVED_DECIMALS
    heights_m = np.round(elevation.heights_m * unit) / unit
    return Terrain(elevation.west_m, elevation.south_m, elevation.spacing_m, heights_m)


def build_grid(terrain: Terrain) -> ElevationGrid:
    """The heights of the ground to drive on, as what measures slopes takes them."""
    return ElevationGrid(terrain.west_m, terrain.south_m, terrain.spacing_m, terrain.heights_m)


def find_requested_soil(request: PlanRequest) -> Soil | None:
    """The soil of a request: a name of Headland's table, or a table of the user with the name after "#".

    Its moisture is the one asked for, else what the rain of the last days makes it, else the usual one. Raises
    HeadlandError for an unknown soil, a moisture that it does not have, and rain that cannot be read.
    """
    if request.soil is None:
        return None
    estimate = estimate_requested_moisture(request) if request.moisture_pct is None else None
    with attach_parameter("soil"):
        name, path = _find_soil_place(request.soil)
        if estimate is None:
            return find_soil(name, request.moisture_pct, path)
        return build_estimated_soil(get_soil_rows(name, path), estimate)


def estimate_requested_moisture(request: PlanRequest) -> MoistureEstimate | None:
    """Moisture of the soil of a request after the rain of the last days; None without rain. Raises HeadlandError."""
    if request.soil is None or request.rain_mm is None:
        return None
    rains_mm, et0s_mm = parse_recent_rain(request.rain_mm, request.et0_mm)
    with attach_parameter("soil"):
        return estimate_moisture(get_soil_rows(*_find_soil_place(request.soil)), rains_mm, et0s_mm)


def list_soil_rows(soil: str) -> tuple[Soil, ...]:
    """The lines of a soil as a request gives it; raises HeadlandError for one that is not known."""
    with attach_parameter("soil"):
        return get_soil_rows(*_find_soil_place(soil))


def _find_soil_place(soil: str) -> tuple[str, Path | None]:
    """Name and table of a soil; of a table with one soil the name may be left out."""
    name, path = split_soil_name(soil)
    if name or path is None:
        return name, path
    names = list(load_soils(path))
    if len(names) > 1:
        raise RequestError(
            f"The table {str(path)!r} has {len(names)} soils; name one as {mark_parameter('soil')} {path}#{names[0]}."
        )
    return names[0], path


def split_soil_name(soil: str) -> tuple[str, Path | None]:
    """Name and table of a soil as a request gives it: "clay", "soils.csv#north" or "soils.csv"; "" without a name."""
    stem, _, name = soil.rpartition(NAME_MARK)
    if stem.lower().endswith(TABLE_SUFFIX):
        return name, Path(stem)
    return ("", Path(soil)) if soil.lower().endswith(TABLE_SUFFIX) else (soil, None)
