"""The outline of a tractor with its implement, whose guided point leads the rear axle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

Points = npt.NDArray[np.float64]
MachineBox = tuple[float, float, float]
"""Rear and front end ahead of the rear axle and half the width (m)."""


@dataclass(frozen=True)
class MachineBody:
    """A tractor with its implement: its boxes, and how far ahead of the rear axle the guided point is (m)."""

    boxes: tuple[MachineBox, ...]
    guide_m: float

    @property
    def reach_m(self) -> float:
        """The farthest distance of any part from the guided point (m)."""
        return max(math.hypot(max(abs(a), abs(b)), half) for a, b, half in self.boxes) + self.guide_m

    def compute_swing_m(self, radius_m: float) -> float:
        """How far the machine reaches out of a circle that the guided point drives (m)."""
        axle_radius_m = math.sqrt(max(radius_m**2 - self.guide_m**2, 0.0))
        return max(math.hypot(axle_radius_m + half, max(abs(a), abs(b))) for a, b, half in self.boxes) - radius_m

    def place_boxes(self, poses: Points) -> npt.NDArray[np.object_]:
        """The boxes at poses (n, 3) of the rear axle, as polygons."""
        corners = np.array([[(a, -half), (b, -half), (b, half), (a, half)] for a, b, half in self.boxes])
        ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        sideways = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        turned = corners[None, ..., :1] * ahead[:, None, None] + corners[None, ..., 1:] * sideways[:, None, None]
        return np.asarray(shapely.polygons((turned + poses[:, None, None, :2]).reshape(-1, 4, 2)))
