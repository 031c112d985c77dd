"""Slopes, aspect, shading and contours of surfaces in closed form, and heights continued over gaps."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields.errors import HeadlandError
from fields.terrain.elevation_grid import ElevationGrid, fill_gaps, lay_nodes
from fields.terrain.slopes import (
    choose_contour_interval_m,
    compute_directional_slopes,
    compute_gradients,
    compute_hill_shade,
    summarise_slopes,
    trace_contours,
)
from tests.examples import count_examples
from tests.fields.terrain.heights import FIELD, Surface, bowl, build_plane


def build_grid(surface: Surface, spacing_m: float = 5.0) -> ElevationGrid:
    frame = lay_nodes(FIELD.boundary, spacing_m, 15.0)
    heights = surface(*frame.list_places().T).reshape(frame.rows, frame.columns)
    return ElevationGrid(frame.west_m, frame.south_m, frame.spacing_m, heights)


@pytest.mark.parametrize(
    ("east", "north", "falls_to_deg"),
    [
        (0.0, 0.1, 180.0),
        (0.1, 0.0, 270.0),
        (0.0, -0.1, 0.0),
        (-0.06, 0.08, 180.0 - math.degrees(math.atan2(0.06, 0.08))),
    ],
)
def test_a_plane_has_one_slope_and_falls_one_way(east: float, north: float, falls_to_deg: float) -> None:
    found = summarise_slopes(build_grid(build_plane(east, north)), FIELD.boundary)
    assert found is not None
    assert (found.median, found.p90, found.steepest) == pytest.approx((0.1, 0.1, 0.1), abs=1e-9)
    assert found.aspect_deg == pytest.approx(falls_to_deg, abs=1e-6) and found.aspect_share == pytest.approx(1.0)


def test_a_bowl_has_the_slopes_of_its_paraboloid_and_no_aspect() -> None:
    grid = build_grid(bowl, 2.0)
    found = summarise_slopes(grid, FIELD.boundary)
    assert found is not None
    x, y = np.meshgrid(np.linspace(-100, 100, 801), np.linspace(-80, 80, 641))
    slopes = np.hypot(x / 2000.0, y / 1500.0)
    assert (found.median, found.p90) == pytest.approx(np.quantile(slopes, [0.5, 0.9]), abs=0.001)
    assert found.steepest == pytest.approx(slopes.max(), abs=0.003)
    assert (abs(found.steepest_place_m[0]), abs(found.steepest_place_m[1])) == pytest.approx((98.0, 78.0), abs=2.1)
    assert found.aspect_share < 1e-6 and found.lowest_m == pytest.approx(50.0)
    assert summarise_slopes(grid, shapely.box(1.0e4, 1.0e4, 1.1e4, 1.1e4)) is None


def test_along_is_uphill_and_across_falls_to_the_right() -> None:
    gradients = np.array([[0.1, 0.0], [0.0, 0.1]])  # rising to the east; rising to the north
    along, across = compute_directional_slopes(gradients, 0.5 * math.pi)  # northward
    assert along == pytest.approx([0.0, 0.1]) and across == pytest.approx([-0.1, 0.0])
    along, across = compute_directional_slopes(gradients, np.array([0.0, 0.0]))  # eastward
    assert along == pytest.approx([0.1, 0.0]) and across == pytest.approx([0.0, 0.1])


@given(east=st.floats(-0.5, 0.5), north=st.floats(-0.5, 0.5), heading=st.floats(-math.pi, math.pi))
def test_slopes_along_and_across_are_the_slope(east: float, north: float, heading: float) -> None:
    along, across = compute_directional_slopes(np.array([east, north]), heading)
    assert math.hypot(along, across) == pytest.approx(math.hypot(east, north), abs=1e-12)
    back_along, back_across = compute_directional_slopes(np.array([east, north]), heading + math.pi)
    assert (back_along, back_across) == pytest.approx((-along, -across), abs=1e-12)


def test_slopes_facing_north_west_are_bright() -> None:
    level, lit, dark = (compute_hill_shade(build_grid(build_plane(rise, -rise)))[3, 3] for rise in (0.0, 0.2, -0.2))
    assert level == pytest.approx(math.sqrt(0.5)) and dark < level < lit
    facing = 1.0 / math.sqrt(2.0)  # rises by 1 to the south-east, so it stands square to light at 45 degrees
    assert compute_hill_shade(build_grid(build_plane(facing, -facing)))[3, 3] == pytest.approx(1.0)
    assert compute_hill_shade(build_grid(build_plane(-9.0, 9.0))).max() == 0.0
    assert compute_hill_shade(build_grid(build_plane(0.1, -0.1)), 2.0)[3, 3] == pytest.approx(lit)


def test_contours_lie_at_their_heights() -> None:
    grid = build_grid(build_plane(0.0, 0.05))
    assert choose_contour_interval_m(grid, FIELD.boundary) == 1.0  # 8 m over the field, at most 12 lines
    contours = trace_contours(grid, 1.0)
    assert [level for level, _ in contours] == list(np.arange(46.0, 55.0))
    for level, points in contours:
        assert points[:, 1] == pytest.approx(np.full(len(points), (level - 50.0) / 0.05))
    rings = [points for level, points in trace_contours(build_grid(bowl, 2.0), 0.5) if level == 50.5]
    assert len(rings) == 1 and rings[0][0] == pytest.approx(rings[0][-1])
    assert bowl(*rings[0].T) == pytest.approx(np.full(len(rings[0]), 50.5), abs=2e-3)


@given(east=st.floats(-0.5, 0.5), north=st.floats(-0.5, 0.5), seed=st.integers(0, 10_000))
@settings(max_examples=count_examples(20))
def test_gaps_of_planes_are_filled_by_the_plane(east: float, north: float, seed: int) -> None:
    y, x = np.mgrid[0:20, 0:24] * 1.0
    plane = build_plane(east, north)(x, y)
    chance = np.random.default_rng(seed)
    heights = np.where(chance.random(plane.shape) < 0.6, np.nan, plane)
    heights[5:12, 6:15] = np.nan
    filled = fill_gaps(heights, np.ones(plane.shape, dtype=np.bool_))
    assert np.abs(filled - plane).max() < 1e-5


def test_far_from_the_field_the_nearest_height_holds() -> None:
    heights = np.full((9, 30), np.nan)
    heights[:, :10] = np.arange(10.0)
    near = np.zeros(heights.shape, dtype=np.bool_)
    near[:, 10:15] = True
    filled = fill_gaps(heights, near)
    assert filled[4, :15] == pytest.approx(np.arange(15.0), abs=1e-6) and (filled[4, 15:] == filled[4, 14]).all()
    assert fill_gaps(filled, near) is filled


def test_steeper_ground_has_higher_gradients_at_every_node() -> None:
    gradients = compute_gradients(build_grid(bowl))
    grid = build_grid(bowl)
    x, y = np.meshgrid(grid.xs_m, grid.ys_m)
    assert np.abs(gradients - np.stack([x / 2000.0, y / 1500.0], axis=-1)).max() < 1e-9


def test_grids_that_are_no_ground_are_refused() -> None:
    with pytest.raises(HeadlandError, match=r"shape \(3, 9\); it needs 4 rows and columns"):
        ElevationGrid(0.0, 0.0, 1.0, np.zeros((3, 9)))
    with pytest.raises(HeadlandError, match="not finite"):
        ElevationGrid(0.0, 0.0, 1.0, np.full((5, 5), np.nan))
    wide = lay_nodes(shapely.box(0.0, 0.0, 10_000.0, 10_000.0), 2.0, 15.0)
    assert wide.rows * wide.columns <= 253_000 and wide.spacing_m == pytest.approx(20.06, abs=0.01)
