"""Turns that a tractor cannot follow well, recognised in a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from planner.ground.measure import guided_point
from planner.ground.touched import FenceCheck, ObstacleCheck
from planner.site import Site
from vehicle.missions import Mission
from vehicle.run import Run

ASIDE_M = 0.4  # a track begun farther beside its line than this calls for a slower turn
OUTSIDE_M = 0.3  # so does a path this far outside the field
LONGEST_M = 60.0  # a longer leg is a route; slowing all of it would cost more than a track begun aside


@dataclass(frozen=True)
class Slip:
    """A turn badly followed: the tractor, the first working leg after the turn, and by how many metres.

    `outside` tells whether it left the field, came over a fence, or touched an obstacle.
    """

    tractor: int
    leg: int
    metres: float
    outside: bool = False


def slips(run: Run, site: Site) -> list[Slip]:
    """Every turn of a run: how far aside its track was begun, or how far it left the field if that is worse."""
    boundary, checks = site.layout.field.ground, (FenceCheck(site), ObstacleCheck(site))
    shapely.prepare(boundary)
    turns = []
    for tractor, mission in enumerate(run.plan.missions):
        path, at_leg, poses = guided_point(run, site, tractor), run.leg(tractor), run.poses(tractor)
        for leg in _tracks_begun(mission):
            begun = int(np.argmax(at_leg >= leg))
            line = mission.legs[leg].points
            along = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
            off = path[begun] - line[0]
            aside = abs(float(along[0] * off[1] - along[1] * off[0]))
            start = int(np.argmax(at_leg >= turn_start(mission, leg)))
            turn = path[start : begun + 1]
            beyond = shapely.points(turn[~shapely.contains_xy(boundary, turn)])
            outside = float(np.max(shapely.distance(beyond, boundary), initial=0.0))
            crossed = max(check.depth_m(poses[start : begun + 1]) for check in checks)
            outside = max(outside, OUTSIDE_M + crossed if crossed else 0.0)
            left = outside > OUTSIDE_M
            turns.append(Slip(tractor, leg, max(aside, outside + ASIDE_M) if left else aside, left))
    return turns


def worst_aside(turns: list[Slip]) -> float:
    """The farthest any track of a run was begun beside its line (m), from all its turns."""
    return max((slip.metres for slip in turns), default=0.0)


def _tracks_begun(mission: Mission) -> list[int]:
    """First working leg of every track and of every side of a round that is not joined to the one before."""
    legs = mission.legs
    return [k for k in range(1, len(legs)) if legs[k].implement and not legs[k - 1].implement]


def turn_start(mission: Mission, leg: int) -> int:
    """First of the legs that lead to the track of a working leg."""
    goal = mission.legs[leg].task
    while leg > 0 and not mission.legs[leg - 1].implement and mission.legs[leg - 1].task.same_goal(goal):
        leg -= 1
    return leg
