"""How far swaths are drawn out: over ground that nothing else covers, and not into the swaths of another cell."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from strategies.lines.lay_lines import _list_swaths

WIDTH_M = 4.0


@pytest.mark.parametrize(
    ("ends", "drawn_m"),
    [
        ([58.0], [0.0]),  # up to the one across, which covers what is beyond
        ([50.0, 54.0], [8.0, 4.0]),
    ],
)
def test_swaths_end_where_those_of_another_cell_begin(ends: list[float], drawn_m: list[float]) -> None:
    # How far (m) swaths along x from 0, at y = 0, 4 m ..., are drawn out beyond their ends
    lines = [np.array([[0.0, WIDTH_M * row], [end, WIDTH_M * row]]) for row, end in enumerate(ends)]
    lines.append(np.array([[60.0, -40.0], [60.0, 40.0]]))
    swaths = [SimpleNamespace(points_m=points, line=number) for number, points in enumerate(lines)]
    site: Any = SimpleNamespace(layout=SimpleNamespace(swaths=swaths), width_m=WIDTH_M)
    drafts = list(_list_swaths(site, shapely.box(0.0, -40.0, 62.0, 40.0)))
    assert [float(draft.points[-1, 0] - end) for draft, end in zip(drafts, ends, strict=False)] == pytest.approx(
        drawn_m, abs=0.5
    )
