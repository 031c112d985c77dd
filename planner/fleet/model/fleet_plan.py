"""The plan of a fleet: a saved plan with machines, field and the times of its legs.

Preparing one simulates the plan once, which takes seconds: do it in a process of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.documents.reader import read_field
from fields.geometry.field import Field
from fields.geometry.overlays import unite
from fields.sample_fields import list_sample_names
from fields.units import DAY_S
from planner.evaluation.field_physics import LEVEL_GROUND, FieldPhysics
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.model.timed_mission import TimedMission
from planner.pipeline.outputs.saved_plans import MACHINES_KEY, read_machines, read_physics, read_request
from planner.request.plan_request import PlanRequest
from vehicle.missions.plan import Plan
from vehicle.missions.plan_file import FARTHEST_M, SavedPlan, parse_saved_plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.tractor import Implement, Tractor, list_tractor_names
from vehicle.records import WAITING
from vehicle.sim.world import World

CLEARANCE_SHARE = 0.8  # of the clearance that the plan itself keeps: what is nearer was not planned
SHORTEST_LEG_S = 0.05
LONGEST_STANDS_S = DAY_S  # of one tractor of a plan, all its refills
TimedPlan = tuple[tuple[TimedMission, ...], tuple[float, ...], float]
"""Timed missions, when each tractor is done (s), and the least distance of two (m)."""


@dataclass(frozen=True, eq=False)
class FleetPlan:
    """A plan to be driven live; metres are those of the plan, whose origin is in `saved`.

    `finish_s` is when each tractor is done in the simulation, `min_clearance_m` the least distance of two in it.
    `ground` is the ground that is driven on, `field` the field if it is known, `physics` its heights and load.
    """

    saved: SavedPlan
    scenario: PlanRequest
    tractor: Tractor
    implement: Implement
    timed_missions: tuple[TimedMission, ...]
    finish_s: tuple[float, ...]
    min_clearance_m: float
    ground: shapely.Geometry
    field: Field | None = None
    physics: FieldPhysics = LEVEL_GROUND

    @property
    def tractor_count(self) -> int:
        """Number of tractors."""
        return len(self.timed_missions)

    @property
    def plan(self) -> Plan:
        """The plan alone."""
        return self.saved.plan

    @property
    def worked_m(self) -> float:
        """Metres of all working legs."""
        return sum(timed_mission.worked_m[-1] for timed_mission in self.timed_missions)

    @property
    def clearance_m(self) -> float:
        """The distance below which two tractors are stopped: as requested, but less than the least of the plan."""
        return min(self.scenario.clearance_m, CLEARANCE_SHARE * self.min_clearance_m)


def prepare_fleet_plan(
    text: str, field: Path | None = None, tractor: Path | None = None, timing: Mapping[str, Any] | None = None
) -> FleetPlan:
    """Prepare a saved plan; the field and tractor files replace those that it names.

    Without them only samples and tractors of Headland are read: a name in a plan never opens a file. With `timing` of
    `describe_timing` the plan is not simulated: a replanned plan has no gates on its driven legs, so it cannot be
    simulated from its start. Raises MissionError, RequestError, VehicleError or FleetManagerError.
    """
    saved = parse_saved_plan(text)
    # A plan is simulated to its end before it is driven.
    for number, mission in enumerate(saved.plan.missions, start=1):
        stands_s = math.fsum(leg.standing_s for leg in mission.legs)
        if stands_s > LONGEST_STANDS_S:
            raise FleetManagerError(
                f"Tractor {number} of the plan stops for {stands_s:.6g} s in all; shorten that to at most "
                f"{LONGEST_STANDS_S:.0f} s (a day).",
                parameter="plan",
            )
    ends_m = [np.abs(leg.points).max() for mission in saved.plan.missions for leg in mission.legs]
    farthest_m = float(max(map(abs, saved.origin_m))) + float(max(ends_m))
    if not farthest_m <= FARTHEST_M:  # frames hold no coordinates beyond that
        raise FleetManagerError(
            f"The plan reaches {farthest_m:.3g} m from the origin of its coordinate system; at most {FARTHEST_M:g} m "
            "are allowed: give origin_m and points in metres of the field.",
            parameter="plan",
        )
    scenario = read_request(saved)
    if tractor is not None:
        scenario = replace(scenario, tractor=str(tractor))
        saved = replace(saved, scenario={name: v for name, v in saved.scenario.items() if name != MACHINES_KEY})
    elif MACHINES_KEY not in saved.scenario and scenario.tractor not in list_tractor_names():
        raise FleetManagerError(
            f"The plan was made for the tractor {scenario.tractor[:60]!r}, which does not come with Headland; give the "
            "tractor file by its name.",
            parameter="tractor",
        )
    machine, implement = read_machines(saved, scenario)
    physics = read_physics(saved, scenario, machine)
    if timing is None:
        run = World(saved.plan, machine, implement, terrain=physics.terrain, load=physics.driven_load).run()
        if run.outcome != DONE:
            raise FleetManagerError(
                f"{machine.name} does not reach the end of the plan ({run.outcome}); plan again.", parameter="plan"
            )
        timed_plan = build_timed_missions(saved.plan, run), tuple(float(t) for t in run.finish_s), run.min_clearance_m
    else:
        timed_plan = _restore_timing(saved.plan, timing)
    plan_field = _read_plan_field(scenario, saved, field)
    ground = _build_driving_area(saved, plan_field, max(implement.contact_width_m, machine.width_m))
    return FleetPlan(saved, scenario, machine, implement, *timed_plan, ground, plan_field, physics)


def describe_timing(plan: FleetPlan) -> dict[str, Any]:
    """Times of legs, finish times and least distance of a plan, as plain values to save."""
    return {
        "seconds": [list(timed_mission.leg_seconds) for timed_mission in plan.timed_missions],
        "finish_s": list(plan.finish_s),
        "near_m": plan.min_clearance_m if math.isfinite(plan.min_clearance_m) else None,
    }


def _restore_timing(plan: Plan, timing: Mapping[str, Any]) -> TimedPlan:
    """Read what `describe_timing` returned for the same plan; raises FleetManagerError for another plan's."""
    seconds, min_clearance_m = timing["seconds"], timing["near_m"]
    if [len(leg_seconds) for leg_seconds in seconds] != [len(mission.legs) for mission in plan.missions]:
        raise FleetManagerError("The saved times belong to another plan; create the fleet again from its plan.")
    timed_missions = tuple(
        TimedMission(mission, tuple(leg_seconds)) for mission, leg_seconds in zip(plan.missions, seconds, strict=True)
    )
    return timed_missions, tuple(timing["finish_s"]), math.inf if min_clearance_m is None else min_clearance_m


