"""What the table of cells takes for inside is inside, however the area is shaped, and it knows most of it."""

import numpy as np
import pytest
import shapely

from planner.evaluation.ground.coverage import InteriorCellTable

OFF_M = 2.5


@pytest.fixture(scope="module")
def area() -> shapely.Geometry:
    """Some 60 ha with 900 points on a waved outline, and two ponds in it."""
    angle = 2.0 * np.pi * np.arange(900) / 900
    reach = 420.0 * (1.0 + 0.08 * np.sin(3.0 * angle) + 0.03 * np.sin(17.0 * angle))
    outline = shapely.Polygon(np.column_stack([1.3 * reach * np.cos(angle), 0.85 * reach * np.sin(angle)]))
    ponds = [
        shapely.Point(place).buffer(size_m) for place, size_m in (((90, 40), 25), ((-200, 0), 12), ((0, -170), 30))
    ]
    return shapely.difference(outline, shapely.union_all(ponds))


@pytest.fixture(scope="module")
def places(area: shapely.Geometry) -> np.ndarray:
    west, south, east, north = area.bounds
    rng = np.random.default_rng(5)
    spread = rng.uniform((west - 50.0, south - 50.0), (east + 50.0, north + 50.0), (20_000, 2))
    near = shapely.get_coordinates(area) + rng.normal(0.0, 8.0, (len(shapely.get_coordinates(area)), 2))
    return np.column_stack([np.concatenate([spread, near]), np.zeros(len(spread) + len(near))])


def test_what_is_sure_lies_so_far_inside(area, places):
    sure = np.delete(np.arange(len(places)), InteriorCellTable(area, OFF_M).find_uncertain(places))
    points = shapely.points(places[sure, :2])
    assert shapely.contains_properly(area, points).all()
    assert shapely.distance(area.boundary, points).min() > OFF_M


def test_most_of_the_field_is_known(area, places):
    within = shapely.contains_xy(area, places[:, :2])
    unsure = InteriorCellTable(area, OFF_M).find_uncertain(places)
    assert within[unsure].sum() < 0.25 * within.sum()
    assert np.isin(np.flatnonzero(~within), unsure).all()


@pytest.mark.parametrize("area", [shapely.Polygon(), shapely.box(0.0, 0.0, 0.0, 0.0), shapely.box(3.0, 3.0, 4.0, 9.0)])
def test_nothing_is_known_of_what_has_no_inside(area):
    places = np.array([[3.5, 6.0], [0.0, 0.0], [np.nan, 1.0]])
    assert InteriorCellTable(area, OFF_M).find_uncertain(places).tolist() == [0, 1, 2]
