"""The layout that a saved plan was made on, found again among those that its field could have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from fields.layout.swaths import Layout

MOST_OFF_M, MOST_OTHER_SHARE = 0.1, 1e-3  # of half of the tracks, and of the ground inside the headland: rounding


@dataclass(frozen=True, eq=False)
class PlannedLayout:
    """What a plan tells of its layout, in metres from `origin_m`.

    Attributes:
        inside: the ground inside its headland passes; empty without them.
        middles: (n, 2) of what it works on tracks.
    """

    origin_m: tuple[float, float]
    inside: shapely.Geometry
    middles: npt.NDArray[np.float64]

    def find_index(self, layouts: Sequence[Layout]) -> int | None:
        """Index of the layout with these tracks inside this headland; None where there is none."""
        fitting = (index for index, layout in enumerate(layouts) if self._fits(layout))
        return next(fitting, None)

    def _fits(self, layout: Layout) -> bool:
        shift = np.asarray(self.origin_m) - np.asarray(layout.field.origin_m)
        inside = shapely.transform(self.inside, lambda xy: xy + shift)
        region = layout.inner_region if layout.headland_passes else shapely.Polygon()
        if shapely.symmetric_difference(inside, region).area > MOST_OTHER_SHARE * max(region.area, inside.area):
            return False
        swaths = shapely.MultiLineString([swath.points_m for swath in layout.swaths])
        off_m = shapely.distance(swaths, shapely.points(self.middles + shift))
        return bool(len(off_m)) and float(np.median(off_m)) < MOST_OFF_M
