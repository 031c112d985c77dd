"""Swaths along contours: closed forms on a plane and on a cone, spacing and radius on any ground."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as some

from fields.geometry.field import Field
from fields.layout.contours import STEP_M, GuideCurve, lay_contour_swaths, smooth_contour
from fields.layout.swaths import Layout, lay_swaths, measure_min_spacing_m
from fields.terrain.elevation_grid import ElevationGrid

WIDTH_M, RADIUS_M = 6.0, 6.0
LENGTH_M, DEPTH_M = 160.0, 100.0
Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]


def build_grid(heights: Heights) -> ElevationGrid:
    places = np.arange(-40.0, LENGTH_M + 41.0, 4.0)
    return ElevationGrid(-40.0, -40.0, 4.0, heights(*np.meshgrid(places, places)))


def lay(heights: Heights, field: Field | None = None) -> Layout:
    field = field or Field("slope", shapely.box(0.0, 0.0, LENGTH_M, DEPTH_M))
    return lay_contour_swaths(field, build_grid(heights), WIDTH_M, 2, RADIUS_M)


def measure_radius(points: np.ndarray) -> float:
    """The least radius (m) of the circles through points 10 m before, at and 10 m behind each place."""
    a, b, c = points[:-20], points[10:-10], points[20:]
    first, second = b - a, c - b
    turn = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    sides = np.hypot(*first.T) * np.hypot(*second.T) * np.hypot(*(c - a).T)
    return float((sides / np.maximum(2.0 * turn, 1e-12)).min()) if len(points) > 20 else math.inf


@pytest.mark.parametrize("fall_deg", [0.0, 37.0, 90.0, 141.0])
def test_plane_has_straight_swaths_across_its_fall(fall_deg: float) -> None:
    fall = math.radians(fall_deg)
    layout = lay(lambda x, y: -0.1 * (x * math.sin(fall) + y * math.cos(fall)))
    assert abs(math.remainder(layout.bearing_deg - fall_deg - 90.0, 180.0)) < 0.01
    assert not any(swath.via_m for swath in layout.swaths)
    straight = lay_swaths(layout.field, WIDTH_M, 2.0 * WIDTH_M, fall_deg + 90.0, headland_passes=2)
    assert len(layout.swaths) == len(straight.swaths)
    assert layout.total_length_m == pytest.approx(straight.total_length_m, abs=0.1)


def test_cone_has_rings_about_its_top() -> None:
    top = np.array([80.0, -120.0])
    layout = lay(lambda x, y: -0.08 * np.hypot(x - top[0], y - top[1]))
    radii = {}
    for swath in layout.swaths:
        distance = np.hypot(*(swath.points_m - top).T)
        assert np.ptp(distance) < 0.05
        radii[swath.line] = float(distance.mean())
    gaps = np.abs(np.diff([radii[line] for line in sorted(radii)]))
    assert gaps.max() <= WIDTH_M + 0.05 and np.ptp(gaps) < 0.01


def test_swaths_cover_the_ground_inside_the_headland() -> None:
    layout = lay(lambda x, y: 0.08 * y + 0.6 * np.sin(x / 30.0))
    strips = [shapely.LineString(swath.points_m).buffer(0.51 * WIDTH_M, cap_style="flat") for swath in layout.swaths]
    missed = shapely.difference(layout.inner_region, shapely.union_all(strips))
    assert missed.area < 0.001 * layout.inner_region.area


@settings(max_examples=4)
@given(
    some.floats(0.02, 0.12), some.floats(0.0, 1.5), some.floats(15.0, 60.0), some.floats(0.0, 6.0),
    some.booleans(),
)  # fmt: skip
def test_neighbours_keep_their_distance_and_bend_no_tighter_than_tractors(
    slope: float, wave_m: float, length_m: float, phase: float, turned: bool
) -> None:
    def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        along, up = (y, x) if turned else (x, y)
        return slope * up + wave_m * np.sin(along / length_m + phase)

    layout = lay(heights)
    for swath in layout.swaths:
        assert measure_radius(swath.points_m) > 0.98 * RADIUS_M
    lines: dict[int, list[shapely.LineString]] = {swath.line: [] for swath in layout.swaths}
    for swath in layout.swaths:
        lines[swath.line].append(shapely.LineString(swath.points_m))
    for before, line in pairwise(sorted(lines)):
        gap_m = shapely.distance(shapely.union_all(lines[before]), shapely.union_all(lines[line]))
        if len(lines[before]) == len(lines[line]) == 1:
            assert gap_m <= WIDTH_M + 0.05
        assert gap_m >= min(WIDTH_M, DEPTH_M / 40.0)


@given(some.floats(-0.02, 0.02), some.floats(-3.0, 3.0), some.floats(40.0, 200.0))
@example(3.0 / 256.0, 0.0, 199.0 - 1e-9)  # nearly a step more than a whole number of them
@settings(max_examples=10)
def test_smoothing_keeps_arcs(curvature: float, heading: float, length_m: float) -> None:
    """Whatever the length of the arc: its guide has the curvature of the arc, lies on it and ends a step before it."""
    step_m = length_m / 800.0
    headings = heading + step_m * curvature * np.arange(800.0)
    arc = step_m * np.cumsum(np.column_stack([np.cos(headings), np.sin(headings)]), axis=0)
    arc = np.concatenate([[[0.0, 0.0]], arc])
    guide = smooth_contour(arc, 10.0)
    assert guide is not None
    assert length_m - STEP_M - 1e-6 < guide.length_m < length_m + 1e-6
    assert np.allclose(guide.curvatures, curvature, atol=2e-5)
    assert float(shapely.distance(shapely.LineString(arc), shapely.points(guide.points)).max()) < 0.02


def test_places_along_and_beside_a_guide_lead_back() -> None:
    headings = 0.4 * np.sin(np.arange(120.0) / 20.0)
    steps = STEP_M * np.column_stack([np.cos(headings), np.sin(headings)])
    guide = GuideCurve(np.cumsum(steps, axis=0), headings)
    measured = np.array([[along, beside] for along in (-20.0, 3.3, 60.7, 140.0) for beside in (-30.0, 0.0, 25.0)])
    assert np.allclose(guide.locate(guide.place(measured)), measured, atol=0.05)


@pytest.mark.parametrize("heights", [lambda x, y: 0.0 * x, lambda x, y: -0.001 * ((x - 80.0) ** 2 + (y - 50.0) ** 2)])
def test_ground_without_a_contour_through_it_has_no_swath(heights: Heights) -> None:
    small = Field("dome", shapely.Point(80.0, 50.0).buffer(60.0))
    assert lay(heights, small).swaths == ()


def test_spacing_of_curved_swaths_is_that_of_their_lines() -> None:
    def fall_from_top(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return -0.08 * np.hypot(x - 80.0, y + 120.0)

    field = Field("slope", shapely.box(0.0, 0.0, LENGTH_M, DEPTH_M))
    layout = lay_contour_swaths(field, build_grid(fall_from_top), WIDTH_M, 2, RADIUS_M, 5.0)
    assert all(swath.via_m for swath in layout.swaths)
    radii = {swath.line: float(np.hypot(*(swath.points_m - (80.0, -120.0)).T).mean()) for swath in layout.swaths}
    steps = np.abs(np.diff([radii[line] for line in sorted(radii)]))
    assert measure_min_spacing_m(layout) == pytest.approx(steps.min(), abs=0.02)
    assert 5.0 <= measure_min_spacing_m(layout) < WIDTH_M
