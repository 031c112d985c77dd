"""What a fleet is to do: a saved plan with the machines, how long its legs take when it is driven, and where it leads.

Making one drives the plan once in the simulator: seconds of computing, for a process of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.field import Field
from fields.read import read_field, sample_names
from planner.scenario import Scenario
from planner.service.centre.course import Course
from planner.service.centre.errors import CentreError
from planner.showing import MACHINES, machines_with, scenario_of
from vehicle.layout import WAITING
from vehicle.missions import Plan
from vehicle.plan_file import SavedPlan, saved_from_json
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor, tractor_names
from vehicle.world import simulate

NEARER = 0.8  # of the clearance that the plan itself keeps: what is nearer was not planned
LEAST_S = 0.05
LONGEST_STANDS_S = 86400.0  # of one tractor of a plan, all its refills
FARTHEST_M = 1e8  # that frames of the link take, more than twice round the earth
Ring = tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False)
class FleetPlan:
    """A plan to be driven live; metres are those of the plan, whose origin is in `saved`.

    `finish_s` is when each tractor is done in the simulated plan, `near_m` how near two come in it. `ground` is what is
    driven on, `field` is the field where it is known.
    """

    saved: SavedPlan
    scenario: Scenario
    tractor: Tractor
    implement: Implement
    courses: tuple[Course, ...]
    finish_s: tuple[float, ...]
    near_m: float
    ground: shapely.Geometry
    field: Field | None = None

    @property
    def tractors(self) -> int:
        """Number of tractors."""
        return len(self.courses)

    @property
    def plan(self) -> Plan:
        """The plan alone."""
        return self.saved.plan

    @property
    def rings(self) -> tuple[Ring, ...]:
        """Rings of the field, the outline first, in metres of the plan; none where the field is not known."""
        if self.field is None:
            return ()
        rings = (self.field.boundary.exterior, *self.field.boundary.interiors)
        return tuple(_ring(ring, self._shift) for ring in rings)

    @property
    def obstacles(self) -> tuple[Ring, ...]:
        """What stands in the field."""
        if self.field is None:
            return ()
        parts = shapely.get_parts([one.shape for one in self.field.obstacles])
        return tuple(_ring(part.exterior, self._shift) for part in parts)

    @property
    def _shift(self) -> np.ndarray:
        assert self.field is not None
        shift: np.ndarray = np.asarray(self.field.origin_m) - np.asarray(self.saved.origin_m)
        return shift

    @property
    def worked_m(self) -> float:
        """Metres of all working legs."""
        return sum(course.worked_m[-1] for course in self.courses)

    @property
    def clearance_m(self) -> float:
        """How near two may come before they are stopped: as was asked, and never more than the plan itself keeps."""
        return min(self.scenario.clearance_m, NEARER * self.near_m)


def prepared(
    text: str, field: Path | None = None, tractor: Path | None = None, timing: Mapping[str, Any] | None = None
) -> FleetPlan:
    """A saved plan made ready; the field and tractor files stand for those its scenario names.

    Without them only samples and tractors that come with Headland are read: names in a plan open no file. With the
    `timing` of `timing_of` it is not simulated: legs that were driven before a plan was made anew have no gates any
    more, so that from its beginning such a plan cannot be driven. Raises MissionError, ScenarioError, VehicleError or
    CentreError.
    """
    saved = saved_from_json(text)
    _check_stands(saved.plan)
    _check_place(saved)
    scenario = scenario_of(saved)
    if tractor is not None:
        scenario = replace(scenario, tractor=str(tractor))
        saved = replace(saved, scenario={name: v for name, v in saved.scenario.items() if name != MACHINES})
    elif MACHINES not in saved.scenario and scenario.tractor not in tractor_names():
        raise CentreError(
            f"The plan was made for the tractor {scenario.tractor[:60]!r}, which does not come with Headland; give the "
            "tractor file by its name.", parameter="tractor",
        )  # fmt: skip
    machine, implement = machines_with(saved, scenario)
    courses, finish_s, near_m = (
        _simulated(saved.plan, machine, implement) if timing is None else _timed_before(saved.plan, timing)
    )
    known = _field(scenario, saved, field)
    width_m = max(implement.contact_width_m, machine.width_m)
    ground = _ground(saved, known, width_m)
    return FleetPlan(saved, scenario, machine, implement, courses, finish_s, near_m, ground, known)


def _check_stands(plan: Plan) -> None:
    """Raise CentreError for stands that nobody would wait for: a plan is simulated to its end before it is driven."""
    for number, mission in enumerate(plan.missions, start=1):
        stands_s = math.fsum(leg.stand_s for leg in mission.legs)
        if stands_s > LONGEST_STANDS_S:
            raise CentreError(
                f"Tractor {number} of the plan stands for {stands_s:.6g} s; at most {LONGEST_STANDS_S:.0f} s, a day, "
                "are taken.", parameter="plan",
            )  # fmt: skip


def _check_place(saved: SavedPlan) -> None:
    """Raise CentreError for a plan that lies where no tractor can report to be."""
    ends_m = [np.abs(leg.points).max() for mission in saved.plan.missions for leg in mission.legs]
    farthest_m = float(max(map(abs, saved.origin_m))) + float(max(ends_m))
    if not farthest_m <= FARTHEST_M:
        raise CentreError(
            f"The plan reaches {farthest_m:.3g} m from the origin of its coordinate system; at most {FARTHEST_M:g} m "
            "are taken: give origin_m and points in metres of the field.", parameter="plan",
        )  # fmt: skip


Timed = tuple[tuple[Course, ...], tuple[float, ...], float]
"""Courses, when each tractor is done (s), and how near two come (m)."""


def _simulated(plan: Plan, machine: Tractor, implement: Implement) -> Timed:
    run = simulate(plan, machine, implement)
    if run.outcome != DONE:
        raise CentreError(
            f"The plan is not driven to its end ({run.outcome}) by {machine.name}; plan anew.", parameter="plan"
        )
    return timed(plan, run), tuple(float(t) for t in run.finish_s), run.min_clearance_m


def timing_of(plan: FleetPlan) -> dict[str, Any]:
    """How long the legs of a plan take, when its tractors are done and how near they come, as plain values."""
    return {
        "seconds": [list(course.seconds) for course in plan.courses], "finish_s": list(plan.finish_s),
        "near_m": plan.near_m if math.isfinite(plan.near_m) else None,
    }  # fmt: skip


def _timed_before(plan: Plan, timing: Mapping[str, Any]) -> Timed:
    """What `timing_of` gave of the same plan; raises CentreError for that of another."""
    seconds, near_m = timing["seconds"], timing["near_m"]
    if [len(each) for each in seconds] != [len(mission.legs) for mission in plan.missions]:
        raise CentreError("The times that are kept are those of another plan; make the fleet anew of its plan.")
    courses = tuple(Course(mission, tuple(each)) for mission, each in zip(plan.missions, seconds, strict=True))
    return courses, tuple(timing["finish_s"]), math.inf if near_m is None else near_m


def timed(plan: Plan, run: Run) -> tuple[Course, ...]:
    """The missions of a plan with the seconds that a run spends on each leg, waiting for others left out."""
    step_s = float(run.time_s[1] - run.time_s[0]) if len(run.time_s) > 1 else LEAST_S
    courses = []
    for number, mission in enumerate(plan.missions):
        driving = (run.status(number) != WAITING) & (run.time_s < run.finish_s[number])
        ticks = np.bincount(run.leg(number)[driving], minlength=len(mission.legs))
        courses.append(Course(mission, tuple(np.maximum(ticks * step_s, LEAST_S).tolist())))
    return tuple(courses)


def _field(scenario: Scenario, saved: SavedPlan, file: Path | None) -> Field | None:
    """The field of a plan: a file that was given, or a sample; None for neither."""
    if file is None and scenario.field not in sample_names():
        return None
    where = scenario.field if file is None else str(file)
    if file is not None and "#" in scenario.field:
        where += "#" + scenario.field.rsplit("#", 1)[1]
    field = read_field(where, local=scenario.local, crs=scenario.crs, swap=scenario.swap)
    if field.crs != saved.crs:
        raise CentreError(
            f"The field is in {field.crs or 'local metres'} and the plan in {saved.crs or 'local metres'}; give the "
            "field that the plan was made for.", parameter="field",
        )  # fmt: skip
    return field


def _ring(ring: shapely.LinearRing, shift: np.ndarray) -> Ring:
    return tuple((float(x), float(y)) for x, y in np.asarray(ring.coords)[:-1, :2] + shift)


def _ground(saved: SavedPlan, field: Field | None, width_m: float) -> shapely.Geometry:
    """What tractors may drive on: the field, and the ways of the plan."""
    # Each leg by itself: GEOS takes gigabytes for the buffer of all, where some drive the same way again and again.
    lines = np.array([shapely.LineString(leg.points) for m in saved.plan.missions for leg in m.legs])
    ways = shapely.union_all(shapely.buffer(lines, 0.5 * width_m, quad_segs=4))
    if field is not None:
        shift = np.asarray(field.origin_m) - np.asarray(saved.origin_m)
        ways = shapely.union(ways, shapely.Polygon(_ring(field.boundary.exterior, shift)))
    return shapely.simplify(ways, 0.05)
