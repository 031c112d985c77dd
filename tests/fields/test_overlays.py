"""Overlays of areas that GEOS gets wrong without a grid."""

import numpy as np
import shapely
from shapely import affinity

from fields.geometry.overlays import clip_all_areas, clip_area, subtract_area

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
