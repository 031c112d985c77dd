"""Turns that a tractor cannot follow well, recognised in a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from planner.ground.measure import Points, guided
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
    checks: tuple[FenceCheck | ObstacleCheck, ...] = FenceCheck(site), ObstacleCheck(site)
    turns = []
    for tractor, mission in enumerate(run.plan.missions):
        at_leg, poses = run.leg(tractor), run.poses(tractor)
        legs = tracks_begun(mission)
        starts = _reached(at_leg, [turn_start(mission, leg) for leg in legs])
        ends = [begun + 1 for begun in _reached(at_leg, legs)]
        rows = _rows(starts, ends, len(poses))
        beyond_m = _beyond_m(poses, rows, site)
        near = [_near(check, poses, rows) for check in checks]
        begun = guided(poses[np.array(ends, dtype=np.int64) - 1], site)
        for leg, place, start, end in zip(legs, begun, starts, ends, strict=True):
            line = mission.legs[leg].points
            along = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
            off = place - line[0]
            aside = abs(float(along[0] * off[1] - along[1] * off[0]))
            outside = float(np.max(beyond_m[start:end], initial=0.0))
            crossed = max(
                check.depth_m(poses[start:end]) if at[start:end].any() else 0.0
                for check, at in zip(checks, near, strict=True)
            )
            outside = max(outside, OUTSIDE_M + crossed if crossed else 0.0)
            left = outside > OUTSIDE_M
            turns.append(Slip(tractor, leg, max(aside, outside + ASIDE_M) if left else aside, left))
    return turns


def _reached(at_leg: npt.NDArray[np.int64], legs: list[int]) -> list[int]:
    """The first rows of a record on some legs or later ones; 0 for a leg that is never reached."""
    rows = np.searchsorted(at_leg, legs)
    rows[rows == len(at_leg)] = 0
    return rows.tolist()  # type: ignore[no-any-return]


def _rows(starts: list[int], ends: list[int], count: int) -> npt.NDArray[np.bool_]:
    """Which of so many rows are in turns that begin and end like this."""
    rows = np.zeros(count, dtype=np.bool_)
    for start, end in zip(starts, ends, strict=True):
        rows[start:end] = True
    return rows


def _beyond_m(poses: Points, rows: npt.NDArray[np.bool_], site: Site) -> Points:
    """How far (t,) the guided point is outside the field, at some rows of the poses; 0 elsewhere and inside."""
    boundary = site.layout.field.ground
    shapely.prepare(boundary)
    beyond_m, looked = np.zeros(len(poses)), np.flatnonzero(rows)
    path = guided(poses[looked], site)
    out = ~shapely.contains_xy(boundary, path)
    beyond_m[looked[out]] = shapely.distance(shapely.points(path[out]), boundary)
    return beyond_m


def _near(check: FenceCheck | ObstacleCheck, poses: Points, rows: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """At which of some rows (t,) there is something to look at for a check."""
    near = rows.copy()
    near[rows] = check.reached(poses[rows])
    return near


def worst_aside(turns: list[Slip]) -> float:
    """The farthest any track of a run was begun beside its line (m), from all its turns."""
    return max((slip.metres for slip in turns), default=0.0)


def tracks_begun(mission: Mission) -> list[int]:
    """First working leg of every track and of every side of a round that is not joined to the one before."""
    legs = mission.legs
    return [k for k in range(1, len(legs)) if legs[k].implement and not legs[k - 1].implement]


def turn_start(mission: Mission, leg: int) -> int:
    """First of the legs that lead to the track of a working leg."""
    goal = mission.legs[leg].task
    while leg > 0 and not mission.legs[leg - 1].implement and mission.legs[leg - 1].task.same_goal(goal):
        leg -= 1
    return leg
