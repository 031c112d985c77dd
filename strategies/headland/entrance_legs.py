"""Legs from where a tractor's work ends to the entrance of a field."""

from __future__ import annotations

from strategies.headland.raised_paths import find_raised_path
from strategies.path_planning.errors import StrategyError
from strategies.path_planning.paths import DrivePath, EntranceLane, Pose, join_paths, make_straight_path
from strategies.program.field_job import FieldJob
from strategies.program.legs import add_wait_points, build_path_legs
from vehicle.missions.plan import LEAVE, Leg, LegTask, Mission

STRAIGHT_ON_RADII = (0.0, 1.5, 3.0, 6.0)  # radii straight on to the entrance after the last turn
WAIT_POINT_STEP_M = 10.0  # between places to wait


def build_exit_legs(job: FieldJob, gate: EntranceLane, mission: Mission) -> list[Leg]:
    """The legs from the end of a mission to the entrance; raises StrategyError if no path leads there."""
    path = _find_path_out(job, gate, mission.end)
    if path is None:
        x, y, _ = mission.end
        raise StrategyError(
            f"No path with a turning radius of {job.driving_rules.radius_m:.1f} m leads from where work ends to the "
            f"entrance (at {x:.0f}, {y:.0f} m) inside the field."
        )
    return add_wait_points(build_path_legs(job, path, LegTask(LEAVE)), WAIT_POINT_STEP_M)


def _find_path_out(job: FieldJob, gate: EntranceLane, pose: Pose) -> DrivePath | None:
    """The path from a pose to the entrance that goes straight on no farther than it must; None if there is none."""
    for radii in STRAIGHT_ON_RADII:
        extra_m = radii * job.driving_rules.radius_m
        if not job.connector.fits(make_straight_path(gate.inner_pose, extra_m)):
            return None
        lead = gate.build_path_out(extra_m)
        path = find_raised_path(job, pose, lead.start, allow_rim=True)
        if path is not None:
            return join_paths((path, lead), path.kind)
    return None