def build_timed_missions(plan: Plan, run: SimulationRun) -> tuple[TimedMission, ...]:
    """The missions of a plan with the seconds of each leg in a run, without waiting for others."""
    step_s = run.step_s or SHORTEST_LEG_S
    timed_missions = []
    for number, mission in enumerate(plan.missions):
        driving = (run.get_statuses(number) != WAITING) & (run.time_s < run.finish_s[number])
        ticks = np.bincount(run.get_leg_numbers(number)[driving], minlength=len(mission.legs))
        timed_missions.append(TimedMission(mission, tuple(np.maximum(ticks * step_s, SHORTEST_LEG_S).tolist())))
    return tuple(timed_missions)


def _read_plan_field(scenario: PlanRequest, saved: SavedPlan, file: Path | None) -> Field | None:
    """The field of a plan: the given file, or a sample; None if neither."""
    if file is None and scenario.field not in list_sample_names():
        return None
    source = scenario.field if file is None else str(file)
    if file is not None and "#" in scenario.field_name:
        source += "#" + scenario.field.partition("#")[2]
    field = read_field(source, local=scenario.local, crs=scenario.crs, swap_axes=scenario.swap_axes)
    if field.crs != saved.crs:
        raise FleetManagerError(
            f"The field is in {field.crs or 'local metres'} and the plan in {saved.crs or 'local metres'}; give the "
            "field that the plan was made for.",
            parameter="field",
        )
    return field


def build_field_outline(field: Field, saved: SavedPlan) -> shapely.Polygon:
    """The outline of a field with its holes filled, in metres of a plan, whose origin may be another."""
    shift = np.asarray(field.origin_m) - np.asarray(saved.origin_m)
    return shapely.Polygon(np.asarray(field.boundary.exterior.coords)[:, :2] + shift)


def _build_driving_area(saved: SavedPlan, field: Field | None, width_m: float) -> shapely.Geometry:
    """The ground that tractors may drive on: the field, and the paths of the plan."""
    # One buffer per leg: GEOS takes gigabytes for the buffer of all legs where many share a path.
    lines = np.array([shapely.LineString(leg.points) for m in saved.plan.missions for leg in m.legs])
    driven_area = unite(shapely.buffer(lines, 0.5 * width_m, quad_segs=4))
    if field is not None:
        driven_area = unite([driven_area, build_field_outline(field, saved)])
    return shapely.simplify(driven_area, 0.05)
