"""Places that surely lie inside an area, looked up in a table of cells: most of what is driven is far from edges.

What the table does not know is left to exact predicates, so that no answer depends on the cells.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely

from vehicle.jit import compiled

CELLS = 20_000
LEAST_CELL_M = 1.0
ROUNDED = 1.05  # buffers have chords for arcs, and are so much too small at the most
Points = npt.NDArray[np.float64]


@compiled
def _looked_up(places, west, south, cell, inner):  # type: ignore[no-untyped-def]
    """Whether places (t, 2 or more columns) are not in a cell of the table `inner` (rows from south, columns)."""
    out = np.ones(len(places), dtype=np.bool_)
    rows, columns = inner.shape
    for k in range(len(places)):
        east, north = (places[k, 0] - west) / cell, (places[k, 1] - south) / cell
        if 0.0 <= east < columns and 0.0 <= north < rows:
            out[k] = not inner[int(north), int(east)]
    return out


class Inside:
    """A table of the cells of an area that lie more than `off_m` inside its edge."""

    def __init__(self, area: shapely.Geometry, off_m: float) -> None:
        west, south, east, north = area.bounds if not area.is_empty else (0.0, 0.0, 0.0, 0.0)
        self._origin = west, south
        self._cell = max(LEAST_CELL_M, math.sqrt((east - west) * (north - south) / CELLS))
        columns, rows = (1 + int(span / self._cell) for span in (east - west, north - south))
        core = area.buffer(-ROUNDED * (off_m + self._cell))  # from a middle to a corner is less than a cell
        shapely.prepare(core)
        x, y = west + self._cell * (np.arange(columns) + 0.5), south + self._cell * (np.arange(rows) + 0.5)
        self._inner = np.asarray(shapely.contains_xy(core, *np.meshgrid(x, y)), dtype=np.bool_)

    def unsure(self, places: Points) -> npt.NDArray[np.int64]:
        """Numbers of the places (t, 2 or more), x and y in the first columns, that may be outside or near the edge."""
        return np.flatnonzero(_looked_up(places, *self._origin, self._cell, self._inner))
