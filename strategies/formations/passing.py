"""The poses of a tractor on its way between columns, and where on a column nobody stands in its way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from strategies.path_planning.paths import DrivePath, Pose
from strategies.programmes.waiting_places import StandsInWay
from strategies.site.site import Site

Floats = npt.NDArray[np.float64]

POSE_STEP_M = 0.5
SETTLED_M = 4.0  # beyond the end of a move, on which a tractor is off its line
CLEAR_STEP_M, MOST_STEPS = 1.0, 100  # between the places that are tried, and how many


def trace_body(site: Site, path: DrivePath) -> Floats:
    """Poses (n, 3) of the centre of mass along a path of the guided point, and beyond its end until it has settled.

    Forwards the axle trails the guided point, in reverse the body lies along the path.
    """
    settled = replace(path, segments=(*path.segments, replace(path.segments[-1], length_m=SETTLED_M, curvature=0.0)))
    guide_m, poses = site.body.guide_m, list[tuple[float, float, float]]()
    angle = path.start[2]
    x, y = path.start[0] - guide_m * math.cos(angle), path.start[1] - guide_m * math.sin(angle)
    for gear, points in settled.sample(POSE_STEP_M):
        headings = np.arctan2(*np.diff(points, axis=0).T[::-1]).tolist()
        for (px, py), heading in zip(points.tolist(), [*headings, headings[-1]], strict=True):
            angle = math.atan2(py - y, px - x) if gear > 0 else heading + math.pi
            x, y = px - guide_m * math.cos(angle), py - guide_m * math.sin(angle)
            poses.append((x + site.axle_m * math.cos(angle), y + site.axle_m * math.sin(angle), angle))
    return np.array(poses)


def find_clear_place(
    site: Site, stands_in_way: StandsInWay, begin: Pose, passing: Sequence[Floats], place_m: float, forwards: bool
) -> float:
    """The first place on a column from its begin, a distance on, or up to there, that is in nobody's way (m).

    With a step to spare, as nobody stops and drives quite as planned; infinite where there is none.
    """
    if not math.isfinite(place_m):
        return place_m
    x, y, heading = begin
    back_m = site.body.guide_m - site.axle_m
    step_m = CLEAR_STEP_M if forwards else -CLEAR_STEP_M

    def is_clear(along_m: float) -> bool:
        ahead_m = along_m - back_m
        pose = np.array([x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading), heading])
        return not any(stands_in_way(pose, poses) for poses in passing)

    was_clear = is_clear(place_m - step_m)
    for number in range(MOST_STEPS):
        along_m = place_m + number * step_m
        clear = is_clear(along_m)
        if clear and was_clear:
            return along_m
        was_clear = clear
    return math.inf if forwards else -math.inf
