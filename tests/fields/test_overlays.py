"""Overlays of areas that GEOS gets wrong without a grid."""

import numpy as np
import pytest
import shapely
from shapely import affinity

from fields.geometry.arithmetic import GRID_M
from fields.geometry.overlays import (
    clip_all_areas,
    clip_area,
    intersect,
    intersect_on_grid,
    subtract,
    subtract_area,
    subtract_on_grid,
    unite,
    unite_on_grid,
)

# Two strips of 6 m side by side; shapely.intersection says of the second that it lies in the first.
STRIPS = np.array(
    shapely.from_wkt(
        [
            "POLYGON ((-67.88601099120194 72.83511450399486, -0.0094153621992192 90.89741404675044, "
            "1.5335197175684914 85.09919437691883, -66.34307591143423 67.03689483416325, "
            "-67.88601099120194 72.83511450399486))",
            "POLYGON ((-63.89523016705977 67.68827875611203, -1.0710726000747424 84.40609941256369, "
            "0.4718624796929682 78.60787974273208, -62.352295087292056 61.89005908628042, "
            "-63.89523016705977 67.68827875611203))",
        ]
    )
)


def test_neighbours_share_no_ground() -> None:
    first, second = STRIPS
    assert clip_all_areas(STRIPS, STRIPS[::-1])[0].area < 1e-3
    assert clip_area(first, second).area < 1e-3
    assert abs(subtract_area(first, second).area - first.area) < 1e-3


def test_each_is_clipped_by_its_own_part() -> None:
    shifted = np.array([affinity.translate(one, 1.0, 0.0) for one in STRIPS])
    for strip, part, clipped in zip(STRIPS, shifted, clip_all_areas(STRIPS, shifted), strict=True):
        assert abs(clipped.area - clip_area(strip, part).area) < 1e-9
        assert 0.5 * strip.area < clipped.area < strip.area


def test_ground_that_crosses_itself_is_cut_on_a_grid_where_that_fails_without() -> None:
    ground = shapely.Polygon([(66.1, -152.5), (0.0, 0.0), (-237.3, -102.9)])
    sliver = shapely.Polygon([(-221.7, -96.1), (66.1, -152.5), (38.7, -148.8)])
    tip = shapely.Polygon([(38.7, -148.8), (33.2, -148.0), (36.4, -146.2)])
    buffered = shapely.MultiPolygon([sliver, tip])  # as buffers with sharp corners come: the tip lies in the sliver
    with pytest.raises(shapely.errors.GEOSException):
        shapely.difference(ground, buffered)
    outside, inside = subtract(ground, buffered), intersect(ground, buffered)
    assert outside.is_valid
    assert outside.area + inside.area == pytest.approx(ground.area, abs=0.5)  # edges move by half a cell of the grid
    assert unite([ground, buffered]).area == pytest.approx(outside.area + unite([sliver, tip]).area, abs=0.5)
    parts = subtract(np.array([ground, tip]), np.array([buffered, ground]))
    assert [part.area for part in parts] == pytest.approx([outside.area, subtract(tip, ground).area], abs=0.5)


def test_ground_that_crosses_itself_is_repaired_where_a_grid_fails() -> None:
    bow, band = shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)]), shapely.box(-1.0, 2.0, 11.0, 8.0)
    for overlay in (shapely.intersection, shapely.difference):
        with pytest.raises(shapely.errors.GEOSException):
            overlay(bow, band, grid_size=GRID_M)
    # Two triangles of 25 m2 whose tips touch; the band holds all of them but four corners of 2 m2.
    assert intersect_on_grid(bow, band).area == pytest.approx(42.0)
    assert subtract_on_grid(bow, band).area == pytest.approx(8.0)
    assert unite_on_grid([bow, band]).area == pytest.approx(72.0 + 8.0)
