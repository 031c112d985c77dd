"""Where a field is entered and left: the place on its outline, and the pose straight ahead of it inside."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.ops import nearest_points

from strategies.ways.paths import Path, Pose, ahead, straight

EDGE_M = 0.2  # so far inside of the outline ways begin and end, so that nobody stops beyond it


@dataclass(frozen=True)
class Gateway:
    """The way through the entrance: from the outline straight ahead for `lead_m` to where the guided point may turn."""

    at: Pose
    lead_m: float

    @property
    def inside(self) -> Pose:
        """Where a tractor that comes in may turn for the first time."""
        return ahead(self.at, self.lead_m)

    def into(self, more_m: float = 0.0) -> Path:
        """Straight in, and on for so many metres."""
        return straight(self.at, self.lead_m + more_m)

    def out(self, more_m: float = 0.0) -> Path:
        """The same way out."""
        x, y, heading = ahead(self.at, self.lead_m + more_m)
        return straight((x, y, math.remainder(heading + math.pi, 2.0 * math.pi)), self.lead_m + more_m)


def gateway(outline: shapely.Polygon, free: shapely.Geometry, entrance: tuple[float, float]) -> Gateway:
    """The way in at an entrance on the outline, or where the outline is nearest to it.

    It leads to the nearest place of the largest part of `free`, where the guided point may be.
    """
    edge = nearest_points(outline.exterior, shapely.Point(entrance))[0]
    main = max(shapely.get_parts(free).tolist(), key=lambda part: round(part.area, 3))
    goal = nearest_points(main, edge)[0]
    off = np.array([goal.x - edge.x, goal.y - edge.y])
    pose = (float(edge.x), float(edge.y), math.atan2(off[1], off[0]))
    lead_m = float(np.hypot(*off))
    edge_m = min(EDGE_M, 0.5 * lead_m)
    return Gateway(ahead(pose, edge_m), lead_m - edge_m)
