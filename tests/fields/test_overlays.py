"""Overlays of areas that GEOS gets wrong without a grid."""

import numpy as np
import pytest
import shapely
from shapely import affinity

from fields.geometry.overlays import clip_all_areas, clip_area, intersect, subtract, subtract_area, unite

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
