"""Legs from the entrance of a field to where every tractor begins, and back to it.

Before it begins a tractor stands on the road, and after it has left it is gone: in nobody's way. All enter by one lane,
one after another, each when the one before is clear of it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from strategies.headland.plan_passes import WAIT_POINT_STEP_M, renumber_gates
from strategies.headland.raised_paths import find_raised_path
from strategies.path_planning.errors import NoPathFromError, StrategyError
from strategies.path_planning.paths import DrivePath, EntranceLane, Pose, join_paths, make_straight_path
from strategies.program.field_job import FieldJob
from strategies.program.legs import add_wait_points, build_path_legs, make_mission
from vehicle.missions.plan import ENTER, LEAVE, Leg, LegGate, LegTask, Mission, Plan

STRAIGHT_ON_RADII = (0.0, 1.5, 3.0, 6.0)  # radii straight on from the entrance before the first turn
GOAL_DISTANCE_M = 40.0  # last part of the path in, whose legs are named after the work they lead to


def add_entrance(job: FieldJob, plan: Plan) -> Plan:
    """The plan with every tractor entering and leaving by the entrance lane of the job; unchanged if there is none.

    Raises StrategyError if no path leads in or out.
    """
    if job.entrance_lane is None:
        return plan
    entrance_legs = [
        (
            _build_entry_legs(job, job.entrance_lane, tractor_mission),
            build_exit_legs(job, job.entrance_lane, tractor_mission),
        )
        for tractor_mission in plan.missions
    ]
    leg_offsets = [len(legs_in) for legs_in, _ in entrance_legs]
    missions = []
    for mission, (legs_in, legs_out) in zip(plan.missions, entrance_legs, strict=True):
        missions.append(make_mission([*legs_in, *renumber_gates(mission.legs, leg_offsets), *legs_out]))
    return _add_entry_gates(job, plan, missions)


def _build_entry_legs(job: FieldJob, gate: EntranceLane, mission: Mission) -> list[Leg]:
    """The legs from the entrance to the start of a mission."""
    path = _find_entrance_path(job, gate, mission.start, outwards=False)
    if path is None:
        raise _build_no_path_error(job, mission.start, "the entrance to where work begins")
    goal_task = mission.legs[0].task
    legs, remaining_m = list[Leg](), path.length_m
    for leg in add_wait_points(build_path_legs(job, path, LegTask(ENTER)), WAIT_POINT_STEP_M):
        is_near_goal = remaining_m <= GOAL_DISTANCE_M
        legs.append(replace(leg, task=replace(goal_task, kind=ENTER)) if is_near_goal else leg)
        remaining_m -= leg.length_m
    return legs


def build_exit_legs(job: FieldJob, gate: EntranceLane, mission: Mission) -> list[Leg]:
    """The legs from the end of a mission to the entrance."""
    path = _find_entrance_path(job, gate, mission.end, outwards=True)
    if path is None:
        raise _build_no_path_error(job, mission.end, "where work ends to the entrance")
    return add_wait_points(build_path_legs(job, path, LegTask(LEAVE)), WAIT_POINT_STEP_M)


def _find_entrance_path(job: FieldJob, gate: EntranceLane, pose: Pose, *, outwards: bool) -> DrivePath | None:
    """The path between the entrance and a pose that goes straight on no farther than it must; None if there is none."""
    for radii in STRAIGHT_ON_RADII:
        extra_m = radii * job.driving_rules.radius_m
        if not job.connector.fits(make_straight_path(gate.inner_pose, extra_m)):
            return None
        lead = gate.build_path_out(extra_m) if outwards else gate.build_path_in(extra_m)
        end_poses = (pose, lead.start) if outwards else (lead.end, pose)
        path = find_raised_path(job, *end_poses, allow_rim=True, keep_to_headland=job.avoids_unworked and not outwards)
        if path is not None:
            return join_paths((path, lead) if outwards else (lead, path), path.kind)
    return None


def _build_no_path_error(job: FieldJob, pose: Pose, description: str) -> StrategyError:
    return NoPathFromError(
        f"No path with a turning radius of {job.driving_rules.radius_m:.1f} m leads from {description} "
        f"(at {pose[0]:.0f}, {pose[1]:.0f} m) inside the field.",
        pose[:2],
    )


def _add_entry_gates(job: FieldJob, plan: Plan, missions: list[Mission]) -> Plan:
    """The missions, each with a gate on the one that enters before it.

    A tractor that others wait for at the start enters first, then the one that has most to drive.
    """
    awaited = [{gate.tractor for gate in mission.legs[0].gates} for mission in plan.missions]
    drive_times_s = [round(math.fsum(leg.length_m / leg.speed_mps for leg in mission.legs), 1) for mission in missions]
    order: list[int] = []
    while len(order) < len(missions):
        remaining = [tractor for tractor in range(len(missions)) if tractor not in order]
        ready = [tractor for tractor in remaining if awaited[tractor] <= set(order)] or remaining
        order.append(min(ready, key=lambda tractor: (-drive_times_s[tractor], tractor)))
    gated_plan = Plan(tuple(missions), plan.notes)
    for first, second in pairwise(order):
        gated_plan = gated_plan.copy_with_gate(second, 0, _build_clear_gate(job, first, missions[first]))
    return gated_plan


def _build_clear_gate(job: FieldJob, tractor: int, mission: Mission) -> LegGate:
    """Gate that opens when a tractor is its own length and `ahead_m` past where it entered."""
    rears, fronts, _ = zip(*job.driving_rules.boxes, strict=True)
    remaining_m = max(fronts) - min(rears) + job.driving_rules.ahead_m
    for leg_number, leg in enumerate(mission.legs):
        if remaining_m <= leg.length_m:
            return LegGate(tractor, leg_number, remaining_m)
        remaining_m -= leg.length_m
    return LegGate(tractor, len(mission.legs) - 1, mission.legs[-1].length_m)
