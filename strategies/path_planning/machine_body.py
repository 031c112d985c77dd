"""The outline of a tractor with its implement, whose guided point leads the rear axle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats, build_directions

POINT_STEP_M = 0.5  # between the points of an outline

MachineBox = tuple[float, float, float]
"""Rear and front end ahead of the rear axle and half the width (m)."""


@dataclass(frozen=True)
class MachineBody:
    """A tractor with its implement: its boxes, and how far ahead of the rear axle the guided point is (m)."""

    boxes: tuple[MachineBox, ...]
    guide_m: float

    @cached_property
    def points(self) -> Floats:
        """Its outline as points (n, 3): ahead of the rear axle, to its left, and from the point before; at most
        POINT_STEP_M apart on a box, infinite for the first (m)."""
        points: list[tuple[float, float]] = []
        for rear, front, half in self.boxes:
            corners = [(rear, -half), (front, -half), (front, half), (rear, half)]
            for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
                pieces = max(1, math.ceil(math.hypot(bx - ax, by - ay) / POINT_STEP_M))
                points += [(ax + (bx - ax) * k / pieces, ay + (by - ay) * k / pieces) for k in range(pieces)]
        outline = np.array(points)
        return np.column_stack([outline, np.hypot(*np.diff(outline, axis=0, prepend=np.inf).T)])

    @cached_property
    def reach_m(self) -> float:
        """The distance of the farthest of its points from the rear axle (m)."""
        return float(np.hypot(*self.points[:, :2].T).max())

    @property
    def guided_reach_m(self) -> float:
        """More than any part is away from the guided point (m)."""
        return self.reach_m + self.guide_m

    def compute_swing_m(self, radius_m: float) -> float:
        """How far the machine reaches out of a circle that the guided point drives (m)."""
        axle_radius_m = math.sqrt(max(radius_m**2 - self.guide_m**2, 0.0))
        return max(math.hypot(axle_radius_m + half, max(abs(a), abs(b))) for a, b, half in self.boxes) - radius_m

    def place_boxes(self, poses: Floats) -> npt.NDArray[np.object_]:
        """The boxes at poses (n, 3) of the rear axle, as polygons."""
        corners = np.array([[(a, -half), (b, -half), (b, half), (a, half)] for a, b, half in self.boxes])
        ahead = build_directions(poses[:, 2])
        sideways = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        turned = corners[None, ..., :1] * ahead[:, None, None] + corners[None, ..., 1:] * sideways[:, None, None]
        return np.asarray(shapely.polygons((turned + poses[:, None, None, :2]).reshape(-1, 4, 2)))
