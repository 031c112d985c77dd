"""Cells of a layout."""

import pytest
import shapely

from fields import Field, lay_swaths


def rectangle(length: float, width: float) -> Field:
    return Field("r", shapely.box(0, 0, length, width))


@pytest.mark.parametrize("rounds", [0, 3])
def test_one_bearing_is_one_cell(rounds: int) -> None:
    layout = lay_swaths(rectangle(200, 80), 3.0, 9.0, 90.0, headland_passes=rounds)
    (cell,) = layout.cells
    assert (cell.number, cell.bearing_rad, cell.bearing_deg) == (1, layout.bearing_rad, 90.0)
    assert cell.region is layout.inner_region and cell.area_m2 == layout.inner_region.area
    assert {track.cell_number for track in layout.swaths} == {1}


@pytest.mark.parametrize(("apart_m", "spacing"), [(0.0, 2.0), (2.85, 2.85), (9.0, 3.0)])
def test_lines_inside_rounds_are_as_far_apart_as_asked_and_cover_all(apart_m: float, spacing: float) -> None:
    """7 m inside three rounds take three lines of 3 m; what they overlap may lie between them or outside."""
    layout = lay_swaths(rectangle(200, 25), 3.0, 9.0, 90.0, headland_passes=3, min_spacing_m=apart_m)
    across = [track.start_m[1] for track in layout.swaths]
    assert sorted(across) == pytest.approx([12.5 - spacing, 12.5, 12.5 + spacing])
    lines = [shapely.LineString([track.start_m, track.end_m]) for track in layout.swaths]
    swaths = shapely.union_all(shapely.buffer(lines, 1.5, cap_style="flat"))
    assert layout.inner_region.difference(swaths).area == pytest.approx(0.0, abs=1e-6)
