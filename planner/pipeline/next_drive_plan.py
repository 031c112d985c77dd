"""The drive that would tell causes apart, as a saved plan: what a robot drives, and `headland show` lists.

Its metres are those of the logs; it begins where they begin, in their usual direction and at their usual speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fields.arrays import Floats
from planner.pipeline.outputs.saved_plans import MACHINES_KEY
from strategies.rules.legs import PATH_STEP_M
from vehicle.identification.diagnosis.corrections import correct_logs
from vehicle.identification.diagnosis.next_drive import (
    DRIVE_PROGRAMMES,
    ProgrammePieces,
    find_usual_heading_and_speed,
    simulate_programme,
)
from vehicle.identification.diagnosis.results import NextDrive
from vehicle.identification.logs.schema import Log
from vehicle.identification.replay.drive_segments import build_dataset, build_rig_and_corrections
from vehicle.missions.plan import DRIVE, TURN, Leg, LegTask, Mission, Plan, PlanNotes
from vehicle.missions.plan_file import format_plan
from vehicle.model.tractor import Implement, Tractor

COURSE_M = 1.0  # of a path, from which its direction at an end is taken
TURN_SHARE = 0.7  # of full lock, which turns between passes use: gentle enough for any ground
FIELD_NAME = "drive to do next"


def build_next_drive_plan(drive: NextDrive, logs: Sequence[Log], tractor: Tractor, ground: str) -> str:
    """Return the saved plan of a drive for a tractor as its logs have made it known."""
    programme = next(each for each in DRIVE_PROGRAMMES if each.id == drive.id)
    dataset = build_dataset(correct_logs(logs, tractor), (tractor.antenna_forward_m, tractor.antenna_right_m))
    heading, pace = find_usual_heading_and_speed(dataset.segments)
    rig, settings = build_rig_and_corrections(tractor, ground, (0.0, 0.0))
    passes = simulate_programme(rig, programme, heading, pace, settings).segments
    legs: list[Leg] = []
    for (_, pieces), segment in zip(programme.passes, passes, strict=True):
        path = np.column_stack([segment.east, segment.north])
        path += (legs[-1].points[-1] if legs else np.zeros(2)) - path[0]
        if legs:
            legs.append(_turn_to(legs[-1], path, tractor, pace))
        legs += _cut_pass(path, segment.time, pieces, pace)
    first = dataset.segments[0]
    origin = (dataset.origin[0] + float(first.east[0]), dataset.origin[1] + float(first.north[0]))
    machines = {"tractor": tractor.model_dump(mode="json"), "implement": Implement().model_dump()}
    return (
        format_plan(
            Plan((Mission(tuple(legs)),), PlanNotes(others={"drive": drive.id, "words": drive.description})),
            origin_m=origin,
            scenario={"field": FIELD_NAME, "tractor": tractor.name, MACHINES_KEY: machines},
        )
        + "\n"
    )


def _cut_pass(path: Floats, time: Floats, pieces: ProgrammePieces, pace: float) -> list[Leg]:
    """Return a leg per piece of constant command; each begins where the one before ends."""
    ends_s = np.cumsum([seconds for seconds, *_ in pieces])
    rows = [0, *np.minimum(np.searchsorted(time, ends_s), len(time) - 1)]
    legs = []
    for (_, _, share, working), begin, end in zip(pieces, rows, rows[1:], strict=False):
        points = _thin_points(path[begin : end + 1])
        legs.append(Leg(points, share * pace, implement=working > 0.0, task=LegTask(DRIVE)))
    return legs


def _thin_points(path: Floats) -> Floats:
    """Return points about PATH_STEP_M apart, with both ends."""
    steps = np.hypot(*np.diff(path, axis=0).T)
    number = np.floor(np.concatenate([[0.0], np.cumsum(steps)]) / PATH_STEP_M)
    kept = np.concatenate([[True], np.diff(number) > 0.0])
    kept[-1] = True
    thinned: Floats = path[kept]
    if len(thinned) > 2 and np.hypot(*(thinned[-1] - thinned[-2])) < 0.5 * PATH_STEP_M:
        thinned = np.delete(thinned, -2, axis=0)
    return thinned


def _turn_to(before: Leg, path: Floats, tractor: Tractor, pace: float) -> Leg:
    """Return the turn from the end of a leg to the beginning of a path."""
    # Searching for turns is loaded where a drive has more than one pass.
    from strategies.moves.closed_forms import find_forward_path
    from strategies.rules.driving_rules import list_turn_costs

    begin, end = before.points[-1], path[0]
    radius_m = tractor.wheelbase_m / math.tan(math.radians(TURN_SHARE * tractor.max_steering_deg))
    start = (float(begin[0]), float(begin[1]), _find_course(before.points[::-1]) + math.pi)
    goal = (float(end[0]), float(end[1]), _find_course(path))
    ((_, points),) = find_forward_path(start, goal, radius_m, list_turn_costs(pace, pace)).sample(PATH_STEP_M)
    return Leg(points, pace, task=LegTask(TURN))


def _find_course(path: Floats) -> float:
    """Return the direction (rad) in which a path begins."""
    gaps = np.hypot(*(path - path[0]).T)
    row = int(np.argmax(gaps >= min(COURSE_M, float(gaps.max()))))
    east, north = path[row] - path[0]
    return math.atan2(north, east)
