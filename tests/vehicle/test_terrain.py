"""The surface through a grid of heights: it meets them, is smooth, and its gradient is its derivative."""

import math

import numpy as np
import pytest

from fields.arrays import Floats
from vehicle.errors import VehicleError
from vehicle.model.terrain import Terrain

ROUGH = Terrain(-40.0, 7.0, 2.5, np.random.default_rng(5).normal(0.0, 1.0, (9, 12)))
STEP_M = 1e-5


def spread_points(terrain: Terrain, count: int, margin_m: float = 0.0) -> Floats:
    """Random places at least `margin_m` inside of the outermost nodes."""
    west, south, east, north = terrain.bounds_m
    low, high = np.array([west, south]) + margin_m, np.array([east, north]) - margin_m
    return low + (high - low) * np.random.default_rng(6).random((count, 2))


def build_grid(rise: Floats) -> Floats:
    """Nodes (7, 9, 2) of a grid of 3 m, times `rise`."""
    x, y = np.meshgrid(3.0 * np.arange(9), 3.0 * np.arange(7))
    return np.asarray(rise[0] * x + rise[1] * y)


def test_the_surface_goes_through_every_height() -> None:
    rows, columns = np.indices(ROUGH.heights_m.shape)
    nodes = np.column_stack([-40.0 + 2.5 * columns.ravel(), 7.0 + 2.5 * rows.ravel()])
    assert ROUGH.compute_heights(nodes) == pytest.approx(ROUGH.heights_m.ravel(), abs=1e-12)


def test_the_gradient_is_the_derivative_of_the_height() -> None:
    points = spread_points(ROUGH, 300, 0.01)
    gradients = ROUGH.compute_gradients(points)
    assert np.abs(gradients).max() > 0.5
    for axis in (0, 1):
        step = STEP_M * np.eye(2)[axis]
        differences = (ROUGH.compute_heights(points + step) - ROUGH.compute_heights(points - step)) / (2.0 * STEP_M)
        assert gradients[:, axis] == pytest.approx(differences, abs=1e-4)


def test_the_gradient_does_not_jump_between_cells() -> None:
    border = np.column_stack([np.full(50, -40.0 + 4 * 2.5), np.linspace(8.0, 26.0, 50)])
    near = np.array([1e-9, 0.0])
    assert ROUGH.compute_gradients(border - near) == pytest.approx(ROUGH.compute_gradients(border + near), abs=1e-6)


def test_a_plane_is_a_plane_up_to_its_edges() -> None:
    rise = np.array([0.1, -0.04])
    plane = Terrain(0.0, 0.0, 3.0, 5.0 + build_grid(rise))
    points = np.concatenate([spread_points(plane, 100), [[0.0, 0.0], [24.0, 18.0]]])
    assert plane.compute_heights(points) == pytest.approx(5.0 + points @ rise, abs=1e-12)
    assert plane.compute_gradients(points) == pytest.approx(np.broadcast_to(rise, points.shape), abs=1e-12)


def test_a_bowl_is_exact_one_cell_from_its_edge() -> None:
    x, y = np.meshgrid(3.0 * np.arange(9), 3.0 * np.arange(7))
    bowl = Terrain(0.0, 0.0, 3.0, 0.01 * x**2 - 0.02 * x * y + 0.005 * y**2)
    points = spread_points(bowl, 100, 3.0)
    expected = np.column_stack([0.02 * points[:, 0] - 0.02 * points[:, 1], 0.01 * points[:, 1] - 0.02 * points[:, 0]])
    assert bowl.compute_gradients(points) == pytest.approx(expected, abs=1e-12)


def test_a_closed_lap_climbs_nothing() -> None:
    """The gradient along a circle, summed by the trapezium rule with ever finer steps."""
    angles = np.linspace(0.0, 2.0 * math.pi, 20_001)
    lap = np.array([-26.0, 17.0]) + 8.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    slopes, steps = ROUGH.compute_gradients(lap), np.diff(lap, axis=0)
    climbs = (0.5 * (slopes[1:] + slopes[:-1]) * steps).sum(axis=1)
    assert np.abs(climbs).sum() > 5.0
    assert climbs.sum() == pytest.approx(0.0, abs=1e-5)


def test_beyond_an_edge_the_ground_goes_on_at_its_height() -> None:
    corner = ROUGH.heights_m[-1, -1]
    east, north = ROUGH.bounds_m[2:]
    assert ROUGH.compute_heights([[east + 50.0, north + 3.0]])[0] == pytest.approx(corner)
    assert ROUGH.compute_gradients([[east + 50.0, north + 3.0]])[0].tolist() == [0.0, 0.0]
    assert ROUGH.covers([[east, north], [-40.0, 7.0]])
    assert not ROUGH.covers([[east + 0.1, north]])
    assert ROUGH.covers([[east + 0.1, north]], margin_m=0.2)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((0.0, 0.0, 5.0, np.zeros((1, 9))), "2 rows and columns"),
        ((0.0, 0.0, 0.0, np.zeros((4, 4))), "a spacing above 0"),
        ((math.nan, 0.0, 1.0, np.zeros((4, 4))), "finite metres"),
        ((0.0, 0.0, 1.0, np.full((4, 4), np.nan)), "fill the gaps"),
    ],
)
def test_heights_that_are_no_ground_are_refused(values: tuple[float, float, float, object], words: str) -> None:
    with pytest.raises(VehicleError, match=words):
        Terrain(*values)  # type: ignore[arg-type]
