"""Cells of a layout."""

from __future__ import annotations

import math

import pytest
import shapely

from fields import Cell, Field, Layout, Track, lay_tracks


def rectangle(length: float, width: float) -> Field:
    return Field("r", shapely.box(0, 0, length, width))


@pytest.mark.parametrize("rounds", [0, 3])
def test_one_bearing_is_one_cell(rounds: int) -> None:
    layout = lay_tracks(rectangle(200, 80), 3.0, 9.0, 90.0, rounds=rounds)
    (cell,) = layout.cells
    assert (cell.number, cell.bearing_rad, cell.bearing_deg) == (1, layout.bearing_rad, 90.0)
    assert cell.region is layout.inner and cell.area_m2 == layout.inner.area
    assert {track.cell for track in layout.tracks} == {1}


def test_a_track_runs_as_its_cell_does() -> None:
    field = rectangle(100, 50)
    cells = Cell(1, 0.0, shapely.box(0, 0, 60, 50)), Cell(2, math.pi / 2, shapely.box(60, 0, 100, 50))
    tracks = Track(0, 0, (0.0, 10.0), (60.0, 10.0)), Track(1, 0, (80.0, 0.0), (80.0, 50.0), 2)
    layout = Layout(field, 0.0, 3.0, 9.0, tracks, field.boundary, 3, cells)
    assert [layout.bearing_of(track) for track in tracks] == [0.0, math.pi / 2]
    assert [cell.bearing_deg for cell in layout.cells] == [90.0, 0.0]
