"""Rough outlines: cleaned on the safe side, with what changed told; ordinary ones stay as they are."""

import re
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields import list_sample_names, read_field
from fields.arrays import Floats
from fields.geometry.outline_cleaning import clean_outline
from tests.drawn_fields import feature
from tests.fields.geojson import SQUARE_M, collection, moved, polygon, refusal

CORNERS_M = np.array([[0.0, 0.0], [260.0, 10.0], [250.0, 170.0], [120.0, 190.0], [-10.0, 150.0]])


def walk(corners: Floats, count: int) -> Floats:
    """Points at even distances along the sides of a polygon."""
    ring = shapely.LinearRing(corners)
    places = np.linspace(0.0, ring.length, count, endpoint=False)
    return np.asarray(shapely.get_coordinates(shapely.line_interpolate_point(ring, places)))


def make_rough(count: int, seed: int = 1, noise_m: float = 0.3) -> Floats:
    """A field of 4.4 ha with noise in every direction, so that the line crosses itself."""
    return walk(CORNERS_M, count) + np.random.default_rng(seed).normal(0.0, noise_m, (count, 2))


def get_coordinates(ring: Floats) -> list[list[float]]:
    return [*ring.tolist(), ring[0].tolist()]


@pytest.mark.slow
@pytest.mark.parametrize("count", [2_000, 10_000])
def test_noise_and_a_spike_are_cleaned(saved: Any, count: int) -> None:
    ring = make_rough(count)
    spiked = np.concatenate([ring[:600], [ring[599] + [20.0, -25.0], ring[599]], ring[600:]])
    field = read_field(saved(polygon(get_coordinates(spiked))), local=True)
    (remark,) = field.remarks
    pattern = r"cleaned to \d+ cm: (\d+) of its (\d+) points .* is ([\d.]+) m from .* changed by (-?\d+) m2\."
    kept, drawn, moved_m, lost_m2 = map(float, re.search(pattern, remark).groups())  # type: ignore[union-attr]
    assert (drawn, kept) == (count + 2, len(field.boundary.exterior.coords) - 1)
    assert kept <= 100
    assert moved_m == pytest.approx(field.boundary.exterior.distance(shapely.Point(spiked[600])), abs=0.01)
    true = shapely.Polygon(CORNERS_M)
    assert -0.03 * true.area < lost_m2 < 0.0
    assert field.area_m2 == pytest.approx(true.area, rel=0.03)
    assert shapely.hausdorff_distance(field.boundary.exterior, true.exterior, 0.01) < 2.6


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(400, 3_000), noise_m=st.floats(0.0, 0.4))
def test_a_cleaned_field_lies_in_the_drawn_one(seed: int, count: int, noise_m: float) -> None:
    ring = make_rough(count, seed, noise_m)
    drawn = shapely.make_valid(shapely.Polygon(ring), method="structure")
    field, _ = clean_outline([ring], "a") or pytest.fail("not cleaned")
    assert shapely.difference(field, drawn).area < 1e-3 * drawn.area
    again, remarks = clean_outline([shapely.get_coordinates(field.exterior)[:-1]], "a") or pytest.fail("not cleaned")
    assert again.equals_exact(field) and remarks == ()


def test_an_obstacle_and_a_hole_grow(saved: Any) -> None:
    rough = make_rough(3_000, 2, 0.3) / 10.0 + [100.0, 30.0]
    pond = feature(polygon(get_coordinates(rough)), role="obstacle", name="pond")
    drawn = shapely.make_valid(shapely.Polygon(rough), method="structure")
    field = read_field(saved(collection(feature(polygon(SQUARE_M)), pond)), local=True)
    assert field.remarks[0].startswith("The outline of obstacle 'pond' of 'plot.geojson' was cleaned to ")
    assert shapely.difference(drawn, field.obstacles[0].shape).area < 1e-3
    assert len(field.obstacles[0].shape.exterior.coords) <= 101
    tree = feature(polygon(get_coordinates(rough / 10.0)), name="tree")
    field = read_field(saved(collection(feature(polygon(SQUARE_M)), tree)), local=True)
    assert len(field.obstacles[0].shape.exterior.coords) <= 101 and field.obstacles[0].shape.area < 20.0
    holed = read_field(saved(polygon(SQUARE_M, get_coordinates(rough))), local=True)
    assert shapely.intersection(drawn, holed.boundary).area < 1e-3
    assert shapely.Polygon(holed.boundary.exterior).equals(shapely.box(0, 0, 200, 100))


def test_ordinary_outlines_stay(saved: Any) -> None:
    for name in list_sample_names():
        boundary = read_field(name).boundary
        rings = [shapely.get_coordinates(ring)[:-1] for ring in (boundary.exterior, *boundary.interiors)]
        assert clean_outline(rings, name) == (boundary, ())
    jagged = walk(CORNERS_M, 100) + np.random.default_rng(3).normal(0.0, 0.3, (100, 2))
    assert clean_outline([jagged], "a") == (shapely.Polygon(jagged), ())


def test_an_area_that_does_not_change_by_a_metre_has_no_sign() -> None:
    """A ring of 600 points on a circle of 1 m is cleaned inwards."""
    angles = np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False)
    cleaned, (remark,) = clean_outline([np.column_stack([np.cos(angles), np.sin(angles)])], "a") or pytest.fail()
    assert -0.5 < cleaned.area - np.pi < 0.0 and remark.endswith("changed by 0 m2.")


def test_what_is_beyond_repair_is_refused(saved: Any) -> None:
    assert "crosses itself at" in refusal(saved(polygon([[0, 0], [100, 100], [100, 0], [0, 100], [0, 0]])), local=True)
    small_loop = [[0, 0], [200, 0], [200, 102], [197, 98], [200, 98], [196, 102], [0, 100], [0, 0]]
    field = read_field(saved(polygon(small_loop)), local=True)
    assert field.area_m2 == pytest.approx(20_000, rel=0.03) and "was cleaned to 5 cm" in field.remarks[0]
    outside = polygon(SQUARE_M, moved([[0, 0], [9, 0], [9, 9], [0, 0]], 500))
    assert "a hole lies outside" in refusal(saved(outside), local=True)
