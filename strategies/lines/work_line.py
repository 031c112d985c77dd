"""A work line: where a machine works, either way, and where it may begin and end there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from fields.arrays import Floats, cut_line, locate_at, measure_along
from fields.geometry.arithmetic import GRID_M
from strategies.path_planning.paths import Pose
from vehicle.missions.plan import HEADLAND_PASS, LegTask

HOLE_PASS = "hole"  # group of the sides of a headland pass round a hole

SHARPEST_RAD = 2.0  # corners of the headland beyond this are turned with the implement up
STRAIGHT_RAD = 0.2  # lines that differ by less have no corner between them, and a tractor is still on its line
MOST_OFF_SHARE = 0.25  # of the width: a tractor farther beside a line has lost it


def extend_line(points: Floats, before_m: float, after_m: float) -> Floats:
    """A polyline (n, 2) drawn out straight at its ends, without points that coincide."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    points = points[np.concatenate([[True], steps > GRID_M])]
    first, last = points[0] - points[1], points[-1] - points[-2]
    begin = points[0] + before_m / np.hypot(*first) * first
    end = points[-1] + after_m / np.hypot(*last) * last
    return np.vstack([begin, points[1:-1], end])


def build_tool_path(path: Floats, tool_m: float) -> Floats:
    """The path (n, 2) of an implement `tool_m` behind the guided point on its path (n, 2)."""
    return cut_line(extend_line(path, tool_m, 0.0), 0.0, float(measure_along(path)[-1]))


def build_tool_strip(path: Floats, tool_m: float, width_m: float) -> shapely.Geometry:
    """The ground that an implement passes over whose guided point is `tool_m` ahead of it on a path (n, 2)."""
    bar = shapely.LineString(build_tool_path(path, tool_m))
    return shapely.buffer(bar, 0.5 * width_m, cap_style="flat", join_style="mitre")


@dataclass(frozen=True, eq=False)
class WorkLine:
    """A piece of a swath or a headland side.

    Attributes:
        task: what its legs are for.
        group: lines of one swath, or of one headland pass, have the same: the implement may stay down between them.
        paths: for either direction the path (n, 2) of the guided point from where the implement is lowered to where it
            is lifted.
        tool_m: how far the implement works behind the guided point.
        own_m2: the ground that no other line covers.
        both_ways: whether it may be driven in either direction, or in the first alone.
    """

    task: LegTask
    group: tuple[str, int]
    paths: tuple[Floats, Floats]
    tool_m: float
    own_m2: float = 0.0
    both_ways: bool = True

    @cached_property
    def alongs(self) -> tuple[Floats, Floats]:
        """For either direction the distances of the points of its path, along it (m)."""
        return measure_along(self.paths[0]), measure_along(self.paths[1])

    @property
    def is_place(self) -> bool:
        """Whether it is only where a tractor stands, and no work."""
        return not self.task.is_work

    @property
    def is_side(self) -> bool:
        """Whether it is a side of a headland pass, round the field or round a hole."""
        return self.group[0] in (HEADLAND_PASS, HOLE_PASS)

    @property
    def length_m(self) -> float:
        """Length in metres, as driven."""
        return max(self.measure_path_m(0), self.measure_path_m(1))

    def get_begin(self, direction: int) -> Pose:
        """Pose of the guided point where the implement is lowered."""
        return self.get_pose(direction, 0.0)

    def get_end(self, direction: int) -> Pose:
        """Pose of the guided point where it is lifted."""
        return self.get_pose(direction, math.inf)

    def get_pose(self, direction: int, distance_m: float) -> Pose:
        """Pose of the guided point at a distance along the path."""
        path, along = self.paths[direction], self.alongs[direction]
        k = min(max(int(np.searchsorted(along, distance_m, side="right")) - 1, 0), len(path) - 2)
        x, y = locate_at(path, along, [min(distance_m, float(along[-1]))])[0].tolist()
        ahead = path[k + 1] - path[k]
        return x, y, math.atan2(ahead[1], ahead[0])

    def measure_path_m(self, direction: int) -> float:
        """Length of the path in a direction (m)."""
        return float(self.alongs[direction][-1])

    @property
    def tool_path(self) -> Floats:
        """The path (n, 2) of the implement in the first direction."""
        return build_tool_path(self.paths[0], self.tool_m)

    def build_strip(self, width_m: float) -> shapely.Geometry:
        """The ground that the implement passes over in the first direction."""
        return build_tool_strip(self.paths[0], self.tool_m, width_m)
