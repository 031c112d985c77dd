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
from strategies.ways.rubbing import rubs, stretches_of

Points = npt.NDArray[np.float64]
Box = tuple[float, float, float]
"""From where to where ahead of the rear axle, and half the width (m)."""

STEP_M = 0.5
SLACK_M = 1e-6


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
        self._away: dict[tuple[float, float, bool], float] = {}
        self._stretches = {True: stretches_of(fences), False: stretches_of(self._lines)}
        shapely.prepare([self._fences, self._lines])

    def crosses(self, way: Path, *, fences_only: bool = False) -> bool:
        """Whether some part of the machine comes to a fence, or an obstacle as well, on a way."""
        if (way, fences_only) not in self._known:
            self._known[way, fences_only] = self._crosses(way, fences_only)
        return self._known[way, fences_only]

    def _crosses(self, way: Path, fences_only: bool) -> bool:
        near_m = self.body.reach_m + self.spare_m
        # No point of a way is nearer than half of what its ends are away together and it is not long.
        if self._away_m(way.start, fences_only) + self._away_m(way.end, fences_only) - way.length_m > 2.0 * near_m:
            return False
        ends, boxes = np.array([way.start, way.end]), np.array(self.body.boxes, dtype=np.float64)
        stretches, sizes = self._stretches[fences_only], (self.body.guide_m, self.body.reach_m, self.spare_m)
        return bool(rubs(ends, way.rows(), boxes, stretches, *sizes, STEP_M))

    def may_cross(self, starts: Points, ends: Points, length_m: Points) -> npt.NDArray[np.bool_]:
        """Which ways of so many metres (k,) from `starts` to `ends` (k, 2+) come near enough to be looked at."""
        places, which = np.unique(np.concatenate([starts[:, :2], ends[:, :2]]), axis=0, return_inverse=True)
        away = shapely.distance(self._lines, shapely.points(places))[which]
        near_m = self.body.reach_m + self.spare_m + SLACK_M
        near: npt.NDArray[np.bool_] = away[: len(starts)] + away[len(starts) :] - length_m <= 2.0 * near_m
        return near

    def _away_m(self, pose: Pose, fences_only: bool) -> float:
        """How far the lines are from a pose; infinite where there are none."""
        key = pose[0], pose[1], fences_only
        if key not in self._away:
            lines = self._fences if fences_only else self._lines
            away = math.inf if lines.is_empty else float(shapely.distance(lines, shapely.Point(pose[:2])))
            self._away[key] = away
        return self._away[key]

    def hits(self, pose: Pose) -> bool:
        """Whether some part of a machine that stands straight, its guided point in a pose, is at one of them."""
        x, y, heading = pose
        back = self.body.guide_m
        return self._hit(np.array([[x - back * math.cos(heading), y - back * math.sin(heading), heading]]), self._lines)

    def _hit(self, poses: Points, lines: shapely.Geometry) -> bool:
        reach_m = self.body.reach_m - self.body.guide_m + self.spare_m
        near = shapely.dwithin(lines, shapely.points(poses[:, :2]), reach_m + SLACK_M)
        return bool(shapely.dwithin(lines, self.body.placed(poses[near]), self.spare_m).any())


def inside(fence: Fence | None, ways: list[Path | None], cost: Callable[[Path], float]) -> Path | None:
    """The quickest of some ways that keep inside a fence; None where none does."""
    kept = [way for way in ways if way is not None and not (fence and fence.crosses(way))]
    return min(kept, key=lambda way: round(cost(way), 6), default=None)
