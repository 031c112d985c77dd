"""Whether a tractor with its implement keeps off fences and obstacles on the way from one pose to another.

The guided point leads the rear axle, which trails it: driven forwards, the nose swings out of a bend and the implement
too. Which ways there are is found for the guided point alone; here is what the rest of the machine does on them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from strategies.ways.paths import Path, Pose

Points = npt.NDArray[np.float64]
Box = tuple[float, float, float]
"""From where to where ahead of the rear axle, and half the width (m)."""

STEP_M = 0.5


@dataclass(frozen=True)
class Body:
    """A tractor with its implement: its boxes, and how far ahead of the rear axle the guided point is (m)."""

    boxes: tuple[Box, ...]
    guide_m: float

    @property
    def reach_m(self) -> float:
        """How far anything of it is from the guided point at most."""
        return max(math.hypot(max(abs(a), abs(b)), half) for a, b, half in self.boxes) + self.guide_m

    def swing_m(self, radius_m: float) -> float:
        """How far it reaches out of a circle that the guided point drives (m)."""
        axle = math.sqrt(max(radius_m**2 - self.guide_m**2, 0.0))
        return max(math.hypot(axle + half, max(abs(a), abs(b))) for a, b, half in self.boxes) - radius_m

    def placed(self, poses: Points) -> npt.NDArray[np.object_]:
        """Its boxes at poses (n, 3) of the rear axle, as polygons."""
        corners = np.array([[(a, -half), (b, -half), (b, half), (a, half)] for a, b, half in self.boxes])
        ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        turned = corners[None, ..., :1] * ahead[:, None, None] + corners[None, ..., 1:] * left[:, None, None]
        return np.asarray(shapely.polygons((turned + poses[:, None, None, :2]).reshape(-1, 4, 2)))


class Fence:
    """Fences, and outlines of obstacles, that nothing of a body should come nearer to than `spare_m` as planned.

    Guidance is never exact. A plan may touch an obstacle where there is no other way, but never crosses a fence.
    """

    def __init__(self, fences: shapely.Geometry, obstacles: shapely.Geometry, body: Body, spare_m: float) -> None:
        self.body, self.spare_m = body, spare_m
        self._fences, self._lines = fences, shapely.union(fences, obstacles)
        self._known: dict[tuple[Path, bool], bool] = {}  # strategies ask for the same ways
        shapely.prepare([self._fences, self._lines])

    def crosses(self, way: Path, *, fences_only: bool = False) -> bool:
        """Whether some part of the machine comes to a fence, or an obstacle as well, on a way."""
        if (way, fences_only) not in self._known:
            self._known[way, fences_only] = self._crosses(way, self._fences if fences_only else self._lines)
        return self._known[way, fences_only]

    def _crosses(self, way: Path, lines: shapely.Geometry) -> bool:
        points = way.outline(0.1)
        line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        if not shapely.dwithin(lines, line, self.body.reach_m + self.spare_m):
            return False
        return self._hit(_axle(way, self.body.guide_m), lines)

    def hits(self, pose: Pose) -> bool:
        """Whether some part of a machine that stands straight, its guided point in a pose, is at one of them."""
        x, y, heading = pose
        back = self.body.guide_m
        return self._hit(np.array([[x - back * math.cos(heading), y - back * math.sin(heading), heading]]), self._lines)

    def _hit(self, poses: Points, lines: shapely.Geometry) -> bool:
        return bool(shapely.dwithin(lines, self.body.placed(poses), self.spare_m).any())


def _axle(way: Path, guide_m: float) -> Points:
    """Poses (n, 3) of the rear axle on a way: forwards it trails the guided point, in reverse it keeps to the way."""
    x, y, heading = way.start
    axle = np.array([x - guide_m * math.cos(heading), y - guide_m * math.sin(heading)])
    poses = [(*axle, heading)]
    for gear, points in way.sample(STEP_M):
        if gear < 0:
            step = points[:-1] - points[1:]
            angles = np.arctan2(step[:, 1], step[:, 0])
            back = guide_m * np.column_stack([np.cos(angles), np.sin(angles)])
            poses += [(*spot, angle) for spot, angle in zip(points[1:] - back, angles, strict=True)]
            axle = points[-1] - back[-1]
            continue
        for point in points[1:]:
            off = point - axle
            axle = point - guide_m * off / math.hypot(*off)
            poses.append((*axle, math.atan2(off[1], off[0])))
    return np.array(poses)


def inside(fence: Fence | None, ways: list[Path | None], cost: Callable[[Path], float]) -> Path | None:
    """The quickest of some ways that keep inside a fence; None where none does."""
    kept = [way for way in ways if way is not None and not (fence and fence.crosses(way))]
    return min(kept, key=lambda way: round(cost(way), 6), default=None)
